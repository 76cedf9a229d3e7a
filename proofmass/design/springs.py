"""Choose the springs of a design from a catalogue or as clock springs, and make its record.

Springs of a catalogue fit if the ratios of their stiffnesses are those of the design.
Clock springs are flat strips wound to spirals, with a length and a stress that a maker accepts::

      b  out of the plane          k = E b t^3/(12 L)
     +--+
     |  | t  in the plane          stress = 6 M/(b t^2),  at the faces of the strip
     +--+
      L  along the strip           both for clamped ends, with the same moment in the whole strip

A strip in the file of `read_strips` is a cross section that a maker offers, with the lengths of the
shortest and the longest piece, Young's modulus and the largest stress.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from pathlib import Path
from typing import Any

import numpy as np

from proofmass.analytic.balancer.model import balancers
from proofmass.analytic.balancer.path import along, follow
from proofmass.analytic.balancer.synthesis import LAST_PATH_ANGLE, Synthesis
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.recorded import read_named_rows

# Stiffnesses [N m/rad] of the prototype's springs: van Nes 2022, table J.1, with six decimals that
# follow from the deviations in table J.2.
CATALOGUE = {"907": 0.037241, "903": 0.024637, "908": 0.081929}
CATALOGUE_HEADER = ("spring", "stiffness [N m/rad]")


STRIP_HEADER = (
    "strip",
    "width [mm]",
    "thickness [mm]",
    "shortest [mm]",
    "longest [mm]",
    "modulus [GPa]",
    "stress [MPa]",
)
STRIP_SCALES = (1e-3, 1e-3, 1e-3, 1e-3, 1e9, 1e6)
"""Factors of the columns after the name, to SI units."""
SPRING_COUNTS = (1, 2)
"""Numbers of springs at a joint; the thesis's prototype has two, wound oppositely."""


@dataclass(frozen=True)
class SpringStrip:
    """A strip that a maker offers.

    Attributes
    ----------
    name : str
    width, thickness : float
        Width b out of the plane of bending and thickness t in it [m].
    shortest, longest : float
        Lengths of the shortest and the longest piece that can be made [m].
    modulus, stress : float
        Young's modulus E, and the largest bending stress [Pa].
    """

    name: str
    width: float
    thickness: float
    shortest: float
    longest: float
    modulus: float
    stress: float


@dataclass(frozen=True)
class Selection:
    """Catalogue springs chosen for every joint.

    Attributes
    ----------
    springs : tuple of tuple of str
        Names of the catalogue springs in parallel at each joint, two at most; a joint may have
        none.
    stiffness : tuple of float
        Total stiffness at each joint [N m/rad].
    ratios : tuple of float
        Stiffness of each joint over that of joint 2 [1].
    error : float
        Square root of the sum of the squared deviations of these ratios from the design's [1].
    scale : float
        m g r [N m] that the springs balance, for a design that balances 1 N m; a least-squares
        fit over the joints.
    """

    springs: tuple[tuple[str, ...], ...]
    stiffness: tuple[float, ...]
    ratios: tuple[float, ...]
    error: float
    scale: float


def select_springs(
    stiffness: Sequence[float], catalogue: Mapping[str, float] = CATALOGUE
) -> Selection:
    r"""Choose the catalogue springs whose ratios fit a design best, at most two at each joint.

    ::

        minimise  sqrt(sum_i (K_i/K_2 - k_i/k_2)^2),    K_i = sum of at most two of the catalogue

    For a given K_2 the best springs of each joint do not depend on those of the others.  So one
    search in a sorted list for each K_2, that is for each pair of springs, covers all combinations:
    the result is exact for a catalogue of any size.

    Parameters
    ----------
    stiffness : k_1, k_2, .. of the design [N m/rad]; the second must be positive
    catalogue : stiffness [N m/rad] by name

    Raises
    ------
    ValueError
        The design has no spring in joint 2.

    Notes
    -----
    Van Nes 2022, listing N.1, uses a genetic algorithm over 13^6 combinations.

    Examples
    --------
    >>> select_springs([1.498937760758821, 1.0, 4.847839773931474]).springs
    (('907',), ('903',), ('907', '908'))
    """
    wanted = np.asarray(stiffness, float)
    if not wanted[1] > 0:
        raise ValueError(
            f"ratios need a spring in joint 2, whose stiffness is {wanted[1]:g}; keep "
            f"it from zero by a bound"
        )
    pairs = [(), *((name,) for name in catalogue), *combinations_with_replacement(catalogue, 2)]
    sums = np.array([sum(catalogue[name] for name in pair) for pair in pairs])
    order = np.argsort(sums, kind="stable")
    sums, second = sums[order], sums[order][1:]
    ideal = wanted / wanted[1] * second[:, None]
    above = np.clip(np.searchsorted(sums, ideal), 1, sums.size - 1)
    nearer = above - (ideal - sums[above - 1] <= sums[above] - ideal)
    errors = np.linalg.norm((sums[nearer] - ideal) / second[:, None], axis=-1)
    chosen = nearer[errors.argmin()]
    found = sums[chosen]
    return Selection(
        tuple(pairs[order[k]] for k in chosen),
        tuple(found.tolist()),
        tuple((found / found[1]).tolist()),
        float(errors.min()),
        float(found @ wanted / (wanted @ wanted)),
    )


def read_catalogue(file: Path) -> dict[str, float]:
    """Read a catalogue: stiffnesses [N m/rad] by name.

    The CSV file has the header ``spring,stiffness [N m/rad]`` and a row for each spring.

    Raises
    ------
    InputError
        There is no such file, its header differs, a stiffness is not a positive number, or a name
        occurs twice.
    """
    return {
        name: value for name, (value,) in read_named_rows(file, CATALOGUE_HEADER, "spring").items()
    }


def describe_design(
    task: Synthesis,
    vectors: Array,
    catalogue: Mapping[str, float],
    strips: Sequence[SpringStrip] = (),
    moment: float = 1.0,
) -> dict[str, Any]:
    """The record of the first of the designs (B, d), which are sorted with the best first.

    For linear springs it includes springs of the catalogue, if there are any, for that design with
    which they give the smallest error.  With `strips` it includes the clock springs with which the
    first design balances m g r = `moment` [N m].
    """
    variant = task.variant
    record = {
        "target": variant.target,
        "segments": variant.segments,
        "springs": variant.springs,
        "preload": variant.preload,
        "option": variant.option,
        "figure": variant.figure,
        "bounds": variant.bounds,
        "points": task.angles.size,
        **design_figures(task, vectors[0]),
    }
    fits = bool(catalogue) and variant.springs == "linear"
    if fits and (chosen := fit_catalogue(task, vectors, catalogue)):
        record["selection"] = chosen
    if strips:
        record["clock_springs"] = choose_clock_springs(task, vectors[0], strips, moment)
    return record


def choose_clock_springs(
    task: Synthesis, vector: Array, strips: Sequence[SpringStrip], moment: float
) -> list[dict[str, Any]]:
    """The clock spring of each joint of a design (d,) for m g r = `moment` [N m].

    A joint for which no spring can be made has the reason instead, and a joint without stiffness
    has no spring.
    """
    flat = task.variant.parameters(vector[None])
    chain = balancers(**flat)
    angle = np.concatenate([[0.0], task.angles])
    largest = np.abs(along(chain, follow(chain, LAST_PATH_ANGLE), angle).moment[0]).max(axis=0)
    found: list[dict[str, Any]] = []
    for i, moment_at_joint in enumerate(largest * moment, 1):
        k = float(flat[f"stiffness{i}"][0]) * moment
        joint: dict[str, Any] = {"joint": i, "stiffness": k, "moment": float(moment_at_joint)}
        if k > 0:
            try:
                spring = choose_strip(k, float(moment_at_joint), strips)
            except ValueError as error:
                joint["why"] = str(error)
            else:
                joint |= {
                    "strip": spring.strip.name,
                    "count": spring.count,
                    "length": spring.length,
                    "stress": spring.stress,
                }
        found.append(joint)
    return found


def design_figures(task: Synthesis, vector: Array) -> dict[str, Any]:
    """Error, work reduction, spread of energy and parameters of a design (d,)."""
    figures = task.figures(vector[None])
    return {
        "rmse": float(figures.rmse[0]),
        "work_reduction": float(figures.work_reduction[0]),
        "spread": float(figures.spread[0]),
        "parameters": {k: float(v[0]) for k, v in task.variant.parameters(vector[None]).items()},
    }


def fit_catalogue(
    task: Synthesis, vectors: Array, catalogue: Mapping[str, float]
) -> dict[str, Any]:
    """Catalogue springs for the design that has the smallest error with them, and its figures.

    All designs are tried, since designs near the best one are nearly as good and have other ratios
    of stiffnesses.  The result is empty if no design has a spring in joint 2, or if none can be
    evaluated with catalogue springs.
    """
    places = [
        list(task.variant.usual).index(f"stiffness{i + 1}") for i in range(task.variant.segments)
    ]
    tried = [
        (vector, select_springs(vector[places], catalogue))
        for vector in vectors
        if vector[places[1]] > 0
    ]
    if not tried:
        return {}
    with_springs = np.array([replace_stiffness(vector, chosen, places) for vector, chosen in tried])
    errors = task.figures(with_springs).rmse
    if np.isnan(errors).all():
        return {}
    best = int(np.nanargmin(errors))
    chosen = tried[best][1]
    return {
        "springs": chosen.springs,
        "stiffness": chosen.stiffness,
        "ratios": chosen.ratios,
        "error": chosen.error,
        "moment": chosen.scale,
        **design_figures(task, with_springs[best]),
    }


def replace_stiffness(vector: Array, chosen: Selection, places: list[int]) -> Array:
    """A design (d,) with its stiffnesses replaced by the chosen ones, scaled to m g r = 1 N m.

    `places` are the indices of the stiffnesses in the vector.
    """
    changed = vector.copy()
    changed[places] = np.array(chosen.stiffness) / chosen.scale
    return changed


@dataclass(frozen=True)
class ClockSpring:
    """The clock springs to be made for a joint.

    Attributes
    ----------
    strip : SpringStrip
    count : int
        Number of equal springs in parallel.
    length : float
        Length of the strip of each spring [m].
    stress : float
        Bending stress of each spring at the largest moment of the joint [Pa].
    """

    strip: SpringStrip
    count: int
    length: float
    stress: float

    @property
    def volume(self) -> float:
        """Volume of all strips of the joint [m^3]."""
        return self.count * self.length * self.strip.width * self.strip.thickness

    @property
    def faults(self) -> list[str]:
        """Reasons why the maker would not accept the springs; empty if they can be made."""
        s, found = self.strip, []
        if not s.shortest <= self.length <= s.longest:
            found.append(
                f"has a length of {1e3 * self.length:.4g} mm "
                f"({1e3 * s.shortest:g} to {1e3 * s.longest:g} mm can be made)"
            )
        if self.stress > s.stress:
            found.append(
                f"has a stress of {1e-6 * self.stress:.4g} MPa "
                f"(up to {1e-6 * s.stress:g} MPa is allowed)"
            )
        return found


def strip_stiffness(strip: SpringStrip, length: float) -> float:
    """Stiffness k = E b t^3/(12 L) [N m/rad] of a clock spring from a strip of a length [m].

    Source: van Nes 2022, eq. I.1, line 1562.  The equation is that of a straight strip in bending,
    and holds for windings that do not touch.  The springs of table J.1 there are stiffer by a fifth
    to two fifths than the equation gives with the length of their windings,
    2 pi n (r_in + r_out)/2, since not the whole length bends.

    >>> steel = SpringStrip("907", 6e-3, 0.6e-3, 0.1, 2.0, 206e9, 1.4e9)
    >>> round(strip_stiffness(steel, 0.597409), 6)
    0.037241
    """
    return strip.modulus * strip.width * strip.thickness**3 / (12.0 * length)


def make_clock_spring(k: float, moment: float, strip: SpringStrip, count: int = 1) -> ClockSpring:
    """The clock spring from a strip with a given stiffness, and its stress.

    Whether it can be made is not checked; see `ClockSpring.faults`.

    Parameters
    ----------
    k : float
        Stiffness of the joint [N m/rad], positive.
    moment : float
        Largest moment of the joint's springs [N m].
    strip : SpringStrip
    count : int
        Number of equal springs in parallel.
    """
    length = strip_stiffness(strip, 1.0) * count / k
    return ClockSpring(
        strip, count, length, 6.0 * abs(moment) / count / (strip.width * strip.thickness**2)
    )


def choose_strip(k: float, moment: float, strips: Sequence[SpringStrip]) -> ClockSpring:
    """The clock springs of least volume that a maker accepts, one or two in parallel.

    Raises
    ------
    ValueError
        None can be made; the message lists the faults for each strip.
    """
    tried = [make_clock_spring(k, moment, strip, n) for strip, n in product(strips, SPRING_COUNTS)]
    made = [spring for spring in tried if not spring.faults]
    if not made:
        why = "; ".join(f"{s.count} x {s.strip.name} {' and '.join(s.faults)}" for s in tried)
        raise ValueError(f"no clock spring for {k:.4g} N m/rad and {abs(moment):.4g} N m: {why}")
    return min(made, key=lambda spring: (spring.volume, spring.count))


def read_strips(file: Path) -> list[SpringStrip]:
    """Read the strips that a maker offers from a CSV file with a row for each strip.

    Raises
    ------
    InputError
        There is no such file, its header differs, a value is not positive, a name occurs twice, or
        a longest piece is not longer than the shortest.
    """
    found = []
    for name, cells in read_named_rows(file, STRIP_HEADER, "strip").items():
        strip = SpringStrip(
            name, *(cell * scale for cell, scale in zip(cells, STRIP_SCALES, strict=True))
        )
        if not strip.shortest < strip.longest:
            raise InputError(file, name, "the longest piece must exceed the shortest")
        found.append(strip)
    return found
