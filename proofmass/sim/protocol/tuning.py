"""Settings that studies vary: scans, recipes, and perturbations of one cause at a time."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from proofmass.base.arrays import Array
from proofmass.sim.protocol.part import EnginePart
from proofmass.sim.protocol.settings import ParameterValue, ParameterValues, first_number

if TYPE_CHECKING:
    from mujoco import MjModel

STEP_CAUSE = "time step"
"""Name of the cause of an error that a shorter step makes smaller."""


@dataclass(frozen=True)
class Studied:
    """A dynamics run whose settings are studied.

    Attributes
    ----------
    model : MjModel
        The compiled MJCF.
    times : ndarray (n,)
        Times of the samples [s].
    work : float
        Largest number of evaluations of forces in a run of a scan [1].
    driven : bool
        Whether joints are driven.
    held_to_drive : bool
        Whether the reference is evaluated at the actual state of the drives.
    jolted : callable
        Whether the motion starts under gravity or with rates other than zero; computed when called.
    controlled : bool
        Whether controls of actuators change in time.
    """

    model: "MjModel"
    times: Array
    work: float
    driven: bool
    held_to_drive: bool
    jolted: Callable[[], bool]
    controlled: bool = False

    @property
    def own_step(self) -> float:
        """Time step of the model [s]."""
        return float(self.model.opt.timestep)

    def timesteps(self, stages: int = 1) -> list[float]:
        """Time steps [s] of which 1, 2, 4, .. lead from sample to sample.

        Each is half of the one before, so that half and a quarter of a step, from which an error
        floor is recognized, are steps of the same scan.  `stages` is the number of evaluations of
        forces in a step.
        """
        most = max(1.0, self.work / stages / (self.times.size - 1))
        numbers = takewhile(lambda number: number <= most, (2**k for k in count()))
        return [float(self.times[1] - self.times[0]) / number for number in numbers]

    def quartered_step(self, stages: int = 1) -> float:
        """The shortest step [s] whose quarter is among `timesteps`, but at least the model's own.

        It is for scans over another setting, whose error floor is recognized from half and a
        quarter of the step.
        """
        return max([self.own_step, *self.timesteps(stages)[-3:][:1]])


@dataclass(frozen=True)
class Scan:
    """Settings that differ in one of them, the `varied` one, from coarse to fine.

    Attributes
    ----------
    name : str
        A name that no other scan of the engine has.
    varied : str
    settings : tuple of dict
    """

    name: str
    varied: str
    settings: tuple[dict[str, ParameterValue], ...]


def scan_over(
    base: ParameterValues, name: str, varied: str, values: Sequence[ParameterValue]
) -> Scan:
    """A scan over one of the settings."""
    return Scan(name, varied, tuple({**base, varied: value} for value in values))


@dataclass(frozen=True)
class Recipe:
    """Settings as a function of the time step, for the search of the longest sufficient step.

    Attributes
    ----------
    name : str
    parameters : callable
        ``parameters(step)`` gives all settings but the step itself [s].
    plain : bool
        Whether these settings are the engine's own defaults.
    """

    name: str
    parameters: Callable[[float], dict[str, ParameterValue]]
    plain: bool = False


@dataclass(frozen=True)
class Perturbation:
    """Settings in which one possible cause of an error is changed, and nothing else.

    Attributes
    ----------
    cause, change : str
        The suspected cause, and how it is changed, in words.
    parameters : dict of str to ParameterValue
    better : bool or None
        Whether a smaller error is expected; False if the cause can only be increased, None if the
        error may change either way.
    whole : bool
        Whether the cause is removed completely, and not only halved.
    """

    cause: str
    change: str
    parameters: dict[str, ParameterValue]
    better: bool | None = True
    whole: bool = False


class Tuning(EnginePart):
    """The settings of an engine that studies vary; by default its time step, if that is a setting.

    Attributes
    ----------
    sizes : mapping of str to callable
        By setting, the quantity with which errors should fall, as a function of the setting's
        value: a step or time constant [s], or a share.
    labels : mapping of str to str
        By setting, name of that quantity on the axis of a figure, if it is not the setting.
    """

    sizes: ClassVar[Mapping[str, Callable[[ParameterValue], float]]] = {"timestep": first_number}
    labels: ClassVar[Mapping[str, str]] = {}

    def size(self, varied: str, value: ParameterValue) -> float:
        """Quantity with which errors should fall along a scan: from `sizes`, or 1 / value."""
        return self.sizes[varied](value) if varied in self.sizes else 1.0 / first_number(value)

    def at_step(self, parameters: ParameterValues, step: float) -> dict[str, ParameterValue]:
        """Settings with another time step [s], and other settings adapted to it."""
        return {**parameters, "timestep": step}

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans of settings in dynamics."""
        if "timestep" in self.settings.model_fields:
            yield scan_over({}, self.title, "timestep", about.timesteps())

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

    def holding(
        self, model: Path, parameters: ParameterValues, slower: float
    ) -> dict[str, ParameterValue] | None:
        """Settings with which creep under friction is `slower` times slower; None if impossible."""
        return None
