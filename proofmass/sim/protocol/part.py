"""A part that an engine may have, in a file that is loaded when the part is asked for."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any, Generic, Protocol, Self, TypeVar, overload

from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.settings import EngineSettings


class PartOwner(Protocol):
    """An engine, as its parts know it."""

    title: str
    settings: type[EngineSettings]


@dataclass(frozen=True)
class EnginePart:
    """A part of an engine, such as its `proofmass.sim.protocol.tuning.Tuning`.

    Attributes
    ----------
    title : str
        Name of the engine in a sentence.
    settings : type of EngineSettings
        The settings of the engine.
    """

    title: str
    settings: type[EngineSettings]


P = TypeVar("P", bound=EnginePart)


class LoadedPart(Generic[P]):
    """A part as an attribute of a class of engines; it is made when it is first asked for.

    Parameters
    ----------
    made_by : type of EnginePart or str
        Its class, or the place of the class as ``module:NAME``, which is imported only then.
        Empty: engines of the class have no such part.

    Examples
    --------
    >>> from proofmass.sim.protocol.engine import Engine
    >>> class Mine(Engine):
    ...     theory = LoadedPart("my_package.theory:MyTheory")
    >>> Mine().own_equations
    Traceback (most recent call last):
      ...
    proofmass.sim.protocol.failures.Unsupported: Mine has no own equations
    """

    def __init__(self, made_by: type[P] | str = "") -> None:
        self.made_by, self.name = made_by, ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, engine: None, owner: type) -> Self: ...

    @overload
    def __get__(self, engine: PartOwner, owner: type) -> P: ...

    def __get__(self, engine: PartOwner | None, owner: type) -> Any:
        if engine is None:
            return self
        part = self.find_class(engine.title)(engine.title, engine.settings)
        vars(engine)[self.name] = part  # Python finds it there the next time
        return part

    def find_class(self, title: str) -> type[P]:
        """The class of the part, imported if only its place is given.

        Raises
        ------
        Unsupported
            The engine of this title has no such part.
        ValueError
            The part cannot be imported.
        """
        if not isinstance(self.made_by, str):
            return self.made_by
        words = self.name.replace("_", " ")
        if not self.made_by:
            raise Unsupported(f"{title} has no {words}")
        try:
            return resolve_name(self.made_by)
        except Exception as error:
            raise ValueError(
                f"{title}: its {words}, {self.made_by}, cannot be loaded: "
                f"{type(error).__name__}: {error}"
            ) from error
