"""Charts: what a closed form knows beside the curves of a run, as data that a report can draw.

A reference's module may have functions that make one of its parameters: all equilibria of a
mechanism, its workspace, its buckling loads.  A sidecar's ``[[chart]]`` names such a function; it
takes parameters by name and says ``-> Chart``.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array, Complex, Index

MOST = 12  # panels that a page has room for
GAP = complex(np.nan, np.nan)
"""Breaks a line of places x + iy."""


@dataclass(frozen=True)
class ChartLine:
    """A line through points, or the points alone; NaN breaks it.

    Attributes
    ----------
    x, y : ndarray (n,)
        Places [SI].
    label : str
        What it is, for the legend; lines of one label are drawn alike.
    stable : bool
        Drawn bold; what is unstable thin and dashed.
    points : bool
        Markers instead of a line: filled, or hollow if unstable.
    bars : bool
        Links of a mechanism: thick, with a pin at every point; thin and dashed if unstable, as
        for another pose of the same links.
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
    """A line through places x + iy (n,) [SI], drawn as `ChartLine` says; `GAP` breaks it.

    >>> line_through(np.array([1.0, 2.0j]), "way").y.tolist()
    [0.0, 2.0]
    """
    return ChartLine(places.real, places.imag, label, stable, points, bars)


@dataclass(frozen=True)
class Field:
    """Values over a grid, or over triangles, drawn as filled contours; NaN stays white.

    Attributes
    ----------
    x, y : ndarray (m,), (n,)
        The grid [SI]; with triangles, the places of all values, (k,) each.
    values : ndarray (m, n), or (k,)
        [its unit]; those that pass through infinity are drawn as a singularity of zero unless NaN
        is between.
    label, unit : str
        What they are, for the colour bar.
    signed : bool
        Zero is a singularity: two colours that part there, and a line on it.
    triangles : ndarray (t, 3) or None
        Numbers of the places at their corners: a field of any outline, which a grid would jag.
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
        """Where it has finite values [SI]."""
        if self.triangles is None:
            i, j = np.nonzero(np.isfinite(self.values))
            return self.x[i], self.y[j]
        seen = np.unique(self.triangles)
        return self.x[seen], self.y[seen]


@dataclass(frozen=True)
class ChartRegion:
    """An area that closed outlines bound; those within others are its holes.

    Attributes
    ----------
    outlines : tuple of ndarray (n, 2)
        Points on each of them [SI].
    label : str
        What it is, for the legend; regions of one label are filled alike.
    area : float
        Its size [its unit], written into it where there is room; NaN is not.
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
    """One pair of axes: lines on regions or on a field, under a title of a few words."""

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
        Name and SI unit of both axes, such as ("x", "m"); "rad" is drawn in degrees, "" not at all.
    panels : tuple of Panel
        One to twelve.
    caption : str
        What to see, in a sentence or two.
    alike : bool
        One scale across and up, as for shapes.
    logarithmic : bool
        A logarithmic axis up, on which values that are not positive are left out.

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
    alike: bool = False
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not 1 <= len(self.panels) <= MOST:
            raise ValueError(f"a chart has 1 to {MOST} panels, got {len(self.panels)}")

    @property
    def lines(self) -> tuple[ChartLine, ...]:
        """Those of all panels."""
        return tuple(line for panel in self.panels for line in panel.lines)

    @property
    def regions(self) -> tuple[ChartRegion, ...]:
        """Those of all panels."""
        return tuple(region for panel in self.panels for region in panel.regions)
