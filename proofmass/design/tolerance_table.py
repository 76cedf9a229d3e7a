"""The band of a balancer's moment by tolerances of manufacture: its record, sentence and figure."""

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from proofmass.report.style import RC  # isort: skip
from matplotlib import rc_context
from matplotlib.figure import Figure

from proofmass.base.arrays import Array
from proofmass.base.files import write_output
from proofmass.design.tolerances import BAND_PERCENTILES, Deviation, ToleranceBand

GROUP_WORDS = {
    "length": "lengths",
    "stiffness": "stiffnesses",
    "preload": "preloads",
    "angle": "angles",
}
"""Words of the groups of tolerances."""


def record_band(
    band: ToleranceBand, deviations: list[Deviation], wanted: Array, seed: int
) -> dict[str, Any]:
    """The band as JSON has it; angles in radians, moments over m g r."""
    errors = band.errors(wanted)
    exact = float(np.sqrt(np.mean((band.nominal - wanted) ** 2)))
    return {
        "seed": seed,
        "samples": len(band.moments) + band.failed,
        "failed": band.failed,
        "deviations": {one.name: one.size for one in deviations},
        "angle": band.angle.tolist(),
        "wanted": wanted.tolist(),
        "nominal": band.nominal.tolist(),
        "percentiles": list(BAND_PERCENTILES),
        "low": band.low.tolist(),
        "high": band.high.tolist(),
        "least": band.least.tolist(),
        "most": band.most.tolist(),
        "standard_deviation": band.moments.std(axis=0).tolist(),
        "linear_standard_deviation": band.linear.tolist(),
        "nominal_rmse": exact,
        "rmse_percentiles": dict(
            zip(
                ("2.5", "50", "97.5"),
                np.percentile(errors, (2.5, 50.0, 97.5)).tolist(),
                strict=True,
            )
        ),
        "largest_rmse": float(errors.max()),
        "shares": band.shares,
    }


def tell_band(record: dict[str, Any]) -> str:
    """The band in one sentence."""
    width = np.array(record["high"]) - np.array(record["low"])
    widest = int(width.argmax())
    first = max(record["shares"], key=record["shares"].__getitem__)
    place = f"{np.degrees(record['angle'][widest]):.0f} degrees"
    failed = f"; {record['failed']} of them fold or lock before 90 degrees" * bool(record["failed"])
    return (
        f"tolerances: of {record['samples']} balancers within them the rms error is "
        f"{record['rmse_percentiles']['50']:.5f} m g r in the middle and "
        f"{record['rmse_percentiles']['97.5']:.5f} at 97.5 % (exactly built "
        f"{record['nominal_rmse']:.5f}), 95 % of the moments lie within "
        f"{0.5 * width[widest]:.4f} m g r to either side at {place}, and {GROUP_WORDS[first]} "
        f"cause {100 * record['shares'][first]:.0f} % of the variance{failed}"
    )


def write_band(record: dict[str, Any], stem: Path) -> list[Path]:
    """Write the band to JSON, SVG and PNG files, and return their paths."""
    write_output(stem.with_suffix(".json"), json.dumps(record, indent=1))
    with rc_context(RC):
        figure = draw_band(record)
        for ending in ("svg", "png"):
            drawn = BytesIO()
            figure.savefig(drawn, format=ending, dpi=150)
            write_output(stem.with_suffix(f".{ending}"), drawn.getvalue())
    return [stem.with_suffix(ending) for ending in (".json", ".svg", ".png")]


def draw_band(record: dict[str, Any]) -> Figure:
    """The wanted moment with the band, and the error's band on a scale of its own."""
    figure = Figure((7.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    angle = np.degrees(record["angle"])
    wanted = np.array(record["wanted"])
    for axes, zero in ((left, 0.0 * wanted), (right, wanted)):
        least, low, high, most, nominal = (
            np.array(record[name]) - zero for name in ("least", "low", "high", "most", "nominal")
        )
        axes.fill_between(angle, least, most, color="#0072B2", alpha=0.15, lw=0, label="extremes")
        axes.fill_between(angle, low, high, color="#0072B2", alpha=0.35, lw=0, label="95 %")
        axes.plot(angle, nominal, color="#0072B2", label="exactly built")
        axes.plot(angle, wanted - zero, color="black", linestyle="--", label="wanted")
        axes.set(xlabel="angle [deg]", xlim=(0, 90))
        axes.set_xticks(range(0, 91, 15))
    left.set(ylabel="moment / m g r", title=f"Moments of {record['samples']} balancers")
    right.set(ylabel="error / m g r", title="Their errors")
    words = "Variance: " + shares_text(record)
    right.text(0.02, 0.98, words, transform=right.transAxes, fontsize=6.5, va="top")
    left.legend(loc="upper left")
    return figure


def shares_text(record: dict[str, Any]) -> str:
    """The shares of the groups in the variance, the largest first."""
    ordered = sorted(record["shares"].items(), key=lambda pair: -pair[1])
    return ", ".join(f"{GROUP_WORDS[group]} {100 * share:.0f} %" for group, share in ordered)
