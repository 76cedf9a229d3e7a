"""`proofmass new --from` proposes a sidecar for a model, with which it agrees, or says why not."""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.batch.check import check
from proofmass.case.case import Tolerance
from proofmass.commands import new_from_model
from proofmass.commands.cli import app
from proofmass.commands.new_from_model import write_proposal
from proofmass.commands.proposal import joint_range, measured_runs
from proofmass.commands.proposal.flat_model import flat_tree
from proofmass.commands.proposal.inspection import ModelSummary, inspect_model
from proofmass.commands.proposal.measured_runs import (
    LeftOut,
    MeasuredRun,
    NothingMoves,
    accept,
    measure_driven_motion,
    measure_free_motion,
)
from proofmass.commands.proposal.measured_tolerance import (
    describe_far_off,
    measured_tolerances,
    round_up,
)
from proofmass.commands.proposal.model_copy import missing_sensors, with_named_key
from proofmass.commands.proposal.mutant import MutantTrial, try_mutants
from proofmass.commands.proposal.proposal import Proposal
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve
from proofmass.sim.contents import mechanism_dof
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.run import Run
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import Outcome
from tests.shipped import shipped

check_in_same_worker = partial(check, jobs=1, detectable=False, causes=False)
"""A check in the worker that measured: it has evaluated the reference of a free motion already."""


@pytest.fixture
def few(monkeypatch):
    """Proposed sweeps have 37 samples, on whose number nothing here depends."""
    whole = new_from_model.Proposal.text
    monkeypatch.setattr(
        new_from_model.Proposal,
        "text",
        lambda own: whole(own).replace("[run.sweep]\n", "[run.sweep]\nn = 37\n"),
    )


@pytest.fixture
def bare(tmp_path):
    """``bare(name)`` writes the model of a shipped case, alone, into a folder.

    Its sensors are removed unless `keep` is true.
    """

    def of(name: str, keep: bool = False) -> Path:
        text = shipped(f"{name}.xml").with_suffix(".xml").read_text()
        if not keep:
            text = re.sub(r"<sensor>.*?</sensor>", "", text, flags=re.S)
        file = tmp_path / f"{name}.xml"
        file.write_text(text)
        return file

    return of


def test_a_model_without_sensors_gets_sensors_and_agrees(bare):
    model = bare("slider_crank")
    before = model.read_bytes()
    files, messages = write_proposal("mine", model)
    assert [file.name for file in files] == ["mine.toml", "mine.xml"]
    assert model.read_bytes() == before
    found = check_in_same_worker([files[0]])
    assert found.exit_code == 0
    assert {"sweep", "dynamics"} == {c.run for c in found.comparisons if c.outcome == "agrees"}
    assert "one degree of freedom; joint 'crank' drives it and turns once" in messages[0]


@pytest.mark.usefixtures("few")
def test_a_model_with_sensors_is_not_copied(bare):
    (sidecar,), _ = write_proposal("mine", bare("fourbar", keep=True))
    case = load_case(sidecar)
    assert case.model == "fourbar.xml"
    assert "holding_moment" in case.channels


@pytest.mark.usefixtures("few")
def test_a_proposed_drive_stays_clear_of_its_limit_position(bare):
    """The crank of the double rocker swings by less than a turn, between two limit positions."""
    look = inspect_model(bare("double_rocker", keep=True))
    best = look.drive
    assert not best.turns
    begin, end = best.way
    assert abs(end - begin) < abs(best.far_end.value - best.start)
    (sidecar,), messages = write_proposal("mine", bare("double_rocker", keep=True))
    assert check_in_same_worker([sidecar]).exit_code == 0
    assert "90% of its way to a limit" in messages[0]


def test_a_mechanism_with_two_degrees_of_freedom_is_released(bare):
    files, messages = write_proposal("mine", bare("fivebar"))
    assert "2 degrees of freedom" in messages[0]
    found = check_in_same_worker(files[:1])
    assert found.exit_code == 0
    (case,) = found.cases
    assert not case.drive
    assert all(t.why.startswith("proposed: ") for t in case.tolerance)
    assert {c.outcome for c in found.comparisons} == {Outcome.AGREES}


@pytest.mark.usefixtures("few")
def test_a_joint_with_an_actuator_is_swept_if_springs_hold_the_others(bare):
    """The joint with the actuator is driven in a sweep, while springs hold the others at rest.

    Without the springs the other joints have no equilibrium, and no drive is proposed.
    """
    (sidecar, *_), messages = write_proposal("mine", bare("finger", keep=True))
    assert messages[0] == (
        "It has 2 degrees of freedom; joint 'driver' is driven, as its actuator does, and turns "
        "once. Springs hold the others at rest."
    )
    found = check_in_same_worker([sidecar])
    assert found.exit_code == 0
    (case,) = found.cases
    assert [drive.joint for drive in case.drive] == ["driver"]
    assert set(case.run) == {"sweep"}
    assert all(t.why.startswith("proposed: ") for t in case.tolerance)
    model = bare("finger", keep=True)
    text = model.read_text()
    assert 'stiffness="0.02"' in text
    model.write_text(text.replace('stiffness="0.02"', ""))
    assert inspect_model(model).drive is None


@pytest.mark.usefixtures("few")
def test_a_run_that_an_engine_does_not_cover_is_left_out_with_a_reason(bare):
    model = bare("fourbar")
    model.write_text(
        model.read_text().replace(
            '<joint name="rocker"/>', '<joint name="rocker" damping="0.1 0.1"/>'
        )
    )
    (sidecar, *_), messages = write_proposal("mine", model)
    (left_out,) = (line for line in messages if "pymunk cannot run" in line)
    assert left_out.startswith("sweep, pymunk and dynamics, pymunk: left out: ")
    assert "polynomial damping of joint 'rocker'" in left_out
    solvers = {kind: run.solvers for kind, run in load_case(sidecar).run.items()}
    assert solvers == {"sweep": ("mujoco",), "dynamics": ("mujoco",)}
    assert all(line in sidecar.read_text() for line in messages)


SPINNING_BOX = """<mujoco><option gravity="0 0 0" timestep="2e-3"/><worldbody><body name="top">
<freejoint/><geom type="box" size=".1 .2 .3" contype="0" conaffinity="0"/></body></worldbody>
<keyframe><key name="go" qvel="0.1 0 0 1 2 3"/></keyframe></mujoco>"""


def test_a_spatial_model_is_released_and_agrees(tmp_path):
    model = tmp_path / "top.xml"
    model.write_text(SPINNING_BOX)
    (sidecar, own), messages = write_proposal("spun", model)
    found = check_in_same_worker([sidecar])
    (case,) = found.cases
    assert (case.reference, case.start) == ("spatial", "go")
    assert case.run["dynamics"].solvers == ("mujoco",)
    assert case.run["dynamics"].until == 1.0
    assert {"top_place.x", "top_turn.w", "top_rate.z"} <= case.channels.keys()
    assert "planar solver does not cover it: free joint ''" in messages[0]
    assert "6 degrees of freedom" in messages[0]
    assert any(line.startswith("dynamics, pymunk: left out: ") for line in messages)
    assert {c.outcome for c in found.comparisons} == {Outcome.AGREES}
    # the check can fail: the step is too long for a body that turns ten times as fast
    own.write_text(own.read_text().replace("1 2 3", "10 20 30"))
    worse = check_in_same_worker([sidecar]).comparisons
    assert Outcome.DIFFERS in {c.outcome for c in worse}


def test_a_model_without_position_sensors_gets_some(tmp_path):
    """The new sensors are added to the model's own, which keep their names.

    A position or an orientation is needed because `proofmass choose` goes by the error of one.
    """
    model = tmp_path / "top.xml"
    own = '<sensor><frameangvel name="top_rate" objtype="body" objname="top"/></sensor></mujoco>'
    model.write_text(SPINNING_BOX.replace("</mujoco>", own))
    (sidecar, copy), _ = write_proposal("spun", model)
    assert copy.read_text().count('"top_rate"') == 1
    assert {"top_place.x", "top_turn.w", "top_rate.z"} <= load_case(sidecar).channels.keys()


def test_a_proposed_tolerance_leaves_room_for_rounding(tmp_path):
    """The error of a body in free flight is rounding, which differs from machine to machine."""
    model = tmp_path / "top.xml"
    model.write_text(SPINNING_BOX)
    (sidecar, _), _ = write_proposal("spun", model)
    found = check_in_same_worker([sidecar])
    (case,) = found.cases
    rate = next(one for one in case.tolerance if one.unit == ("rad/s",) or one.unit == "rad/s")
    rows = [c for c in found.comparisons if c.unit == "rad/s" and c.nrmse > 0]
    largest_range = max(c.error_rms / c.nrmse for c in rows)
    assert rate.abs >= 1e-12 * largest_range


def test_a_proposed_tolerance_is_at_least_rounding_of_the_range():
    """A proposed tolerance is 1e-12 of the range, or larger if the measured error is.

    Here the range is 1 km, of which 1e-12 is 1 nm; the error of 1e-3 m/s gets 3e-3 m/s.
    """
    without_error = Comparison("", "", "", "x", "m", error_max=1e-15, error_rms=5e-16, nrmse=5e-19)
    with_error = Comparison("", "", "", "v", "m/s", error_max=1e-3, error_rms=1e-3, nrmse=1e-6)
    found = list(measured_tolerances("dynamics", ("mujoco",), [without_error, with_error]))
    assert [one.abs for one in found] == [1e-9, 0.003]
    assert ["at least 1e-12 of the range" in one.why for one in found] == [True, False]


def compared(channel: str, error: float, scale: float) -> Comparison:
    """A comparison in m whose largest error is `error`, of a curve with the range `scale`."""
    return Comparison(
        "", "", "", channel, "m", error_max=error, error_rms=error, nrmse=error / scale
    )


def test_a_proposed_tolerance_passes_no_curve_that_does_not_move():
    """A curve that stays in the middle of its range is off by half of the range.

    The tip, off by 0.6 of its range, gets a tolerance that it exceeds, so that it differs.  The
    knob moves by less than the tolerance of the arm, and gets one of its own.
    """
    tip, arm, knob = (
        compared("tip", 0.6, 1.0),
        compared("arm", 0.1, 2.0),
        compared("knob", 1e-3, 0.1),
    )
    found = list(measured_tolerances("dynamics", ("pymunk",), [tip, arm, knob]))
    assert [(one.channels, one.abs, one.relative_to_range) for one in found] == [
        (("arm",), 0.3, None),
        (("knob",), 0.003, None),
        (("tip",), None, 0.08),
    ]
    assert "tip by 0.6 of its range" in describe_far_off([tip])


def test_a_channel_without_an_error_gets_no_tolerance_that_it_would_pass_unmoved():
    """The range of a curve without an error is not known, so that only rounding is allowed."""
    exact = Comparison("", "", "", "exact", "m", error_max=0.0, error_rms=0.0, nrmse=0.0)
    found = measured_tolerances("sweep", ("mujoco",), [compared("arm", 0.1, 2.0), exact])
    assert [(one.channels, one.abs) for one in found] == [(("arm",), 0.3), (("exact",), 2e-12)]


PENDULUM = """<mujoco><option gravity="0 0 -9.81"><flag contact="disable"/></option><worldbody>
<body><joint name="hinge" axis="0 1 0"/><geom size=".02" pos=".4 0 0"/></body>
</worldbody><sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""


def test_a_hinge_with_its_own_sensor_alone_is_let_go(tmp_path):
    """Driven, the hinge would be compared with its own motion, and agree whatever the engine does.

    A sensor of its moment shows something of a driven hinge as well.
    """
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM)
    look = inspect_model(model)
    assert (look.drive, look.dof, look.moves) == (None, 1, True)
    model.write_text(
        PENDULUM.replace(
            "<sensor>", '<actuator><motor name="m" joint="hinge"/></actuator><sensor>'
        ).replace("</sensor>", '<actuatorfrc name="moment" actuator="m"/></sensor>')
    )
    assert inspect_model(model).drive.joint == "hinge"


def test_a_sensor_of_the_drive_alone_is_completed_by_others(bare):
    """The crank's own angle is that of the drive: it measures no place of the linkage."""
    model = bare("slider_crank")
    text = model.read_text()
    sensor = '<sensor><jointpos name="angle" joint="crank"/></sensor></mujoco>'
    model.write_text(text.replace("</mujoco>", sensor))
    look = inspect_model(model)
    assert look.drive.joint == "crank"
    assert not look.placed


def test_a_joint_that_starts_beyond_its_range_is_named_with_the_model(bare):
    model = bare("fourbar", keep=True)
    model.write_text(
        model.read_text().replace('<joint name="rocker"', '<joint range="2.5 3" name="rocker"')
    )
    with pytest.raises(
        InputError, match=r"joint 'rocker' starts at .* rad, beyond its range"
    ) as found:
        write_proposal("mine", model)
    assert found.value.file == model


def test_an_error_in_a_proposal_names_the_given_model(bare, monkeypatch):
    """The sidecar is deleted again, so that its name would lead nowhere."""

    def fail(name, model, look, sidecar):
        raise InputError(sidecar, "drive", "wrong")

    monkeypatch.setattr(new_from_model, "propose_for", fail)
    model = bare("fourbar", keep=True)
    with pytest.raises(InputError) as found:
        write_proposal("mine", model)
    assert str(found.value) == f"{model}: drive: wrong"


def test_joints_that_can_be_no_better_than_the_best_are_not_driven(bare, monkeypatch):
    """Steps shrink towards limit positions: to walk there takes seconds for a toggle press."""
    driven = []

    def counted(mechanism, names):
        driven.extend(names)
        return branch(mechanism, names)

    branch = joint_range.Branch
    monkeypatch.setattr(joint_range, "Branch", counted)
    assert inspect_model(bare("fourbar", keep=True)).drive.joint == "crank"
    assert set(driven) == {"crank"}


def test_degrees_of_freedom_of_a_mechanism_with_loops_leave_out_what_the_loops_hold(bare):
    """A five-bar whose geoms may touch has four joints and two loop equations."""
    model = bare("fivebar")
    text = model.read_text()
    assert '<flag contact="disable"/>' in text
    model.write_text(text.replace('<flag contact="disable"/>', ""))
    compiled = compile_model(model)
    assert (compiled.nv, mechanism_dof(compiled, "start")) == (4, 2)


FALLING_BOX = """<mujoco><option timestep="5e-3"/><default><geom solref=".05 1"/></default>
<worldbody><geom type="plane" size="1 1 .1"/>
<body name="box" pos="0 0 .3" euler="20 10 0"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
</worldbody></mujoco>"""


CART_WITH_FRICTION = """<mujoco><option><flag contact="disable"/></option><worldbody>
<body name="cart"><joint name="slide" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/>
<body name="pole" euler="0 30 0"><joint name="hinge" axis="0 1 0" frictionloss="0.02"/>
<geom size=".05" pos="0 0 .5" mass=".2"/></body></body></worldbody>
<sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""


def test_a_model_with_contacts_is_compared_with_its_own_equations(tmp_path):
    """The reference is the model's own motion with refined steps, until it is no longer known.

    The proposed case can be checked like any other.  With a step of 5 ms some rates are so far
    off after the impact that they differ.
    """
    model = tmp_path / "box.xml"
    model.write_text(FALLING_BOX)
    (sidecar, _), messages = write_proposal("fallen", model)
    found = check_in_same_worker([sidecar])
    (case,) = found.cases
    assert case.reference == "refined"
    assert "judges the time stepping alone" in sidecar.read_text()
    assert 0.1 < case.run["dynamics"].until <= 1.0
    assert "in space" in messages[0]
    assert found.exit_code == 1
    differing = {c.channel for c in found.comparisons if c.outcome == Outcome.DIFFERS}
    assert {c.outcome for c in found.comparisons} == {Outcome.AGREES, Outcome.DIFFERS}
    assert differing < {c.channel for c in found.comparisons if c.unit == "rad/s"}
    assert max(c.error_max for c in found.comparisons) > 0  # a step of 5 ms has an error


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            SPINNING_BOX.replace(' name="top"', ""),
            "no joint, site or loose body of it has a name",
        ),
        (
            PENDULUM.replace("-9.81", "0"),
            "nothing moves: it starts at rest, and no force acts",
        ),
    ],
    ids=["without names", "at rest without forces"],
)
def test_a_model_without_anything_to_compare_is_refused(tmp_path, text, words):
    model = tmp_path / "model.xml"
    model.write_text(text)
    with pytest.raises(InputError, match=words):
        write_proposal("mine", model)
    assert [file.name for file in tmp_path.iterdir()] == ["model.xml"]


UNNAMED_KEY = '<keyframe><key qpos="0.1"/></keyframe></mujoco>'


def test_a_key_without_a_name_gets_one_in_a_copy(tmp_path):
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM.replace("</mujoco>", UNNAMED_KEY))
    (sidecar, copy), messages = write_proposal("mine", model)
    assert '<key name="start" qpos="0.1"/>' in copy.read_text()
    assert "Its key has no name; in mine.xml it is named start." in messages
    assert load_case(sidecar).start == "start"


def test_keys_that_no_element_states_are_the_initial_pose(tmp_path):
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM.replace("<worldbody>", '<size nkey="2"/><worldbody>'))
    named = tmp_path / "named.xml"
    named.write_text(with_named_key(model))
    assert [compile_model(named).key(0).name, *compile_model(named).key(0).qpos] == ["start", 0.0]
    assert inspect_model(named).start == "start"


def test_a_key_without_a_name_in_an_included_file_is_refused(tmp_path):
    (tmp_path / "keys.xml").write_text(f"<mujoco>{UNNAMED_KEY}")
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM.replace("</mujoco>", '<include file="keys.xml"/></mujoco>'))
    with pytest.raises(InputError, match="its key has no name"):
        write_proposal("mine", model)
    assert {file.name for file in tmp_path.iterdir()} == {"pendulum.xml", "keys.xml"}


def test_a_model_whose_first_key_has_no_name_starts_from_the_next(bare):
    model = bare("fourbar")
    model.write_text(model.read_text().replace('<key name="start"', "<key"))
    assert inspect_model(model).start == "crossed"


def test_a_mechanism_that_dry_friction_holds_is_refused_with_its_creep(tmp_path):
    """The reference stays at rest, while MuJoCo's dry friction creeps."""
    model = tmp_path / "cart.xml"
    held = re.sub(r'<joint name="slide"[^/]*/>', "", CART_WITH_FRICTION).replace('"0.02"', '"2"')
    model.write_text(held)
    with pytest.raises(InputError, match=r"nothing moves: .*; joint hinge creeps with"):
        write_proposal("mine", model)
    assert [file.name for file in tmp_path.iterdir()] == ["cart.xml"]


def test_a_model_that_takes_too_long_to_inspect_is_reported(tmp_path, monkeypatch):
    model = tmp_path / "box.xml"
    model.write_text(FALLING_BOX)
    monkeypatch.setattr(new_from_model, "INSPECTION_SECONDS", 0.05)
    with pytest.raises(InputError, match=r"could not be looked at: no answer in 0\.05 s of"):
        write_proposal("fallen", model)
    assert [file.name for file in tmp_path.iterdir()] == ["box.xml"]


MODELS_WITHOUT_PROPOSAL = {
    "no model": ("<mujoco", "<mujoca", "mujoca|Unrecognized|XML"),
    "nothing moves": (
        "</equality>",
        "<connect site1='point' site2='fixed'/></equality>",
        "no degree of freedom|over-constrained|does not cover|is not assembled: loop",
    ),
}


@pytest.mark.parametrize(
    ("old", "new", "said"), MODELS_WITHOUT_PROPOSAL.values(), ids=MODELS_WITHOUT_PROPOSAL.keys()
)
def test_a_model_without_a_proposal_is_reported_without_a_traceback(bare, old, new, said):
    model = bare("fourbar")
    text = model.read_text().replace("</worldbody>", '<site name="fixed" pos="1 2 0"/></worldbody>')
    text = text.replace('timestep="1e-3"', 'timestep="1e-2"')
    model.write_text(re.sub(old, new, text))
    found = CliRunner().invoke(app, ["new", "mine", "--from", str(model)])
    assert found.exit_code == 2
    assert re.search(said, found.stderr)
    assert "Traceback" not in found.stderr
    assert [file.name for file in model.parent.iterdir()] == ["fourbar.xml"], "a file is left"


def test_existing_files_are_not_overwritten(bare):
    model = bare("fourbar")
    other = model.with_name("mine.xml")
    other.write_text("mine")
    with pytest.raises(InputError, match=r"mine\.xml: it is there already"):
        write_proposal("mine", model)
    assert other.read_text() == "mine"


def test_output_is_refused_together_with_from(bare):
    found = CliRunner().invoke(app, ["new", "mine", "--from", str(bare("fourbar")), "-o", "x"])
    assert found.exit_code == 2
    assert "--output does not go with --from" in found.stderr


@pytest.mark.parametrize(("value", "up"), [(0.0123, 0.02), (2e-9, 2e-9), (9.5, 10.0), (0.0, 1e-12)])
def test_proposed_numbers_are_rounded_up(value, up):
    assert round_up(value) == up


SERVO_PENDULUM = PENDULUM.replace(
    "<sensor>", '<actuator><position name="m" joint="hinge" kp="9" kv="1"/></actuator><sensor>'
).replace("</sensor>", '<actuatorfrc name="moment" actuator="m"/></sensor>')


def test_a_servo_is_not_replaced_by_a_drive(tmp_path):
    """With a motor without a control the same hinge is driven."""
    model = tmp_path / "servo.xml"
    model.write_text(SERVO_PENDULUM)
    look = inspect_model(model)
    assert (look.drive, look.controlled) == (None, True)
    assert "let go under the controls of its key for 1 s" in look.describe()


TWO_MASSES = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
<body name="rotor"><joint name="rotor" axis="0 0 1" damping=".001"/>
<inertial pos="0 0 0" mass=".3" diaginertia=".002 .002 .002"/>
<body name="load"><joint name="flex" axis="0 0 1" stiffness="4" damping=".001"/>
<inertial pos="0 0 0" mass="1" diaginertia=".02 .02 .02"/></body></body></worldbody>
<actuator><motor name="tau" joint="rotor" ctrlrange="-5 5"/></actuator>
<sensor><jointpos name="rotor" joint="rotor"/><jointpos name="flex" joint="flex"/></sensor>
KEY</mujoco>"""
"""A rotor that drives a load over a torsion spring, as in mujoco#1524 with a softer spring."""


@pytest.fixture(scope="module")
def two_masses(tmp_path_factory):
    """The sidecar that is proposed for two masses on a spring, with a control in the key."""
    model = tmp_path_factory.mktemp("two") / "two.xml"
    key = '<keyframe><key name="start" qpos="0 0" ctrl="1"/></keyframe>'
    model.write_text(TWO_MASSES.replace("KEY", key))
    (sidecar,), _ = write_proposal("mine", model)
    return sidecar


def test_a_motor_with_a_control_lets_the_spring_oscillate(two_masses):
    """The resonance is the square root of k (1/I1 + 1/I2)."""
    case = load_case(two_masses)
    assert (case.drive, set(case.run)) == ((), {"dynamics"})
    curves = solve(case, "dynamics", "mujoco")
    flex = curves.channels["flex"] - curves.channels["flex"].mean()
    ups = np.flatnonzero((flex[:-1] < 0) & (flex[1:] >= 0))
    period = (curves.x[ups[-1]] - curves.x[ups[0]]) / (ups.size - 1)
    assert 2 * np.pi / period == pytest.approx(np.sqrt(4 * (1 / 0.002 + 1 / 0.02)), rel=0.01)


def test_a_sidecar_says_which_change_of_the_model_its_check_notices(two_masses):
    """The named change, made again, makes a curve differ; wider tolerances let all changes pass."""
    assert re.search(r"tried: load of tau larger by 1 %: [12] of 2 curves", two_masses.read_text())
    case = load_case(two_masses)
    asked = "dynamics", "mujoco", ["rotor"], ""
    assert try_mutants(case, *asked).turned
    wide = [
        one.model_copy(update={"abs": None, "relative_to_range": 0.4}) for one in case.tolerance
    ]
    found = try_mutants(case.model_copy(update={"tolerance": tuple(wide)}), *asked)
    assert (found.turned, found.differing) == (False, 0)
    assert "no curve differs" in found.describe()


def test_a_spring_that_stays_at_rest_is_not_compared_with_its_drive(tmp_path):
    """Without a control nothing but the drive would move, so that nothing is written."""
    model = tmp_path / "two.xml"
    model.write_text(TWO_MASSES.replace("KEY", ""))
    with pytest.raises(InputError, match="nothing but the drive moves"):
        write_proposal("mine", model)
    assert [file.name for file in tmp_path.iterdir()] == ["two.xml"]


PARALLEL_BARS = """<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><default>
<geom type="capsule" size=".1" contype="0" conaffinity="0"/></default><worldbody>
<body name="crank"><joint name="crank" axis="0 0 1"/><geom fromto="0 0 0 {a} 0 0"/>
<body name="coupler" pos="{a} 0 0"><joint name="coupler" axis="0 0 1"/>
<geom fromto="0 0 0 {b} 0 0"/><site name="one" pos="{b} 0 0"/></body></body>
<body name="rocker" pos="{b} 0 0"><joint name="rocker" axis="0 0 1"/>
<geom fromto="0 0 0 {a} 0 0"/><site name="two" pos="{a} 0 0"/></body></worldbody>
<equality><connect site1="one" site2="two"/></equality>
<sensor><jointpos name="angle" joint="coupler"/></sensor>
<keyframe><key name="start" qpos="1 -1 1"/></keyframe></mujoco>"""


@pytest.mark.parametrize(("a", "b"), [(4, 4), (1, 3)], ids=["square", "parallelogram"])
def test_a_drive_stops_before_a_change_point_and_names_it(tmp_path, a, b):
    """The bars are in line at 0 and at pi, of which pi is farther from the start at 1 rad."""
    model = tmp_path / "bars.xml"
    model.write_text(PARALLEL_BARS.format(a=a, b=b))
    look = inspect_model(model)
    assert look.drive.far_end == (pytest.approx(np.pi, abs=1e-6), True)
    assert look.drive.way == (pytest.approx(1.0), pytest.approx(1 + 0.9 * (np.pi - 1)))
    assert "90% of its way to the change point at 3.142 rad" in look.describe()


EXPLODING = """<mujoco><option timestep="0.02"/><worldbody>
<body><joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass="2"
contype="0" conaffinity="0"/></body></worldbody>
<actuator><position joint="a" kp="100"/><velocity joint="a" kv="9"/></actuator>
<sensor><jointpos name="a" joint="a"/></sensor>
<keyframe><key name="start" qpos=".5" ctrl="0 0"/></keyframe></mujoco>"""


def test_a_model_that_fails_with_its_own_step_gets_one_with_which_it_runs(tmp_path):
    """The damping 9 N m s/rad of a servo on 0.06 kg m^2 bears steps up to 2 I/kv = 13 ms."""
    model = tmp_path / "servo.xml"
    model.write_text(EXPLODING)
    (sidecar,), messages = write_proposal("mine", model)
    case = load_case(sidecar)
    assert case.run["dynamics"].solvers[:2] == ("mujoco", "mujoco:finer")
    assert case.settings["mujoco:finer"]["timestep"] in (0.02 / 2**k for k in range(1, 6))
    assert "mujoco" not in case.settings
    (failed,) = (line for line in messages if line.startswith("dynamics, mujoco: "))
    assert "the model's own step is 20 ms: diverged" in failed
    assert re.search(r"times the largest stable one, 13\.\d ms \(Euler\)", failed)
    found = check_in_same_worker([sidecar])
    outcomes = {c.solver: c.outcome for c in found.comparisons}
    assert outcomes["mujoco"] == Outcome.DIVERGED
    assert outcomes["mujoco:finer"] == Outcome.AGREES


UNUSABLE_MODELS = {
    "no joint": ("<mujoco><worldbody><body/></worldbody></mujoco>", "it has no joint"),
    "not a number": (
        PARALLEL_BARS.format(a=1, b=3).replace('"1 -1 1"', '"nan -1 1"'),
        "qpos='nan -1 1' is not a number",
    ),
    "open": (
        PARALLEL_BARS.format(a=1, b=3).replace('"1 -1 1"', '"1 0.2 1"'),
        "is not assembled: loop 'one to two' is open by",
    ),
    "no mesh": (
        '<mujoco><asset><mesh name="m" file="m.stl"/></asset><worldbody><body><joint name="a"/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
        "'m.stl'",
    ),
    "at rest": (
        FALLING_BOX.replace('"0 0 .3" euler="20 10 0"', '"0 0 .1"').replace(".05 1", ".01 1"),
        "nothing moves: until 1 s no body leaves its start by more than",
    ),
}


@pytest.mark.parametrize(("text", "words"), UNUSABLE_MODELS.values(), ids=UNUSABLE_MODELS.keys())
def test_an_unusable_model_is_refused_in_a_line_and_leaves_no_file(tmp_path, text, words):
    model = tmp_path / "model.xml"
    model.write_text(text)
    found = CliRunner().invoke(app, ["new", "mine", "--from", str(model)])
    assert found.exit_code == 2
    assert words in " ".join(found.stderr.split())
    assert "Traceback" not in found.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["model.xml"]


def test_an_included_file_is_part_of_a_changed_model(tmp_path):
    """The numbers of included files are changed as well; folders are those of the first file."""
    (tmp_path / "part.xml").write_text("<mujocoinclude>" + BODY_WITH_TIP + "</mujocoinclude>")
    main = tmp_path / "main.xml"
    main.write_text(
        '<mujoco><compiler meshdir="m"/><worldbody><include file="part.xml"/></worldbody></mujoco>'
    )
    tree = flat_tree(main)
    assert [body.get("name") for body in tree.iter("body")] == ["arm"]
    folders = [one.get("meshdir") for one in tree.iter("compiler") if one.get("meshdir")]
    assert folders == [str(tmp_path / "m")]


BODY_WITH_TIP = '<body name="arm"><joint/><geom size=".1"/></body>'


def test_names_with_quotation_marks_are_written_as_they_are(tmp_path):
    model = tmp_path / "pendulum.xml"
    model.write_text(PENDULUM.replace('"hinge"', "'a\"b'").replace('name="angle"', ""))
    sensors = missing_sensors(inspect_model(model))
    assert sensors[0] == "<jointpos name='a\"b' joint='a\"b'/>"


@pytest.mark.parametrize(
    ("step", "known", "until", "samples"),
    [(0.03, 1.0, 0.99, 34), (0.002, 1.0, 1.0, 501), (0.0007, 1.0, 0.9996, 477), (2.0, 1.0, 2.0, 2)],
)
def test_a_free_motion_takes_whole_steps_of_the_model(step, known, until, samples):
    """An engine then makes the model's own step, and none that is a little shorter."""
    none = ("",)
    look = ModelSummary(
        "", 1, None, none, (), True, none, none, none, step, True, known_until=known
    )
    assert (look.until, look.samples) == (until, samples)
    made = Run("dynamics", np.linspace(0, look.until, look.samples), ()).steps(step)[1]
    assert made == pytest.approx(step, rel=1e-12)


def outcome_of(outcome: Outcome) -> MeasuredRun:
    """A run of one channel with an outcome; a mutant turned its check if it agrees."""
    found = [replace(compared("tip", 0.1, 1.0), outcome=outcome, message="why")]
    trial = MutantTrial(("a larger by 1 %",), 1, 1, "a") if outcome == Outcome.AGREES else None
    return MeasuredRun(found, (), trial)


@pytest.fixture
def proposal():
    """A proposal for a model with a step of 8 ms."""
    none = ("",)
    look = ModelSummary("", 1, None, none, (), True, none, none, none, 0.008, True)
    return Proposal("mine", "a.xml", look, {"dynamics": ["mujoco"]})


@pytest.mark.parametrize("divisor", [1, 2, 4])
def test_a_driven_motion_gets_the_longest_step_with_which_it_agrees(monkeypatch, proposal, divisor):
    """The step that is written is that of the run that agrees, and the comment has the model's."""

    def measure(proposal, settings, kind, solver):
        fine = settings.get("timestep", 0.008) <= 0.008 / divisor
        return outcome_of(Outcome.AGREES if fine else Outcome.DIFFERS)

    monkeypatch.setattr(measured_runs, "measure", measure)
    monkeypatch.setattr(measured_runs, "with_step", lambda case, solver, step: {"timestep": step})
    measure_driven_motion(proposal, {}, "mujoco")
    assert proposal.steps == ({} if divisor == 1 else {"mujoco": 0.008 / divisor})
    assert ("the model's own step is 8 ms" in proposal.messages[0]) == (divisor > 1)


@pytest.mark.parametrize("outcome", [Outcome.UNSUPPORTED, Outcome.UNCHECKED, Outcome.OTHER_STEP])
def test_a_run_without_a_compared_curve_is_left_out(proposal, outcome):
    with pytest.raises(LeftOut, match="no curve of it is compared: why"):
        accept(proposal, "dynamics", "mujoco", outcome_of(outcome))
    with pytest.raises(NothingMoves):
        accept(proposal, "dynamics", "mujoco", outcome_of(Outcome.NOTHING_MOVED))
    assert proposal.messages == []
    accept(proposal, "dynamics", "mujoco", outcome_of(Outcome.DIFFERS))


def test_an_unexpected_error_of_a_model_is_a_line(tmp_path, monkeypatch):
    def fail(function, *args, **limits):
        raise KeyError("joint")

    monkeypatch.setattr(new_from_model, "call_isolated", fail)
    with pytest.raises(InputError, match="its motion could not be looked at: 'joint'"):
        write_proposal("mine", tmp_path / "model.xml")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("noticed", [True, False])
def test_a_step_that_agrees_with_finer_tolerances_is_tried_with_them(
    monkeypatch, proposal, noticed
):
    """If a mutant turns its check it stays alone, and otherwise the finer step takes its place."""

    def measure(proposal, case, kind, solver, tolerances=()):
        run = outcome_of(Outcome.AGREES)
        turned = solver == "mujoco:finer" or (noticed and tolerances)
        trial = MutantTrial(("a larger by 1 %",), int(bool(turned)), 1, "a")
        one = Tolerance(run="dynamics", solver=(solver,), abs=0.1, why="measured")
        return replace(run, trial=trial, tolerances=tolerances or (one,))

    monkeypatch.setattr(measured_runs, "measure", measure)
    monkeypatch.setattr(measured_runs, "with_step", lambda case, solver, step: case)
    measure_free_motion(proposal, None, "mujoco", None)
    kept = "mujoco" if noticed else "mujoco:finer"
    assert proposal.runs == {"dynamics": [kept]}
    assert [one.solver for one in proposal.tolerances] == [(kept,)]
    assert proposal.steps == ({} if noticed else {"mujoco:finer": 0.002})
