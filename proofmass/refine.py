"""``[refine]``: a run again with its rods in more and more segments, and the order of its errors.

An error e of order p falls by r^p when a rod is cut into r times as many segments, n2 = r n1, and
then two runs point to the limit of many segments (Richardson), short of what is of higher order:

    p = log(e1 / e2) / log r          v = v2 + (v2 - v1) / (r^p - 1)
"""

from fnmatch import fnmatchcase
from itertools import pairwise
from math import gcd
from typing import Any

from pydantic import Field, field_validator, model_validator

from proofmass.rod import Segments
from proofmass.sidecar import RunTable
from proofmass.strict import Kind, Strict


class Refine(Strict):
    """``[refine]``: every rod in so many `segments`, one number after the other, in one `run`.

    The largest error of each of the `channels` must fall with `order`, from each number to the next
    and `within` so much.  A rest is sampled where every number of segments has the same place on
    its links, for what lies between their ends is off by more or less.  Errors up to `wall`, in the
    channel's unit, are left to rounding and to the reference, and show no order.  `richardson` is
    what the limits of places may be off by at the last sample [m]; `between` the two numbers that
    they are taken from, the last two if left out.
    """

    segments: tuple[Segments, ...] = Field(min_length=2)
    run: Kind = "rest"
    channels: tuple[str, ...] = ("*",)
    order: float = Field(gt=0)
    within: float = Field(gt=0)
    wall: float = Field(1e-9, gt=0)
    richardson: float | None = Field(None, gt=0)
    between: tuple[int, int] | None = None
    why: str

    @field_validator("channels", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @model_validator(mode="after")
    def _rising(self) -> "Refine":
        if self.segments[0] < 2 or any(a >= b for a, b in pairwise(self.segments)):
            raise ValueError(f"segments = {list(self.segments)} must rise, from 2 or more")
        if self.between not in (None, *pairwise(self.segments)):
            raise ValueError(f"between = {list(self.between or ())} must be neighbours in segments")
        if self.between and self.richardson is None:
            raise ValueError("between goes with richardson = what the limit may be off by")
        if not self.why.strip():
            raise ValueError("why is empty; an order needs its reason")
        return self

    def covers(self, channel: str) -> bool:
        """Whether the order of a channel's error is asked for."""
        return any(fnmatchcase(channel, pattern) for pattern in self.channels)

    def sampled(self, run: RunTable) -> RunTable:
        """The run with the samples that all numbers of segments have in common."""
        if self.run != "rest":
            return run
        return run.model_copy(update={"n": gcd(*self.segments) + 1, "until": None})

    @property
    def last(self) -> tuple[int, int]:
        """The two numbers of segments that point to the limit."""
        return self.between or (self.segments[-2], self.segments[-1])

