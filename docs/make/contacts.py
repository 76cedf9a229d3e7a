"""Contacts and friction against closed forms: which errors fall with the step, in each engine.

    python -m docs.make.contacts [--quick]

The cases of models/contacts that have a closed form are run with the step of their models and with
1/2, 1/4, ... of it.  Five touching balls are run in bare MuJoCo with finer steps and stiffer
contacts.  The contacts that MuJoCo finds for a flat cylinder that hangs above a floor are counted.
Writes docs/contacts.md.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from benchmarks import ROOT, command, folders
from proofmass import load_case
from proofmass.analytic.contacts import restitution
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.run.solve import call_engine, plan_run
from proofmass.sim.mujoco.contacts import creep_rate
from proofmass.sim.mujoco.theory import (
    CYLINDER_CLEARANCE,
    CYLINDER_RADIUS,
    HALF_HEIGHT,
    TWO_ULPS,
    cylinder_problem,
    tilt_for_share,
    tilted_quaternion,
)
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Run
from proofmass.verdict.compare import compare

HALVINGS = 5
CASES = {
    "block_slides": ("position", "velocity"),
    "block_sticks": ("position", "velocity"),
    "block_stops": ("position",),
    "ball_rolls": ("position", "velocity", "spin"),
    "ball_bounces": ("height",),
    "block_rocks": ("angle",),
    "balls_in_row": ("x1.x", "x5.x"),
}
"""Channels in the table, by case."""
POSITION_UNITS = ("m", "rad")
"""Units of channels whose largest errors are listed.  The list has root mean squares of the errors
of velocities, which jump."""
ROUNDING = 1e-10
"""Errors [SI] below this are rounding errors of 10,000 steps, and no order is stated for them."""
CREEPS: dict[str, dict[str, Any]] = {
    "default softness, impedance 0.9": {},
    "`impratio` 10": {"impratio": 10.0},
    "time constant 10 ms": {"solref": (0.01, 1.0)},
    "impedance 0.99": {"impedance": 0.99},
    "stiffness 2000, damping 80": {"solref": (-2000.0, -80.0)},
}
"""Settings of contacts on which a box creeps."""
SLOPE, FRICTION = 0.3, 0.6
"""Angle of the slope [rad] and the coefficient of friction [1], twice the one that is needed."""
HEAD = (
    "| case | channel | engine | step [ms] | errors with this step, and with 1/2, 1/4, 1/8, 1/16 "
    "of it | errors fall with the step |\n|---|---|---|---|---|---|"
)


def main() -> None:
    quick = command(__doc__).parse_args().quick
    with folders(quick, Path("reports")) as (_, docs):
        names, halvings = (list(CASES), HALVINGS) if not quick else (["block_stops"], 2)
        steps = (1e-4,) if quick else (1e-4, 5e-5, 2e-5, 1e-5, 2e-6)
        tables = {
            "series": [HEAD, *(line for name in names for line in rows(name, halvings))],
            "creep": creep((2e-3,) if quick else (2e-3, 5e-4)),
            "impacts": impacts(100 if quick else 10000),
            "phantom": phantom(200 if quick else 2000),
            "touching": touching(steps, (0.95,) if quick else (0.95, 0.9999)),
        }
        lines = {name: "\n".join(lines) for name, lines in tables.items()}
        page = PAGE.format(**lines, tilt=number(tilt_for_share(cylinder_problem().theory), 3))
        (docs / "contacts.md").write_text(page, encoding="utf-8")
        print(page)


def rows(name: str, halvings: int) -> Iterator[str]:
    """The errors of a case, a row for each engine and channel."""
    case = load_case(ROOT / "models" / "contacts" / f"{name}.toml")
    for engine in ("mujoco", "pymunk"):
        found = [errors(case, engine, k) for k in range(halvings)]
        step = number(1e3 * own_step(case), 3)
        for channel in CASES[name]:
            curve = [one[channel] for one in found]
            values = ", ".join(number(value, 2) for value in curve)
            yield f"| {name} | {channel} | {engine} | {step} | {values} | {verdict(curve)} |"


def own_step(case: Case) -> float:
    """The time step of a case's model [s]."""
    return float(mujoco.MjModel.from_xml_path(str(case.model_path)).opt.timestep)


def errors(case: Case, engine: str, halved: int) -> dict[str, float]:
    """Errors [SI] of each channel, with the step halved `halved` times."""
    run = plan_run(case, "dynamics", engine)
    settings = {**run.settings, "timestep": own_step(case) / 2**halved}
    try:
        curves = call_engine(engine, case.model_path, replace(run, settings=settings))
    except Diverged:
        return dict.fromkeys(case.channels, np.nan)
    compared = compare(case, "dynamics", engine, curves, detectable=False)
    return {c.channel: c.error_max if c.unit in POSITION_UNITS else c.error_rms for c in compared}


def verdict(curve: Sequence[float]) -> str:
    """Whether errors fall with the step, by a power law fitted to all of them.

    >>> verdict([8.0, 4.0, 2.0, 1.0]), verdict([1.0, 0.9, 1.1, 1.0])
    ('yes, order 1.0', 'no')
    """
    values = np.asarray(curve, float)
    if not np.isfinite(values).all():
        return "failed"
    if values.max() < ROUNDING:
        return "exact"
    if values.min() < ROUNDING:
        return "yes, down to rounding"
    order = -np.polyfit(np.arange(len(values)), np.log2(np.maximum(values, 1e-300)), 1)[0]
    if order < 0.4:
        return "no"
    scatter = (np.diff(values) > 0).any()
    return f"yes, {'unevenly, about ' if scatter else ''}order {order:.1f}"


def creep(steps: Sequence[float]) -> Iterator[str]:
    """Speeds of a box that friction should hold on a slope, by the closed form and in MuJoCo."""
    heads = [f"at {number(1e3 * step, 2)} ms" for step in steps]
    yield f"| contacts | closed form [mm/s] | elliptic cone {' | '.join(heads)} | pyramidal cone |"
    yield f"|---|---{'|---' * len(heads)}|---|"
    for words, settings in CREEPS.items():
        known = creep_rate(pull=9.81 * np.sin(SLOPE), contacts=4, **settings)
        found = [crept(step, "elliptic", **settings) for step in steps]
        found.append(crept(steps[0], "pyramidal", **settings))
        speeds = " | ".join(f"{1e3 * speed:.6g}" for speed in (known, *found))
        yield f"| {words} | {speeds} |"


SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'


def crept(
    step: float,
    cone: str = "elliptic",
    geom: str = "box",
    joints: str = SLIDES,
    solref: tuple[float, float] = (0.02, 1.0),
    impedance: float = 0.9,
    impratio: float = 1.0,
) -> float:
    """Speed [m/s] at which a body of 2 kg slides down a slope in bare MuJoCo, after a second."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{step}" cone="{cone}"
      gravity="{-9.81 * np.sin(SLOPE)} 0 {-9.81 * np.cos(SLOPE)}" impratio="{impratio}"
      tolerance="1e-12"/>
      <default><geom friction="{FRICTION} 0 0" solref="{solref[0]} {solref[1]}"
      solimp="{impedance} {impedance}"/></default>
      <worldbody><geom type="plane" size="2 2 .1"/>
      <body pos="0 0 0.02">{joints}
      <geom type="{geom}" size="0.1 0.1 0.02" mass="2"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(1.0 / step))
    return float(-data.qvel[0])


def impacts(steps: int) -> Iterator[str]:
    """Restitution of a ball in bare MuJoCo, by the damping ratio and stiffness of the contact."""
    hard = (1e4, 1e6, 1e8)
    yield "| damping ratio | limit | " + " | ".join(f"at {k:.0e}/s²" for k in hard) + " |"
    yield f"|---|---{'|---' * len(hard)}|"
    for ratio in (0.07, 0.4, 1.0, 2.0):
        found = " | ".join(f"{bounced(ratio, k, steps):.4f}" for k in hard)
        yield f"| {ratio} | {restitution(ratio):.4f} | {found} |"


def bounced(ratio: float, stiffness: float, steps: int) -> float:
    """Speed after an impact over that before it, without gravity, with `steps` in half a period."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="{np.pi / np.sqrt(stiffness) / steps}" gravity="0 0 0"/><worldbody>
      <geom type="plane" size="1 1 1" priority="1"
      solref="{-stiffness} {-2 * ratio * stiffness**0.5}"/>
      <body pos="0 0 .1"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>
      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[0] = -1.0
    mujoco.mj_step(model, data, 4 * steps)
    return float(data.qvel[0])


def phantom(poses: int) -> Iterator[str]:
    """Contacts of a cylinder that hangs above a floor without gravity, by its tilt."""
    yield "| floor | tilt [rad] | contacts | deepest one [mm] | closed form [mm] | energy [J] |"
    yield "|---|---|---|---|---|---|"
    for words, floor in {"level": "0 0 0", "tilted": "10 20 0"}.items():
        for tilt in (1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11):
            hits, deepest, energy = hanging(tilt, floor, poses)
            depth, joules = number(1e3 * deepest, 4), number(energy, 2)
            known = number(1e3 * phantom_depth(tilt), 4) if floor == "0 0 0" else ""
            yield f"| {words} | {tilt:.0e} | {hits} of {poses} | {depth} | {known} | {joules} |"


def phantom_depth(tilt: float) -> float:
    """Depth [m] of the contact that MuJoCo finds on a level floor, with a rounding of `TWO_ULPS`.

    With the cylinder's axis a and the floor's normal n, MuJoCo goes from the centre of a face by
    the radius along (n . a) a - n.  This vector is as long as the tilt and lies in the face, except
    for the rounding of its component along n.  Where it is shorter than 1e-15, `mjMINVAL`, MuJoCo
    takes another direction in the face.

    >>> f"{phantom_depth(1e-14):.4g}", phantom_depth(1e-12)
    ('0.001798', 0.0)
    """
    length = np.hypot(tilt, TWO_ULPS)
    deep = CYLINDER_RADIUS * TWO_ULPS / length - CYLINDER_CLEARANCE
    return float(deep) if tilt >= 1e-15 and deep > 0 else 0.0


def hanging(tilt: float, floor: str, poses: int) -> tuple[int, float, float]:
    """Poses of a cylinder above a floor with contacts, deepest contact [m], most energy [J]."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="1e-3" gravity="0 0 0"/><worldbody>
      <geom type="plane" size="1 1 1" euler="{floor}" priority="1" solref="-1e6 -200"/>
      <body><freejoint/>
      <geom type="cylinder" size="{CYLINDER_RADIUS} {HALF_HEIGHT}" mass="0.01"/></body>
      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    up, found = data.geom_xmat[0].reshape(3, 3)[:, 2].copy(), []
    for way, turn in np.random.default_rng(0).uniform(0.0, 2 * np.pi, (poses, 2)):
        mujoco.mj_resetData(model, data)
        mujoco.mju_mulQuat(data.qpos[3:], model.geom_quat[0], tilted_quaternion(tilt, turn, way))
        data.qpos[:3] = (HALF_HEIGHT + CYLINDER_CLEARANCE) * up
        mujoco.mj_forward(model, data)
        deepest = max((-float(c.dist) for c in data.contact[: data.ncon]), default=0.0)
        mujoco.mj_step(model, data)
        mujoco.mj_energyVel(model, data)
        found.append((deepest, float(data.energy[1])))
    depths, energies = zip(*found, strict=True)
    return sum(depth > 1e-9 for depth in depths), max(depths), max(energies)


def touching(steps: Sequence[float], impedances: Sequence[float]) -> Iterator[str]:
    """Velocities of five touching balls after the impact, in both engines and by three theories."""
    yield "| | steps in a contact | impedance | v1 | v2 | v3 | v4 | v5 | energy |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for impedance in impedances:
        for step in steps:
            many = np.pi / 1e3 / step
            yield line("MuJoCo", struck(step, 1e6, impedance), f"{many:.0f}", f"{impedance:g}")
    hard = struck(steps[0] / 10, 1e8, impedances[0])
    many = np.pi / 1e3 / steps[0]
    yield line("MuJoCo, 100 times as stiff", hard, f"{many:.0f}", f"{impedances[0]:g}")
    for words, gap in {
        "pymunk": 0.0,
        "pymunk, 1 nm of overlap": -1e-9,
        "pymunk, gaps of 1 nm": 1e-9,
    }.items():
        yield line(words, struck_rigidly(1e-4, gap))
    yield line("theory: the first ball hits four that move as one body", [-0.6, 0.4, 0.4, 0.4, 0.4])
    yield line("theory: linear springs between the balls", springs())
    yield line("the reference: impacts one after the other", [0.0, 0.0, 0.0, 0.0, 1.0])


def line(words: str, speeds: Sequence[float], steps: str = "", impedance: str = "") -> str:
    """A row of the table of touching balls."""
    cells = [steps, impedance, *(f"{v:.4f}" for v in speeds)]
    return f"| {words} | {' | '.join(cells)} | {sum(v * v for v in speeds):.4f} |"


def struck(step: float, stiffness: float, impedance: float) -> list[float]:
    """Velocities [m/s] of the balls of `balls_touching` after the impact, in bare MuJoCo."""
    file = ROOT / "models" / "contacts" / "balls_touching.xml"
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_EULER
    model.geom_solref[:] = -stiffness, 0.0
    model.geom_solimp[:, :2] = impedance
    model.opt.tolerance = 1e-12
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, int(30.0 / stiffness**0.5 / step))
    return [float(v) for v in data.qvel]


def struck_rigidly(step: float, gap: float) -> list[float]:
    """Velocities [m/s] of the balls after the impact in pymunk, with gaps [m] between them."""
    file = ROOT / "models" / "contacts" / "balls_touching.xml"
    tree = ElementTree.parse(file)
    for k, body in enumerate(tree.findall(".//body")):
        body.set("pos", f"{k * (0.04 + gap)!r} 0 0.02")
    speeds = tuple(f"v{k}" for k in range(1, 6))
    for name, joint in zip(speeds, tree.findall(".//joint[@name]"), strict=True):
        ElementTree.SubElement(tree.find("sensor"), "jointvel", name=name, joint=joint.get("name"))
    with TemporaryDirectory() as folder:
        moved = Path(folder) / "row.xml"
        tree.write(moved)
        run = Run("dynamics", np.linspace(0.0, 0.05, 51), speeds, settings={"timestep": step})
        curves = call_engine("pymunk", moved, run)
    return [float(curves.channels[name][-1]) for name in speeds]


def springs() -> list[float]:
    """Velocities [m/s] of a row of masses with springs between them that can only push."""
    from scipy.integrate import solve_ivp

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        press = np.maximum(-np.diff(y[:5]), 0.0)
        return np.concatenate([y[5:], np.append(0.0, press) - np.append(press, 0.0)])

    start = [*([0.0] * 5), 1.0, *([0.0] * 4)]
    done = solve_ivp(rates, (0.0, 60.0), start, "DOP853", rtol=1e-9, atol=1e-9, max_step=0.05)
    return [float(v) for v in done.y[5:, -1]]


PAGE = """# Contacts and friction

`python -m docs.make.contacts` made this page.

The cases in `models/contacts/` have closed forms (see [Sidecar](sidecar.md#references)) and run
in both engines. The engines have different models of a contact. In MuJoCo it is a spring and a
damper that push, with a regularized friction. In pymunk it is rigid, with Coulomb's friction and a
coefficient of restitution, see [Engines](engines.md#contacts-in-pymunk).

## Does the error fall with the step?

The table lists the largest errors of positions, in m or rad, and the root mean squares of the
errors of velocities, because velocities jump in an impact. The step is that of the model.

{series}

Where MuJoCo's error does not fall, the softness of its contacts limits it. With every step an
impact lasts pi divided by the square root of the contact's stiffness: 1 ms for the ball that
bounces and 0.3 ms in the row. While a body slides, MuJoCo's errors are of first order with large
factors, because the body hops on its soft contacts. pymunk's errors of positions are of second
order while a contact lasts, and of first order at impacts, each of which is up to a step late.

## Creep of bodies that friction should hold

In MuJoCo a body that friction should hold slides slowly. With the elliptic cone and an impedance d
that is the same for every depth, n contacts creep with the speed

    v = (1 - d) / d  m A a / (b n impratio),      b = 2 / (d timeconst)  or  damping / d,

as `proofmass.sim.mujoco.contacts.creep_rate` computes it. Here a is the acceleration that the body
would have without friction, m is its mass and A is MuJoCo's `body_invweight0`, so that m A is 1 for
a free body. The step, the weight and the coefficient of friction do not matter, as long as no
contact transmits the largest force that its friction allows. The table is that of a box with two
slides on a slope of 0.3 rad, with a coefficient of friction of 0.6:

{creep}

In pymunk friction holds the box: its speed is a rounding error.

`proofmass choose CASE --creep 1e-6` proposes the `impratio` with which a body creeps in MuJoCo with
no more than 1e-6 m/s, and confirms it with a separate program. The block of
`models/contacts/block_sticks` creeps with 2.09e-4 m/s with the default `impratio`, with
9.5e-7 m/s at 220 and with 9.5e-10 m/s at 220,000; at 2.2 million it creeps faster, with 7.8e-4 m/s.

## Speed after an impact

After an impact on a damped spring that can only push, a body has the share
exp(-2 z acos(z) / (1 - z²)^(1/2)) of its speed, with the damping ratio z. MuJoCo's contact
approaches this limit only as its stiffness grows, because its impedance changes with the depth. The
table is computed without gravity, with 10,000 steps in half a period:

{impacts}

## Five balls that touch

Five equal elastic balls touch in a row, and the first one has a velocity of 1 m/s. Impacts one
after the other, which are the limit of gaps that go to zero, give all of this velocity to the last
ball. MuJoCo converges to another motion, because a contact prescribes the relative *acceleration*
of its two balls, -k r - b v, and not a force. The prescribed acceleration is zero between balls
that touch and do not overlap yet, so that four of them move as one body: the velocities are -3/5
and 2/5 for an impedance of 1. The stiffness makes no difference with the same number of steps in a
contact, and finer steps lead to this limit. In pymunk all pairs that touch at an instant act at
once, which gives -3/5 and 2/5 as well; but rounding decides which pairs touch. Overlaps of 1 nm and
gaps of 1 nm lead to two different motions, and positions that touch to the last digit lead to a
third. Linear springs between the balls have another limit.

{touching}

## A flat cylinder that hangs above a floor

MuJoCo finds contacts up to a radius deep between a plane and a cylinder above it, if the axis of
the cylinder differs from the plane's normal by 1e-15 to 1e-12 rad, as it does after a rotation into
this direction. To find the lowest point of the edge, MuJoCo goes from the centre of a face by the
radius along the vector (n · a) a - n, with the axis a and the normal n. This vector is as long as
the tilt. Rounding leaves it a component d normal to the face, so that the point lies
r d / (tilt² + d²)^(1/2) too deep. Below 1e-15 MuJoCo takes another vector.

A cylinder of 10 g, 41 mm in radius, hangs 0.021 mm above a floor, at rest and without gravity, in
poses that are rotated at random. It should have no contact and no energy. The closed form is
computed with d = 4.4e-16, the largest value on a level floor. The energy is that after a step of
1 ms with contacts of 1e6/s². MuJoCo 3.3.7 and 3.6.0 have the same contacts on the level floor.

{phantom}

`proofmass stress` finds the tilt below which one of 400 such cylinders begins to move: [Where it
breaks](stress.md). The closed form gives {tilt} rad. `tests/studies/stress/bare/with_mujoco.py`,
which needs MuJoCo and NumPy alone, finds a value within 2 % of it.
"""

if __name__ == "__main__":
    main()
