"""Rods as one-dimensional flexes of MuJoCo, added to an MJCF before it is compiled.

A flex of dimension 1 is a discrete elastic rod (since MuJoCo 3.17): points joined by edges, with
bending springs between neighbouring edges.

      |                         points of a clamped rod at -h/2, h/2, 3h/2, .. L, the first two on
    o-|-o---o---o---o---o       the ground: h = L / (n + 1/2), and springs at h/2, 3h/2, ..
      |                         points of a pinned rod at 0, h, 2h, .. L

A bend b has the energy EI/(2h) (2 tan b/2)^2, which gives an error of second order in h, 0.7 to 2.9
times that of a chain of links.  Edges are soft constraints of the engine.

    NAME.0, NAME.1, ...     bodies, one for each point, without rotation
    NAME.tip                site at the far end
    NAME                    the flex, its edges, and the loop that constrains the far end

The engine steps until nothing moves.  Its integrator ``discrete`` treats the flexes' stiffness
implicitly, so that a step may be longer than the period of their fast modes.  Loops and edges are
the engine's own soft constraints: their violation falls with the square of the step, and is 4e-7 to
1e-5 of the length of an edge in cantilevers under P L^2/EI = 1 to 10.
"""

import copy
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from proofmass.analytic.support import RunKind
from proofmass.base.arrays import Array
from proofmass.base.clock import processor_time
from proofmass.sim.mjcf import leave_out_disabled, read_spec
from proofmass.sim.mujoco.model import Recorder, load, refuse_uncovered
from proofmass.sim.mujoco.sensors import withhold_stage
from proofmass.sim.mujoco.settings import HARD_SOLIMP, configure, stepping_settings
from proofmass.sim.mujoco.settling import step_to_rest
from proofmass.sim.mujoco.work import StepWork
from proofmass.sim.plane import MotionPlane, find_plane
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Rod, Run
from proofmass.sim.rods import (
    DEFAULT_MASS,
    JOINT_PROPERTIES,
    RADIUS_RATIO,
    SLIDE,
    Chain,
    RodPose,
    check_rod,
    check_sites,
    compile_without_rods,
    connect,
    rod_channels,
    rod_curve,
    start_poses,
)

# [`time_scale` of the rod] damping over stiffness of a flex: critical for the slowest mode
DAMPING_TIME = 0.3


def cut_into_links(rod: Rod) -> Chain:
    """Cut a rod into the links between its points.

    Raises
    ------
    BadRod
        The rod has fewer than two segments, or a length or stiffness that is not positive.
    Unsupported
        The rod has a clamp at the far end, an axial or shear stiffness, a torsion stiffness, or a
        load per length.
    """
    check_rod(rod)
    if rod.ends[1] == "clamped":
        raise Unsupported(f"rod {rod.name!r}: a flex is clamped where it begins only")
    if rod.axial is not None or rod.shear is not None:
        raise Unsupported(f"rod {rod.name!r}: a flex has no axial and no shear stiffness of a rod")
    if rod.spatial:
        raise Unsupported(f"rod {rod.name!r}: a flex bends in a plane here, and has no torsion")
    if any(rod.load) or rod.couple:
        raise Unsupported(f"rod {rod.name!r}: a flex has no load and no couple per length")
    if any(rod.curvature):
        raise Unsupported(f"rod {rod.name!r}: a flex is straight without loads here")
    n, clamped = rod.segments, rod.ends[0] == "clamped"
    h = rod.length / (n + 0.5 if clamped else n)
    lengths, nodes = np.full(n, h), h * np.arange(0.5, n)
    springs = np.append(0.0, np.full(n - 1, rod.stiffness / h))
    if clamped:
        lengths, nodes = np.append(h / 2, lengths), h * np.arange(n + 1.0)
        springs = np.append(np.inf, np.full(n, rod.stiffness / h))
    return Chain(rod, lengths, springs, nodes)


def arc_lengths(one: Chain) -> Array:
    """Arc length [m] of a rod's points; the first point of a clamped rod lies behind the clamp."""
    behind = 0.0 if one.has_joint[0] else one.lengths[0]
    return one.vertices - behind * (one.vertices == 0)


def count_fixed_points(one: Chain) -> int:
    """How many points are fixed to the body on which the rod begins."""
    return 1 if one.has_joint[0] else 2


def scaled_moments(bends: Array) -> Array:
    """Bending moments at `bends` [rad], divided by EI/h [1]."""
    return np.asarray(2.0 * np.tan(bends / 2) / np.cos(bends / 2) ** 2)


def time_scale(rod: Rod) -> float:
    """sqrt(m L^3 / EI) [s], the time scale of a rod's slow motions."""
    return float(((rod.mass or DEFAULT_MASS) * rod.length**3 / rod.stiffness) ** 0.5)


def add_flex(spec: mujoco.MjSpec, bare: mujoco.MjModel, one: Chain) -> None:
    """Add a flex with its bodies, sites and loops; `bare` is the compiled model without rods."""
    rod, site, parent = one.rod, bare.site(one.rod.start), spec.site(one.rod.start).parent
    if bare.body_weldid[site.bodyid[0]]:
        raise Unsupported(f"rod {rod.name!r}: a flex begins on the ground; {parent.name!r} moves")
    turn, bodies = np.zeros(9), []
    mujoco.mju_quat2Mat(turn, site.quat)
    for k, s in enumerate(arc_lengths(one)):
        bodies.append(
            parent.add_body(name=f"{rod.name}.{k}", quat=site.quat, pos=site.pos + s * turn[::3])
        )
        if k >= count_fixed_points(one):
            free_point(bodies[-1], rod, one.lengths[-1])
    tip, radius = bodies[-1].add_site(name=f"{rod.name}.tip"), RADIUS_RATIO * rod.length
    spec.add_flex(
        name=rod.name,
        dim=1,
        young=4 * rod.stiffness / (np.pi * radius**4),
        poisson=0.0,
        radius=radius,
        damping=DAMPING_TIME * time_scale(rod),
        contype=0,
        conaffinity=0,
        vertbody=[body.name for body in bodies],
        vert=np.zeros(3 * len(bodies)),
        elem=np.stack([range(len(bodies) - 1), range(1, len(bodies))], axis=1).ravel(),
    )
    spec.add_equality(name=f"{rod.name}.edges", type=mujoco.mjtEq.mjEQ_FLEX, name1=rod.name)
    if rod.end is not None:
        connect(spec, rod.name, tip.name, rod.end)


def free_point(body: mujoco._specs.MjsBody, rod: Rod, length: float) -> None:
    """Give a point three slides and its share of the rod's mass."""
    body.mass, body.explicitinertial = (rod.mass or DEFAULT_MASS) * length / rod.length, True
    body.inertia = np.full(3, body.mass * length**2 / 12)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        body.add_joint(
            name=f"{body.name}.{name}",
            type=SLIDE,
            axis=axis,
            stiffness=[0, 0, 0],
            **JOINT_PROPERTIES,
        )


S = mujoco.mjtSensor
VELOCITY_STAGE = int(mujoco.mjtStage.mjSTAGE_VEL)
DIRECTION_SENSORS = (
    S.mjSENS_FRAMEXAXIS,
    S.mjSENS_FRAMEYAXIS,
    S.mjSENS_FRAMEZAXIS,
    S.mjSENS_FRAMEQUAT,
)
NO_RATE = "the engine is at rest: no rates, no accelerations"
NO_ENERGY = "MuJoCo counts no energy of a flex that bends"
NO_TURN = "the points of a flex do not rotate: directions are not read"
# time step, in multiples of `time_scale` / segments; edges then stretch alike for all n
TIMESTEP_RATIO = 0.06
FLEX_STEPS_PER_CHECK = 20  # steps between two checks of the speed
# [rod lengths per `time_scale`] speed of the fastest joint below which a model is at rest
FLEX_REST_SPEED = 1e-10
MAX_FLEX_STEPS = 100_000  # steps after which the search for an equilibrium is given up
CONSTRAINT_TIME = 0.1  # [steps] time constant of the constraints; shorter ones are hardly stiffer


def equilibrium(path: Path, run: Run) -> Curves:
    """Find the equilibrium of a model whose rods are flexes, by time stepping.

    Rods are read at the arc lengths ``run.x``; a sensor has one value, which is repeated for each
    of these.  The settings of the result have the largest relative stretch of an edge.

    Raises
    ------
    Unsupported
        The run is not an equilibrium with rods, or has drives; a rod begins on a body that moves,
        has a clamp at its far end, or bears a moment; there is dry friction.
    Diverged
        The engine reset itself, or does not come to rest.
    """
    began = processor_time()
    if run.kind != "equilibrium" or not run.rods:
        raise Unsupported("a flex can replace a rod only in an equilibrium run")
    if run.drives:
        raise Unsupported(
            f"a run with a flex has no drives: joint {run.drives[0].joint!r} is driven"
        )
    chains, plane = [cut_into_links(rod) for rod in run.rods], find_rod_plane(path, run)
    model, data = assemble_model(path, run, chains)
    rest_speed = FLEX_REST_SPEED * min(rod.length / time_scale(rod) for rod in run.rods)
    steps = step_to_rest(
        model, data, rest_speed, block=FLEX_STEPS_PER_CHECK, max_steps=MAX_FLEX_STEPS
    )
    mujoco.mj_forward(model, data)
    record, missing = make_recorder(model, data, run)
    record.sample(0)
    curves = {name: np.repeat(values, run.x.size) for name, values in record.curves().items()}
    poses = {one.rod.name: (one, rod_pose(data, one, plane)) for one in chains}
    for channel, (rod, part) in rod_channels(run).items():
        one, shape = poses[rod.name]
        curves[channel] = rod_curve(one, part, shape, run.x)
    return Curves(
        run.x,
        curves,
        missing,
        violation=float(record.violations().max(initial=0.0)),
        seconds=processor_time() - began,
        steps=steps,
        settings={
            **stepping_settings(model),
            "stretch": max(max_stretch(one, shape) for one, shape in poses.values()),
        },
        work=steps * StepWork(model).step(data),
    )


def make_recorder(
    model: mujoco.MjModel, data: mujoco.MjData, run: Run
) -> tuple[Recorder, dict[str, str]]:
    """The recorder of the sensors, and the channels that are not read, with the reasons."""
    sensors = tuple(c for c in run.channels if c not in rod_channels(run))
    missing = {channel: NO_TURN for channel in sensors if channel.endswith(".angle")}
    record = Recorder(model, data, tuple(c for c in sensors if c not in missing), 1)
    missing |= withhold_stage(record, VELOCITY_STAGE, NO_RATE)
    for channel, (index, _) in list(record.sensors.items()):
        kind = S(model.sensor_type[index])
        if kind == S.mjSENS_E_POTENTIAL or kind in DIRECTION_SENSORS:
            missing[channel] = NO_TURN if kind in DIRECTION_SENSORS else NO_ENERGY
            del record.sensors[channel]
    return record, missing


def find_rod_plane(path: Path, run: Run) -> MotionPlane:
    """The plane in which the rods bend, found from the model with chains in place of the flexes."""
    model, data = load(path, replace(run, settings={}))
    mujoco.mj_kinematics(model, data)
    return find_plane(model, data)


def assemble_model(
    path: Path, run: Run, chains: list[Chain]
) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The model with its flexes, in the start pose."""
    spec = read_spec(path)
    bare = compile_without_rods(spec)
    check_sites(bare, run.rods)
    users = copy.copy(bare)  # without the flexes, whose equalities are added and covered here
    leave_out_disabled(users)
    refuse_uncovered(users, RunKind.EQUILIBRIUM)
    key = spec.key(run.start)
    begin, ctrl = mujoco.MjData(bare), np.array(key.ctrl) if key else np.empty(0)
    if key and len(key.qpos):
        begin.qpos[:] = key.qpos
    for other in spec.keys:
        spec.delete(other)
    mujoco.mj_kinematics(bare, begin)
    for one in chains:
        add_flex(spec, bare, one)
    refuse_moments(spec, chains)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    try:
        model = spec.compile()
    except ValueError as error:
        raise BadModel(f"{path.name}: {' '.join(str(error).split())}") from None
    leave_out_disabled(model)
    tune_settling(model, run)
    data = mujoco.MjData(model)
    data.ctrl[: ctrl.size] = ctrl
    set_start_pose(model, data, bare, begin, chains)
    return model, data


def refuse_moments(spec: mujoco.MjSpec, chains: list[Chain]) -> None:
    """Raise `Unsupported` if an actuator exerts a moment on a point, which cannot rotate."""
    tips = [f"{one.rod.name}.tip" for one in chains]
    for actuator in spec.actuators:
        if actuator.target in tips and any(actuator.gear[3:]):
            raise Unsupported(f"actuator {actuator.name!r}: a moment on a point of a flex")


def tune_settling(model: mujoco.MjModel, run: Run) -> None:
    """Set the step and the constraints for fast settling; the run's settings override them."""
    step = TIMESTEP_RATIO * min(time_scale(rod) / rod.segments for rod in run.rods)
    own = {
        "timestep": step,
        "tolerance": 1e-14,
        "solref": (CONSTRAINT_TIME * step, 1.0),
        "solimp": HARD_SOLIMP,
    }
    configure(model, own | {key: value for key, value in run.settings.items() if key != "flex"})


def set_start_pose(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bare: mujoco.MjModel,
    begin: mujoco.MjData,
    chains: list[Chain],
) -> None:
    """Set the model's own joints as in `begin`, and the rods as arcs that reach their ends."""
    added = {
        model.joint(f"{one.rod.name}.{k}.{axis}").id
        for one in chains
        for k in range(count_fixed_points(one), one.vertices.size)
        for axis in "xyz"
    }
    own = [j not in added for j in range(model.njnt)]
    data.qpos[np.repeat(own, np.diff(np.append(model.jnt_qposadr, model.nq)))] = begin.qpos
    bends = start_poses(bare, begin, chains)
    for one in chains:
        turn = np.cumsum([bends.get(name, 0.0) for name in one.names])
        x, y = np.cumsum(one.lengths * [np.cos(turn), np.sin(turn)], axis=1)
        for k, s in list(enumerate(arc_lengths(one)))[count_fixed_points(one) :]:
            first = model.joint(f"{one.rod.name}.{k}.x").qposadr[0]
            data.qpos[first : first + 2] = x[k - 1] - s, y[k - 1]


def rod_pose(data: mujoco.MjData, one: Chain, plane: MotionPlane) -> RodPose:
    """Vertices and angles of a rod's links, and its moments over EI/h, which stand for bends."""
    places = np.array([data.body(f"{one.rod.name}.{k}").xpos for k in range(one.vertices.size)])
    places[0] = data.site(one.rod.start).xpos
    x, y = plane.flat(np.diff(places, axis=0)).T
    angles = np.unwrap(np.arctan2(y, x))
    return places, angles, scaled_moments(np.diff(angles, prepend=angles[0]))


def max_stretch(one: Chain, shape: RodPose) -> float:
    """Largest relative change of the length of a rod's links [1]."""
    links = np.linalg.norm(np.diff(shape[0], axis=0), axis=1)
    return float(np.abs(links / one.lengths - 1.0).max())
