"""Results of long searches, kept so that searches for problems near them can begin from them.

Sensitivities need the equilibria of many problems whose parameters differ in the sixth digit.
Newton's method gets from the equilibrium of one such problem to that of another in one step,
whereas a search would start from no known equilibrium every time.
"""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache, partial, wraps
from math import isfinite
from typing import Any, TypeVar, cast

Answer = TypeVar("Answer")
KEPT = 64
CLOSE = 1e-5
"""Largest relative difference of two numbers that count as near each other."""
ANSWERS = 16
"""Number of evaluations of references that are kept."""
Memory = dict[Any, Any]
in_use: ContextVar[tuple[Memory, bool]] = ContextVar("in_use")
answers: dict[tuple[Callable[..., Any], bytes], Any] = {}


@contextmanager
def memory_in_use(memory: Memory, more: bool) -> Iterator[None]:
    """Let `nearby` functions take results from a memory in a ``with`` block.

    They add their own results to the memory only if `more` is true.  The last digits of a
    result depend on where its search began.  A memory therefore holds the results of one evaluation
    only.  Otherwise last digits would depend on what the process had evaluated before.
    """
    token = in_use.set((memory, more))
    try:
        yield
    finally:
        in_use.reset(token)


def nearby(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Decorator: a function returns a stored result if the memory has one for near arguments.

    The memory is the one of `memory_in_use`; `near` compares arguments.  Without a memory, or if
    it has no such result, the function is called.  The results of the last `KEPT`
    calls are kept, so that the function is not called again for equal arguments.

    >>> @nearby
    ... def square(x):
    ...     return x * x
    >>> memory = {}
    >>> with memory_in_use(memory, True):
    ...     square(3.0)
    9.0
    >>> with memory_in_use(memory, False):
    ...     square(3.000001), square(3.001) == 3.001**2
    (9.0, True)
    >>> square(3.000001) == 3.000001**2
    True
    """
    exact = lru_cache(KEPT)(function)

    @wraps(function)
    def found(*given: Any) -> Answer:
        memory, more = in_use.get(({}, False))
        known = memory.setdefault(found, [])
        for arguments, result in known:
            if near(arguments, given, CLOSE * largest(arguments)):
                return cast(Answer, result)
        result = exact(*given)
        if more:
            known.append((given, result))
        return result

    return found


def answered(function: Callable[..., Answer], *given: Any, **named: Any) -> Answer:
    """Result of a function that is called only once for equal arguments, which may hold arrays.

    The last `ANSWERS` results are kept.  Where a memory is in use (`memory_in_use`),
    the function is always called, since the last digits of its result depend on the memory.

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


def near(one: Any, other: Any, nothing: float) -> bool:
    """Whether numbers in nested tuples are near each other, and all other entries are equal.

    A number is near that of `one` if their difference is at most `CLOSE` times that of
    `one`, or at most `nothing` where that of `one` is zero.

    >>> near((0.0, (3.0, "a")), (1e-6, (3.00001, "a")), 3e-5)
    True
    >>> near((0.0, 3.0), (1e-4, 3.0), 3e-5), near((1e-7, 3.0), (2e-7, 3.0), 3e-5)
    (False, False)
    """
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(partial(near, nothing=nothing), one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == other or abs(one - other) <= (CLOSE * abs(one) or nothing)
    return bool(one == other)


def largest(value: Any) -> float:
    """Largest absolute value of the finite numbers in nested tuples.

    >>> largest((1.0, (-3.0, "a", float("inf"))))
    3.0
    """
    if isinstance(value, tuple):
        return max(map(largest, value), default=0.0)
    return abs(value) if isinstance(value, float) and isfinite(value) else 0.0
