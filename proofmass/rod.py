"""``[rod.NAME]``: an elastic rod between two sites of the MJCF."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from proofmass.sim.protocol import Rod
from proofmass.strict import Strict

MOST = 10**5
"""Segments of a rod: one matrix of the engines, a row and a column for each, is then 80 GB."""
Segments = Annotated[int, Field(le=MOST)]


class RodTable(Strict):
    """``[rod.NAME]``: where a rod is held, what it is made of, and how it is cut into links.

    It begins at the site `from`, its tangent along that site's x axis, and bends about the z axis.
    The site `to` of another body, or ``OTHER.tip`` of a rod before it, holds its far end; left out,
    that is free.  `turn` is that of its tangent from end to end in the start pose, an arc [rad]:
    which of several equilibria it comes to rest in.  Sensors on the sites ``NAME.middle`` and
    ``NAME.tip`` stay in place whatever the number of `segments`.  `mass` is needed where gravity
    acts.
    """

    start: str = Field(alias="from")
    to: str | None = None
    length: float = Field(gt=0)
    stiffness: float = Field(gt=0)
    segments: Segments = Field(20, ge=2)
    ends: tuple[Literal["clamped", "pinned"], Literal["clamped", "pinned", "free"]] = (
        "clamped", "pinned")
    scheme: Literal["half", "double", "naive"] = "half"
    mass: float | None = Field(None, gt=0)
    turn: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _loose(cls, table: Any) -> Any:
        if isinstance(table, dict) and "to" not in table:
            return {"ends": ("clamped", "free"), **table}
        return table

    @model_validator(mode="after")
    def _held(self) -> "RodTable":
        if (self.to is None) != (self.ends[1] == "free"):
            raise ValueError(f"its far end is {self.ends[1]}: " + (
                "give to = the site that holds it" if self.to is None else "leave out to"))
        if self.ends[1] == "clamped" and self.scheme != "half":
            raise ValueError(f"scheme {self.scheme!r} has no clamp at the far end; use half")
        if self.ends == ("pinned", "free"):
            raise ValueError("a rod that is pinned here and free there swings; clamp it")
        return self

    def built(self, name: str) -> Rod:
        """What a simulator is asked to build."""
        return Rod(name, self.start, self.to, self.length, self.stiffness, self.segments,
                   self.ends, self.scheme, self.mass, self.turn)
