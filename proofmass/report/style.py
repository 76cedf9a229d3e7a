"""The look of each solver: colour, dash pattern and marker, the same in every figure.

Colours are those of Okabe and Ito, which colour-blind readers can distinguish; dash pattern and
marker distinguish the solvers on a black-and-white print as well.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import Any
from zlib import crc32

from proofmass.sim.engines import own_engines

Dash = tuple[int, tuple[float, ...]]


@dataclass(frozen=True)
class Look:
    """Colour, dash pattern and marker of one solver, and its number for staggering markers."""

    colour: str
    dash: Dash
    marker: str
    number: int = 0

    @property
    def line(self) -> dict[str, Any]:
        """Keyword arguments of matplotlib for a line with this look."""
        return {"color": self.colour, "linestyle": self.dash, "marker": self.marker}


SOLID: Dash = (0, ())
FIRST_LOOK = Look("#0072B2", SOLID, "o", 0)
PALETTE = {
    (0, ""): FIRST_LOOK,
    (1, ""): Look("#D55E00", (0, (5, 1.5)), "s", 1),
    (0, "default"): Look("#56B4E9", (0, (1.2, 1.2)), "^", 2),
    (1, "default"): Look("#E69F00", (0, (5, 1.5, 1, 1.5)), "v", 3),
    (0, "fine"): Look("#009E73", (0, (8, 2)), "D", 4),
    (0, "settled"): Look("#882255", (0, (2, 1)), "d", 5),
    (1, "fine"): Look("#CC79A7", (0, (3, 1, 1, 1, 1, 1)), "P", 6),
}
"""Looks by the index of an engine among those of this distribution, and by the variant."""
FIXED_LOOKS = {
    f"{name}:{variant}".rstrip(":"): look
    for (k, variant), look in PALETTE.items()
    for name in own_engines()[k : k + 1]
}
HATCHES = "", "////", "....", "xxxx", "\\\\\\\\"
"""Hatches of filled areas, one for each engine."""
SPARE_LOOKS = [
    (c, d, m)
    for m, (d, c) in zip(
        "Xp*h<>Xp*h<>",
        product(
            [(0, (2, 2)), (0, (7, 1, 1, 1)), (0, (4, 4)), (0, (1, 3))],
            ["#CC79A7", "#444444", "#8A6D00"],
        ),
        strict=True,
    )
]
INK, LABEL_COLOUR, WRONG_COLOUR = "#1b1f24", "#333333", "#8a1c1c"
"""Colours of lines and letters, of less important ones, and of words on what is wrong."""
# for charts, from Tol's muted scheme
MUTED_COLOURS = ("#332288", "#CC6677", "#117733", "#AA4499", "#999933", "#44AA99")
REFERENCE_STYLE: dict[str, Any] = {"color": "#c4c4c4", "linewidth": 4.5, "solid_capstyle": "round"}

FONT_FAMILY = "DejaVu Sans"
"""Font of figures, which comes with matplotlib; in SVG `figures.save` adds others."""
RC: dict[Any, Any] = {
    "font.family": FONT_FAMILY,
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # a fixed place: finding a free one takes as long as drawing
    "axes.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-3, 4),
    "axes.unicode_minus": False,
    "grid.color": "#ececec",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.bottom": False,  # the lines of the grid replace tick marks
    "ytick.left": False,
    "lines.linewidth": 1.1,
    "path.simplify_threshold": 0.2,
    "lines.markersize": 3.2,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "proofmass",
}


def solver_looks(solvers: Iterable[str]) -> dict[str, Look]:
    """Return a look for every solver; those without a fixed look get spare ones.

    The spare look follows from the name, so that a solver looks the same in every report.  If
    several names have the same one, those later in the alphabet get the next that is free.

    >>> solver_looks(["pymunk", "adams"])["pymunk"].colour
    '#D55E00'
    >>> solver_looks(["simpack"])["simpack"] == solver_looks(["adams", "simpack"])["simpack"]
    True
    """
    chosen = {}
    free = list(range(len(SPARE_LOOKS)))
    for name in sorted(set(solvers)):
        if name in FIXED_LOOKS:
            chosen[name] = FIXED_LOOKS[name]
            continue
        wanted = (crc32(name.encode()) >> 8) % len(SPARE_LOOKS)
        spare = min(free, key=lambda k: (k - wanted) % len(SPARE_LOOKS))
        free = [k for k in free if k != spare] or list(range(len(SPARE_LOOKS)))
        chosen[name] = Look(*SPARE_LOOKS[spare], number=len(FIXED_LOOKS) + spare)
    return chosen


BACKGROUNDS = {"light": "#ffffff", "dark": "#191d21"}
"""Background of curves on light and on dark pages."""
TEXT_CONTRAST = 4.5
"""Least contrast of small letters to the background (WCAG 2.2, 1.4.3); lines need 3."""


def luminance(colour: str) -> float:
    """Return the relative luminance of a colour such as ``#0072B2`` (WCAG 2.2)."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    red, green, blue = (
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    """Return the contrast of two colours, from 1 to 21 (WCAG 2.2).

    >>> contrast("#000000", "#ffffff")
    21.0
    """
    low, high = sorted((luminance(one), luminance(other)))
    return round((high + 0.05) / (low + 0.05), 3)


def make_legible(colour: str, paper: str, least: float = TEXT_CONTRAST) -> str:
    """Mix a colour with black or white until its contrast to the paper is large enough.

    >>> make_legible("#0072B2", "#ffffff"), make_legible("#0072B2", "#191d21") == "#0072B2"
    ('#0072B2', False)
    """
    towards = 255 if luminance(paper) < 0.2 else 0
    parts = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    for share in range(101):
        mixed = [round(part + (towards - part) * share / 100) for part in parts]
        found = "#" + "".join(f"{part:02X}" for part in mixed)
        if contrast(found, paper) >= least:
            break
    return found


def engine_hatches(engines: Iterable[str]) -> dict[str, str]:
    """Return a hatch for every engine; engines of this distribution have fixed ones.

    >>> engine_hatches(["pymunk", "adams"])
    {'pymunk': '////', 'adams': 'xxxx'}
    """
    own = own_engines()
    other = sorted(set(engines) - set(own))
    return {
        name: HATCHES[k % len(HATCHES)]
        for k, name in enumerate([*own, *other])
        if name in set(engines)
    }
