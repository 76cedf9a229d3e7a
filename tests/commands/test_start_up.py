"""Commands and imports that need no engine do not load one."""

import subprocess
import sys
from pathlib import Path
from shutil import copy

import pytest

from tests.shipped import MODELS

SLOW_PACKAGES = {"numpy", "scipy", "mujoco", "pymunk", "pydantic", "pint", "matplotlib"}
MAX_OWN_MODULES = 50
"""Number of modules of this package that a check may load before it knows its cases."""


def modules_loaded_by(code: str) -> set[str]:
    """Modules that a new interpreter has loaded after some lines of code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.splitlines()[-1].split())


def packages_loaded_by(code: str) -> set[str]:
    """Top-level packages that a new interpreter has loaded after some lines of code."""
    return {name.partition(".")[0] for name in modules_loaded_by(code)}


def test_help_loads_no_engine_and_no_numerics() -> None:
    loaded = packages_loaded_by(
        "from proofmass.commands.cli import app\ntry: app(['--help'])\nexcept SystemExit: pass"
    )
    assert "typer" in loaded
    assert not SLOW_PACKAGES & loaded


def test_the_installed_command_loads_no_engine_for_its_help() -> None:
    """The command starts by its entry point, which also sets what MuJoCo need not load."""
    loaded = packages_loaded_by(
        "import sys; from proofmass.__main__ import main; sys.argv = ['proofmass', '--help']\n"
        "try: main()\nexcept SystemExit: pass"
    )
    assert "typer" in loaded
    assert not SLOW_PACKAGES & loaded


def test_importing_check_loads_no_engine() -> None:
    assert not {"mujoco", "scipy", "pymunk", "matplotlib", "pint", "tomlkit"} & packages_loaded_by(
        "import proofmass.batch.check"
    )


def test_importing_check_loads_no_module_that_few_checks_need() -> None:
    """These are loaded for a run that differs, for motions in space, and for studies."""
    loaded = modules_loaded_by(
        "import proofmass.batch.check, proofmass.formats.terminal, proofmass.formats.sarif"
    )
    own = {name for name in loaded if name.partition(".")[0] == "proofmass"}
    folders = ("proofmass.evidence", "proofmass.analytic.spatial", "proofmass.studies")
    assert not [name for name in own if name.startswith(folders)]
    assert "proofmass.sim.protocol.tuning" not in own
    assert len(own) <= MAX_OWN_MODULES


def test_a_check_loads_engine_and_reference_in_its_workers_only(tmp_path: Path) -> None:
    """The engine is MuJoCo, and the pendulum's closed form needs SciPy."""
    for name in ("pendulum.toml", "pendulum.xml"):
        copy(MODELS / "linkages" / name, tmp_path)
    edit = tmp_path / "pendulum.toml"
    text = edit.read_text().replace("until = 10.0 ", "until = 1.0 ").replace("n = 1001", "n = 11")
    edit.write_text(text)
    code = f"import sys; sys.argv = ['proofmass', 'check', {str(edit)!r}]\n"
    code += "from proofmass.__main__ import main\ntry: main()\n"
    loaded = modules_loaded_by(code + "except SystemExit as end: assert end.code == 0")
    assert "proofmass.formats.terminal" in loaded
    assert not {"mujoco", "scipy", "pymunk", "matplotlib"} & {
        name.partition(".")[0] for name in loaded
    }
    assert "proofmass.analytic.linkages.pendulum" not in loaded


def test_a_run_of_a_closed_form_without_loops_loads_no_general_solver() -> None:
    loaded = modules_loaded_by(
        "from proofmass.run.sidecar import load_case\n"
        "from proofmass.run.solve import solve_here\n"
        "from proofmass.run.validate import validate_case\n"
        f"case = load_case({str(MODELS / 'linkages/pendulum.toml')!r})\n"
        "validate_case(case)\n"
        "solve_here(case, 'dynamics', 'mujoco')\n"
    )
    assert "proofmass.sim.mujoco.dynamics" in loaded
    folders = ("proofmass.analytic.spatial", "proofmass.analytic.planar", "proofmass.evidence")
    assert not [name for name in loaded if name.startswith(folders)]


def test_a_command_does_not_search_for_plugins_of_pydantic() -> None:
    loaded = modules_loaded_by(
        "import os, sys; os.environ.pop('PYDANTIC_DISABLE_PLUGINS', None)\n"
        "from proofmass.__main__ import main; sys.argv = ['proofmass', '--help']\n"
        "try: main()\nexcept SystemExit: pass\n"
        "import proofmass.base.strict, pydantic.plugin._loader as loader\n"
        "assert loader._plugins is None"
    )
    assert "pydantic.plugin._loader" in loaded


@pytest.mark.parametrize("before", ["", "import proofmass.batch.check, proofmass.verdict.compare"])
def test_check_compare_and_solve_of_the_package_are_functions(before: str) -> None:
    code = f"{before}\nfrom proofmass import check, compare, solve\nimport types\n"
    code += "assert all(isinstance(one, types.FunctionType) for one in (check, compare, solve))"
    assert "proofmass" in packages_loaded_by(code)


def test_an_unknown_name_of_the_package_is_an_attribute_error() -> None:
    import proofmass

    with pytest.raises(AttributeError, match="has no attribute 'chek'"):
        _ = proofmass.chek  # type: ignore[attr-defined]
