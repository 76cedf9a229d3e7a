"""What an engine is, as the folders above `sim` see it.

An engine is one object, an `Engine`, which another distribution can provide as an entry point of
the group ``proofmass.engines``.  Only the method `Engine.simulate` is required:

    simulate(model: Path, run: Run) -> Curves

What studies ask of an engine is in its parts, which are loaded when they are asked for:

    tuning          settings that studies vary
    theory          orders of convergence, stability limits, and test problems
    programs        settings as text to paste, and programs that need the engine only
    own_equations   the motion of a model by itself, solved in several ways

An engine has no access to references and tolerances.  It imports nothing of the folders above
`proofmass.sim`; those of `proofmass.base` may be imported.
"""

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.part import LoadedPart
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import EngineSettings

if TYPE_CHECKING:
    from proofmass.analytic.support import Support
    from proofmass.sim.protocol.object_run import ObjectRun
    from proofmass.sim.protocol.own_equations import OwnEquations
    from proofmass.sim.protocol.programs import Programs
    from proofmass.sim.protocol.theory import Theory
    from proofmass.sim.protocol.tuning import Tuning


class AccuracyLimit(NamedTuple):
    """Expected largest error of an engine, as a share of the reference's range [1], and its reason.

    The `accuracy` of an engine may have one for ``sweep`` (all channels), for ``rest`` (rates of a
    sweep where drives leave degrees of freedom), and for each of ``position``, ``velocity``,
    ``acceleration`` and ``force`` (channels of dynamics).
    """

    relative_to_range: float
    why: str


class Engine:
    """An engine as its users see it; attributes and methods that a subclass omits have defaults.

    Settings are given as `proofmass.sim.protocol.settings.ParameterValues`, by their names in
    `settings`.

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
    accuracy : mapping of str to AccuracyLimit
        Accuracy that is expected for a driven linkage, for cases that state no tolerance.
    support : mapping
        What becomes of each feature of a model in its runs, see `proofmass.analytic.support`;
        empty if the engine does not state it.
    tuning : Tuning
        Settings that studies vary; the time step alone, if not given.
    theory : Theory
        Statements of theory; none, if not given.
    programs : Programs
        Settings as text, and programs; a table of a sidecar and no program, if not given.
    own_equations : OwnEquations
        Solutions of a model's own motion; `proofmass.sim.protocol.failures.Unsupported` is raised
        if the engine has none.
    """

    title = ""
    packages: tuple[str, ...] = ()
    settings: type[EngineSettings] = EngineSettings
    chooses: tuple[str, ...] = ("timestep",)
    native = False
    computes = True
    planar = False
    accuracy: Mapping[str, AccuracyLimit] = {}
    support: ClassVar["Support"] = {}
    tuning: LoadedPart["Tuning"] = LoadedPart("proofmass.sim.protocol.tuning:Tuning")
    theory: LoadedPart["Theory"] = LoadedPart("proofmass.sim.protocol.theory:Theory")
    programs: LoadedPart["Programs"] = LoadedPart("proofmass.sim.protocol.programs:Programs")
    own_equations: LoadedPart["OwnEquations"] = LoadedPart()

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

    def at_version(self, number: str) -> "Engine":
        """The same engine in another version, in an interpreter that has it.

        Raises
        ------
        Unsupported
            The engine runs only in the version that is installed here.
        """
        raise Unsupported(f"{self.title} runs only in the version that is installed here")

    def versions(self) -> dict[str, str]:
        """Versions of the distributions that compute its results."""
        return {name: version(name) for name in self.packages}

    def provide(self) -> str:
        """Fetch what the engine needs before it can run; returns why that cannot be had, or ""."""
        return ""

    def owns(self, thing: object) -> bool:
        """Whether something is a model of the engine's own objects, which `record` runs."""
        return False

    def record(self, thing: object, run: "ObjectRun") -> Curves:
        """Run a model of the engine's own objects, a copy of it where that is possible.

        Raises
        ------
        InputError
            The run or a channel is wrong.
        """
        raise NotImplementedError

    def check_settings(self, settings: Mapping[str, object]) -> None:
        """Raise `BadSetting` if the engine does not accept the settings.

        A file that a setting names, here with its absolute path, may be read; an `InputError` then
        says what is wrong in it.
        """
        self.settings.read(settings)
