"""proofmass: multibody simulators held against mathematics."""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from proofmass.case import Case as Case
    from proofmass.check import check as check
    from proofmass.compare import Comparison as Comparison
    from proofmass.compare import compare as compare
    from proofmass.errors import InputError as InputError
    from proofmass.reference import evaluate as evaluate
    from proofmass.report.animation import Animation as Animation
    from proofmass.report.animation import animate as animate
    from proofmass.report.explorer import Explorer as Explorer
    from proofmass.report.reprs import as_html as as_html
    from proofmass.sidecar import load_case as load_case
    from proofmass.sim.protocol import Curves as Curves
    from proofmass.solve import solve as solve

    __version__: str

PUBLIC = {
    "Animation": "report.animation",
    "Case": "case",
    "load_case": "sidecar",
    "animate": "report.animation",
    "Explorer": "report.explorer",
    "as_html": "report.reprs",
    "check": "check",
    "Comparison": "compare",
    "compare": "compare",
    "InputError": "errors",
    "evaluate": "reference",
    "Curves": "sim.protocol",
    "solve": "solve",
}
"""Modules by the names that they give to the package; they are imported when a name is used."""

__all__ = [
    "Animation",
    "Case",
    "Comparison",
    "Curves",
    "Explorer",
    "InputError",
    "animate",
    "as_html",
    "check",
    "compare",
    "evaluate",
    "load_case",
    "solve",
]


class Package(ModuleType):
    """A package whose functions are imported when they are used.

    Python sets a submodule as an attribute of its package; here the function of the same name
    stays what the package gives, so that ``from proofmass import check`` is the function.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        if name == "__version__":
            return _version()
        if name not in PUBLIC:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{PUBLIC[name]}"), name)


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("proofmass")
    except PackageNotFoundError:  # a source tree on the path, not installed
        return "0+unknown"


sys.modules[__name__].__class__ = Package
