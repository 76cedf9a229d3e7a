"""Measures of how well a balancer meets its target: moment error, work reduction, energy spread.

The targets are moment-angle characteristics with the energies that they balance.  A summary for the
report gives a balancer's rest posture, the angles at which its stops switch, and warnings.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from proofmass.analytic.balancer.friction import follow_with_friction
from proofmass.analytic.balancer.model import Balancer, balancer
from proofmass.analytic.balancer.path import (
    BalancerPaths,
    Path,
    along,
    balancing_moment,
    follow,
)
from proofmass.base.arrays import Array

MomentCurve = Callable[[Array], Array]
# polynomial of the target laevo, from the thesis's program, line 4067; eq. 28 is rounded
LAEVO_COEFFICIENTS = (-0.2511, 1.343, -2.91, 2.824, -0.006501)
TAN_3PI_8 = np.tan(3.0 * np.pi / 8.0)
"""Factor 1 + sqrt(2) in eqs 26 and 27."""


@dataclass(frozen=True)
class Target:
    """A target: balancing moment M(angle) and height energy V(angle), with dV/dangle = -M.

    In a balancer that meets the target, the sum of spring energy and V is constant. A call returns
    M. Both are for m g r = 1 N m; V is determined up to a constant.
    """

    name: str
    moment: MomentCurve
    height_energy: MomentCurve

    def __call__(self, angle: ArrayLike) -> Array:
        """The moment [1] over m g r at pendulum angles [rad]."""
        return self.moment(np.asarray(angle, float))


def target(name: str, angle: ArrayLike) -> Array:
    r"""Moment [N m] of a named target at a pendulum angle [rad] (...), for m g r = 1 N m.

    ::

        sine                    sin a                                        eq. 24
        progressive             1 - cos a                                        25
        progressive-degressive  1/2 + 4/(3 pi) atan(tan(3 pi/8) (4 a/pi - 1))    26
        degressive-progressive  1/2 + 1/2 tan(3/2 (a - pi/4))/tan(3 pi/8)        27
        laevo                   -0.2511 a^4 + 1.343 a^3 - 2.91 a^2 + 2.824 a - 0.006501    28
        sine180                 sin 2a, 180 degrees of a sine in 90 of the pendulum        29
        square-root             sqrt a                                     "sqrt", line 4079
        quadratic               a^2                                   "quadratic", line 4084
        hardening-softening     1/2 + 1/2 sin(2a - pi/2)      "hardening-softening", line 4089
        softening-hardening     1/2 + 1/2 tan(a - pi/4)       "softening-hardening", line 4100

    All are meant for 0 to pi/2, where the first six lie within [-0.0065, 1]; the fourth has poles
    at -pi/12 and 7 pi/12, and laevo, a fit to an exoskeleton's spring, is not zero at zero.  The
    last four are only in the thesis's programs, under the names given on the right; the thesis has
    no tables for them.  square-root ends at 1.253 and quadratic at 2.467; square-root starts with
    an infinite slope and is not defined below zero.

    ValueError for a name that is not in `TARGETS`. Accuracy: rounding. Source: van Nes 2022 (S. van
    Nes, The use of a rigid linkage balancer with torsion springs to realize nonlinear moment-angle
    characteristics, MSc thesis TU Delft 2022.074), eqs 24-29, lines 794-806. Eq. 28 prints two
    decimals; its tables were made with the coefficients of the program, line 4067, as here.

    >>> [round(float(target(name, np.pi / 4)), 4) for name in TARGETS]
    [0.7071, 0.2929, 0.5, 0.5, 0.9715, 1.0, 0.8862, 0.6169, 0.5, 0.5]
    """
    if name not in TARGETS:
        raise ValueError(f"target must be one of {', '.join(TARGETS)}, got {name!r}")
    return TARGETS[name](angle)


def target_for(b: Balancer, name: str) -> Target:
    """Find a target by name; `weight` is the moment of a mass on the pendulum of `b`, extended.

    ::

        weight    M = (r sin a - dr/da cos a)/r0,    V = r cos a/r0,    r = r(a), r0 = r(0)

    Without extension this is the sine.  ValueError for any other name that is not in `TARGETS`.
    """
    if name != "weight":
        target(name, 0.0)
        return TARGETS[name]
    return weight_target(
        float(b.extension1[0] / b.pendulum[0]), float(b.extension2[0] / b.pendulum[0])
    )


def weight_target(extension1: float, extension2: float) -> Target:
    """Target `weight` of a pendulum with r/r0 = 1 + extension1 a + extension2 a^2.

    `extension1` is in [1/rad], `extension2` in [1/rad^2].

    >>> float(weight_target(0.1, 0.0)(np.pi / 2).round(6))
    1.15708
    """

    def reach(a: Array) -> Array:
        return 1.0 + a * (extension1 + a * extension2)

    return Target(
        "weight",
        lambda a: reach(a) * np.sin(a) - (extension1 + 2.0 * a * extension2) * np.cos(a),
        lambda a: reach(a) * np.cos(a),
    )


# van Nes 2022, listing N.2: polynomial of degree 5 of the angle in degrees, highest power first
# [N m]; with the first coefficient as printed, 4.4283e-10, the moment at 90 degrees would be 2.41
EXPECTED = {
    "van Nes N.2": (4.4283e-11, -8.2536e-09, 4.8168e-07, -1.4378e-05, 0.0011225, -0.00029428)
}


def expected(name: str, angle: ArrayLike) -> Array:
    r"""Moment [N m] with which a measurement was compared, at a pendulum angle [rad] (...).

    ``van Nes N.2`` is the fit to the model of the prototype with its springs as measured::

        4.4283e-11 x^5 - 8.2536e-9 x^4 + 4.8168e-7 x^3 - 1.4378e-5 x^2 + 1.1225e-3 x - 2.9428e-4

    with x in degrees, from 0 to 90. ValueError for a name that is not in `EXPECTED`. Source: van
    Nes 2022, listing N.2, lines 2298 and 2303, where the first coefficient is printed ten times too
    large.

    >>> round(float(expected("van Nes N.2", np.pi / 3)), 5)
    0.04681
    """
    if name not in EXPECTED:
        raise ValueError(f"expected must be one of {', '.join(EXPECTED)}, got {name!r}")
    return np.asarray(np.polyval(EXPECTED[name], np.degrees(np.asarray(angle, float))))


def target_from_table(angles: ArrayLike, moments: ArrayLike, name: str = "table") -> Target:
    """Make a target from a table by a cubic interpolation that is monotone where the table is.

    Parameters
    ----------
    angles : pendulum angles [rad] (n,), rising strictly, n >= 2
    moments : moments over m g r at these angles [1] (n,)
    name : name of the target in messages

    Returns
    -------
    Target : with a continuous slope; its energy is zero at the first angle

    Raises
    ------
    ValueError
        The columns have different sizes, or fewer than 2 rows; a value is not finite; angles do
        not rise; or the target is called outside the table.

    Notes
    -----
    Piecewise cubic Hermite interpolation (Fritsch and Carlson, SIAM J. Numer. Anal. 17, 1980).
    Error O(h^3) in the distance h of the samples, O(h^2) next to an extreme.

    Examples
    --------
    >>> wanted = target_from_table([0.0, 0.5, 1.5], [0.0, 1.0, 1.0])
    >>> float(wanted(1.2))
    1.0
    """
    x, y = (np.asarray(column, float) for column in (angles, moments))
    _check_table(name, x, y)
    cubic = PchipInterpolator(x, y, extrapolate=False)
    integral = cubic.antiderivative()

    def inside(curve: MomentCurve) -> MomentCurve:
        def within(angle: Array) -> Array:
            bad = ~((angle >= x[0]) & (angle <= x[-1]))
            if bad.any():
                raise ValueError(
                    f"{name}: angle {angle[bad].flat[0]:.6g} rad is outside its range "
                    f"{x[0]:.6g} to {x[-1]:.6g} rad"
                )
            return curve(angle)

        return within

    return Target(name, inside(cubic), inside(lambda angle: -integral(angle)))


def _check_table(name: str, x: Array, y: Array) -> None:
    if x.ndim != 1 or x.shape != y.shape or x.size < 2:
        raise ValueError(
            f"{name}: angles and moments must be two columns of one size, at least 2, "
            f"got {x.shape} and {y.shape}"
        )
    for column, values in (("angles", x), ("moments", y)):
        for row in np.flatnonzero(~np.isfinite(values)):
            raise ValueError(f"{name}: {column} must be finite, row {row} is {values[row]}")
    for row in np.flatnonzero(np.diff(x) <= 0.0):
        raise ValueError(
            f"{name}: angles must rise strictly, row {row + 1} is {x[row + 1]:.6g} rad"
            f" after {x[row]:.6g} rad"
        )


def _progressive_degressive(angle: Array) -> Array:
    return 0.5 + 4.0 / (3.0 * np.pi) * np.arctan(TAN_3PI_8 * (4.0 * angle / np.pi - 1.0))


def _progressive_degressive_energy(angle: Array) -> Array:
    u = TAN_3PI_8 * (4.0 * angle / np.pi - 1.0)
    return -0.5 * angle - (u * np.arctan(u) - 0.5 * np.log1p(u * u)) / (3.0 * TAN_3PI_8)


def _degressive_progressive(angle: Array) -> Array:
    return 0.5 + 0.5 * np.tan(1.5 * (angle - np.pi / 4.0)) / TAN_3PI_8


def _degressive_progressive_energy(angle: Array) -> Array:
    return -0.5 * angle + np.log(np.cos(1.5 * (angle - np.pi / 4.0))) / (3.0 * TAN_3PI_8)


def _hardening_softening_energy(angle: Array) -> Array:
    return 0.25 * np.sin(2.0 * angle) - 0.5 * angle


def _softening_hardening(angle: Array) -> Array:
    return 0.5 + 0.5 * np.tan(angle - np.pi / 4.0)


def _softening_hardening_energy(angle: Array) -> Array:
    return 0.5 * np.log(np.cos(angle - np.pi / 4.0)) - 0.5 * angle


TARGETS = {
    each.name: each
    for each in (
        Target("sine", np.sin, np.cos),
        Target("progressive", lambda a: 1.0 - np.cos(a), lambda a: np.sin(a) - a),
        Target("progressive-degressive", _progressive_degressive, _progressive_degressive_energy),
        Target("degressive-progressive", _degressive_progressive, _degressive_progressive_energy),
        Target(
            "laevo",
            np.poly1d(LAEVO_COEFFICIENTS),
            lambda a: 1.0 - np.polyint(np.poly1d(LAEVO_COEFFICIENTS))(a),
        ),
        Target("sine180", lambda a: np.sin(2.0 * a), lambda a: 0.5 * np.cos(2.0 * a)),
        Target("square-root", np.sqrt, lambda a: -2.0 / 3.0 * a**1.5),
        Target("quadratic", np.square, lambda a: -(a**3) / 3.0),
        Target("hardening-softening", lambda a: np.sin(a) ** 2, _hardening_softening_energy),
        Target("softening-hardening", _softening_hardening, _softening_hardening_energy),
    )
}


def precision_points(count: int) -> Array:
    """Pendulum angles j pi/(2 count) [rad], j = 1 .. count, at which targets are compared.

    Van Nes 2022, lines 735-772: 90 for three segments, 15 for four.

    >>> np.degrees(precision_points(3)).round(9)
    array([30., 60., 90.])
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, got {count}")
    return 0.5 * np.pi * np.arange(1, count + 1) / count


def rmse(moment: ArrayLike, target: ArrayLike, *, scale: ArrayLike = 1.0) -> Array:
    """Root mean square of moment - target over the last axis, in units of `scale` = m g r [N m].

    Van Nes 2022, eq. 18. `moment` and `target` [N m] broadcast, (..., points); returns (...).

    >>> float(rmse([1.0, 2.0], [1.0, 4.0], scale=2.0).round(9))
    0.707106781
    """
    error = np.asarray(moment, float) - np.asarray(target, float)
    return np.sqrt(np.mean(error**2, axis=-1)) / scale


def work_reduction(moment: ArrayLike, reference: ArrayLike, angle: ArrayLike) -> Array:
    r"""Reduction [%] of the work against a moment `reference` that is balanced by `moment`.

    ::

        100 (1 - integral |moment - reference| dangle / integral reference dangle)

    The number has a meaning only together with its reference: the same balancer has different
    numbers against the sine and against its own model (see `prototype.REDUCTIONS`).

    Parameters
    ----------
    moment, reference : balancing moment, and the moment to be balanced [N m], (..., points)
    angle : pendulum angle [rad] (points,), rising

    Returns
    -------
    (...) [%], 100 for a perfect balancer, negative for one that increases the work

    Raises
    ------
    ValueError
        The reference does no work over these angles.

    Notes
    -----
    Trapezoidal rule on the given points, as in van Nes 2022, eq. 34 and line 4119.  The points of
    the thesis leave out angle 0, which changes its results by less than 0.02 percentage points.

    Examples
    --------
    >>> angle = precision_points(90)
    >>> round(float(work_reduction(0.9 * np.sin(angle), np.sin(angle), angle)), 9)
    90.0
    """
    given, wanted, a = (np.asarray(curve, float) for curve in (moment, reference, angle))
    work = np.trapezoid(wanted, a, axis=-1)
    if not np.all(work > 0.0):
        raise ValueError(f"reference must do positive work over angle, got {np.min(work):.6g} J")
    return np.asarray(100.0 * (1.0 - np.trapezoid(np.abs(given - wanted), a, axis=-1) / work))


def energy_spread(*energies: ArrayLike, scale: ArrayLike = 1.0) -> Array:
    r"""Spread of the energy between the springs: mean of their differences over the points.

    ::

        f2 = mean_j sqrt(sum over pairs (V_a - V_b)^2)/(m g r) = mean_j sqrt(n) |V - mean V|/(m g r)

    Parameters
    ----------
    energies : energy of each of the n springs [J], each (..., points)
    scale : m g r [N m]

    Returns
    -------
    (...) [1]; zero if all springs have the same energy

    Notes
    -----
    Van Nes 2022, eqs 19-22 and line 4117, with three springs. The sum over the pairs of n springs
    is computed by the identity on the right.

    Examples
    --------
    >>> round(float(energy_spread([1.0], [2.0], [4.0])), 9) == round(14**0.5, 9)
    True
    """
    springs = np.stack(np.broadcast_arrays(*(np.asarray(v, float) for v in energies)))
    square = len(springs) * np.sum((springs - springs.mean(axis=0)) ** 2, axis=0)
    return np.mean(np.sqrt(square), axis=-1) / scale


MAX_SPRING_DEFLECTION = np.pi / 2
"""Largest deflection of a clock spring between simple stops [rad]."""
NEARLY_STRAIGHT_ANGLE = 0.05
"""Angle below which an arm is nearly straight [rad]: length errors grow twentyfold."""
ANGLE_STEP = np.radians(0.25)
"""Distance of the pendulum angles that are examined [rad]."""


def warnings(to: float = np.pi / 2, **parameters: float) -> list[str]:
    """Warnings about a balancer that its moment curve alone does not show.

    Parameters
    ----------
    to : float
        Last pendulum angle [rad].
    **parameters
        Parameters of `proofmass.analytic.balancer.solve` [SI].

    Returns
    -------
    list of str
        Empty for a regular balancer.  Otherwise some of: an unstable rest posture; a fold, where
        the chain jumps; an arm that straightens and passes into the other elbow (where a search
        over one elbow only finds the straight arm), or that becomes nearly straight; a joint that
        never leaves its preload, or never touches its stop; a spring wound past its range or past
        its largest moment.

    Examples
    --------
    >>> warnings(length1=0.3382, length2=0.5, length3=0.5, rest_angle=0.0152, stiffness1=0.5152,
    ...       stiffness2=1.5643, stiffness3=2.5515, preload2=0.944, low2=0.0)
    ['joint 2 never leaves its preload: M1 = k1 alpha as far as it is locked']
    """
    b, paths = follow_cached(tuple(parameters.items()), to)
    found = [paths.why[0]] if paths.why[0] else []
    if paths.reach[0] == 0.0:
        return found
    path = along(
        b, paths, np.linspace(0.0, paths.reach[0], int(abs(paths.reach[0]) / ANGLE_STEP) + 2)
    )
    return [
        *found,
        *warn_of_straight_arm(path),
        *warn_of_unused_stops(b, path, paths),
        *warn_of_overwound_springs(path, b.stiffness[0], b.quadratic[0]),
    ]


def warn_of_straight_arm(path: Path) -> list[str]:
    """Warn if the last two segments come in line, or nearly so."""
    n = path.theta.shape[-1]
    bend = np.sin(path.theta[0, :, -1] - path.theta[0, :, -2])
    least = int(np.abs(bend).argmin())
    crossed = np.flatnonzero(np.diff(np.sign(bend)) != 0)
    if crossed.size:
        angle = np.degrees(path.alpha[crossed[0] + 1])
        return [
            f"segments {n - 1} and {n} straighten at {angle:.1f} deg and pass into the other elbow"
        ]
    if abs(bend[least]) < NEARLY_STRAIGHT_ANGLE:
        return [
            f"segments {n - 1} and {n} are straight but for {abs(bend[least]):.3f} rad at "
            f"{np.degrees(path.alpha[least]):.1f} deg: nearly singular"
        ]
    return []


def warn_of_unused_stops(b: Balancer, path: Path, paths: BalancerPaths) -> list[str]:
    """Warn of stops that are never left, or never met."""
    low, high, stop_moments = b.low[0], b.high[0], paths.pieces.end.unknowns[-1, b.segments + 2 :]
    moment_of_joint = dict(zip(b.stopped, np.abs(stop_moments), strict=True))
    left_stops = {joint for _, joint, _, side in paths.switches if side == 0}
    met_stops = {joint for _, joint, _, side in paths.switches if side > 0}
    found = []
    for k in range(len(low)):
        if (
            (low[k] == 0.0 or high[k] == 0.0)
            and k + 1 not in left_stops
            and path.side[0, :, k].all()
        ):
            pressed = bool(moment_of_joint[k] >= np.abs(b.preload[0, k]))
            found.append(
                f"joint {k + 1} never leaves its preload: M1 = k1 alpha as far as it is locked"
                + pressed * ", and the load presses it onto its stop all the more"
            )
        if np.isfinite(high[k]) and high[k] > 0 and k + 1 not in met_stops:
            found.append(f"joint {k + 1} never touches its stop at {high[k]:g} rad")
    return found


def warn_of_overwound_springs(path: Path, stiffness: Array, quadratic: Array) -> list[str]:
    """Warn of springs wound past their range, or past their largest moment."""
    found = []
    for k in range(len(stiffness)):
        spring_deflection = path.deflection[0, :, k]
        if np.abs(spring_deflection).max() > MAX_SPRING_DEFLECTION * (1 + 1e-9) and k:
            found.append(
                f"spring {k + 1} is wound by {np.abs(spring_deflection).max():.2f} rad, more "
                f"than a quarter turn"
            )
        if (stiffness[k] + 2 * quadratic[k] * spring_deflection < 0).any():
            angle = np.degrees(
                path.alpha[(stiffness[k] + 2 * quadratic[k] * spring_deflection < 0).argmax()]
            )
            found.append(f"spring {k + 1} is past its largest moment from {angle:.1f} deg on")
    return found


RIGHT_ANGLE = np.pi / 2
"""Last pendulum angle of events and properties [rad]."""


def chain_of(parameters: dict[str, Any]) -> Balancer:
    """Make the balancer of parameters, without its target and friction."""
    return balancer(**without_friction(parameters))


ParameterItems = tuple[tuple[str, float], ...]


@lru_cache(8)
def follow_cached(parameters: ParameterItems, to: float) -> tuple[Balancer, BalancerPaths]:
    """Make the balancer of some parameters, and follow its path to an angle; cached."""
    b = balancer(**dict(parameters))
    return b, follow(b, to)


def follow_without_friction(
    parameters: dict[str, Any], to: float = RIGHT_ANGLE
) -> tuple[Balancer, BalancerPaths]:
    """Make the balancer as `chain_of` does, and follow its path to an angle."""
    return follow_cached(tuple(without_friction(parameters).items()), to)


def without_friction(parameters: dict[str, Any]) -> dict[str, Any]:
    """Leave out the parameters of target, expected curve and friction."""
    return {
        key: value
        for key, value in parameters.items()
        if not (key.startswith("target") or key == "expected" or "friction" in key)
    }


def events(**parameters: Any) -> dict[str, float]:
    """Pendulum angles [rad] up to 90 degrees at which a joint leaves or meets a stop, by name.

    >>> found = events(length1=0.4764, length2=0.4975, length3=0.4986, stiffness1=0.9341,
    ...               stiffness2=0.1211, stiffness3=0.0927, preload2=0.3983, low2=0.0)
    >>> {name: round(float(np.degrees(angle)), 4) for name, angle in found.items()}
    {'joint 2 released': 46.6595}
    """
    _, paths = follow_without_friction(parameters)
    words = {0: "released", -1: "back on its stop", 1: "on its stop"}
    return {f"joint {joint} {words[side]}": angle for _, joint, angle, side in paths.switches}


def properties(**parameters: Any) -> dict[str, str]:
    """Describe a balancer for the report's page: posture, events, measures and warnings.

    With a `target` the measures of how well it is met are included, at the precision points of van
    Nes 2022: 90 for three segments, 15 for four, without angle 0.

    >>> properties(length1=0.3394, length2=0.4573, length3=0.4752, stiffness1=1.2701,
    ...       stiffness2=0.8473, stiffness3=4.1078, rest_angle=0.6641,
    ...       target="sine")["work reduction"]
    '99.30 % against the sine'
    """
    b, paths = follow_without_friction(parameters)
    found = {
        "rest posture": ", ".join(f"{np.degrees(a):.1f}°" for a in b.rest[0])
        + " from the upright, clockwise"
    }
    found |= {name: f"{np.degrees(angle):.2f}°" for name, angle in events(**parameters).items()}
    if not paths.why[0]:
        found |= describe_measures(
            *follow_without_friction(parameters, RIGHT_ANGLE + 1e-9),
            str(parameters.get("target", "")),
            float(parameters.get("target_moment", 1.0)),
        )
    if "expected" in parameters:
        found |= compare_friction_loop(b, parameters)
    found_warnings = warnings(**without_friction(parameters))
    return found | ({"mind": "; ".join(found_warnings)} if found_warnings else {})


def compare_friction_loop(b: Balancer, parameters: dict[str, Any]) -> dict[str, str]:
    """Compare the friction's hysteresis loop with the expected measurement, as in listing N.2."""
    way = np.radians(np.linspace(0.0, 90.0, 181))
    # two cycles, of which the second one is a closed loop
    angle = np.concatenate([way, way[-2::-1], way[1:], way[-2::-1]])
    friction = np.array([float(parameters.get(f"friction{i + 1}", 0.0)) for i in range(b.segments)])
    if friction.any():
        path, rub = follow_with_friction(b, friction, angle)
    else:
        paths = follow_without_friction(parameters, RIGHT_ANGLE + 1e-9)[1]
        if paths.why[0]:
            return {}
        path, rub = along(b, paths, angle), np.zeros((angle.size, b.segments))
    bearing = float(parameters.get("pendulum_friction", 0.0))
    moment = (path.moment[0, :, 0] + rub[:, 0])[360:]
    forward, backward = moment[:181] + bearing, moment[:179:-1] - bearing
    wanted = expected(str(parameters["expected"]), angle[360:])
    residual = np.abs(forward - wanted[:181]) + np.abs(backward - wanted[:179:-1])
    work, friction_work = np.trapezoid(residual, way), np.trapezoid(forward - backward, way)
    reference = 2.0 * np.trapezoid(wanted[:181], way)
    return {
        "work reduction of the loop": f"{100.0 * (1.0 - work / reference):.2f} % against "
        f"{parameters['expected']}",
        "lost in a cycle": f"{1000.0 * friction_work:.2f} mJ by friction",
    }


def joints_without_springs(b: Balancer) -> list[int]:
    """Numbers of the joints, from 1, whose springs have no moment at any deflection.

    >>> chain = {"length1": 0.5, "length2": 0.3, "length3": 0.4}
    >>> chain |= {"stiffness1": 1.0, "stiffness2": 0.0, "stiffness3": 2.0}
    >>> joints_without_springs(chain_of(chain))
    [2]
    """
    moments = np.abs(b.stiffness) + np.abs(b.quadratic) + np.abs(b.preload)
    return (np.flatnonzero(moments[0] == 0.0) + 1).tolist()


def describe_measures(
    b: Balancer, paths: BalancerPaths, target: str, scale: float
) -> dict[str, str]:
    """Describe the largest deflections, and the measures of how a target is met."""
    angle = precision_points(15 if b.segments == 4 else 90)
    path = along(b, paths, angle)
    moment, energy = balancing_moment(b, path)[0], path.energy[0]
    largest_deflections = np.degrees(np.abs(path.deflection[0]).max(axis=0))
    found = {"springs wound by": ", ".join(f"{w:.0f}°" for w in largest_deflections) + " at most"}
    if free := joints_without_springs(b):
        found["no spring needed"] = " and ".join(f"joint {joint}" for joint in free)
    if target:
        wanted = scale * target_for(b, target)(angle)
        found |= {
            "error": f"{float(rmse(moment, wanted, scale=scale)):.5f} m g r, root mean square at "
            f"{angle.size} angles",
            "work reduction": f"{float(work_reduction(moment, wanted, angle)):.2f} % against the "
            f"{target}",
            "energy spread": f"{float(energy_spread(*energy.T, scale=scale)):.3f} m g r between "
            f"springs",
        }
    return found
