"""The look of each solver: colour, dash pattern and marker, the same in every figure.

Colours are of published palettes, the first ones those of Okabe and Ito, which colour-blind readers
can distinguish; dash pattern and marker distinguish twelve solvers on a black-and-white print too.
"""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import cycle
from typing import Any

from proofmass.sim.engines import hosted_names, own_engines

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
    "mujoco": FIRST_LOOK,
    "pymunk": Look("#D55E00", (0, (5, 1.5)), "s", 1),
    "mujoco:default": Look("#4B9DCB", (0, (1.2, 1.2)), "^", 2),
    "pymunk:default": Look("#C68900", (0, (5, 1.5, 1, 1.5)), "v", 3),
    "mujoco:fine": Look("#009E73", (0, (8, 2)), "D", 4),
    "mujoco:settled": Look("#882255", (0, (2, 1)), "d", 5),
    "pymunk:fine": Look("#CC79A7", (0, (3, 1, 1, 1, 1, 1)), "P", 6),
    "spare 1": Look("#EE6677", (0, (4, 4)), "X", 7),
    "spare 2": Look("#225522", (0, (1, 3)), "*", 8),
    "spare 3": Look("#53377A", (0, (9, 1.5, 3, 1.5)), "p", 9),
    "spare 4": Look("#7F180D", (0, (3, 3, 1, 3)), "<", 10),
    "spare 5": Look("#B15928", (0, (6, 1, 1, 1, 1, 1, 1, 1)), ">", 11),
}
"""Looks of solvers, and spare ones; of any two, colour, dash pattern and marker all differ.

The first five colours and that of ``pymunk:fine`` are those of Okabe and Ito, their sky blue and
orange darker, for the contrast of lines to white paper; the others are wine of Tol's muted scheme,
red of his bright one, his dark green, strong violet and reddish brown of Kelly's colours of maximum
contrast, and brown of ColorBrewer's Paired.
"""
SPARE_LOOKS = [look for name, look in PALETTE.items() if name.startswith("spare ")]
FIXED_LOOKS = {name: look for name, look in PALETTE.items() if look not in SPARE_LOOKS}
LENT_LOOKS = [*SPARE_LOOKS, *reversed(FIXED_LOOKS.values())]
"""Looks for other solvers in the order in which they are taken: those of solvers that are not in
the figure come after the spare ones."""
HATCHES = (
    *("", "////", "....", "xxxx", "\\\\\\\\", "----", "||||", "++++", "oo"),
    *("**", "//..", "\\\\--", "||..", "OO"),
)
"""Hatches of filled areas, one for each engine."""
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

    Up to twelve differ in colour, in dash pattern and in marker, further ones in the three
    together.  An engine in an interpreter of its own has its place among these, and of any other
    solver the look follows from the name, so that a solver looks the same in every report.  If
    several have the same one, those later in the alphabet get the next that is free.

    >>> solver_looks(["pymunk", "adams"])["pymunk"].colour
    '#D55E00'
    >>> solver_looks(["simpack"])["simpack"] == solver_looks(["adams", "simpack"])["simpack"]
    True
    """
    names, places = set(solvers), {name: k for k, name in enumerate(hosted_names())}
    chosen = {name: FIXED_LOOKS[name] for name in FIXED_LOOKS if name in names}
    free = [look for look in LENT_LOOKS if look not in chosen.values()]
    rounds = 0
    others = names - set(chosen)
    for name in sorted(others, key=lambda one: (places.get(one, len(places)), ":" in one, one)):
        if not free:
            rounds, free = rounds + 1, [mix_looks(look, rounds + 1) for look in LENT_LOOKS]
        spare = (zlib.crc32(name.encode()) >> 8) % len(SPARE_LOOKS)
        wanted = places.get(name, spare) % len(LENT_LOOKS)
        numbers = [look.number for look in (*LENT_LOOKS[wanted:], *LENT_LOOKS[:wanted])]
        chosen[name] = min(free, key=lambda look: numbers.index(look.number % len(numbers)))
        free.remove(chosen[name])
    return chosen


def mix_looks(look: Look, shift: int) -> Look:
    """A look of the palette with the dash pattern and the marker of one that is farther on."""
    other = [*PALETTE.values()][(look.number + shift) % len(PALETTE)]
    return Look(look.colour, other.dash, other.marker, look.number + shift * len(PALETTE))


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
    own, there = own_engines(), set(engines)
    fixed = {name: HATCHES[k] for k, name in enumerate(own) if name in there}
    free = [hatch for hatch in (*HATCHES[len(own) :], *HATCHES) if hatch not in fixed.values()]
    return fixed | dict(zip(sorted(there - set(own)), cycle(free), strict=False))
