"""Quasi-static sweep: hold the drives at each sample until rest, read poses, rates and efforts."""

import time

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadModel, Curves, Run, Unsupported
from proofmass.sim.pymunk.close import named, stages
from proofmass.sim.pymunk.held import ROUGH, Held, hold
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.pose import along, gaps, values
from proofmass.sim.pymunk.read import Channel, kinetic, unwrapped
from proofmass.sim.pymunk.space import Settings

NO_ACC = "Chipmunk has no inverse dynamics: no accelerations in a sweep"
NO_RATE = "Chipmunk gives no quasi-static rates of coordinates that springs or gravity hold"


def sweep(links: Links, run: Run, channels: dict[str, Channel], settings: Settings) -> Curves:
    """Hold the drives at each sample until rest; see `proofmass.sim.pymunk.engine.simulate`.

    Where the loops cannot be closed any further the sweep stops and keeps what it has.
    """
    if not run.drives:
        raise Unsupported("a sweep without a driven joint")
    began = time.perf_counter()
    laws = np.array([[curve * np.ones(len(run.x)) for curve in drive.law(run.x)]
                     for drive in run.drives])  # drives, (value, rate, acceleration), samples
    held = hold(links, settings)
    missing = {name: NO_ACC for name, c in channels.items() if c.order == 2}
    if held.free:
        missing |= {name: NO_RATE for name, c in channels.items() if c.order in (1, -1)}
    wanted = {name: c for name, c in channels.items() if name not in missing}
    read, stopped = _follow(held, laws, {c.order for c in wanted.values()})
    pose, velocity, effort = (np.array(part) for part in zip(*read, strict=True))
    curves = {name: unwrapped(name, _curve(c, links, pose, velocity, effort))
              for name, c in wanted.items()}
    n = len(pose)
    state = (values(links.drives, pose).T, laws[:, 1, :n], laws[:, 2, :n])
    return Curves(run.x[:n], curves, missing, state, float(gaps(links, pose).max()),
                  time.perf_counter() - began, n,
                  {"iterations": held.most, "error_bias": settings["error_bias"]},
                  stopped, derivatives=0 if held.free else 1)


def _follow(held: Held, laws: Array, orders: set[int]
            ) -> tuple[list[tuple[Array, Array, Array]], str]:
    """Pose, velocity and efforts at each sample, and why the last ones could not be reached."""
    read: list[tuple[Array, Array, Array]] = []
    for value, rate in zip(laws[:, 0].T, laws[:, 1].T, strict=True):
        try:
            _move(held, value)
        except BadModel as error:
            if len(read) < 2:
                raise
            last = named(held.links, laws[:, 0, len(read) - 1])
            return read, f"stopped at {last}: {error}"
        pose = held.pose
        effort = held.efforts() if -2 in orders else np.zeros(len(value))
        velocity = held.rates(rate) if orders & {1, -1} else np.zeros_like(pose)
        read.append((pose, velocity, effort))
    return read, ""


def _move(held: Held, target: Array) -> None:
    *between, _ = stages(held.links, values(held.links.drives, held.pose), target)
    for stage in between:
        held.settle(stage, ROUGH)
    held.settle(target)


def _curve(c: Channel, links: Links, pose: Array, velocity: Array, effort: Array) -> Array:
    if c.order == -2:
        return effort[:, c.drive] * c.factor
    if c.order == -1:
        return kinetic(links, velocity)
    return c.function(pose) if c.order == 0 else along(c.function, pose, velocity)
