"""Equalities of a compiled model: loops closed at points, and ties between joints or tendons."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.mjcf.options import EQUALITY_FLAGS, is_disabled
from proofmass.analytic.names import equality_name
from proofmass.analytic.numerics import IDENTITY_QUATERNION
from proofmass.base.arrays import Array

EQUALITY = mujoco.mjtEq


class EqualityKind(StrEnum):
    """What an equality holds together, in the words of MJCF."""

    CONNECT = "connect"
    WELD = "weld"
    JOINT = "joint"
    TENDON = "tendon"
    FLEX = "flex"
    FLEXVERT = "flexvert"
    FLEXSTRAIN = "flexstrain"


@dataclass(frozen=True, eq=False)
class EqualityData:
    """An equality that acts from the start.

    Attributes
    ----------
    name, kind : str, EqualityKind
    """

    name: str
    kind: EqualityKind

    @property
    def is_rigid(self) -> bool:
        """Whether it is one of rigid bodies, joints or tendons, and not of a flex."""
        return not self.kind.startswith("flex")


@dataclass(frozen=True, eq=False)
class LoopData(EqualityData):
    """A ``connect`` or ``weld``: a point of one body that coincides with a point of another.

    Attributes
    ----------
    one, on_one : int, ndarray (3,)
        The first body, and the point in its frame [m].
    two, on_two : int, ndarray (3,)
        The second body, and the point in its frame [m].
    turns : ndarray (2, 4), optional
        For a weld: quaternions, in bodies one and two, of axes that are constrained to be parallel
        [1].
    scale : float
        Factor of the rows of these axes [1].
    """

    one: int
    on_one: Array
    two: int
    on_two: Array
    turns: Array | None = None
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class TieData(EqualityData):
    """An equality: the value of a joint or tendon is a polynomial of that of another one.

    Both values count from their zeros.

    Attributes
    ----------
    one, two : int
        Numbers of the joints or tendons; `two` is -1 if `one` is constant.
    polynomial : ndarray (5,)
        Coefficients, lowest power first [SI].
    """

    one: int
    two: int
    polynomial: Array

    @property
    def tendons(self) -> bool:
        """Whether `one` and `two` are tendons, not joints."""
        return self.kind == EqualityKind.TENDON

    @property
    def is_constant(self) -> bool:
        """Whether it makes `one` constant."""
        return self.two < 0 or not self.polynomial[1:].any()

    @property
    def is_linear(self) -> bool:
        """Whether the polynomial has no power above the first."""
        return not self.polynomial[2:].any()


def read_equalities(model: Any) -> tuple[EqualityData, ...]:
    """Read the equalities that act from the start, in their order."""
    if is_disabled(model, EQUALITY_FLAGS):
        return ()
    return tuple(read_equality(model, e) for e in np.flatnonzero(model.eq_active0).tolist())


def read_equality(model: Any, e: int) -> EqualityData:
    """Read equality number e."""
    kind = EqualityKind(EQUALITY(int(model.eq_type[e])).name.removeprefix("mjEQ_").lower())
    if kind in (EqualityKind.CONNECT, EqualityKind.WELD):
        return read_loop(model, e, kind)
    name = equality_name(model, e)
    if kind not in (EqualityKind.JOINT, EqualityKind.TENDON):
        return EqualityData(name, kind)
    one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
    return TieData(name, kind, one, two, np.array(model.eq_data[e, :5]))


def read_loop(model: Any, e: int, kind: EqualityKind) -> LoopData:
    """Read equality number e, a connect or a weld."""
    one, two, data = int(model.eq_obj1id[e]), int(model.eq_obj2id[e]), model.eq_data[e]
    weld = kind == EqualityKind.WELD
    # the data of a weld begin with the point on the second body, those of a connect on the first
    places = (data[3:6], data[:3]) if weld else (data[:3], data[3:6])
    turns = [data[6:10], IDENTITY_QUATERNION]
    if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        sides = one, two
        one, two = (int(model.site_bodyid[side]) for side in sides)
        places = tuple(model.site_pos[side] for side in sides)
        turns = [model.site_quat[side] for side in sides]
    return LoopData(
        equality_name(model, e),
        kind,
        one,
        np.array(places[0]),
        two,
        np.array(places[1]),
        np.array(turns) if weld else None,
        float(data[10]) if weld else 1.0,
    )
