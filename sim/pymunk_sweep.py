"""Quasi-static sweep: hold the drive, let Chipmunk come to rest, read poses, rates and the motor.

With all velocity taken out in every step, a step of Chipmunk is one Newton step of the holds in
the metric of the masses, so a linkage without free coordinates rests after a few of them.  Free
coordinates (springs, hanging bodies) sink to rest under critical damping.
"""

import time
from dataclasses import dataclass

import numpy as np
import pymunk
from pymunk import batch

from sim.protocol import Array, Curves, Diverged, Run, Unsupported
from sim.pymunk_close import along, close, gaps, joint_value
from sim.pymunk_links import Joint, Links
from sim.pymunk_read import Channel, kinetic, unwrapped
from sim.pymunk_rest import free_directions, pace
from sim.pymunk_space import FIELDS, Carriage, Motor, Settings, add_motor, build, put, taken

MOVE = 0.05
"""Largest move of the drive [rad, or extents] between two rests."""
STILL = 1e-12
"""Largest remaining move in a step, in extents, that counts as rest at a sample."""
ROUGH = 1e-6
"""The same between samples, where the pose only has to stay on its branch."""
MOST = 20000
"""Steps after which a pose that still moves is given up."""
NO_ACC = "Chipmunk has no inverse dynamics: no accelerations in a sweep"
NO_FORCE = "in Chipmunk a driven slide shares its load with the guide"
NO_RATE = "Chipmunk gives no quasi-static rates of coordinates that springs or gravity hold"


@dataclass
class Held:
    """A space whose drive is held: the state of a sweep between its samples."""

    links: Links
    joint: Joint
    space: pymunk.Space
    motor: Motor
    dt: float
    free: bool
    pose: Array
    velocity: Array
    keep: float = 0.0

    def step(self, rate: float) -> None:
        """One engine step with the drive at a rate [rad/s]; keeps the state it leaves.

        The bodies move on with their velocity and `keep` a share of it.  Chipmunk's own damping
        would not do: it acts after the springs' impulses and weakens them.
        """
        self.motor.rate = self.joint.sign * rate
        kept = self.keep * self.velocity
        put(self.space, self.pose + self.dt * (self.velocity - kept), kept)
        self.space.step(self.dt)
        buffer = batch.Buffer()
        batch.get_space_bodies(self.space, FIELDS, buffer)
        (self.pose,), (self.velocity,) = taken(buffer, self.links)

    def stop(self) -> None:
        """Take all velocity out without moving."""
        self.velocity = np.zeros_like(self.velocity)

    def settle(self, value: float, still: float = STILL) -> None:
        """Step until nothing moves and the drive has its value."""
        calm, scale = 0, self.links.extent
        for count in range(MOST):
            if self.free and count % 200 == 0:
                self.dt, self.keep = pace(self.links, self.joint, self.pose)
            ahead = float(joint_value(self.joint, self.pose + self.dt * self.velocity))
            self.step((value - ahead) / self.dt)
            moved = np.abs(self.velocity).max() * self.dt / scale
            if not np.isfinite(moved):
                break
            calm = calm + 1 if moved < still else 0
            if calm > 2:
                return
        gap = gaps(self.links, self.pose).max()
        raise Diverged(f"drive at {value:.4g}: not at rest after {count + 1} steps, "
                       f"loops open by {gap:.3g} m")

    def effort(self) -> float:
        """The drive's moment [N m] about the joint's axis, in a pose at rest.

        Chipmunk tells only the size of an impulse.  Its sign is found by letting the drive go for
        one step: the joint falls the way that the motor held it back from.
        """
        self.stop()
        self.step(0.0)
        assert isinstance(self.motor, pymunk.SimpleMotor)
        size = self.motor.impulse / self.dt
        self.stop()
        self.motor.max_force = 0.0
        self.step(0.0)
        falls = along(lambda p: joint_value(self.joint, p), self.pose, self.velocity)
        self.motor.max_force = float("inf")
        self.stop()
        return -float(np.sign(falls)) * size

    def rates(self, rate: float) -> Array:
        """The engine's velocities (links + 1, 3) for a rate of the drive, in a pose at rest."""
        for _ in range(MOST):
            last = self.velocity
            self.stop()
            self.step(rate)
            if np.abs(self.velocity - last).max() < STILL * np.abs(self.velocity).max():
                break
        velocity = self.velocity
        self.stop()
        return velocity


def sweep(links: Links, run: Run, driven: int, channels: dict[str, Channel],
          settings: Settings) -> Curves:
    """Hold the drive at each sample until rest; see `sim.with_pymunk.simulate`."""
    if run.drive is None:
        raise Unsupported("a sweep without a driven joint")
    began = time.perf_counter()
    value, rate, _ = (np.asarray(v, float) * np.ones(len(run.x)) for v in run.drive.law(run.x))
    held = _held(links, links.joints[driven], float(value[0]), settings)
    missing = {name: NO_ACC for name, c in channels.items() if c.order == 2}
    if isinstance(held.motor, Carriage):
        missing |= {name: NO_FORCE for name, c in channels.items() if c.order == -2}
    if held.free:
        missing |= {name: NO_RATE for name, c in channels.items() if c.order in (1, -1)}
    wanted = {name: c for name, c in channels.items() if name not in missing}
    orders = {c.order for c in wanted.values()}
    poses, speeds, efforts = [], [], []
    for target, speed in zip(value.tolist(), rate.tolist(), strict=True):
        _move(held, target)
        poses.append(held.pose)
        efforts.append(held.effort() if -2 in orders else 0.0)
        speeds.append(held.rates(speed) if orders & {1, -1} else np.zeros_like(held.pose))
    pose, velocity = np.array(poses), np.array(speeds)
    curves = {name: unwrapped(name, _curve(c, links, pose, velocity, np.array(efforts)))
              for name, c in wanted.items()}
    drive = (joint_value(held.joint, pose), rate, np.asarray(run.drive.law(run.x)[2], float))
    return Curves(run.x, curves, missing, drive, float(gaps(links, pose).max()),
                  time.perf_counter() - began, len(run.x),
                  {k: v for k, v in settings.items() if k != "timestep"})


def _held(links: Links, joint: Joint, value: float, settings: Settings) -> Held:
    """The space at rest with the drive at its first value."""
    pose = close(links, links.pose, (joint, value))
    space = build(links, settings["iterations"], settings["error_bias"])
    motor = add_motor(space, links, joint)
    free = free_directions(links, joint, pose).shape[1] > 0
    # at this step gravity and a gap of rounding size make equal noise
    weight = float(np.linalg.norm(links.gravity))
    dt = float(np.sqrt(links.extent / weight)) if weight else 1.0
    return Held(links, joint, space, motor, dt, free, pose, np.zeros_like(pose))


def _move(held: Held, target: float) -> None:
    now = float(joint_value(held.joint, held.pose))
    most = MOVE if held.joint.hold.axis is None else MOVE * held.links.extent
    for value in np.linspace(now, target, int(abs(target - now) / most) + 2)[1:-1]:
        held.settle(float(value), ROUGH)
    held.settle(target)


def _curve(c: Channel, links: Links, pose: Array, velocity: Array, effort: Array) -> Array:
    if c.order == -2:
        return effort * c.factor
    if c.order == -1:
        return kinetic(links, velocity)
    return c.function(pose) if c.order == 0 else along(c.function, pose, velocity)
