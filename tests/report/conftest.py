"""A reference of a test's own in a copy of the four-bar's case."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from proofmass.analytic import REFERENCES
from proofmass.report import case_figures, case_page


@pytest.fixture
def stubbed(models: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str, str, str], Path]:
    """``stubbed(name, source, parameters, more)``: the sidecar, whose one channel is a moment.

    The reference is a module of that name and source; `parameters` and `more` are lines of the
    sidecar, in its table of parameters and at its end.
    """

    def make(name: str, source: str, parameters: str, more: str) -> Path:
        (models / "stubs").mkdir()
        (models / "stubs" / f"{name}.py").write_text(source)
        monkeypatch.syspath_prepend(models / "stubs")
        monkeypatch.setitem(REFERENCES, name, name)
        for module in (case_figures, case_page):  # other processes do not know of it
            monkeypatch.setattr(
                module, "call_isolated", lambda function, *args, **limits: function(*args)
            )
        file = models / "fourbar.toml"
        text = file.read_text().replace('"fourbar"', f'"{name}"')
        text = re.sub(
            r"(?s)\[parameters\].*?\[drive\]", f"[parameters]\n{parameters}\n[drive]", text
        )
        text = re.sub(
            r"(?s)\[channels\].*",
            '[channels]\nholding_moment = { equals = "moment",'
            ' unit = "N m" }\n[[tolerance]]\nsolver = "mujoco"\nrelative_to_range = 1e-12\n'
            'why = "rounding"\n',
            text,
        )
        file.write_text(text + more)
        return file

    return make
