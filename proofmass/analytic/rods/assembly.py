"""Clamped rods whose tips are pinned or clamped to one rigid platform: 2RFR, 3RFR, 3PFR.

A *plain* assembly has straight rods without loads of their own, pinned to a platform that is free;
the references of mechanisms, `equilibrium`, `continuation` and `all_equilibria`, take plain
assemblies only, and `assembly_search` takes all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.base.arrays import Array, Complex


@dataclass(frozen=True)
class Assembly:
    """k rods and a platform; without arms and clamped tips it is a pin, which bears no moment.

    Attributes
    ----------
    clamp : ndarray (k,)
        Positions O_i of the clamps, or of the beginnings of their guides, as x + iy [m].
    angle : ndarray (k,)
        Tangents at the clamps [rad]; without guides, motors add their angles to them.
    length, stiffness : ndarray (k,)
        L_i [m], EI_i [N m^2].
    arm : ndarray (k,)
        Attachments r_i in the platform's frame, x + iy [m].
    rigid_extension : ndarray (k,)
        Rigid straight end d_i of each rod [m], pinned at its far end.
    guide : ndarray (k,) or None
        Unit vectors of the guides along which the clamps slide; None: motors turn the clamps.
    clamped : ndarray of bool (k,)
        Whether each tip is clamped to the platform instead of pinned.
    tip_angle : ndarray (k,)
        Tangent of a clamped tip in the platform's frame [rad].
    curvature : ndarray (k,)
        Natural curvature u0 of each rod [1/m].
    couple : ndarray (k,)
        Dead moment l on each rod, per length [N].
    weight : ndarray of complex (k,)
        Dead load w on each rod, per length, x + iy [N/m].
    held : ndarray (3,)
        x, y [m] and phi [rad] of the platform, NaN where they are free.
    """

    clamp: Complex
    angle: Array
    length: Array
    stiffness: Array
    arm: Complex
    rigid_extension: Array
    guide: Complex | None
    clamped: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(1, bool))
    tip_angle: Array = field(default_factory=lambda: np.zeros(1))
    curvature: Array = field(default_factory=lambda: np.zeros(1))
    couple: Array = field(default_factory=lambda: np.zeros(1))
    weight: Complex = field(default_factory=lambda: np.zeros(1, complex))
    held: Array = field(default_factory=lambda: np.full(3, np.nan))

    @property
    def rods(self) -> int:
        """Number k of rods."""
        return self.clamp.size

    @cached_property
    def dof(self) -> int:
        """Number p of coordinates of the pose: x, y of a pin; x, y, phi of a platform."""
        return 3 if self.arm.any() or self.clamped.any() else 2

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Those of the coordinates x, y, phi = 0, 1, 2 of the pose that are not held."""
        return np.flatnonzero(np.isnan(self.held[: self.dof]))

    @cached_property
    def is_plain(self) -> bool:
        """Whether straight rods without loads of their own are pinned to a free platform."""
        own = (self.clamped, self.curvature, self.couple, self.weight)
        return self.rods > 1 and not any(part.any() for part in own) and self.free.size == self.dof

    @property
    def scale(self) -> tuple[float, float, float]:
        """A length [m], a force [N] and a moment [N m] that are typical of these rods."""
        length, stiffness = self.length.mean(), self.stiffness.mean()
        return float(length), float(stiffness / length**2), float(stiffness / length)


def assembly(
    clamp: ArrayLike,
    *,
    length: ArrayLike = 1.0,
    stiffness: ArrayLike = 1.0,
    arm: ArrayLike = (0.0, 0.0),
    angle: ArrayLike = 0.0,
    guide: ArrayLike | None = None,
    rigid_extension: ArrayLike = 0.0,
    clamped: ArrayLike = False,
    tip_angle: ArrayLike = 0.0,
    curvature: ArrayLike = 0.0,
    couple: ArrayLike = 0.0,
    weight: ArrayLike = (0.0, 0.0),
    held: Sequence[float | None] = (None, None, None),
) -> Assembly:
    r"""Clamped rods with their tips pinned or clamped to one rigid platform.

    ::

          theta_1                        rod i: clamp O_i, tangent theta_i, length L_i, EI_i
        O1 |/_____                       B_i = P + Rot(phi) r_i: pin of rod i on the platform
                  `.B1____
                    \     |   phi        R (motors): inputs q_i add to the angles of the clamps
                     \ P. |              P (guides): clamp i is at O_i + q_i g_i,
        O2 |\_________\___/ B3                       g_i = (cos alpha_i, sin alpha_i)
                     B2    \
                            `--- O3      all r_i = 0: the tips share one pin P (2RFR)

    Parameters
    ----------
    clamp : O_i [m], (k, 2)
    length, stiffness : L_i [m], EI_i [N m^2], (k,) or one for all
    arm : r_i in the platform's frame [m], (k, 2)
    angle : of the clamps when the inputs are zero [rad], (k,)
    guide : alpha_i [rad], (k,), makes the inputs slide the clamps; None makes them turn
    rigid_extension : rigid end of each rod [m], (k,)
    clamped : of bool, whether tips are clamped to the platform instead of pinned [1], (k,)
    tip_angle : tangent of a clamped tip in the platform's frame [rad], (k,)
    curvature : natural curvature u0 [1/m], (k,), positive where a rod without load bends left
    couple : dead moment per length l [N], (k,)
    weight : dead load per length w [N/m], (k, 2)
    held : x, y [m], phi [rad] of the platform, None where it is free

    Raises
    ------
    ValueError
        A parameter of the wrong shape or sign, or clamps further apart than rods and platform
        reach.

    Notes
    -----
    Source: J. Pérez Gámiz, Resolución del problema de posición de mecanismos ultraflexibles planos
    de cadena cerrada, TFG, UPV/EHU Bilbao 2018, text lines 880-1160.  The rigid extension is in its
    program only (lines 7091-7205).

    Examples
    --------
    >>> assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=0.0522).dof
    2
    >>> assembly([[-3.0, 0.0], [0.3, 0.0]])
    Traceback (most recent call last):
    ValueError: clamps 1 and 2 are 3.3 m apart, and their rods reach 2 m
    """
    points = complex_points("clamp", clamp)
    count = points.size
    lengths = number_per_rod("length", length, count, above=0.0)
    stiff = number_per_rod("stiffness", stiffness, count, above=0.0)
    rigid = number_per_rod("rigid_extension", rigid_extension, count, least=0.0)
    arms, weights = (points_per_rod(*one, count) for one in (("arm", arm), ("weight", weight)))
    guides = None if guide is None else np.exp(1j * number_per_rod("guide", guide, count))
    a = Assembly(
        points,
        number_per_rod("angle", angle, count),
        lengths,
        stiff,
        arms,
        rigid,
        guides,
        number_per_rod("clamped", clamped, count).astype(bool),
        number_per_rod("tip_angle", tip_angle, count),
        number_per_rod("curvature", curvature, count),
        number_per_rod("couple", couple, count),
        weights,
        np.array([np.nan if value is None else value for value in held], float),
    )
    if not a.is_plain and rigid.any():
        raise ValueError(
            "rigid_extension is for straight rods that are pinned to a free platform; clamp a tip "
            "at a point of the platform instead"
        )
    if guides is None:
        check_clamp_distances(a)
    return a


def complex_points(name: str, points: ArrayLike) -> Complex:
    """Points (k, 2) as x + iy (k,); ValueError that names the parameter for anything else."""
    given = np.atleast_2d(np.asarray(points, float))
    if given.ndim != 2 or given.shape[1] != 2 or not np.isfinite(given).all():
        raise ValueError(f"{name} must be finite points [m], (k, 2), got {points!r}")
    return given @ np.array([1.0, 1.0j])


def points_per_rod(name: str, points: ArrayLike, count: int) -> Complex:
    """One point for all rods or one for each (count,), as x + iy."""
    given = complex_points(name, points)
    if given.size not in (1, count):
        raise wrong_shape(name, points, count)
    return np.broadcast_to(given, (count,))


def number_per_rod(
    name: str, value: ArrayLike, count: int, *, above: float = -np.inf, least: float = -np.inf
) -> Array:
    """One finite number for each rod (count,), larger than `above` and not less than `least`."""
    given = np.asarray(value, float)
    if given.shape not in ((), (count,)):
        raise wrong_shape(name, value, count)
    if not (np.isfinite(given) & (given > above) & (given >= least)).all():
        bound = " and above 0" if above == 0.0 else " and not below 0" if least == 0.0 else ""
        raise ValueError(f"{name} must be finite{bound}, got {value!r}")
    return np.broadcast_to(given, (count,))


def wrong_shape(name: str, value: ArrayLike, count: int) -> ValueError:
    """The error for a parameter that is neither one for all rods nor one for each rod."""
    return ValueError(f"{name} must be one for all or one for each of {count} rods, got {value!r}")


def check_clamp_distances(a: Assembly) -> None:
    """ValueError for the first two clamps whose rods and platform are too short to connect them."""
    reach = a.length + a.rigid_extension
    for i in range(a.rods):
        for j in range(i):
            distance = abs(a.clamp[i] - a.clamp[j])
            max_distance = reach[i] + reach[j] + abs(a.arm[i] - a.arm[j])
            if distance > max_distance:
                raise ValueError(
                    f"clamps {j + 1} and {i + 1} are {distance:.6g} m apart, and their "
                    f"rods reach {max_distance:.6g} m"
                )


def triangle(side: float) -> Array:
    """Vertices r_i (3, 2) [m] of an equilateral platform about its centre, the first two below it.

    With them the angle of the side B1-B2 is phi.

    >>> triangle(1.0).round(6).tolist()
    [[-0.5, -0.288675], [0.5, -0.288675], [0.0, 0.57735]]
    """
    if not 0.0 < side < np.inf:
        raise ValueError(f"side must be positive and finite [m], got {side}")
    angles = np.radians([-150.0, -30.0, 90.0])
    return side / np.sqrt(3.0) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def is_mirrored(a: Assembly, pins: ArrayLike) -> NDArray[np.bool_]:
    """Whether pins (..., k, 2) [m] at the right distances belong to a mirror image of the platform.

    The distances of three vertices are the same in a platform and in its mirror image; the sign of
    the area of their polygon is not.  The closure of Pérez Gámiz 2018, eqs 113-115, accepts both.

    >>> a = assembly([[-0.9, -0.5], [0.9, -0.5], [0.0, 1.0]], arm=triangle(0.2))
    >>> is_mirrored(a, triangle(0.2) * [1, -1])
    array(True)
    """
    points = np.asarray(pins, float) @ np.array([1.0, 1.0j])
    if a.dof < 3 or points.shape[-1:] != (a.rods,):
        raise ValueError(
            f"pins must be those of a platform with {a.rods} arms, (..., {a.rods}, 2)"
            f", got {np.shape(pins)}"
        )
    return np.asarray(doubled_area(points) * doubled_area(a.arm) < 0.0)


def doubled_area(points: Complex) -> Array:
    """Twice the signed area of the polygon of points (..., k), positive counter-clockwise."""
    return np.asarray((points.conj() * np.roll(points, -1, axis=-1)).imag.sum(axis=-1))
