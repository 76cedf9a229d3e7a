"""Chipmunk's steps, from one before the start on, recorded at the samples and just before them."""

import numpy as np
import pymunk
from pymunk import batch

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Run
from proofmass.sim.pymunk.close import close
from proofmass.sim.pymunk.drive import Motor, add_drives, aim
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.space import FIELDS, Settings, build, put, taken
from proofmass.sim.pymunk.start import start_motion, step_back

SURE = 3000
"""Least iterations of the first step: Chipmunk starts from the last step's impulses, and has none.
Ten times those of the others, if these are more."""
States = tuple[Array, Array, Array]
"""Pose at each sample, velocity over the step before it and over the step after it."""


def stepped(links: Links, run: Run, per: int, settings: Settings) -> States:
    """Step through a run with `per` steps from sample to sample."""
    space, drives, targets, back = prepared(links, run, per, settings)
    record = np.zeros(len(targets), bool)
    record[::per] = record[per - 1::per] = True
    buffer = batch.Buffer()
    first = max(SURE, 10 * settings["iterations"])
    step_through(space, settings["timestep"], drives, targets, record, buffer, first)
    return at_samples(*taken(buffer, links), record, per, back)


def prepared(links: Links, run: Run, per: int, settings: Settings
             ) -> tuple[pymunk.Space, list[Motor], Array, Array]:
    """The space one step before the start, its drives, their values after each step (steps,
    drives), and the velocity before the start."""
    space = build(links, settings["iterations"], settings["error_bias"])
    pose, velocity, targets = start_state(links, run, per, settings["timestep"])
    put(space, pose, velocity)
    return space, add_drives(space, links), targets, velocity


def start_state(links: Links, run: Run, per: int, dt: float) -> tuple[Array, Array, Array]:
    """Pose (links + 1, 3) one step before the start, velocity from there to the start, and the
    values of the drives after each step (steps, drives)."""
    times = run.x[0] + dt * np.arange((len(run.x) - 1) * per + 1)
    laws = np.zeros((3, len(times), len(run.drives)))
    for k, drive in enumerate(run.drives):
        for part, curve in zip(laws, drive.law(times), strict=True):
            part[:, k] = curve
    value, rate, acc = laws
    value = _one_more(value, acc, dt)
    pose = close(links, links.pose, value[1])
    motion = start_motion(links, pose, rate[0], acc[0])
    pose, velocity = step_back(links, pose, motion, dt, value[:2])
    return pose, velocity, value[2:]


def _one_more(value: Array, acc: Array, dt: float) -> Array:
    """Law values with one step more at both ends, so that central differences reach the ends."""
    if len(value) < 2:
        return np.repeat(value, 3, axis=0)
    first = 2 * value[0] - value[1] + dt**2 * acc[0]
    last = 2 * value[-1] - value[-2] + dt**2 * acc[-1]
    return np.vstack([first, value, last])


def step_through(space: pymunk.Space, dt: float, drives: list[Motor], targets: Array,
                 record: Array, buffer: batch.Buffer, first: int) -> None:
    """Step once for each row of targets, and append all bodies' state after the marked steps.

    The first step, which is marked, takes `first` iterations.
    """
    step, read = space.step, batch.get_space_bodies
    usual, space.iterations = space.iterations, first
    for target, wanted in zip(targets.tolist(), record.tolist(), strict=True):
        aim(drives, target)
        step(dt)
        if wanted:
            read(space, FIELDS, buffer)
            if first:
                space.iterations, first = usual, 0


def at_samples(pose: Array, velocity: Array, record: Array, per: int,
               back: Array) -> States:
    """The states at the samples, from the recorded steps and the velocity before the first."""
    place = np.cumsum(record) - 1
    samples = np.arange(0, len(record), per)
    before = np.concatenate([back[None], velocity[place[samples[1:] - 1]]])
    return pose[place[samples]], before, velocity[place[samples]]
