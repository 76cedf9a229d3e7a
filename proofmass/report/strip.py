"""A row of a chart that is a table: places on an axis that all rows have in common."""

from dataclasses import dataclass
from math import log


@dataclass(frozen=True)
class Strip:
    """What is drawn in a row, at places from 0 to 100 [%].

    Attributes
    ----------
    said : str
        What is to be seen, in words.
    css : str
        Class of its colour.
    grid : list of float
        Where lines stand behind all rows [%].
    mark : str
        The marker at `dot`, from `proofmass.report.svg_markers.MARKS`.
    hollow : bool
        Whether only its outline is drawn.
    dot, tick : float, optional
        Places of what was measured, and of what it is held against [%].
    bar, spread : tuple of float, optional
        From where to where a bar goes, and the interval that is known of its end [%].
    band : tuple of float, optional
        Where the band of what is allowed begins, and how wide it is [%].
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


def place(value: float, low: float, high: float) -> float:
    """Place of a value on a logarithmic axis [%]; what lies beyond it stands at its ends.

    >>> place(10.0, 1.0, 100.0), place(0.1, 1.0, 100.0), place(5.0, 1.0, 1.0)
    (50.0, 0.0, 100.0)
    """
    if not high > low:
        return 100.0
    return round(min(max(100 * log(value / low) / log(high / low), 0.0), 100.0), 3)
