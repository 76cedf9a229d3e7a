"""Charts: what a closed form knows beside the curves of a run, as data that a report can draw.

A reference's module may have functions that make one of its parameters: all equilibria of a
mechanism, its workspace, its buckling loads.  A sidecar's ``[[chart]]`` names such a function.
"""

from dataclasses import dataclass

from analytic.domain import Array


@dataclass(frozen=True)
class Line:
    """A line through points, or the points alone; NaN breaks it.

    Attributes
    ----------
    x, y : ndarray (n,)
        SI units, radians.
    label : str
        What it is, for the legend; lines of one label are drawn alike.
    stable : bool
        Drawn bold; what is unstable thin and dashed.
    points : bool
        Markers instead of a line.
    """

    x: Array
    y: Array
    label: str = ""
    stable: bool = True
    points: bool = False


@dataclass(frozen=True)
class Field:
    """Values over a grid, drawn as filled contours; NaN stays white.

    Attributes
    ----------
    x, y : ndarray (m,), (n,)
        The grid.
    values : ndarray (m, n)
    label, unit : str
        What they are, for the colour bar.
    signed : bool
        Zero is a singularity: two colours that part there, and a line on it.
    """

    x: Array
    y: Array
    values: Array
    label: str
    unit: str
    signed: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes: lines on a field, under a title of a few words."""

    lines: tuple[Line, ...] = ()
    field: Field | None = None
    title: str = ""


@dataclass(frozen=True)
class Chart:
    """Panels with the same axes.

    Attributes
    ----------
    x, y : tuple of str
        Name and SI unit of both axes, such as ("x", "m"); "rad" is drawn in degrees.
    panels : tuple of Panel
    caption : str
        What to see, in a sentence or two.
    alike : bool
        One scale across and up, as for shapes.
    """

    x: tuple[str, str]
    y: tuple[str, str]
    panels: tuple[Panel, ...]
    caption: str
    alike: bool = False
