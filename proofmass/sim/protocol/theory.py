"""What theory states of an engine: orders of convergence, stability, limits of test problems."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from proofmass.base.arrays import Array
from proofmass.sim.protocol.part import EnginePart
from proofmass.sim.protocol.settings import ParameterValue, ParameterValues
from proofmass.sim.protocol.tuning import Scan, Studied

if TYPE_CHECKING:
    from mujoco import MjModel

StepMap = Callable[[float, float], Array]
"""``map(z, zeta)``: the matrix (2, 2) that a step applies to (q, dt q') of a spring and a damper,
with z = dt omega."""
Stepping = Callable[[float], tuple[str, float, dict[str, ParameterValue], str]]
"""For a value: text of an MJCF, time step [s], settings, and the channel that is watched."""


@dataclass(frozen=True)
class Scheme:
    """A time-stepping scheme of an engine, with the properties that theory gives.

    Attributes
    ----------
    name : str
    step : callable
        Its `StepMap`.
    law : str
        The formula of the largest stable dt omega, in words.
    settings : dict of str to ParameterValue
        Settings that select the scheme.
    conserves : bool
        Whether the energy of a free motion is conserved, except for errors.
    half_kick : bool
        Whether a run from rest begins with the velocity of half a step.
    tried : mapping of str to tuple of float
        Test problems of ``proofmass stress`` for the scheme, and their numbers [1]: damping ratios
        of ``spring`` and ``slide``, numbers of masses of a ``chain``, dt omega of ``swing`` and
        ``fade``; for ``pendulum`` and ``whirl`` the number has no meaning.
    """

    name: str
    step: StepMap
    law: str
    settings: dict[str, ParameterValue] = field(default_factory=dict)
    conserves: bool = True
    half_kick: bool = False
    tried: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class LimitProblem:
    """A test problem of an engine: one parameter is increased until the run fails.

    Attributes
    ----------
    what, setting, parameter, law : str
        The model, the scheme, the parameter that is increased, and the limit of theory, in words.
    stepped : callable
        Its `Stepping`.
    step, zeta : callable, float
        The `StepMap` from which the limit of theory follows, and the damping ratio [1]; if `step`
        is None the limit is `theory`.
    theory : float
        Limit of the parameter [SI].
    start, reach : float
        First and last value of the parameter [SI].
    bound : float, optional
        Largest correct value of the watched channel [SI]; if none is given, a run fails beyond 1.
    """

    what: str
    setting: str
    parameter: str
    law: str
    stepped: Stepping
    step: StepMap | None = None
    zeta: float = 0.0
    theory: float = float("nan")
    start: float = 0.1
    reach: float = 1e3
    bound: float | None = None


class Theory(EnginePart):
    """What theory states of an engine; by default nothing.

    Attributes
    ----------
    schemes : tuple of Scheme
        Its time-stepping schemes whose stability is known.
    """

    schemes: ClassVar[tuple[Scheme, ...]] = ()

    def orders(self, scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
        """Orders of convergence that errors of a scan may show; empty if theory gives none.

        `derivative` is 0 for errors of positions, 1 of rates and energies, 2 of accelerations and
        forces.
        """
        return ()

    def scheme_of(self, parameters: ParameterValues, model: "MjModel") -> Scheme | None:
        """The scheme with which a single coordinate is stepped; None if none is known."""
        return None

    def limit_problems(self) -> Iterator[LimitProblem]:
        """The engine's own test problems."""
        yield from ()
