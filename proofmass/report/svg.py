"""Reduction of matplotlib's SVG in size, and its use inside a page with other figures."""

import re
from hashlib import md5
from html import escape

UNUSED_PARTS = re.compile(
    r"<metadata>.*?</metadata>|<!--.*?-->|<style type=\"text/css\">.*?</style>|"
    r" transform=\"rotate\(-0 [^\"]*\"|stroke-dashoffset: 0; ?|<g[^>]*/>",
    re.DOTALL,
)
XML_HEAD = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>", re.DOTALL)
SVG_TAG = re.compile(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>')
REFERENCED_ID = re.compile(r'(?:href="|url\()#([\w.-]+)')
ID = re.compile(r' id="([^"]*)"')
STYLE = re.compile(r' style="([^"]*)"')
TAG = re.compile(r"<[^>]*>")
LONG_NUMBER = re.compile(r"(-?\d+\.\d\d)\d+")
POLYLINE = re.compile(r' d="(M[^"QCz]*)"')
PATH_STEP = re.compile(r"([ML]) (-?[\d.e+-]+) (-?[\d.e+-]+)")
STYLE_SPACE = re.compile(r"(?<=[:;,]) ")
GROUP = re.compile(r"<(/?)g([^>]*)>\n?")
PIXELS_PER_POINT = 1.37
"""Pixels per point on a page: letters of 8 pt are as large as the page's small print."""


def compact_svg(text: str) -> str:
    """Reduce a matplotlib SVG: short numbers, relative lines, CSS classes, and no empty groups.

    Lines are rounded to a tenth of a point, that is 0.04 mm.

    Examples
    --------
    >>> compact_svg('<svg viewBox="0 0 9 9"><g id="a"><path d="M 1.04 1 L 2.16 1.5 "/></g></svg>')
    '<svg viewBox="0 0 9 9"><path d="M1 1l1.2 .5"/></svg>'
    """
    text = UNUSED_PARTS.sub("", text).replace("xlink:href", "href")
    text = POLYLINE.sub(lambda m: f' d="{relative_polyline(m[1])}"', text)
    used = {name: f"i{k}" for k, name in enumerate(dict.fromkeys(REFERENCED_ID.findall(text)))}
    text = ID.sub(lambda m: f' id="{used[m[1]]}"' if m[1] in used else "", text)
    text = REFERENCED_ID.sub(lambda m: m[0].replace("#" + m[1], f"#{used[m[1]]}"), text)
    text = TAG.sub(lambda m: LONG_NUMBER.sub(r"\1", m[0]), text)
    text = re.sub(r"\n\s*", "\n", text)
    return styles_to_classes(remove_empty_groups(text)).strip()


def relative_polyline(path: str) -> str:
    """Rewrite moves and lines of a path with relative coordinates, rounded to tenths."""
    words, here, drawing = [], (0, 0), ""
    for command, *numbers in PATH_STEP.findall(path):
        x, y = (round(10 * float(number)) for number in numbers)
        if command == "M":
            words.append(f"M{format_tenths(x)} {format_tenths(y)}")
        elif (x, y) != here or drawing == "M":
            words.append(
                ("l" if drawing == "M" else " ")
                + f"{format_tenths(x - here[0])} {format_tenths(y - here[1])}"
            )
        here, drawing = (x, y), command
    return "".join(words).replace(" -", "-")


def format_tenths(value: int) -> str:
    """Format a whole number of tenths, as short as possible.

    >>> format_tenths(-5), format_tenths(120), format_tenths(1203)
    ('-.5', '12', '120.3')
    """
    whole, part = divmod(abs(value), 10)
    return "-" * (value < 0) + (f"{whole or ''}.{part}" if part else f"{whole}")


def remove_empty_groups(text: str) -> str:
    """Remove the groups that have no attributes."""
    open_groups: list[str] = []

    def keep(m: re.Match[str]) -> str:
        if m[1]:
            return m[0] if open_groups.pop() else ""
        open_groups.append(m[2].strip())
        return m[0] if m[2].strip() else ""

    return GROUP.sub(keep, text)


def styles_to_classes(text: str) -> str:
    """Replace styles that occur more than twice by CSS classes, named by a hash of the style.

    A class applies to the whole page, so the same style has the same name in all figures.  Styles
    with an id, such as that of a hatch, belong to one figure and are kept.

    >>> hatched = '<svg viewBox="0 0 9 9">' + 3 * '<path style="fill: url(#i7)"/>' + "</svg>"
    >>> styles_to_classes(hatched) == hatched
    True
    """
    found = [style for style in STYLE.findall(text) if "url(#" not in style]
    often = {
        s: "p" + md5(s.encode(), usedforsecurity=False).hexdigest()[:6]
        for s in dict.fromkeys(found)
        if found.count(s) > 2
    }
    text = STYLE.sub(lambda m: f' class="{often[m[1]]}"' if m[1] in often else m[0], text)
    rules = "".join(f".{name}{{{STYLE_SPACE.sub('', style)}}}" for style, name in often.items())
    return SVG_TAG.sub(lambda m: m[0] + f"<style>{rules}</style>" * bool(rules), text, count=1)


def inline_svg(text: str, key: str, label: str) -> str:
    """Return the element ``<svg>`` of a file, with ids and a width that suit a page.

    Parameters
    ----------
    text : str
        From `compact_svg`.
    key : str
        Prefix of every id, so that two figures of a page do not share one.
    label : str
        Description for screen readers.

    Returns
    -------
    str

    Examples
    --------
    >>> text = inline_svg('<svg viewBox="0 0 9 9"><use href="#b"/><path id="b"/></svg>', "key", "x")
    >>> text.removeprefix('<svg viewBox="0 0 9 9" style="max-width:12px" ')
    'role="img" aria-label="x"><use href="#key-b"/><path id="key-b"/></svg>'
    """
    text = XML_HEAD.sub("", text)
    text = SVG_TAG.sub(
        lambda m: (
            f'<svg viewBox="{m[1]}" style="max-width:{width(m[1])}px" role="img" '
            f'aria-label="{escape(label)}">'
        ),
        text,
        count=1,
    )
    used = set(REFERENCED_ID.findall(text))
    text = ID.sub(lambda m: f' id="{key}-{m[1]}"' if m[1] in used else "", text)
    return REFERENCED_ID.sub(lambda m: m[0].replace("#" + m[1], f"#{key}-{m[1]}"), text).strip()


def width(box: str) -> int:
    """Return the width of a figure on a page [px], with which letters have the same size in all."""
    return round(PIXELS_PER_POINT * float(box.split()[2]))
