"""Results of searches are the same whatever was asked before, and each search is made once."""

import pytest

from proofmass.analytic.remember import reuse_nearby, use_memory


@pytest.fixture
def searches():
    """A search with a search inside it, and the list of all calls of both."""
    calls = []

    @reuse_nearby
    def inner(x: float, shift: float) -> float:
        calls.append(("inner", x, shift))
        return x + shift

    @reuse_nearby
    def outer(x: float, guess: float) -> float:
        calls.append(("outer", x, guess))
        return 2.0 * inner(x, 1.0)

    return outer, calls


def test_a_result_that_was_found_before_fills_a_memory_with_its_inner_results(searches):
    """A change of the guess alone then asks for no inner search, before or after an evaluation."""
    outer, calls = searches
    assert outer(3.0, 1.0) == 8.0  # without a memory, as `evaluate` calls it
    memory = {}
    with use_memory(memory, store_results=True):
        assert outer(3.0, 1.0) == 8.0
    assert calls == [("outer", 3.0, 1.0), ("inner", 3.0, 1.0)]
    with use_memory(memory, store_results=False):
        assert outer(3.0, 2.0) == 8.0
    assert calls[2:] == [("outer", 3.0, 2.0)]


def test_a_result_that_began_from_a_memory_is_not_given_to_others(searches):
    """The inner result of the memory is near 3, so the outer one is 8; alone it is that of 3."""
    outer, _ = searches
    memory, near = {}, 3.0 * (1.0 + 1e-7)
    with use_memory(memory, store_results=True):
        outer(3.0, 1.0)
    with use_memory(memory, store_results=False):
        assert outer(near, 2.0) == 8.0
    assert outer(near, 2.0) == 2.0 * (near + 1.0) != 8.0
