"""The engine pymunk (Chipmunk): runs a planar MJCF that MuJoCo has compiled."""

from dataclasses import replace
from pathlib import Path
from typing import cast

from pymunk import Space

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.support import left_out
from proofmass.sim.mjcf import collected_warnings, warning_notes
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.object_run import ObjectRun
from proofmass.sim.protocol.part import LoadedPart
from proofmass.sim.protocol.run import Run
from proofmass.sim.pymunk.dynamics import dynamics
from proofmass.sim.pymunk.model import find_channels, read_model
from proofmass.sim.pymunk.own_space import record_space
from proofmass.sim.pymunk.quasi_static import equilibrium, sweep
from proofmass.sim.pymunk.settings import ACCURACY, CONTACT_SETTINGS, SPACE_SETTINGS, PymunkSettings
from proofmass.sim.pymunk.support import SUPPORT


def simulate(model: Path, run: Run) -> Curves:
    """Run a planar mechanism in pymunk.

    Drives are ideal: constraints whose target is set to the next value of the motion profile before
    each step.  Motors on other joints act with the constant force of their ``ctrl`` in the start
    key, or with a force that changes along the run, see `proofmass.sim.pymunk.loads`.  Joint
    springs may be polynomials.  Joint limits are exact to 1e-13 rad in a sweep and soft in
    dynamics.

    Loads are motors on sites, constant in the frame of a refsite on the ground, or in the frame of
    the site if there is no refsite.

    In a sweep the degrees of freedom that the drives leave are in static equilibrium at each
    sample, and the equilibria follow each other from the start key on.  In an equilibrium run they
    come to rest with the drives fixed.  The engine decides whether a pose is at rest: its own step
    from standstill must give no velocity.  proofmass computes a stiffness and chooses by it how far
    to move along the engine's velocity, since Chipmunk itself comes to rest no faster than it
    swings.

    Springs and dampers may act between two sites.  In dynamics geoms touch where MuJoCo lets them,
    with MuJoCo's friction; see `proofmass.sim.pymunk.contacts`.

    The method is of second order in time.  Dampers follow the midpoint rule, with the setting
    `midpoint_damping` false they are Chipmunk's own, of first order.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        What to do; see `proofmass.sim.protocol.run.Run`.  Settings, with proofmass's values where
        none are given: ``timestep`` [s], that of the model, reduced so that whole steps fit between
        samples (a sweep does not use it); ``iterations`` of the solver in a step, 100 in dynamics,
        in a sweep the number that the start pose needs, up to 500, or 500 where the drives leave
        degrees of freedom, and in all cases more where poses of the run need them; ``error_bias``,
        the share of a constraint violation that is left after a second, 0; ``collision_slop`` [m]
        and ``collision_bias`` of contacts, 1e-6 and 0.9**60; ``defaults = True`` for Chipmunk's own
        values.

    Returns
    -------
    Curves
        The channels over ``run.x``, the actual state of the drives, the largest constraint
        violation and the cost.  A sweep ends where the loops cannot be closed any further, or where
        a joint limit is in the way, and gives this reason.

    Raises
    ------
    BadModel
        The model does not compile, lacks a named element, or its start pose is not assembled.
    Unsupported
        The model contains something that this engine does not cover; the message names it.
    Diverged
        The run failed.
    """
    with collected_warnings() as warned:
        links, settings = read_model(model, run)
    wanted, missing = find_channels(links, run)
    act = {"sweep": sweep, "equilibrium": equilibrium, "dynamics": dynamics}[run.kind]
    curves = act(links, run, wanted, settings)
    curves.missing.update(missing)
    return replace(
        curves,
        notes=(
            *curves.notes,
            *left_out(read_compiled(links.model), SUPPORT),
            *warning_notes(links.model, warned),
        ),
    )


class Pymunk(Engine):
    """pymunk as an engine of proofmass; see `proofmass.sim.protocol.engine.Engine`."""

    title = "pymunk"
    packages = ("pymunk",)
    settings = PymunkSettings
    chooses = (*SPACE_SETTINGS, *CONTACT_SETTINGS)
    planar = True
    accuracy = ACCURACY
    support = SUPPORT
    tuning = LoadedPart("proofmass.sim.pymunk.tried_settings:PymunkTuning")
    theory = LoadedPart("proofmass.sim.pymunk.theory:PymunkTheory")
    programs = LoadedPart("proofmass.sim.pymunk.program:PymunkPrograms")

    def simulate(self, model: Path, run: Run) -> Curves:
        """See `simulate`."""
        return simulate(model, run)

    def at_version(self, number: str) -> Engine:
        """pymunk in another version, stepped plainly; see `Engine.at_version`."""
        from proofmass.sim.hosts.engines import PYMUNK  # what only other versions need

        return PYMUNK.at_version(number)

    def owns(self, thing: object) -> bool:
        """Whether something is a ``Space``."""
        return isinstance(thing, Space)

    def record(self, thing: object, run: ObjectRun) -> Curves:
        """See `proofmass.sim.pymunk.own_space.record_space`."""
        return record_space(cast(Space, thing), run)


ENGINE = Pymunk()
