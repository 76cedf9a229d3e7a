"""Names, streams and models of strangers: a report, or an error that names what is wrong."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from proofmass import check
from proofmass.base.errors import InputError
from proofmass.base.recorded import read_table
from proofmass.evidence.changed import model_source, with_changed_model
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import load_reference
from proofmass.report import write_report
from proofmass.report.page import slug
from proofmass.run.sidecar import load_case
from proofmass.run.validate import validate_case
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadModel
from proofmass.studies.pages import write_study_pages
from proofmass.studies.record import StudyRow, write_table
from tests.shipped import MODELS, shipped

SHORT = (("until = 10.0", "until = 0.5"), ("n = 1001", "n = 51"))


def write_pendulum(folder: Path, name: str = "pendulum") -> Path:
    """Write a short case of a pendulum, and return its sidecar."""
    folder.mkdir(exist_ok=True, parents=True)
    for ending in ("xml", "toml"):
        text = shipped(f"pendulum.{ending}").read_text(encoding="utf-8")
        for old, new in SHORT:
            text = text.replace(old, new)
        (folder / f"{name}.{ending}").write_text(text, encoding="utf-8")
    return folder / f"{name}.toml"


def run_proofmass(
    *words: object, folder: Path, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Run the command ``proofmass`` in a folder, in an environment with changes."""
    return subprocess.run(
        [sys.executable, "-m", "proofmass", *map(os.fsencode, map(str, words))],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "shift-jis", "utf-8"])
def test_a_stream_of_any_encoding_is_printed_to(tmp_path, encoding):
    write_pendulum(tmp_path, "四節 β")
    found = run_proofmass("check", ".", folder=tmp_path, PYTHONIOENCODING=encoding)
    assert found.returncode == 0, found.stderr
    text = found.stdout.decode(encoding)
    assert "agrees" in text
    assert ("✓" if encoding == "utf-8" else "+ agrees") in text
    shown = "四節" if encoding in ("utf-8", "shift-jis") else r"\u56db\u7bc0"
    assert shown in text


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize(
    "words", ["check .", "check . --json", "list .", "show pendulum.toml", "schema", "--help"]
)
def test_a_full_output_is_one_error(tmp_path, words):
    write_pendulum(tmp_path)
    with open("/dev/full", "wb") as full:
        found = subprocess.run(
            [sys.executable, "-m", "proofmass", *words.split()],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert found.returncode == 2
    errors = found.stderr.decode()
    assert errors.count("error: standard output: No space left on device") == 1
    assert "Traceback" not in errors
    assert "Exception ignored" not in errors


def test_a_reader_that_has_enough_is_no_error(tmp_path):
    write_pendulum(tmp_path)
    command = f"{sys.executable} -m proofmass schema | head -c 10"
    found = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, check=True)
    assert found.stdout == b'{\n "$schema'[:10]
    assert found.stderr == b""


LONG_NAME = "四節リンク機構の検証モデル（クランク揺動形・実験室二号機）"


@pytest.mark.parametrize("name", [LONG_NAME, "a" * 250])
def test_a_long_name_has_a_page(tmp_path, name):
    write_pendulum(tmp_path / "cases", name)
    write_pendulum(tmp_path / "cases", "good")
    result = check(tmp_path / "cases", causes=False)
    index = write_report(result, tmp_path / "pages", data=True)
    text = index.read_text(encoding="utf-8")
    for case in ("good", name):
        assert f"{slug(case)}.html" in text
        assert (tmp_path / "pages" / f"{slug(case)}.html").exists()
    assert slug(name) != slug(f"{name[:-1]}b")


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text there")
def test_a_folder_and_a_file_whose_names_are_not_utf_8(tmp_path):
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    case = write_pendulum(folder)
    case.rename(case.with_name(os.fsdecode(b"p\xe9nd.toml")))
    other = case.with_name(os.fsdecode(b"p\xe9nd.xml"))
    case.with_suffix(".xml").rename(other)
    found = run_proofmass("check", folder, "--junit", "a.xml", "--sarif", "b", folder=tmp_path)
    assert found.returncode == 0, found.stderr
    assert b"agrees" in found.stdout
    found = run_proofmass("report", folder, "-o", "pages", "--data", folder=tmp_path)
    assert found.returncode == 0, found.stderr
    assert len(list((tmp_path / "pages").glob("p~5cudce9nd.html"))) == 1
    other.write_text("<mujoco")
    found = run_proofmass("check", folder, folder=tmp_path)
    assert found.returncode == 2
    assert b"p\xe9nd.xml: XML" in found.stderr.replace(b"\n", b" ")
    assert b"Traceback" not in found.stderr


RECURSIVE = """<mujoco><asset><model name="m" file="{file}"/></asset><worldbody>
<body name="b"><joint axis="0 0 1"/><geom size=".1" pos="1 0 0"/>
<frame><attach model="m" body="b" prefix="x"/></frame></body></worldbody></mujoco>"""


@pytest.mark.parametrize("way", ["itself", "each other", "link", "include"])
def test_a_model_that_attaches_itself_is_refused_by_name(tmp_path, way):
    (tmp_path / "sub").mkdir()
    files = {
        "itself": {"a.xml": "a.xml"},
        "each other": {"a.xml": "sub/b.xml", "sub/b.xml": "../a.xml"},
        "link": {"a.xml": "link.xml"},
        "include": {"part.xml": "a.xml"},
    }[way]
    for name, file in files.items():
        (tmp_path / name).write_text(RECURSIVE.format(file=file))
    if way == "link":
        (tmp_path / "link.xml").symlink_to("a.xml")
    if way == "include":
        (tmp_path / "a.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(
        BadModel, match=r"a\.xml: <model file=.* attaches a model to itself: a\.xml"
    ):
        compile_model(tmp_path / "a.xml")


def test_a_model_may_attach_another_one_twice(tmp_path):
    """Both are no circle: two ways to the same model, and a comment on the model itself."""
    text = RECURSIVE.replace("</asset>", '<model name="n" file="{file}"/></asset>')
    text = text.replace("<frame>", '<frame><attach model="n" body="b" prefix="y"/>')
    (tmp_path / "a.xml").write_text(f"<!-- {RECURSIVE} -->{text}".format(file="b.xml"))
    (tmp_path / "b.xml").write_text('<mujoco><worldbody><body name="b"/></worldbody></mujoco>')
    assert compile_model(tmp_path / "a.xml").nbody == 4


TYPO_CASES = (
    "spatial/universal_joint",
    "linkages/axes_controlled",
    "linkages/finger",
    "linkages/hacksaw_recorded",
    "rods/rfr2_load_path",
)
"""Cases of the general references in space and in the plane, of a recorded one, of loads and rods.
The reference of those without channels is evaluated before all names are known to be right."""


@pytest.mark.parametrize("name", TYPO_CASES)
def test_a_typo_in_any_name_is_named(name, tmp_path):
    """Every name that a sidecar takes from its model, or from its reference, with a typo."""
    for file in (MODELS / name).parent.iterdir():
        if file.suffix in (".xml", ".csv", ".toml"):
            (tmp_path / file.name).write_bytes(file.read_bytes())
    sidecar = tmp_path / f"{Path(name).name}.toml"
    lines = sidecar.read_text(encoding="utf-8").splitlines(keepends=True)
    tried = 0
    for k, line in enumerate(lines):
        key, _, value = line.partition("=")
        if key.strip() not in NAME_KEYS or not value.strip().startswith('"'):
            continue
        tried += 1
        with_typo = line.replace('"', '"zq', 1)
        sidecar.write_text("".join([*lines[:k], with_typo, *lines[k + 1 :]]), encoding="utf-8")
        with pytest.raises(InputError, match="zq"):
            validate_case(load_case(sidecar))
    assert tried


NAME_KEYS = ("joint", "actuator", "model", "reference", "start", "scales", "x")


def test_a_single_path_is_that_path(tmp_path, monkeypatch):
    """And not the list of its letters, one of which is the current folder."""
    monkeypatch.chdir(tmp_path)
    write_pendulum(tmp_path)
    write_pendulum(tmp_path / "other")
    for path in ("pendulum.toml", Path("pendulum.toml")):
        result = check(path, causes=False, detectable=False)
        assert [case.name for case in result.cases] == ["pendulum"]
        assert not result.errors


DOTTED = """title = "a"
source = "b"
reference = "{reference}"
[run.dynamics]
n = 51
until = 0.5
solvers = ["mujoco", "pymunk"]
[[tolerance]]
relative_to_range = 1e-2
why = "half a second of a pendulum in steps of a millisecond"
"""


@pytest.mark.parametrize("reference", ["planar", "spatial"])
def test_sensors_may_have_dots_in_their_names(reference, tmp_path):
    sidecar = write_pendulum(tmp_path)
    text = DOTTED.format(reference=reference)
    if reference == "spatial":  # Chipmunk is of the plane
        text = text.replace(', "pymunk"', "")
    sidecar.write_text(text)
    model = sidecar.with_suffix(".xml")
    text = model.read_text(encoding="utf-8")
    text = text.replace("</body>", '<site name="end" pos="0 -1 0"/></body>')
    start, end = text.index("<sensor>"), text.index("</sensor>")
    more = """<sensor><jointpos name="the.angle" joint="pivot"/>
    <jointvel name="the" joint="pivot"/>
    <framepos name="the.end" objtype="site" objname="end"/>"""
    model.write_text(text[:start] + more + text[end:], encoding="utf-8")
    result = check(sidecar, causes=False)
    assert not result.errors
    assert {c.channel for c in result.comparisons} >= {"the.angle", "the", "the.end.x", "the.end.y"}
    assert {c.outcome for c in result.comparisons} == {"agrees"}
    write_report(result, tmp_path / "pages", data=True)
    sidecar.write_text(
        DOTTED.format(reference=reference) + '[channels]\n"the.end.w" = {}\n', encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"use the\.end\.x, \.y or \.z"):
        load_case(sidecar)


def test_an_edited_file_counts_in_the_same_session(tmp_path):
    """Also with the same size and time of change; a file that the model includes as well."""
    sidecar = write_pendulum(tmp_path)
    model, part = sidecar.with_suffix(".xml"), tmp_path / "part.xml"
    text = model.read_text(encoding="utf-8").replace("gravity=", "wind=")
    model.write_text(text.replace("</mujoco>", '<include file="part.xml"/></mujoco>'))
    for gravity in (-1.5, -2.5):
        part.write_text(f'<mujoco><option gravity="0 {gravity} 0"/></mujoco>')
        os.utime(part, (1e9, 1e9))
        case = load_case(sidecar)
        assert compiled_model(case).opt.gravity[1] == gravity
        assert model_source(case).full.opt.gravity[1] == gravity
    keys = []
    for row in ("1", "2"):
        (tmp_path / "a.csv").write_text(f"t [s],x [m]\n0,0\n1,{row}\n2,5\n")
        os.utime(tmp_path / "a.csv", (1e9, 1e9))
        keys.append(read_table(tmp_path / "a.csv").rows[1])
    assert keys[0] != keys[1]


@pytest.mark.parametrize("reference", ["../curve.csv", "{folder}/curve.csv"])
def test_a_changed_model_is_written_into_its_folder_alone(reference, tmp_path):
    """A recorded reference of another folder is not written, which would be beside that folder."""
    for ending in (".toml", ".xml", ".csv"):
        file = shipped("hacksaw.xml" if ending == ".xml" else f"hacksaw_recorded{ending}")
        place = tmp_path / "cases" / file.name if ending != ".csv" else tmp_path / "curve.csv"
        place.parent.mkdir(exist_ok=True)
        place.write_bytes(file.read_bytes())
    sidecar = tmp_path / "cases" / "hacksaw_recorded.toml"
    text = sidecar.read_text(encoding="utf-8")
    name = reference.format(folder=tmp_path)
    sidecar.write_text(text.replace("hacksaw_recorded.csv", name), encoding="utf-8")
    case = load_case(sidecar)
    before = (tmp_path / "curve.csv").stat()
    (tmp_path / "below" / "changed").mkdir(parents=True)
    changed = with_changed_model(case, [], tmp_path / "below" / "changed")
    assert [file.name for file in (tmp_path / "below").rglob("*") if file.is_file()] == [
        "hacksaw.xml"
    ]
    assert (tmp_path / "curve.csv").stat() == before
    assert isinstance(load_reference(changed), type(load_reference(case)))


def test_settings_of_figures_in_a_strangers_folder_are_not_read(tmp_path):
    """Such a file can make matplotlib start LaTeX; here it would make the pictures red."""
    write_pendulum(tmp_path)
    words = ["animate", "pendulum.toml", "--frames", "2", "-o"]
    assert run_proofmass(*words, "a.gif", folder=tmp_path).returncode == 0
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\naxes.facecolor: red\n")
    found = run_proofmass(*words, "b.gif", folder=tmp_path)
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "a.gif").read_bytes() == (tmp_path / "b.gif").read_bytes()


def test_a_page_of_a_study_is_in_the_folder_of_the_report(tmp_path):
    """Names in the table of a stranger's study are names, and no paths."""
    study = tmp_path / "study"
    study.mkdir()
    row = StudyRow("trade", "../../../case", "../../run", "mujoco", "a", "timestep", 0.01)
    write_table([row], study / "trade.csv")
    (study / "verdicts.json").write_text("[]")
    (tmp_path / "a" / "b" / "pages").mkdir(parents=True)
    with suppress(InputError):
        write_study_pages([study], tmp_path / "a" / "b" / "pages")
    outside = [
        file
        for file in tmp_path.rglob("*")
        if file.is_file() and not file.is_relative_to(tmp_path / "a" / "b" / "pages" / "trade")
    ]
    assert {file.parent for file in outside} == {study}
