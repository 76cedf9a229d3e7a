"""The JSON Schema of a sidecar, with which editors complete its keys and mark unknown ones.

    proofmass schema -o proofmass.schema.json

Editors with support of TOML, such as by Taplo, find the schema by the first line of a sidecar::

    #:schema proofmass.schema.json

The schema checks less than `proofmass.run.sidecar.load_case`: keys and types, but neither which
keys may be combined, nor the names of a model.
"""

import json
from typing import Any

from proofmass.base.files import OUTPUT_MARK
from proofmass.case.case import Case
from proofmass.run.sidecar import FIELDS_WITHOUT_KEY, Levels

DIALECT = "https://json-schema.org/draft/2020-12/schema"
DEFAULTED_KEYS = {
    "Channel": ("equals", "unit"),
    "RunTable": ("solvers",),
    "RecordedColumn": ("column",),
}
"""Keys that a case must have, but a sidecar may leave out: `proofmass.run.sidecar.fill_defaults`
finds them, or the name of a column in ``[recording]``."""
REQUIRED_KEYS = ["title", "source", "reference"]
JsonObject = dict[str, Any]


def as_json_text() -> str:
    """The text of the schema."""
    return json.dumps(sidecar_schema(), indent=1) + "\n"


def sidecar_schema() -> JsonObject:
    """The JSON Schema of a sidecar, of draft 2020-12.

    >>> schema = sidecar_schema()
    >>> schema["required"], schema["additionalProperties"]
    (['title', 'source', 'reference'], False)
    """
    case, levels = (kind.model_json_schema(by_alias=True) for kind in (Case, Levels))
    parts = case["$defs"] | levels["$defs"]
    for name, filled in DEFAULTED_KEYS.items():
        parts[name]["required"] = [k for k in parts[name]["required"] if k not in filled]
    parts["RecordedColumn"] = {"anyOf": [{"type": "string"}, parts["RecordedColumn"]]}
    keys = {k: v for k, v in case["properties"].items() if k not in FIELDS_WITHOUT_KEY}
    return {
        "$schema": DIALECT,
        "$comment": OUTPUT_MARK,
        "title": "Sidecar of a proofmass case",
        "description": "What a model in MJCF is compared with, in which runs, and how closely.",
        "type": "object",
        "additionalProperties": False,
        "required": REQUIRED_KEYS,
        "anyOf": [{"required": ["drive"]}, {"required": ["run"]}],
        "properties": as_in_toml(keys | levels["properties"]),
        "$defs": as_in_toml(parts),
    }


def as_in_toml(part: Any) -> Any:
    """A part of a schema without null, which TOML does not have, and titles, which repeat keys."""
    if isinstance(part, list):
        return [as_in_toml(one) for one in part if one != {"type": "null"}]
    if not isinstance(part, dict):
        return part
    kept = {
        key: as_in_toml(value)
        for key, value in part.items()
        if not (key == "title" and isinstance(value, str)) and (key, value) != ("default", None)
    }
    if len(kept.get("anyOf", ())) == 1:
        kept |= kept.pop("anyOf")[0]
    return kept
