"""Convergence series of a case: settings that differ in one parameter, from coarse to fine.

The series are not the full product of all parameters, but settings between which a user would
choose.  Each engine states them for dynamics; in other runs the number of segments of rods is
varied.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import takewhile

from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.run.solve import describe_dynamics
from proofmass.sim.engines import NoEngine, engine_of, format_solver
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.settings import ParameterValue
from proofmass.sim.protocol.tuning import Scan, scan_over
from proofmass.studies.record import Setting


def setting_size(engine: str, varied: str, value: ParameterValue) -> float:
    """The size of a setting with which errors should fall, such as its time step [s].

    For other varied parameters it is a time constant [s], a share or a length: the engine says.
    """
    try:
        return engine_of(engine).tuning.size(varied, value)
    except NoEngine:  # the table may come from a machine with other engines
        return Engine().tuning.size(varied, value)


@dataclass(frozen=True)
class ConvergenceSeries:
    """Settings of one engine that differ in one parameter, from coarse to fine.

    Attributes
    ----------
    engine, name : str
        Name of the engine; name of the series, unique in the run.
    varied : str
        The parameter that differs.
    settings : tuple of Setting
    """

    engine: str
    name: str
    varied: str
    settings: tuple[Setting, ...]

    @property
    def sizes(self) -> list[float]:
        """Size of each setting, with which its errors should fall; see `setting_size`."""
        return [
            setting_size(self.engine, self.varied, one.parameters[self.varied])
            for one in self.settings
        ]

    @property
    def scaled(self) -> bool:
        """Whether other parameters change with the time step, such as the stiffness of loops."""
        first, *others = (
            {k: v for k, v in one.parameters.items() if k != self.varied} for one in self.settings
        )
        return self.varied == "timestep" and any(other != first for other in others)

    @property
    def scan(self) -> Scan:
        """The series as the scan of its engine."""
        return Scan(self.name, self.varied, tuple(one.parameters for one in self.settings))


def series_of_scan(engine: str, scan: Scan) -> ConvergenceSeries:
    """The series of an engine's scan."""
    return ConvergenceSeries(
        engine, scan.name, scan.varied, tuple(Setting(engine, k) for k in scan.settings)
    )


def list_series(case: Case, kind: Kind) -> list[ConvergenceSeries]:
    """The convergence series of a run of a case; none in a sweep of a rigid mechanism.

    Raises
    ------
    InputError
        The model has an error.
    """
    engines = case.run[kind].engines
    if kind != "dynamics":
        return [
            series_of_scan(name, scan)
            for name in engines
            for scan in scan_segments(case, kind, name)
        ]
    description = describe_dynamics(case)
    return [
        *own_settings_series(case, kind),
        *(
            series_of_scan(name, scan)
            for name in engines
            for scan in engine_of(name).tuning.scans(description)
        ),
    ]


def own_settings_series(case: Case, kind: Kind) -> Iterator[ConvergenceSeries]:
    """The setting of the model and the sidecar, as a series of one, for each solver of the run.

    It may run where no other setting does, such as for a stiff mechanism with a tiny mass.
    """
    own = float(compiled_model(case).opt.timestep)
    for solver in case.run[kind].solvers:
        engine, _, variant = solver.partition(":")
        if variant == "default":  # the other series have the defaults
            continue
        given = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in case.settings.get(solver, {}).items()
        }
        setting = Setting(engine, {"timestep": own, **given})
        place = "sidecar" if given else "model"
        yield ConvergenceSeries(
            engine, f"{format_solver(solver)}, as in the {place}", "timestep", (setting,)
        )


def with_step(setting: Setting, step: float) -> Setting:
    """A setting with another time step [s], and with parameters that depend on it."""
    tuning = engine_of(setting.engine).tuning
    return replace(setting, parameters=tuning.at_step(setting.parameters, step))


def scan_segments(case: Case, kind: Kind, engine: str) -> Iterator[Scan]:
    """Scan over the number of segments of all rods.

    In equilibrium the numbers suit the samples, so that these lie at the ends of segments: segments
    are straight, and errors between their ends vary.
    """
    if not case.rod:
        return
    samples = (case.run[kind].n or 0) - 1
    first = samples // 4 if kind == "equilibrium" and samples % 4 == 0 else 5
    numbers = list(takewhile(lambda n: n <= 160, (first * 2**k for k in range(8))))
    yield scan_over({}, f"{format_solver(engine)}, segments", "segments", numbers)
