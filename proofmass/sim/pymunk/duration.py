"""A motion in time: as many iterations as it needs, and its curves and drive state."""

import time

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Curves, Diverged, Run
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.patience import enough
from proofmass.sim.pymunk.pose import gaps, values
from proofmass.sim.pymunk.read import Channel, kinetic, moving, unwrapped
from proofmass.sim.pymunk.space import Settings
from proofmass.sim.pymunk.steps import States, stepped

LOST = 0.1
"""Gap, as a share of the mechanism's extent, beyond which a run is lost."""
USUAL, MOST = 100, 3000
"""Iterations of a step: at first, and at most."""
LEFT = 0.1
"""Share of an error that they may leave; the next step starts from there."""
LOOKED_AT = 40
"""Poses at which the iterations needed are found."""


def duration(links: Links, run: Run, channels: dict[str, Channel], settings: Settings) -> Curves:
    """Step a mechanism through time; see `proofmass.sim.pymunk.engine.simulate`.

    Without a given number of iterations the run is repeated with what its poses need.
    """
    began = time.perf_counter()
    per, dt = run.steps(settings["timestep"])
    used = {**settings, "timestep": dt, "iterations": settings["iterations"] or USUAL}
    states = stepped(links, run, per, used)
    if settings["iterations"] is None and (needed := _needed(links, states[0])) > USUAL:
        used["iterations"] = needed
        states = stepped(links, run, per, used)
    gap = _checked(links, states[0], run.x)
    curves = {name: unwrapped(name, _curve(links, c, states, dt)) for name, c in channels.items()}
    steps = (len(run.x) - 1) * per + 1
    return Curves(run.x, curves, {}, _drive_state(links, states, dt), gap,
                  time.perf_counter() - began, steps, used)


def _needed(links: Links, pose: Array) -> int:
    if _lost(links, pose)[1].any():
        return MOST
    return min(enough(links, pose[:: len(pose) // LOOKED_AT + 1], LEFT), MOST)


def _drive_state(links: Links, states: States, dt: float) -> tuple[Array, Array, Array] | None:
    def value(pose: Array) -> Array:
        return values(links.drives, pose)

    if not links.drives:
        return None
    place, rate, acceleration = (moving(value, order, *states, dt).T for order in (0, 1, 2))
    return place, rate, acceleration


def _lost(links: Links, pose: Array) -> tuple[Array, Array]:
    """Largest gap [m] of each pose, and where it or anything else says that the run was lost."""
    with np.errstate(all="ignore"):
        gap = gaps(links, pose).max(axis=-1)
    return gap, ~(np.isfinite(pose).all(axis=(1, 2)) & (gap <= LOST * links.extent))


def _checked(links: Links, pose: Array, x: Array) -> float:
    gap, lost = _lost(links, pose)
    if lost.any():
        k = int(np.argmax(lost))
        raise Diverged(f"lost at time {x[k]:.4g} s: the loops are open by {gap[k]:.3g} m")
    return float(gap.max())


def _curve(links: Links, c: Channel, states: States, dt: float) -> Array:
    if c.order == -1:
        return kinetic(links, 0.5 * (states[1] + states[2]))
    return moving(c.function, c.order, *states, dt)
