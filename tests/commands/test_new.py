"""A first model and sidecar by `proofmass new`, and the schema by which editors check sidecars."""

import json
import re
import shlex
import tomllib
from contextlib import nullcontext
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import check
from proofmass.commands.cli import app
from proofmass.commands.new import SCHEMA_FILE, write_new
from proofmass.run.schema import sidecar_schema
from proofmass.run.sidecar import load_case
from proofmass.verdict.outcome import Outcome
from tests.shipped import MODELS, shipped_files

CONTRIB = MODELS.parent / "contrib"


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    Draft202012Validator.check_schema(sidecar_schema())
    return Draft202012Validator(sidecar_schema())


def test_a_new_case_agrees_without_changes(tmp_path):
    assert [file.name for file in write_new("arm", tmp_path)] == [
        "arm.xml",
        "arm.toml",
        SCHEMA_FILE,
    ]
    found = check([tmp_path / "arm.toml"], detectable=False, causes=False)
    assert found.exit_code == 0
    assert {c.run for c in found.comparisons if c.outcome == Outcome.AGREES} == {
        "sweep",
        "dynamics",
    }
    assert {c.solver for c in found.comparisons if c.outcome == Outcome.AGREES} == {
        "mujoco",
        "pymunk",
    }


def test_existing_files_are_not_overwritten(tmp_path):
    write_new("arm", tmp_path)
    before = (tmp_path / "arm.toml").read_text()
    (tmp_path / "arm.xml").unlink()
    with pytest.raises(InputError, match=r"arm\.toml: it is there already"):
        write_new("arm", tmp_path)
    assert not (tmp_path / "arm.xml").exists()
    assert (tmp_path / "arm.toml").read_text() == before
    assert len(write_new("leg", tmp_path)) == 2, "the schema is there already"


@pytest.mark.parametrize("name", ["", "../arm", "a b", ".arm", "a/b"])
def test_names_that_are_no_file_names_are_refused(tmp_path, name):
    found = CliRunner().invoke(app, ["new", name, "-o", str(tmp_path)])
    assert found.exit_code == 2
    assert "is no name of a case" in found.stderr
    assert not list(tmp_path.iterdir())


def test_the_command_prints_the_schema(tmp_path):
    found = CliRunner().invoke(app, ["schema"])
    assert json.loads(found.stdout) == sidecar_schema()
    file = tmp_path / "s.json"
    CliRunner().invoke(app, ["schema", "-o", str(file)])
    assert file.read_text() == found.stdout


@pytest.mark.parametrize("file", shipped_files(), ids=lambda file: file.stem)
def test_every_shipped_sidecar_satisfies_the_schema(validator, file):
    assert [e.message for e in validator.iter_errors(tomllib.loads(file.read_text()))] == []


def test_the_schema_has_keys_of_the_file_and_no_internal_fields(validator):
    """The schema has the keys of tables by their names in the file, but no internal fields."""
    schema = sidecar_schema()
    assert schema["properties"].keys() >= {"accuracy", "drive", "channels", "refine"}
    assert not {"file", "unmatched", "called", "reads_model"} & schema["properties"].keys()
    assert "from" in schema["$defs"]["DriveTable"]["properties"]
    assert "null" not in json.dumps(schema)


REFUSED_SIDECARS = {
    "an unknown key": ('tilte = "x"', "tilte"),
    "an unknown key of a table": ('[drive]\njoint = "crank"\nfrmo = 1.0', "frmo"),
    "a word for a number": ('[drive]\njoint = "crank"\nto = "far"', "drive.to"),
    "an unknown run": ("[run.swep]\nn = 3", "'swep'"),
    "a number that is too small": ("[run.sweep]\nn = 1", "run.sweep.n"),
    "a tolerance without a reason": ("[[tolerance]]\nabs = 1.0", "tolerance"),
    "a channel with a key too many": (
        '[channels]\nrocker = { equals = "b", units = "m" }',
        "units",
    ),
}
"""Wrong lines of a sidecar, and a word of the key that the error names."""


@pytest.mark.parametrize(("text", "key"), REFUSED_SIDECARS.values(), ids=REFUSED_SIDECARS.keys())
def test_the_schema_refuses_sidecars_that_load_case_refuses(validator, tmp_path, text, key):
    good = 'title = "t"\nsource = "s"\nreference = "planar"\n{}\n[run.dynamics]\nuntil = 0.1\n'
    write_new("arm", tmp_path)
    for lines, valid in (("", True), (text, False)):
        (tmp_path / "arm.toml").write_text(good.format(lines))
        assert validator.is_valid(tomllib.loads(good.format(lines))) == valid
        with nullcontext() if valid else pytest.raises(InputError, match=re.escape(key)):
            load_case(tmp_path / "arm.toml")


def test_a_sidecar_without_drive_and_run_is_refused_by_the_schema_too(validator, tmp_path):
    """The runs by default, a sweep and dynamics, are those of a drive."""
    text = 'title = "t"\nsource = "s"\nreference = "planar"\n'
    assert not validator.is_valid(tomllib.loads(text))
    write_new("arm", tmp_path)
    (tmp_path / "arm.toml").write_text(text)
    with pytest.raises(InputError, match="run: missing"):
        load_case(tmp_path / "arm.toml")


def test_the_schema_reports_a_missing_key(validator):
    (missed,) = validator.iter_errors({"title": "t", "source": "s", "drive": {"joint": "a"}})
    assert "'reference'" in missed.message


@pytest.mark.parametrize("name", ["pre-commit-config.yaml", "github/action.yml"])
def test_the_options_in_contrib_exist_on_the_command_line(name):
    text = (CONTRIB / name).read_text().replace("\\\n", "")
    lines = re.findall(r"proofmass (check [^\n|]*)", text)
    assert lines
    for line in lines:
        options = [word for word in shlex.split(line)[1:] if word.startswith("-")]
        helped = CliRunner().invoke(app, ["check", "--help"], env={"COLUMNS": "200"}).stdout
        assert all(option in helped for option in options)


def test_a_new_sidecar_names_its_schema_and_an_existing_page(tmp_path):
    write_new("arm", tmp_path)
    text = (tmp_path / "arm.toml").read_text()
    assert text.startswith(f"#:schema {SCHEMA_FILE}\n")
    assert "docs/sidecar.md" in text
    assert (Path(MODELS).parent / "docs" / "sidecar.md").is_file()
