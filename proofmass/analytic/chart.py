"""Charts: what a reference knows in addition to the curves of a run, as data that a report draws.

A chart shows, for example, all equilibria of a mechanism, its workspace or its buckling loads.  It
is made by a function of the reference's module, which takes the parameters of the reference by
name and whose return annotation is ``-> Chart``.  A sidecar's ``[[chart]]`` names that function.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.base.arrays import Array, Complex, Index

MAX_PANELS = 12  # largest number of panels of a chart: a page has room for no more
LINE_BREAK = complex(np.nan, np.nan)
"""A point x + iy that interrupts a line."""


@dataclass(frozen=True)
class ChartLine:
    """A line through points, or the points alone; NaN interrupts the line.

    Attributes
    ----------
    x, y : ndarray (n,)
        Coordinates of the points [SI].
    label : str
        Name of the line in the legend; lines with the same label are drawn in the same way.
    stable : bool
        True: the line is drawn bold. False: thin and dashed, as for unstable equilibria.
    points : bool
        Whether markers are drawn instead of a line: filled ones, or hollow ones if not `stable`.
    bars : bool
        Whether the line shows links of a mechanism: it is drawn thick, with a pin at every point;
        thin and dashed if not `stable`, as for another pose of the same links.
    """

    x: Array
    y: Array
    label: str = ""
    stable: bool = True
    points: bool = False
    bars: bool = False

    def __post_init__(self) -> None:
        if np.ndim(self.x) != 1 or np.shape(self.x) != np.shape(self.y):
            raise ValueError(
                f"a line needs x (n,) and y (n,), got {np.shape(self.x)} and {np.shape(self.y)}"
            )


def line_through(
    places: Complex,
    label: str = "",
    *,
    stable: bool = True,
    points: bool = False,
    bars: bool = False,
) -> ChartLine:
    """A line through points x + iy (n,) [SI], see `ChartLine`; `LINE_BREAK` interrupts the line.

    >>> line_through(np.array([1.0, 2.0j]), "way").y.tolist()
    [0.0, 2.0]
    """
    return ChartLine(places.real, places.imag, label, stable, points, bars)


@dataclass(frozen=True)
class Field:
    """Values over a grid or over triangles, drawn as filled contours; NaN stays white.

    Attributes
    ----------
    x, y : ndarray (m,), (n,)
        Coordinates of the grid [SI]; with triangles, the coordinates of all values, (k,) each.
    values : ndarray (m, n), or (k,)
        Values of the field [its unit]. Where values change their sign through infinity, the
        drawing shows a zero, unless there is NaN between them.
    label, unit : str
        Name and unit of the values, for the colour bar.
    signed : bool
        Whether zero is a singularity: the two signs have two colours, and a line marks the zero.
    triangles : ndarray (t, 3) or None
        Indices of the points at the corners of each triangle. Triangles give the field a smooth
        outline of any shape, where a grid would give a jagged one.
    """

    x: Array
    y: Array
    values: Array
    label: str
    unit: str
    signed: bool = False
    triangles: Index | None = None

    def __post_init__(self) -> None:
        if self.triangles is None:
            if np.shape(self.values) != np.shape(self.x) + np.shape(self.y):
                raise ValueError(
                    f"a field needs values (m, n) at x (m,) and y (n,), got "
                    f"{np.shape(self.values)} at {np.shape(self.x)}, {np.shape(self.y)}"
                )
        elif not np.shape(self.values) == np.shape(self.x) == np.shape(self.y):
            raise ValueError(
                f"a field over triangles needs values, x and y (k,), got {np.shape(self.values)} "
                f"at {np.shape(self.x)}, {np.shape(self.y)}"
            )

    @property
    def places(self) -> tuple[Array, Array]:
        """Coordinates of the points with finite values; with triangles, of all corners [SI]."""
        if self.triangles is None:
            i, j = np.nonzero(np.isfinite(self.values))
            return self.x[i], self.y[j]
        corners = np.unique(self.triangles)
        return self.x[corners], self.y[corners]


@dataclass(frozen=True)
class ChartRegion:
    """An area that is bounded by closed outlines; an outline within another one is a hole.

    Attributes
    ----------
    outlines : tuple of ndarray (n, 2)
        Points on each outline [SI].
    label : str
        Name of the region in the legend; regions with the same label are filled in the same way.
    area : float
        Area of the region [its unit], written into it where there is room; NaN is not written.
    """

    outlines: tuple[Array, ...]
    label: str
    area: float = float("nan")

    def __post_init__(self) -> None:
        for outline in self.outlines:
            if np.ndim(outline) != 2 or np.shape(outline)[1] != 2:
                raise ValueError(f"an outline needs points (n, 2), got {np.shape(outline)}")


@dataclass(frozen=True)
class Panel:
    """One pair of axes with lines, drawn over regions or over a field, and a short title."""

    lines: tuple[ChartLine, ...] = ()
    field: Field | None = None
    title: str = ""
    regions: tuple[ChartRegion, ...] = ()


@dataclass(frozen=True)
class Chart:
    """Panels with the same axes.

    Attributes
    ----------
    x, y : tuple of str
        Name and SI unit of each axis, such as ("x", "m"); "rad" is drawn in degrees, and for "" no
        unit is drawn.
    panels : tuple of Panel
        One to twelve panels.
    caption : str
        What the chart shows, in a sentence or two.
    equal_scales : bool
        Whether both axes have the same scale, as shapes need it.
    logarithmic : bool
        Whether the vertical axis is logarithmic; values that are not positive are left out.

    Examples
    --------
    >>> load = np.linspace(0.0, 2.0, 5)
    >>> panel = Panel((ChartLine(load**2, load),))
    >>> len(Chart(("deflection", "m"), ("load", "N"), (panel,), "It hardens.").lines)
    1
    >>> ChartLine(load, load[1:])
    Traceback (most recent call last):
    ValueError: a line needs x (n,) and y (n,), got (5,) and (4,)
    """

    x: tuple[str, str]
    y: tuple[str, str]
    panels: tuple[Panel, ...]
    caption: str
    equal_scales: bool = False
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not 1 <= len(self.panels) <= MAX_PANELS:
            raise ValueError(f"a chart has 1 to {MAX_PANELS} panels, got {len(self.panels)}")

    @property
    def lines(self) -> tuple[ChartLine, ...]:
        """The lines of all panels."""
        return tuple(line for panel in self.panels for line in panel.lines)

    @property
    def regions(self) -> tuple[ChartRegion, ...]:
        """The regions of all panels."""
        return tuple(region for panel in self.panels for region in panel.regions)
