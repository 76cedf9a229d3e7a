"""A clamped rod that stretches and shears, in the frame of its sections: a second formulation.

The unknowns are the strains: v_z along the section's normal, v_x across it, and the curvature u.
Their equations are those of Pérez Gámiz 2018, eq. 27 without its misprints, with constant
stiffnesses and a dead load f per length,

    GA v_x' = -EA u (v_z - 1) - f . d        t = (cos theta, sin theta), the normal
    EA v_z' =  GA u v_x       - f . t        d = (-sin theta, cos theta)
    EI u'   =  EA v_x (v_z - 1) - GA v_x v_z
    theta' = u,    p' = v_z t + v_x d

They are integrated from the clamp; `scipy.optimize.root` finds its three strains while the loads
grow in steps.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import root

from proofmass.base.arrays import Array


@dataclass(frozen=True)
class Section:
    """EI [N m2], EA and GA [N]."""

    bending: float = 1.0
    axial: float = 1.0
    shear: float = 1.0


def rates(state: Array, section: Section, line: Array) -> Array:
    """d/ds of (v_z, v_x, u, theta, x, y) under a dead load per length."""
    v_z, v_x, u, theta = state[:4]
    c, s = np.cos(theta), np.sin(theta)
    along, across = line[0] * c + line[1] * s, line[1] * c - line[0] * s
    ea, ga = section.axial, section.shear
    return np.array(
        [
            (ga * u * v_x - along) / ea,
            -(ea * u * (v_z - 1.0) + across) / ga,
            (ea * v_x * (v_z - 1.0) - ga * v_x * v_z) / section.bending,
            u,
            v_z * c - v_x * s,
            v_z * s + v_x * c,
        ]
    )


def shoot(
    s: Array,
    section: Section,
    force: tuple[float, float] = (0.0, 0.0),
    moment: float = 0.0,
    line: tuple[float, float] = (0.0, 0.0),
    follower: tuple[float, float] = (0.0, 0.0),
    steps: int = 3,
) -> dict[str, Array]:
    """x, y, theta and m at arc lengths s from a clamp along +x; the last s is that of the tip.

    `force` and `line` keep their directions; `follower` turns with the section at the tip.
    """

    def path(strains: Array, share: float) -> Array:
        start = np.concatenate([strains, np.zeros(3)])
        load = share * np.array(line)
        return solve_ivp(
            lambda _, z: rates(z, section, load),
            (0.0, s[-1]),
            start,
            "DOP853",
            t_eval=s,
            rtol=1e-13,
            atol=1e-14,
        ).y

    def missed(strains: Array, share: float) -> Array:
        v_z, v_x, u, theta = path(strains, share)[:4, -1]
        pull = share * (complex(*force) * np.exp(-1j * theta) + complex(*follower))
        return np.array(
            [
                v_z - 1.0 - pull.real / section.axial,
                v_x - pull.imag / section.shear,
                u - share * moment / section.bending,
            ]
        )

    strains = np.array([1.0, 0.0, 0.0])
    for share in np.arange(1, steps + 1) / steps:
        found = root(missed, strains, args=(share,), tol=1e-12)
        strains = found.x
    if np.abs(found.fun).max() > 1e-11:
        raise ValueError(found.message)
    _, _, u, theta, x, y = path(strains, 1.0)
    return {"x": x, "y": y, "theta": theta, "m": section.bending * u}


def pinned(
    s: Array, section: Section, pin: tuple[float, float], line: tuple[float, float]
) -> dict[str, Array]:
    """x, y, theta and m with the tip at a pin, by scipy's collocation from the straight rod."""
    nodes = np.linspace(0.0, s[-1], 41)
    straight, level = np.hypot(*pin) / s[-1], 0.0 * nodes
    found = solve_bvp(
        lambda _, z: np.stack(rates(z, section, np.array(line))),
        lambda a, b: np.array([*a[3:], b[2], b[4] - pin[0], b[5] - pin[1]]),
        nodes,
        np.stack([level + straight, level, level, level, straight * nodes, level]),
        tol=1e-9,
        max_nodes=20000,
    )
    if not found.success:
        raise ValueError(found.message)
    _, _, u, theta, x, y = found.sol(s)
    return {"x": x, "y": y, "theta": theta, "m": section.bending * u}
