"""What ``mkdocs build`` does to the pages: it finds where public names of proofmass are defined.

``::: proofmass.solve`` would be the module of that name; the function is what users import.
"""

import re

import proofmass

PUBLIC = re.compile(r"^::: proofmass\.(\w+)$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Write the full path of each public name that a page documents."""
    return PUBLIC.sub(lambda found: f"::: {path(found[1])}", markdown)


def path(name: str) -> str:
    """Module and name of what ``from proofmass import name`` gives."""
    there = getattr(proofmass, name)
    return f"{there.__module__}.{there.__qualname__}"
