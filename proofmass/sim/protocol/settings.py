"""The settings of an engine: their names, types and ranges."""

from collections.abc import Mapping
from itertools import takewhile
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from proofmass.base.strict import StrictNumber
from proofmass.sim.protocol.failures import BadSetting


def _parse_numbers(value: Any) -> Any:
    """A text of several numbers, as in an attribute of MJCF, ``"0.002 1"``, as a tuple."""
    if not isinstance(value, str):
        return value
    try:
        return tuple(map(float, value.split()))
    except ValueError:
        raise ValueError(f"{value!r} is no list of numbers") from None


StrictNumbers = Annotated[tuple[StrictNumber, ...], BeforeValidator(_parse_numbers)]
FILE_MARK, BY_CHANNEL, BY_JOINT = "file", "by channel", "by joint"
"""Marks of settings: names of files; tables by channel; tables by joint."""
FileName = Annotated[str, FILE_MARK]
"""Name of a file, in a sidecar relative to its folder; an engine is given the absolute path."""


class EngineSettings(BaseModel):
    """The settings of an engine, with types and ranges; each engine has its own subclass.

    A setting that is the name of a file is a `FileName`.  A table whose keys are names of channels
    or of driven joints is annotated with `BY_CHANNEL` or `BY_JOINT`, so that the names are checked.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def marked(cls, mark: str) -> list[str]:
        """The settings that are annotated with a mark."""
        return [name for name, field in cls.model_fields.items() if mark in field.metadata]

    @classmethod
    def is_default(cls, parameters: "ParameterValues") -> bool:
        """Whether settings differ from the engine's own defaults in the time step at most."""
        return bool(parameters.get("defaults")) and all(
            value == cls.model_fields[name].default
            for name, value in parameters.items()
            if name in cls.model_fields and name not in ("timestep", "defaults")
        )

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Self:
        """Check settings.

        Raises
        ------
        BadSetting
            A setting is unknown, of the wrong type, or out of range.
        """
        for key in settings:
            if key not in cls.model_fields:
                raise BadSetting(
                    key, f"unknown setting {key!r}; known: {', '.join(cls.model_fields)}"
                )
        try:
            return cls(**settings)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(takewhile(lambda part: isinstance(part, str), first["loc"]))  # type: ignore
            if first["type"] == "missing":
                raise BadSetting(key, "missing; it is required") from None
            wrong = first["msg"].removeprefix("Value error, ")
            instead = "" if isinstance(first["input"], dict) else f", not {first['input']!r}"
            raise BadSetting(key, f"{wrong}{instead}") from None


ParameterValue = str | float | int | bool | tuple[float, ...]
"""A value of a setting."""
ParameterValues = Mapping[str, ParameterValue]


def first_number(parameter: ParameterValue) -> float:
    """A value as a number; of several numbers the first."""
    return float(parameter[0] if isinstance(parameter, tuple) else parameter)
