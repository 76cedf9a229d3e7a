"""Figures that a sidecar asks for: views and charts.

A view shows curves over something else than the run's own x, which must rise: what is swept up and
back runs over time, and its loop is a view.  A chart shows what the reference knows beside the
runs, such as all equilibria.
"""

from typing import Any

from pydantic import Field, field_validator, model_validator

from proofmass.sidecar import known_unit
from proofmass.strict import Kind, Strict


class View(Strict):
    """``[[view]]``: a figure of the report.

    Names are channels, driven joints, or quantities of the reference.  `y` is drawn as the
    reference and every solver, a panel each; `stack` piles up quantities of the reference and draws
    their sum as a line.  `dashed` is held beside `y`, a target for one.  `marks` are places on x by
    what happens there, or a function of the reference's module that tells them of its parameters.
    `unit` and `x_unit` are those of names that no channel knows; such names and marks are in SI.
    """

    title: str = Field(min_length=1)
    x: str
    y: tuple[str, ...] = ()
    stack: tuple[str, ...] = ()
    dashed: str | None = None
    marks: str | dict[str, float] = Field({})
    unit: str | None = None
    x_unit: str | None = None
    run: Kind | None = None

    @field_validator("y", "stack", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @field_validator("unit", "x_unit")
    @classmethod
    def _known_unit(cls, unit: str | None) -> str | None:
        return None if unit is None else known_unit(unit)

    @model_validator(mode="after")
    def _one_kind(self) -> "View":
        if bool(self.y) == bool(self.stack):
            raise ValueError("give either y or stack")
        if self.dashed is not None and len(self.y) != 1:
            raise ValueError("dashed goes with one y")
        return self


class ChartTable(Strict):
    """``[[chart]]``: a figure of the report that the reference's module computes.

    `draw` is a function of it that returns an `proofmass.analytic.chart.Chart`.  It gets the case's
    parameters that it takes by name, and `parameters` in addition, or instead of them.
    """

    title: str = Field(min_length=1)
    draw: str
    parameters: dict[str, int | float | str | tuple[float, ...]] = Field({})


class Beside(Strict):
    """``[beside.NAME]``: another parameter set of the same reference, drawn thin in every view."""

    parameters: dict[str, float | str]
