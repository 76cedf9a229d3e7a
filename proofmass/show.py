"""A case as the text of a sidecar that leaves nothing to defaults."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from proofmass.case import Case

INLINE = ("parameters", "channels", "refine")
"""Tables whose entries stand in one line each."""
LISTS = ("drive", "tolerance", "view", "chart")
"""Tables of which a sidecar may have several."""
Table = Mapping[str, Any]


def as_toml(case: Case, every: bool = True) -> str:
    """The text of a sidecar that loads to the same case, beside the same model.

    Parameters
    ----------
    case : Case
        From `proofmass.case.load_case`.
    every : bool
        Whether keys stand there that change nothing, too, such as ``scale = 1.0``.
    """
    table = case.model_dump(by_alias=True, exclude_none=True, exclude_defaults=not every,
                            exclude={"file", "unmatched"})
    if case.unmatched:
        table["channels"]["*"] = {}  # which finds that nothing else matches
    plain = {key: value for key, value in table.items() if not is_table(key, value)}
    blocks = ["\n".join(format_lines(plain))]
    for key, value in table.items():
        if is_table(key, value):
            blocks += format_tables(key, value)
    return "\n\n".join(blocks) + "\n"


def is_table(key: str, value: Any) -> bool:
    """Whether a key of the sidecar has a heading."""
    return isinstance(value, Mapping) or key in LISTS


def format_tables(key: str, value: Any) -> Iterator[str]:
    """The tables of a key, with their headings."""
    if key in LISTS:
        several = len(value) > 1 or key != "drive"
        for one in value:
            if key == "tolerance":
                one = {k: v[0] if isinstance(v, tuple) and len(v) == 1 else v
                       for k, v in one.items()}
            yield "\n".join([f"[[{key}]]" if several else f"[{key}]", *format_lines(one)])
    elif not value:
        return
    elif key in INLINE:
        yield "\n".join([f"[{key}]", *format_lines(value)])
    else:
        for name, one in value.items():
            yield "\n".join([f"[{key}.{format_key(name)}]", *format_lines(one)])


def format_lines(table: Table) -> Iterator[str]:
    """A line for each key."""
    return (f"{format_key(key)} = {format_value(value)}" for key, value in table.items())


def format_key(key: str) -> str:
    """A key, in quotation marks where it needs them.

    >>> format_key("crank"), format_key("pin.x")
    ('crank', '"pin.x"')
    """
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else format_value(key)


def format_value(value: Any) -> str:
    """A value in TOML.

    >>> format_value({"equals": "é", "only": ["a", True, 1e-12]})
    '{ equals = "é", only = ["a", true, 1e-12] }'
    """
    if isinstance(value, Mapping):
        return f"{{ {', '.join(format_lines(value))} }}" if value else "{}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Sequence):
        return f"[{', '.join(map(format_value, value))}]"
    return repr(value)
