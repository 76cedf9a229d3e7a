"""Objects that a notebook shows as HTML, which the report makes once a notebook asks for it."""

from collections.abc import Callable

HTML_MAKERS: list[Callable[[object], str]] = []
"""Functions that make HTML of an object; the package registers that of its report."""


class ShownAsHtml:
    """An object that a notebook shows as HTML."""

    def _repr_html_(self) -> str | None:
        return HTML_MAKERS[-1](self) if HTML_MAKERS else None
