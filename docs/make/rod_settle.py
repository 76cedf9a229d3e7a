"""Rods that are released in any shape in both engines, and the poses in which they settle."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from proofmass.analytic.rods.all_equilibria import Solutions, solutions
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.equilibrium import clamps_and_forces
from proofmass.analytic.start import start_pose
from proofmass.base.arrays import Array
from proofmass.sim.mujoco.model import loop_violations
from proofmass.sim.mujoco.settling import failure_warning
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Rod
from proofmass.sim.pymunk.model import read_links
from proofmass.sim.pymunk.quasi_static import rod_shape
from proofmass.sim.pymunk.space import build_space
from proofmass.sim.rods import Chain, chain, compile_with_rods
from proofmass.sim.smooth import SmoothTerms
from proofmass.sim.start import StartOfModel
from tests.independent.rods.chain_assembly import AssemblyEquilibria, settle

MODEL = """<mujoco><compiler angle="radian"/>
  <option gravity="0 0 0" timestep="1e-3" integrator="implicitfast" tolerance="1e-12"
    jacobian="dense">
    <flag contact="disable"/></option>
  <default><equality solref="0.002 1" solimp="0.9999 0.9999 0.001"/></default>
  <worldbody><site name="ground"/>{sites}{platform}</worldbody>
  <actuator><motor site="{hand}" refsite="ground" gear="{load}"/></actuator>
  <keyframe><key name="start" qpos="{pose}" ctrl="1"/></keyframe></mujoco>"""
CARRIER = '<inertial pos="0 0 0" mass="1e-6" diaginertia="1e-6 1e-6 1e-6"/>'
PLATFORM = f"""<body><joint name="x" type="slide" axis="1 0 0"/>{CARRIER}
  <body><joint name="y" type="slide" axis="0 1 0"/>{CARRIER}
  <body name="platform"><joint name="phi"/>{CARRIER}
  <site name="hand"/>{{pins}}</body></body></body>"""
PHASE_OF_STEP = 0.05  # [rad] phase of the swing of a single spring in a step
ROD_MASS = 1e-6  # [kg] small, because the joints have armature instead
STEPS_OF_BLOCK, MAX_STEPS = 100, 100_000  # steps between two checks of the speed, and in all
REST_SPEED = 1e-6  # [rad/s] of the fastest joint at rest: 1e-9 rad in a step
ITERATIONS = 100  # of Chipmunk in a step
MAX_TURN, JOINT_NOISE = 2.0 * np.pi, 0.25  # [rad] of random starts: turn of a rod, spread of joints
MAX_POSE_DISTANCE = 0.05  # [m, rad] between the equilibria of a rod and of its chain
MAX_ALPHA = 20.0  # L sqrt(R/EI): larger loads need loops that chains of 20 links do not have
SAME_ANGLE = 1e-4  # [rad] largest difference of all links of one equilibrium


@dataclass(frozen=True)
class Scene:
    """Rods of n links on a pin or a platform, and the equilibria that they have.

    Attributes
    ----------
    found : Solutions
        Equilibria of the rods, the lowest energy first.
    standing : AssemblyEquilibria (equilibria,)
        Equilibria of the chains near them; NaN where there is none.
    """

    a: Assembly
    n: int
    found: Solutions
    standing: AssemblyEquilibria

    @cached_property
    def chains(self) -> list[Chain]:
        """The rods' links; their tips are pinned to the first one's tip, or to the platform."""
        pin = self.a.dof == 2
        turn = self.found.state.shape([1.0])[2][0, :, 0] - clamps_and_forces(self.found.state)[0][0]
        ends = [
            None if pin and not i else "rod0.tip" if pin else f"pin{i}" for i in range(self.a.rods)
        ]
        return [
            chain(
                Rod(
                    f"rod{i}",
                    f"clamp{i}",
                    end,
                    float(self.a.length[i]),
                    float(self.a.stiffness[i]),
                    self.n,
                    ("clamped", "pinned" if end else "free"),
                    mass=ROD_MASS,
                    turn=float(turn[i]),
                )
            )
            for i, end in enumerate(ends)
        ]

    @cached_property
    def model(self) -> mujoco.MjModel:
        """The compiled model; its start pose is near the lowest equilibrium."""
        theta, place, _ = (part[0] for part in clamps_and_forces(self.found.state))
        sites = [
            f'<site name="clamp{i}" pos="{p.real} {p.imag} 0" euler="0 0 {t}"/>'
            for i, (t, p) in enumerate(zip(theta, place, strict=True))
        ]
        load, pin = self.found.state.load[0], self.a.dof == 2
        pins = "".join(
            f'<site name="pin{i}" pos="{r.real} {r.imag} 0"/>' for i, r in enumerate(self.a.arm)
        )
        gear = [*load[:2], 0, 0, 0, 0.0 if pin else load[2]]
        spec = mujoco.MjSpec.from_string(
            MODEL.format(
                sites="".join(sites),
                platform="" if pin else PLATFORM.format(pins=pins),
                hand="rod0.tip" if pin else "hand",
                load=" ".join(map(str, gear)),
                pose="" if pin else " ".join(map(str, self.found.state.pose[0])),
            )
        )
        return compile_with_rods(spec, [one.rod for one in self.chains])

    @cached_property
    def weighed(self) -> mujoco.MjModel:
        """MuJoCo's model: every spring by itself swings equally fast and is critically damped."""
        model = copy.copy(self.model)
        pace = PHASE_OF_STEP / model.opt.timestep
        own = np.where(model.jnt_stiffness > 0, model.jnt_stiffness, self.a.stiffness.mean())
        model.dof_armature[:] = own / pace**2
        model.dof_damping[:] = 2.0 * own / pace
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def pose(self, angles: Array, platform: Array) -> Array:
        """Joint values for links' angles (k, n) [rad] and, if there is one, a platform's pose."""
        theta, qpos = clamps_and_forces(self.found.state)[0][0], np.zeros(self.model.nq)
        for i, one in enumerate(self.chains):
            joints = [self.model.joint(name).qposadr[0] for name in one.names[1:]]
            qpos[joints] = np.diff(angles[i], prepend=theta[i])
        for name, value in zip(("x", "y", "phi"), platform, strict=False):
            if self.a.dof == 3:
                qpos[self.model.joint(name).qposadr[0]] = value
        return qpos

    def random(self, seed: int) -> Array:
        """Joint values of closed loops: arcs that turn by up to MAX_TURN, with noise in joints."""
        dice, theta = np.random.default_rng(seed), clamps_and_forces(self.found.state)[0][0]
        while True:
            bends = dice.uniform(-MAX_TURN, MAX_TURN, (self.a.rods, 1)) / self.n
            bends = bends + dice.normal(0.0, JOINT_NOISE, (self.a.rods, self.n))
            platform = dice.uniform(-1.0, 1.0, 3) * [0.5, 0.5, np.pi]
            closed = self.closed(self.pose(theta[:, None] + np.cumsum(bends, axis=1), platform))
            if closed is not None:
                return closed

    def nudged(self, k: int, seed: int, size: float = 1e-3) -> Array:
        """Joint values near equilibrium k: every link is rotated by noise of this size [rad]."""
        noise = np.random.default_rng(seed).normal(0.0, size, self.standing.angle[k].shape)
        closed = self.closed(self.pose(self.standing.angle[k] + noise, self.standing.pose[k]))
        if closed is None:
            raise Diverged("loops that cannot be closed")
        return closed

    def closed(self, qpos: Array) -> Array | None:
        """The joint values with the least change that close the loops; None if they stay open."""
        data = mujoco.MjData(self.model)
        data.qpos[:] = qpos
        data.qpos[:] = start_pose(StartOfModel(SmoothTerms(self.model), qpos), np.zeros(0))
        mujoco.mj_kinematics(self.model, data)
        return data.qpos.copy() if loop_violations(self.model, data).max() < 1e-9 else None

    def angles(self, qpos: Array) -> Array:
        """Angles of the links (k, n) [rad]."""
        theta = clamps_and_forces(self.found.state)[0][0]
        return np.array(
            [
                t + np.cumsum([qpos[self.model.joint(name).qposadr[0]] for name in one.names[1:]])
                for t, one in zip(theta, self.chains, strict=True)
            ]
        )

    def which(self, angles: Array) -> tuple[int, AssemblyEquilibria, float]:
        """The number of the nearest equilibrium or -1, that of the chain, the distance [rad]."""
        inputs, load = self.found.state.inputs[0], np.append(self.found.state.load[0], 0.0)
        own = settle(self.a, inputs, seed=angles, segments=self.n, force=load[:2], moment=load[2])
        if np.isnan(own.energy):
            raise Diverged("no equilibrium of the chain is near")
        off = np.abs(self.standing.angle - own.angle).max(axis=(1, 2))
        k = int(np.nanargmin(off))
        return k if off[k] < SAME_ANGLE else -1, own, float(np.abs(angles - own.angle).max())


def scene(a: Assembly, given: dict[str, Sequence[float]], modes: int, n: int) -> Scene:
    """A problem with all its equilibria up to a mode, in chains of n links."""
    found = solutions(a, modes=modes, most_load=MAX_ALPHA, **given)
    load = np.append(given["load"], 0.0)
    inputs = np.broadcast_to(given["inputs"], a.rods)
    angles = found.state.shape(np.arange(1, n + 1) / n)[2]
    standing = settle(a, inputs, seed=angles, segments=n, force=load[:2], moment=load[2])
    far = ~(np.abs(standing.pose - found.state.pose).max(axis=1) < MAX_POSE_DISTANCE)
    # The links of these chains are too long for the waves of the rod.
    standing.angle[far] = standing.energy[far] = np.nan
    return Scene(a, n, found, standing)


def mujoco_rest(scene: Scene, qpos: Array) -> Array:
    """The links' angles at which MuJoCo's steps come to rest."""
    model, data = scene.weighed, mujoco.MjData(scene.weighed)
    data.qpos[:], data.ctrl[:] = qpos, 1.0
    for _ in range(STEPS_OF_BLOCK, MAX_STEPS, STEPS_OF_BLOCK):
        mujoco.mj_step(model, data, STEPS_OF_BLOCK)
        if failure_warning(data):
            raise Diverged("MuJoCo gave up")
        if np.abs(data.qvel).max() < REST_SPEED:
            return scene.angles(data.qpos)
    raise Diverged(f"not at rest after {MAX_STEPS} steps")


def pymunk_rest(scene: Scene, qpos: Array) -> Array:
    """The links' angles at which Chipmunk's steps come to rest.

    Links have the moments of inertia with which stiff springs swing half a radian in a step, and
    springs the damping in proportion that is critical for the slowest of a rod's swings.
    """
    model, dt = copy.copy(scene.model), scene.model.opt.timestep
    model.dof_damping[:] = 4.0 * scene.n * dt * model.jnt_stiffness
    model.key_qpos[0] = qpos
    links = read_links(model, "start", ())
    space = build_space(links, ITERATIONS, 0.0)
    moving = space.bodies
    for body in moving:
        body.moment = 16.0 * model.jnt_stiffness.max() * dt**2
    for _ in range(STEPS_OF_BLOCK, MAX_STEPS, STEPS_OF_BLOCK):
        for _ in range(STEPS_OF_BLOCK):
            space.step(dt)
        if max(abs(body.angular_velocity) for body in moving) < REST_SPEED:
            pose = np.array([[*body.position, body.angle] for body in moving] + [[0.0] * 3])
            theta = clamps_and_forces(scene.found.state)[0][0]
            return np.array(
                [
                    t + np.cumsum(rod_shape(links, pose, one)[2][1:])
                    for t, one in zip(theta, scene.chains, strict=True)
                ]
            )
    raise Diverged(f"not at rest after {MAX_STEPS} steps")


ENGINES = {"mujoco": mujoco_rest, "pymunk": pymunk_rest}
