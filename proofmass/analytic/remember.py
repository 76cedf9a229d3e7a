"""Results of long searches, from which searches for problems near them begin.

Sensitivities ask for many problems that differ in the sixth digit.  Newton's method gets from the
equilibrium of one to that of another in a step; a search begins at nothing every time.
"""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, wraps
from typing import Any, TypeVar

Answer = TypeVar("Answer")
KEPT = 64
ANSWERS = 16
"""Evaluations of references that are kept."""
Memory = dict[Any, Any]
in_use: ContextVar[tuple[Memory, bool]] = ContextVar("in_use")
answers: dict[tuple[Callable[..., Any], bytes], Any] = {}


@contextmanager
def memory_in_use(memory: Memory, more: bool) -> Iterator[None]:
    """Let `nearby` functions take results from a memory, and add theirs to it if `more` may come.

    Last digits depend on where a search began.  So a memory holds what one evaluation found and no
    more, or they would depend on what a process had evaluated before.
    """
    token = in_use.set((memory, more))
    try:
        yield
    finally:
        in_use.reset(token)


def nearby(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Let a function give the result for arguments equal in five digits, if the memory in use has
    one; its results for equal arguments are remembered in any case.

    >>> @nearby
    ... def square(x):
    ...     return x * x
    >>> memory = {}
    >>> with memory_in_use(memory, more=True):
    ...     square(3.0)
    9.0
    >>> with memory_in_use(memory, more=False):
    ...     square(3.000001), square(3.001) == 3.001**2
    (9.0, True)
    >>> square(3.000001) == 3.000001**2
    True
    """
    exact = lru_cache(KEPT)(function)

    @wraps(function)
    def found(*given: Any) -> Answer:
        memory, more = in_use.get(({}, False))
        key = found, rough(given)
        if key in memory:
            return memory[key]
        result = exact(*given)
        if more:
            memory[key] = result
        return result

    return found


def answered(function: Callable[..., Answer], *given: Any, **named: Any) -> Answer:
    """What a function returns, called once for the same arguments, which may hold arrays.

    The last `ANSWERS` answers are kept.  Where a memory is in use the function is called: last
    digits depend on the memory.

    >>> answered(dict, [("x", 1.0)]) is answered(dict, [("x", 1.0)])
    True
    """
    if in_use.get(None) is not None:
        return function(*given, **named)
    key = function, pickle.dumps((given, named))
    if key not in answers:
        result = function(*given, **named)
        while len(answers) >= ANSWERS:
            del answers[next(iter(answers))]
        answers[key] = result
    found: Answer = answers[key]
    return found


def rough(value: Any, digits: int = 5) -> Any:
    """Numbers in so many digits, in tuples of tuples.

    >>> rough((0.123456, (3.0, None)))
    (0.12346, (3.0, None))
    """
    if isinstance(value, tuple):
        return tuple(rough(part, digits) for part in value)
    return float(f"{value:.{digits}g}") if isinstance(value, float) else value
