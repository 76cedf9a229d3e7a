"""The 112 designs of van Nes 2022, appendix M, by the line of the thesis's text."""

import json
from pathlib import Path
from typing import Any

DATA = json.loads((Path(__file__).parents[2] / "data" / "balancer.json").read_text())


def rows(segments: int | None = None) -> dict[str, dict[str, Any]]:
    """Designs by their line: all, or those of three or four segments."""
    return {line: row for line, row in DATA["rows"].items() if segments in (None, row["segments"])}


def parameters(row: dict[str, Any]) -> dict[str, float]:
    """Parameters of a design, a copy, under the names of `proofmass.analytic.balancer.solve`."""
    return dict(row["parameters"])
