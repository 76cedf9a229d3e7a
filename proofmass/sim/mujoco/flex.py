"""One pose at rest in MuJoCo whose rods are flexes of its own; see `proofmass.sim.rod_flex`.

The engine steps until nothing moves.  Its integrator ``discrete`` takes the flexes' stiffness
implicitly, so that a step may last longer than their fast modes.  Loops and edges are the engine's
own constraints: they give way with the square of the step, an edge by 4e-7 to 1e-5 of its length in
cantilevers under P L^2/EI = 1 to 10.
"""

import time
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from proofmass.sim.mjcf import leave_out_disabled
from proofmass.sim.mujoco.model import Recorder, load, refuse_dry_friction
from proofmass.sim.mujoco.reading import withhold
from proofmass.sim.mujoco.settings import configure, stepped_with
from proofmass.sim.mujoco.still import until_still
from proofmass.sim.plane import Plane, find_plane
from proofmass.sim.protocol import BadModel, Curves, Run, Unsupported
from proofmass.sim.rod_chain import Chain
from proofmass.sim.rod_flex import add, fixed, moments, points, stations, tempo
from proofmass.sim.rod_shape import Pose, curve, of_rods
from proofmass.sim.rods import check, start_poses, without_links_to_rods

S = mujoco.mjtSensor
VELOCITY = int(mujoco.mjtStage.mjSTAGE_VEL)
DIRECTIONS = (S.mjSENS_FRAMEXAXIS, S.mjSENS_FRAMEYAXIS, S.mjSENS_FRAMEZAXIS, S.mjSENS_FRAMEQUAT)
NO_RATE = "the engine is at rest: no rates, no accelerations"
NO_ENERGY = "MuJoCo counts no energy of a flex that bends"
NO_TURN = "the points of a flex do not turn: directions are not read"
PACE = 0.06  # of a rod's time, over its segments: the step; edges then stretch alike for all n
BLOCK = 20  # steps between two looks at the speed
STILL = 1e-10  # lengths of a rod in its time: the fastest joint at rest
MOST = 100_000  # steps until a rest is given up
PROMPT = 0.1  # steps: time constant of the constraints; shorter ones are hardly stiffer
STIFF = 0.9999, 0.9999, 0.001  # solimp of the constraints, as MuJoCo caps it


def rest(path: Path, run: Run) -> Curves:
    """Let a model come to rest whose rods are flexes.

    Rods are read at the arc lengths ``run.x``; sensors have the same value everywhere.  The
    settings of the result tell by how much an edge is stretched, at most.

    Raises
    ------
    Unsupported
        Another run than a rest; drives; a rod that begins on a body that moves, or has a clamp at
        its far end; a moment on a rod; dry friction.
    Diverged
        The engine reset itself, or does not come to rest.
    """
    began = time.perf_counter()
    if run.kind != "rest" or not run.rods:
        raise Unsupported("a flex stands for a rod, in a rest")
    if run.drives:
        raise Unsupported(f"a flex stands on the ground: joint {run.drives[0].joint!r} is driven")
    chains, plane = [points(rod) for rod in run.rods], plane_of(path, run)
    model, data = assembled(path, run, chains)
    still = STILL * min(rod.length / tempo(rod) for rod in run.rods)
    steps = until_still(model, data, still, block=BLOCK, most=MOST)
    mujoco.mj_forward(model, data)
    record, missing = recorder(model, data, run)
    record.sample(0)
    curves = {name: np.repeat(values, run.x.size) for name, values in record.curves().items()}
    poses = {one.rod.name: (one, pose(data, one, plane)) for one in chains}
    for channel, (rod, part) in of_rods(run).items():
        one, shape = poses[rod.name]
        curves[channel] = curve(one, part, shape, run.x)
    return Curves(run.x, curves, missing, gap=float(record.gaps().max(initial=0.0)),
                  seconds=time.perf_counter() - began, steps=steps,
                  settings={**stepped_with(model), "stretch": max(
                      stretch(one, shape) for one, shape in poses.values())})


def recorder(model: mujoco.MjModel, data: mujoco.MjData,
             run: Run) -> tuple[Recorder, dict[str, str]]:
    """What reads the sensors, and the channels that are not read, with the reason."""
    sensors = tuple(c for c in run.channels if c not in of_rods(run))
    missing = {channel: NO_TURN for channel in sensors if channel.endswith(".angle")}
    record = Recorder(model, data, tuple(c for c in sensors if c not in missing), 1)
    missing |= withhold(record, VELOCITY, NO_RATE)
    for channel, (index, _) in list(record.sensors.items()):
        kind = S(model.sensor_type[index])
        if kind == S.mjSENS_E_POTENTIAL or kind in DIRECTIONS:
            missing[channel] = NO_TURN if kind in DIRECTIONS else NO_ENERGY
            del record.sensors[channel]
    return record, missing


def plane_of(path: Path, run: Run) -> Plane:
    """The plane that the rods bend in, from the model with chains for them."""
    model, data = load(path, replace(run, settings={}))
    mujoco.mj_kinematics(model, data)
    return find_plane(model, data)


def assembled(path: Path, run: Run, chains: list[Chain]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model with its flexes, in the start pose."""
    spec = mujoco.MjSpec.from_file(str(path))
    bare = without_links_to_rods(spec)
    check(bare, run.rods)
    key = spec.key(run.start)
    begin, ctrl = mujoco.MjData(bare), np.array(key.ctrl) if key else np.empty(0)
    if key and len(key.qpos):
        begin.qpos[:] = key.qpos
    for other in spec.keys:
        spec.delete(other)
    mujoco.mj_kinematics(bare, begin)
    for one in chains:
        add(spec, bare, one)
    no_moments(spec, chains)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    try:
        model = spec.compile()
    except ValueError as error:
        raise BadModel(f"{path.name}: {' '.join(str(error).split())}") from None
    leave_out_disabled(model)
    refuse_dry_friction(model, run.kind)
    tune(model, run)
    data = mujoco.MjData(model)
    data.ctrl[: ctrl.size] = ctrl
    put(model, data, bare, begin, chains)
    return model, data


def no_moments(spec: mujoco.MjSpec, chains: list[Chain]) -> None:
    """Raise where an actuator turns a point: it cannot."""
    tips = [f"{one.rod.name}.tip" for one in chains]
    for actuator in spec.actuators:
        if actuator.target in tips and any(actuator.gear[3:]):
            raise Unsupported(f"actuator {actuator.name!r}: a moment on a point of a flex")


def tune(model: mujoco.MjModel, run: Run) -> None:
    """Step and constraints for a short way to rest; the run's settings come last."""
    step = PACE * min(tempo(rod) / rod.segments for rod in run.rods)
    own = {"timestep": step, "tolerance": 1e-14, "solref": (PROMPT * step, 1.0), "solimp": STIFF}
    configure(model, own | {key: value for key, value in run.settings.items() if key != "flex"})


def put(model: mujoco.MjModel, data: mujoco.MjData, bare: mujoco.MjModel, begin: mujoco.MjData,
        chains: list[Chain]) -> None:
    """The model's own joints as they are in `begin`, the rods as arcs that reach their ends."""
    added = {model.joint(f"{one.rod.name}.{k}.{axis}").id for one in chains
             for k in range(fixed(one), one.vertices.size) for axis in "xyz"}
    own = [j not in added for j in range(model.njnt)]
    data.qpos[np.repeat(own, np.diff(np.append(model.jnt_qposadr, model.nq)))] = begin.qpos
    bends = start_poses(bare, begin, chains)
    for one in chains:
        turn = np.cumsum([bends.get(name, 0.0) for name in one.names])
        x, y = np.cumsum(one.lengths * [np.cos(turn), np.sin(turn)], axis=1)
        for k, s in list(enumerate(stations(one)))[fixed(one):]:
            first = model.joint(f"{one.rod.name}.{k}.x").qposadr[0]
            data.qpos[first:first + 2] = x[k - 1] - s, y[k - 1]


def pose(data: mujoco.MjData, one: Chain, plane: Plane) -> Pose:
    """Vertices of a rod's links, their angles, and bends with which EI/h gives the moments."""
    places = np.array([data.body(f"{one.rod.name}.{k}").xpos
                       for k in range(one.vertices.size)])
    places[0] = data.site(one.rod.start).xpos
    x, y = plane.flat(np.diff(places, axis=0)).T
    angles = np.unwrap(np.arctan2(y, x))
    return places, angles, moments(np.diff(angles, prepend=angles[0]))


def stretch(one: Chain, shape: Pose) -> float:
    """By how much of its length a link is longer or shorter than it should be, at most."""
    links = np.linalg.norm(np.diff(shape[0], axis=0), axis=1)
    return float(np.abs(links / one.lengths - 1.0).max())
