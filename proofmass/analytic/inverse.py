"""Inverse problems: how drives move an end point or a platform along a given path.

A reference that can solve one says so by its attribute `inverse`::

    def lead_trolley(motion, *, drum):
        return tuple(part / drum for part in (motion.place, motion.rate, motion.acceleration))


    class Gantry(Reference):
        inverse = InverseProblem({"x": "trolley_x", "y": "trolley_y"}, lead_trolley)

A ``[drive]`` with ``profile = { path = "line.csv" }`` then leads the mechanism along the rows of a
file, see `proofmass.reference.path`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from proofmass.base.arrays import Array

COORDINATES = {"x": "m", "y": "m", "phi": "rad"}
"""The coordinates that a path may have, with their SI units: a place and an angle in the plane."""
DriveMotion = tuple[Array, Array, Array]


@dataclass(frozen=True)
class PathMotion:
    """The motion of an end point or a platform at rising times, from the beginning of a path on.

    Attributes
    ----------
    time : ndarray (n,)
        Times [s].
    place, rate, acceleration : ndarray (coordinates, n)
        Coordinates in the order of `InverseProblem.curves` and their time derivatives [m, rad].
    load_rates, load_accelerations : dict of str to ndarray (n,)
        First and second time derivatives of the parameters that loads change [SI].
    """

    time: Array
    place: Array
    rate: Array
    acceleration: Array
    load_rates: Mapping[str, Array] = field(default_factory=dict)
    load_accelerations: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class InverseProblem:
    """How a reference finds the motion of its drives for that of an end point or a platform.

    Attributes
    ----------
    curves : dict of str to str
        For each coordinate of the path, x, y or phi, the curve of the reference's own `solve` that
        equals it: the direct problem has to give the path back.
    solve : function
        Takes a `PathMotion`, and by keyword those of its parameters that the case gives, as arrays
        (n,) where a load changes them.  Returns values [rad or m] of all drives, their rates and
        accelerations, (drives, n) each, all of one branch that begins with the path.  A ValueError
        names the first place that cannot be reached, and by how much it is missed.
    accuracy : float
        Error of its values as a share of their range [1]; values in between need no smaller one.
    at_each_place : bool
        Whether it solves each place by itself, as closed forms do, so that drives can ask it at any
        time. Otherwise they follow polynomials through its solutions.

    Examples
    --------
    >>> InverseProblem({"r": "radius"}, max)
    Traceback (most recent call last):
    ValueError: a path has no coordinate 'r'; it may have x, y, phi
    """

    curves: Mapping[str, str]
    solve: Callable[..., DriveMotion]
    accuracy: float = 1e-12
    at_each_place: bool = False

    def __post_init__(self) -> None:
        for name in self.curves:
            if name not in COORDINATES:
                raise ValueError(
                    f"a path has no coordinate {name!r}; it may have {', '.join(COORDINATES)}"
                )
