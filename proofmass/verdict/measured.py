"""Verdicts on measured curves with noise: `sigma` in a tolerance of the sidecar."""

from dataclasses import astuple, replace

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.recorded import interpolate_recorded
from proofmass.base.strict import Kind
from proofmass.base.wording import format_fitted, format_list, number
from proofmass.case.case import Case, Tolerance
from proofmass.sim.engines import computes_curves
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparison, NoiseResult
from proofmass.verdict.noise import (
    FALSE_REFUSALS,
    TEST_SHARE,
    MeasuredCurve,
    NoiseTest,
    Residual,
    TooFewRows,
    estimate_sigma,
    fit_residual,
    largest_limit,
)
from proofmass.verdict.outcome import Outcome

KNOWN_SHARE_OF_NOISE = 0.1
"""Share of sigma up to which the curve without noise must be known at the rows: it adds 0.5 % to
the size of the noise."""


def measured_channels(case: Case, run: Kind, solver: str) -> dict[str, Tolerance]:
    """The channels of a run whose tolerance is the noise of a measured curve."""
    found = {name: case.tolerance_for(run, solver, name) for name in case.channels_of(run)}
    return {name: one for name, one in found.items() if one and one.sigma is not None}


def noise_level(case: Case, run: Kind, solver: str) -> float:
    """The chance of a false refusal that each measured channel of a run has."""
    return FALSE_REFUSALS / max(len(measured_channels(case, run, solver)), 1)


def allowed_noise(
    case: Case, run: Kind, solver: str, name: str, difference: Array | None, count: int
) -> float | None:
    """The largest residual that noise has at some rows of a channel [SI].

    The size of noise that is estimated is that of the `difference` (n,) of the curves; None if it
    is not known.
    """
    sigma = measured_channels(case, run, solver)[name].noise
    if sigma is not None:
        sigma *= case.channels[name].factor
    elif difference is not None:
        sigma = estimate_sigma(difference)
    if sigma is None:
        return None
    return sigma * largest_limit(count, TEST_SHARE * noise_level(case, run, solver))


def measured_curve(solver: str, name: str, curves: Curves, reference: Curves) -> MeasuredCurve:
    """A channel of a recorded file at its own rows, and the curve that is compared with it.

    The recorded file is the reference, or else the solver.
    """
    order = slice(None, None, 1 if curves.x[-1] > curves.x[0] else -1)
    x, pair = curves.x[order], (curves.channels[name], reference.channels[name])
    is_solver = name in curves.rows or not (computes_curves(solver) or name in reference.rows)
    measured, smooth = (one[order] for one in (pair if is_solver else pair[::-1]))
    rows = (curves if is_solver else reference).rows.get(name)
    return MeasuredCurve(*(rows or (x, measured)), x, smooth)


def residuals_of(
    case: Case, run: Kind, solver: str, curves: Curves, reference: Curves
) -> dict[str, Residual | TooFewRows]:
    """The residuals of the measured channels of a run [SI], or why a channel has none."""
    found = dict[str, Residual | TooFewRows]()
    for name, tolerance in measured_channels(case, run, solver).items():
        if name not in curves.channels:
            continue
        curve = measured_curve(solver, name, curves, reference)
        if not np.isfinite(curve.measured).all() or not np.isfinite(curve.smooth).all():
            continue  # as of any curve that is no number somewhere
        sigma = tolerance.noise
        try:
            found[name] = fit_residual(
                curve, None if sigma is None else sigma * case.channels[name].factor, tolerance.fit
            )
        except TooFewRows as error:
            found[name] = error
    return found


def judge_noise(
    comparison: Comparison,
    case: Case,
    residual: Residual | TooFewRows,
    scale: float,
) -> Comparison:
    """A comparison of a measured channel whose residual is judged as noise.

    Parameters
    ----------
    comparison : Comparison
        The one of the curves at the samples.
    case : Case
    residual : Residual or TooFewRows
        From `residuals_of`.
    scale : float
        That of the reference curve [its unit].
    """
    if isinstance(residual, TooFewRows):
        return replace(comparison, outcome=Outcome.UNDECIDED, message=str(residual))
    channel, curve = case.channels[comparison.channel], residual.curve
    level = noise_level(case, comparison.run, comparison.solver)  # type: ignore[arg-type]
    tests, error = residual.tests(level), np.abs(residual.values) / channel.factor
    worst, rms = int(np.argmax(error)), float(np.sqrt(np.mean(error**2)))
    limit = next(one.limit for one in tests if one.name == "largest")
    unsure = float(interpolate_recorded(curve.x, curve.samples, curve.smooth)[1].max())
    found = replace(
        comparison,
        error_max=float(error[worst]),
        at=float(curve.x[worst]),
        error_rms=rms,
        nrmse=rms / scale if scale else float("nan"),
        allowed=limit * residual.sigma / channel.factor,
        uncertainty=unsure / channel.factor,
        noise=noise_result(residual, tests, channel.factor),
    )
    if unsure > KNOWN_SHARE_OF_NOISE * residual.sigma:
        return replace(found, outcome=Outcome.UNDECIDED, message=explain_coarse(found))
    tolerance = case.tolerance_for(found.run, found.solver, found.channel)
    assert tolerance is not None
    bad = [one for one in tests if not one.passes]
    if bad:
        message = f"{format_list(one.words for one in bad)}: {describe_noise(found)}"
        return replace(found, outcome=Outcome.DIFFERS, message=message)
    words = format_list(one.words for one in tests)
    message = f"{tolerance.why}; {describe_noise(found)}; {words}"
    return replace(found, outcome=Outcome.AGREES, message=message)


def noise_result(residual: Residual, tests: tuple[NoiseTest, ...], factor: float) -> NoiseResult:
    """What is reported of a residual [SI], in the unit of its channel."""
    units = {"zero": factor, "lag": 1.0}
    return NoiseResult(
        residual.sigma / factor,
        residual.estimated,
        residual.count,
        {one.name: (one.value, one.limit) for one in tests},
        {k: astuple(one.over(units[k])) for k, one in residual.fits.items()},
    )


def describe_noise(found: Comparison) -> str:
    """The size of the noise and the fitted numbers, in words."""
    noise = found.noise
    assert noise is not None
    known = "estimated" if noise.estimated else "stated"
    words = [f"noise of {number(noise.sigma)} {found.unit}, as {known}, in {noise.rows} rows"]
    for name, (value, error) in noise.fits.items():
        unit = unit_of_fit(name, found.unit, found.run)
        words.append(f"{name} {format_fitted(value, error)} {unit} fitted")
    return ", ".join(words)


def unit_of_fit(name: str, unit: str, run: str) -> str:
    """The unit of a fitted number of a channel in a unit.

    >>> unit_of_fit("zero", "deg", "dynamics"), unit_of_fit("lag", "deg", "dynamics")
    ('deg', 's')
    """
    if name == "zero":
        return unit
    return "s" if run == "dynamics" else "of x"


def explain_coarse(found: Comparison) -> str:
    """Why a measured curve is not judged: the curve it is compared with is not known closely."""
    assert found.noise is not None
    return (
        f"the curve without noise is known to {number(found.uncertainty)} {found.unit} alone "
        f"between its samples, more than {KNOWN_SHARE_OF_NOISE:g} of the noise of "
        f"{number(found.noise.sigma)} {found.unit}: give the run more samples, or the file even "
        "times"
    )
