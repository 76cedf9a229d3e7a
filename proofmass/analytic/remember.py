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
RESULTS_PER_FUNCTION = 64
RELATIVE_NEARNESS = 1e-5
"""Largest relative difference of two numbers that count as near each other."""
MAX_KEPT_EVALUATIONS = 16
"""Number of evaluations of references that are kept."""
Memory = dict[Any, list[tuple[tuple[Any, ...], Any]]]
"""Results of one evaluation: by function, the arguments of each call and its result."""
current_memory: ContextVar[tuple[Memory, bool]] = ContextVar("in_use")
kept_evaluations: dict[tuple[Callable[..., Any], bytes], Any] = {}


@contextmanager
def use_memory(memory: Memory, store_results: bool) -> Iterator[None]:
    """Let `reuse_nearby` functions take results from a memory in a ``with`` block.

    They add their own results to the memory only if `store_results` is true.  The last digits of a
    result depend on where its search began.  A memory therefore holds the results of one evaluation
    only.  Otherwise last digits would depend on what the process had evaluated before.
    """
    token = current_memory.set((memory, store_results))
    try:
        yield
    finally:
        current_memory.reset(token)


def reuse_nearby(function: Callable[..., Answer]) -> Callable[..., Answer]:
    """Decorator: a function returns a stored result if the memory has one for near arguments.

    The memory is the one of `use_memory`; `is_near` compares arguments.  Without a memory, or if
    results are stored in it, a call without a result nearby is made as if it were the first one of
    the process.  The results of the last `RESULTS_PER_FUNCTION` such calls are kept, with those
    that the functions inside them stored, so that a memory gets the same results from a call that
    was made before.  A call that depends on the results of a memory is not kept.

    >>> @reuse_nearby
    ... def square(x):
    ...     return x * x
    >>> memory = {}
    >>> with use_memory(memory, True):
    ...     square(3.0)
    9.0
    >>> with use_memory(memory, False):
    ...     square(3.000001), square(3.001) == 3.001**2
    (9.0, True)
    >>> square(3.000001) == 3.000001**2
    True
    """

    @lru_cache(RESULTS_PER_FUNCTION)
    def call_first(*given: Any) -> tuple[Answer, Memory]:
        """The result of a call with an empty memory, and all results that the call stores."""
        own: Memory = {}
        with use_memory(own, store_results=True):
            result = function(*given)
        own.setdefault(reuse_or_call, []).append((given, result))
        return result, own

    @wraps(function)
    def reuse_or_call(*given: Any) -> Answer:
        memory, store_results = current_memory.get(({}, True))
        for arguments, result in memory.get(reuse_or_call, ()):
            if is_near(arguments, given, RELATIVE_NEARNESS * largest_number(arguments)):
                return cast(Answer, result)
        if not store_results:  # inner searches begin from the memory, so the result is not kept
            return function(*given)
        found, stored = call_first(*given)
        for called, results in stored.items():
            memory.setdefault(called, []).extend(results)
        return found

    return reuse_or_call


def call_once(function: Callable[..., Answer], *given: Any, **named: Any) -> Answer:
    """Result of a function that is called only once for equal arguments, which may hold arrays.

    The last `MAX_KEPT_EVALUATIONS` results are kept.  Where a memory is in use (`use_memory`),
    the function is always called, since the last digits of its result depend on the memory.

    >>> call_once(dict, [("x", 1.0)]) is call_once(dict, [("x", 1.0)])
    True
    """
    if current_memory.get(None) is not None:
        return function(*given, **named)
    key = function, pickle.dumps((given, named))
    if key not in kept_evaluations:
        result = function(*given, **named)
        while len(kept_evaluations) >= MAX_KEPT_EVALUATIONS:
            del kept_evaluations[next(iter(kept_evaluations))]
        kept_evaluations[key] = result
    found: Answer = kept_evaluations[key]
    return found


def is_near(one: Any, other: Any, zero_tolerance: float) -> bool:
    """Whether numbers in nested tuples are near each other, and all other entries are equal.

    A number is near that of `one` if their difference is at most `RELATIVE_NEARNESS` times that of
    `one`, or at most `zero_tolerance` where that of `one` is zero.

    >>> is_near((0.0, (3.0, "a")), (1e-6, (3.00001, "a")), 3e-5)
    True
    >>> is_near((0.0, 3.0), (1e-4, 3.0), 3e-5), is_near((1e-7, 3.0), (2e-7, 3.0), 3e-5)
    (False, False)
    """
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(
            map(partial(is_near, zero_tolerance=zero_tolerance), one, other)
        )
    if isinstance(one, float) and isinstance(other, float):
        return one == other or abs(one - other) <= (RELATIVE_NEARNESS * abs(one) or zero_tolerance)
    return bool(one == other)


def largest_number(value: Any) -> float:
    """Largest absolute value of the finite numbers in nested tuples.

    >>> largest_number((1.0, (-3.0, "a", float("inf"))))
    3.0
    """
    if isinstance(value, tuple):
        return max(map(largest_number, value), default=0.0)
    return abs(value) if isinstance(value, float) and isfinite(value) else 0.0
