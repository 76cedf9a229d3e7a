"""Stored results depend on every file of the distribution that brings their engine.

The tests write a distribution as pip would install it, or as it would install the folder in which
it is developed.  Its engine is pymunk with a gravity that each of its files may change: the module
of the class, a module beside it, its data, and another module of the distribution.
"""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from proofmass import load_case
from proofmass.base.installation import describe_installation
from proofmass.case.case import Case
from proofmass.evidence.coverage import coverage_key
from proofmass.run.fingerprint import package_versions
from proofmass.sim.engines import ENGINE_GROUP
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from tests.distributions import forget_distributions, on_path, write_distribution
from tests.shipped import shipped
from tests.studies.study_tasks import own_locks

__all__ = ["own_locks"]

CLASS_MODULE = """
from pathlib import Path
from tempfile import TemporaryDirectory

from proofmass.sim.protocol.engine import Engine
from proofmass.sim.pymunk.engine import PymunkSettings, simulate
from swing_engine import law
import swing_helper

FACTOR = 1.0
TABLE = Path(__file__).with_name("table.txt")


class Swing(Engine):
    settings = PymunkSettings

    def simulate(self, model, run):
        gravity = -9.81 * FACTOR * law.FACTOR * swing_helper.FACTOR * float(TABLE.read_text())
        with TemporaryDirectory() as folder:
            file = Path(folder) / "model.xml"
            file.write_text(model.read_text().replace("-9.81", str(gravity)))
            return simulate(file, run)


SWING, OTHER = Swing(), Swing()
"""
FILES = {
    "swing_engine/__init__.py": CLASS_MODULE,
    "swing_engine/law.py": "FACTOR = 1.0\n",
    "swing_engine/table.txt": "1.0\n",
    "swing_helper.py": "FACTOR = 1.0\n",
}
INFO = "swing_engine-1.0.dist-info"
MODULES = "swing_"
"""How the names of the distribution's modules begin."""
INSTALLATIONS = pytest.mark.parametrize("site", ["installed", "developed"], indirect=True)


@pytest.fixture
def site(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    """The folder with the files of the distribution, which is installed here."""
    folder, code = tmp_path / "site", tmp_path / "site"
    listed, files = [*FILES, "../bin/swing", f"{INFO}/RECORD", f"{INFO}/entry_points.txt"], FILES
    if request.param == "developed":
        code = tmp_path / "project" / "src"
        listed = ["_editable_swing.pth", f"{INFO}/RECORD", f"{INFO}/entry_points.txt"]
        files = {os.path.relpath(code / name, folder): text for name, text in FILES.items()}
    code.mkdir(parents=True)
    write_distribution(folder, "swing_engine", files, ENGINE_GROUP, swing="SWING")
    (folder / "_editable_swing.pth").write_text(f"{code}\n")
    (folder / INFO / "RECORD").write_text("".join(f"{name},,\n" for name in listed))
    with on_path(folder, code, modules=MODULES):  # as the .pth file does at the start of Python
        yield code


@pytest.fixture
def case(site: Path) -> Case:
    """The shipped pendulum for half a second in the engine of the distribution."""
    found = load_case(shipped("pendulum.toml"))
    table = found.run["dynamics"]
    short = table.model_copy(update={"until": 0.5, "n": 51, "solvers": ("swing",)})
    return found.model_copy(update={"run": {"dynamics": short}})


@pytest.fixture
def run_again(case: Case, tmp_path: Path) -> Callable[[], tuple[float, int]]:
    """Run as a new process would: the error, and the number of runs in the store."""

    def run() -> tuple[float, int]:
        forget_distributions(MODULES)
        store = Store(tmp_path / "store")
        task = StudyRun(case, "dynamics", Setting("swing", {"timestep": 1e-3}))
        (row,) = Study(store).run([task], repeats=0)
        assert row.outcome == "ran", row.message
        return row.errors["position"], len(list(store.folder.glob("*.0.json")))

    return run


def change(site: Path, tmp_path: Path, name: str) -> None:
    """Change a file of the distribution, or the object that the name of its engine stands for."""
    file = site / name if name in FILES else tmp_path / "site" / name
    text = file.read_text()
    file.write_text(text.replace("1.0\n", "1.01\n").replace(":SWING", ":OTHER"))
    assert file.read_text() != text


@pytest.mark.parametrize("name", [*FILES, f"{INFO}/entry_points.txt"])
@INSTALLATIONS
def test_keys_change_with_any_file_of_the_distribution_of_an_engine(
    site: Path, tmp_path: Path, case: Case, name: str
) -> None:
    def keys() -> tuple[object, ...]:
        forget_distributions(MODULES)
        return (
            package_versions("swing"),
            coverage_key(case),
            describe_installation()["swing_engine"],
        )

    known = keys()
    assert keys() == known
    change(site, tmp_path, name)
    assert all(one != other for one, other in zip(known, keys(), strict=True))


@pytest.mark.parametrize("site", ["installed"], indirect=True)
def test_keys_change_also_for_an_engine_in_an_interpreter_of_its_own(
    site: Path, tmp_path: Path
) -> None:
    names = tmp_path / "site" / INFO / "entry_points.txt"
    names.write_text(names.read_text().replace("proofmass.engines", "proofmass.hosted_engines"))
    known = package_versions("swing"), describe_installation()["swing_engine"]
    change(site, tmp_path, "swing_engine/law.py")
    forget_distributions(MODULES)
    other = package_versions("swing"), describe_installation()["swing_engine"]
    assert known[0]["adapter"] != other[0]["adapter"]
    assert known[1] != other[1]


@pytest.mark.parametrize("name", ["swing_engine/law.py", "swing_engine/table.txt"])
@pytest.mark.parametrize("site", ["installed"], indirect=True)
def test_a_stored_run_is_made_again_if_a_file_beside_the_class_of_its_engine_changes(
    site: Path, tmp_path: Path, run_again: Callable[[], tuple[float, int]], name: str
) -> None:
    right, count = run_again()
    assert count == 1
    assert run_again() == (right, 1)  # read from the store
    change(site, tmp_path, name)
    wrong, count = run_again()
    assert count == 2
    assert wrong > 1e-3 > right  # 1 % of gravity
    (site / name).write_text(FILES[name])
    assert run_again() == (right, 2)


@INSTALLATIONS
def test_what_differs_between_machines_changes_no_key(site: Path, tmp_path: Path) -> None:
    """Bytecode, scripts and the records of an installation are not what an engine computes with."""
    known = describe_installation()["swing_engine"]
    assert known.startswith("1.0, code ")
    (site / "swing_engine" / "__pycache__").mkdir(exist_ok=True)
    (site / "swing_engine" / "__pycache__" / "law.cpython-399.pyc").write_bytes(b"bytecode")
    (tmp_path / "bin").mkdir(exist_ok=True)
    (tmp_path / "bin" / "swing").write_text("#!/home/other/python\n")
    with (tmp_path / "site" / INFO / "RECORD").open("a") as record:
        record.write("__editable___swing_finder.py,,\n")
    (tmp_path / "site" / "__editable___swing_finder.py").write_text("MAPPING = {}\n")
    assert describe_installation()["swing_engine"] == known
