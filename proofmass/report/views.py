"""Views: a run's curves over another x, loops among them, beside those of other parameter sets."""

from dataclasses import dataclass, replace

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.case import Case
from proofmass.report.data import Shown, readable, ways
from proofmass.seen import Seen, seen
from proofmass.view import View
from proofmass.wording import listed, number, pretty


@dataclass(frozen=True)
class Viewed:
    """A view of a run.

    Attributes
    ----------
    view : View
        The sidecar's table.
    own, beside : Seen, dict of str to Seen
        The reference where a solver came farthest, and with the parameter sets beside it.
    over : Shown
        The run with the view's x in place of its own.
    """

    view: View
    own: Seen
    beside: dict[str, Seen]
    over: Shown

    @property
    def x(self) -> Array:
        """The reference's x, in the unit that people read."""
        return self.own.values[self.view.x] * self.over.x_scale

    @property
    def loop(self) -> bool:
        """Whether x turns back."""
        return len(ways(self.x)) > 1

    def readable(self, name: str, by: Seen | None = None) -> Array:
        """A curve of the reference, or of parameters beside it, in the unit that people read."""
        source = by or self.own
        return source.values[name] * readable(source.units[name])[1]

    def total(self, by: Seen | None = None) -> Array:
        """The sum of what is stacked."""
        return np.sum([self.readable(name, by) for name in self.view.stack], axis=0)


def viewed(shown: Shown, view: View) -> Viewed:
    """Put a view's x in place of the run's: measured if it is a channel, else the reference's."""
    case = shown.case
    longest = max(shown.curves.values(), key=lambda c: len(c.x))
    curves, truth = {}, {}
    for solver, found in shown.curves.items():
        there = seen(case, view, found).values[view.x]
        truth[solver] = replace(shown.truth[solver], x=there)
        x = found.channels.get(view.x) if view.x in case.channels else there
        if x is not None:
            curves[solver] = replace(found, x=x)
    own = seen(case, view, longest)
    unit, scale = readable(own.units[view.x])
    return Viewed(view, own, {name: seen(case, view, longest, name) for name in case.beside},
                  replace(shown, curves=curves, truth=truth, x_name=spoken(case, view.x, unit),
                          x_unit=unit, x_scale=scale))


def spoken(case: Case, name: str, unit: str) -> str:
    """A driven joint's name with what is meant of it; any other name as it is."""
    joint = name not in case.channels and name in [d.joint for d in case.drive]
    return name + (" angle" if unit == "deg" else " position") * joint


def all_viewed(case: Case, shown: list[Shown]) -> list[Viewed]:
    """The case's views of runs that have curves."""
    return [viewed(s, view) for view in case.view for s in shown
            if s.curves and s.kind == case.run_of(view)]


def unit_of(view: Viewed) -> str:
    """The unit of what a view stacks, as people read it."""
    return pretty(readable(view.own.units[view.view.stack[0]])[0])


def spread(view: Viewed, by: Seen | None = None) -> str:
    """How flat the sum of a stack is, in words."""
    total = view.total(by)
    low, high, mean = float(np.min(total)), float(np.max(total)), float(np.mean(total))
    tiny = 1e-12 * max(abs(low), abs(high))  # what rounding leaves of a zero
    ends = " to ".join(number(end if abs(end) > tiny else 0.0, 4) for end in (low, high))
    share = f", {number(100 * (high - low) / abs(mean), 2)} % of its mean" if mean else ""
    return f"{ends} {unit_of(view)}, a spread of {number(high - low, 3)} {unit_of(view)}{share}"


def caption(view: Viewed) -> str:
    """What a view's figure shows, in words."""
    if view.view.stack:
        words = [f"The reference's {listed(view.view.stack)}, stacked"
                 + (" on the first way" if view.loop else "")
                 + f"; their sum as a line, {spread(view)}; below, the sum less its mean"]
        words += [f"{name}: {spread(view, by)}" for name, by in view.beside.items()]
    else:
        words = ["Reference (thick, pale) and solvers on top of it"]
        words += ["markers open where x rises, filled where it falls"] * view.loop
        words += [f"dashed: {view.view.dashed}"] * (view.view.dashed is not None)
        words += [f"thin: {listed(view.beside)}"] * bool(view.beside)
        words += ["below, the difference to the reference in the channel's unit, with what the "
                  "tolerance allows"] * any(n in view.over.channels for n in view.view.y)
    return "; ".join(words) + "."
