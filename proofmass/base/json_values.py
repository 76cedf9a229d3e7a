"""Numbers in JSON, which has no NaN: None stands for a number that is not finite."""

import math
from typing import Any


def replace_nonfinite(value: Any) -> Any:
    """Return nested lists and dicts in which numbers that are not finite are None.

    >>> replace_nonfinite([{"size": float("nan"), "relative": True}])
    [{'size': None, 'relative': True}]
    """
    if isinstance(value, dict):
        return {key: replace_nonfinite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [replace_nonfinite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def restore_nan(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record with NaN where it has None.

    >>> restore_nan({"size": None, "relative": True})
    {'size': nan, 'relative': True}
    """
    return {key: math.nan if value is None else value for key, value in record.items()}
