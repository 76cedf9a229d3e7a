"""What a process has read of the files of a case: kept in memory by the content of the files.

`read_once` decorates a function that reads files, or something that was read of them, such as a
compiled model.  All results are in one store of `KEPT_INPUTS` entries; the one that was not used
for the longest time goes first.  `forget_inputs` empties it, and `serve_model` empties it when a
worker goes on to another model, since what earlier cases left there would count against the limit
of memory of a run.
"""

from collections.abc import Callable, Hashable
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any, TypeVar

from proofmass.base.files import content_key

Reader = TypeVar("Reader", bound=Callable[..., Any])
KEPT_INPUTS = 256
"""Number of inputs in memory.  A study tries many numbers of rod links, each a compiled model from
which eight other results are read; `proofmass explain` compiles thousands of models of 0.1 MB."""
served_model: list[Path] = []
"""The model of the last call of `serve_model`; empty before the first."""


def read_once(key: Callable[[Any], Hashable] | None = content_key) -> Callable[[Reader], Reader]:
    """Decorator: a function that reads its first argument is called once for each content of it.

    Parameters
    ----------
    key : function, optional
        Returns what is different after the files of the first argument have changed: the digest of
        a file by default.  None: the first argument is no file, but an object that was read, which
        stands for itself.

    Examples
    --------
    >>> @read_once(None)
    ... def count(words, mark):
    ...     print("counted")
    ...     return len(words)
    >>> count(("a", "b"), "!"), count(("a", "b"), "!")
    counted
    (2, 2)
    >>> forget_inputs()
    >>> count(("a", "b"), "!")
    counted
    2
    """

    def keep(read: Reader) -> Reader:
        @wraps(read)
        def read_or_kept(source: Any, *more: Hashable) -> Any:
            return kept_input(read, key(source) if key else None, source, more)

        return read_or_kept  # type: ignore[return-value]

    return keep


@lru_cache(KEPT_INPUTS)
def kept_input(
    read: Callable[..., Any], content: Hashable, source: Any, more: tuple[Hashable, ...]
) -> Any:
    """Read a source with this content; this is the store of `read_once`."""
    return read(source, *more)


def forget_inputs() -> None:
    """Forget all that was read."""
    kept_input.cache_clear()


def serve_model(file: Path) -> None:
    """Forget what was read for other models than that of the last call."""
    if served_model != [file]:
        served_model[:] = [file]
        forget_inputs()
