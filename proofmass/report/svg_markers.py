"""Markers of figures as paths of SVG, so that pages have the same markers as figures for papers.

Colours are chosen in `proofmass.report.style`.
"""

from collections.abc import Iterable
from typing import NamedTuple

from proofmass.report.style import BACKGROUNDS, TEXT_CONTRAST, make_legible

MARKER_PATHS = {
    "o": "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0z",
    "s": "M-3.6-3.6h7.2v7.2h-7.2z",
    "^": "M0-4.6l4.4 8h-8.8z",
    "v": "M0 4.6l4.4-8h-8.8z",
    "<": "M-4.6 0l8-4.4v8.8z",
    ">": "M4.6 0l-8-4.4v8.8z",
    "D": "M0-4.9l4.9 4.9l-4.9 4.9l-4.9-4.9z",
    "d": "M0-5l3.2 5l-3.2 5l-3.2-5z",
    "p": "M0-4.6l4.4 3.2l-1.7 5.2h-5.4l-1.7-5.2z",
    "h": "M0-4.8l4.2 2.4v4.8l-4.2 2.4l-4.2-2.4v-4.8z",
    "P": "M-1.5-4.6h3v3.1h3.1v3h-3.1v3.1h-3v-3.1h-3.1v-3h3.1z",
    "X": "M-4.4-2.4l2-2l2.4 2.4l2.4-2.4l2 2l-2.4 2.4l2.4 2.4l-2 2l-2.4-2.4l-2.4 2.4l-2-2l2.4-2.4z",
    "*": "M0-5.2l1.5 3.5l3.8.4l-2.9 2.5l.9 3.8l-3.3-2l-3.3 2l.9-3.8l-2.9-2.5l3.8-.4z",
}
"""Markers by matplotlib's letters, as paths about (0, 0), about 9 pixels wide."""


LINE_CONTRAST = 3.0
"""Least contrast of lines and markers to their background (WCAG 2.2, 1.4.11)."""


class Tone(NamedTuple):
    """A colour of figures on a page: a CSS class, and its colours on light and on dark paper.

    `light` and `dark` are for lines and markers, `light_ink` and `dark_ink` for letters.
    """

    css: str
    light: str
    dark: str
    light_ink: str
    dark_ink: str


def page_tones(colours: Iterable[str]) -> dict[str, Tone]:
    """Return a tone for each different colour.

    >>> page_tones(["#0072B2", "#D55E00", "#0072B2"])["#D55E00"].css
    't1'
    """
    return {
        colour: Tone(
            f"t{k}",
            *(
                make_legible(colour, BACKGROUNDS[paper], LINE_CONTRAST)
                for paper in ("light", "dark")
            ),
            *(
                make_legible(colour, BACKGROUNDS[paper], TEXT_CONTRAST)
                for paper in ("light", "dark")
            ),
        )
        for k, colour in enumerate(dict.fromkeys(colours))
    }
