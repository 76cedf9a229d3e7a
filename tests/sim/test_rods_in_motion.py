"""Tests of rods with mass in dynamics: wrong numbers differ, and start rates keep loops closed."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.batch.check import check
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadRod
from proofmass.sim.protocol.run import Drive, Rod, Run
from proofmass.verdict.compare import compare
from proofmass.verdict.refinement import refined_errors
from tests.shipped import shipped
from tests.sim.rod_models import ENGINES

ELASTIC_SLIDER_CRANK = "slider_crank_elastic"


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("rod_released.toml", r"(?s)(\[rod.rod\].*stiffness = )0.25", r"\g<1>0.2525"),
        ("rod_released.toml", r"(?s)(\[rod.rod\].*mass = )0.1", r"\g<1>0.101"),
        pytest.param(
            "rod_released.toml",
            r"(?s)(\[rod.rod\].*length = )1.0",
            r"\g<1>1.005",
            marks=pytest.mark.slow,
        ),
        ("rod_released.toml", "stiffness = 0.25     # N m2", "stiffness = 0.2525"),
        ("rod_released.toml", "segments = 20", 'segments = 20\nscheme = "naive"'),
        ("rod_released.xml", "0 -9.81 0", "0 9.81 0"),
        pytest.param("rod_released.xml", "0 -9.81 0", "0 -9.7 0", marks=pytest.mark.slow),
        pytest.param(
            f"{ELASTIC_SLIDER_CRANK}.toml",
            r"(?s)(\[rod.*stiffness = )0.2",
            r"\g<1>0.202",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            f"{ELASTIC_SLIDER_CRANK}.toml",
            r"(?s)(\[rod.*mass = )0.1",
            r"\g<1>0.101",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            f"{ELASTIC_SLIDER_CRANK}.xml", 'mass="0.05"', 'mass="0.0505"', marks=pytest.mark.slow
        ),
        pytest.param(
            f"{ELASTIC_SLIDER_CRANK}.xml",
            'pos="0.25 0 0"',
            'pos="0.2501 0 0"',
            marks=pytest.mark.slow,
        ),
        (f"{ELASTIC_SLIDER_CRANK}.toml", "rate = 6.0", "rate = -6.0"),
        pytest.param(
            f"{ELASTIC_SLIDER_CRANK}.xml", 'qvel="6 0"', 'qvel="0 0"', marks=pytest.mark.slow
        ),
    ],
)
def test_wrong_numbers_of_moving_rods_differ(name, old, new, edit):
    """Each mutation changes at least one outcome to "differs".

    Stiffness, mass or weight are wrong by 1 %, a rod's length by 0.5 %, a crank's by 0.1 mm.  Other
    mutations are springs at other places, the opposite sign of gravity or of the drive, and a
    coupler that starts without its rate.  A released rod falls for 0.4 s.
    """
    edit("rod_released.toml", "until = 1.2", "until = 0.4")
    edit("rod_released.toml", "n = 61", "n = 21")
    sidecar = edit(name, old, new).with_suffix(".toml")
    if "rate = -6.0" in new:
        edit(sidecar.name, "to = 6.28", "to = -6.28")
    if "0.2501" in new:
        edit(name, 'pos="1.25 0 0"', 'pos="1.2501 0 0"')
    case = load_case(sidecar.with_suffix(".toml"))
    curves = solve_here(case, "dynamics", "mujoco")
    found = compare(case, "dynamics", "mujoco", curves, detectable=False)
    assert "differs" in {c.outcome for c in found}


def test_an_elastic_coupler_in_pymunk_converges_with_order_2():
    """Errors with 6 and 12 links are compared, over an eighth of a turn of the crank.

    Moments and energies are left out, since they begin at zero.
    """
    case = load_case(shipped(f"{ELASTIC_SLIDER_CRANK}.toml"))
    runs = {"dynamics": case.run["dynamics"].model_copy(update={"n": 10})}
    drives = (case.drive[0].model_copy(update={"to": np.pi / 4}),)
    errors = []
    for segments in (6, 12):
        rods = {"coupler": case.rod["coupler"].model_copy(update={"segments": segments})}
        brief = case.model_copy(update={"rod": rods, "run": runs, "drive": drives})
        found = refined_errors(brief, "dynamics", "pymunk", solve_here(brief, "dynamics", "pymunk"))
        errors.append({c.channel: c.error_max for c in found if c.unit not in ("J", "N m")})
    orders = {name: np.log2(errors[0][name] / errors[1][name]) for name in errors[0]}
    assert len(orders) == 7
    # 0.15 is the tolerance of the order in [refine]
    assert orders == pytest.approx(dict.fromkeys(orders, 2.0), abs=0.15)


def test_a_motion_that_is_not_resolved_is_an_error_of_its_parameters(edit):
    file = edit("rod_released.toml", "stiffness = 0.25     # N m2", "stiffness = 1e9")
    (error,) = check([file]).errors
    assert "rod_released.toml: parameters" in str(error)
    assert "too stiff to be followed so long" in str(error)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_a_coupler_starts_with_the_rate_of_a_rigid_coupler(angle, tmp_path):
    """The first joint of a straight coupler starts with the rate of a rigid coupler.

    The rate follows from the rates of the key; the springs start straight and without a rate.
    """
    x = 0.25 * np.cos(angle) + np.sqrt(1.0 - (0.25 * np.sin(angle)) ** 2)
    turn = -np.arcsin(0.25 * np.sin(angle))
    rate = -6.0 * 0.25 * np.cos(angle) / np.cos(turn)
    slide = -6.0 * 0.25 * np.sin(angle) - rate * np.sin(turn)
    file = tmp_path / "model.xml"
    text = shipped(f"{ELASTIC_SLIDER_CRANK}.xml").read_text()
    key = f'qpos="{angle!r} {float(x) - 1.25!r}" qvel="6 {float(slide)!r}"'
    file.write_text(text.replace('qvel="6 0"', key))
    rod = Rod("coupler", "crank_end", "slider_pin", 1.0, 0.2, 8, ("pinned", "pinned"), mass=0.1)
    model = compile_model(file, [rod])
    pose, rates = (
        {model.joint(j).name: float(row[j]) for j in range(model.njnt)}
        for row in (model.key_qpos[0], model.key_qvel[0])
    )
    assert pose["coupler.0"] == pytest.approx(turn - angle, abs=1e-12)
    assert rates["coupler.0"] == pytest.approx(rate - 6.0, abs=1e-9)
    springs = [f"coupler.{k}" for k in range(1, 9)]
    assert [rates[name] for name in springs] == pytest.approx([0.0] * 8, abs=1e-9)
    assert [pose[name] for name in springs] == pytest.approx([0.0] * 8, abs=1e-9)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    apart = data.site("coupler.tip").xpos - data.site("slider_pin").xpos
    np.testing.assert_allclose(apart, 0.0, atol=1e-9)


def test_a_bent_coupler_starts_with_rates_that_keep_its_loop_closed(tmp_path):
    """The start rates of a bent coupler do not open its loop.

    Its arc is 0.02 m longer than the distance of its supports; it bends with the smallest rates.
    """
    file = tmp_path / "model.xml"
    text = shipped(f"{ELASTIC_SLIDER_CRANK}.xml").read_text()
    file.write_text(text.replace('qvel="6 0"', 'qpos="0.7 -0.0922" qvel="6 -1"'))
    rod = Rod(
        "coupler", "crank_end", "slider_pin", 1.0, 0.2, 8, ("pinned", "pinned"), mass=0.1, turn=0.7
    )
    model = compile_model(file, [rod])
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    rows = data.efc_J.reshape(data.nefc, model.nv)
    np.testing.assert_allclose(rows @ data.qvel, 0.0, atol=1e-9)
    assert np.abs(data.qvel[2:]).max() > 0.1


def test_a_straight_coupler_between_fixed_supports_is_refused(tmp_path):
    file = tmp_path / "model.xml"
    text = shipped(f"{ELASTIC_SLIDER_CRANK}.xml").read_text()
    joints = '<joint name="crank"/>', '<joint name="slider" type="slide" axis="1 0 0"/>'
    for joint in (*joints, '<motor name="motor" joint="crank"/>', 'qvel="6 0"'):
        text = text.replace(joint, "")
    file.write_text(text.replace('<actuatorfrc name="drive_moment" actuator="motor"/>', ""))
    rod = Rod("coupler", "crank_end", "slider_pin", 1.0, 0.2, 8, ("pinned", "pinned"), mass=0.1)
    with pytest.raises(BadRod, match="must be longer, or stretch"):
        compile_model(file, [rod])


PENDULUM_ON_ARM = """<mujoco><compiler angle="radian"/>
  <option timestep="1e-3" integrator="RK4" gravity="0 -9.81 0"><flag contact="disable"/></option>
  <worldbody><body name="arm"><joint name="arm"/>
    <inertial pos="0.5 0 0" mass="1" diaginertia="1e-3 1e-1 1e-1"/>
    <body name="bob" pos="1 0 0"><joint name="bob"/>
      <inertial pos="0.7 0 0" mass="1" diaginertia="1e-6 1e-6 1e-6"/></body></body></worldbody>
  <sensor><jointpos name="bob" joint="bob"/><jointvel name="bob_rate" joint="bob"/></sensor>
  <keyframe><key name="start" qpos="0 -1.2" qvel="0.8 0.5"/></keyframe></mujoco>"""


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pendulum_on_a_driven_arm_follows_its_equation(engine, tmp_path):
    """A pendulum on an evenly turning arm follows its equation, from pose and rate of the key."""
    file = tmp_path / "model.xml"
    file.write_text(PENDULUM_ON_ARM)
    t, length, inertia = np.linspace(0.0, 1.0, 11), 0.7, 0.49 + 1e-6

    def slopes(time, state):
        arm, (bob, rate) = 0.8 * time, state
        pull = -9.81 * np.cos(arm + bob) - 0.8**2 * np.sin(bob)
        return rate, length * pull / inertia

    wanted = solve_ivp(slopes, (0.0, 1.0), (-1.2, 0.5), "DOP853", t, rtol=1e-11, atol=1e-12).y
    drive = Drive("arm", lambda x: (0.8 * x, 0.8 + 0.0 * x, 0.0 * x))
    found = ENGINES[engine](file, Run("dynamics", t, ("bob", "bob_rate"), (drive,))).channels
    np.testing.assert_allclose(found["bob"], wanted[0], atol=2e-5)
    np.testing.assert_allclose(found["bob_rate"], wanted[1], atol=2e-5)
