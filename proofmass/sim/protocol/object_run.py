"""A run of a model that a user built of an engine's own objects, such as a ``Space`` of pymunk."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from proofmass.base.arrays import Array

ChannelOfObject: TypeAlias = "tuple[Any, str] | Callable[..., float]"
"""An object and the path of an attribute, such as ``(body, "position.x")``; or a function."""


@dataclass(frozen=True)
class ObjectRun:
    """What to do with a model of an engine's own objects.

    Attributes
    ----------
    duration, step : float
        Length of the run, and of its steps [s].
    channels : mapping
        The curves by name: an object and the path of its attribute, a function of the model, or a
        function without arguments.
    every : int
        Steps from one sample to the next.
    copies : bool
        Whether the model must stay as it is, since it is run again.
    """

    duration: float
    step: float
    channels: Mapping[str, ChannelOfObject]
    every: int = 1
    copies: bool = False

    @property
    def samples(self) -> int:
        """The number of samples, with that of the start."""
        return round(self.duration / self.step / self.every) + 1

    @property
    def times(self) -> Array:
        """The times of the samples (n,) [s]."""
        last = self.step * self.every * (self.samples - 1)
        return np.linspace(0.0, last, self.samples)
