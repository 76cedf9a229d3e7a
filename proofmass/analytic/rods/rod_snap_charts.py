"""Charts of a rod between a motor and a pin: all its equilibria, and its shapes around a snap."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.chart import Chart, Line, Panel
from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.rods.search_sheet import rods
from proofmass.analytic.rods.snap_family import Family, family, shape

POINTS = 81  # of a rod
COUNTS = "no", "one", "two"


def branches(*, length: float = 1.0, stiffness: float = 1.0, distance: float) -> Chart:
    """Holding moment over the motor's angle, of all equilibria with up to 3.5 half waves.

    Parameters
    ----------
    length, stiffness : L [m], EI [N m^2]
    distance : d, from the clamp to the pin [m]

    Returns
    -------
    Chart
        Either side's branch, piece by piece between its folds, and the two snaps.

    Examples
    --------
    >>> chart = branches(distance=0.8)
    >>> [line.label for line in chart.lines if line.stable and not line.points]
    ['stable, bent to the left', 'stable, bent to the right']
    """
    of, unit = family(length, distance), stiffness / length
    alpha, q = np.exp(of.place.T)
    moment = -unit * rods(alpha, q).moment
    near = np.abs(of.angle) < 2.0 * of.fold
    lines = [line for side, word in ((1, "left"), (-1, "right"))
             for line in pieces(of, side * of.angle, side * moment, near, word)]
    after = float(-unit * rods(*of.at(np.array([of.fold]))).moment[0])
    for side in (1, -1):
        lines.append(Line(-side * np.full(2, of.fold), side * np.array(
            [moment[of.folds[0]], -after]), "before and after a snap", points=True))
    return Chart(
        ("motor", "rad"), ("holding moment", "N m"), (Panel(tuple(lines)),),
        f"Each side's branch ends in a fold, at ∓{np.degrees(of.fold):.2f}°, from where the rod "
        f"snaps to the other side. Beyond the fold the branch goes back as a pass between valleys, "
        f"and beyond the next one with two directions to fall in.")


def pieces(of: Family, angle: Array, moment: Array, near: NDArray[np.bool_], word: str
           ) -> Iterator[Line]:
    """A branch between its folds, as far as it is near."""
    ends = [0, *of.folds[:2], angle.size - 1]
    for count, first, last in zip(COUNTS, ends[:-1], ends[1:], strict=True):
        part = np.arange(first, last + 1)[near[first: last + 1]]
        label = f"{count} direction{'s' * (count == 'two')} to fall in"
        yield Line(angle[part], moment[part], f"stable, bent to the {word}" if count == "no"
                   else label, stable=count == "no")


def shapes(*, length: float = 1.0, distance: float) -> Chart:
    """Shapes on the way to a snap, and those between which the rod then jumps.

    Parameters
    ----------
    length : L [m]
    distance : d, from the clamp to the pin [m]

    Returns
    -------
    Chart
        To the left: stable shapes as the motor turns down from 80 degrees; to the right: before the
        snap and after it.
    """
    of = family(length, distance)
    a = np.radians(np.linspace(80.0, -np.degrees(of.fold), 6))
    before = drawn(of, a, length)
    landed = drawn(of, np.array([of.fold]), length)[0].conj()
    way = tuple(Line(p.real, p.imag, f"{angle:.1f}°") for p, angle in
                zip(before, np.degrees(a), strict=True))
    snap = (Line(before[-1].real, before[-1].imag, "before the snap", stable=False),
            Line(landed.real, landed.imag, "after it"))
    return Chart(
        ("x", "m"), ("y", "m"),
        (Panel(way, title="the motor turns down"), Panel(snap, title="it snaps")),
        "The arch gives way to the dip at its clamp, until none of it holds any more; it then "
        "jumps to the mirrored side.", alike=True)


def drawn(of: Family, angle: Array, length: float) -> Complex:
    """Places x + iy [m] of stable rods that are bent to the left (n, points)."""
    alpha, q = of.at(angle)
    return np.asarray(length * shape(alpha, q, of.distance, np.linspace(0.0, 1.0, POINTS))[0].T)
