"""Scripts of engines are short: what several of them need has one place in sim/interpreter/."""

from pathlib import Path

import pytest

from proofmass.sim.hosts.engine import SCRIPTS

MOST_LINES = 160
"""Lines of a script, with its docstring: a reader takes in an adapter at one sitting."""
LONGER = {
    "drake.py": 204,  # two solvers, SAP and continuous time, and contacts: objects of Drake alone
    "exudyn.py": 188,  # a tree and bodies beside it, a solver in time and another one of statics
    "simbody.py": 187,  # all forces, drives and drags are elements of OpenSim, made one by one
}
"""Scripts that are longer, and by how much they may be."""


def too_long(script: Path) -> str:
    """What is wrong with the length of a script; empty if nothing is."""
    lines = len(script.read_text(encoding="utf-8").splitlines())
    most = LONGER.get(script.name, MOST_LINES)
    advice = "move what another script has too to proofmass/sim/interpreter/"
    return f"{script.name} has {lines} lines, more than {most}: {advice}" if lines > most else ""


@pytest.mark.parametrize("script", sorted(SCRIPTS.glob("*.py")), ids=lambda one: one.stem)
def test_no_script_of_an_engine_is_long(script: Path) -> None:
    """No script has more lines than it may have, and none of the longer ones has become short."""
    assert not too_long(script), too_long(script)
    if script.name in LONGER:
        assert len(script.read_text(encoding="utf-8").splitlines()) > MOST_LINES


def test_a_long_script_is_named(tmp_path: Path) -> None:
    """A script of 161 lines is too long, one of 160 is not."""
    script = tmp_path / "mine.py"
    script.write_text("x = 1\n" * MOST_LINES)
    assert not too_long(script)
    script.write_text("x = 1\n" * (MOST_LINES + 1))
    assert "mine.py has 161 lines, more than 160" in too_long(script)
