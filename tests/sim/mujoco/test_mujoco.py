"""Tests of runs in MuJoCo: assembly, holding moments, convergence, error floors, failed runs."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.mujoco.dynamics import check_run
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Diverged, Unsupported
from proofmass.sim.protocol.run import Drive, Run
from tests.shipped import shipped


def largest_relative_error(name: str, kind: str, units: tuple[str, ...], **settings) -> float:
    """The largest error of all channels in these units, each as a share of its range."""
    case = load_case(shipped(f"{name}.toml"))
    curves = simulate(case.model_path, replace(plan_run(case, kind, "mujoco"), settings=settings))
    truth = evaluate(case, kind, curves.x, curves.drive)
    return max(
        float(np.abs(curves.channels[n] - truth.channels[n]).max() / np.ptp(truth.channels[n]))
        for n in curves.channels
        if case.channels[n].unit in units
    )


POSITION_UNITS = ("m", "rad")
ALL_UNITS = ("m", "rad", "m/s", "rad/s", "m/s^2", "rad/s^2", "N m")


@pytest.mark.parametrize("name", ["fourbar", "fourbar_crossed", "hacksaw"])
def test_sweep_is_the_closed_form_to_rounding(name):
    # poses and the inverse of their constraint rows are exact to rounding: the largest error, of an
    # acceleration, is 8 eps of the range; rates by the rows of the last Newton step but one would
    # have errors of 400 to 700 eps
    assert largest_relative_error(name, "sweep", ALL_UNITS) < 1e-14


@pytest.mark.parametrize("samples", [63, 75, 83, 107])
def test_a_stride_to_a_change_point_is_taken_together_with_the_next(samples):
    """With these numbers of samples a stride is half of the spacing, and one ends at pi or 3 pi."""
    case = load_case(shipped("change_point.toml"))
    run = plan_run(case, "sweep", "mujoco")
    curves = simulate(case.model_path, replace(run, x=np.linspace(0, 4 * np.pi, samples)))
    truth = evaluate(case, "sweep", curves.x, curves.drive)
    for name in ("rocker", "coupler.angle"):  # rounding divided by the sine of 0.06 rad
        assert np.abs(curves.channels[name] - truth.channels[name]).max() < 1e-12


def test_softness_is_an_error_floor_that_the_step_does_not_lower():
    coarse = largest_relative_error(
        "hacksaw", "dynamics", POSITION_UNITS, timestep=1e-3, solref=(0.02, 1.0)
    )
    fine = largest_relative_error(
        "hacksaw", "dynamics", POSITION_UNITS, timestep=2.5e-4, solref=(0.02, 1.0)
    )
    stiff = largest_relative_error(
        "hacksaw", "dynamics", POSITION_UNITS, timestep=2.5e-4, solref=(0.01, 1.0)
    )
    assert fine == pytest.approx(coarse, rel=0.05)  # the step does not limit the error
    # the constraint violation of the loop is proportional to the square of solref
    assert fine / stiff == pytest.approx(4, rel=0.1)


def test_acceleration_errors_grow_with_step_over_solref_to_the_fourth():
    acceleration = ("m/s^2", "rad/s^2")
    stiff, soft = (
        largest_relative_error(
            "hacksaw", "dynamics", acceleration, timestep=1e-3, solref=(k * 1e-3, 1.0)
        )
        for k in (5, 7)
    )
    # the softness of the loops adds to the error
    assert np.log(stiff / soft) / np.log(7 / 5) == pytest.approx(4, abs=0.5)
    finer = largest_relative_error(
        "hacksaw", "dynamics", acceleration, timestep=2.5e-4, solref=(5 * 2.5e-4, 1.0)
    )
    assert finer == pytest.approx(stiff, rel=0.1)  # the error depends on the ratio, not on the step


def test_gravity_causes_an_error_floor_of_accelerations():
    acceleration = ("m/s^2", "rad/s^2")
    floors = [
        largest_relative_error(
            "fourbar", "dynamics", acceleration, timestep=dt, solref=(stiff, 1.0)
        )
        for dt, stiff in ((1e-3, 0.02), (1e-3, 0.01), (2.5e-4, 0.005))
    ]
    assert np.ptp(floors) < 0.05 * max(floors)
    # 1 - 0.9999 of the acceleration with which an open loop falls, times a length
    assert 1e-5 < max(floors) < 1e-3


@pytest.mark.parametrize(
    ("integrator", "order", "dt"), [("RK4", 4, 5e-3), ("RK4", 4, 2e-3), ("Euler", 1, 1e-3)]
)
def test_pendulum_converges_at_the_order_of_its_integrator(integrator, order, dt):
    """At 1 ms the error of RK4 is 5e-12; it would be 12e-12 if the bob had 1e-12 kg m^2."""
    errors = [
        largest_relative_error(
            "pendulum", "dynamics", ("rad",), timestep=step, integrator=integrator
        )
        for step in (dt, dt / 2)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)  # terms of higher order


def test_dynamics_states_the_settings_of_its_steps(models, edit):
    case = load_case(models / "fourbar.toml")
    tuned, plain = (
        simulate(
            case.model_path,
            replace(
                plan_run(case, "dynamics", "mujoco"), x=np.linspace(0, 0.1, 3), settings=settings
            ),
        ).settings
        for settings in ({}, {"defaults": True})
    )
    assert tuned == {
        "timestep": 1e-3,
        "integrator": "RK4",
        "solver": "NEWTON",
        "iterations": 100,
        "tolerance": 1e-10,
        "solref": (0.005, 1.0),
        "solimp": (0.9999, 0.9999, 0.001, 0.5, 2.0),
    }
    differ = {key for key in tuned if tuned[key] != plain[key]}
    assert differ == {"timestep", "integrator", "solref", "solimp"}
    more = '<connect name="pin" site1="coupler_end" site2="rocker_end" solref="0.02 1"/></equality>'
    file = edit("fourbar.xml", "</equality>", more.replace('"pin"', '"twice"'))
    both = simulate(file, replace(plan_run(case, "dynamics", "mujoco"), x=np.linspace(0, 0.1, 3)))
    assert both.settings["solref"] == "several"
    assert both.settings["solimp"] == tuned["solimp"]


def test_a_sweep_uses_no_settings_of_the_stepping_engine():
    case = load_case(shipped("fourbar.toml"))
    one, two = (
        simulate(
            case.model_path,
            replace(plan_run(case, "sweep", "mujoco"), x=np.linspace(0, 1, 5), settings=settings),
        )
        for settings in ({}, {"defaults": True, "iterations": 1})
    )
    assert one.settings == two.settings == {}
    # 1e-10: moments have the rounding of closed loops divided by solref^2
    for name, curve in one.channels.items():
        np.testing.assert_allclose(curve, two.channels[name], rtol=0, atol=1e-10, err_msg=name)


def sweep_curves(xml: str, tmp_path: Path, channels=("moment",), n: int = 5):
    """Curves of a sweep that drives the joint "a" of a small model from 0 to 1."""
    file = tmp_path / "model.xml"
    file.write_text(xml)
    drive = Drive("a", lambda x: (x, np.ones_like(x), np.zeros_like(x)))
    return simulate(file, Run("sweep", np.linspace(0, 1, n), channels, (drive,)))


ARM_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 -10 0"/><worldbody>
  <body name="a"><joint name="a" {spring}/><inertial pos="0.5 0 0" mass="3" diaginertia="1 1 1"/>
  {more}</body></worldbody><actuator><motor name="m" joint="a" gear="{gear}"/></actuator>
  <sensor><actuatorfrc name="moment" actuator="m"/></sensor></mujoco>"""


def test_the_holding_moment_balances_weight_and_spring_by_its_gear(tmp_path):
    xml = ARM_MODEL.format(spring='stiffness="7" springref="0.2"', more="", gear=2)
    curves = sweep_curves(xml, tmp_path)
    by_hand = (3 * 10 * 0.5 * np.cos(curves.x) + 7 * (curves.x - 0.2)) / 2
    np.testing.assert_allclose(
        curves.channels["moment"], by_hand, atol=1e-14, rtol=0
    )  # rounding of 15


def test_an_undetermined_degree_of_freedom_is_refused(tmp_path):
    loose = (
        '<body name="b" pos="1 0 0"><joint name="b"/><inertial pos="1 0 0" mass="1" '
        'diaginertia="1 1 1"/></body>'
    )
    with pytest.raises(Unsupported, match=r"1 degree\(s\) of freedom left when a = 0 is held"):
        sweep_curves(ARM_MODEL.format(spring="", more=loose, gear=1), tmp_path)


def test_a_weld_is_refused_by_name(tmp_path):
    weld = ARM_MODEL.format(spring="", more="", gear=1).replace(
        "<actuator>", '<equality><weld name="glue" body1="a"/></equality><actuator>'
    )
    with pytest.raises(Unsupported, match="weld 'glue'"):
        sweep_curves(weld, tmp_path)


def test_friction_of_a_driven_joint_changes_no_curve_in_dynamics(edit, models):
    case = load_case(models / "fourbar.toml")
    run = replace(plan_run(case, "dynamics", "mujoco"), x=np.linspace(0, 1, 11))
    free = simulate(case.model_path, run)
    edit("fourbar.xml", '<joint name="crank"', '<joint name="crank" frictionloss="50"')
    for name, curve in simulate(case.model_path, run).channels.items():
        np.testing.assert_array_equal(curve, free.channels[name], err_msg=name)


@pytest.mark.parametrize(
    "sensor", ['actuatorfrc name="moment" actuator="m"', 'jointactuatorfrc name="moment" joint="a"']
)
def test_dynamics_has_the_holding_moment_of_a_drive(sensor, tmp_path):
    """The moment balances the weight of 3 kg at 0.5 m, while the joint turns at 1 rad/s.

    The sensor of the motor shows it divided by the gear of 2, the sensor of the joint as it is.
    """
    xml = (
        ARM_MODEL.format(spring="", more="", gear=2)
        .replace('actuatorfrc name="moment" actuator="m"', sensor)
        .replace("<sensor>", '<sensor><jointpos name="a" joint="a"/><e_kinetic name="energy"/>')
    )
    file, drive = tmp_path / "model.xml", Drive("a", lambda t: (t, 1 + 0 * t, 0 * t))
    file.write_text(xml)
    channels, x = ("a", "moment", "energy"), np.linspace(0, 1, 3)
    curves = simulate(file, Run("dynamics", x, channels, (drive,)))
    assert set(curves.channels) == {"a", "moment"}
    gear = 2 if sensor.startswith("actuatorfrc") else 1
    wanted_moment = 3 * 10 * 0.5 * np.cos(curves.channels["a"])
    np.testing.assert_allclose(
        gear * curves.channels["moment"], wanted_moment, rtol=3e-9
    )  # the inertia of the flywheel is 1e9 times that of the mechanism
    assert "flywheels" in curves.missing["energy"]
    free = simulate(file, Run("dynamics", x, channels))
    np.testing.assert_array_equal(free.channels["moment"], 0)  # the motor has no control
    assert not free.missing


def test_friction_of_an_undriven_joint_acts_in_dynamics(tmp_path):
    """A bob starts with 1 rad/s, under friction of 0.5 N m per kg m^2: v = 1 - 0.5 t, then rest."""
    xml = ARM_MODEL.format(spring='frictionloss="1"', more="", gear=1).replace("0 -10 0", "0 0 0")
    xml = xml.replace("<sensor>", '<sensor><jointvel name="v" joint="a"/>').replace(
        "</mujoco>", '<keyframe><key name="start" qvel="1"/></keyframe></mujoco>'
    )
    xml = xml.replace('pos="0.5 0 0" mass="3"', 'pos="0 0 0" mass="3"').replace("1 1 1", "2 2 2")
    file = tmp_path / "model.xml"
    file.write_text(xml.replace('gravity="0 0 0"', 'gravity="0 0 0" timestep="1e-3"'))
    curves = simulate(file, Run("dynamics", np.linspace(0, 3, 7), ("v",)))
    by_hand = np.maximum(1 - 0.5 * curves.x, 0)
    np.testing.assert_allclose(curves.channels["v"], by_hand, atol=0.02)  # soft friction of MuJoCo


def test_a_joint_equality_drives_its_follower(tmp_path):
    follower = (
        '</body><body name="b"><joint name="b"/><inertial pos="1 0 0" mass="1" '
        'diaginertia="1 1 1"/>'
    )
    xml = (
        ARM_MODEL.format(spring="", more=follower, gear=1)
        .replace(
            "<actuator>",
            """<equality>
      <joint joint1="b" joint2="a" polycoef="0 0.5 0.25 0 0"/></equality><actuator>""",
        )
        .replace(
            "<sensor>",
            """<sensor><jointpos name="b" joint="b"/><jointvel name="vb" joint="b"/>
      <user name="ab" objtype="joint" objname="b" datatype="real" needstage="acc" dim="1"/>""",
        )
    )
    curves = sweep_curves(xml, tmp_path, ("b", "vb", "ab"))
    x = curves.x
    np.testing.assert_allclose(curves.channels["b"], 0.5 * x + 0.25 * x**2, atol=1e-14, rtol=0)
    np.testing.assert_allclose(curves.channels["vb"], 0.5 + 0.5 * x, atol=1e-14, rtol=0)
    np.testing.assert_allclose(
        curves.channels["ab"], 0.5, atol=1e-14, rtol=0
    )  # all three: rounding


def test_a_run_that_mujoco_resets_has_diverged(tmp_path):
    # an undamped spring with dt * omega = 76, while RK4 is stable up to 2.83; MuJoCo resets its
    # state and continues
    xml = ARM_MODEL.format(spring='stiffness="1e8"', more="", gear=1).replace(
        "<sensor>", '<sensor><jointpos name="a" joint="a"/>'
    )
    file = tmp_path / "model.xml"
    file.write_text(xml)
    settings = {"timestep": 0.01, "integrator": "RK4"}
    with pytest.raises(Diverged, match="badq"):
        simulate(file, Run("dynamics", np.linspace(0, 1, 11), ("a",), settings=settings))


def test_a_loop_that_comes_open_ends_a_run_where_it_does():
    """A loop is open at a tenth of the size of the model."""
    model = mujoco.MjModel.from_xml_path(str(shipped("fourbar.xml")))
    size, times = model.stat.extent, np.arange(4.0)
    record = SimpleNamespace(rows={"qpos": np.zeros((4, model.nq))})

    def run(*gaps: float) -> None:
        curves = Curves(times, {"a": times}, violations=size * np.array(gaps))
        check_run(model, mujoco.MjData(model), record, curves, [])

    run(0.0, 0.099, 0.099, 0.099)
    with pytest.raises(Diverged, match=f"open by {0.101 * size:.3g} m at t = 2 s") as error:
        run(0.0, 0.099, 0.101, 0.3)
    assert error.value.curves.x.tolist() == [0.0, 1.0]


def test_start_pose_far_from_assembled_is_refused(models, edit):
    file = edit("fourbar.xml", r'qpos="0  1\.35', 'qpos="0  2.35')
    case = load_case(models / "fourbar.toml")
    with pytest.raises(BadModel, match="loop 'pin' is open by"):
        simulate(file, plan_run(case, "sweep", "mujoco"))


def test_the_acceleration_of_a_point_does_not_include_gravity(tmp_path):
    xml = ARM_MODEL.format(spring="", more='<site name="tip" pos="2 0 0"/>', gear=1).replace(
        "<sensor>", '<sensor><framelinacc name="tip" objtype="site" objname="tip"/>'
    )
    curves = sweep_curves(xml, tmp_path, ("tip.x", "tip.y"))
    np.testing.assert_allclose(curves.channels["tip.x"], -2 * np.cos(curves.x), atol=1e-14, rtol=0)
    np.testing.assert_allclose(curves.channels["tip.y"], -2 * np.sin(curves.x), atol=1e-14, rtol=0)


def test_a_coupling_without_solution_is_named_as_an_equality(tmp_path):
    """A joint that must be 1 + b + b^2 cannot be driven to 0; the model has no loop."""
    xml = ARM_MODEL.format(spring="", more="", gear=1).replace(
        "<sensor>",
        '<sensor><jointpos name="a" joint="a"/>',
    )
    body = '<body name="b"><joint name="b"/><inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>'
    xml = xml.replace("</worldbody>", f"{body}</body></worldbody>").replace(
        "<sensor>",
        '<equality><joint joint1="a" joint2="b" polycoef="1 1 1 0 0"/></equality><sensor>',
    )
    with pytest.raises(BadModel, match=r"an equality of joints stays violated by .* rad"):
        sweep_curves(xml, tmp_path, ("a",))
