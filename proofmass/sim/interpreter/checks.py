"""What runs of all kinds need: a refusal, a watch, and checks of what an engine returns."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from .geometry import LinkMotion
from .mechanism import NeutralMechanism

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


def refuse_gears(mechanism: NeutralMechanism, engine: str) -> None:
    """Raise `Refused` at a gear, for an engine without couplings of joints."""
    for gear in mechanism.gears:
        raise Refused(f"{engine} has no coupling of joints, such as gear {gear.name!r}")


def refuse_rows(mechanism: NeutralMechanism) -> None:
    """Raise `Refused` at a link that has not one joint but several."""
    for k in range(1, len(mechanism.links)):
        if len(mechanism.joints_of(k)) != 1:
            raise Refused(f"link {mechanism.links[k].name!r} with several joints")


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
