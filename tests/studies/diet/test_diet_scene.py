"""The scene of a diet: what is monitored, which changes are allowed, and the sentences on both.

No worker processes start: runs are made in the test's own process, or their curves are given.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.base.worker import OutOfMemory, TimedOut
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Run
from proofmass.studies.diet import scene
from proofmass.studies.diet.edits import read_model
from proofmass.studies.diet.scene import (
    Bound,
    MonitoredRun,
    channel_changes,
    channel_errors,
    monitor_run,
)
from proofmass.verdict.compare import compare_channel
from tests.shipped import shipped
from tests.studies.diet.test_diet_options import write_pendulum
from tests.studies.test_study_verdicts import monitored_run_of, raising

PENDULUM = load_case(shipped("pendulum.toml"))


def monitor_pendulum(
    curves: Curves,
    reference: dict[str, np.ndarray],
    monkeypatch,
    case=PENDULUM,
    solver: str = "mujoco",
):
    """A monitored run of the pendulum with given curves and given curves of its reference."""
    monkeypatch.setattr(scene, "run_original", lambda file, model, run: curves)
    monkeypatch.setattr(scene, "call_bounded", lambda case, kind, function, *told: function(*told))
    monkeypatch.setattr(
        scene, "reference_for", lambda case, kind, curves: Curves(curves.x, reference)
    )
    return monitor_run(
        case, plan_run(case, "dynamics", solver), solver, read_model(case.model_path)
    )


def pendulum_with_tolerance(channel: dict[str, object], **tolerance: object):
    """The case of the pendulum with one changed channel, its angle, and one tolerance of it."""
    angle = PENDULUM.channels["angle"].model_copy(update=channel)
    return PENDULUM.model_copy(
        update={
            "channels": {"angle": angle},
            "tolerance": (
                PENDULUM.tolerance[0].model_copy(
                    update={
                        "abs": None,
                        "relative_to_range": None,
                        "channels": ("angle",),
                        **tolerance,
                    }
                ),
            ),
        }
    )


@pytest.mark.parametrize(
    ("channel", "tolerance", "truth", "most"),
    [
        ({"unit": "deg"}, {"abs": 9.0}, [0.0, 1.0, 2.0], np.deg2rad(9.0)),
        ({}, {"abs": 0.3}, [0.0, 1.0, 2.0], 0.3),
        ({"unit": "deg"}, {"relative_to_range": 0.05}, [0.0, 1.0, 2.0], 0.1),
        # the reference is constant, so the share is of a scale, which is 1 rad for an angle
        ({}, {"relative_to_range": 0.2}, [2.0, 2.0, 2.0], 0.2),
    ],
)
def test_the_tolerance_is_that_of_the_comparison(channel, tolerance, truth, most, monkeypatch):
    """It is in the channel's own unit, and relative to its scale if the reference is constant."""
    curves = Curves(np.linspace(0.0, 1.0, 3), {"angle": np.array(truth) + 0.01})
    case = pendulum_with_tolerance(channel, **tolerance)
    monitored = monitor_pendulum(curves, {"angle": np.array(truth)}, monkeypatch, case)
    left = 0.1 * (most - 0.01)
    assert monitored.allowed["angle"] == pytest.approx(np.full(3, left), rel=1e-12, abs=0)
    assert monitored.bound.allowed["angle"] == pytest.approx(0.01 + left, rel=1e-12, abs=0)
    compared = compare_channel(case, "dynamics", "mujoco", "angle", curves, np.array(truth), {})
    assert compared.allowed * case.channels["angle"].factor == pytest.approx(most, rel=1e-12, abs=0)


def test_a_bound_is_the_error_plus_a_tenth_of_tolerance_minus_error(monkeypatch):
    """The allowed error is the error plus a tenth of the difference between tolerance and error.

    An error beyond its tolerance may only grow by a thousandth of rounding, which is 1e-9 of the
    largest value of the channel.
    """
    x, truth = np.linspace(0.0, 1.0, 3), np.array([0.0, 1.0, 2.0])
    curves = Curves(x, {"angle": truth + 0.01})
    for most, larger in ((0.11, 0.01), (0.005, 1e-3 * 1e-9 * 2.01)):
        monitored = monitor_pendulum(
            curves, {"angle": truth}, monkeypatch, pendulum_with_tolerance({}, abs=most)
        )
        assert monitored.bound.allowed["angle"] - 0.01 == pytest.approx(larger, rel=1e-3, abs=0)
    run = monitored.run
    assert (monitored.bound.run, monitored.bound.case) == (
        run,
        pendulum_with_tolerance({}, abs=most),
    )
    # no tolerance for MuJoCo: 1.1 times the error is allowed, or rounding
    free = pendulum_with_tolerance({}, abs=0.11, solver=("pymunk",))
    monitored = monitor_pendulum(curves, {"angle": truth}, monkeypatch, free)
    assert monitored.bound.allowed["angle"] == pytest.approx(0.011, rel=1e-12, abs=0)
    monitored = monitor_pendulum(curves, {"angle": truth + 0.01}, monkeypatch, free)
    assert monitored.bound.allowed["angle"] == pytest.approx(2.01e-9, rel=1e-12, abs=0)
    # a tolerance of the sweep does not apply to this run of dynamics
    for kind, most in (("sweep", 0.011), ("dynamics", 0.02)):
        monitored = monitor_pendulum(
            curves, {"angle": truth}, monkeypatch, pendulum_with_tolerance({}, abs=0.11, run=kind)
        )
        assert monitored.bound.allowed["angle"] == pytest.approx(most, rel=1e-12, abs=0)


def test_a_run_has_its_own_rods_and_limits(monkeypatch):
    case = load_case(shipped("rod_cantilever.toml"))
    run, asked = plan_run(case, "equilibrium", "mujoco"), []
    curves = Curves(run.x, {name: np.ones(run.x.size) for name in case.channels_of("equilibrium")})
    monkeypatch.setattr(
        scene, "run_original", lambda file, model, run: asked.append(model) or curves
    )
    monkeypatch.setattr(scene, "call_bounded", lambda *told: asked.append(told) or curves)
    edited = SimpleNamespace(compiled=lambda rods: ("model with", rods))
    assert monitor_run(case, run, "mujoco", edited).name == "rod_cantilever equilibrium"
    assert run.rods
    assert asked == [
        ("model with", run.rods),
        (case, "equilibrium", scene.reference_for, case, "equilibrium", curves),
    ]


def test_errors_are_given_relative_to_the_allowed_ones():
    x = np.arange(3.0)
    curves = Curves(
        x,
        {
            "a": np.array([0.0, 1.0, 1.0]),
            "b": np.array([0.0, -3.0, 1.0]),
            "nobody asks": np.full(3, 9.0),
        },
    )
    bound = Bound(
        Run("dynamics", x, ()),
        {"a": 0.5, "b": 2.0},
        {"a": np.array([0.0, 1.0, 2.0]), "b": np.zeros(3)},
    )
    assert bound.errors(curves) == {"a": 2.0, "b": 1.5}


def test_errors_of_a_case_use_its_reference_at_the_drives_state(monkeypatch):
    """The reference is evaluated again for the curves, in a worker with the limits of the run."""
    x, asked = np.arange(3.0), []
    curves = Curves(x, {"a": np.array([0.0, 1.0, 1.0])})

    def bounded(case, kind, function, *told):
        asked.append((case, kind, function, *told))
        return Curves(x, {"a": np.array([0.0, 1.0, 2.0])})

    monkeypatch.setattr(scene, "call_bounded", bounded)
    bound = Bound(Run("dynamics", x, ()), {"a": 0.25}, case=PENDULUM)
    assert bound.errors(curves) == {"a": 4.0}
    assert asked == [(PENDULUM, "dynamics", scene.reference_for, PENDULUM, "dynamics", curves)]


def test_only_the_change_of_a_potential_energy_counts():
    """A potential energy is known up to a constant: adding a constant is no change."""
    x, energy = np.arange(3.0), np.array([0.0, 1.0, 3.0])
    before = Curves(x, {"energy": energy, "other": energy})
    run, one = Run("passive", x, ()), np.ones(3)
    monitored = MonitoredRun(
        "",
        run,
        {"energy": one, "other": one},
        before,
        frozenset({"energy"}),
        Bound(run, {"energy": 1.0, "other": 1.0}, before.channels),
    )
    shifted = Curves(x, {"energy": energy + 7.0, "other": energy + 7.0})
    for how in (channel_changes(monitored, shifted, set()), channel_errors(monitored, shifted)):
        assert how == {"energy": 0.0, "other": 7.0}
    assert scene.with_changes_since_start(shifted, set()) is shifted


SENSORS = [
    SimpleNamespace(name=name, objname=of)
    for name, of in (
        ("angle", "crank"),
        ("place", "tip"),
        ("probe of tip", "tip"),
        ("rate", "crank"),
    )
]


def edited_model_of(
    monitored: tuple[str, ...] = (), added_sensors: tuple[str, ...] = (), sensors=SENSORS
):
    """A stand-in for an edited model with four sensors, one of which the study may have added."""
    spec = SimpleNamespace(
        joints=[SimpleNamespace(name="crank")],
        sensors=sensors,
        bodies=[],
        sites=[SimpleNamespace(name="tip")],
    )
    return SimpleNamespace(
        monitored=monitored, added_sensors=set(added_sensors), spec=spec, compiled=lambda: "model"
    )


def test_an_element_is_monitored_by_sensors_with_its_name_or_at_it():
    assert scene.sensors_at(edited_model_of(), ("tip", "rate")) == {
        "tip",
        "rate",
        "place",
        "probe of tip",
    }
    assert scene.monitored_sensors(edited_model_of()) is None
    own = edited_model_of(("tip", "angle"), ("probe of tip",))
    assert scene.monitored_sensors(own) == {"angle", "probe of tip"}
    curves = Curves(
        np.zeros(1),
        {"angle": np.zeros(1), "probe of tip[0]": np.ones(1), "place[0]": np.zeros(1)},
        steps=7,
    )
    left = scene.select_monitored(own, curves)
    assert (list(left.channels), left.steps) == (["angle", "probe of tip[0]"], 7)
    assert left.channels["probe of tip[0]"] == 1.0
    assert scene.select_monitored(edited_model_of(), curves) is curves


def test_a_run_keeps_only_the_channels_of_monitored_sensors():
    monitored = monitored_run_of(
        {"pin.x": 1.0, "pin.y": 2.0, "point.x": 3.0, "pin": 4.0},
        {"pin.x": [1.0], "pin.y": [2.0], "point.x": [3.0], "pin": [4.0]},
    )
    monitored = replace(monitored, name="run", level=frozenset({"pin"}))
    assert scene.channels_of_sensors(monitored, {"pin"}) == ["pin.x", "pin.y", "pin"]
    assert scene.channels_of_sensors(monitored, {"x"}) == []
    bound = Bound(
        replace(monitored.run, settings={"timestep": 1.0}),
        {"pin.x": 0.1, "pin.y": 0.2, "point.x": 0.3, "pin": 0.4},
        case=PENDULUM,
    )
    for each in (monitored, replace(monitored, bound=bound)):
        left = scene.keep_channels(each, {"pin"})
        assert (left.name, left.level, left.run) == (
            "run",
            {"pin"},
            replace(monitored.run, channels=("pin.x", "pin.y", "pin")),
        )
        assert left.allowed == {"pin.x": 1.0, "pin.y": 2.0, "pin": 4.0}
        assert left.before.channels == {"pin.x": 1.0, "pin.y": 2.0, "pin": 4.0}
        assert left.before.x is monitored.before.x
    assert left.bound == Bound(left.run, {"pin.x": 0.1, "pin.y": 0.2, "pin": 0.4}, case=PENDULUM)
    assert scene.keep_channels(monitored, {"pin"}).bound is None


ONE_CHANNEL_RUN = monitored_run_of({"y": 1.0}, {"y": [0.0]})


@pytest.mark.parametrize(
    ("edited", "words"),
    [
        (
            edited_model_of(("crank", "angle", "probe of tip"), ("probe of tip",)),
            "Monitored: joint crank and sensor angle, and nothing else.",
        ),
        (
            edited_model_of((), ("probe of tip",)),
            "Monitored, since no sidecar and no --watch says what matters: all sensors of the "
            "model, angle, place and rate.",
        ),
        (
            edited_model_of((), ("probe of tip",), SENSORS[2:3]),
            "Monitored, since no sidecar, no sensor and no --watch says what matters: everything "
            "that moves.",
        ),
    ],
)
def test_a_sentence_states_what_is_monitored_and_why(edited, words, monkeypatch):
    """Sensors that the study adds are not named.

    There is no sentence on independent groups if there is only one or if finding them fails.
    """
    for answer in (
        lambda *_, **__: [["a"]],
        raising(TimedOut("late")),
        raising(ValueError("other")),
    ):
        monkeypatch.setattr(scene, "call_isolated", answer)
        assert list(scene.describe_monitored(edited, ONE_CHANNEL_RUN)) == [words]


def test_a_sentence_states_how_potential_energies_are_compared(monkeypatch):
    monkeypatch.setattr(scene, "call_isolated", raising(TimedOut("late")))
    _, level = scene.describe_monitored(
        edited_model_of(), replace(ONE_CHANNEL_RUN, level=frozenset({"b", "a"}))
    )
    assert level == (
        "a and b: a potential energy is known up to a constant, so only its change "
        "counts; what does not move adds nothing to it."
    )


def test_independent_groups_are_named_if_everything_is_monitored(monkeypatch):
    """If the caller has named what is monitored, there is no sentence on groups."""
    asked = []

    def answer(function, *args, timeout):
        asked.append((function.__name__, *args, timeout))
        return [["a", "b"], ["c"]]

    monkeypatch.setattr(scene, "call_isolated", answer)
    _, groups = scene.describe_monitored(edited_model_of(), ONE_CHANNEL_RUN)
    assert asked == [("groups", "model", ONE_CHANNEL_RUN.run, 600.0)]
    assert groups == (
        "2 groups of bodies move without acting on each other in this run, through no contact, "
        "equality, tendon or actuator: a, b; c. All of what is monitored of them is kept. --watch "
        "NAME, with a joint, body, site or sensor of the group that matters, leaves the others "
        "out."
    )
    assert len(list(scene.describe_monitored(edited_model_of(("tip",)), ONE_CHANNEL_RUN))) == 1


def test_a_sidecar_is_about_the_model_it_names_or_that_of_its_own_name(tmp_path):
    file = tmp_path / "crank.toml"
    for text, model in (
        ('model = "other.xml"', "other.xml"),
        ('title = "x"', "crank.xml"),
        ("model =", "crank.xml"),
        ("a = " + "[" * 100_000, "crank.xml"),
        ("model = 7", "7"),
    ):
        file.write_text(text)
        assert scene.model_of_sidecar(file) == model
    file.write_bytes(b"title = '\xb0'")  # no UTF-8
    assert scene.model_of_sidecar(file) == "crank.xml"
    assert scene.model_of_sidecar(tmp_path / "none.toml") == "none.xml"


def test_sidecars_are_read_strictly_each_within_a_minute(tmp_path, monkeypatch):
    """A sidecar that cannot be read here counts as that of the model of its own name.

    Loading it with that model then reports what is wrong.
    """
    for name in ("b", "a", "c"):
        (tmp_path / f"{name}.toml").write_text('model = "a.xml"')
    asked = []

    def answer(function, path, *, timeout):
        asked.append((function.__name__, path.name, timeout))
        if path.stem == "c":
            raise OutOfMemory("full")
        return function(path)

    monkeypatch.setattr(scene, "call_isolated", answer)
    monkeypatch.setattr(scene, "load_validated", lambda path, strict: (path.name, strict))
    assert list(scene.load_sidecars(tmp_path / "a.xml")) == [("a.toml", True), ("b.toml", True)]
    assert asked == [("model_of_sidecar", f"{name}.toml", 60.0) for name in "abc"]
    assert list(scene.load_sidecars(tmp_path / "c.xml")) == [("c.toml", True)]


def test_compiling_in_a_worker_is_limited_to_two_minutes(tmp_path, monkeypatch):
    """A model that takes too long or too much memory is bad input.

    A model that MuJoCo refuses is only reported as not compiling; reading it gives the reason.
    """
    file, asked = write_pendulum(tmp_path), []
    monkeypatch.setattr(
        scene,
        "call_isolated",
        lambda function, *args, timeout: asked.append((function, args, timeout)),
    )
    scene.compile_in_worker(file)
    assert asked == [(scene.accepts_model, (file,), 120.0)]
    monkeypatch.setattr(scene, "call_isolated", raising(TimedOut("no answer")))
    with pytest.raises(InputError) as error:
        scene.compile_in_worker(file)
    assert (error.value.file, error.value.key, error.value.wrong) == (
        file,
        "",
        "cannot be compiled: no answer",
    )
    assert scene.accepts_model(file)
    file.write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    assert not scene.accepts_model(file)
