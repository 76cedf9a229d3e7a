"""Compare curves with the reference: one `Comparison` for each channel of each solver."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.base.units import MOTION_UNITS, POSITION_UNITS, unit_powers
from proofmass.case.case import MAX_TOLERANCE_SHARE, Case, Tolerance
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.find import assembly_modes
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.run_reference import RunReference
from proofmass.sim.contents import joints, mass, sensors_of_drive, size
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import MIN_FREE_STEP_SHARE, MIN_STEP_SHARE, Run, fitting_samples
from proofmass.verdict.comparison import Comparison, Comparisons, DetectableChange
from proofmass.verdict.detectable import detectable_changes
from proofmass.verdict.measured import allowed_noise, judge_noise, residuals_of
from proofmass.verdict.noise import Residual, TooFewRows
from proofmass.verdict.outcome import Outcome, judge_error

NAN = float("nan")
PROFILE_TIMES = 101
"""Number of times at which the rates of drives are looked up between samples that are at rest."""
REST_SHARE = 1e-3
"""Share of a drive's mean rate up to which it counts as at rest at all samples: they are at its
turning points.  Rounding, and what an engine's drive is off by, are smaller."""
MIN_DRIVEN_DISTANCE = 1e-6
"""Distance of a drive from its first value up to which it stays there [rad or m]: what an engine's
drive is off by at a turning point."""
START_SHARE = 0.1  # share of a dynamics run after which errors of the start pose have decayed
CONSTANT_RANGE = 1e-3
"""Range over size of a curve below which it counts as constant; drives cause as much variation."""
ZERO_SHARE = 1e-12  # share of the mechanism's size up to which a reference's values count as zero


class MechanismSizes(NamedTuple):
    """Length, mass and time of a mechanism in a run, of which products have the other units.

    Attributes
    ----------
    length : float
        Its size, or the extent of a single body [m].
    mass : float
        The mass of all bodies that can move [kg].
    time : float
        1 over the largest rate of a drive at the samples (`length` over the largest speed of a
        slide), or the duration of a free motion [s].  If all samples are at turning points of the
        drives, the rates are those between them.  0 if neither drives nor the run define one.
    """

    length: float
    mass: float
    time: float

    def scale(self, unit: str, reference: Array) -> float:
        """The scale of a reference curve (n,) that ``relative_to_range`` refers to [SI].

        The scale is the range of the curve.  If the range is less than a thousandth of the curve's
        size, the curve counts as constant, and its scale is its size:

        - of a position the size of the mechanism, and of an angle 1 rad, since where a position or
          an angle is zero is a convention;
        - of any other curve its largest magnitude;
        - of any other curve that is zero throughout, the product of powers of length, mass and time
          that has the `unit`: L / T of a velocity, M L^2 / T^2 of a moment.
        """
        own, span = 1.0, float(np.ptp(reference))
        for base, power in zip(self, unit_powers(unit)[:3], strict=True):
            own *= (base**power if base else 0.0) if power else 1.0
        magnitude = float(np.abs(reference).max())
        if unit in ("m", "rad") or not magnitude > ZERO_SHARE * own:
            magnitude = own
        return span if span >= CONSTANT_RANGE * magnitude else magnitude


def compare(
    case: Case,
    run: Kind,
    solver: str,
    curves: Curves,
    detectable: bool = True,
    reference: RunReference | None = None,
) -> Comparisons:
    """Compare a solver's curves with the reference.

    Parameters
    ----------
    case : Case
        Has the channels and their tolerances.
    run, solver : str
        The run and the solver that the curves belong to.
    curves : Curves
        From `solve`.
    detectable : bool
        Whether to find `Comparison.detectable` and the `properties` of the case as well. The
        reference is then evaluated at least twice for each parameter.
    reference : RunReference, optional
        The reference of the run, if several solvers are compared with it: it is then evaluated
        once at changed parameters.

    Returns
    -------
    Comparisons
        One comparison for each channel, in the order of the sidecar, and the reference.

    Raises
    ------
    InputError
        The model is assembled in another mode than the sidecar says; a tolerance lets a curve
        pass that does not move.
    """
    evaluated = reference or RunReference(case, run, curves)
    driven = evaluated.as_driven(curves.drive)
    check_assembly_mode(case, run, curves, driven)
    sizes = mechanism_sizes(case, run, curves)
    check_tolerances(case, run, solver, sizes, driven.channels)
    changes: dict[str, dict[str, DetectableChange]] = {}
    if detectable:
        changes = detectable_changes(
            evaluated, allowed_errors(case, run, solver, curves, driven.channels)
        )
    residuals = residuals_of(case, run, solver, curves, driven)
    found = [
        compare_channel(
            case,
            run,
            solver,
            name,
            curves,
            driven.channels[name],
            changes.get(name, {}),
            driven.uncertainty.get(name, 0.0),
            sizes,
            residuals.get(name),
        )
        for name in case.channels_of(run)
    ]
    judged = judge_run(case, run, curves, driven.channels, found)
    return Comparisons(judged, driven, evaluated.properties if detectable else None)


def compare_channel(
    case: Case,
    run: Kind,
    solver: str,
    name: str,
    curves: Curves,
    reference: Array,
    detectable: dict[str, DetectableChange],
    reference_error: Array | float = 0.0,
    sizes: MechanismSizes | None = None,
    residual: Residual | TooFewRows | None = None,
) -> Comparison:
    """Compare one channel: the curves are in SI units, the comparison in the channel's unit.

    `reference_error` is the error that the reference may have at each sample [SI].  `sizes` are
    those of the run, if they were found before.  `residual` is that of a measured channel.
    """
    tolerance, unit = case.tolerance_for(run, solver, name), case.channels[name].unit
    factor = case.channels[name].factor
    sizes = sizes or mechanism_sizes(case, run, curves)
    scale = sizes.scale(case.channels[name].si_unit, reference) / factor
    allowed = tolerance.allowed(scale) if tolerance else NAN
    place: dict[str, Any] = {
        "case": case.name,
        "solver": solver,
        "run": run,
        "channel": name,
        "unit": unit,
        "allowed": allowed,
        "seconds": curves.seconds,
        "steps": curves.steps,
        "violation": curves.violation,
        "at_unit": unit_of_x(case, run),
    }
    if name not in curves.channels:
        return Comparison(
            **place, outcome=Outcome.UNSUPPORTED, message=curves.missing.get(name, "")
        )
    error = np.abs(curves.channels[name] - reference) / factor
    worst = int(np.argmax(np.where(np.isfinite(error), error, np.inf)))
    unsure = (curves.uncertainty.get(name, np.zeros_like(error)) + reference_error) / factor
    rms = float(np.sqrt(np.mean(error**2)))
    found: dict[str, Any] = {
        "error_max": float(error[worst]),
        "at": float(curves.x[worst]),
        "error_rms": rms,
        "nrmse": rms / scale if scale else NAN,
        "error_later": float(error[curves.x >= end_of_start(curves)].max())
        if run == "dynamics"
        else NAN,
        "detectable": detectable,
        "uncertainty": float(unsure.max(initial=0.0)),
    }
    if residual is not None:
        return judge_noise(Comparison(**place, **found), case, residual, scale)
    why = tolerance.why if tolerance else ""
    outcome, message = judge_error(float(error[worst]), allowed, unit, why)
    if outcome == Outcome.UNCHECKED and solver in case.asked:
        outcome, message = Outcome.MEASURED, ""
    if np.isfinite(error).all() and allowed > 0:
        least, most = float((error - unsure).max()), float((error + unsure).max())
        if least <= allowed < most:
            outcome = Outcome.UNDECIDED
            message = explain_undecided(found["uncertainty"], allowed, unit)
    return Comparison(**place, **found, outcome=outcome, message=message)


def unit_of_x(case: Case, run: Kind) -> str:
    """The SI unit of a run's x: s in time, m along rods, that of the leading drive in a sweep.

    >>> from proofmass import load_case
    >>> case = load_case("models/linkages/fourbar.toml")
    >>> unit_of_x(case, "sweep"), unit_of_x(case, "dynamics")
    ('rad', 's')
    """
    if run == "equilibrium":
        return "m"
    if run == "dynamics" or case.leader is None or not case.leader.steady:
        return "s"
    return str(joints(compiled_model(case))[case.leader.joint])


def check_tolerances(
    case: Case, run: Kind, solver: str, sizes: MechanismSizes, reference: Mapping[str, Array]
) -> None:
    """Raise InputError if a tolerance lets a curve pass that does not move, see `passes_unmoved`.

    A curve that is zero up to rounding has no scale of its own and is left out: the rounding is
    that of the largest curve with its unit, or by the mechanism's size, and a tolerance may cover
    larger curves as well.
    """
    largest: dict[str, float] = {}
    for name, channel in case.channels_of(run).items():
        size = float(np.abs(reference[name]).max())
        largest[channel.si_unit] = max(largest.get(channel.si_unit, 0.0), size)
    for name, channel in case.channels_of(run).items():
        tolerance = case.tolerance_for(run, solver, name)
        if tolerance is None or tolerance.relative_to_range is not None:  # checked on reading
            continue
        scale = sizes.scale(channel.si_unit, reference[name])
        moved = np.ptp(reference[name])
        if channel.si_unit not in POSITION_UNITS:
            moved = np.abs(reference[name]).max()
        zero = moved <= ZERO_SHARE * max(scale, largest[channel.si_unit])
        allowed = allowed_error(case, run, solver, name, sizes, reference[name])
        if allowed is not None and not zero and passes_unmoved(allowed, scale):
            raise loose_tolerance(
                case, name, tolerance, *(x / channel.factor for x in (allowed, scale))
            )


def loose_tolerance(
    case: Case, name: str, tolerance: Tolerance, allowed: float, scale: float
) -> InputError:
    """The error of a tolerance that lets a curve of this scale pass that does not move."""
    unit = "" if case.channels[name].unit == "1" else f" {case.channels[name].unit}"
    return case.error(
        f"tolerance.{case.tolerance.index(tolerance)}",
        f"it allows {allowed:.3g}{unit} for channel {name!r}, whose reference has a scale of "
        f"{scale:.3g}{unit}: a curve that does not move would pass; allow at most "
        f"{MAX_TOLERANCE_SHARE * scale:.3g}{unit} there, with a tolerance of its own if need be",
    )


def passes_unmoved(allowed: float, scale: float) -> bool:
    """Whether a tolerance lets a curve pass that stays in the middle of the reference's range.

    A tolerance that lets the mirrored curve pass does so too.

    >>> passes_unmoved(0.6, 1.0), passes_unmoved(0.4, 1.0)
    (True, False)
    """
    return allowed > MAX_TOLERANCE_SHARE * scale


def judge_run(
    case: Case, run: Kind, curves: Curves, reference: Mapping[str, Array], found: list[Comparison]
) -> list[Comparison]:
    """Give channels within their tolerance another outcome if the run tells nothing of the model.

    It tells nothing if its time step was another one than the model or the settings ask for, or if
    nothing moved, see `shows_motion`.  An equilibrium need not move: its curves go along a rod.
    """
    if curves.step_share < least_step_share(case):
        outcome, message = Outcome.OTHER_STEP, explain_step(case, run, curves)
    elif run != "equilibrium" and not any(
        shows_motion(case, c, curves, reference[c.channel]) for c in found
    ):
        outcome, message = Outcome.NOTHING_MOVED, explain_rest(case, run, curves)
    else:
        return found
    good = Outcome.AGREES, Outcome.UNDECIDED
    return [replace(c, outcome=outcome, message=message) if c.outcome in good else c for c in found]


def shows_motion(case: Case, c: Comparison, curves: Curves, reference: Array) -> bool:
    """Whether a checked channel shows that something moved.

    Its reference leaves its start by more than the tolerance, or is a rate that is not zero, or it
    is a force or another quantity of the motion of the drive that is not zero.  Position and rate
    of a driven joint show nothing: the reference is evaluated at the drive's actual motion.
    """
    model, channel = compiled_model(case), case.channels[c.channel]
    driven = [drive.joint for drive in case.drive if drive.joint in joints(model)]
    if c.channel.partition(".")[0] in (
        n for joint in driven for n in sensors_of_drive(model, joint)
    ):
        return False
    allowed = c.allowed * channel.factor
    if np.abs(reference - reference[0]).max() > allowed:
        return True
    if not np.abs(reference).max() > allowed or channel.si_unit in POSITION_UNITS:
        return False
    return channel.si_unit in MOTION_UNITS["velocity"] or moves_drive(curves)


def moves_drive(curves: Curves) -> bool:
    """Whether a drive leaves its first value from sample to sample."""
    if curves.drive is None:
        return False
    value = curves.drive[0]
    return bool(np.abs(value - value[:, :1]).max(initial=0.0) > MIN_DRIVEN_DISTANCE)


def explain_rest(case: Case, run: Kind, curves: Curves) -> str:
    """Explain that nothing moved, and how to make something move."""
    moved = "nothing moves"
    if moves_drive(curves):
        moved = "nothing but the drive moves"
        remedy = "check channels that move, or let the joint go, with a control (ctrl) in the key"
    elif case.drive:
        remedy = f"give run.{run}.n more samples: the drive is where it began at each of them"
    else:
        remedy = "give a key with rates (qvel) or controls (ctrl), or a longer until"
    return (
        f"{moved}: no checked channel leaves its start by more than its tolerance, so that nothing "
        f"is tested; {remedy}"
    )


def least_step_share(case: Case) -> float:
    """Least share of the time step of a case's model that its runs in time may step with [1]."""
    return MIN_STEP_SHARE if case.drive or case.recorded else MIN_FREE_STEP_SHARE


def explain_step(case: Case, run: Kind, curves: Curves) -> str:
    """Explain that the time step of a run was another one than the model or its settings ask for.

    Rows of a recorded curve cannot be chosen, so that only the step can be; so it is where the
    duration is a few steps and no whole number of them.
    """
    made, asked = (f"{1e3 * step:.4g} ms" for step in (curves.made_step, curves.asked_step))
    duration, samples = float(curves.x[-1] - curves.x[0]), curves.x.size
    fitting = fitting_samples(duration, curves.asked_step, samples)
    _, step = Run(run, np.linspace(0.0, duration, fitting), ()).steps(curves.asked_step)
    helps = not case.recorded and step >= least_step_share(case) * curves.asked_step
    fits = f"run.{run}.n = {fitting}, or " if helps else ""
    return (
        f"steps of {made} instead of the {asked} of the model or its settings, since samples are "
        f"{1e3 * duration / (samples - 1):.4g} ms apart, so that nothing is known of the latter; "
        f"give {fits}timestep = {curves.made_step:.17g} in the settings of the solver"
    )


def allowed_error(
    case: Case,
    run: Kind,
    solver: str,
    name: str,
    sizes: MechanismSizes,
    reference: Array,
    curve: Array | None = None,
) -> float | None:
    """The largest error that a channel's tolerance allows [SI].

    None if there is no tolerance, or if it is noise that is estimated, and the curve of the solver
    is not given.
    """
    if (tolerance := case.tolerance_for(run, solver, name)) is None:
        return None
    if tolerance.sigma is not None:
        difference = None if curve is None else curve - reference
        return allowed_noise(case, run, solver, name, difference, reference.size)
    channel = case.channels[name]
    scale = sizes.scale(channel.si_unit, reference)
    return tolerance.allowed(scale / channel.factor) * channel.factor


def allowed_errors(
    case: Case, run: Kind, solver: str, curves: Curves, reference: Mapping[str, Array]
) -> dict[str, float]:
    """Return the largest allowed error of each channel that a tolerance covers [its SI unit]."""
    sizes, found = mechanism_sizes(case, run, curves), dict[str, float]()
    for name in (name for name in case.channels_of(run) if name in curves.channels):
        own = reference[name], curves.channels[name]
        allowed = allowed_error(case, run, solver, name, sizes, *own)
        if allowed is not None:
            found[name] = allowed
    return found


def end_of_start(curves: Curves) -> float:
    """The x at which the first tenth of a run ends."""
    return float(curves.x[0] + START_SHARE * (curves.x[-1] - curves.x[0]))


def mechanism_sizes(case: Case, run: Kind, curves: Curves) -> MechanismSizes:
    """The sizes of the mechanism of a case in a run with these curves."""
    model = compiled_model(case)
    length = size(model, case.start) or float(model.stat.extent)  # of a single body: its geoms
    return MechanismSizes(length, mass(model), time_scale(case, run, curves, length))


def scale_of(case: Case, run: Kind, name: str, curves: Curves, reference: Array) -> float:
    """The scale of the reference of one channel [SI], see `MechanismSizes.scale`."""
    return mechanism_sizes(case, run, curves).scale(case.channels[name].si_unit, reference)


def time_scale(case: Case, run: Kind, curves: Curves, extent: float) -> float:
    """The time of `MechanismSizes` [s]; 0 if neither drives nor the run define one."""
    if not case.drive:
        return float(np.ptp(curves.x)) if run == "dynamics" else 0.0
    if curves.drive is None or not extent:
        return 0.0
    units = joints(compiled_model(case))
    sizes = np.array([extent if units[drive.joint] == "m" else 1.0 for drive in case.drive])
    values, rates, _ = curves.drive
    rate = float((np.abs(rates).max(axis=1) / sizes).max())
    way, duration = float((np.ptp(values, axis=1) / sizes).max()), float(np.ptp(curves.x))
    x_is_time = run == "dynamics" or not case.drive[0].steady
    if x_is_time and (way <= MIN_DRIVEN_DISTANCE or rate * duration < REST_SHARE * way):
        between = np.linspace(curves.x[0], curves.x[-1], PROFILE_TIMES)
        found = [np.abs(p(between)[1]).max() for p in drive_profiles(case, run)]
        rate = max(rate, float((np.array(found) / sizes).max()))
    return 1.0 / rate if rate else 0.0


def explain_undecided(uncertainty: float, allowed: float, unit: str) -> str:
    """Explain why a curve neither agrees nor differs.

    >>> explain_undecided(2e-3, 1e-3, "m").partition(";")[0]
    'its curve is known to 0.002 m alone, where 0.001 m is allowed: too coarse to tell'
    """
    return (
        f"its curve is known to {uncertainty:.3g} {unit} alone, where {allowed:.3g} {unit} is "
        "allowed: too coarse to tell; give more rows, rows at the samples of the run, or a wider "
        "tolerance"
    )


def check_assembly_mode(case: Case, run: Kind, curves: Curves, reference: Curves) -> None:
    """Raise InputError if the model is assembled in another mode than the sidecar says."""
    if "mode" not in case.parameters or curves.drive is None:
        return
    if start_difference(case, curves, reference) <= 0.1:
        return
    for mode in assembly_modes(case):
        try:
            other = evaluate(case, run, curves.x, curves.drive, mode=mode)
        except InputError:  # a mode that does not exist at these poses
            continue
        if start_difference(case, curves, other) < 0.01:
            raise case.error(
                "start",
                f"key {case.start!r} assembles the model in mode "
                f"{mode:+d}, parameters.mode says "
                f"{float(case.parameters['mode']):+.0f}; change one of the two",
            )


def start_difference(case: Case, curves: Curves, reference: Curves) -> float:
    """Largest difference of a position channel at the first sample, over the curve's range."""
    names = [
        n for n, c in case.channels.items() if c.si_unit in ("m", "rad") and n in curves.channels
    ]
    return max(
        (
            abs(float(curves.channels[n][0] - reference.channels[n][0]))
            / (float(np.ptp(reference.channels[n])) or 1.0)
            for n in names
        ),
        default=0.0,
    )
