"""How MuJoCo's integrators step a spring and a damper, and where theory says that they give way.

    Euler, implicit, implicitfast         stable for z up to 2 (zeta + sqrt(1 + zeta^2))
    the same without implicit damping     2 (sqrt(1 + zeta^2) - zeta)
    discrete, implicit in the spring too  no limit
    RK4                                   |1 + w + w^2/2 + w^3/6 + w^4/24| = 1,
                                          w = z (-zeta + i sqrt(1 - zeta^2))

with z = dt omega and the damping ratio zeta.

E. Hairer, C. Lubich, G. Wanner, Geometric Numerical Integration, 2nd ed., ch. I; E. Hairer,
G. Wanner, Solving Ordinary Differential Equations II, sec. IV.2, for RK4.
"""

from collections.abc import Iterator
from math import inf

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.problem_models import key, wheel
from proofmass.sim.protocol import (
    LimitProblem,
    ParameterValue,
    ParameterValues,
    Scheme,
    StepMap,
    Stepping,
)


def euler(z: float, zeta: float) -> Array:
    """The new velocity, with the damper's force at its end, moves the position."""
    held = 1.0 + 2.0 * zeta * z
    return np.array([[1.0 - z**2 / held, 1.0 / held], [-(z**2) / held, 1.0 / held]])


def euler_explicit(z: float, zeta: float) -> Array:
    """The new velocity, with the damper's force at its beginning, moves the position."""
    left = 1.0 - 2.0 * zeta * z
    return np.array([[1.0 - z**2, left], [-(z**2), left]])


def discrete(z: float, zeta: float) -> Array:
    """Spring and damper both with their forces at the end of the step."""
    held = 1.0 + 2.0 * zeta * z + z**2
    return np.array([[1.0 - z**2 / held, 1.0 / held], [-(z**2) / held, 1.0 / held]])


def rk4(z: float, zeta: float) -> Array:
    """The exponential of the system's matrix to the fourth power."""
    step = np.array([[0.0, 1.0], [-(z**2), -2.0 * zeta * z]])
    a, power = np.eye(2), np.eye(2)
    for k in (1, 2, 3, 4):
        power = power @ step / k
        a = a + power
    return a


LAWS: dict[StepMap, str] = {  # of the limit of dt omega
    euler: "2 (ζ + √(1 + ζ²))",
    euler_explicit: "2 (√(1 + ζ²) − ζ)",
    rk4: "|R(z (−ζ + i √(1 − ζ²)))| = 1",
    discrete: "implicit in the spring as well",
}
ONE = (0.0,)


def scheme(name: str, step: StepMap, **tried: tuple[float, ...]) -> Scheme:
    """The scheme of an integrator; discrete damps what it steps."""
    return Scheme(name, step, LAWS[step], {"integrator": name}, step is not discrete, tried=tried)


SCHEMES = (
    scheme(
        "Euler",
        euler,
        spring=(0.0, 0.3, 1.0),
        slide=ONE,
        chain=(20, 200),
        pendulum=ONE,
        swing=(0.05,),
        fade=(0.05,),
    ),
    scheme("implicit", euler, spring=ONE),
    scheme("implicitfast", euler, spring=(0.0, 0.3, 1.0), whirl=ONE, swing=(0.05,)),
    scheme(
        "RK4",
        rk4,
        spring=(0.0, 0.3, 1.0),
        slide=ONE,
        chain=(20,),
        pendulum=ONE,
        whirl=ONE,
        swing=(0.3,),
        fade=(0.3,),
    ),
    scheme("discrete", discrete, spring=(0.0, 0.3)),
)


def scheme_of(parameters: ParameterValues, model: mujoco.MjModel) -> Scheme:
    """The scheme of a run: that of its integrator."""
    own = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
    name = str(parameters.get("integrator", own))
    return next(one for one in SCHEMES if one.name.lower() == name.lower())


def limit_problems() -> Iterator[LimitProblem]:
    """Springs with explicit damping, velocity servos, soft loops, and flat cylinders."""
    for zeta in (0.3, 1.0):
        text = wheel(1.0, 2.0 * zeta, flags='eulerdamp="disable"')
        yield LimitProblem(
            f"spring on a hinge, ζ = {zeta:g}, explicit damping",
            "Euler",
            "dt ω",
            LAWS[euler_explicit],
            sprung(text),
            euler_explicit,
            zeta,
            reach=100.0,
        )
    yield from servos()
    yield from soft_loops()
    yield flat_cylinders()


def sprung(text: str) -> Stepping:
    """A model stepped by Euler's method with a step, of its coordinate's place."""
    return lambda step: (text, step, {"integrator": "Euler"}, "place")


def servos() -> Iterator[LimitProblem]:
    """A velocity servo, an explicit damper unless the integrator knows it."""
    text = wheel(rest='<actuator><velocity joint="joint" kv="1"/></actuator>' + key("0", "0.001"))

    def served(name: str) -> Stepping:
        return lambda step: (text, step, {"integrator": name}, "rate")

    for one in SCHEMES:
        what = "velocity servo", one.name, "dt kv/I"
        if one.name == "Euler":
            yield LimitProblem(*what, "|1 − z| = 1", served(one.name), theory=2.0)
        elif one.step is rk4:  # on the negative axis, where critical damping is as well
            yield LimitProblem(*what, "|R(−z)| = 1", served(one.name), rk4, 1.0)
        else:
            yield LimitProblem(*what, "implicit in the velocity", served(one.name), theory=inf)


def soft_loops() -> Iterator[LimitProblem]:
    """A constraint is an explicit spring with critical damping, of omega = 1 / timeconst."""
    for name, step in (
        ("Euler", euler_explicit),
        ("implicitfast", euler_explicit),
        ("RK4", rk4),
        ("discrete", discrete),
    ):
        yield LimitProblem(
            "loop with refsafe off",
            name,
            "dt/solref",
            LAWS[step] + ", ζ = 1",
            loop('refsafe="disable"', name),
            step,
            1.0,
        )
    yield LimitProblem(
        "loop with refsafe on",
        "Euler",
        "dt/solref",
        "solref is kept to 2 dt",
        loop("", "Euler"),
        theory=inf,
    )


def loop(flags: str, name: str) -> Stepping:
    """A slide that an equality holds against its weight, stepped by a second at a time."""
    text = wheel(
        kind="slide",
        gravity="1e-3 0 0",
        flags=flags,
        rest='<equality><joint joint1="joint" solimp="0.9 0.9 0.001"/></equality>',
    )

    def stepped(ratio: float) -> tuple[str, float, dict[str, ParameterValue], str]:
        return text, 1.0, {"integrator": name, "solref": (1.0 / ratio, 1.0)}, "place"

    return stepped


RADIUS, HALF, GAP = 0.041, 0.002, 2.1e-5
"""Radius and half the height of a flat cylinder, and its height above the floor [m]."""
TWO_ULPS = 2 * float(np.finfo(float).eps)
"""How far the square of an axis that is turned is off 1 [1]: the most that was seen."""
CYLINDERS = 400
"""Turned in as many ways: five of their axes are off by `TWO_ULPS`, 81 by half of that."""


def flat_cylinders() -> LimitProblem:
    """Cylinders that hang above a floor, at rest and without weight: nothing should move them.

    From the centre of a face MuJoCo goes by the radius r along (n . a) a - n to the lowest point
    of the edge, with the axis a of the cylinder and the normal n of the floor::

             a
         ____|____         that vector is as long as the tilt, and lies in the face, but for a
        |____|____|        part d that rounding leaves along a: the point is
             |                 r d / sqrt(tilt^2 + d^2)
        _____n_____        too deep, by up to the radius

    `docs/contacts.md` has depths and energies of single poses.
    """
    theory = 1.0 / np.sqrt(1.0 - (GAP / RADIUS) ** 2)
    return LimitProblem(
        f"flat cylinders, {1e3 * GAP:g} mm above a floor",
        "Euler",
        "r d/(gap tilt)",
        f"r d / √(tilt² + d²) = gap, d = {TWO_ULPS:.2g}; tilt {tilted(theory):.2g} rad",
        lambda share: hang(tilted(share)),
        theory=float(theory),
        start=0.01,
        reach=100.0,
        bound=1e-12,
    )


def tilted(share: float) -> float:
    """The tilt [rad] with which rounding leads so many times the gap down."""
    return float(RADIUS * TWO_ULPS / (GAP * share))


def leaning(tilt: float, turn: float, way: float) -> Array:
    """The quaternion [1] of a body that is turned about the vertical, and then tilted [rad].

    The tilt is small, about a horizontal axis in a direction `way` [rad].
    """
    found = np.zeros(4)
    lean = np.array([1.0, 0.5 * tilt * np.cos(way), 0.5 * tilt * np.sin(way), 0.0])
    about = np.array([np.cos(0.5 * turn), 0.0, 0.0, np.sin(0.5 * turn)])
    mujoco.mju_mulQuat(found, lean, about)
    return found


def hang(tilt: float) -> tuple[str, float, dict[str, ParameterValue], str]:
    """The cylinders tilted by an angle [rad], and their kinetic energy."""
    turns, ways = (2 * np.pi * (np.arange(CYLINDERS) * share % 1.0) for share in (0.618, 0.755))
    bodies = []
    for k, (turn, way) in enumerate(zip(turns, ways, strict=True)):
        quat = " ".join(map(repr, leaning(tilt, turn, way).tolist()))
        bodies.append(
            f"""<body pos="{k} 0 {HALF + GAP!r}" quat="{quat}">
            <joint name="joint{k}" type="slide" axis="0 0 1"/>
            <geom type="cylinder" size="{RADIUS} {HALF}" mass="0.01"/></body>"""
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
