"""A balancer whose postures are prescribed: loads, moments and energy, without an equilibrium."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.balancer import quantities
from proofmass.analytic.balancer.model import (
    ChainParameters,
    balancer,
    check_preload,
    close_chain,
    preload_spring,
)
from proofmass.analytic.balancer.path import Path
from proofmass.analytic.numerics import check_finite, cross
from proofmass.analytic.protocol import (
    ClosedForm,
)
from proofmass.base.arrays import Array

MODES = (1, -1)
"""Elbow up, and elbow down."""


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    length1: float,
    length2: float,
    length3: float,
    length4: float | None = None,
    stiffness1: float,
    stiffness2: float,
    stiffness3: float,
    stiffness4: float = 0.0,
    quadratic1: float = 0.0,
    quadratic2: float = 0.0,
    quadratic3: float = 0.0,
    quadratic4: float = 0.0,
    preload2: float = 0.0,
    preload3: float = 0.0,
    preload4: float = 0.0,
    pendulum: float = 1.0,
    rest_angle: float = 0.0,
    rest_angle2: float = 0.0,
    weight: float = 0.0,
    mode: int = 1,
) -> dict[str, Array]:
    r"""Loads of a chain whose pendulum and all joints but the last two are driven.

    The chain is that of `proofmass.analytic.balancer.solve`.  Its posture follows from the drives
    and the loop alone.  The springs of the last two joints then give the force F on the tip, and F
    gives the moment of every drive::

        F x (tip - P_(n-2)) = M_(n-1),     F x (tip - P_(n-1)) = M_n
        drive_i = M_i - F x (tip - P_(i-1)),     holding = F x tip - weight r sin(alpha)

    The drives do all the work: with V the energy of springs and weight,

        dV = holding dalpha + sum_i drive_i de_i

    If the posture is an equilibrium of the chain, the joints need no drive: then drive_i = 0, and
    holding is the balancing moment M1 (less the weight's).  The chain has no stops here; where it
    would rest on a stop, the drives carry the moment of the stop.

    Parameters
    ----------
    angle : pendulum angle alpha and deflections e1 (for four segments e1, e2) [rad], (n, ...); the
        first axis is that of the drives
    rate, acceleration : their time derivatives [rad/s, rad/s^2], which statics does not need
    length1, length2, length3, length4 : segments [m]; length4 makes it a balancer of four segments
    stiffness1, stiffness2, stiffness3, stiffness4 : k of the slack springs [N m/rad]
    quadratic1, quadratic2, quadratic3, quadratic4 : A [N m/rad^2]
    preload2, preload3, preload4 : moment [N m] of the spring at rest
    pendulum : r [m]
    rest_angle, rest_angle2 : angles of segment 1, and of segment 2 of four, at rest [rad]
    weight : force at the tip, down along the upright [N]
    mode : +1 elbow up, -1 elbow down, of the last two segments

    Returns
    -------
    dict of (...) arrays: those of `proofmass.analytic.balancer.solve` without rates and targets,
    and drive_moment1, for four segments also drive_moment2 [N m], clockwise like the deflections.

    Raises
    ------
    ValueError
        A parameter is out of its domain; the first axis has not 2 rows, or 3 for four segments; or
        the last two segments cannot reach the tip in a posture.

    Notes
    -----
    Accuracy: rounding over the sine of the angle between the arms of the last two joints to the
    tip.  Source: S. van Nes, MSc thesis TU Delft 2022.074, appendices B and C for the loads, and F
    for the method: the program SAM takes only mechanisms without degrees of freedom.  The thesis
    therefore prescribed there the angles that its own program had found, and compared loads and
    energy.

    Examples
    --------
    >>> chain = dict(length1=0.3394, length2=0.4573, length3=0.4752, stiffness1=1.2701,
    ...              stiffness2=0.8473, stiffness3=4.1078, rest_angle=0.6641)
    >>> pose = solve([0.8726646260, 0.6050932], **chain)  # theta1 = 1.269193 at 50 degrees
    >>> [round(float(pose[name]), 3) + 0.0 for name in ("holding_moment", "drive_moment1")]
    [0.769, 0.0]
    """
    given = {
        k: v
        for k, v in locals().items()
        if k not in ("angle", "rate", "acceleration")
        and not (length4 is None and k.endswith("4") and not v)
    }
    check_finite(angle=angle)
    joints = range(2, 4 if length4 is None else 5)
    preload = {f"preload{i}": given.pop(f"preload{i}") for i in joints}
    check_finite(**preload)
    chain = balancer(**given)  # without preloads, which would need stops
    wound = np.array([[0.0, *preload.values()]])
    stiffness, _, stored = preload_spring(chain.stiffness, chain.quadratic, wound)
    chain = replace(chain, preload=wound, stiffness=stiffness, stored=stored)
    check_preload(chain)
    inputs, n = np.asarray(angle, float), chain.segments
    if inputs.shape[:1] != (n - 1,):
        raise ValueError(
            f"angle needs {n - 1} rows, the pendulum's and those of {n - 2} deflections, got "
            f"{inputs.shape[0] if inputs.ndim else 'none'}"
        )
    alpha, *given_deflections = inputs.reshape(n - 1, -1)
    rest = chain.rest[0]
    first = np.cumsum(
        np.stack(given_deflections, axis=-1) + np.diff(rest[: n - 2], prepend=0.0), -1
    )
    psi = close_chain(pendulum, chain.length[0], first - alpha[:, None], mode)
    if np.isnan(psi).any():
        first_angle = np.degrees(alpha[np.isnan(psi).any(axis=-1).argmax()])
        raise ValueError(
            f"the last two segments cannot reach the tip at alpha = {first_angle:g} deg"
        )
    deflection = np.diff(psi - rest, axis=-1, prepend=0.0)
    deflection[:, 0] += alpha
    moment = chain.moments(deflection[None])[0]
    arms = np.cumsum((chain.length[0] * (np.sin(psi) + 1j * np.cos(psi)))[:, ::-1], -1)[:, ::-1]
    arm_before, last_arm = arms[:, -2], arms[:, -1]
    force = (moment[:, -2] * last_arm - moment[:, -1] * arm_before) / cross(arm_before, last_arm)
    found = quantities(
        chain,
        Path(
            alpha,
            (psi + alpha[:, None])[None],
            deflection[None],
            moment[None],
            chain.energies(deflection[None]),
            np.zeros((1, alpha.size, n)),
            np.stack([force.real, force.imag], axis=-1)[None],
            np.zeros((1, alpha.size, n)),
        ),
        np.zeros(alpha.size),
    )
    found = {k: v for k, v in found.items() if not k.endswith("_rate")}
    found["holding_moment"] = -pendulum * force.real - weight * pendulum * np.sin(alpha)
    for i in range(n - 2):
        found[f"drive_moment{i + 1}"] = moment[:, i] - found[f"node{i + 1}_load"]
    return {name: value.reshape(inputs.shape[1:]) for name, value in found.items()}


class BalancerPosture(ChainParameters, ClosedForm, function=solve):
    """A balancer whose postures are prescribed: loads, moments and energy, no equilibrium."""
