"""The engine pymunk (Chipmunk): runs a planar MJCF that MuJoCo has compiled."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.support import left_out
from proofmass.sim.mjcf import collected_warnings, warning_notes
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.programs import Imposed, sidecar_instructions
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import ParameterValues
from proofmass.sim.protocol.tuning import Perturbation, Recipe, Scan, Studied
from proofmass.sim.pymunk import tried_settings
from proofmass.sim.pymunk.dynamics import MIN_FIRST_ITERATIONS, dynamics
from proofmass.sim.pymunk.model import find_channels, read_model
from proofmass.sim.pymunk.program import IMPOSED as IMPOSED
from proofmass.sim.pymunk.program import write_program as write_program
from proofmass.sim.pymunk.quasi_static import equilibrium, sweep
from proofmass.sim.pymunk.settings import ACCURACY, PymunkSettings
from proofmass.sim.pymunk.support import SUPPORT

SPACE_SETTINGS = ("timestep", "iterations", "error_bias")
CONTACT_SETTINGS = ("collision_slop", "collision_bias")


def check_settings(settings: Mapping[str, object]) -> None:
    """Raise `BadSetting` if a setting is unknown or out of range."""
    PymunkSettings.read(settings)


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

    The method is of second order in time, except for dampers, which are of first order in Chipmunk.

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


def snippet(parameters: ParameterValues, steps: int) -> str:
    """Lines of Python that step a pymunk space with given settings.

    Settings that pymunk does not have are added as comments; the lines are comments only if the
    time step, the iterations or the bias is missing.
    """
    own = list(stepping_lines(parameters, steps)) if set(parameters) >= set(SPACE_SETTINGS) else []
    return "\n".join(
        [
            *own,
            *(
                f"# {line}"
                for line in sidecar_instructions(parameters, (*SPACE_SETTINGS, *CONTACT_SETTINGS))
            ),
        ]
    )


def stepping_lines(parameters: ParameterValues, steps: int) -> Iterator[str]:
    """Lines of Python that set a space and step it.

    The first step takes more iterations, since there are no impulses of an earlier step.
    """
    iterations = int(str(parameters["iterations"]))
    yield from (
        f"space.{key} = {parameters[key]!r}" for key in CONTACT_SETTINGS if key in parameters
    )
    yield from (
        "for constraint in space.constraints:",
        f"    constraint.error_bias = {parameters['error_bias']!r}",
        f"space.iterations = {max(MIN_FIRST_ITERATIONS, 10 * iterations)}"
        "  # there are no impulses to start from",
        f"space.step({parameters['timestep']!r})",
        f"space.iterations = {iterations}",
        f"for _ in range({steps - 1}):",
        f"    space.step({parameters['timestep']!r})",
    )


class Pymunk(Engine):
    """pymunk as an engine of proofmass; see `proofmass.sim.protocol.engine.Engine`."""

    title = "pymunk"
    packages = ("pymunk",)
    settings = PymunkSettings
    chooses = (*SPACE_SETTINGS, *CONTACT_SETTINGS)
    planar = True
    imposed = IMPOSED
    schemes = tried_settings.SCHEMES
    labels = tried_settings.LABELS
    sizes = tried_settings.SIZES
    accuracy = ACCURACY
    support = SUPPORT

    def simulate(self, model: Path, run: Run) -> Curves:
        """See `simulate`."""
        return simulate(model, run)

    def scans(self, about: Studied) -> Iterator[Scan]:
        """See `proofmass.sim.pymunk.tried_settings.scans`."""
        return tried_settings.scans(self.title, about)

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """See `proofmass.sim.pymunk.tried_settings.orders`."""
        return tried_settings.orders(scan, derivative, about)

    def perturbations(
        self, parameters: ParameterValues, about: Studied, scaled: bool
    ) -> Iterator[Perturbation]:
        """See `proofmass.sim.pymunk.tried_settings.perturbations`."""
        return tried_settings.perturbations(parameters, about)

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """See `proofmass.sim.pymunk.tried_settings.recipes`."""
        return tried_settings.recipes(self.title)

    def snippet(self, parameters: ParameterValues, steps: int, model: Path | None = None) -> str:
        """See `snippet`; `model` is not used."""
        return snippet(parameters, steps)

    def write_program(
        self,
        model: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed,
        controls: str = "",
    ) -> str:
        """See `proofmass.sim.pymunk.program.write_program`."""
        return write_program(model, run, motion, head, drive, controls)


ENGINE = Pymunk()
