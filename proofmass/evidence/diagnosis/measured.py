"""Numbers of a model, or of a reference, that the noise of measured curves lets through or not.

A tolerance that is the noise of a measured curve tells whether the residual is noise.  A wrong
length that is too small for that may still be seen by its shape: the residual is fitted with the
slope of the curve by each number, and no change may be larger, in its standard errors, than noise
makes it.  The slopes are those of the reference by its parameters, or those of the engine by the
numbers of the model, for which the engine runs once for each.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import get_args

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.strict import Kind
from proofmass.base.wording import format_fitted, format_list, number
from proofmass.case.case import Case, Fitted
from proofmass.evidence.diagnosis.explanation import Explanation
from proofmass.evidence.diagnosis.fault import Fault
from proofmass.evidence.diagnosis.fit import (
    MODEL_KIND,
    ModelResiduals,
    Residuals,
    measured_fault,
    slopes_of,
)
from proofmass.sim.engines import computes_curves
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparison, Comparisons
from proofmass.verdict.measured import measured_curve, noise_level, unit_of_fit
from proofmass.verdict.noise import (
    FALSE_REFUSALS,
    NUMBERS_SHARE,
    ZEROS_SHARE,
    FittedNumber,
    NumberFit,
    Residual,
    TooFewRows,
    fit_numbers,
    fit_residual,
)
from proofmass.verdict.outcome import Outcome


@dataclass(frozen=True)
class MeasuredNumbers:
    """The residuals of the measured channels of a run, and what its numbers would change.

    Attributes
    ----------
    search : Residuals
        The curves at other numbers.
    measured : dict of str to Residual
        By channel [SI].
    slopes : dict of str to dict of str to ndarray (m,)
        For each number the change of each channel without noise, at its rows, by a share of it
        [SI].
    """

    search: Residuals
    measured: dict[str, Residual]
    slopes: dict[str, dict[str, Array]]

    @cached_property
    def fit(self) -> NumberFit:
        """The fit of the numbers that are not 0, or that of those that are 0 if only it fails."""
        fits = []
        for share, zero in ((NUMBERS_SHARE, False), (ZEROS_SHARE, True)):
            keys = [key for key in self.slopes if (self.search.parameters[key] == 0.0) == zero]
            parts = {key: list(self.slopes[key].values()) for key in keys}
            fits.append(fit_numbers(list(self.measured.values()), parts, share * self.level))
        first, second = fits
        return second if first.passes and (not second.passes or not first.changes) else first

    def explains(self, name: str) -> str:
        """The channel whose residual a number explains most."""
        left = self.left_by(name)
        return max(self.measured, key=lambda n: squares(self.measured[n]) - squares(left[n]))

    def fault(self, name: str) -> Fault:
        """The wrong value of a number, and the one that fits the residuals."""
        size, share = self.search.sizes[name], self.fit.changes[name]
        value = self.search.parameters[name] + share.value * size
        fault = measured_fault(self.search, name, FittedNumber(value, share.error * size))
        return replace(fault, note=self.describe(name))

    def left_by(self, name: str) -> dict[str, Residual]:
        """The residuals that a change of a number leaves, to first order."""
        share = self.fit.changes[name].value
        return {
            channel: one.with_values(one.values - share * self.slopes[name][channel])
            for channel, one in self.measured.items()
        }

    def explanation(self, name: str) -> Explanation:
        """The change of a number as a cause of what its channels differ by."""
        search, fault, left = self.search, self.fault(name), self.left_by(name)
        value = search.parameters[name] + self.fit.changes[name].value * search.sizes[name]
        noise = [n for n in left if left[n].is_noise(self.level)]
        return Explanation(
            search.kind,
            fault.change,
            tuple(n for n in self.differing if n in noise),
            tuple(n for n in left if n not in (*noise, *self.differing)),
            share_left(self.measured, left),
            len(self.differing),
            1,
            {name: (search.parameters[name], value)},
            faults=(fault,),
            edits=search.edits({name: value}),
        )

    @cached_property
    def level(self) -> float:
        """The chance of a false refusal of each channel."""
        return noise_level(self.search.case, self.search.run, self.search.solver)

    @cached_property
    def differing(self) -> tuple[str, ...]:
        """The channels that are not noise, or else that which a wrong number shows in."""
        found = tuple(n for n, one in self.measured.items() if not one.is_noise(self.level))
        if found or self.fit.passes:
            return found
        return (self.explains(self.fit.largest),)

    @property
    def explanations(self) -> list[Explanation]:
        """Changes of numbers, and fits of the recording, that leave noise."""
        numbers = [
            self.explanation(name)
            for name, one in self.fit.changes.items()
            if abs(one.ratio) > self.fit.limit
        ]
        return [one for one in (*numbers, *self.fits_of_recording()) if one.complete]

    def fits_of_recording(self) -> Iterator[Explanation]:
        """The zero and the lag of each channel that differs, as causes."""
        case = self.search.case
        for channel in self.differing:
            own = self.measured[channel]
            for name in (one for one in get_args(Fitted) if one not in own.fits):
                fits = (*own.fits, name)
                after = fit_residual(own.curve, None if own.estimated else own.sigma, fits)
                factor = case.channels[channel].factor if name == "zero" else 1.0
                fitted = after.fits[name].over(factor)
                unit = unit_of_fit(name, case.channels[channel].unit, self.search.run)
                words = (
                    f"a {name} of {format_fitted(fitted.value, fitted.error)} {unit} in the "
                    f"recording of {channel}, as fit = {list(fits)!r} would find"
                )
                agrees = (channel,) if after.is_noise(self.level) else ()
                left = share_left(self.measured, {**self.measured, channel: after})
                yield Explanation(name, words, agrees, (), left, len(self.differing), 2)

    def describe(self, name: str) -> str:
        """The change of a number in its standard errors, in words."""
        ratio = abs(self.fit.changes[name].ratio)
        return f"{number(ratio, 2)} standard errors, noise has up to {number(self.fit.limit, 2)}"


def measured_numbers(residuals: Residuals) -> MeasuredNumbers | None:
    """The numbers of a case beside its measured channels; None without either.

    The curves of another program have no slopes by numbers of the model.
    """
    search, measured = residuals, residuals.measured
    if not measured or not (search.parameters or search.can_run_again):
        return None
    x = search.curves.x
    if not search.parameters:
        search = ModelResiduals(search.case, search.run, search.solver, search.curves)
        if not search.repeats():
            return None
        x = x[:: search.stride]
    side = -1.0 if computes_curves(search.solver) else 1.0
    slopes = {
        key: {
            name: side * at_rows(one, x, slope[name] * search.allowed[name])
            for name, one in measured.items()
        }
        for key, slope in slopes_of(search, search.kind).items()
    }
    return MeasuredNumbers(search, measured, slopes)


def share_left(before: Mapping[str, Residual], after: Mapping[str, Residual]) -> float:
    """Root mean square of residuals over sigma after a change, over that before it [1]."""
    sums = [sum(map(squares, some.values())) for some in (after, before)]
    return float(np.sqrt(sums[0] / sums[1]))


def squares(residual: Residual) -> float:
    """Sum of the squares of a residual over sigma [1]."""
    return float(np.square(residual.values / residual.sigma).sum())


def noise_cause(residuals: Residuals) -> Iterator[Explanation]:
    """The cause that a tolerance is smaller than the noise of recorded curves.

    It is one if what is left of all channels that differ is noise of an estimated size.
    """
    case, reference = residuals.case, residuals.evaluated
    names = [n for n in residuals.differing if n not in residuals.measured]
    if not names or (computes_curves(residuals.solver) and not case.recorded):
        return
    sizes, shares = [], []
    for name in names:
        curve = measured_curve(residuals.solver, name, residuals.curves, reference)
        try:
            found = fit_residual(curve, None)
        except TooFewRows:
            return
        if not found.is_noise(FALSE_REFUSALS / len(names)):
            return
        channel = case.channels[name]
        sizes.append(f"{number(found.sigma / channel.factor)} {channel.unit} for {name}")
        largest = found.tests(FALSE_REFUSALS / len(names))[0].limit * found.sigma
        shares.append(residuals.allowed[name] / largest)
    words = f"sigma = {format_list(sizes)} in place of the tolerance, since what is left is noise"
    left = float(np.sqrt(np.mean(np.square(shares))))
    yield Explanation("noise", words, tuple(names), (), left, len(residuals.differing))


def at_rows(residual: Residual, x: Array, curve: Array) -> Array:
    """A curve at some samples, at the rows of a measured channel."""
    order = slice(None, None, 1 if x[-1] > x[0] else -1)
    return replace(residual.curve, samples=x[order], smooth=curve[order]).at_rows(curve[order])


def judge_numbers(
    case: Case, run: Kind, solver: str, curves: Curves, found: Comparisons
) -> Comparisons:
    """The comparisons of a run, of which one differs if a number is further off than noise allows.

    Parameters
    ----------
    case, run, solver, curves
        The run.
    found : Comparisons
        From `proofmass.verdict.compare.compare`.
    """
    noisy = [c for c in found if c.noise is not None]
    if not noisy or found.reference is None or any(c.outcome != Outcome.AGREES for c in noisy):
        return found
    numbers = measured_numbers(Residuals(case, run, solver, curves))
    if numbers is None or not numbers.fit.changes:
        return found
    judged = [with_numbers(c, numbers) for c in found]
    return Comparisons(judged, found.reference, found.properties)


def with_numbers(c: Comparison, numbers: MeasuredNumbers) -> Comparison:
    """The comparison of a measured channel with what the fit of numbers says of it."""
    name, fit = numbers.fit.largest, numbers.fit
    if c.noise is None or not (fit.passes or numbers.explains(name) == c.channel):
        return c
    fault, ratio = numbers.fault(name), fit.changes[name].ratio
    tested = replace(c, noise=c.noise.with_test("numbers", ratio, fit.limit))
    if not fit.passes:
        wrong, right = fault.values
        shape = f"a residual that {fault.name} explains, with {right} in place of {wrong}"
        words = f"{shape} ({numbers.describe(name)})"
        return replace(tested, outcome=Outcome.DIFFERS, message=words)
    what = "number of the model" if numbers.search.kind == MODEL_KIND else "parameter"
    words = f"no {what} is off by more than {numbers.describe(name)}, {fault.name}"
    return replace(tested, message=f"{c.message}; {words}")
