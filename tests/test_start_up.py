"""Commands and imports that need no engine do not load one."""

import subprocess
import sys

import pytest

SLOW = {"numpy", "scipy", "mujoco", "pymunk", "pydantic", "pint", "matplotlib"}


def loaded_by(code: str) -> set[str]:
    """Top-level packages that a new interpreter has loaded after some lines of code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return {name.partition(".")[0] for name in done.stdout.splitlines()[-1].split()}


def test_help_loads_no_engine_and_no_numerics() -> None:
    loaded = loaded_by(
        "from proofmass.cli import app\ntry: app(['--help'])\nexcept SystemExit: pass"
    )
    assert "typer" in loaded
    assert not SLOW & loaded


def test_the_command_itself_loads_no_more_for_its_help() -> None:
    """The command starts by its entry point, which also sets what MuJoCo need not load."""
    loaded = loaded_by(
        "import sys; from proofmass.__main__ import main; sys.argv = ['proofmass', '--help']\n"
        "try: main()\nexcept SystemExit: pass"
    )
    assert "typer" in loaded
    assert not SLOW & loaded


def test_what_starts_a_check_loads_neither_scipy_nor_figures() -> None:
    assert not {"scipy", "pymunk", "matplotlib", "pint", "tomlkit"} & loaded_by(
        "import proofmass.check"
    )


@pytest.mark.parametrize("before", ["", "import proofmass.check, proofmass.compare"])
def test_functions_of_the_package_are_not_their_modules(before: str) -> None:
    code = f"{before}\nfrom proofmass import check, compare, solve\nimport types\n"
    code += "assert all(isinstance(one, types.FunctionType) for one in (check, compare, solve))"
    assert "proofmass" in loaded_by(code)


def test_a_name_that_the_package_does_not_have() -> None:
    import proofmass

    with pytest.raises(AttributeError, match="has no attribute 'chek'"):
        _ = proofmass.chek  # type: ignore[attr-defined]
