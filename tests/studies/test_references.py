"""References of runs of a study: which are kept in a file, and for which motions they are used."""

import numpy as np
import pytest

from proofmass.reference.evaluate import reference_for
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.sim.protocol.curves import Curves
from proofmass.studies import measure, references
from proofmass.studies.measure import StudyRun, observe
from proofmass.studies.record import Setting
from proofmass.studies.references import moved_as_prescribed, reference_at, write_reference
from tests.shipped import shipped

FOURBAR = load_case(shipped("fourbar.toml"))
PENDULUM = load_case(shipped("pendulum.toml"))


def prescribed_curves(kind) -> Curves:
    """The samples of the four-bar's run, with its crank as prescribed; no engine runs."""
    run = prescribed_run(FOURBAR, kind)
    return Curves(run.x, {}, drive=run.motion(run.x))


@pytest.fixture
def evaluated(monkeypatch) -> list[str]:
    """The kinds of runs of all references that are evaluated, in order."""
    asked: list[str] = []

    def evaluate(case, kind, curves):
        asked.append(kind)
        return reference_for(case, kind, curves)

    monkeypatch.setattr(references, "reference_for", evaluate)
    return asked


@pytest.mark.parametrize("kind", ["sweep", "dynamics"])
def test_the_reference_at_the_prescribed_motion_is_evaluated_once(kind, evaluated, tmp_path):
    curves, file = prescribed_curves(kind), tmp_path / "a.npz"
    fresh = reference_for(FOURBAR, kind, curves).channels
    for _ in range(3):
        found = reference_at(FOURBAR, kind, curves, file)
        assert found.keys() == fresh.keys()
        assert all(np.array_equal(found[name], fresh[name]) for name in fresh)
    assert evaluated == [kind]
    reference_at(FOURBAR, kind, curves, None)
    assert evaluated == [kind] * 2  # without a file it is evaluated each time


def test_a_run_moves_as_prescribed_if_no_bit_differs():
    """One bit of a drive's value, rate or acceleration, and a sweep that ended early."""
    run, curves = prescribed_run(FOURBAR, "dynamics"), prescribed_curves("dynamics")
    assert moved_as_prescribed(run, curves)
    for k in range(3):
        moved = [np.array(part) for part in curves.drive]
        moved[k][0, -1] = np.nextafter(moved[k][0, -1], np.inf)
        assert not moved_as_prescribed(run, Curves(curves.x, {}, drive=tuple(moved)))
    part = Curves(curves.x[:9], {}, drive=tuple(one[:, :9] for one in curves.drive))
    assert not moved_as_prescribed(run, part)
    assert not moved_as_prescribed(run, Curves(curves.x, {}))
    free = prescribed_run(PENDULUM, "dynamics")
    assert moved_as_prescribed(free, Curves(free.x, {}))
    assert not moved_as_prescribed(free, Curves(free.x + 1e-12, {}))


@pytest.mark.parametrize(("late", "kept"), [(0.0, True), (1e-6, False)])
def test_only_the_reference_at_the_prescribed_motion_is_kept(late, kept, monkeypatch, tmp_path):
    """A sweep whose drive is late is compared with the reference where the drive is."""
    run = prescribed_run(FOURBAR, "sweep")
    value, rate, acceleration = run.motion(run.x)
    drive = value + late, rate, acceleration
    exact = reference_for(FOURBAR, "sweep", Curves(run.x, {}, drive=drive)).channels
    monkeypatch.setattr(measure, "call_engine", lambda *_: Curves(run.x, exact, drive=drive))
    file = tmp_path / "a.npz"
    task = StudyRun(FOURBAR, "sweep", Setting("mujoco"), reference=file)
    for _ in range(2):
        assert max(observe(task, False, None).errors.values()) == 0.0
        assert file.is_file() == kept


def test_the_reference_of_a_free_motion_is_written_before_its_runs(evaluated, tmp_path):
    file = tmp_path / "a.npz"
    for _ in range(2):
        write_reference(PENDULUM, "dynamics", file)
    assert evaluated == ["dynamics"]
    x = prescribed_run(PENDULUM, "dynamics").x
    found = reference_at(PENDULUM, "dynamics", Curves(x, {}), file)
    fresh = reference_for(PENDULUM, "dynamics", Curves(x, {})).channels
    assert all(np.array_equal(found[name], fresh[name]) for name in fresh)
    assert len(evaluated) == 1
