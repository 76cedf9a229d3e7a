"""Time stepping in Chipmunk, read at the samples and one step before them."""

import time

import numpy as np
import pymunk
from pymunk import batch

from sim.protocol import Array, Curves, Diverged, Run
from sim.pymunk_close import close, gaps, joint_value
from sim.pymunk_links import Links
from sim.pymunk_read import Channel, kinetic, moving, unwrapped
from sim.pymunk_space import FIELDS, Motor, Settings, add_motor, build, put, taken
from sim.pymunk_start import start_motion, step_back

SURE = 3000
"""Iterations of the first step: Chipmunk starts from the last step's impulses, and has none."""
LOST = 0.1
"""Gap, as a share of the mechanism's extent, beyond which a run is lost."""


def duration(links: Links, run: Run, driven: int, channels: dict[str, Channel],
             settings: Settings) -> Curves:
    """Step a mechanism through time; see `sim.with_pymunk.simulate`."""
    began = time.perf_counter()
    per, dt = run.steps(settings["timestep"])
    space, motor, rates, back = prepared(links, run, driven, dt, per, settings)
    record = np.zeros(len(rates), bool)
    record[::per] = record[per - 1::per] = True
    buffer = batch.Buffer()
    step_through(space, dt, motor, rates, record, buffer, SURE)
    states = at_samples(*taken(buffer, links), record, per, back)
    gap = _checked(links, states[0], run.x)
    curves = {name: unwrapped(name, _curve(links, c, states, dt)) for name, c in channels.items()}
    drive = None
    if motor is not None:
        def value(pose: Array) -> Array:
            return joint_value(links.joints[driven], pose)
        drive = (value(states[0]), moving(value, 1, *states, dt), moving(value, 2, *states, dt))
    return Curves(run.x, curves, {}, drive, gap, time.perf_counter() - began, len(rates),
                  {**settings, "timestep": dt})


def prepared(links: Links, run: Run, driven: int, dt: float, per: int,
             settings: Settings
             ) -> tuple[pymunk.Space, Motor | None, Array, Array]:
    """The space one step before the start, its motor, a rate for each step, the velocity then."""
    space = build(links, settings["iterations"], settings["error_bias"])
    steps = (len(run.x) - 1) * per
    if run.drive is None:
        pose = close(links, links.pose)
        motion = start_motion(links, pose, None)
        motor, rates, back = None, np.zeros(steps + 1), None
    else:
        joint = links.joints[driven]
        value, rate, acc = (np.asarray(v, float) for v in
                            run.drive.law(run.x[0] + dt * np.arange(steps + 1)))
        value = _one_more(value, acc, dt)
        pose = close(links, links.pose, (joint, value[1]))
        motion = start_motion(links, pose, (joint, rate[0], acc[0]))
        motor = add_motor(space, links, joint)
        rates, back = joint.sign * np.diff(value)[1:] / dt, (joint, value[0], value[1])
    pose, velocity = step_back(links, pose, motion, dt, back)
    put(space, pose, velocity)
    return space, motor, rates, velocity


def _one_more(value: Array, acc: Array, dt: float) -> Array:
    """Law values with one step more at both ends, so that central differences reach the ends."""
    if len(value) < 2:
        return np.array([value[0], value[0], value[0]])
    first = 2 * value[0] - value[1] + dt**2 * acc[0]
    last = 2 * value[-1] - value[-2] + dt**2 * acc[-1]
    return np.concatenate([[first], value, [last]])


def step_through(space: pymunk.Space, dt: float, motor: Motor | None,
                 rates: Array, record: Array, buffer: batch.Buffer, first: int) -> None:
    """Step once for each rate, and append the state of all bodies after the marked steps.

    The first step, which is marked, takes `first` iterations.
    """
    step, read = space.step, batch.get_space_bodies
    usual, space.iterations = space.iterations, first
    for rate, wanted in zip(rates.tolist(), record.tolist(), strict=True):
        if motor:
            motor.rate = rate
        step(dt)
        if wanted:
            read(space, FIELDS, buffer)
            if first:
                space.iterations, first = usual, 0


def at_samples(pose: Array, velocity: Array, record: Array, per: int,
               back: Array) -> tuple[Array, Array, Array]:
    """Pose, velocity before and velocity after each sample, from the recorded steps."""
    place = np.cumsum(record) - 1
    samples = np.arange(0, len(record), per)
    before = np.concatenate([back[None], velocity[place[samples[1:] - 1]]])
    return pose[place[samples]], before, velocity[place[samples]]


def _checked(links: Links, pose: Array, x: Array) -> float:
    with np.errstate(all="ignore"):
        gap = gaps(links, pose).max(axis=-1)
    lost = ~(np.isfinite(pose).all(axis=(1, 2)) & (gap <= LOST * links.extent))
    if lost.any():
        k = int(np.argmax(lost))
        raise Diverged(f"lost at time {x[k]:.4g} s: the loops are open by {gap[k]:.3g} m")
    return float(gap.max())


def _curve(links: Links, c: Channel, states: tuple[Array, Array, Array], dt: float) -> Array:
    if c.order == -1:
        return kinetic(links, 0.5 * (states[1] + states[2]))
    return moving(c.function, c.order, *states, dt)
