"""Calls that compile a changed model or evaluate a reference, in a worker within limits."""

from collections.abc import Callable
from typing import Any

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.strict import Kind
from proofmass.worker import Crashed, OutOfMemory, TimedOut, isolated


def limited(case: Case, kind: Kind, function: Callable, *args: Any, least: float = 0.0) -> Any:
    """`isolated`, within the limits of one of a case's runs, with at least so much time [s]."""
    limits = case.run[kind]
    return isolated(function, *args, timeout=max(limits.timeout, least), memory=limits.memory)


def bounded(case: Case, kind: Kind, function: Callable, *args: Any) -> Any:
    """`limited` for a call that is no run itself; raises InputError where it reaches a limit."""
    try:
        return limited(case, kind, function, *args)
    except (TimedOut, OutOfMemory, Crashed) as error:
        raise InputError(case.file, f"run.{kind}", f"its model or its reference: {error}") from None
