"""Templates of programs, and escaped text for them, for the program writers of all engines."""

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def load_template(name: str, **filters: Callable[..., str]) -> "Template":
    """A template of a program, with filters; Jinja is imported here, since few runs need it."""
    from proofmass.base.templates import template_environment

    templates = template_environment("proofmass.sim", "programs")
    templates.filters.update(filters)
    return templates.get_template(name)


def escape_text(text: str) -> str:
    r"""Text in a form that is safe in a docstring, or, if it has no line breaks, in a comment.

    >>> print(escape_text('C:\\new, \"\"\"\0'))
    C:\\new, \"\"\"\x00
    """
    text = text.replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text
    )
