"""The interface between the core and an engine.

An engine is one object, an `Engine`, which another distribution can provide as an entry point of
the group ``proofmass.engines``.  Only the method `Engine.simulate` is required:

    simulate(model: Path, run: Run) -> Curves

An engine has no access to references and tolerances.  It imports nothing of the core; `errors`,
`files`, `recorded`, `strict` and `units` are below it and may be imported.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.own_equations import OwnMotion
from proofmass.sim.protocol.programs import Imposed, sidecar_instructions
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.protocol.settings import (
    EngineSettings,
    ParameterValue,
    ParameterValues,
    first_number,
)
from proofmass.sim.protocol.theory import LimitProblem, Scheme
from proofmass.sim.protocol.tuning import STEP_CAUSE, Perturbation, Recipe, Scan, Studied, scan_over

if TYPE_CHECKING:
    from mujoco import MjModel

    from proofmass.analytic.support import Support


class AccuracyLimit(NamedTuple):
    """Expected largest error of an engine, as a share of the reference's range [1], and its reason.

    The `accuracy` of an engine may have one for ``sweep`` (all channels), for ``rest`` (rates of a
    sweep where drives leave degrees of freedom), and for each of ``position``, ``velocity``,
    ``acceleration`` and ``force`` (channels of dynamics).
    """

    relative_to_range: float
    why: str


class Engine:
    """An engine as the core uses it; attributes and methods that a subclass omits have defaults.

    Settings are given as `ParameterValues`, by their names in `settings`.

    Attributes
    ----------
    title : str
        Name in a sentence; the name of the class, if not given.
    packages : tuple of str
        Distributions that compute its results in addition to NumPy, SciPy and MuJoCo.
    settings : type of EngineSettings
        The settings, with types, ranges and the engine's own defaults.
    chooses : tuple of str
        Settings that the engine itself chooses or fits if they are not given, and reports.
    native : bool
        Whether the engine compiles the MJCF itself and refuses files that do not compile.
    computes : bool
        Whether the engine computes its curves from the model.  An engine that has them from
        elsewhere is a solver only if a sidecar names it, and studies leave it out.
    planar : bool
        Whether the engine moves bodies only in the plane of a mechanism.  It is then a solver of a
        motion in space only if a sidecar names it.
    imposed : sequence of Imposed
        Ways in which its programs can impose a motion, the ideal way first.
    schemes : tuple of Scheme
        Its time-stepping schemes whose stability is known from theory.
    sizes : mapping of str to callable
        By setting, the quantity with which errors should fall, as a function of the setting's
        value: a step or time constant [s], or a share.
    labels : mapping of str to str
        By setting, name of that quantity on the axis of a figure, if it is not the setting.
    accuracy : mapping of str to AccuracyLimit
        Accuracy that is expected for a driven linkage, for cases that state no tolerance.
    support : mapping
        What becomes of each feature of a model in its runs, see `proofmass.analytic.support`;
        empty if the engine does not state it.
    """

    title = ""
    packages: tuple[str, ...] = ()
    settings: type[EngineSettings] = EngineSettings
    chooses: tuple[str, ...] = ("timestep",)
    native = False
    computes = True
    planar = False
    imposed: Sequence[Imposed] = (Imposed("ideal drive"),)
    schemes: tuple[Scheme, ...] = ()
    sizes: Mapping[str, Callable[[ParameterValue], float]] = {"timestep": first_number}
    labels: Mapping[str, str] = {}
    accuracy: Mapping[str, AccuracyLimit] = {}
    support: ClassVar["Support"] = {}

    def __init_subclass__(cls) -> None:
        if "title" not in vars(cls):
            cls.title = cls.__name__

    def simulate(self, model: Path, run: Run) -> Curves:
        """Run the model of an MJCF file.

        Raises
        ------
        BadModel, Unsupported, Diverged
            Any other exception counts as a crash of the run, except
            `proofmass.base.errors.InputError`, which names a faulty file of the engine.
        """
        raise NotImplementedError

    def own_motion(
        self,
        model: Path,
        until: float,
        samples: int,
        seconds: float,
        start: str = "start",
        drives: tuple[Drive, ...] = (),
        loads: tuple[ChangingLoad, ...] = (),
    ) -> OwnMotion:
        """Solve the motion of a model by itself in several ways, from its key `start` or its first.

        The motion lasts about `until` [s], with about `samples` samples, and is solved in about
        `seconds` of counted processor time.  `drives` and `loads` prescribe parts of it, if given.

        Raises
        ------
        BadModel, Unsupported
        """
        raise Unsupported(f"{self.title} solves no model's own equations in several ways")

    def solve_closely(self, model: Path, run: Run) -> Curves:
        """Solve a motion without fixed time steps, as accurately as possible.

        Raises
        ------
        BadModel, Unsupported, NotSolved
        """
        raise Unsupported(f"{self.title} has no motion without time steps")

    def check_settings(self, settings: Mapping[str, object]) -> None:
        """Raise `BadSetting` if the engine does not accept the settings.

        A file that a setting names, here with its absolute path, may be read; an `InputError` then
        says what is wrong in it.
        """
        self.settings.read(settings)

    def is_default(self, parameters: ParameterValues) -> bool:
        """Whether the settings differ from the engine's own defaults in the time step at most."""
        fields = self.settings.model_fields
        return bool(parameters.get("defaults")) and all(
            value == fields[name].default
            for name, value in parameters.items()
            if name in fields and name not in ("timestep", "defaults")
        )

    def size(self, varied: str, value: ParameterValue) -> float:
        """Quantity with which errors should fall along a scan: from `sizes`, or 1 / value."""
        return self.sizes[varied](value) if varied in self.sizes else 1.0 / first_number(value)

    def at_step(self, parameters: ParameterValues, step: float) -> dict[str, ParameterValue]:
        """Settings with another time step [s], and other settings adapted to it."""
        return {**parameters, "timestep": step}

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans of settings in dynamics; by default one over the time step, if it can be set."""
        if "timestep" in self.settings.model_fields:
            yield scan_over({}, self.title, "timestep", about.timesteps())

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """Orders of convergence that errors of a scan may show; empty if theory gives none.

        `derivative` is 0 for errors of positions, 1 of rates and energies, 2 of accelerations and
        forces.
        """
        return ()

    def perturbations(
        self, parameters: ParameterValues, about: Studied, scaled: bool
    ) -> Iterator[Perturbation]:
        """Settings in which one possible cause of an error is changed, for each cause.

        `scaled` states whether the settings are of a scan in which loops get harder with the step.
        """
        if "timestep" in self.settings.model_fields:
            step = first_number(parameters.get("timestep", about.own_step))
            yield Perturbation(STEP_CAUSE, "halving the step", {**parameters, "timestep": step / 2})

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """Recipes among which the cheapest sufficient setting is searched."""
        if "timestep" in self.settings.model_fields:
            plain: dict[str, ParameterValue] = (
                {"defaults": True} if ("defaults" in self.settings.model_fields) else {}
            )
            yield Recipe(
                f"{self.title}, defaults" if plain else self.title, lambda step: plain, bool(plain)
            )

    def snippet(self, parameters: ParameterValues, steps: int, model: Path | None = None) -> str:
        """Text to paste so that the engine runs with these settings, for so many steps."""
        return "\n".join(f"# {line}" for line in sidecar_instructions(parameters))

    def holding(
        self, model: Path, parameters: ParameterValues, slower: float
    ) -> dict[str, ParameterValue] | None:
        """Settings with which creep under friction is `slower` times slower; None if impossible."""
        return None

    def comment(self, text: str) -> str:
        """Text as a comment before a snippet."""
        return indent(text, "# ")

    def pasted(
        self, model: Path, parameters: ParameterValues, steps: int
    ) -> tuple[str, set[str]] | None:
        """The text of an MJCF with a snippet in it, and the names of the settings that it states.

        The result is None if the engine's snippets are no part of an MJCF.
        """
        return None

    def write_program(
        self,
        model: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed,
        controls: str = "",
    ) -> str:
        """A dynamics run as a program that needs the engine only.

        `controls` is the source of ``controls(t)``, the controls of the run's loads, if it has any.

        Raises
        ------
        Unsupported
            The program cannot be written; the message says why.
        """
        raise Unsupported(f"{self.title} has no programs")

    def scheme_of(self, parameters: ParameterValues, model: "MjModel") -> Scheme | None:
        """The scheme with which a single coordinate is stepped; None if none is known."""
        return None

    def limit_problems(self) -> Iterator[LimitProblem]:
        """The engine's own test problems."""
        yield from ()
