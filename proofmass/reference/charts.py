"""Charts of a case: the functions of the reference that compute them, and their arguments."""

import inspect
from collections.abc import Callable
from functools import partial

from proofmass.analytic.chart import Chart
from proofmass.case.case import Case, ChartTable
from proofmass.reference.find import reference_class

KEYWORD_KINDS = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def compute_chart(case: Case, table: ChartTable) -> Chart:
    """Compute a chart with the reference's function; may take seconds.

    Parameters
    ----------
    case, table
        The case, and its table that describes the chart.

    Returns
    -------
    Chart

    Raises
    ------
    InputError
        As for `bind_chart`; parameters that the function refuses.
    """
    function = bind_chart(case, table)
    try:
        return function()
    except (TypeError, ValueError) as error:
        raise case.error(key_path(case, table, "parameters"), str(error)) from None


def check_charts(case: Case) -> None:
    """Raise InputError if a chart names a function or a parameter that does not exist."""
    for table in case.chart:
        bind_chart(case, table)


def bind_chart(case: Case, table: ChartTable) -> Callable[[], Chart]:
    """Return the function that a chart names, bound to its parameters; nothing is computed.

    The function gets those of the case's parameters that it takes by name; the chart's own
    parameters are added or replace them.

    Raises
    ------
    InputError
        The reference has no such chart, the function has no such parameter, or one is missing.
    """
    there = chart_functions(case)
    if table.draw not in there:
        raise case.error(
            key_path(case, table, "draw"),
            f"{case.reference} has no chart "
            f"{table.draw!r}; there are: {', '.join(there) or 'none'}",
        )
    signature = inspect.signature(there[table.draw])
    takes = {name: p for name, p in signature.parameters.items() if p.kind in KEYWORD_KINDS}
    for name in table.parameters:
        if name not in takes:
            raise case.error(
                key_path(case, table, f"parameters.{name}"),
                f"{table.draw}() has no such parameter; known: {', '.join(takes)}",
            )
    given = {n: v for n, v in {**case.parameters, **table.parameters}.items() if n in takes}
    lacking = [n for n, p in takes.items() if p.default is p.empty and n not in given]
    if lacking:
        raise case.error(
            key_path(case, table, "parameters"),
            f"{table.draw}() also needs {', '.join(lacking)}",
        )
    return partial(there[table.draw], **given)


def chart_functions(case: Case) -> dict[str, Callable[..., Chart]]:
    """Return the charts of the reference by name."""
    reference = reference_class(case)
    return {} if reference is None else {one.__name__: one for one in reference.charts}


def key_path(case: Case, table: ChartTable, key: str) -> str:
    """Return the path of a chart's key in the sidecar, for messages."""
    return case.table_key("chart", case.chart.index(table), key)
