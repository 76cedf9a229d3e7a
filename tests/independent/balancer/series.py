"""The moment-angle curve of three segments in closed form, without any search."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.balancer.model import balancer, close_chain
from proofmass.base.arrays import Array


def curve(beta: ArrayLike, **parameters: float) -> dict[str, Array]:
    r"""Pendulum angle and balancing moment where segment 1 stands at `beta` from the pendulum.

    With beta = theta1 - alpha the deflections of springs 2 and 3 depend on beta alone: seen from
    spring 1 the rest of the chain is one nonlinear spring in series with it::

        M1 = -dU/dbeta,    U(beta) = V2(e2) + V3(e3),    alpha = theta10 - beta + M1/k1

        de2/dbeta = -1 - l1 sin(theta3 - theta1)/(l2 sin(theta3 - theta2))
        d(e2 + e3)/dbeta = -1 + l1 sin(theta2 - theta1)/(l3 sin(theta3 - theta2))

    The curve is that of the free joints; on a stop beta is constant, and dM1/dalpha = k1.

    Parameters
    ----------
    beta : angle of segment 1 from the pendulum [rad] (...); rest_angle at rest
    **parameters : of `proofmass.analytic.balancer.solve`, three segments, spring 1 linear

    Returns
    -------
    dict of (...) arrays: alpha [rad], balancing_moment [N m]; NaN where the chain does not reach.

    Raises
    ------
    ValueError
        As `solve`; spring 1 not linear, or four segments.

    Notes
    -----
    Exact; the derivatives are singular where segments 2 and 3 are in line. The curve covers every
    branch, stable or not. It is not in van Nes 2022, but follows from its eqs 9-11.

    Examples
    --------
    >>> from proofmass.analytic.balancer import solve
    >>> shape = dict(length1=0.5, length2=0.5, length3=0.5, rest_angle=1.0, stiffness1=1.0,
    ...              stiffness2=0.5, stiffness3=0.5)
    >>> found = curve(0.8, **shape)
    >>> followed = solve(found["alpha"], **shape)
    >>> abs(float(followed["balancing_moment"] - found["balancing_moment"])) < 1e-14
    True
    """
    b = balancer(**parameters)
    if b.segments != 3 or b.quadratic[0, 0] != 0:
        raise ValueError("the closed curve is for three segments with a linear spring 1")
    angle = np.asarray(beta, float)
    psi = close_chain(b.pendulum[0], b.length[0], angle[..., None], int(parameters.get("mode", 1)))
    e = np.diff(psi - b.rest[0], axis=-1, prepend=0.0)
    moment = b.moments(np.reshape(e, (1, -1, 3)))[0].reshape(psi.shape)
    one, two, three = np.moveaxis(psi, -1, 0)
    l1, l2, l3 = b.length[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        second = -l1 * np.sin(three - one) / (l2 * np.sin(three - two))
        third = l1 * np.sin(two - one) / (l3 * np.sin(three - two))
    m1 = -(moment[..., 1] * (second - 1.0) + moment[..., 2] * (third - second))
    return {"alpha": b.rest[0, 0] - angle + m1 / b.stiffness[0, 0], "balancing_moment": m1}
