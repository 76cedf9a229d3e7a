"""Dry friction in the joints of a balancer: the loop between the ways out and back."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Loop(NamedTuple):
    """Moments that hold the pendulum on its slow way out and back; each (..., points)."""

    out: Array  # [N m], angle rising
    back: Array  # [N m], angle falling


def loop(moment: ArrayLike, turns: ArrayLike, friction: ArrayLike) -> Loop:
    r"""Holding moment of a balancer with Coulomb friction, to first order in the friction.

    ::

        M                       __--  out       M_out, M_back = M +- sum_i tau_i |de_i/dalpha|
        |              __---====
        |        __--====  --   back            the width is the friction work per angle
        |  __--===--
        +------------------------ alpha

    M of the frictionless path may be used for this reason: let beta be the internal coordinates of
    the chain, V(alpha, beta) its energy, and Q_alpha, Q_beta the forces of friction, with the loss
    sum tau_i |de_i| on the path. Equilibrium V_beta = Q_beta moves beta by V_bb^-1 Q_beta, and the
    holding moment by V_ab V_bb^-1 Q_beta - Q_alpha = -(Q_alpha + beta' Q_beta), since
    beta' = -V_bb^-1 V_ba along the path: that is the friction work per angle. The neglected terms
    are of second order in tau.

    Parameters
    ----------
    moment : M without friction [N m], (..., points)
    turns : de_i/dalpha of every joint with friction, (joints, ..., points): the deflections' rates
        at rate 1; for the pin in the tip that of alpha - theta_n; for the pendulum's own pivot 1
    friction : tau_i [N m], (joints,), zero or positive

    Returns
    -------
    Loop

    Raises
    ------
    ValueError
        A friction moment is negative or not finite, or there is not one for each joint.

    Notes
    -----
    Valid while tau is small against spring moments, where the free chain is stable (V_bb > 0), all
    joints keep turning the same way, and no fold is near. After a turning point, and where a joint
    stands still (de_i/dalpha = 0), it sticks: there the true moment crosses from one branch to the
    other over an angle of about 2 |Q_beta/V_ab| instead of at once.

    Qualitative only: van Nes 2022 names friction as the cause of its measured loop (Fig. 8), widest
    from 60 to 90 degrees, where the internal freedom moves most (lines 936, 980-982, 1031),
    but gives no friction moment. Its branches cross at 50 degrees, which this model cannot do,
    since it loses energy at every angle.

    Examples
    --------
    >>> out, back = loop([1.0, 2.0], [[1.0, 0.5], [0.0, -2.0]], [0.1, 0.2])
    >>> out.round(9), back.round(9)
    (array([1.1 , 2.45]), array([0.9 , 1.55]))
    """
    middle, turn, tau = (np.asarray(x, float) for x in (moment, turns, friction))
    if tau.shape != turn.shape[:1]:
        raise ValueError(
            f"friction must be one moment for each of {len(turn)} joints, got shape {tau.shape}"
        )
    if not np.all((tau >= 0.0) & np.isfinite(tau)):
        raise ValueError(f"friction must be zero or positive [N m], got {tau.tolist()}")
    lost = np.tensordot(tau, np.abs(turn), axes=1)
    return Loop(middle + lost, middle - lost)


def dissipated(angle: ArrayLike, branches: Loop) -> Array:
    """Work [J] lost on one way out and back: area of the loop by trapezoids over `angle` [rad].

    >>> float(dissipated([0.0, 2.0], loop([0.0, 1.0], [[1.0, 1.0]], [0.25])))
    1.0
    """
    return np.asarray(np.trapezoid(branches.out - branches.back, np.asarray(angle, float), axis=-1))
