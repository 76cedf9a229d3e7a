"""The base class of all tables of a sidecar, the types of numbers in it, and the kinds of runs."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from proofmass.base.errors import suggest_names

Kind = Literal["sweep", "dynamics", "equilibrium"]

StrictNumber = Annotated[float, Field(strict=True)]
"""A number, whole or not; pydantic would otherwise take ``true`` for 1 and the text "1.0" for 1."""
WholeNumber = Annotated[int, Field(strict=True)]
Count = Annotated[WholeNumber, Field(ge=1, lt=2**31)]
Switch = Annotated[bool, Field(strict=True)]


class Strict(BaseModel):
    """A table of the sidecar: unknown keys are errors that list the known ones."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        populate_by_name=True,
        allow_inf_nan=False,
        defer_build=True,  # a process that only receives cases from its workers validates none
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
