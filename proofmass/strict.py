"""The base class of all tables of a sidecar, and the kinds of runs."""

from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, model_validator

from proofmass.errors import suggest_names

Kind = Literal["sweep", "dynamics", "equilibrium"]


class Strict(BaseModel):
    """A table of the sidecar: unknown keys are errors that list the known ones."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False
    )

    fields_without_key: ClassVar[frozenset[str]] = frozenset()
    """Fields that no sidecar gives."""

    @model_validator(mode="before")
    @classmethod
    def _known(cls, table: Any) -> Any:
        fields = cls.model_fields
        known = [
            f.alias or name for name, f in fields.items() if name not in cls.fields_without_key
        ]
        for key in table if isinstance(table, dict) else ():
            if key not in known and key not in fields:
                raise ValueError(f"unknown key {key!r}; {suggest_names(key, known, 'known')}")
        return table
