"""A fixture that gives a copy of the four-bar's case a reference of the test's own."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def write_stub_sidecar(
    models: Path,
) -> Callable[[str, str, str, str], Path]:
    """A function that writes a sidecar with a reference of the test's own, and returns its path.

    It is called as ``f(name, source, parameters, more)``.  The reference is a program beside the
    sidecar with this name and source.  `parameters` has the lines of the sidecar's table of
    parameters, `more` has lines for the end of the sidecar.  The sidecar has one channel, a moment.
    """

    def make(name: str, source: str, parameters: str, more: str) -> Path:
        (models / f"{name}.py").write_text(source)
        file = models / "fourbar.toml"
        text = file.read_text().replace('"fourbar"', f'"{name}.py"')
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
