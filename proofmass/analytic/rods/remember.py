"""Results that problems equal in five digits share.

Sensitivities ask for many problems that differ in the sixth digit; Newton's method gets from the
equilibrium of one to that of another in a step, a search begins at nothing every time.
"""

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Any, TypeVar

Found = TypeVar("Found")
KEPT = 64


def shared(function: Callable[..., Found]) -> Callable[..., Found]:
    """Remember results by the arguments' first five digits: those of the first that has them.

    Threads that ask for the same wait for the one that came first.
    """
    known: dict[Any, Found] = {}
    lock = Lock()

    @wraps(function)
    def remembered(*given: Any) -> Found:
        key = rough(given)
        with lock:
            if key not in known:
                if len(known) == KEPT:
                    del known[next(iter(known))]
                known[key] = function(*given)
            return known[key]

    return remembered


def rough(value: Any) -> Any:
    """Numbers in five digits, in tuples of tuples.

    >>> rough((0.123456, (3.0, None)))
    (0.12346, (3.0, None))
    """
    if isinstance(value, tuple):
        return tuple(map(rough, value))
    return float(f"{value:.5g}") if isinstance(value, float) else value
