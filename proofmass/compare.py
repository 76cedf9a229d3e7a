"""Curves against the reference: one `Comparison` for each channel of each solver."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from proofmass.case import Case
from proofmass.chart import check_charts
from proofmass.errors import InputError
from proofmass.recorded import Recorded
from proofmass.reference import compiled, evaluate, modes, module_of
from proofmass.seen import check_views
from proofmass.units import powers, si_unit
from sim.contents import joints, mass, size
from sim.protocol import Array, Curves

NAN = float("nan")
OPEN = ("unchecked", "unsupported")
GOOD = ("agrees", *OPEN)
UNCHECKED = ("nothing of this case was checked; give it a [[tolerance]] that covers a channel that "
             "a solver delivers, or say unchecked = true")
START = 0.1  # share of a duration in which errors of the start are expected to decay
CONSTANT = 1e-3  # a curve whose range is less of its size does not move, up to what drives do
ZERO = 1e-12  # of the mechanism's size: what a reference computes instead of a zero


@dataclass(frozen=True)
class Comparison:
    """One channel of one solver in one run, held against the reference.

    Attributes
    ----------
    case, solver, run, channel, unit : str
        What was compared.
    error_max, at : float
        Largest absolute difference, in `unit`, and the x at which it stands.
    error_rms, nrmse : float
        Root mean square of the difference, and the same over `scale_of` the reference curve,
        which is its range unless it is constant.
    allowed : float
        Tolerance in `unit`; NaN when the channel is not checked.
    would_notice : dict of str to float
        For each parameter the smallest relative change that the tolerance would catch.
    outcome : str
        agrees, differs, unchecked, unsupported, diverged, crashed, timed out or out of memory.
    message : str
        The tolerance's reason when it agrees; otherwise what is wrong.
    seconds, steps, gap
        Cost of the run, and its largest loop gap [m].
    error_later : float
        Largest absolute difference after the first tenth of a duration, in `unit`: the start pose
        is often in another equilibrium of a soft loop than the motion; NaN in other runs.
    """

    case: str
    solver: str
    run: str
    channel: str
    unit: str
    error_max: float = NAN
    at: float = NAN
    error_rms: float = NAN
    nrmse: float = NAN
    allowed: float = NAN
    would_notice: dict[str, float] = field(default_factory=dict)
    outcome: str = "unchecked"
    message: str = ""
    seconds: float = NAN
    steps: int = 0
    gap: float = NAN
    error_later: float = NAN

    @property
    def of_range(self) -> float:
        """Largest error over `scale_of` the reference curve; NaN when it has none."""
        return self._share(self.error_max)

    @property
    def of_range_later(self) -> float:
        """The same for `error_later`."""
        return self._share(self.error_later)

    def _share(self, error: float) -> float:
        return error * self.nrmse / self.error_rms if self.error_rms else self.nrmse


def reference_for(case: Case, curves: Curves) -> Curves:
    """The reference at the state the drive really had in that run."""
    recorded = isinstance(module_of(case), Recorded)
    return evaluate(case, curves.x, None if recorded else curves.drive)


def compare(case: Case, run: str, solver: str, curves: Curves) -> list[Comparison]:
    """Hold a solver's curves against the reference.

    Parameters
    ----------
    case : Case
        Holds the channels and their tolerances.
    run, solver : str
        Which run of the case the curves are of.
    curves : Curves
        From `solve`.

    Returns
    -------
    list of Comparison
        One for each channel, in the sidecar's order.

    Raises
    ------
    InputError
        The model is assembled in another mode than the sidecar says; a view or a chart cannot
        be drawn.
    """
    truth = reference_for(case, curves)
    check_branch(case, curves, truth)
    check_views(case, run, curves)
    check_charts(case)
    slopes = sensitivities(case, curves)
    return [
        one(case, run, solver, name, curves, truth.channels[name], slopes)
        for name in case.channels_of(run)
    ]


def one(case: Case, run: str, solver: str, name: str, curves: Curves, truth: Array,
        slopes: dict[str, dict[str, float]]) -> Comparison:
    """Compare one channel; its curves are in SI units, the comparison in the channel's."""
    tolerance, unit = case.tolerance_for(run, solver, name), case.channels[name].unit
    factor = case.channels[name].factor
    scale = scale_of(case, run, name, curves, truth) / factor
    allowed = tolerance.allowed(scale) if tolerance else NAN
    place: dict[str, Any] = {
        "case": case.name, "solver": solver, "run": run, "channel": name, "unit": unit,
        "allowed": allowed, "seconds": curves.seconds, "steps": curves.steps, "gap": curves.gap}
    if name not in curves.channels:
        return Comparison(**place, outcome="unsupported", message=curves.missing.get(name, ""))
    error = np.abs(curves.channels[name] - truth) / factor
    worst = int(np.argmax(np.where(np.isfinite(error), error, np.inf)))
    rms = float(np.sqrt(np.mean(error**2)))
    found: dict[str, Any] = {
        "error_max": float(error[worst]), "at": float(curves.x[worst]), "error_rms": rms,
        "nrmse": rms / scale if scale else NAN,
        "error_later": float(error[curves.x >= start_until(curves)].max())
        if run == "duration" else NAN,
        "would_notice": {p: allowed * factor / s[name] for p, s in slopes.items()
                         if s[name] > 0}
        if tolerance else {}}
    why = tolerance.why if tolerance else ""
    outcome, message = verdict(float(error[worst]), allowed, unit, why)
    return Comparison(**place, **found, outcome=outcome, message=message)


def start_until(curves: Curves) -> float:
    """Where the first tenth of a run ends."""
    return float(curves.x[0] + START * (curves.x[-1] - curves.x[0]))


def scale_of(case: Case, run: str, name: str, curves: Curves, truth: Array) -> float:
    """What ``of_range`` is a share of, in SI units.

    It is the range of the reference curve, unless that is constant: its range is less than a
    thousandth of its size.  Then it is that size.  Where a place or an angle is zero is a
    convention, so the size of a place is that of the mechanism, and of an angle 1 rad.  The size
    of any other curve is its largest magnitude, or, if it is zero throughout, what the mechanism's
    length L, its mass M and a time T make of the unit: L / T of a velocity, M L^2 / T^2 of a
    moment.  T is 1 over the largest rate of a drive (L over the largest speed of a slide), or the
    length of a free motion.
    """
    unit, span = case.channels[name].si_unit, float(np.ptp(truth))
    model = compiled(case)
    extent = size(model, case.start)
    own = 1.0
    for base, power in zip((extent, mass(model), time_of(case, run, curves, extent)),
                           powers(unit)[:3], strict=True):
        own *= (base**power if base else 0.0) if power else 1.0
    magnitude = float(np.abs(truth).max())
    if unit in ("m", "rad") or not magnitude > ZERO * own:
        magnitude = own
    return span if span >= CONSTANT * magnitude else magnitude


def time_of(case: Case, run: str, curves: Curves, extent: float) -> float:
    """The time T of `scale_of` [s]; 0 if nothing tells it."""
    if not case.drive:
        return float(np.ptp(curves.x)) if run == "duration" else 0.0
    if curves.drive is None or not extent:
        return 0.0
    units = joints(compiled(case))
    rates = [float(np.abs(rate).max()) / (extent if units[drive.joint] == "m" else 1.0)
             for drive, rate in zip(case.drive, curves.drive[1], strict=True)]
    return 1.0 / max(rates) if max(rates) else 0.0


def verdict(error: float, allowed: float, unit: str, why: str) -> tuple[str, str]:
    """Outcome and message of a largest error; NaN never agrees.

    >>> verdict(1e-6, 1e-5, "m", "rounding")
    ('agrees', 'rounding')
    >>> verdict(float("nan"), 1e-5, "m", "rounding")[0]
    'differs'
    """
    if not np.isfinite(error):
        return "differs", "not a number somewhere on the curve"
    if not why:
        return "unchecked", "no tolerance covers this channel of this solver"
    if error <= allowed:
        return "agrees", why
    if not allowed:
        return "differs", ("the reference is zero and the mechanism has no size of this quantity, "
                           "so of_range allows nothing: give the tolerance as abs")
    quantity, factor = si_unit(unit or "1")
    turns = error * factor / (2 * np.pi)
    if quantity == "rad" and turns > 0.5 and abs(turns - round(turns)) < 1e-3:
        return "differs", f"off by {round(turns)} whole turn(s): count the start pose's angle anew"
    return "differs", f"{error / allowed:.3g} x the allowed error"


def sensitivities(case: Case, curves: Curves, h: float = 1e-6) -> dict[str, dict[str, float]]:
    """For each parameter, how much each channel's curve moves for a relative change of 1.

    Central differences of the closed form; empty for a recorded curve, which has no parameters.
    Words, parameters that are zero, and the assembly mode have no relative change.
    """
    if isinstance(module_of(case), Recorded):
        return {}
    slopes = {}
    for key, value in case.parameters.items():
        if isinstance(value, str) or key == "mode" or value == 0:
            continue
        try:
            up, down = (evaluate(case, curves.x, curves.drive, **{key: value * (1 + s * h)})
                        for s in (1, -1))
        except InputError:  # the changed mechanism cannot be assembled everywhere
            continue
        slopes[key] = {n: float(np.abs(up.channels[n] - down.channels[n]).max() / (2 * h))
                       for n in up.channels}
    return slopes


def check_branch(case: Case, curves: Curves, truth: Curves) -> None:
    """Refuse a model that is assembled in another mode than the sidecar says."""
    if "mode" not in case.parameters or curves.drive is None:
        return
    if misfit(case, curves, truth) <= 0.1:
        return
    for mode in modes(case):
        try:
            other = evaluate(case, curves.x, curves.drive, mode=mode)
        except InputError:  # a mode that is not there at these poses
            continue
        if misfit(case, curves, other) < 0.01:
            raise InputError(case.file, "start", f"key {case.start!r} assembles the model in mode "
                             f"{mode:+d}, parameters.mode says "
                             f"{float(case.parameters['mode']):+.0f}; change one of the two")


def misfit(case: Case, curves: Curves, truth: Curves) -> float:
    """Largest difference of a position channel at the first sample, over the curve's range."""
    names = [n for n, c in case.channels.items()
             if c.si_unit in ("m", "rad") and n in curves.channels]
    return max((abs(float(curves.channels[n][0] - truth.channels[n][0]))
                / (float(np.ptp(truth.channels[n])) or 1.0) for n in names), default=0.0)
