"""proofmass: multibody simulators held against mathematics."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from proofmass.base.display import HTML_MAKERS
from proofmass.base.installation import own_version

if TYPE_CHECKING:
    from proofmass.base.errors import InputError as InputError
    from proofmass.batch.check import check as check
    from proofmass.case.case import Case as Case
    from proofmass.formats.assertion import assert_agrees as assert_agrees
    from proofmass.reference.evaluate import evaluate as evaluate
    from proofmass.report.animation import Animation as Animation
    from proofmass.report.animation import animate as animate
    from proofmass.report.explorer import Explorer as Explorer
    from proofmass.report.reprs import as_html as as_html
    from proofmass.run.sidecar import load_case as load_case
    from proofmass.run.solve import solve as solve
    from proofmass.screen.screen import screen_model as screen_model
    from proofmass.sim.protocol.curves import Curves as Curves
    from proofmass.verdict.compare import compare as compare
    from proofmass.verdict.comparison import Comparison as Comparison
    from proofmass.verdict.judge import judge as judge

    __version__: str

PUBLIC = {
    "Animation": "report.animation",
    "Case": "case.case",
    "load_case": "run.sidecar",
    "animate": "report.animation",
    "Explorer": "report.explorer",
    "as_html": "report.reprs",
    "assert_agrees": "formats.assertion",
    "check": "batch.check",
    "Comparison": "verdict.comparison",
    "compare": "verdict.compare",
    "InputError": "base.errors",
    "evaluate": "reference.evaluate",
    "Curves": "sim.protocol.curves",
    "judge": "verdict.judge",
    "solve": "run.solve",
    "screen_model": "screen.screen",
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
    "assert_agrees",
    "check",
    "compare",
    "evaluate",
    "judge",
    "load_case",
    "screen_model",
    "solve",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return own_version()
    if name not in PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{PUBLIC[name]}"), name)


HTML_MAKERS.append(lambda thing: import_module("proofmass.report.reprs").as_html(thing))
