"""What the writers of programs share: their templates, and text that may stand in a program."""

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def template(name: str, **filters: Callable[..., str]) -> "Template":
    """A template of programs, with filters; few runs need Jinja, so it is loaded here."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    templates = Environment(
        loader=PackageLoader("proofmass.sim", "programs"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters.update(filters)
    return templates.get_template(name)


def escaped(text: str) -> str:
    r"""Text that may stand in a docstring or a comment; lines remain lines in the first only.

    >>> print(escaped('C:\\new, \"\"\"\0'))
    C:\\new, \"\"\"\x00
    """
    text = text.replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text
    )
