"""Planar rods: Kirchhoff's elastica, which does not stretch, in closed form; shooting; mechanisms.

A rod of length L and bending stiffness EI is clamped at a point under an angle; with theta(s) its
tangent's angle and n the constant force on its tip::

    x' = cos(theta),  y' = sin(theta),  EI theta' = m,  m' = n_x sin(theta) - n_y cos(theta)

`solve`, the reference of a model, is the clamped rod under dead loads of `cantilever`, which may
also stretch and shear.
"""

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
