"""What runs of all kinds need: a refusal, a watch, and checks of what an engine returns."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from .geometry import LinkMotion

LOST_SIZES = 1e3
"""Distance from the start, in sizes of the mechanism, beyond which a run is lost."""


class Refused(Exception):
    """The engine cannot express something of the mechanism; the message names it."""


class Stopwatch:
    """Processor time in a ``with`` block [s]."""

    def __enter__(self) -> Stopwatch:
        self.began, self.seconds = time.process_time(), 0.0
        return self

    def __exit__(self, *_: Any) -> None:
        self.seconds = time.process_time() - self.began


def check_motions(motions: list[LinkMotion]) -> None:
    """Raise ValueError if a motion is no `LinkMotion`."""
    for k, one in enumerate(motions, 1):
        if len(one) not in (4, 6):
            raise ValueError(
                f"read({k}) returned {len(one)} things, not 4, or 6 with accelerations"
            )
        shapes = [np.shape(part) for part in one]
        if shapes != [(3,), (3, 3), *[(3,)] * (len(one) - 2)]:
            raise ValueError(
                f"read({k}) returned arrays of the shapes {shapes}; expected place (3,), rotation "
                "(3, 3), velocity (3,) and angular velocity (3,)"
            )
