"""A row of a chart in a table: marks at places on an axis that all rows have in common."""

from dataclasses import dataclass
from math import log


@dataclass(frozen=True)
class Strip:
    """The marks of a row, at places from 0 to 100 [%].

    Attributes
    ----------
    said : str
        The row in words, for screen readers.
    css : str
        CSS class of the colour.
    grid : list of float
        Places of the lines behind all rows [%].
    mark : str
        The marker at `dot`, from `proofmass.report.svg_markers.MARKER_PATHS`.
    hollow : bool
        Whether only the outline of the marker is drawn.
    dot, tick : float, optional
        Places of the measured value, and of the value that it is compared with [%].
    bar, spread : tuple of float, optional
        Start and end of a bar, and the interval in which its end lies [%].
    band : tuple of float, optional
        Start and width of the band of allowed values [%].
    """

    said: str
    css: str
    grid: list[float]
    mark: str = ""
    hollow: bool = False
    dot: float | None = None
    tick: float | None = None
    bar: tuple[float, float] | None = None
    spread: tuple[float, float] | None = None
    band: tuple[float, float] | None = None


def log_place(value: float, low: float, high: float) -> float:
    """Return the place of a value on a logarithmic axis [%]; values beyond it are at its ends.

    >>> log_place(10.0, 1.0, 100.0), log_place(0.1, 1.0, 100.0), log_place(5.0, 1.0, 1.0)
    (50.0, 0.0, 100.0)
    """
    if not high > low:
        return 100.0
    return round(min(max(100 * log(value / low) / log(high / low), 0.0), 100.0), 3)
