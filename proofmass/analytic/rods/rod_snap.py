"""Rod between a motor and a pin that is nearer than its length: it snaps from side to side."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.elliptic import stiff
from proofmass.analytic.rods.rod_snap_charts import branches, shapes
from proofmass.analytic.rods.search_sheet import rods
from proofmass.analytic.rods.snap_family import Family, family, shape

__all__ = ["branches", "facts", "marks", "shapes", "solve"]
SIDES = {"left": 1, "right": -1}


def solve(
    angle: ArrayLike, rate: ArrayLike = 0.0, acceleration: ArrayLike = 0.0, *,
    length: float = 1.0, stiffness: float = 1.0, distance: float, side: str = "left",
) -> dict[str, Array]:
    r"""Equilibrium of a buckled rod that a motor turns at its clamp, followed through its snaps.

    ::

                  .--._
               _.'     `.            EI theta' = m,   theta(0) = a,   m(L) = 0
             _/ )a       `.          (x, y)(L) = (d, 0),   d < L
            @---- d ------ o
          motor           pin        left: bent to the left of the line to the pin, as here

    Bent to the left it stands while a > -a*, bent to the right while a < a*.  Where the motor
    passes such a fold the rod jumps to the other side, and the difference in energy is lost.
    Between -a* and a* the side is a matter of history: samples are taken one after the other.

    Parameters
    ----------
    angle : a, of the motor from the line to the pin [rad], within +-pi, in the order of motion (n,)
    rate, acceleration : of the motor; a rest does not depend on them
    length, stiffness : L [m], EI [N m^2]
    distance : d, from the clamp to the pin [m], from 0.32 to 0.99 L
    side : "left" or "right", to which it is bent before the first sample

    Returns
    -------
    dict of (n,) arrays: mid_x, mid_y [m], half-way along the rod; tip_angle [rad], its tangent at
    the pin, unwrapped from a; holding_moment [N m] of the motor; force_x, force_y [N] of the pin
    on the rod; energy [J] of bending, lost [J] in all snaps so far, and work [J] that the motor has
    done since the first sample, energy + lost less what they were there; side, 1 left and -1 right.

    Raises
    ------
    ValueError
        A pin that is too near or too far, an angle beyond +-pi, an unknown side.

    Notes
    -----
    Within 1e-12 L; at a fold half of the digits are lost.  After a snap the rod rests on the other
    side: of all equilibria at that angle no other stable one has less energy than the rod has at
    the fold (searched for at d = 0.8 L), so that damping leaves no choice.  The shapes are those of
    Pérez Gámiz 2018, eq. 33-46, on a level line of their chart
    (`proofmass.analytic.rods.snap_family`); its single rod (annex II lines 1616-1957) is not moved.

    Examples
    --------
    To -80 degrees and back: on the other side then.

    >>> swing = solve(np.radians([80.0, 0.0, -80.0, 0.0]), distance=0.8)
    >>> swing["mid_y"].round(6).tolist()
    [0.249259, 0.240182, -0.249259, -0.240182]
    """
    family_, a = family(length, distance), np.atleast_1d(np.asarray(angle, float))
    stiff(stiffness)
    if side not in SIDES:
        raise ValueError(f"side must be one of {', '.join(SIDES)}, got {side!r}")
    if not np.all(np.abs(a) <= np.pi):
        raise ValueError(f"angle must be within +-pi [rad], got {a[~(np.abs(a) <= np.pi)][0]}")
    now = sides(a, family_.fold, SIDES[side])
    alpha, q = family_.at(now * a)
    rod, unit = rods(alpha, q), stiffness / length
    place, turn, load = shape(alpha, q, family_.distance, np.array([0.0, 0.5, 1.0]))
    push = unit / length * alpha**2 * load
    snaps = np.cumsum(now != np.append(SIDES[side], now[:-1]))
    energy, lost = unit * rod.energy, unit * drop(family_) * snaps
    return {"mid_x": length * place[1].real, "mid_y": now * length * place[1].imag,
            "tip_angle": a + now * (turn[2] - turn[0]), "holding_moment": -now * unit * rod.moment,
            "force_x": push.real, "force_y": now * push.imag, "energy": energy, "lost": lost,
            "work": energy + lost - energy[0] - lost[0], "side": now}


def sides(angle: Array, fold: float, side: int) -> Array:
    """1 (left) or -1 (right) at each of the angles in turn."""
    now = np.empty(angle.size)
    for i, a in enumerate(angle):
        side = -side if side * a < -fold else side
        now[i] = side
    return now


def drop(of: Family) -> float:
    """Energy lost in a snap, of a rod of unit length and stiffness."""
    before, after = rods(*of.at(of.fold * np.array([-1.0, 1.0]))).energy
    return float(before - after)


def marks(*, length: float = 1.0, distance: float, **_: object) -> dict[str, float]:
    """Angles of the motor [rad] at which the rod snaps.

    >>> {name: round(float(np.degrees(a)), 3) for name, a in marks(distance=0.8).items()}
    {'snaps to the right': -54.337, 'snaps to the left': 54.337}
    """
    fold = family(length, distance).fold
    return {"snaps to the right": -fold, "snaps to the left": fold}


def facts(*, length: float = 1.0, stiffness: float = 1.0, distance: float, **_: object
          ) -> dict[str, str]:
    """What the parameters amount to, for the report's page.

    >>> facts(distance=0.8)["lost in a snap"]
    '6.257 J of 8.341 J'
    """
    of, unit = family(length, distance), stiffness / length
    ends = rods(*of.at(of.fold * np.array([-1.0, 1.0])))
    before, after = unit * np.abs(ends.moment)
    return {"snaps at": f"±{np.degrees(of.fold):.3f}°",
            "holding moment": f"{before:.4g} N m before a snap, {after:.4g} N m after it",
            "lost in a snap": f"{unit * drop(of):.4g} J of {unit * ends.energy[0]:.4g} J"}
