"""Limits of MuJoCo, measured with MuJoCo and NumPy alone.

    python -I tests/studies/stress/bare/with_mujoco.py                       # all of them, as JSON
    python -I tests/studies/stress/bare/with_mujoco.py "pendulum, Euler"     # one

Nothing of proofmass is imported, so the limits that `proofmass stress` states for MuJoCo are
confirmed independently.  The mechanisms are the files in `models/linkages/`; models of springs are
written here.  A run fails if MuJoCo warns, if a value is not finite, if the constraint violation is
more than a tenth of the model's extent, or if the error of a position is more than a tenth of its
range.  All positions are compared after every step.
"""

import cmath
import json
import math
import sys
from functools import cache, partial
from pathlib import Path

import mujoco
import numpy as np

MODELS = Path(__file__).parents[4] / "models" / "linkages"
LIMIT_TOLERANCE = 2e-3  # relative width at which a bisection ends
LARGEST_ERROR = 0.1
GRAVITY = 9.81
WARNINGS = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


def find_limit(failed, low, high):
    """The first value that fails: in strides of a quarter from `low` on, then by bisection."""
    stride = 1.25 if high > low else 0.8
    assert not failed(low)
    while not failed(low * stride):
        low *= stride
        assert (low < high) is (stride > 1), "not failed at all"
    high = low * stride
    while max(high / low, low / high) > 1 + LIMIT_TOLERANCE:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if failed(middle) else (middle, high)
    return math.sqrt(low * high)


def has_warned(data):
    """Whether MuJoCo has warned of a state that is not finite or too large, and has reset it."""
    return any(data.warning[w].number for w in WARNINGS)


def relative_error(found, reference):
    """Largest error of some curves (n, curves), as a share of the range of the reference curve."""
    if not np.isfinite(found).all():
        return math.inf
    return float((np.abs(found - reference).max(axis=0) / np.ptp(reference, axis=0)).max())


def run_steps(model, steps, read, start=lambda model, data: None):
    """The rows of `read` for the state before the first step and after each; None if it fails."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    start(model, data)
    rows = [read(data)]
    for _ in range(steps):
        mujoco.mj_step(model, data)
        if has_warned(data):
            return None
        rows.append(read(data))
    assert math.isclose(data.time, steps * model.opt.timestep, rel_tol=1e-9)  # the steps taken
    return np.array(rows)


def advance(y, step, rate):
    """A state after a step with a constant rate."""
    return [p + step * q for p, q in zip(y, rate, strict=True)]


def integrate(slope, y, step, count):
    """States (count + 1, len(y)) by the Runge-Kutta method of order 4."""
    rows = [y]
    for _ in range(count):
        a = slope(y)
        b = slope(advance(y, 0.5 * step, a))
        c = slope(advance(y, 0.5 * step, b))
        d = slope(advance(y, step, c))
        y = [
            p + step / 6 * (q + 2 * r + 2 * s + t)
            for p, q, r, s, t in zip(y, a, b, c, d, strict=True)
        ]
        rows.append(y)
    return np.array(rows)


# -- a pendulum that is released from its horizontal pose


def pendulum_angle(x, speed):
    """Angle of a pendulum at times x, by Jacobi's elliptic functions.

    sin(angle / 2) = -k cd(w t, k) with k = sin(pi / 4); cd by descending Landen steps.
    """
    moduli = [math.sqrt(0.5)]
    while moduli[-1] > 1e-9:
        rest = math.sqrt(1 - moduli[-1] ** 2)
        moduli.append((1 - rest) / (1 + rest))
    quarter = math.pi / 2 * np.prod([1 + k for k in moduli[1:]])
    u = speed * np.asarray(x) + quarter  # cd(u) = sn(u + K)
    s = np.sin(u / np.prod([1 + k for k in moduli[1:]]))
    for k in reversed(moduli[1:]):
        s = (1 + k) * s / (1 + k * s**2)
    return -2 * np.arcsin(math.sqrt(0.5) * s)


def pendulum_error(integrator=None, step=1e-3, gravity=1.0, seconds=10.0):
    """The largest error of the pendulum's angle, as a share of its range."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "pendulum.xml"))
    model.opt.timestep = step
    model.opt.gravity[:] *= gravity
    if integrator:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    steps = round(seconds / step)
    found = run_steps(model, steps, lambda data: data.qpos.copy())
    if found is None:
        return math.inf
    x = step * np.arange(steps + 1)
    return relative_error(found, pendulum_angle(x, math.sqrt(GRAVITY * gravity))[:, None])


def pendulum_step(integrator):
    """Largest time step [s] of a run of ten seconds."""
    return find_limit(lambda h: pendulum_error(integrator, h) > LARGEST_ERROR, 0.02, 2.0)


def pendulum_gravity():
    """Largest factor on gravity, with steps of 1 ms and RK4."""
    return find_limit(lambda g: pendulum_error(gravity=g) > LARGEST_ERROR, 100.0, 1e5)


def pendulum_spring(seconds=0.1, step=1e-3):
    """Stiffest spring in the pivot [N m/rad], for 1 kg m2, in a run of 0.1 s with RK4."""

    def failed(stiffness):
        model = mujoco.MjModel.from_xml_path(str(MODELS / "pendulum.xml"))
        model.jnt_stiffness[0] = stiffness
        found = run_steps(model, round(seconds / step), lambda data: data.qpos.copy())
        if found is None:
            return True
        fine_steps = 40  # steps of the reference in one step that is tried
        reference = integrate(
            lambda y: (y[1], -GRAVITY * math.sin(y[0]) - stiffness * y[0]),
            [-math.pi / 2, 0.0],
            step / fine_steps,
            fine_steps * round(seconds / step),
        )
        return relative_error(found, reference[::fine_steps, :1]) > LARGEST_ERROR

    return find_limit(failed, 1e5, 1e7)


# -- a four-bar: crank 1, coupler 2, rocker 2.5, ground 3 m; 1 kg/m


BAR_LENGTHS = 1.0, 2.0, 2.5, 3.0


def coupler_and_rocker(crank):
    """Angles of coupler and rocker in the open assembly mode."""
    a, b, c, ground = BAR_LENGTHS
    pin = cmath.rect(a, crank)
    diagonal = ground - pin
    angle = cmath.phase(diagonal) + math.acos(
        (b**2 + abs(diagonal) ** 2 - c**2) / (2 * b * abs(diagonal))
    )
    return angle, cmath.phase(pin + cmath.rect(b, angle) - ground)


def energies(crank):
    """Generalized inertia about the crank [kg m2] and potential energy [J] of a pose."""
    a, b, c, _ = BAR_LENGTHS
    beta, gamma = coupler_and_rocker(crank)
    # a i e^(ia) + b i e^(ib) b' = c i e^(ic) c'
    beta_rate = a * math.sin(crank - gamma) / (b * math.sin(gamma - beta))
    gamma_rate = a * math.sin(crank - beta) / (c * math.sin(gamma - beta))
    middle = cmath.rect(a, crank) * 1j + cmath.rect(b / 2, beta) * 1j * beta_rate
    inertia = a**3 / 3 + b * abs(middle) ** 2 + b**3 / 12 * beta_rate**2 + c**3 / 3 * gamma_rate**2
    height = (
        a * a / 2 * math.sin(crank)
        + b * (a * math.sin(crank) + b / 2 * math.sin(beta))
        + c * c / 2 * math.sin(gamma)
    )
    return inertia, GRAVITY * height


def slope(y):
    """Rates of crank angle and speed by Lagrange's equation, with differences of the energies."""
    crank, rate = y
    h = 1e-5
    (more, up), (less, down) = energies(crank + h), energies(crank - h)
    return rate, -(0.5 * (more - less) * rate**2 + up - down) / (2 * h) / energies(crank)[0]


FINE_STEP = 2.5e-4  # [s]


@cache
def released_crank():
    """Angle and speed of the crank, released at rest, at times FINE apart."""
    return integrate(slope, [0.0, 0.0], FINE_STEP, round(2.3 / FINE_STEP))


def fourbar_positions(crank):
    """Angle of the rocker, direction of the coupler, and coordinates of the pin."""
    pairs = np.array([coupler_and_rocker(angle) for angle in crank])
    coupler, rocker = np.unwrap(pairs, axis=0).T
    return np.column_stack([rocker, coupler, 3 + 2.5 * np.cos(rocker), 2.5 * np.sin(rocker)])


def crank_at(x):
    """Angle of the released crank at some times, by cubic interpolation."""
    place, rate = released_crank().T
    k = np.minimum((np.asarray(x) / FINE_STEP).astype(int), len(place) - 2)
    s = x / FINE_STEP - k
    return (
        place[k] * (1 + 2 * s) * (1 - s) ** 2
        + FINE_STEP * rate[k] * s * (1 - s) ** 2
        + place[k + 1] * s**2 * (3 - 2 * s)
        + FINE_STEP * rate[k + 1] * s**2 * (s - 1)
    )


def fourbar(step, integrator=None):
    """The model of the four-bar with a time step and an integrator."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "fourbar.xml"))
    model.opt.timestep = step
    if integrator:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    return model


def read_fourbar(data):
    """The four positions that are compared, the constraint violation, and the crank angle."""
    crank, coupler, rocker = data.qpos
    pin = cmath.rect(1.0, crank) + cmath.rect(2.0, crank + coupler)
    end = 3.0 + cmath.rect(2.5, rocker)
    return rocker, crank + coupler, end.real, end.imag, abs(pin - end), crank


def fails_without_reference(model, rows):
    """Whether a run fails by itself, without a comparison with the reference."""
    return (
        rows is None
        or not np.isfinite(rows).all()
        or rows[:, 4].max() > LARGEST_ERROR * model.stat.extent
    )


def fourbar_step(integrator, seconds=2.0):
    """Largest time step [s] of a four-bar that is released at rest."""

    def failed(step):
        model, steps = fourbar(step, integrator), round(seconds / step)
        rows = run_steps(model, steps, read_fourbar)
        if fails_without_reference(model, rows):
            return True
        return (
            relative_error(rows[:, :4], fourbar_positions(crank_at(step * np.arange(steps + 1))))
            > LARGEST_ERROR
        )

    return find_limit(failed, 2e-3, 1.0)


def driven_crank_fails(step, integrator=None, speed=1.0):
    """Whether one turn of the crank at `speed` rad/s fails, with a flywheel of 1e12 kg m2."""
    model = fourbar(step, integrator)
    model.dof_armature[0] = 1e12

    def start(model, data):
        h = 1e-6
        (b, c), (beta, gamma) = coupler_and_rocker(-h), coupler_and_rocker(h)
        rates = np.array([1.0, (beta - b) / (2 * h) - 1.0, (gamma - c) / (2 * h)])
        place = data.qpos.copy()
        mujoco.mj_setConst(model, data)  # the loop's stiffness depends on the inertias
        data.qpos[:], data.qvel[:] = place, speed * rates

    rows = run_steps(model, round(2 * math.pi / speed / step), read_fourbar, start)
    return (
        fails_without_reference(model, rows)
        or relative_error(rows[:, :4], fourbar_positions(rows[:, 5])) > LARGEST_ERROR
    )


def fourbar_speed():
    """Largest speed of one turn of the crank [rad/s], with steps of 1 ms and RK4."""
    return find_limit(lambda times: driven_crank_fails(1e-3, speed=times), 20.0, 5e3)


def driven_step(integrator):
    """Largest time step [s] of one turn at 1 rad/s."""
    return find_limit(lambda step: driven_crank_fails(step, integrator), 0.01, 3.0)


def fourbar_energy(integrator, most=100_000, share=0.01):
    """Steps of 1 ms after which the energy of a released four-bar has changed by a hundredth.

    The change is over the largest kinetic energy.  The first 2000 steps are not judged, since the
    kinetic energy is largest in the first swing.
    """
    model = fourbar(1e-3, integrator)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    largest, drift, first = 0.0, 0.0, None
    for k in range(most):
        mujoco.mj_step(model, data)  # the energies are those before the step
        potential, kinetic = data.energy.tolist()
        total = potential + kinetic
        first = total if first is None else first
        largest, drift = max(largest, kinetic), max(drift, abs(total - first))
        if k > 2000 and drift > share * largest:
            return k
    return math.inf


# -- a spring and a damper on one coordinate, of unit inertia


def oscillator(rest="", kind="hinge", stiffness=0.0, damping=0.0, gravity="0 0 0", flag=""):
    """A body on a spring and a damper, displaced by a thousandth."""
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
  <option gravity="{gravity}"><flag contact="disable" {flag}/></option>
  <worldbody><body pos="1 0 0">
    <joint name="joint" type="{kind}" axis="0 0 1" stiffness="{stiffness}" damping="{damping}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
  {rest or '<keyframe><key qpos="0.001"/></keyframe>'}</mujoco>""")


def grows(model, step, integrator, what="qpos", steps=3000, bound=1.0):
    """Whether a value that starts small is large after many steps."""
    model.opt.timestep = step
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    largest = 0.0
    for k in range(steps):
        mujoco.mj_step(model, data)
        if has_warned(data) or not abs(value := float(getattr(data, what)[0])) < 1e6:
            return True
        largest = max(largest, abs(value)) if k > 0.75 * steps else 0.0
    return largest > bound


def spring_step(integrator, zeta, flag=""):
    """Largest dt omega of a spring."""
    return find_limit(
        lambda z: grows(oscillator(stiffness=1.0, damping=2 * zeta, flag=flag), z, integrator),
        0.3,
        50.0,
    )


def hung_gravity(integrator):
    """Largest gravity dt2 / L of a hanging point mass."""

    def failed(gravity):
        model = mujoco.MjModel.from_xml_string(f"""<mujoco>
  <option gravity="0 {-gravity!r} 0"/><worldbody><body><joint axis="0 0 1"/>
  <inertial pos="0 -1 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body></worldbody>
  <keyframe><key qpos="1e-6"/></keyframe></mujoco>""")
        return grows(model, 1.0, integrator, bound=1e-3)

    return find_limit(failed, 0.5, 50.0)


def servo_gain(integrator):
    """Largest dt kv / I of a velocity servo."""
    rest = (
        '<actuator><velocity joint="joint" kv="1"/></actuator>'
        '<keyframe><key qpos="0" qvel="0.001"/></keyframe>'
    )
    return find_limit(lambda z: grows(oscillator(rest), z, integrator, "qvel"), 0.3, 50.0)


def loop_softness(integrator):
    """Largest dt / timeconst of an equality, without refsafe."""

    def failed(ratio):
        model = oscillator(
            '<equality><joint joint1="joint" solimp="0.9 0.9 0.001"/></equality>'
            '<keyframe><key qpos="0.001"/></keyframe>',
            "slide",
            gravity="0 0 1e-3",
            flag='refsafe="disable"',
        )
        model.eq_solref[0] = 1 / ratio, 1.0
        return grows(model, 1.0, integrator)

    return find_limit(failed, 0.3, 50.0)


def flat_cylinder(radius=0.041, half=0.002, gap=2.1e-5, ways=3000):
    """Largest r d / (gap tilt) at which a cylinder above a floor has no contact at any rotation.

    Here gap is the distance from the floor, and d the largest rounding error of the square of a
    rotated axis, two units of the last place.
    """
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body><freejoint/><geom type="cylinder" size="{radius} {half}" mass="0.01"/></body>
  </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[2] = half + gap
    chance = np.random.default_rng(1).uniform(0.0, 2.0 * math.pi, (ways, 2))

    def touches(share):
        tilt = radius * 2.0**-51 / (gap * share)
        for turn, way in chance:
            # the tilt about an axis in the floor follows the rotation about the normal
            data.qpos[3:] = (
                math.cos(turn / 2),
                tilt / 2 * math.cos(way),
                tilt / 2 * math.sin(way),
                math.sin(turn / 2),
            )
            mujoco.mj_fwdPosition(model, data)
            if any(contact.dist < -1e-9 for contact in data.contact[: data.ncon]):
                return True
        return False

    return find_limit(touches, 0.1, 100.0)


LIMITS = {
    **{
        f"pendulum, {name}": partial(pendulum_step, name)
        for name in ("Euler", "implicit", "implicitfast", "RK4", "discrete")
    },
    "pendulum, gravity": pendulum_gravity,
    "pendulum, spring": pendulum_spring,
    **{
        f"fourbar_released, {name}": partial(fourbar_step, name)
        for name in ("Euler", "implicit", "implicitfast", "RK4", "discrete")
    },
    "fourbar, drive speed": fourbar_speed,
    "fourbar, Euler": partial(driven_step, "Euler"),
    "fourbar, RK4": partial(driven_step, "RK4"),
    "fourbar_released, energy, Euler": partial(fourbar_energy, "Euler"),
    "fourbar_released, energy, implicit": partial(fourbar_energy, "implicit"),
    "spring, ζ = 0, Euler": partial(spring_step, "Euler", 0.0),
    "spring, ζ = 0.3, Euler": partial(spring_step, "Euler", 0.3),
    "spring, ζ = 1, Euler": partial(spring_step, "Euler", 1.0),
    "spring, ζ = 1, explicit damping, Euler": partial(
        spring_step, "Euler", 1.0, 'eulerdamp="disable"'
    ),
    "spring, ζ = 0.3, implicitfast": partial(spring_step, "implicitfast", 0.3),
    "spring, ζ = 0, RK4": partial(spring_step, "RK4", 0.0),
    "spring, ζ = 1, RK4": partial(spring_step, "RK4", 1.0),
    "hung pendulum, Euler": partial(hung_gravity, "Euler"),
    "hung pendulum, RK4": partial(hung_gravity, "RK4"),
    "velocity servo, Euler": partial(servo_gain, "Euler"),
    "velocity servo, RK4": partial(servo_gain, "RK4"),
    "loop with refsafe off, Euler": partial(loop_softness, "Euler"),
    "loop with refsafe off, RK4": partial(loop_softness, "RK4"),
    "flat cylinder": flat_cylinder,
}


if __name__ == "__main__":
    print(json.dumps({name: LIMITS[name]() for name in sys.argv[1:] or LIMITS}))
