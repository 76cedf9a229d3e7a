"""What was read of a case's files is read again only if their content changes."""

import os

from proofmass.reference import case_model
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import load_reference
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.failures import BadModel, BadRod
from tests.reference.stubs import (
    FOURBAR,
    ROD,
    error_of,
    with_tables,
)


def test_a_model_is_compiled_again_only_if_its_file_or_its_rods_change(models):
    case = load_case(models / "pendulum.toml")
    first = compiled_model(case)
    assert compiled_model(with_tables(case, title="another")) is first
    before = case.model_path.stat().st_mtime_ns
    case.model_path.write_text(case.model_path.read_text().replace('mass="1"', 'mass="3"'))
    os.utime(case.model_path, ns=(before + 1, before + 1))
    assert compiled_model(case).body("bob").mass == 3 * first.body("bob").mass
    finer = ROD.rod["rod"].model_copy(update={"segments": 7})
    assert compiled_model(with_tables(ROD, rod={"rod": finer})).nbody < compiled_model(ROD).nbody


def test_a_recorded_curve_is_read_again_only_if_its_file_has_changed(models):
    case = load_case(models / "hacksaw_recorded.toml")
    first = load_reference(case)
    assert load_reference(case) is first
    file = models / case.reference
    before = file.stat().st_mtime_ns
    head, *rows = [line for line in file.read_text().splitlines() if not line.startswith("#")]
    file.write_text("\n".join([head, *rows[:3]]))
    os.utime(file, ns=(before + 1, before + 1))
    assert len(load_reference(case).table.rows) == 3 < len(first.table.rows)
    file.unlink()
    assert error_of(load_reference, case) == (file, "", "no such recorded curve")


def test_a_rod_that_cannot_be_built_is_an_error_of_the_sidecar(monkeypatch):
    def fail(*_):
        raise BadRod("beam", "from", "no site 'clmp'")

    monkeypatch.setattr(case_model, "compile_once", fail)
    assert error_of(compiled_model, ROD) == (ROD.file, "rod.beam.from", "no site 'clmp'")


def test_a_compilation_error_names_the_model_once(monkeypatch):
    def fail(*_):
        raise BadModel("fourbar.xml: XML Error: line 3")

    monkeypatch.setattr(case_model, "compile_once", fail)
    assert error_of(compiled_model, FOURBAR) == (FOURBAR.model_path, "", "XML Error: line 3")
