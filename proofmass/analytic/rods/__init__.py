"""Planar rods: Kirchhoff's inextensible elastica in closed form; shooting; mechanisms of rods.

A rod of length L and bending stiffness EI is clamped at a point at an angle.  With theta(s) the
angle of its tangent and n the constant force on its tip::

    x' = cos(theta),  y' = sin(theta),  EI theta' = m,  m' = n_x sin(theta) - n_y cos(theta)

`solve`, the reference ``rod`` of models, is that of `cantilever`: a clamped rod under dead loads,
which may also stretch and shear.
"""

from typing import Annotated

from proofmass.analytic.protocol import (
    Angle,
    BendingStiffness,
    ClosedForm,
    Domain,
    Force,
    Length,
    Moment,
    Natural,
    Position,
    Quantity,
)
from proofmass.analytic.rods.buckling import buckling, imperfect
from proofmass.analytic.rods.cantilever import equilibria, pseudo_rigid, solve
from proofmass.analytic.rods.column import critical, elastica, ends_meet, self_buckling
from proofmass.analytic.rods.elastica import (
    bounds,
    modulus,
    of_load,
    of_shape,
    relative,
    shape,
    tip,
)
from proofmass.analytic.rods.rod_pinned import pinned
from proofmass.analytic.rods.shooting import from_tip, integrate

__all__ = [
    "ClampedRod",
    "bounds",
    "buckling",
    "critical",
    "elastica",
    "ends_meet",
    "equilibria",
    "from_tip",
    "imperfect",
    "integrate",
    "modulus",
    "of_load",
    "of_shape",
    "pinned",
    "pseudo_rigid",
    "relative",
    "self_buckling",
    "shape",
    "solve",
    "tip",
]


class ClampedRod(ClosedForm, function=solve):
    """A clamped planar rod under dead loads, which may also stretch and shear."""

    method = "solver of a clamped rod, by elliptic functions or by shooting"
    charts = (
        buckling,
        imperfect,
    )

    length: Length
    stiffness: BendingStiffness
    force_x: Force
    force_y: Force
    moment: Moment
    weight_x: Annotated[float, Quantity("N/m")]
    weight_y: Annotated[float, Quantity("N/m")]
    follower_x: Force
    follower_y: Force
    x0: Position
    y0: Position
    theta0: Angle
    axial: Annotated[float, Quantity("N", Domain.POSITIVE_OR_INF)]
    shear: Annotated[float, Quantity("N", Domain.POSITIVE_OR_INF)]
    branch: Natural
