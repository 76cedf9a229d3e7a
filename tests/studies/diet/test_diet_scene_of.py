"""The runs of a scene: those of the sidecars of a model, or the free motion of the model."""

from dataclasses import replace
from pathlib import Path

import pytest

from proofmass.base.errors import InputError
from proofmass.run.sidecar import load_case
from proofmass.studies.diet import scene
from proofmass.studies.diet.scene import load_scene
from tests.shipped import shipped
from tests.studies.diet.test_diet_options import write_pendulum
from tests.studies.test_study_verdicts import monitored_run_of, raising

REFERENCE_SENTENCE = (
    "Options are compared with the references of the sidecars: an error may grow by a tenth of "
    "the difference between its tolerance and itself."
)


@pytest.fixture
def requested_runs(monkeypatch) -> list[tuple]:
    """Sidecars are read in the test's own process; the runs are not made, but listed here."""
    asked = []

    def monitored_run(case, run, solver, edited):
        asked.append((case.name, run.kind, solver, edited))
        names = case.channels_of(run.kind)
        return monitored_run_of(dict.fromkeys(names, 1.0), {name: [0.0] for name in names})

    monkeypatch.setattr(scene, "call_isolated", lambda function, *args, timeout: function(*args))
    monkeypatch.setattr(scene, "load_validated", lambda path, strict: load_case(path))
    monkeypatch.setattr(scene, "monitor_run", monitored_run)
    monkeypatch.setattr(scene, "compile_in_worker", raising(AssertionError()))
    return asked


@pytest.fixture
def listed_calls(monkeypatch) -> list[tuple]:
    """Nothing runs for a model without a sidecar; the calls that would do so are listed here."""
    asked = []
    monkeypatch.setattr(scene, "compile_in_worker", lambda file: asked.append(("compiled", file)))
    monkeypatch.setattr(
        scene,
        "monitor_free_motion",
        lambda file, edited, seconds: (
            asked.append((file, edited, seconds)) or monitored_run_of({"y": 1.0}, {"y": [0.0]})
        ),
    )
    monkeypatch.setattr(
        scene,
        "with_fine_solution",
        lambda file, edited, monitored, error: (
            asked.append((file, edited, monitored, error)) or ("held", "why")
        ),
    )
    monkeypatch.setattr(scene, "describe_monitored", lambda edited, monitored: iter(("one", "two")))
    return asked


@pytest.mark.parametrize("error", ["nan", "inf", "-0.001"])
def test_an_error_that_is_no_share_of_a_range_is_refused(error, tmp_path):
    """Another number is refused before the model, which does not exist here, is read."""
    file = tmp_path / "none.xml"
    with pytest.raises(InputError) as found:
        load_scene(file, 1.0, (), float(error))
    assert (found.value.file, found.value.key, found.value.wrong) == (
        file,
        "--error",
        f"{error} is no share of a range; give a number such as 1e-4",
    )


@pytest.mark.parametrize("error", [None, 0.0, 1e-4, 2.0])
def test_a_model_without_sidecars_is_compared_with_its_fine_solution(error, tmp_path, listed_calls):
    file = write_pendulum(tmp_path)
    found = load_scene(file, 3.0, ("bob",), error)
    compiled, let, fine = listed_calls
    edited = let[1]
    assert compiled == ("compiled", file)  # in a worker, before it is compiled here
    assert (let[0], let[2]) == (file, 3.0)
    assert (fine[:2], fine[3]) == ((file, edited), error)
    assert (edited.monitored, edited.rods) == (("bob",), ())
    assert (found.edited, found.monitored_runs, found.said) == (
        edited,
        ("held",),
        ("one", "two", "why"),
    )
    # the sensors that are added for a joint and a body with that name
    assert found.read == {
        f"{kind} bob {what}"
        for kind, whats in (
            ("joint", ("jointpos", "jointvel")),
            ("body", ("framepos", "framequat", "framelinvel", "frameangvel")),
        )
        for what in whats
    }
    assert found.keys == {"start"}


def test_a_free_motion_without_a_key_keeps_no_key(tmp_path, listed_calls, monkeypatch):
    """The run starts from no key, so there is no key to keep."""
    monitored = monitored_run_of({"y": 1.0}, {"y": [0.0]})
    monitored = replace(monitored, run=replace(monitored.run, start=""))
    monkeypatch.setattr(scene, "monitor_free_motion", lambda *_: monitored)
    found = load_scene(write_pendulum(tmp_path), 3.0)
    assert (found.keys, found.read) == (set(), None)


def test_sidecars_of_a_missing_model_are_not_read(tmp_path, monkeypatch):
    """For a mistyped name the message is that there is no such model, whatever a sidecar says."""
    (tmp_path / "none.toml").write_text('model = "none.xml"')
    monkeypatch.setattr(scene, "load_sidecars", raising(AssertionError()))
    monkeypatch.setattr(scene, "compile_in_worker", lambda file: None)
    with pytest.raises(InputError, match="no such model"):
        load_scene(tmp_path / "none.xml", 1.0)


def test_a_sidecar_is_refused_with_the_name_of_its_model():
    sidecar = shipped("fourbar_crossed.toml")
    with pytest.raises(InputError, match="is a sidecar; give its model") as found:
        load_scene(sidecar, 1.0)
    assert str(found.value).endswith(str(sidecar.with_name("fourbar.xml")))


def keep_only_sidecar(models: Path, name: str) -> Path:
    """Delete all sidecars but that of one model, and return the file of the model."""
    for sidecar in models.glob("*.toml"):
        if sidecar.stem != name:
            sidecar.unlink()
    return models / f"{name}.xml"


def test_runs_of_the_sidecars_are_monitored_with_all_channels(models, requested_runs):
    found = load_scene(keep_only_sidecar(models, "fourbar"), 1.0)
    case = load_case(models / "fourbar.toml")
    kinds = ["sweep", "dynamics"]
    assert [list(w.allowed) for w in found.monitored_runs] == [
        list(case.channels_of(k)) for k in kinds
    ]
    assert requested_runs == [("fourbar", kind, "mujoco", found.edited) for kind in kinds]
    assert (found.edited.monitored, found.edited.added_sensors) == ((), set())
    assert found.read == {name.partition(".")[0] for name in case.channels}
    assert found.keys == {"start"}
    assert found.said == (
        "Monitored: the channels of the sidecars, in their runs.",
        REFERENCE_SENTENCE,
    )


def test_the_edited_model_has_the_rods_of_its_sidecar(models, requested_runs):
    found = load_scene(keep_only_sidecar(models, "rod_cantilever"), 1.0)
    assert found.edited.rods == load_case(models / "rod_cantilever.toml").rods
    assert found.edited.rods


def test_only_channels_that_read_the_named_element_are_monitored(models, requested_runs):
    """For a site they are the channels of the sensors at it; for a sensor its own channel."""
    file = keep_only_sidecar(models, "fourbar")
    found = load_scene(file, 1.0, ("rocker_end",))
    wanted = ["pin.x", "pin.y", "pin_velocity.x", "pin_velocity.y"]
    assert [list(w.allowed) for w in found.monitored_runs] == [wanted, wanted]
    assert found.read == {"pin", "pin_velocity"}
    assert found.said == (
        "Monitored: pin.x, pin.y, pin_velocity.x and pin_velocity.y, in the runs of the sidecars.",
        REFERENCE_SENTENCE,
    )
    moment = load_scene(file, 1.0, ("holding_moment",))
    assert [list(w.allowed) for w in moment.monitored_runs] == [
        ["holding_moment"],
        ["holding_moment"],
    ]


def test_an_element_that_no_channel_reads_cannot_be_monitored(models, requested_runs, edit):
    """No sensor is at the site; the message suggests a channel with a similar name."""
    keep_only_sidecar(models, "pendulum")
    file = edit("pendulum.xml", "</body>", '<site name="rate_"/><site name="tip"/></body>')
    with pytest.raises(InputError) as error:
        load_scene(file, 1.0, ("rate_", "tip"))
    assert (error.value.file, error.value.key, error.value.wrong) == (
        file,
        "--watch",
        (
            "no channel of the sidecars reads rate_ and tip; did you mean 'rate'? their channels: "
            "angle, rate, acceleration, kinetic, potential"
        ),
    )


def test_an_allowed_error_is_refused_for_a_model_with_sidecars(models, requested_runs):
    file = keep_only_sidecar(models, "pendulum")
    with pytest.raises(InputError) as error:
        load_scene(file, 1.0, (), 1e-4)
    assert (error.value.file, error.value.key, error.value.wrong) == (
        file,
        "--error",
        ("its sidecar states what an error may be; change its tolerances, or leave --error out"),
    )
