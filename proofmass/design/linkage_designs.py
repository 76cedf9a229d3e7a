"""Designs of linkages for a path: found by searches, checked against what is asked, and ranked."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from proofmass.analytic.linkages import fourbar
from proofmass.analytic.numerics import TURN
from proofmass.base.arrays import Array, Complex
from proofmass.base.errors import suggest_names
from proofmass.design.coupler_curves import CurveKind, FourBarCurves, SliderCrankCurves
from proofmass.design.linkage_path import (
    FINISHED,
    REFINED,
    REFINED_STEPS,
    PathSearch,
    PathTask,
)
from proofmass.design.linkage_refine import refine
from proofmass.design.path_points import PathPoints
from proofmass.design.search import Effort

LINKAGE_KINDS = ("fourbar", "slider_crank")
"""Kinds of linkages that are searched, under the names of their references."""
ASSEMBLIES = {"open": (1,), "crossed": (-1,), "both": (1, -1)}
"""Assembly modes of four-bars by their words; a slider-crank needs one only, see its curves."""
BOUND_NAMES = tuple(
    dict.fromkeys(
        (*FourBarCurves.names, *SliderCrankCurves.names, "start_angle", "other_x", "other_y")
    )
)
"""Names of parameters that bounds may be given for."""
EXACT = 1e-8
"""Error over the size of the path [1] up to which a design counts as exact, and better
transmission decides: descents end where rounding does, below 1e-12."""
UNLIKE = 0.2
"""Least logarithm of the ratio of a length of two designs of a kind that are both told [1]."""
LENGTH_NAMES = ("crank", "coupler", "rocker", "ground")
"""Lengths of bars, which are positive."""
TOLD = 6  # designs that are told
TURN_SAMPLES = 720  # samples of a coupler curve for a figure and a structural error: half degrees
SPLINE_SAMPLES = 40  # samples of the spline from point to point
REWEIGHTED = 20  # refinements with other weights after which tolerances count as not met
LEAST_EMPHASIS = 1e-3  # added to the factors of weights [1], so that none becomes zero
SearchAdvance = Callable[[str, int, int, float], None]


@dataclass(frozen=True)
class LinkageDesign:
    """A linkage, and how it passes the points of its path.

    Attributes
    ----------
    task : PathTask
    vector : ndarray (d,)
        Unknowns of the task [m, rad].
    """

    task: PathTask
    vector: Array

    @property
    def path(self) -> PathPoints:
        """The path."""
        return self.task.path

    @property
    def kind(self) -> str:
        """The kind of linkage, under the name of its reference."""
        return LINKAGE_KINDS[isinstance(self.task.kind, SliderCrankCurves)]

    @property
    def row(self) -> Array:
        """The parameters (1, k)."""
        return self.vector[None, : self.task.shape_count]

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters by their names [m, rad]; directions are within half a turn."""
        found = dict(zip(self.task.kind.names, self.row[0].tolist(), strict=True))
        for name in ("ground_angle", "guide_angle"):
            if name in found:
                found[name] = float(wrap_angles(np.array(found[name])))
        return found

    @cached_property
    def angles(self) -> Array:
        """Crank angles at the points (N,) [rad]; the first one is within half a turn."""
        angles = self.task.angles(self.vector[None])[0]
        return np.asarray(angles + wrap_angles(angles[:1]) - angles[:1])

    @cached_property
    def passed(self) -> Complex:
        """Places of the coupler point at the crank angles of the points (N,) [m]."""
        return self.task.kind.points(self.row, self.angles[None])[0]

    @property
    def errors(self) -> Array:
        """Distances from the points (N,) [m]."""
        return np.abs(self.passed - self.path.points)

    @property
    def rms(self) -> float:
        """Root of the mean square of the distances [m]."""
        return float(np.sqrt(np.mean(self.errors**2)))

    @property
    def value(self) -> float:
        """Root of the mean square of the weighted distances [m], the objective."""
        return float(np.sqrt(np.mean((self.errors * self.path.weights) ** 2)))

    @property
    def excess(self) -> Array:
        """Distances over what the tolerances allow (N,) [1]; zero without tolerances."""
        if self.path.tolerances is None:
            return np.zeros(self.path.points.size)
        return np.asarray(self.errors / self.path.tolerances)

    @property
    def transmission(self) -> tuple[float, float]:
        """Smallest and largest transmission angle over a turn of the crank [rad]."""
        p = self.parameters
        if self.kind == "fourbar":
            return fourbar.transmission_range(**{name: p[name] for name in LENGTH_NAMES})
        ends = np.array([p["offset"] + p["crank"], p["offset"] - p["crank"]]) / p["coupler"]
        low, high = np.arccos(np.clip(ends, -1.0, 1.0))
        return float(low), float(high)

    @property
    def worst_transmission(self) -> float:
        """Least angle of the transmission angle from 0 and from pi [rad]."""
        low, high = self.transmission
        return min(low, np.pi - high)

    @property
    def grashof(self) -> str:
        """The Grashof class, or what a slider-crank with a turning crank is."""
        if self.kind == "slider_crank":
            return "slider-crank"
        p = self.parameters
        return fourbar.classify(**{name: p[name] for name in LENGTH_NAMES})

    @property
    def margin(self) -> float:
        """The least margin of the crank's turn, the transmission angle and the pivots [m]."""
        return float(self.task.margins(self.row).min())

    @property
    def in_order(self) -> bool:
        """Whether the points are passed in their order, within one turn of the crank."""
        steps = self.task.sense * np.diff(self.angles)
        return bool((steps >= 0.0).all() and steps.sum() <= TURN * (1.0 + 1e-9))

    @property
    def on_one_branch(self) -> bool:
        """Whether the linkage passes all points without being taken apart: its crank turns."""
        return bool((self.task.kind.margins(self.row, 0.0) >= 0.0).all())

    @property
    def is_allowed(self) -> bool:
        """Whether all constraints are met."""
        return self.margin >= 0.0 and self.in_order and self.on_one_branch

    def curve(self, whole: bool = True) -> Complex:
        """Places of the coupler point [m], over a turn or from the first point to the last."""
        end = self.angles[0] + self.task.sense * TURN if whole else self.angles[-1]
        angles = np.linspace(self.angles[0], end, TURN_SAMPLES + 1)
        return self.task.kind.points(self.row, angles[None])[0]

    @cached_property
    def structural_error(self) -> float:
        """Largest distance of the curve from a spline through the points [m].

        The curve is that from the first to the last point, or all of it if the path is closed.
        """
        spline = path_spline(self.path)
        return float(distances_from_line(self.curve(self.path.closed), spline).max())

    def pose(self, angle: float) -> dict[str, complex]:
        """Places of the pins at a crank angle [rad]: A, P, Q, X and B, or G on the guide [m]."""
        p = self.parameters
        places = {"A": complex(p["pivot_x"], p["pivot_y"])}
        places["P"] = places["A"] + p["crank"] * np.exp(1j * angle)
        places["X"] = complex(self.task.kind.points(self.row, np.array([[angle]]))[0, 0])
        end = self.row.copy()
        end[0, -2:] = p["coupler"], 0.0
        places["Q"] = complex(self.task.kind.points(end, np.array([[angle]]))[0, 0])
        if self.kind == "fourbar":
            places["B"] = places["A"] + p["ground"] * np.exp(1j * p["ground_angle"])
        else:
            places["G"] = places["A"] + 1j * p["offset"] * np.exp(1j * p["guide_angle"])
        return places


def wrap_angles(angles: Array) -> Array:
    """Angles within half a turn of zero [rad]."""
    return np.asarray((angles + np.pi) % TURN - np.pi)


def path_spline(path: PathPoints) -> Complex:
    """Places on a cubic spline through the points, by the lengths of their chords [m]."""
    points = path.points
    if path.closed and abs(points[-1] - points[0]) > 1e-9 * path.size:
        points = np.append(points, points[0])
    ends = "periodic" if path.closed else "not-a-knot"
    if path.closed:
        points = np.append(points[:-1], points[0])
    length = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
    spline = CubicSpline(length, np.column_stack([points.real, points.imag]), bc_type=ends)
    x, y = spline(np.linspace(0.0, length[-1], SPLINE_SAMPLES * points.size)).T
    return np.asarray(x + 1j * y, complex)


def distances_from_line(places: Complex, line: Complex) -> Array:
    """Distances of places (n,) from a line of straight pieces through places (m,) [m]."""
    start, along = line[:-1], np.diff(line)
    length = np.maximum(np.abs(along) ** 2, np.finfo(float).tiny)
    share = ((places[:, None] - start) * along.conj()).real / length
    return np.asarray(
        np.abs(places[:, None] - start - np.clip(share, 0.0, 1.0) * along).min(axis=1)
    )


def make_tasks(
    path: PathPoints,
    kinds: Sequence[str] = LINKAGE_KINDS,
    modes: Sequence[int] = (1, -1),
    bounds: dict[str, tuple[float, float]] | None = None,
    transmission: float = 0.0,
) -> dict[str, PathTask]:
    """The searches for a path by their names: of each kind, assembly mode and sense of the crank.

    Parameters
    ----------
    path : PathPoints
    kinds : sequence of str
        Kinds of linkages, see `LINKAGE_KINDS`.
    modes : sequence of int
        Assembly modes of four-bars.
    bounds : dict of str to (float, float)
        Bounds of parameters [m, rad], under the names of `BOUND_NAMES`.
    transmission : float
        Least angle of the transmission angle from 0 and pi [rad].

    Raises
    ------
    ValueError
        A kind or a bound is not known, a bound does not rise or bounds no kind that is searched,
        or the transmission angle is not within 0 and a right angle.
    """
    given = bounds or {}
    check_bounds(given)
    if not 0.0 <= transmission < np.pi / 2:
        raise ValueError(
            f"transmission angle: from 0 to less than 90 degrees, got {np.degrees(transmission):g}"
        )
    forms: dict[str, CurveKind] = {}
    for kind in kinds:
        if kind == "fourbar":
            words = {1: "open", -1: "crossed"}
            forms |= {f"fourbar-{words[mode]}": FourBarCurves(mode) for mode in modes}
        elif kind == "slider_crank":
            forms[kind] = SliderCrankCurves()
        else:
            raise ValueError(f"no kind {kind!r}; {suggest_names(kind, LINKAGE_KINDS)}")
    names = {name for form in forms.values() for name in form.names}
    names |= {"other_x", "other_y"} if "rocker" in names else set()
    names |= {"start_angle"} if path.angles is None or path.angles_from == "first" else set()
    if unused := sorted(given.keys() - names):
        raise ValueError(f"bound of {unused[0]!r}: no linkage that is searched has it free")
    return {
        f"{name}{'-forward' if sense > 0 else '-backward'}": PathTask(
            path,
            form,
            sense,
            tuple(
                (key, pair)
                for key, pair in sorted(given.items())
                if key in form.names
                or key == "start_angle"
                or (key.startswith("other") and "rocker" in form.names)
            ),
            transmission,
        )
        for name, form in forms.items()
        for sense in path.senses
    }


def check_bounds(bounds: dict[str, tuple[float, float]]) -> None:
    """Raise ValueError unless all bounds are of known names, finite, rising and possible."""
    for name, (low, high) in bounds.items():
        if name not in BOUND_NAMES:
            raise ValueError(f"bound of {name!r}: {suggest_names(name, BOUND_NAMES)}")
        if not (np.isfinite([low, high]).all() and low <= high):
            raise ValueError(f"bound of {name!r}: must be finite and rise, got {low:g}:{high:g}")
        if name in LENGTH_NAMES and not low > 0:
            raise ValueError(f"bound of {name!r}: a length is positive, got {low:g}")


@dataclass(frozen=True)
class FoundDesigns:
    """What the searches for a path found.

    Attributes
    ----------
    designs : list of LinkageDesign
        Designs that meet all constraints, best first, each unlike those before it.
    nearest : LinkageDesign
        The best design, or the one nearest to the constraints if none meets them.
    descents : int
        Number of descents of all searches.
    reached : int
        Number of refined descents that ended within a factor 1.2 of the best objective.
    """

    designs: list[LinkageDesign]
    nearest: LinkageDesign
    descents: int
    reached: int


def search_designs_of_path(
    tasks: dict[str, PathTask],
    effort: Effort,
    folder: Path | None = None,
    advance: SearchAdvance = lambda *_: None,
) -> FoundDesigns:
    """Search all tasks, refine the best descents of each, and rank what they found.

    Parameters
    ----------
    tasks : dict of str to PathTask
        Tasks of one path by their names.
    effort : Effort
        Effort of the search of each task.
    folder : path, optional
        Folder in which the searches save their states.
    advance : callable
        Called with the name of a task, the number of finished steps of all tasks, the number of
        all steps, and the best objective of the task so far over the size of the path [1].
    """
    found: list[LinkageDesign] = []
    total = effort.steps * len(tasks)
    for k, (name, task) in enumerate(tasks.items()):
        search = PathSearch(task, effort, folder / f"search-{name}.npz" if folder else None)
        before = k * effort.steps

        def tell(step: int, _: int, value: float, name: str = name, before: int = before) -> None:
            advance(name, before + step, total, value)

        search.run(tell)
        found += refine_best(task, search.found[:REFINED])
    allowed = sorted((one for one in found if one.is_allowed), key=rank_of)
    nearest = allowed[0] if allowed else max(found, key=lambda one: one.margin)
    limit = 1.2 * max(nearest.value, EXACT * nearest.path.size)
    return FoundDesigns(
        unlike_designs(allowed),
        nearest,
        effort.heats[0][0] * len(tasks),
        sum(one.value <= limit for one in allowed),
    )


def refine_best(task: PathTask, vectors: Array) -> list[LinkageDesign]:
    """Refine designs (B, d) a little, and the best of them to the end, within tolerances."""
    some = [LinkageDesign(task, refine(task, one, REFINED_STEPS[0])) for one in vectors]
    some.sort(key=lambda one: (not one.is_allowed, one.value))
    ended = [meet_tolerances(task, refine(task, one.vector)) for one in some[:FINISHED]]
    return ended + some[FINISHED:]


def meet_tolerances(task: PathTask, vector: Array) -> LinkageDesign:
    """The design of a vector (d,); with larger weights at points beyond their tolerances.

    Least squares do not meet tolerances where they can be met.  Lawson's weights lead towards the
    least of the largest excess: each is multiplied by the excess of its point, again and again.
    The root of the mean square of the excess is less than the largest one, and least here: if it
    is above 1, no design near this one meets the tolerances.
    """
    best = design = LinkageDesign(task, vector)
    emphasis = np.ones(task.path.points.size)
    if np.mean(best.excess**2) > 1.0:
        return best
    for _ in range(REWEIGHTED):
        excess = design.excess
        if best.excess.max() <= 1.0:
            break
        emphasis = emphasis * np.sqrt(excess / excess.max() + LEAST_EMPHASIS)
        sharper = replace(task, path=replace(task.path, emphasis=emphasis / emphasis.max()))
        design = LinkageDesign(task, refine(sharper, design.vector, REFINED_STEPS[0]))
        if design.is_allowed and design.excess.max() < best.excess.max():
            best = design
    return best


def rank_of(design: LinkageDesign) -> tuple[float, float, float]:
    """What designs are sorted by: unmet tolerances, error unless exact, and transmission."""
    exact = design.value <= EXACT * design.path.size
    beyond = max(float(design.excess.max()) - 1.0, 0.0)
    return beyond, 0.0 if exact else design.value, -design.worst_transmission


def unlike_designs(designs: Sequence[LinkageDesign]) -> list[LinkageDesign]:
    """The first designs, at most `TOLD`, that differ from all before in kind or in a length."""
    found: list[LinkageDesign] = []
    for one in designs:
        if len(found) < TOLD and all(is_unlike(one, other) for other in found):
            found.append(one)
    return found


def is_unlike(one: LinkageDesign, other: LinkageDesign) -> bool:
    """Whether two designs differ in kind or assembly mode, or by `UNLIKE` in a length."""
    if type(one.task.kind) is not type(other.task.kind) or one.task.kind != other.task.kind:
        return True
    mine, theirs = one.parameters, other.parameters
    ratios = [mine[name] / theirs[name] for name in LENGTH_NAMES if name in mine]
    return float(np.abs(np.log(ratios)).max()) > UNLIKE
