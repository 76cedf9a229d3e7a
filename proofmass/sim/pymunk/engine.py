"""pymunk (Chipmunk): a planar MJCF rebuilt from its compiled numbers; MuJoCo only compiles it."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from proofmass.sim.protocol import (
    Curves,
    Engine,
    Imposed,
    ParameterValues,
    Perturbation,
    Recipe,
    Run,
    Scan,
    Studied,
    left_to_sidecar,
)
from proofmass.sim.pymunk import tried_settings
from proofmass.sim.pymunk.dynamics import SURE, dynamics
from proofmass.sim.pymunk.model import find_channels, read_model
from proofmass.sim.pymunk.program import IMPOSED as IMPOSED
from proofmass.sim.pymunk.program import write_program as write_program
from proofmass.sim.pymunk.quasi_static import equilibrium, sweep
from proofmass.sim.pymunk.settings import ACCURACY, PymunkSettings

SPACE = ("timestep", "iterations", "error_bias")
CONTACTS = ("collision_slop", "collision_bias")


def check_settings(settings: Mapping[str, object]) -> None:
    """Raise `proofmass.sim.protocol.BadSetting` if pymunk cannot be set so."""
    PymunkSettings.read(settings)


def simulate(model: Path, run: Run) -> Curves:
    """Run a planar mechanism in pymunk.

    Drives are ideal: constraints aimed at the law's next value before each step.  Motors on other
    joints act with the constant force of their ``ctrl`` in the start key, or with one that changes
    along the run, see `proofmass.sim.pymunk.loads`.  Joint springs may be
    polynomials.  Joint ranges are stops: exact to 1e-13 rad in a sweep, soft in dynamics.

    Loads are motors on sites, constant in the frame of a refsite on the ground, or without one in
    that of the site.

    In a sweep the coordinates that drives leave free follow them at rest, from the start key on,
    and in equilibrium they come there with the drives held.  The pose is the engine's: one that its
    own step from standstill gives no velocity.  How far to go along that velocity is chosen by a
    stiffness of ours, since Chipmunk has no means to come to rest faster than it swings.

    Springs and dampers may act between two sites.  In dynamics geoms touch where MuJoCo lets them,
    with its friction; see `proofmass.sim.pymunk.contacts`.

    Second order in time, but for damping: Chipmunk's dampers are first order.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        What to do; see `proofmass.sim.protocol.Run`.  Settings: ``timestep`` [s], reduced so that
        whole steps fit between samples (a sweep has no use for it); ``iterations`` of the solver:
        100 in dynamics; in a sweep as many as the start pose needs, up to 500, and 500 where
        springs or weights hold what the drives leave; more where it needs them; ``error_bias``, the
        share of a gap left after a second, 0; ``collision_slop`` [m] and ``collision_bias`` of
        contacts, 1e-6 and 0.9**60; ``defaults = True`` for Chipmunk's own.

    Returns
    -------
    Curves
        The channels over ``run.x``, the actual drive state, the largest gap and the cost.  A sweep
        stops where the loops cannot be closed any further, or a stop is in the way, and says so.

    Raises
    ------
    BadModel
        The model does not compile, lacks a named element, or its start pose is not assembled.
    Unsupported
        The model holds something that the rebuild does not cover; it is named.
    Diverged
        The run failed.
    """
    links, settings = read_model(model, run)
    wanted, missing = find_channels(links, run)
    act = {"sweep": sweep, "equilibrium": equilibrium, "dynamics": dynamics}[run.kind]
    curves = act(links, run, wanted, settings)
    curves.missing.update(missing)
    return curves


def snippet(parameters: ParameterValues, steps: int) -> str:
    """What to paste so that pymunk runs with settings, all of which must be known."""
    own = list(python(parameters, steps)) if set(parameters) >= set(SPACE) else []
    return "\n".join(
        [*own, *(f"# {line}" for line in left_to_sidecar(parameters, (*SPACE, *CONTACTS)))]
    )


def python(parameters: ParameterValues, steps: int) -> Iterator[str]:
    """Lines that step a space; the first step has no impulses to start from, so it takes more."""
    iterations = int(str(parameters["iterations"]))
    yield from (f"space.{key} = {parameters[key]!r}" for key in CONTACTS if key in parameters)
    yield from (
        "for constraint in space.constraints:",
        f"    constraint.error_bias = {parameters['error_bias']!r}",
        f"space.iterations = {max(SURE, 10 * iterations)}  # there are no impulses to start from",
        f"space.step({parameters['timestep']!r})",
        f"space.iterations = {iterations}",
        f"for _ in range({steps - 1}):",
        f"    space.step({parameters['timestep']!r})",
    )


class Pymunk(Engine):
    """pymunk as all commands know it."""

    title = "pymunk"
    packages = ("pymunk",)
    settings = PymunkSettings
    chooses = (*SPACE, *CONTACTS)
    planar = True
    imposed = IMPOSED
    schemes = tried_settings.SCHEMES
    labels = tried_settings.LABELS
    sizes = tried_settings.SIZES
    accuracy = ACCURACY

    def simulate(self, model: Path, run: Run) -> Curves:
        """See `simulate`."""
        return simulate(model, run)

    def scans(self, about: Studied) -> Iterator[Scan]:
        """See `proofmass.sim.pymunk.tried_settings.scans`."""
        return tried_settings.scans(self.title, about)

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """See `proofmass.sim.pymunk.tried_settings`."""
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
        """Python; see `snippet`."""
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
        """See `proofmass.sim.pymunk.program`."""
        return write_program(model, run, motion, head, drive, controls)


ENGINE = Pymunk()
