"""A matplotlib SVG made fit to stand inside a page beside others."""

import re
from html import escape

HEAD = re.compile(r"<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>|<!--.*?-->|"
                  r"<style type=\"text/css\">.*?</style>", re.DOTALL)
SIZE = re.compile(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>')
USED = re.compile(r'(?:href="|url\()#([\w.-]+)')
ID = re.compile(r' id="([^"]*)"')
LONG = re.compile(r"(-?\d+\.\d\d)\d+")


def inline(text: str, key: str, label: str) -> str:
    """The element ``<svg>`` of a file, with ids of its own and short numbers.

    Parameters
    ----------
    text : str
        The SVG file that matplotlib wrote.
    key : str
        Put before every id, so that two figures of a page do not share one.
    label : str
        What a screen reader says.

    Returns
    -------
    str

    Examples
    --------
    >>> inline('<svg viewBox="0 0 9 9"><g id="a"/><use href="#b"/><path id="b"/></svg>', "k", "x")
    '<svg viewBox="0 0 9 9" role="img" aria-label="x"><g/><use href="#k-b"/><path id="k-b"/></svg>'
    """
    text = HEAD.sub("", text).replace("xlink:href", "href")
    text = SIZE.sub(lambda m: f'<svg viewBox="{m[1]}" role="img" aria-label="{escape(label)}">',
                    text, count=1)
    used = set(USED.findall(text))
    text = ID.sub(lambda m: f' id="{key}-{m[1]}"' if m[1] in used else "", text)
    text = USED.sub(lambda m: m[0].replace("#" + m[1], f"#{key}-{m[1]}"), text)
    return re.sub(r"\n\s*", "\n", LONG.sub(r"\1", text)).strip()
