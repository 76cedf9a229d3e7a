"""A reference of somebody else works in all commands without a change of proofmass.

One is a class of another distribution, which the tests write as pip would install it; the other is
a program beside a sidecar.  Both are a pendulum that is let go, integrated by DOP853 instead of the
elliptic functions of proofmass's own, so that they are also a check of that.
"""

import os
import re
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass import check, compare, evaluate, load_case, solve
from proofmass.analytic.linkages.pendulum import Pendulum
from proofmass.analytic.protocol import Ask, InputMotion
from proofmass.base.errors import InputError
from proofmass.base.installation import describe_installation
from proofmass.commands.cli import app
from proofmass.evidence.diagnosis import find_causes
from proofmass.reference.find import REFERENCE_GROUP, load_reference, reference_names
from proofmass.run.case_files import input_files
from proofmass.run.fingerprint import digest_recorded_files
from tests.distributions import on_path, write_distribution
from tests.shipped import shipped

ROOT = Path(__file__).parents[2]
SOURCE = '''
from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from proofmass.analytic.chart import Chart, Panel, line_through
from proofmass.analytic.protocol import Acceleration, Angle, Length, Mass, OwnError, Reference


def phases(*, length: float) -> Chart:
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    return Chart(("x", "m"), ("y", "m"), (Panel((line_through(length * np.exp(1j * turn)),)),), "P")


class Swing(Reference):
    """A pendulum that is let go at rest, integrated step by step."""

    charts = (phases,)
    own_error = OwnError(1e-11, "the elliptic functions of proofmass")
    length: Length
    amplitude: Angle
    mass: Mass = 1.0
    gravity: Acceleration = 9.81

    def solve(self, motion, ask):
        def slope(_, state):
            return state[1], -self.gravity / self.length * np.sin(state[0])

        found = solve_ivp(
            slope, (0.0, motion.x[-1] or 1.0), (self.amplitude, 0.0), "DOP853",
            dense_output=True, rtol=1e-13, atol=1e-13,
        )
        angle, rate = found.sol(motion.x)
        return {"angle": angle, "rate": rate}

    def properties(self, motion, ask):
        return {"small swings": f"{2 * np.pi * (self.length / self.gravity) ** 0.5:.4f} s"}
'''
SIDECAR = """
title = "Pendulum, let go from the horizontal"
source = "equations of motion, integrated"
model = "{model}"
reference = "{reference}"
parameters = {{ length = 1.0, amplitude = -1.5707963267948966 }}

[run.dynamics]
until = 1.0
n = 101
solvers = ["mujoco"]

[channels]
angle = {{ equals = "angle", unit = "rad" }}
rate = {{ equals = "rate", unit = "rad/s" }}

[[tolerance]]
relative_to_range = 1e-4  # a hundredth of what 1 % of gravity changes
why = "RK4 at the model's step"

[[chart]]
title = "Path of the mass"
draw = "phases"
"""
REFERENCES = pytest.mark.parametrize("reference", ["twin", "twin.py"])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a distribution that offers the reference ``twin`` and some faulty ones."""
    folder = tmp_path_factory.mktemp("site")
    names = {"twin": "Swing", "lost": "Sving", "foreign": "np", "double": "Swing"}
    files = {"twin_reference.py": SOURCE}
    write_distribution(folder, "twin_reference", files, REFERENCE_GROUP, **names)
    files = {"other_twin.py": SOURCE}
    write_distribution(folder, "other_twin", files, REFERENCE_GROUP, double="Swing")
    with on_path(folder):
        yield folder


@pytest.fixture
def sidecar(site: Path, tmp_path: Path, reference: str) -> Path:
    """A sidecar of the shipped pendulum's model with one of the references, and the program."""
    return write_sidecar(tmp_path, reference)


def write_sidecar(folder: Path, reference: str, source: str = SOURCE) -> Path:
    """Write a sidecar of the shipped pendulum's model with a reference, and a program beside it."""
    (folder / "twin.py").write_text(source)
    file = folder / "swing.toml"
    model = os.path.relpath(shipped("pendulum.xml"), folder)
    file.write_text(SIDECAR.format(model=model, reference=reference))
    return file


def invoke(*words: object) -> str:
    """The output of a command, which must end with exit code 0."""
    answer = CliRunner().invoke(app, [str(word) for word in words])
    assert answer.exit_code == 0, answer.output
    return answer.output


@REFERENCES
def test_check_agrees_and_a_wrong_parameter_differs(sidecar, reference):
    good = check([sidecar], jobs=1)
    assert {c.outcome for c in good.comparisons} == {"agrees"}, good.errors
    assert set(good.comparisons[0].detectable) == {"length", "amplitude"}
    sidecar.write_text(sidecar.read_text().replace("length = 1.0", "length = 1.01"))
    wrong = check([sidecar], jobs=1)
    assert {c.outcome for c in wrong.comparisons} == {"differs"}
    (diagnosis,) = wrong.diagnoses.values()
    assert "length" in "\n".join(diagnosis.lines)


@REFERENCES
def test_it_is_confirmed_by_the_closed_form(sidecar, reference):
    case = load_case(sidecar)
    x = np.linspace(0.0, 1.0, 21)
    own = evaluate(case, "dynamics", x, None).channels
    parameters = {**case.parameters, "mass": 1.0, "gravity": 9.81}
    exact = Pendulum.evaluate(parameters, InputMotion(x), Ask())
    for name in ("angle", "rate"):
        np.testing.assert_allclose(own[name], exact[name], atol=1e-11)


@REFERENCES
def test_the_notebook_way_and_explain_know_it(sidecar, reference):
    case = load_case(sidecar)
    found = compare(case, "dynamics", "mujoco", solve(case, "dynamics", "mujoco"))
    assert {c.outcome for c in found} == {"agrees"}
    assert "Pendulum, let go from the horizontal" in invoke("explain", sidecar)


@REFERENCES
def test_the_report_has_its_chart_properties_and_units(sidecar, reference, tmp_path):
    invoke("report", sidecar, "-o", tmp_path / "pages")
    page = (tmp_path / "pages" / "swing.html").read_text("utf-8")
    index = (tmp_path / "pages" / "index.html").read_text("utf-8")
    assert "A pendulum that is let go at rest, integrated step by step." in index
    assert "2.0061 s" in page
    assert "Path of the mass" in page
    assert re.search(r"length.{0,80}1 m", page, re.DOTALL)


@REFERENCES
def test_trade_and_choose_measure_against_it(sidecar, reference, tmp_path):
    invoke("trade", sidecar, "-o", tmp_path / "trade")
    told = invoke("choose", sidecar, "--error", "1e-4", "--store", tmp_path / "store")
    assert re.search(r"<option .*timestep=", told), told


def test_results_depend_on_the_code_of_a_reference_from_elsewhere(site, tmp_path):
    """A study makes its runs again, and a cluster's worker with other code is refused."""
    case, file = load_case(write_sidecar(tmp_path, "twin")), site / "twin_reference.py"
    before = digest_recorded_files(case), describe_installation()["twin_reference"]
    assert before[1].startswith("1.0, code ")
    file.write_text(SOURCE.replace("1e-13", "1e-12"))
    after = digest_recorded_files(case), describe_installation()["twin_reference"]
    file.write_text(SOURCE)
    assert all(one != other for one, other in zip(before, after, strict=True))
    assert (digest_recorded_files(case), describe_installation()["twin_reference"]) == before
    own = load_case(shipped("pendulum.toml"))
    assert digest_recorded_files(own) == "", "the code of proofmass has a key of its own"


def test_references_are_listed_without_being_imported(site):
    sys.modules.pop("twin_reference", None)
    assert {"twin", "lost", "foreign"} <= set(reference_names())
    assert "twin_reference" not in sys.modules


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("twyn", "no reference 'twyn'; did you mean 'twin'?"),
        ("lost", "reference 'lost', of twin_reference: twin_reference:Sving cannot be loaded: "),
        ("foreign", "twin_reference:np is no class of proofmass.analytic.protocol.Reference"),
        ("double", "two references have the name 'double': other_twin:Swing of other_twin and "),
    ],
)
def test_a_reference_that_cannot_be_used_is_one_line_with_its_place(site, tmp_path, name, words):
    file = write_sidecar(tmp_path, name)
    with pytest.raises(InputError) as caught:
        load_reference(load_case(file))
    assert caught.value.key == "reference"
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("import numpy", "import numpyy", "twin.py cannot be loaded, line 4: ModuleNotFoundError"),
        ("def solve", "def  solve(", "twin.py cannot be loaded, line 2"),
        ("class Swing(Reference)", "class Swing", "it defines none"),
        ("def solve(", "def solved(", "Swing has no method solve"),
        ("length: Length", "length: float", "Swing.length: state the kind of the parameter"),
        ("length: Length", "solve: Length", "Swing.solve: a parameter cannot have this name"),
        (
            "length: Length",
            "length: Annotated[float, Quantity('furlong per')]",
            "Swing.length: unknown unit 'furlong per'",
        ),
        (
            "def solve(self, motion, ask)",
            "def solve(self, motion)",
            "twin.py: Swing.solve takes (self, motion, ask); here: (self, motion)",
        ),
        (
            "def properties(self, motion, ask)",
            "def properties(self)",
            "twin.py: Swing.properties takes (self, motion, ask); here: (self)",
        ),
        ("class Swing", "raise SystemExit(3)\nclass Swing", "SystemExit: 3"),
    ],
)
def test_a_faulty_program_is_one_line_with_its_place(tmp_path, old, new, words):
    assert old in SOURCE
    source = SOURCE.replace(old, new, 1)
    source = source.replace("import Acceleration", "import Quantity, Acceleration").replace(
        "import numpy as np\n", "import numpy as np\nfrom typing import Annotated\n", 1
    )
    file = write_sidecar(tmp_path, "twin.py", source)
    with pytest.raises(InputError) as caught:
        load_reference(load_case(file))
    assert caught.value.key == "reference"
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ("length = 1.0", "lenght = 1.0", "parameters.lenght", "did you mean 'length'?"),
        ("length = 1.0", "length = -1.0", "parameters", "length must be a positive finite length"),
        (
            "length = 1.0",
            'length = "long"',
            "parameters.length",
            "length is a length [m]; 'long' is no finite number with a unit",
        ),
        ("length = 1.0,", "", "parameters", "missing: length [m]"),
        ('"phases"', '"faces"', "chart.draw", "has no chart 'faces'; there are: phases"),
    ],
)
def test_bad_input_of_a_program_names_the_key_of_the_sidecar(tmp_path, old, new, key, words):
    file = write_sidecar(tmp_path, "twin.py")
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))
    (error,) = check([file], jobs=1).errors
    assert error.key == key
    assert words in str(error)


RESULT = 'return {"angle": angle, "rate": rate}'
LINE = SOURCE[: SOURCE.index(RESULT)].count("\n") + 1
FAULTS_OF_RESULTS = [
    (
        'return {"angle": angle[:1], "rate": rate}',
        "curve 'angle' has shape (1,), and must have (2,)",
    ),
    ('return {"angle": [angle], "rate": rate}', "motion.drive has arrays (n,), motion.drives"),
    ('return {"angle": "left", "rate": rate}', "curve 'angle' must be an array of real numbers"),
    ('return {"angle": [1, [2]], "rate": rate}', "curve 'angle' must be an array of real numbers"),
    ('return {"angle": 1j * angle, "rate": rate}', "curve 'angle' must be an array of real num"),
    ("return angle, rate", "solve must return a dict of curves by name, got ("),
    (
        'return {"angle": angle + np.nan, "rate": rate}',
        "curve 'angle' is nan at x = 0 of run.dynam",
    ),
    (
        'return {"angle": angle, "rate": np.where(motion.x > 0.5, np.inf, rate)}',
        "curve 'rate' is inf at x = 0.51 of run.dynamics",
    ),
]
FAULTS_OF_LINES = [
    ("return motion.way", "AttributeError: 'InputMotion' object has no attribute 'way'"),
    ("return [][0]", "IndexError: list index out of range"),
    ("return len(1.0)", "TypeError: object of type 'float' has no len()"),
    ("assert not len(angle), 'one\\ntwo'", "AssertionError: one two"),
]


@pytest.mark.parametrize(("new", "words"), FAULTS_OF_RESULTS)
def test_a_result_that_is_no_dict_of_curves_of_numbers_names_the_curve(tmp_path, new, words):
    (error,) = check([write_sidecar(tmp_path, "twin.py", SOURCE.replace(RESULT, new))]).errors
    assert error.key == "reference"
    assert error.wrong.startswith("twin.py: ")
    assert words in error.wrong


@pytest.mark.parametrize(("new", "words"), FAULTS_OF_LINES)
def test_an_exception_of_solve_names_its_line(tmp_path, new, words):
    (error,) = check([write_sidecar(tmp_path, "twin.py", SOURCE.replace(RESULT, new))]).errors
    assert error.key == "reference"
    assert error.wrong == f"twin.py, line {LINE}: {words}"


def test_a_value_error_of_solve_is_bad_input_of_the_parameters_with_its_line(tmp_path):
    source = SOURCE.replace(RESULT, "raise ValueError('too long')")
    (error,) = check([write_sidecar(tmp_path, "twin.py", source)]).errors
    assert (error.key, error.wrong) == ("parameters", f"twin.py, line {LINE}: too long")


def test_an_exception_of_properties_names_its_line(tmp_path):
    source = SOURCE.replace('return {"small swings"', 'return {"small swings": motion.way, "s"')
    (error,) = check([write_sidecar(tmp_path, "twin.py", source)]).errors
    assert error.key == "reference"
    assert error.wrong.startswith(f"twin.py, line {LINE + 3}: AttributeError: ")


def test_a_curve_without_numbers_is_named_where_no_cause_can_be_searched_for():
    case = load_case(shipped("pendulum.toml"))
    curves = solve(case, "dynamics", "mujoco")
    angle = curves.channels["angle"].copy()
    angle[3:] = np.nan
    found = find_causes(
        case, "dynamics", "mujoco", replace(curves, channels={**curves.channels, "angle": angle})
    )
    assert found.lines == [
        f"causes were not searched for: the curve of angle is no number at x = {curves.x[3]:g}"
    ]


@pytest.mark.parametrize("text", ["250 kg", "long"])
def test_a_text_in_the_place_of_a_number_is_refused_with_the_unit(models, edit, text):
    edit("fourbar.toml", r"crank = 1.0\b.*", f'crank = "{text}"')
    (error,) = check([models / "fourbar.toml"], jobs=1).errors
    assert error.key == "parameters.crank"
    assert "[m]" in error.wrong
    assert text in error.wrong


def test_a_program_outside_the_folder_of_the_sidecar_is_refused(tmp_path):
    (tmp_path / "inside").mkdir()
    write_sidecar(tmp_path, "twin.py")
    file = write_sidecar(tmp_path / "inside", "../twin.py")
    with pytest.raises(InputError, match="must be in the folder of the sidecar"):
        load_reference(load_case(file))


@pytest.mark.parametrize(
    ("command", "name"),
    [*((word, "twin.py") for word in ("check", "report", "list")), ("check", r"twin\u002epy")],
)
def test_a_search_of_a_folder_runs_no_program(tmp_path, command, name):
    folder, ran = tmp_path / "strange", tmp_path / "ran"
    folder.mkdir()
    file = write_sidecar(folder, name, f"{SOURCE}\nopen({str(ran)!r}, 'w').close()\n")
    output = ["-o", tmp_path / "pages"] if command == "report" else []
    answer = CliRunner().invoke(app, [command, str(folder), *map(str, output)])
    assert not ran.exists()
    assert "a search of a folder runs none" in answer.output.replace("\n", " ")
    assert answer.exit_code == 2 or command == "list"
    load_reference(load_case(file))
    assert ran.exists(), "the program runs where its sidecar is named"


def test_a_changed_program_is_another_reference_and_another_input(tmp_path):
    """It is read again, and leaves no other file in the folder."""
    file = write_sidecar(tmp_path, "twin.py")
    case = load_case(file)
    first = load_reference(case)
    assert load_reference(case) is first
    assert file.with_name("twin.py") in input_files(case)
    (tmp_path / "twin.py").write_text(SOURCE.replace("= 9.81", "= 1.62"))
    assert load_reference(case) is not first
    assert {one.name for one in tmp_path.iterdir()} == {"swing.toml", "twin.py"}


def test_a_program_that_hangs_or_aborts_costs_its_own_case_only(tmp_path):
    for name, fault in (("ends", "import os; os._exit(7)"), ("swing", "")):
        (tmp_path / name).mkdir()
        write_sidecar(tmp_path / name, "twin.py", f"{SOURCE}\n{fault}\n")
    result = check([tmp_path / name / "swing.toml" for name in ("ends", "swing")], jobs=1)
    (error,) = result.errors
    assert (error.file.parent.name, error.key) == ("ends", "reference")
    assert error.wrong == "its program cannot be loaded: exit code 7"
    assert {c.outcome for c in result.comparisons} == {"agrees"}
    assert {c.case for c in result.comparisons} == {"swing/swing"}


def test_the_example_of_the_page_agrees_and_its_mutation_is_found(tmp_path):
    """Two files beside a model are all that a stranger writes."""
    for file in (ROOT / "examples" / "yoke").iterdir():
        shutil.copy(file, tmp_path)
    sidecar = tmp_path / "yoke.toml"
    found = check([sidecar])
    assert [c.outcome for c in found.comparisons].count("agrees") == 23, found.errors
    assert "differs" not in {c.outcome for c in found.comparisons}
    sidecar.write_text(sidecar.read_text().replace("crank = 0.5 ", "crank = 0.505 "))
    answer = CliRunner().invoke(app, ["check", str(sidecar)])
    assert answer.exit_code == 1
    words = " ".join(answer.output.split())
    assert "crank is 0.505 m; with 0.5 m all 23 curves of 4 runs agree" in words
