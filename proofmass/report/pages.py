"""The pages: one for each case, and an index.  They open from disk and fetch nothing."""

import os
import platform
import re
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from proofmass.case import Case
from proofmass.check import Result
from proofmass.errors import InputError
from proofmass.report import tables
from proofmass.report.data import Shown, shown
from proofmass.report.figures import make
from proofmass.report.style import Look, looks
from proofmass.report.svg import inline
from proofmass.report.words import LOST, SYMBOLS, headline, number, spoken

PACKAGES = ("proofmass", "mujoco", "pymunk", "numpy", "scipy")
HEADINGS = {"sweep": "Sweep: the mechanism pose by pose, no time stepping",
            "duration": "Duration: the motion over time, as each engine steps it"}
CAPTIONS = {
    "overlay": "Reference (thick, pale) and solvers on top of it; angles in degrees.",
    "difference": "Absolute difference to the reference, in SI units as in the table. Dashed level "
                  "lines: what the tolerance allows. Exact zeros run into the lower edge.",
}


def write_report(result: Result, folder: Path | str,
                 progress: Callable[[str, int, int], None] = lambda *_: None) -> Path:
    """Write the index, a page for each case, and every figure as SVG and PNG.

    Parameters
    ----------
    result : Result
        From `proofmass.check.check`.
    folder : path
        Made when it is not there; pages of the same name are replaced.
    progress : callable, optional
        Called as ``progress(label, done, total)`` after each case.

    Returns
    -------
    Path
        The ``index.html``.
    """
    folder = Path(folder)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    style, env, facts = looks(c.solver for c in result.comparisons), environment(), about()
    cards = []
    for k, case in enumerate(result.cases):
        views = [shown(result, case, kind) for kind in ("sweep", "duration") if kind in case.run]
        cards.append(card(case, views, style, folder))
        page = env.get_template("case.html").render(
            case=case, card=cards[-1], parts=[part(v, style, folder) for v in views], style=style,
            reasons=tables.reasons(case), about=facts,
            unnoticed=tables.unnoticed(case, [c for v in views for c in v.rows]))
        (folder / cards[-1]["page"]).write_text(page, encoding="utf-8")
        progress(case.name, k + 1, len(result.cases))
    index = folder / "index.html"
    index.write_text(env.get_template("index.html").render(
        cards=cards, style=style, about=facts, errors=[complaint(e) for e in result.errors],
        loose=[c for c in result.comparisons if not c.channel]), encoding="utf-8")
    return index


def environment() -> Environment:
    """The templates, autoescaped; an unknown name in them is an error."""
    env = Environment(loader=PackageLoader("proofmass.report"), autoescape=True,
                      undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    env.filters["number"] = number
    env.globals["symbols"] = SYMBOLS
    return env


def slug(name: str) -> str:
    """A name that any file system and any link can bear.

    >>> slug("four bar/ö")
    'four_bar__'
    """
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


def complaint(error: InputError) -> str:
    """The message of an input at fault, without the folders of the machine it was made on."""
    return str(error).replace(str(error.file), error.file.name)


def card(case: Case, views: list[Shown], style: dict[str, Look], folder: Path) -> dict[str, Any]:
    """A case in short: verdict, counts, thumbnail."""
    rows = [c for v in views for c in v.rows]
    counts = Counter(c.outcome for c in rows)
    drawn = next((v for v in views if v.curves), None)
    stem = f"{slug(case.name)}-thumbnail"
    picture = inline(make(drawn, style, "thumbnail", folder / "figures" / stem), stem,
                     f"{case.name}: {drawn.channels[0]} over {drawn.x_name}") if drawn else ""
    steps = {s: float(str(c.settings["timestep"])) for v in views if v.kind == "duration"
             for s, c in v.curves.items() if "timestep" in c.settings}
    bad = [o for o in ("differs", *LOST) if counts[o]]
    return {"name": case.name, "title": case.title, "page": f"{slug(case.name)}.html",
            "headline": headline(case, rows, steps),
            "state": "bad" if bad or not rows else "good" if counts["agrees"] else "open",
            "counts": [(o, counts[o]) for o in SYMBOLS if counts[o]],
            "picture": Markup(picture)}


def part(view: Shown, style: dict[str, Look], folder: Path) -> dict[str, Any]:
    """All that a page shows of one run."""
    figures = []
    for what, caption in CAPTIONS.items() if view.curves else ():
        stem = f"{slug(view.case.name)}-{view.kind}-{what}"
        svg = make(view, style, what, folder / "figures" / stem)
        label = (f"{view.case.name}, {view.kind}, {what}: {', '.join(view.channels)} over "
                 f"{view.x_name}; numbers in the table below")
        figures.append({"svg": Markup(inline(svg, stem, label)), "caption": caption, "stem": stem})
    return {"kind": view.kind, "figures": figures, "groups": tables.comparisons(view),
            "extrema": tables.extrema(view) if view.curves else [], "costs": tables.costs(view),
            "missing": tables.missing(view), "n": len(next(iter(view.curves.values())).x)
            if view.curves else 0, "over": f"{view.x_name} [{view.x_unit}]",
            "lost": [f"{spoken(s)} is not drawn: {c.outcome}. {c.message}"
                     for s, c in view.lost.items()],
            "what": HEADINGS[view.kind]}


def about() -> list[tuple[str, str]]:
    """Versions, machine and date; no host name, no paths."""
    found = []
    for name in PACKAGES:
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            found.append((name, "not installed"))
    return [*found, ("python", platform.python_version()),
            ("machine", f"{platform.system()} {platform.machine()}, {os.cpu_count()} processors"),
            ("date", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")]
