"""Charts of a case: the function of the reference that makes one, and what it is called with."""

import inspect
from collections.abc import Callable
from functools import partial

from proofmass.analytic.chart import Chart
from proofmass.case import Case, ChartTable
from proofmass.errors import InputError
from proofmass.recorded import Recorded
from proofmass.reference import module_of

NAMED = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def chart_of(case: Case, table: ChartTable) -> Chart:
    """What the reference has to show in a chart; may take seconds.

    Parameters
    ----------
    case, table
        Which chart of which case.

    Returns
    -------
    Chart

    Raises
    ------
    InputError
        As for `bound`; parameters of which the function says that they cannot be.
    """
    function = bound(case, table)
    try:
        return function()
    except (TypeError, ValueError) as error:
        raise InputError(case.file, place(case, table, "parameters"), str(error)) from None


def check_charts(case: Case) -> None:
    """Raise InputError if a chart names a function or a parameter that there is not."""
    for table in case.chart:
        bound(case, table)


def bound(case: Case, table: ChartTable) -> Callable[[], Chart]:
    """The function that a chart names, with its parameters; nothing is computed.

    The function gets those of the case's parameters that it takes by name; the chart's own come in
    addition, or instead of them.
    """
    there = drawers(case)
    if table.draw not in there:
        raise InputError(
            case.file,
            place(case, table, "draw"),
            f"{case.reference} has no chart "
            f"{table.draw!r}; there are: {', '.join(there) or 'none'}",
        )
    signature = inspect.signature(there[table.draw])
    takes = {name: p for name, p in signature.parameters.items() if p.kind in NAMED}
    for name in table.parameters:
        if name not in takes:
            raise InputError(
                case.file,
                place(case, table, f"parameters.{name}"),
                f"{table.draw}() has no such parameter; known: {', '.join(takes)}",
            )
    given = {n: v for n, v in {**case.parameters, **table.parameters}.items() if n in takes}
    lacking = [n for n, p in takes.items() if p.default is p.empty and n not in given]
    if lacking:
        raise InputError(
            case.file,
            place(case, table, "parameters"),
            f"{table.draw}() also needs {', '.join(lacking)}",
        )
    return partial(there[table.draw], **given)


def drawers(case: Case) -> dict[str, Callable[..., Chart]]:
    """Functions of the reference's module that return a chart, by name."""
    reference = module_of(case)
    if isinstance(reference, Recorded):
        return {}
    own = getattr(reference, "__all__", dir(reference))
    return {
        name: f
        for name, f in inspect.getmembers(reference, inspect.isfunction)
        if name in own and inspect.signature(f).return_annotation is Chart
    }


def place(case: Case, table: ChartTable, key: str) -> str:
    """Where a key of a chart stands in the sidecar."""
    return f"chart.{case.chart.index(table)}.{key}"
