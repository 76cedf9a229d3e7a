"""Torsion-spring balancer of a pendulum: a chain of two to four segments, stops, preloads."""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.balancer.friction import follow_with_friction
from proofmass.analytic.balancer.measures import events, properties, target_for
from proofmass.analytic.balancer.measures import expected as expected_of
from proofmass.analytic.balancer.model import (
    NUMBERED_DEFAULTS,
    NUMBERED_PARAMETERS,
    OTHER_DEFAULTS,
    Balancer,
    ChainParameters,
    balancer,
)
from proofmass.analytic.balancer.nearby import path_to
from proofmass.analytic.balancer.path import (
    BalancerPaths,
    Path,
    along,
    balancing_moment,
    follow,
)
from proofmass.analytic.numerics import (
    check_finite,
    check_not_negative,
    components_in_frame,
    cross,
    motion_senses,
)
from proofmass.analytic.protocol import (
    ClosedForm,
    Domain,
    Quantity,
    Word,
)
from proofmass.base.arrays import Array

MODES = (1, -1)
"""Elbow up, and elbow down."""
PATH_MARGIN = 1e-9
"""Length of the path beyond the largest angle [rad], so that rounding does not end it before."""
TARGET_CURVES = ("target", "residual", "target_energy")
"""The curves that a design target adds."""

__all__ = [
    "MODES",
    "Balancer",
    "BalancerPaths",
    "BalancerReference",
    "Path",
    "along",
    "balancer",
    "events",
    "follow",
    "properties",
    "solve",
]


def solve(
    angle: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    length1: float,
    length2: float,
    length3: float | None = None,
    length4: float | None = None,
    stiffness1: float,
    stiffness2: float,
    stiffness3: float = 0.0,
    stiffness4: float = 0.0,
    quadratic1: float = 0.0,
    quadratic2: float = 0.0,
    quadratic3: float = 0.0,
    quadratic4: float = 0.0,
    preload2: float = 0.0,
    preload3: float = 0.0,
    preload4: float = 0.0,
    low2: float = -np.inf,
    low3: float = -np.inf,
    low4: float = -np.inf,
    high2: float = np.inf,
    high3: float = np.inf,
    high4: float = np.inf,
    pendulum: float = 1.0,
    extension1: float = 0.0,
    extension2: float = 0.0,
    rest_angle: float = 0.0,
    rest_angle2: float = 0.0,
    weight: float = 0.0,
    mode: int = 1,
    friction1: float = 0.0,
    friction2: float = 0.0,
    friction3: float = 0.0,
    friction4: float = 0.0,
    pendulum_friction: float = 0.0,
    target: str = "",
    target_moment: float = 1.0,
    expected: str = "",
) -> dict[str, Array]:
    r"""Static equilibrium of a chain with torsion springs that balances a pendulum.

    ::

               tip        pendulum O-tip, r, leaning by alpha from the upright
              / /|        chain O-P1-P2-tip, segments l1, l2, l3 (l4)
          l3 / / |        torsion springs at O, P1, P2 (P3); none at the tip
            / /  | r
         P2 \/   |        all angles clockwise from the upright:
          l2 \   |            point = l (sin theta, cos theta)
              \  |        rest posture: alpha = 0, segment 1 at rest_angle
            P1 \_| l1     mode +1: elbow up, theta_n > theta_(n-1); -1: elbow down
                 O

    Deflections from rest are e1 = theta1 - theta10 and ei = (theta_i - theta_(i-1)) - (the same at
    rest).  A spring wound up by e* to its preload has the moment M = k (e + e*) + A (e + e*)^2.
    Joints may have stops, low <= e <= high; a preload needs a stop that carries it at rest.  The
    chain is in equilibrium where

        V(alpha, theta) = sum V_i(e_i)

    is stationary under the loop and the stops.  This equilibrium is followed from the rest posture,
    and stops are left and met at their exact angles.  The moment on the pendulum that keeps it in
    equilibrium is then

        dV*/dalpha = M1,     less the weight's, weight r sin(alpha)

    since a rotation of all segments about O winds spring 1 alone.  Two segments form a triangle
    with the pendulum that keeps its shape: M1 = k alpha + A alpha^2.  A pendulum that extends as it
    leans, as a human back does, has r = pendulum + extension1 alpha + extension2 alpha^2.  The
    chain's force f along it then does work as well, and the chain balances

        dV*/dalpha = M1 - f dr/dalpha

    of the weight's  weight (r sin(alpha) - dr/dalpha cos(alpha)).

    With dry friction the order of the angles matters: from an equilibrium without friction at the
    first angle on, joints stick, or slip with their friction against the motion
    (`proofmass.analytic.balancer.friction`); a joint that begins and ends to slip within 0.01 rad
    of the pendulum is not noticed. To first order in the friction, with the rates de_i of
    the frictionless path, the moment differs by +-(friction1 |de1/dalpha| + friction2 ...), with
    the sense of the motion: the width of the hysteresis loop is the friction's work per angle.

    Parameters
    ----------
    angle : pendulum angle alpha [rad], (...); with an extension it may be (2, n), alpha and the
        extension [m] of a drive, which has to be that of r(alpha)
    rate, acceleration : its time derivatives [rad/s, rad/s^2]; `rate` scales the quasi-static
        rates, `acceleration` has no meaning in statics
    length1, length2, length3, length4 : segments [m]; without length4 it is a balancer of three
        segments, without length3 one of two
    stiffness1, stiffness2, stiffness3, stiffness4 : k of the slack springs [N m/rad]
    quadratic1, quadratic2, quadratic3, quadratic4 : A [N m/rad^2]
    preload2, preload3, preload4 : moment [N m] of the spring at rest
    low2, low3, low4, high2, high3, high4 : stops of deflections from rest [rad], low <= 0 <= high
    pendulum : length r [m]; at rest if it extends
    extension1, extension2 : coefficients of its extension by alpha [m/rad, m/rad^2]
    rest_angle, rest_angle2 : angles of segment 1, and of segment 2 of four, at rest [rad]
    weight : force at the tip, down along the upright [N]
    mode : +1 elbow up, -1 elbow down, of the last two segments at rest
    friction1, friction2, friction3, friction4 : dry friction of the joints with springs [N m]
    pendulum_friction : dry friction of the pendulum's own bearing [N m]
    target, target_moment : the moment curve for which the balancer is designed, by its name in
        `proofmass.analytic.balancer.measures` or ``weight``, the moment of a mass on the pendulum
        as it extends; and the moment m g r [N m] that the curve is multiplied by
    expected : name of a curve of `proofmass.analytic.balancer.measures.EXPECTED`, with which a
        measurement was compared

    Returns
    -------
    dict of (...) arrays: theta1.., deflection1.. [rad], theta1_rate.., deflection1_rate.. [rad/s],
    node2_x, node2_y, .. [m] of the joints from the end of segment 1 on, y up,
    moment1.. [N m] of the springs, balancing_moment [N m], holding_moment [N m] about O of the
    drive that turns the pendulum, extension_force [N] of the drive that extends it,
    energy1.. [J] of the springs, weight_energy (zero at the height of O), energy of springs and
    weight,
    friction1.. [N m] against the deflections, frictionless_moment [N m], the holding_moment
    without friction,
    force_x, force_y [N] of the chain on the tip, x to the side of growing alpha, y up (every pin
    carries the same force, since the segments have no weight); node1_force_x, node1_force_y, ..,
    the same force on each segment from the one before or from the ground, along that segment and
    across it, to the left; node1_load, .. [N m], the moment on it there, of the spring and of a
    stop, against the deflection.  With a target also target [N m],
    residual = balancing_moment - target, and target_energy [J], the energy of the balanced mass.
    With an expected curve also expected_moment [N m], and expected_measurement [N m], the same
    moment with the friction's hysteresis loop to first order.

    Raises
    ------
    ValueError
        A parameter is out of its domain, not finite, or of a missing segment 4; there is no angle;
        lengths cannot reach the tip; the rest posture is unstable; the path ends at a fold before
        `angle`, where the chain would jump; friction is combined with stops, or no joint can slip
        against the friction.

    Notes
    -----
    Accuracy: Newton's method to rounding at every angle, 1e-12 of the moments.  The path is the
    physical one: an arm may straighten and pass into the other elbow, and lower minima that a
    search over all postures finds are not visited.  Source: S. van Nes, The use of a rigid linkage
    balancer with torsion springs to realize nonlinear moment-angle characteristics, MSc thesis TU
    Delft 2022.074, eq. 4-17.  The thesis does not follow the path: it takes the lowest energy on a
    grid of postures (`tests.independent.balancer.grid`), and lets a released joint of three
    segments pass back through its stop.

    Examples
    --------
    >>> pose = solve(np.radians([30.0, 60.0, 90.0]), length1=0.3394, length2=0.4573,
    ...              length3=0.4752, stiffness1=1.2701, stiffness2=0.8473, stiffness3=4.1078,
    ...              rest_angle=0.6641)
    >>> pose["balancing_moment"].round(6).tolist()
    [0.494344, 0.872421, 1.027206]
    """
    given = {
        k: v
        for k, v in locals().items()
        if (k in OTHER_DEFAULTS or k.rstrip("1234") in NUMBERED_PARAMETERS)
        and not is_of_missing_segment(k, v, length3, length4)
    }
    check_finite(angle=angle, rate=rate, target_moment=target_moment)
    frictions = {
        "friction1": friction1,
        "friction2": friction2,
        "friction3": friction3,
        "friction4": friction4,
        "pendulum_friction": pendulum_friction,
    }
    chain = balancer(**given)
    check_friction(frictions, chain.segments)
    if (extension1 or extension2) and np.ndim(angle) == 2 and len(np.asarray(angle)) == 2:
        angle = np.asarray(angle)[0]
        rate = np.asarray(rate)[0] if np.ndim(rate) == 2 else rate
    alpha, w = np.broadcast_arrays(np.asarray(angle, float), np.asarray(rate, float))
    if not alpha.size:
        raise ValueError(f"angle must hold one angle or more [rad], got {alpha.shape}")
    if not (chain.reach(alpha.ravel()) > 0).all():
        raise ValueError("extension1, extension2: the pendulum must keep a positive length")
    free = found = follow_both_sides(chain, alpha.ravel())
    friction = np.array(list(frictions.values()))[: chain.segments]
    joint_friction = np.zeros((alpha.size, chain.segments))
    if friction.any():
        found, joint_friction = follow_with_friction(chain, friction, alpha.ravel())
    sense = motion_senses(w.ravel(), float(np.abs(w).max(initial=0.0)))
    bearing = pendulum_friction * sense
    values = quantities(chain, found, w.ravel(), joint_friction, bearing)
    if any(frictions.values()):
        values["frictionless_moment"] = quantities(chain, free, w.ravel())["holding_moment"]
    if target:
        values |= target_curves(
            chain, target, target_moment, alpha.ravel(), values["balancing_moment"]
        )
    if expected:
        turns = np.diff(free.rate[0], axis=-1, prepend=0.0)
        width = sense * (np.abs(turns) @ friction) + bearing
        curve = expected_of(expected, alpha.ravel())
        values |= {"expected_moment": curve, "expected_measurement": curve + width}
    return {name: value.reshape(alpha.shape) for name, value in values.items()}


def is_of_missing_segment(
    name: str, value: float | None, length3: float | None, length4: float | None
) -> bool:
    """Whether a parameter with its default is of segment 3 or 4, which the balancer has not."""
    missing = "3" * (length3 is None) + "4" * (length4 is None)
    return name[-1] in missing and value in (None, NUMBERED_DEFAULTS.get(name[:-1], 0.0))


def flexing(
    time: ArrayLike,
    *,
    extension1: float,
    extension2: float = 0.0,
    to: float = np.pi / 2,
    period: float = 2.0,
) -> tuple[Array, Array, Array]:
    """Motion profiles of a pendulum that leans and extends to and fro: angle [rad], extension [m].

    ::

        alpha = to (1 - cos(2 pi time/period))/2
        extension = extension1 alpha + extension2 alpha^2

    `time` [s] (n,), `extension1` [m/rad], `extension2` [m/rad^2], `to` [rad], `period` [s].
    Returns values and first and second time derivatives, each (2, n).

    >>> flexing([0.0, 1.0], extension1=0.1, to=1.5)[0].round(9).tolist()
    [[0.0, 1.5], [0.0, 0.15]]
    """
    w = 2.0 * np.pi / period
    turn = np.exp(1j * w * np.asarray(time, float))
    a, da, dda = to / 2 * (1.0 - turn.real), to / 2 * w * turn.imag, to / 2 * w**2 * turn.real
    slope = extension1 + 2.0 * extension2 * a
    return (
        np.stack([a, a * (extension1 + extension2 * a)]),
        np.stack([da, slope * da]),
        np.stack([dda, slope * dda + 2.0 * extension2 * da**2]),
    )


def check_friction(frictions: dict[str, float], joints: int) -> None:
    """Raise ValueError for a friction that is negative, not finite, or of a missing joint."""
    check_not_negative("N m", **frictions)
    if joints == 3 and frictions["friction4"]:
        raise ValueError("friction4 is of a joint that a balancer of three segments has not")
    if joints == 2 and any(value for name, value in frictions.items() if name[-1] in "1234"):
        raise ValueError(
            "friction1 to friction4 are covered for three segments and four; two segments turn "
            "with the pendulum as one body: give pendulum_friction"
        )


def follow_both_sides(chain: Balancer, alpha: Array) -> Path:
    """Find the path at angles of both signs; ValueError if it ends before them."""
    parts = []
    behind = alpha < 0 if (alpha > 0).any() else alpha <= 0
    for side in (behind, ~behind):
        if side.any():
            last = alpha[side][np.abs(alpha[side]).argmax()]
            to = float(last + np.copysign(PATH_MARGIN, last))
            parts.append((side, path_to(chain, to, alpha[side])))
    if len(parts) == 1:
        return parts[0][1]
    (behind, back), (before, forth) = parts
    merged = {}
    for name in ("theta", "deflection", "moment", "energy", "rate", "force", "side"):
        merged[name] = np.empty((1, alpha.size, getattr(back, name).shape[-1]))
        merged[name][:, behind], merged[name][:, before] = getattr(back, name), getattr(forth, name)
    return Path(alpha, **merged)


def target_curves(
    chain: Balancer, name: str, scale: float, alpha: Array, moment: Array
) -> dict[str, Array]:
    """Curves of the design target, its energy, and the residual moment."""
    target = target_for(chain, name)
    target_moment = scale * target(alpha)
    return {
        "target": target_moment,
        "residual": moment - target_moment,
        "target_energy": scale * target.height_energy(alpha),
    }


def quantities(
    chain: Balancer,
    path: Path,
    rate: Array,
    friction: Array | float = 0.0,
    bearing: Array | float = 0.0,
) -> dict[str, Array]:
    """Quantities of a path by name; `friction` and `bearing`: friction of joints and pendulum."""
    friction = np.broadcast_to(friction, path.rate[0].shape)
    weight = chain.weight[0]
    scale = weight * chain.reach(path.alpha)
    turn, s, c = path.rate[0], np.sin(path.alpha), np.cos(path.alpha)
    across, along_it = path.force[0].T
    found = {
        "balancing_moment": balancing_moment(chain, path)[0] + friction[:, 0],
        "holding_moment": path.moment[0, :, 0] + friction[:, 0] + bearing - scale * s,
        "energy": path.energy[0].sum(axis=-1) + scale * c,
        "extension_force": weight * c - along_it,
        "weight_energy": scale * c,
        "force_x": across * c + along_it * s,
        "force_y": along_it * c - across * s,
    }
    tip_force, theta = found["force_x"] + 1j * found["force_y"], path.theta[0]
    segments = chain.length * (np.sin(theta) + 1j * np.cos(theta))
    arms = np.cumsum(segments[:, ::-1], axis=-1)[:, ::-1]  # from each node to the tip
    deflection_rate = np.diff(turn, axis=-1, prepend=0.0)
    x = np.cumsum(chain.length * np.sin(path.theta[0]), axis=-1)
    y = np.cumsum(chain.length * np.cos(path.theta[0]), axis=-1)
    for i in range(1, chain.segments):
        found |= {f"node{i + 1}_x": x[:, i - 1], f"node{i + 1}_y": y[:, i - 1]}
    for i in range(chain.segments):
        found |= {
            f"theta{i + 1}": path.theta[0, :, i],
            f"deflection{i + 1}": path.deflection[0, :, i],
            f"theta{i + 1}_rate": turn[:, i] * rate,
            f"moment{i + 1}": path.moment[0, :, i],
            f"deflection{i + 1}_rate": deflection_rate[:, i] * rate,
            f"energy{i + 1}": path.energy[0, :, i],
            f"friction{i + 1}": friction[:, i],
            f"node{i + 1}_load": cross(arms[:, i], tip_force),
            **components_in_frame(f"node{i + 1}_force", tip_force, segments[:, i]),
        }
    return found


class BalancerReference(ChainParameters, ClosedForm, function=solve, properties=properties):
    """Torsion-spring balancer of a pendulum: a chain of two to four segments, stops, preloads."""

    method = "solver of the equilibria of a chain with springs"
    marks = (events,)
    profiles = (flexing,)

    low2: Annotated[float, Quantity("rad", Domain.EXTENDED)]
    low3: Annotated[float, Quantity("rad", Domain.EXTENDED)]
    low4: Annotated[float, Quantity("rad", Domain.EXTENDED)]
    high2: Annotated[float, Quantity("rad", Domain.EXTENDED)]
    high3: Annotated[float, Quantity("rad", Domain.EXTENDED)]
    high4: Annotated[float, Quantity("rad", Domain.EXTENDED)]
    extension1: Annotated[float, Quantity("m/rad")]
    extension2: Annotated[float, Quantity("m/rad^2")]
    friction1: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    friction2: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    friction3: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    friction4: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    pendulum_friction: Annotated[float, Quantity("N m", Domain.NOT_NEGATIVE)]
    target: Word
    target_moment: Annotated[float, Quantity("N m", moves=TARGET_CURVES)]
    expected: Word
