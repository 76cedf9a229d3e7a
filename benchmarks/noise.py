"""How often noise is refused, and a wrong length found in it: a table of docs/noise.md.

    python -m benchmarks.noise [--quick]

The angles of a four-bar are measured at 401 rows over two turns, 1000 times with other noise, and
compared with the closed form.  In each row of the table one length of the mechanism is wrong by 0,
4, 5 or 6 of its standard errors, of all four lengths in turn.  The residuals are the slopes of the
closed form times the error, plus noise: what the wrong mechanism would have, to first order.  The
tests are those of `proofmass check`.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import ROOT, command
from docs.make.marks import write_between
from proofmass.evidence.diagnosis.causes import best_causes
from proofmass.evidence.diagnosis.fit import Residuals
from proofmass.evidence.diagnosis.measured import MeasuredNumbers, measured_numbers
from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.verdict.noise import estimate_sigma

SEEDS, QUICK_SEEDS = 1000, 8
"""Measurements of each row of the table."""
ROWS, SIGMA = 401, 0.05
"""Rows of the file, and standard deviation of the noise [deg]."""
ERRORS = 0.0, 4.0, 5.0, 6.0
"""Errors of a length, in its standard errors."""
LENGTHS = "crank", "coupler", "rocker", "ground"
RIG = "recorded:rig"
PAGE = ROOT / "docs" / "noise.md"
BEGIN = "<!-- python -m benchmarks.noise writes the table from here to the next mark -->"
END = "<!-- to here: table -->"
SIDECAR = """title = "Noise"
source = "benchmarks/noise.py"
model = {model!r}
reference = "fourbar"
[parameters]
crank = 1.0
coupler = 2.0
rocker = 2.5
ground = 3.0
mode = 1
[drive]
joint = "crank"
from = 0.0
to = {end!r}
rate = 6.283185307179586
[run.dynamics]
n = {rows}
solvers = ["recorded:rig"]
[settings."recorded:rig"]
file = "rig.csv"
channels = {{ {columns} }}
[channels]
rocker = {{ equals = "rocker_angle", unit = "deg" }}
{more}
[[tolerance]]
sigma = {sigma}
{fit}
why = "noise"
"""
SET_UPS = {
    "rocker": (("rocker",), f"{SIGMA}", ""),
    "rocker, zero fitted": (("rocker",), f"{SIGMA}", 'fit = "zero"'),
    "rocker, noise estimated": (("rocker",), '"estimated"', ""),
    "rocker and coupler": (("rocker", "coupler.angle"), f"{SIGMA}", ""),
}
"""The channels that are measured, their noise, and what is fitted."""


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table, and write it into the page."""
    given = command(__doc__).parse_args(argv)
    seeds = QUICK_SEEDS if given.quick else SEEDS
    lines = ["| measured | length off by | refused | named first |", "|---|---|---|---|"]
    for name, (channels, sigma, fit) in SET_UPS.items():
        with TemporaryDirectory() as folder:
            exact = write_rig(Path(folder), channels, sigma, fit)
        for error in ERRORS:
            refused, named, there = 0, 0, 0
            for length in LENGTHS if error else LENGTHS[:1]:
                for seed in range(seeds // len(LENGTHS) if error else seeds):
                    found = with_noise(exact, length, error, seed)
                    differs = bool(found.differing)
                    causes = best_causes(found.explanations) if differs and error else ()
                    there, refused = there + 1, refused + differs
                    named += bool(causes) and [*causes[0].changes] == [length]
            first = f"{100 * named / there:.1f} %" if error else ""
            off = f"{error:g} standard errors" if error else "nothing"
            lines.append(f"| {name} | {off} | {100 * refused / there:.1f} % | {first} |")
            print(lines[-1], flush=True)
    if not given.quick:
        text = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(write_between(text, BEGIN, END, "\n".join(lines)), encoding="utf-8")


def write_rig(folder: Path, channels: tuple[str, ...], sigma: str, fit: str) -> MeasuredNumbers:
    """A case whose file has the curves of the closed form, to 12 digits, and its numbers."""
    columns = ", ".join(f'"{one}" = "{one}"' for one in channels)
    more = (
        '"coupler.angle" = { equals = "coupler_angle", unit = "deg" }' if len(channels) > 1 else ""
    )
    model = str(ROOT / "models" / "linkages" / "fourbar.xml")
    text = SIDECAR.format(
        model=model, rows=ROWS, columns=columns, more=more, sigma=sigma, fit=fit, end=4.0 * math.pi
    )
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    times = np.linspace(0.0, 2.0, ROWS)
    header = ",".join(["t [s]", *(f"{one} [deg]" for one in channels)])
    (folder / "rig.csv").write_text(f"{header}\n", encoding="utf-8")
    rows = np.zeros((ROWS, len(channels)))
    for _ in range(2):  # the second time with the curves of the reference
        np.savetxt(
            folder / "rig.csv",
            np.column_stack([times, rows]),
            "%.12g",
            ",",
            header=header,
            comments="",
        )
        case = load_case(folder / "rig.toml")
        found = evaluate(case, "dynamics", times, drive_of(times)).channels
        rows = np.degrees(np.stack([found[one] for one in channels], axis=1))
    numbers = measured_numbers(Residuals(case, "dynamics", RIG, solve_here(case, "dynamics", RIG)))
    assert numbers is not None
    return numbers


def drive_of(times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The motion of the crank."""
    rate = np.full((1, times.size), 2.0 * math.pi)
    return rate * times, rate, 0.0 * rate


def with_noise(exact: MeasuredNumbers, length: str, error: float, seed: int) -> MeasuredNumbers:
    """The numbers with residuals of noise and of a length that is wrong by some standard errors."""
    rng = np.random.default_rng(seed)
    share = error * exact.fit.changes[length].error * size_of_noise(exact) if error else 0.0
    measured = {}
    for name, one in exact.measured.items():
        noise = math.radians(SIGMA) * rng.standard_normal(one.count)
        values = one.without_fits(noise + share * exact.slopes[length][name])
        sigma = estimate_sigma(values) if one.estimated else one.sigma
        measured[name] = replace(one, values=values, sigma=sigma)
    return replace(exact, measured=measured)


def size_of_noise(exact: MeasuredNumbers) -> float:
    """The noise over that which the standard errors of the exact curves are for."""
    return math.radians(SIGMA) / next(iter(exact.measured.values())).sigma


if __name__ == "__main__":
    main()
