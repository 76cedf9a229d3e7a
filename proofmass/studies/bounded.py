"""Call a function in a worker process, within the limits of time and memory of a case's run.

Studies compile changed models and evaluate references in this way.
"""

from collections.abc import Callable
from typing import Any

from proofmass.base.strict import Kind
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.case.case import Case


def call_limited(case: Case, kind: Kind, function: Callable, *args: Any, least: float = 0.0) -> Any:
    """Call a function in a worker, within the limits of a run; it has at least `least` [s]."""
    limits = case.run[kind]
    return call_isolated(function, *args, timeout=max(limits.timeout, least), memory=limits.memory)


def call_bounded(case: Case, kind: Kind, function: Callable, *args: Any) -> Any:
    """Call a function as `call_limited` does; raise InputError if it reaches a limit or crashes.

    For calls that are no runs of an engine: they compile a model or evaluate a reference.
    """
    try:
        return call_limited(case, kind, function, *args)
    except (TimedOut, OutOfMemory, Crashed) as error:
        raise case.error(f"run.{kind}", f"its model or its reference: {error}") from None
