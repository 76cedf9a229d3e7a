r"""What theory states of MuJoCo: orders of convergence, limits of stability, and test problems.

**Orders.** Let h be the step, tau the time constant (`solref`) of the spring and damper that close
a loop, 1 - d the share of the open loop's acceleration that the constraint lets through (`solimp`),
and j the order of the time derivative: 0 of positions, 1 of rates, 2 of accelerations.  Errors are
proportional to

    integrator, no loop             RK4: h^4; MuJoCo's others are semi-implicit: h.  From rest these
                                    are a leapfrog that is half a step early, with rates h^2
    softness of a loop              (1 - d) tau^2; after a jolt (1 - d) tau^(2-j) as well
    semi-implicit in a loop         with kappa = J' v in q'' = - b q' - k q - kappa, b = 2/tau and
                                    k = 1/tau^2, it settles with the error h tau kappa, its rate
                                    with h kappa / 2; accelerations: h, h tau; after a jolt
                                    h tau^(1-j) as well, which decays as exp(-t / tau)
    RK4 in a loop                   (h / tau)^4 tau^(2-j), in addition to the softness

A recorded reference is not evaluated at the actual state of the drives, so that a comparison with
it includes the error of the integrator without a loop.

A jolt is a start under load or in motion, from loops that are neither strained nor moving.

**Stability.** MuJoCo's integrators step a spring and a damper stably within these limits of
z = dt omega, with the damping ratio zeta::

    Euler, implicit, implicitfast         stable for z up to 2 (zeta + sqrt(1 + zeta^2))
    the same without implicit damping     2 (sqrt(1 + zeta^2) - zeta)
    discrete, implicit in the spring too  no limit
    RK4                                   |1 + w + w^2/2 + w^3/6 + w^4/24| = 1,
                                          w = z (-zeta + i sqrt(1 - zeta^2))

E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, 2nd ed., ch. I; E. Hairer,
G. Wanner, Solving Ordinary Differential Equations II, sec. IV.2, for RK4.
"""

from collections.abc import Iterator
from math import inf

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.mujoco.tried_settings import has_soft_constraints, may_rebound
from proofmass.sim.problem_models import start_key, wheel_model
from proofmass.sim.protocol.settings import ParameterValue, ParameterValues
from proofmass.sim.protocol.theory import LimitProblem, Scheme, StepMap, Stepping, Theory
from proofmass.sim.protocol.tuning import Scan, Studied


def euler_map(z: float, zeta: float) -> Array:
    """Step map of Euler: the new velocity, with the damping at its end, moves the position."""
    divisor = 1.0 + 2.0 * zeta * z
    return np.array([[1.0 - z**2 / divisor, 1.0 / divisor], [-(z**2) / divisor, 1.0 / divisor]])


def explicit_euler_map(z: float, zeta: float) -> Array:
    """Step map of Euler with the damper's force at the beginning of the step."""
    factor = 1.0 - 2.0 * zeta * z
    return np.array([[1.0 - z**2, factor], [-(z**2), factor]])


def discrete_map(z: float, zeta: float) -> Array:
    """Step map with the forces of spring and damper at the end of the step."""
    divisor = 1.0 + 2.0 * zeta * z + z**2
    return np.array([[1.0 - z**2 / divisor, 1.0 / divisor], [-(z**2) / divisor, 1.0 / divisor]])


def rk4_map(z: float, zeta: float) -> Array:
    """Step map of RK4: the exponential series of the system's matrix up to the fourth power."""
    step = np.array([[0.0, 1.0], [-(z**2), -2.0 * zeta * z]])
    a, power = np.eye(2), np.eye(2)
    for k in (1, 2, 3, 4):
        power = power @ step / k
        a = a + power
    return a


LIMIT_FORMULAS: dict[StepMap, str] = {  # formulas of the largest stable dt omega
    euler_map: "2 (ζ + √(1 + ζ²))",
    explicit_euler_map: "2 (√(1 + ζ²) − ζ)",
    rk4_map: "|R(z (−ζ + i √(1 − ζ²)))| = 1",
    discrete_map: "implicit in the spring as well",
}
SINGLE_VALUE = (0.0,)


def make_scheme(name: str, step: StepMap, **tried: tuple[float, ...]) -> Scheme:
    """The scheme of an integrator; all but discrete conserve energy."""
    return Scheme(
        name,
        step,
        LIMIT_FORMULAS[step],
        {"integrator": name},
        step is not discrete_map,
        tried=tried,
    )


SCHEMES = (
    make_scheme(
        "Euler",
        euler_map,
        spring=(0.0, 0.3, 1.0),
        slide=SINGLE_VALUE,
        chain=(20, 200),
        pendulum=SINGLE_VALUE,
        swing=(0.05,),
        fade=(0.05,),
    ),
    make_scheme("implicit", euler_map, spring=SINGLE_VALUE),
    make_scheme(
        "implicitfast", euler_map, spring=(0.0, 0.3, 1.0), whirl=SINGLE_VALUE, swing=(0.05,)
    ),
    make_scheme(
        "RK4",
        rk4_map,
        spring=(0.0, 0.3, 1.0),
        slide=SINGLE_VALUE,
        chain=(20,),
        pendulum=SINGLE_VALUE,
        whirl=SINGLE_VALUE,
        swing=(0.3,),
        fade=(0.3,),
    ),
    make_scheme("discrete", discrete_map, spring=(0.0, 0.3)),
)


class MujocoTheory(Theory):
    """Orders, stability limits and test problems of MuJoCo."""

    schemes = SCHEMES

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """Orders of convergence that errors of a derivative may show in a scan."""
        first = scan.settings[0]
        if scan.varied == "solimp":
            return (1.0,)
        if scan.varied == "solref":  # below two steps the spring itself is not resolved
            return () if first.get("refsafe") is False else softness_orders(about, derivative)
        return step_orders(scan, derivative, about) if scan.varied == "timestep" else ()

    def scheme_of(self, parameters: ParameterValues, model: mujoco.MjModel) -> Scheme:
        """The scheme of a run: that of its integrator."""
        own = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
        name = str(parameters.get("integrator", own))
        return next(one for one in SCHEMES if one.name.lower() == name.lower())

    def limit_problems(
        self,
    ) -> Iterator[LimitProblem]:
        """Springs with explicit damping, velocity servos, soft loops and flat cylinders."""
        for zeta in (0.3, 1.0):
            text = wheel_model(1.0, 2.0 * zeta, flags='eulerdamp="disable"')
            yield LimitProblem(
                f"spring on a hinge, ζ = {zeta:g}, explicit damping",
                "Euler",
                "dt ω",
                LIMIT_FORMULAS[explicit_euler_map],
                spring_stepping(text),
                explicit_euler_map,
                zeta,
                reach=100.0,
            )
        yield from servo_problems()
        yield from loop_problems()
        yield cylinder_problem()


def step_orders(scan: Scan, j: int, about: Studied) -> tuple[float, ...]:
    """Orders of convergence that errors of derivative j may show in a scan over the step."""
    is_rk4 = scan.settings[0]["integrator"] == "RK4"
    own = (1.0, 2.0) if j == 1 and not about.held_to_drive else (1.0,)
    if is_rk4:  # a changing control is constant over all stages of a step
        own = (2.0, 4.0) if about.controlled else (4.0,)
    scaled = len({each.get("solref") for each in scan.settings}) > 1
    if not (has_soft_constraints(about) and scaled):
        return own
    if is_rk4:
        return tuple(dict.fromkeys((2.0 - j, 2.0)))
    held = {0: (2.0,), 1: (1.0,), 2: (1.0, 2.0, *([0.0] * about.jolted()))}[j]
    return held if about.held_to_drive else (*own, *softness_orders(about, j))


def softness_orders(about: Studied, j: int) -> tuple[float, ...]:
    """Orders in the time constant of loops or limits; impacts last in proportion to the latter."""
    if may_rebound(about):
        return (1.0, 2.0)
    return tuple(dict.fromkeys((2.0 - j, 2.0))) if about.jolted() else (2.0,)


def spring_stepping(text: str) -> Stepping:
    """A model in Euler's method with a step that is varied; the coordinate's value is watched."""
    return lambda step: (text, step, {"integrator": "Euler"}, "place")


def servo_problems() -> Iterator[LimitProblem]:
    """A velocity servo, which is an explicit damper unless the integrator is implicit in it."""
    text = wheel_model(
        rest='<actuator><velocity joint="joint" kv="1"/></actuator>' + start_key("0", "0.001")
    )

    def served(name: str) -> Stepping:
        return lambda step: (text, step, {"integrator": name}, "rate")

    for one in SCHEMES:
        what = "velocity servo", one.name, "dt kv/I"
        if one.name == "Euler":
            yield LimitProblem(*what, "|1 − z| = 1", served(one.name), theory=2.0)
        elif one.step is rk4_map:  # its eigenvalue is negative and real, as with critical damping
            yield LimitProblem(*what, "|R(−z)| = 1", served(one.name), rk4_map, 1.0)
        else:
            yield LimitProblem(*what, "implicit in the velocity", served(one.name), theory=inf)


def loop_problems() -> Iterator[LimitProblem]:
    """Soft loops, each an explicit spring with critical damping and omega = 1 / time constant."""
    for name, step in (
        ("Euler", explicit_euler_map),
        ("implicitfast", explicit_euler_map),
        ("RK4", rk4_map),
        ("discrete", discrete_map),
    ):
        yield LimitProblem(
            "loop with refsafe off",
            name,
            "dt/solref",
            LIMIT_FORMULAS[step] + ", ζ = 1",
            loop_stepping('refsafe="disable"', name),
            step,
            1.0,
        )
    yield LimitProblem(
        "loop with refsafe on",
        "Euler",
        "dt/solref",
        "solref is kept to 2 dt",
        loop_stepping("", "Euler"),
        theory=inf,
    )


def loop_stepping(flags: str, name: str) -> Stepping:
    """A slide that an equality constrains against its weight, with a step of 1 s."""
    text = wheel_model(
        kind="slide",
        gravity="1e-3 0 0",
        flags=flags,
        rest='<equality><joint joint1="joint" solimp="0.9 0.9 0.001"/></equality>',
    )

    def stepped(ratio: float) -> tuple[str, float, dict[str, ParameterValue], str]:
        return text, 1.0, {"integrator": name, "solref": (1.0 / ratio, 1.0)}, "place"

    return stepped


CYLINDER_RADIUS, HALF_HEIGHT, CYLINDER_CLEARANCE = 0.041, 0.002, 2.1e-5
"""Radius and half the height of a flat cylinder, and its height above the floor [m]."""
TWO_ULPS = 2 * float(np.finfo(float).eps)
"""Largest error of the squared length of a rotated axis that was observed [1]."""
CYLINDER_COUNT = 400
"""Number of cylinders, each rotated differently: five axes have the error `TWO_ULPS`, 81 half."""


def cylinder_problem() -> LimitProblem:
    """Cylinders at rest above a floor, without weight, so that no force should act on them.

    MuJoCo finds the lowest point of the edge at the radius r from the centre of a face, in the
    direction of (n . a) a - n, with the axis a of the cylinder and the normal n of the floor::

             a
         ____|____         that vector is as long as the tilt, and lies in the face, but for a
        |____|____|        component d along a, which is a rounding error: the point is
             |                 r d / sqrt(tilt^2 + d^2)
        _____n_____        too deep, by up to the radius

    `docs/contacts.md` has depths and energies of single poses.
    """
    theory = 1.0 / np.sqrt(1.0 - (CYLINDER_CLEARANCE / CYLINDER_RADIUS) ** 2)
    return LimitProblem(
        f"flat cylinders, {1e3 * CYLINDER_CLEARANCE:g} mm above a floor",
        "Euler",
        "r d/(gap tilt)",
        f"r d / √(tilt² + d²) = gap, d = {TWO_ULPS:.2g}; tilt {tilt_for_share(theory):.2g} rad",
        lambda share: hanging_cylinders(tilt_for_share(share)),
        theory=float(theory),
        start=0.01,
        reach=100.0,
        bound=1e-12,
    )


def tilt_for_share(share: float) -> float:
    """The tilt [rad] at which rounding puts the lowest point `share` times the gap too deep."""
    return float(CYLINDER_RADIUS * TWO_ULPS / (CYLINDER_CLEARANCE * share))


def tilted_quaternion(tilt: float, turn: float, direction: float) -> Array:
    """The quaternion [1] of a body that is rotated by `turn` about the vertical, and then tilted.

    The `tilt` is small, and its horizontal axis is at the angle `direction` [all rad].
    """
    found = np.zeros(4)
    lean = np.array([1.0, 0.5 * tilt * np.cos(direction), 0.5 * tilt * np.sin(direction), 0.0])
    about = np.array([np.cos(0.5 * turn), 0.0, 0.0, np.sin(0.5 * turn)])
    mujoco.mju_mulQuat(found, lean, about)
    return found


def hanging_cylinders(tilt: float) -> tuple[str, float, dict[str, ParameterValue], str]:
    """The problem of the cylinders, tilted by an angle [rad]; their kinetic energy is watched."""
    turns, ways = (
        2 * np.pi * (np.arange(CYLINDER_COUNT) * share % 1.0) for share in (0.618, 0.755)
    )
    bodies = []
    for k, (turn, way) in enumerate(zip(turns, ways, strict=True)):
        quat = " ".join(map(repr, tilted_quaternion(tilt, turn, way).tolist()))
        bodies.append(
            f"""<body pos="{k} 0 {HALF_HEIGHT + CYLINDER_CLEARANCE!r}" quat="{quat}">
            <joint name="joint{k}" type="slide" axis="0 0 1"/>
            <geom type="cylinder" size="{CYLINDER_RADIUS} {HALF_HEIGHT}" mass="0.01"/></body>"""
        )
    text = f"""<mujoco model="flat_cylinders">
  <option gravity="0 0 0"/>
  <worldbody>
    <geom type="plane" size="1 1 1" priority="1" solref="-1e6 -200"/>
    {"".join(bodies)}
  </worldbody>
  <sensor><e_kinetic name="kinetic"/></sensor>
  <keyframe><key name="start"/></keyframe>
</mujoco>"""
    return text, 1e-3, {"integrator": "Euler"}, "kinetic"
