"""A comparison: one channel of one solver in one run, with its error, tolerance and outcome."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from proofmass.base.display import ShownAsHtml
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.reference.reference_curves import ComparedCurves, ReferenceCurves
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.outcome import GOOD_OUTCOMES, OUTCOME_OF_EXCEPTION, Outcome

NAN = float("nan")
UNCHECKED_CASE = (
    "nothing of this case was checked; give it a [[tolerance]] that covers a channel that "
    "a solver delivers, or say unchecked = true"
)


@dataclass(frozen=True)
class DetectableChange:
    """The smallest change of a parameter that a tolerance would catch.

    Attributes
    ----------
    size : float
        The change [its unit or 1]; NaN where it is not known because the reference cannot be
        evaluated at changed values.
    relative : bool
        Whether `size` is a share of the parameter's value; otherwise the value is 0, and `size` is
        the change itself, in the parameter's SI unit.
    """

    size: float
    relative: bool = True


@dataclass(frozen=True)
class NoiseResult:
    """What the residual of a measured curve shows, see `proofmass.verdict.noise`.

    Attributes
    ----------
    sigma : float
        Standard deviation of the noise [its unit].
    estimated : bool
        Whether it is estimated from the residual.
    rows : int
        Number of rows of the measured curve.
    tests : dict of str to tuple of float
        For each test its value, and the largest magnitude that noise has, in sigma or in standard
        errors [1].
    fits : dict of str to tuple of float
        What was fitted, and its standard error: ``zero`` [its unit], ``lag`` [s, rad or m].
    """

    sigma: float
    estimated: bool
    rows: int
    tests: dict[str, tuple[float, float]]
    fits: dict[str, tuple[float, float]]

    @property
    def share(self) -> float:
        """The largest value of a test over its limit [1]."""
        return max(abs(value) / limit for value, limit in self.tests.values())

    def with_test(self, name: str, value: float, limit: float) -> "NoiseResult":
        """The result with another test."""
        return replace(self, tests={**self.tests, name: (value, limit)})


@dataclass(frozen=True)
class Comparison(ShownAsHtml):
    """One channel of one solver in one run, compared with the reference.

    Attributes
    ----------
    case, solver, run, channel, unit : str
        The case, solver, run and channel that were compared, and the channel's unit.
    error_max, at : float
        Largest absolute difference [its unit], and the x at which it occurs [SI].
    error_rms, nrmse : float
        Root mean square of the difference [its unit], and the same over `scale_of` the reference
        curve [1], which is its range unless it is constant.
    allowed : float
        Tolerance [its unit]; NaN when the channel is not checked.
    detectable : dict of str to DetectableChange
        For each parameter the smallest change that the tolerance would catch. A parameter is left
        out if the tolerance does not even catch a change by 10 %, such as one on which the channel
        does not depend.
    outcome : str
        agrees, differs, undecided, unchecked, unsupported, diverged, crashed, timed out or out of
        memory.
    message : str
        The tolerance's reason when it agrees; otherwise what is wrong.
    seconds, steps, violation
        Cost of the run, and its largest constraint violation [m].
    error_later : float
        Largest absolute difference after the first tenth of dynamics [its unit], since soft
        constraints of a simulator are often not in equilibrium in the start pose; NaN in other
        runs.
    uncertainty : float
        Largest possible error of the curve or of its reference for a reason other than the solver,
        such as the interpolation of recorded rows [its unit]; 0 where there is none.
    noise : NoiseResult, optional
        Of a measured curve whose tolerance is its noise.
    at_unit : str
        The unit of `at`: s of a motion in time, m of an arc length, rad or m of a drive; empty if
        it is not known.
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
    detectable: dict[str, DetectableChange] = field(default_factory=dict)
    outcome: str = Outcome.UNCHECKED
    message: str = ""
    seconds: float = NAN
    steps: int = 0
    violation: float = NAN
    error_later: float = NAN
    uncertainty: float = 0.0
    noise: NoiseResult | None = None
    at_unit: str = ""

    @property
    def relative_to_range(self) -> float:
        """Largest error over `scale_of` the reference curve; NaN when it has none."""
        return self._share(self.error_max)

    @property
    def relative_to_range_later(self) -> float:
        """The same for `error_later`."""
        return self._share(self.error_later)

    @property
    def allowed_of_range(self) -> float:
        """The allowed error over `scale_of` the reference curve; NaN if the error is 0."""
        return self.allowed * self.nrmse / self.error_rms if self.error_rms else NAN

    @property
    def share_of_allowed(self) -> float:
        """The error over the tolerance, 1 at the limit; of a measured curve the largest test.

        Where one of them gives no number it is infinite, or 0 if the outcome is good all the same.
        """
        if self.noise is not None:
            return self.noise.share
        if np.isfinite(self.error_max) and self.allowed > 0:
            return self.error_max / self.allowed
        return 0.0 if self.outcome in GOOD_OUTCOMES else np.inf

    def _share(self, error: float) -> float:
        return error * self.nrmse / self.error_rms if self.error_rms else self.nrmse


class Comparisons(list[Comparison], ShownAsHtml):
    """The comparisons of one solver in one run, and the reference that its curves were compared to.

    A notebook shows them as a table.

    Attributes
    ----------
    reference : ReferenceCurves, optional
        The reference at the motion that the drives had.
    properties : dict of str to str, optional
        The properties of the case; None if they were not asked for, or in another run than the
        first one of the case.
    """

    def __init__(
        self,
        found: Iterable[Comparison] = (),
        reference: ReferenceCurves | None = None,
        properties: dict[str, str] | None = None,
    ) -> None:
        super().__init__(found)
        self.reference, self.properties = reference, properties

    def join_reference(self, curves: Curves) -> Curves:
        """The curves that were compared, with their reference if it is known."""
        if self.reference is None:
            return curves
        return ComparedCurves.of(curves, self.reference, self.properties)


def failed_comparisons(
    case: Case, run: Kind, solver: str, error: Exception, advice: str = ""
) -> Comparisons:
    """Return a comparison for each channel of a run that failed with an error."""
    outcome, message = OUTCOME_OF_EXCEPTION[type(error)], f"{error}{advice}"
    return Comparisons(
        Comparison(case.name, solver, run, name, channel.unit, outcome=outcome, message=message)
        for name, channel in case.channels_of(run).items()
    )
