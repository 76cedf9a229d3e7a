"""Results of long searches, from which searches for problems near them begin.

Sensitivities ask for many problems that differ in the sixth digit.  Newton's method gets from the
equilibrium of one to that of another in a step; a search begins at nothing every time.
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
"""Share of a number by which another may differ that is near it."""
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
    """Let a function give the result for arguments `near` others, if the memory in use has one; its
    results for equal arguments are remembered in any case.

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


def near(one: Any, other: Any, nothing: float) -> bool:
    """Whether numbers, in tuples of tuples, are `CLOSE` to those of `one`, and all else is equal.

    Beside a zero, what is no larger than `nothing` is close.

    >>> near((0.0, (3.0, "a")), (1e-6, (3.00001, "a")), nothing=3e-5)
    True
    >>> near((0.0, 3.0), (1e-4, 3.0), nothing=3e-5), near((1e-7, 3.0), (2e-7, 3.0), nothing=3e-5)
    (False, False)
    """
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(partial(near, nothing=nothing), one, other))
    if isinstance(one, float) and isinstance(other, float):
        return one == other or abs(one - other) <= (CLOSE * abs(one) or nothing)
    return bool(one == other)


def largest(value: Any) -> float:
    """The largest size of the finite numbers in tuples of tuples.

    >>> largest((1.0, (-3.0, "a", float("inf"))))
    3.0
    """
    if isinstance(value, tuple):
        return max(map(largest, value), default=0.0)
    return abs(value) if isinstance(value, float) and isfinite(value) else 0.0
