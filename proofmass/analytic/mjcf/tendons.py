"""Tendons of a compiled model: their ways, springs, dampers and limits."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.mjcf.options import (
    DAMPER_FLAGS,
    FRICTION_FLAGS,
    LIMIT_FLAGS,
    SPRING_FLAGS,
    UNLIMITED,
    is_disabled,
    read_range,
)
from proofmass.base.arrays import Array

WRAP = mujoco.mjtWrap


class TendonWay(StrEnum):
    """What determines the length of a tendon."""

    SUM = "sum of joints"
    STRAIGHT = "from site to site"
    BY_SITES = "by several sites"
    WRAPPED = "around a geom or a pulley"


@dataclass(frozen=True, eq=False)
class TendonData:
    """A tendon.

    What a flag of the model disables is left out: it is zero, or without a limit.

    Attributes
    ----------
    name, way : str, TendonWay
    terms : tuple of (int, float)
        For each joint of a sum: its number, and the coefficient of its value [1].
    points : tuple of (int, ndarray)
        For each site of a straight way or one by sites: body, and point in its frame [m].
    zero : float
        Length in the reference pose [m or rad].
    slack : tuple of float
        Shortest and longest length at which the spring is slack [m or rad].
    stiffness, damping : tuple of float
        Coefficients, lowest power first [SI].
    spring_yields : bool
        Whether its spring yields, so that its force depends on the past.
    friction : float
        Largest dry friction [N or N m].
    armature : float
        Inertia of its length [kg or kg m^2].
    range : tuple of float
        Shortest and longest length [m or rad].
    margin : float
        Distance from the ends of the range at which the limit begins to act [m or rad].
    has_force_range : bool
        Whether the total force of its actuators has a range.
    """

    name: str
    way: TendonWay
    terms: tuple[tuple[int, float], ...]
    points: tuple[tuple[int, Array], ...]
    zero: float
    slack: tuple[float, float]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    spring_yields: bool
    friction: float
    armature: float
    range: tuple[float, float]
    margin: float
    has_force_range: bool

    @property
    def is_limited(self) -> bool:
        """Whether its length has a range."""
        return self.range != UNLIMITED


def read_tendon(model: Any, t: int) -> TendonData:
    """Read tendon number t; `terms` and `points` are empty for a way that has none."""
    way, first = tendon_way(model, t), int(model.tendon_adr[t])
    wraps = range(first, first + int(model.tendon_num[t]))
    terms, points = tuple[tuple[int, float], ...](), tuple[tuple[int, Array], ...]()
    if way == TendonWay.SUM:
        terms = tuple((int(model.wrap_objid[w]), float(model.wrap_prm[w])) for w in wraps)
    elif way != TendonWay.WRAPPED:
        sites = [int(model.wrap_objid[w]) for w in wraps]
        points = tuple((int(model.site_bodyid[s]), np.array(model.site_pos[s])) for s in sites)
    has_spring, has_damper, has_friction, has_limit = (
        not is_disabled(model, flags)
        for flags in (SPRING_FLAGS, DAMPER_FLAGS, FRICTION_FLAGS, LIMIT_FLAGS)
    )
    return TendonData(
        model.tendon(t).name,
        way,
        terms,
        points,
        float(model.tendon_length0[t]),
        (float(model.tendon_lengthspring[t, 0]), float(model.tendon_lengthspring[t, 1])),
        tuple(has_spring * c for c in (model.tendon_stiffness[t], *model.tendon_stiffnesspoly[t])),
        tuple(has_damper * c for c in (model.tendon_damping[t], *model.tendon_dampingpoly[t])),
        bool(has_spring and np.any(model.tendon_springyield[t])),
        float(has_friction * model.tendon_frictionloss[t]),
        float(model.tendon_armature[t]),
        read_range(model.tendon_range[t], has_limit and bool(model.tendon_limited[t])),
        float(model.tendon_margin[t]),
        bool(model.tendon_actfrclimited[t]),
    )


def tendon_way(model: Any, t: int) -> TendonWay:
    """The way of tendon number t."""
    first = int(model.tendon_adr[t])
    kinds = model.wrap_type[first : first + int(model.tendon_num[t])]
    if (kinds == WRAP.mjWRAP_JOINT).all():
        return TendonWay.SUM
    if (kinds == WRAP.mjWRAP_SITE).all():
        return TendonWay.STRAIGHT if kinds.size == 2 else TendonWay.BY_SITES
    return TendonWay.WRAPPED
