"""HTML of cases, results and comparisons, for notebooks."""

import io
from base64 import b64encode
from collections.abc import Iterable, Sequence
from functools import singledispatch
from html import escape

from matplotlib import rc_context

from proofmass.base.strict import Kind
from proofmass.base.wording import format_unit, number
from proofmass.base.worker import call_isolated
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.formats.terminal import OUTCOME_SIGNS
from proofmass.reference.evaluate import properties
from proofmass.report.case_figures import compute_motion
from proofmass.report.mechanism import distinct_poses, small_figure
from proofmass.report.style import RC
from proofmass.sim.engines import format_solver
from proofmass.verdict.comparison import Comparison

DRAWING_SECONDS = 30.0  # [s] time limit for the drawing of a case
POSES = 25


@singledispatch
def as_html(thing: object) -> str:
    """Return a case, a result or comparisons as HTML, which a notebook shows.

    Parameters
    ----------
    thing : Case, Result, Comparison or sequence of Comparison

    Returns
    -------
    str
        HTML.

    Raises
    ------
    TypeError
        The object is something else.

    Examples
    --------
    >>> from proofmass import as_html, load_case
    >>> "<th>reference</th><td>fourbar" in as_html(load_case("models/linkages/fourbar.toml"))
    True
    """
    raise TypeError(f"{type(thing).__name__} is neither a case nor comparisons")


@as_html.register
def _(case: Case) -> str:
    kept = ", ".join(
        f"{k} = {v:.6g}" if isinstance(v, float) else f"{k} = {v}"
        for k, v in case.parameters.items()
    )
    rows = [
        ("model", case.model),
        ("reference", f"{case.reference}({kept})"),
        ("drives", ", ".join(drive.joint for drive in case.drive) or "none"),
        *(
            (
                f"run.{kind}",
                f"{run.n or 'as recorded'} samples in {', '.join(map(format_solver, run.solvers))}",
            )
            for kind, run in case.run.items()
        ),
        ("channels", str(len(case.channels))),
        *properties(case).items(),
    ]
    body = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    return (
        f"<div><p><b>{escape(case.name)}</b>: {escape(case.title)}</p>{drawing_html(case)}"
        f"<table>{body}</table></div>"
    )


@as_html.register
def _(comparison: Comparison) -> str:
    return comparisons_table([comparison])


@as_html.register(list)
@as_html.register(tuple)
def _(comparisons: Sequence[Comparison]) -> str:
    if not all(isinstance(one, Comparison) for one in comparisons):
        raise TypeError("a list of something else than comparisons")
    return comparisons_table(comparisons)


@as_html.register
def _(result: Result) -> str:
    wrong = "".join(f"<p>error: {escape(str(error))}</p>" for error in result.errors)
    return wrong + comparisons_table(result.comparisons)


def comparisons_table(rows: Iterable[Comparison]) -> str:
    """Return comparisons as a table in HTML, one row each."""
    head = "".join(
        f"<th>{name}</th>"
        for name in ("run", "solver", "channel", "outcome", "largest error", "allowed", "of range")
    )
    body = "".join(
        f"<tr><td>{c.run}</td><td>{escape(format_solver(c.solver))}</td><td>{escape(c.channel)}</td>"
        f"<td>{OUTCOME_SIGNS.get(c.outcome, ('✗', ''))[0]} {c.outcome}</td>"
        f"<td>{number(c.error_max)} {format_unit(c.unit)}</td><td>{number(c.allowed)}</td>"
        f"<td>{number(c.relative_to_range)}</td></tr>"
        for c in rows
    )
    return f"<div><table><tr>{head}</tr>{body}</table></div>"


def drawing_html(case: Case) -> str:
    """Draw the mechanism at some poses of its first run; empty where it cannot be drawn."""
    try:
        svg = call_isolated(draw_small, case, next(iter(case.run)), timeout=DRAWING_SECONDS)
    except Exception:  # a run of the case reports what is wrong with its model
        return ""
    data = b64encode(svg).decode()
    words = escape(f"drawing of {case.name}")
    return f'<img src="data:image/svg+xml;base64,{data}" alt="{words}" width="260">'


def draw_small(case: Case, kind: Kind) -> bytes:
    """Draw the mechanism as SVG; `drawing_html` calls this in another process."""
    picture = distinct_poses(compute_motion(case, kind, {}, POSES).picture)
    stream = io.BytesIO()
    with rc_context(RC):
        small_figure(picture, {}).savefig(
            stream, format="svg", metadata={"Date": None, "Creator": None}
        )
    return stream.getvalue()
