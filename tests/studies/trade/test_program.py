"""Programs of MuJoCo that run without proofmass: their curves, errors, drives and messages."""

import ast
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from proofmass.case.case import Case
from proofmass.case.drive import (
    TABLE_TOLERANCE,
    FunctionProfile,
    InProportion,
    Steady,
    Swing,
    motion_source,
)
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine
from proofmass.sim.mujoco.engine import ENGINE as MUJOCO
from proofmass.sim.mujoco.program import IMPOSED, expand_model
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.programs import Imposed
from proofmass.sim.protocol.run import Drive, Run
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.trade.program import (
    NoCurves,
    ProgramRun,
    drive_ways,
    program_text,
    program_text_here,
    read_curves,
    run_bare_program,
    run_program,
    run_stored_program,
)
from proofmass.studies.trade.verify import model_text_at
from tests.programs import program_curves, run_standalone
from tests.shipped import shipped
from tests.studies.trade.driven import drive_curves

COARSE_PARAMETERS = {
    "timestep": 4e-3,
    "integrator": "RK4",
    "solref": (0.032, 1.0),
    "solimp": (0.9999, 0.9999, 0.001),
}


def load_short_case(name: str, n: int = 21, until: float | None = None) -> Case:
    """A case with a few samples of its dynamics."""
    case = load_case(shipped(f"{name}.toml"))
    table = case.run["dynamics"].model_copy(update={"n": n, **({"until": until} if until else {})})
    return case.model_copy(update={"run": {"dynamics": table}})


def imported_modules(text: str) -> set[str]:
    """Modules that a program imports."""
    nodes = list(ast.walk(ast.parse(text)))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return names | {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}


@pytest.mark.parametrize(
    "name", ["fourbar", "pendulum", "fourbar_released", "hacksaw", "slider_crank"]
)
def test_a_program_gives_the_curves_of_the_engine(name: str, tmp_path: Path) -> None:
    """The program makes the same steps from the same state as the engine's adapter.

    Forward passes at the samples give the constraint solver other start values.  Its results differ
    within its tolerance, 1e-10 to 1e-8 of the forces, and stiff loops turn these differences into
    accelerations: hence 1e-6 of the range.
    """
    case, setting = load_short_case(name), Setting("mujoco", COARSE_PARAMETERS)
    text = program_text_here(case, setting, IMPOSED[0], 'A head\nwith """ and \\ in it.')
    assert imported_modules(text) == {"csv", "sys", "time", "mujoco", "numpy"}
    assert "proofmass" not in text
    found = program_curves(text, tmp_path)
    case, run = setting.apply_to(case, "dynamics")
    wanted = call_engine("mujoco", case.model_path, run)
    curves = wanted.channels | drive_curves(run, wanted)
    assert list(found) == ["t", *curves]
    assert found["t"] == pytest.approx(wanted.x, abs=1e-12)
    for channel, curve in curves.items():
        assert found[channel] == pytest.approx(curve, abs=1e-6 * max(1e-3, np.ptp(curve))), channel


def test_the_program_of_a_pendulum_agrees_with_elliptic_functions(tmp_path: Path) -> None:
    """The reference is computed here with Jacobi's elliptic functions.

    RK4 at 10 ms has an error of 1e-7 of the range.
    """
    case = load_short_case("pendulum", 101, 2.0)
    found = program_curves(
        program_text_here(
            case, Setting("mujoco", {"timestep": 0.01, "integrator": "RK4"}), IMPOSED[0], ""
        ),
        tmp_path,
    )
    k, w = math.sin(math.pi / 4), math.sqrt(9.81)  # the pendulum is released from the horizontal
    sn = ellipj(ellipk(k**2) - w * found["t"], k**2)[0]
    exact = -2 * np.arcsin(k * sn)
    assert np.ptp(exact) > 3.0
    assert found["angle"] == pytest.approx(exact, abs=3e-7 * np.pi)
    assert np.abs(found["angle"] - exact).max() > 1e-10  # it is not the reference itself


@pytest.mark.parametrize(
    ("drive", "position"),
    [(Imposed("flywheel"), 1e-5), (Imposed("servo", 2.0), 3e-5), (Imposed("equality", 0.5), 3e-5)],
)
def test_the_program_of_a_fourbar_agrees_with_its_geometry(
    drive: Imposed, position: float, tmp_path: Path
) -> None:
    """The reference is the intersection of the two circles of the joints, computed here.

    The crank turns at 1 rad/s, with implicitfast at 1 ms.  A servo of gain 2 lets the crank lag by
    its load over kp, 1e-5 rad.  The moment of each drive is compared at the motion that the drive
    really had, so that only the softness of the loop contributes to its error.
    """
    case = load_short_case("fourbar", 91)
    setting = Setting(
        "mujoco",
        {
            **COARSE_PARAMETERS,
            "timestep": 1e-3,
            "integrator": "implicitfast",
            "solref": (4e-3, 1.0),
        },
    )
    text = program_text_here(case, setting, drive, "")
    assert 1e-6 < run_program(case, setting, text, 30.0).driven["force"] < 2e-5
    found = program_curves(text, tmp_path)
    t = found["t"]
    assert t[-1] == pytest.approx(2 * np.pi)
    crank = np.array([np.cos(t), np.sin(t)])
    d = crank - np.array([[3.0], [0.0]])  # from the rocker's ground pin to the crank pin
    far = np.hypot(*d)
    along = (2.5**2 - 2.0**2 + far**2) / (2 * far)
    turn = np.unwrap(np.arctan2(d[1], d[0]))
    rocker = turn - np.arccos(along / 2.5)  # the open assembly mode
    assert np.ptp(rocker) > 0.5
    off = np.abs(found["rocker"] - rocker).max() / np.ptp(rocker)
    assert 0 < off < position


def test_a_servo_with_too_high_a_gain_fails() -> None:
    """RK4 is explicit in the servo's damping, so kv h / I = 2 gain above 2.8 is unstable."""
    case, setting = load_short_case("fourbar"), Setting("mujoco", COARSE_PARAMETERS)
    text = program_text_here(case, setting, Imposed("servo", 2.0), "")
    ran = run_program(case, setting, text, 30.0)
    assert not ran.errors
    assert "mjWARN_BADQ" in ran.failure


def sine_cubed_profile(x, far):
    """A motion profile that a program writes as a table: value, rate and acceleration."""
    return (
        far * np.sin(x) ** 3,
        3 * far * np.sin(x) ** 2 * np.cos(x),
        far * (6 * np.sin(x) * np.cos(x) ** 2 - 3 * np.sin(x) ** 3),
    )


LEADING_SWING = Swing(0.3, 1.7, 2.5)
PROFILES = {
    "steady": [Steady(0.5, -2.0, x_is_time=True)],
    "swing": [LEADING_SWING],
    "in proportion": [LEADING_SWING, InProportion(LEADING_SWING, 0.3, -0.5, 2.0)],
    "table": [
        FunctionProfile(partial(sine_cubed_profile, far=0.7)),
        Steady(0.5, -2.0, x_is_time=True),
    ],
}


@pytest.mark.parametrize("laws", PROFILES.values(), ids=PROFILES)
def test_a_written_motion_is_the_motion_profile(laws: list) -> None:
    """The written motion agrees with the motion profile up to rounding if it is a formula.

    A table is exact at its times.  Between them its values are within `TABLE_TOLERANCE`; its rates
    and accelerations have two and four digits less, by the order of the interpolation.
    """
    x = np.linspace(0.0, 3.0, 41)
    names: dict = {"np": np}
    exec(motion_source(laws, x), names)
    t = np.linspace(0.0, 3.0, 1001)
    wanted = np.array([np.broadcast_arrays(*law(t)) for law in laws])
    for k, within in enumerate((10 * TABLE_TOLERANCE, 1e-8, 1e-5)):
        found = names["motion"](t)[k]
        assert found.shape == (len(laws), t.size)
        assert found == pytest.approx(wanted[:, k], abs=within)
    assert names["motion"](np.array([0.7]))[0].shape == (len(laws), 1)


def test_a_free_motion_has_no_motion_source() -> None:
    assert motion_source([], np.linspace(0.0, 1.0, 3)) == ""


def test_a_wrong_motion_profile_in_a_program_has_a_large_error() -> None:
    """In the wrong program the crank turns 0.1 % too fast, and starts with that rate.

    Its error against the prescribed motion is large; its error at the motion that its drive really
    had is small.
    """
    case, setting = load_short_case("fourbar", 41), Setting("mujoco", COARSE_PARAMETERS)
    text = program_text_here(case, setting, IMPOSED[0], "")
    good = run_program(case, setting, text, 30.0)
    assert 0 < good.errors["position"] < 1e-5
    assert good.driven["position"] == pytest.approx(good.errors["position"], rel=0.1)
    assert good.steps > 0
    assert good.seconds > 0
    wrong = text.replace("0.0 + 1.0 * t", "0.0 + 1.001 * t").replace(
        "data.qvel[:] = [", "data.qvel[:] = 1.001 * np.array([", 1
    )
    head, _, tail = wrong.partition("1.001 * np.array([")
    wrong = head + "1.001 * np.array([" + tail.replace("]", "])", 1)
    ran = run_program(case, setting, wrong, 30.0)
    assert ran.errors["position"] > 1e-3
    assert ran.driven["position"] < 1e-4  # the linkage follows its crank correctly


@pytest.mark.parametrize(
    ("broken", "said"), [("import csv", "nothing = 1 /"), ("def main", "def other")]
)
def test_a_program_that_fails_says_why(broken: str, said: str) -> None:
    case, setting = load_short_case("pendulum"), Setting("mujoco", {"timestep": 0.01})
    text = program_text_here(case, setting, IMPOSED[0], "").replace(broken, said, 1)
    ran = run_program(case, setting, text, 30.0)
    assert not ran.errors
    assert "Error" in ran.failure


def test_a_program_leaves_out_the_flag_energy(models: Path, edit) -> None:
    """With it MuJoCo's kinetic energy is an evaluation late; runs are made without it."""
    edit("pendulum.xml", "<flag ", '<flag energy="enable" ')
    case, setting = load_case(models / "pendulum.toml"), Setting("mujoco", COARSE_PARAMETERS)
    text = program_text_here(case, setting, IMPOSED[0], "")
    assert '<flag contact="disable"' in text
    assert "energy=" not in text


def test_a_program_shows_the_quantity_of_a_sensor_itself(models: Path, edit) -> None:
    """As runs do; see the attributes of MuJoCo's sensors."""
    instrument = 'nsample="9" delay="0.05" interval="0.02 0" cutoff="1"'
    edit("pendulum.xml", '<jointpos name="angle"', rf"\g<0> {instrument}")
    case, setting = load_case(models / "pendulum.toml"), Setting("mujoco", COARSE_PARAMETERS)
    text = program_text_here(case, setting, IMPOSED[0], "")
    assert '<jointpos name="angle"' in text
    for name in ("delay", "interval", "cutoff"):
        assert f"{name}=" not in text


def test_no_program_can_import_proofmass(tmp_path: Path) -> None:
    """Neither where `choose` runs it nor where these tests do, although it is installed."""
    text = "import mujoco, pymunk\nimport proofmass\n"
    with pytest.raises(NoCurves, match="import of proofmass halted"):
        run_bare_program(text, Run("dynamics", np.linspace(0, 1, 3), ()), 60.0)
    (tmp_path / "run.py").write_text(text)
    done = run_standalone(tmp_path / "run.py")
    assert done.returncode == 1
    assert "import of proofmass halted" in done.stderr


def test_a_program_that_does_not_end_is_ended() -> None:
    case, setting = load_short_case("pendulum"), Setting("mujoco", {"timestep": 0.01})
    text = program_text_here(case, setting, IMPOSED[0], "") + "\nwhile True:\n    pass\n"
    assert run_program(case, setting, text, 0.5) == ProgramRun(
        failure="no end after 0.5 s of processor time"
    )


def test_the_result_of_a_program_is_stored(tmp_path: Path) -> None:
    """A second run of the same setting reads the stored result, with the same processor time.

    Another setting has a result of its own.
    """
    case, store = load_short_case("pendulum"), Store(tmp_path)
    setting = Setting("mujoco", {"timestep": 0.01, "integrator": "RK4"})
    first = run_stored_program(case, setting, IMPOSED[0], store, 30.0)
    assert run_stored_program(case, setting, IMPOSED[0], store, 30.0) == first
    assert len(list(tmp_path.glob("*.program.json"))) == 1
    finer = run_stored_program(
        case, setting.with_parameters(timestep=0.005), IMPOSED[0], store, 30.0
    )
    assert finer.errors["position"] < first.errors["position"] / 8
    assert len(list(tmp_path.glob("*.program.json"))) == 2


def test_samples_at_other_times_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "curves.csv"
    file.write_text("t,angle\n0.0,1.0\n0.5,2.0\n1.1,3.0\n")
    run = Run("dynamics", np.array([0.0, 0.5, 1.0]), ("angle",))
    with pytest.raises(ValueError, match="other times"):
        read_curves(file, run)
    found = read_curves(file, replace(run, x=np.array([0.0, 0.5, 1.1])))
    assert found.channels["angle"].tolist() == [1.0, 2.0, 3.0]


def test_included_files_of_a_model_are_expanded(tmp_path: Path) -> None:
    """Nested includes are replaced by their content, and paths of meshes become absolute."""
    (tmp_path / "part.xml").write_text(
        '<mujocoinclude><include file="inner.xml"/><body name="a"><joint name="a"/>'
        '<geom type="mesh" mesh="m" mass="1"/></body></mujocoinclude>'
    )
    (tmp_path / "inner.xml").write_text('<mujocoinclude><site name="s"/></mujocoinclude>')
    whole = tmp_path / "whole.xml"
    whole.write_text(
        '<mujoco><compiler meshdir="shapes"/><asset><mesh name="m" file="m.stl"/>'
        '</asset><worldbody><include file="part.xml"/></worldbody><keyframe>'
        '<key name="start" qpos="0"/></keyframe></mujoco>'
    )
    root = expand_model(whole)
    assert root.find(".//include") is None
    assert [child.tag for child in root.find("worldbody") or []] == ["site", "body"]
    mesh = root.find(".//mesh")
    assert mesh is not None
    assert mesh.get("file") == str((tmp_path / "shapes" / "m.stl").resolve())
    assert root.find("keyframe") is None


def test_an_unknown_kind_of_drive_is_refused() -> None:
    case = load_short_case("fourbar")
    _, run = Setting("mujoco", COARSE_PARAMETERS).apply_to(case, "dynamics")
    with pytest.raises(ValueError, match="known: flywheel, servo, equality"):
        MUJOCO.programs.write_program(
            case.model_path, run, "def motion(t): pass", "", Imposed("rope")
        )


PID_PLUGIN = (
    '<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp" value="4"/>'
    "</instance></plugin></extension>"
)
INTEGRATING_ACTUATOR = (
    '<general name="hand" joint="crank" dyntype="integrator" gainprm="5" biastype="none"/>'
)


@pytest.mark.parametrize(
    ("hand", "key", "refused"),
    [
        ('<position name="hand" joint="crank" kp="100"/>', "", True),
        ('<velocity name="hand" joint="crank" kv="100"/>', "", True),
        ('<plugin name="hand" joint="crank" plugin="mujoco.pid" instance="pid"/>', "", True),
        (INTEGRATING_ACTUATOR, ' act="3"', True),
        (INTEGRATING_ACTUATOR, "", False),
        ('<motor name="hand" joint="crank" damping="1"/>', ' ctrl="0 5"', False),
        ('<position name="hand" joint="rocker" kp="100"/>', "", False),
    ],
)
def test_a_servo_on_a_joint_with_another_actuator_is_refused(
    hand: str, key: str, refused: bool, edit
) -> None:
    """Another actuator on the joint acts against the servo.

    A position actuator of 100 N m/rad gives the rocker an error of 4e-4 of its range if a servo
    drives at 1 ms, and 1e-6 with a flywheel, an equality, or in the product's own run.
    """
    edit(
        "fourbar.xml",
        '<motor name="motor" joint="crank"/>',
        f'<motor name="motor" joint="crank"/>{hand}',
    )
    edit("fourbar.xml", '<key name="start"', f'<key name="start"{key}')
    model = edit(
        "fourbar.xml", "<worldbody>", (PID_PLUGIN if "pid" in hand else "") + "<worldbody>"
    )
    _, run = Setting("mujoco", COARSE_PARAMETERS).apply_to(load_short_case("fourbar"), "dynamics")
    call_engine("mujoco", model, run)
    for drive in (Imposed("flywheel"), Imposed("equality", 0.25)):
        assert "MODEL" in MUJOCO.programs.write_program(model, run, "", "", drive)
    if not refused:
        assert "MODEL" in MUJOCO.programs.write_program(model, run, "", "", Imposed("servo", 0.5))
        return
    said = "a servo on joint 'crank', which the model's actuator 'hand' pushes as well"
    with pytest.raises(Unsupported, match=said):
        MUJOCO.programs.write_program(model, run, "", "", Imposed("servo", 0.5))


@pytest.mark.parametrize(
    ("options", "kind", "said"),
    [
        (
            '<flag actuation="disable"/>',
            "servo",
            'servo, is off: the model has <flag actuation="dis',
        ),
        (
            '<flag equality="disable"/>',
            "equality",
            'equality, is off: the model has <flag equality="',
        ),
        ('<flag constraint="disable"/>', "equality", "has <flag constraint="),
        ("", "servo", "servo, is off: the model disables the actuators of group 0"),
    ],
)
def test_a_drive_that_the_model_disables_is_refused(
    options: str, kind: str, said: str, tmp_path
) -> None:
    model = tmp_path / "arm.xml"
    group = "" if options else 'actuatorgroupdisable="0"'
    model.write_text(f"""<mujoco><option {group}>{options}</option><worldbody><body>
      <joint name="arm"/><geom size=".1" pos="1 0 0"/></body></worldbody>
      <keyframe><key name="start"/></keyframe></mujoco>""")
    times = np.linspace(0.0, 1.0, 11)
    run = Run("dynamics", times, (), (Drive("arm", lambda x: (x, 1.0 + 0.0 * x, 0.0 * x)),))
    assert "MODEL" in MUJOCO.programs.write_program(model, run, "", "", Imposed("flywheel"))
    with pytest.raises(Unsupported, match=said):
        MUJOCO.programs.write_program(model, run, "", "", Imposed(kind, 0.5))


def test_free_motions_have_one_program() -> None:
    assert drive_ways(load_case(shipped("pendulum.toml")), "mujoco") == IMPOSED[:1]
    assert drive_ways(load_case(shipped("fourbar.toml")), "mujoco") == IMPOSED


def test_a_program_is_written_in_a_worker() -> None:
    case, setting = load_short_case("pendulum"), Setting("mujoco", {"timestep": 0.01})
    assert program_text(case, setting, IMPOSED[0], "a head") == program_text_here(
        case, setting, IMPOSED[0], "a head"
    )


def test_the_program_of_a_released_fourbar_agrees_with_its_equation(tmp_path: Path) -> None:
    """The reference is one equation of motion of the crank's angle a, integrated here.

    It follows from the kinetic energy T = J(a) a'^2 / 2, with J from central differences of the
    closed pose, and needs no constraint solver.
    """
    case = load_short_case("fourbar_released", 21, 0.4)
    found = program_curves(
        program_text_here(
            case,
            Setting("mujoco", {**COARSE_PARAMETERS, "timestep": 1e-3, "solref": (8e-3, 1.0)}),
            IMPOSED[0],
            "",
        ),
        tmp_path,
    )
    truth = released_rocker_angles(found["t"], 0.0)
    assert np.ptp(truth) > 0.1
    assert found["rocker"] == pytest.approx(truth, abs=1e-5 * np.ptp(truth))


def released_rocker_angles(t: np.ndarray, start: float) -> np.ndarray:
    """Angles of the rocker of a released four-bar [rad], at times t [s], from a crank angle.

    The links of 1 m, 2 m, 2.5 m and the ground of 3 m are uniform bars of 1 kg/m.
    """

    def pose(a):
        crank = np.array([math.cos(a), math.sin(a)])
        d = crank - [3.0, 0.0]
        far = math.hypot(*d)
        along = (2.5**2 - 2.0**2 + far**2) / (2 * far)
        rocker = math.atan2(d[1], d[0]) % (2 * math.pi) - math.acos(along / 2.5)
        pin = np.array([3.0, 0.0]) + 2.5 * np.array([math.cos(rocker), math.sin(rocker)])
        coupler = math.atan2(*(pin - crank)[::-1])
        middle = (np.array([3.0, 0.0]) + pin) / 2
        return np.array([*(crank / 2), a, *((crank + pin) / 2), coupler, *middle, rocker])

    mass = np.array([1.0, 1.0, 1 / 12, 2.0, 2.0, 2 * 4 / 12, 2.5, 2.5, 2.5 * 6.25 / 12])
    weight = np.zeros(9)
    weight[[1, 4, 7]] = -9.81 * mass[[1, 4, 7]]

    def moves(a, h=1e-4):
        p = [pose(a + k * h) for k in (-2, -1, 1, 2)]
        first = (p[0] - 8 * p[1] + 8 * p[2] - p[3]) / (12 * h)
        second = (-p[0] + 16 * p[1] - 30 * pose(a) + 16 * p[2] - p[3]) / (12 * h**2)
        return first, second

    def rates(_, y):
        first, second = moves(y[0])
        force = weight @ first - (mass * first) @ second * y[1] ** 2
        return [y[1], force / ((mass * first) @ first)]

    cranks = solve_ivp(rates, (0.0, t[-1]), [start, 0.0], t_eval=t, rtol=1e-10, atol=1e-12).y[0]
    return np.array([pose(a)[8] for a in cranks])


ODD_MODEL = """
<mujoco model='an "odd" é'>
  <compiler meshdir="shapes"/>
  <option timestep="1.234e-3" integrator="RK4" gravity="0 -9.81 0">
    <flag contact="disable"GRAVITY/>
  </option>
  <default>
    <joint damping="0.3 0.1 0.2" armature="0.05" frictionloss="0.01"/>
    <position gear="3" ctrlrange="-1 1" dampratio="1"/>
    <equality active="false" solref="0.005 1" solimp="0.9999 0.9999 0.001"/>
    <default class="sprung"><joint stiffness="3 1" springref="20"/></default>
  </default>
  <asset><mesh file="m.stl"/></asset>
  <worldbody>
    <body name="crank">
      <joint name="cr'an&quot;k é"/>
      <inertial pos="0.5 0 0" mass="1" diaginertia="0.001 0.0833 0.0833"/>
      <body name="coupler" pos="1 0 0">
        <joint name="coupler" class="sprung" range="-160 160"/>
        <geom type="mesh" mesh="m" mass="2"/>
        <site name="coupler_end" pos="2 0 0"/>
      </body>
    </body>
    <include file="rocker.xml"/>
  </worldbody>
  <equality>
    <connect name="pin" active="true" site1="coupler_end" site2="rocker_end"/>
  </equality>
  <actuator>
    <motor name="motor" joint="cr'an&quot;k é"/>
    <motor name="load" joint="rocker" gear="2"/>
    <general name="slow" joint="rocker" dyntype="integrator" gainprm="1" biastype="none"/>
  </actuator>
  <sensor>
    <jointpos name='ro"ck\\, é' joint="rocker"/>
    <framelinacc name="acc" objtype="site" objname="rocker_end"/>
  </sensor>
  <keyframe>
    <key name="start" qpos="0 1.3502630658740633 2.2459278597319283" ctrl="0 4 0.5" act="3"/>
  </keyframe>
</mujoco>"""
ROCKER_FILE = """
<mujocoinclude>
  <body name="rocker" pos="3 0 0">
    <joint name="rocker"/>
    <inertial pos="1.25 0 0" mass="2.5" diaginertia="0.001 1.3 1.3"/>
    <site name="rocker_end" pos="2.5 0 0"/>
  </body>
</mujocoinclude>"""


def write_odd_model(folder: Path, gravity: str = "", rate: float = 1.0) -> tuple[Path, Run]:
    """Write a model with classes, a mesh, an include, and names to be quoted; its path and a run.

    Its loads have an activation.  The crank turns at `rate` [rad/s]; with 0 the motion is free.
    """
    (folder / "shapes").mkdir()
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
    faces = [
        np.append(np.zeros(3, "<f4"), corners[[*face]]).astype("<f4").tobytes() + b"\0\0"
        for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    ]
    (folder / "shapes" / "m.stl").write_bytes(bytes(80) + b"\4\0\0\0" + b"".join(faces))
    (folder / "rocker.xml").write_text(ROCKER_FILE)
    (folder / "odd.xml").write_text(ODD_MODEL.replace("GRAVITY", gravity), encoding="utf-8")
    drives = (Drive("cr'an\"k é", Steady(0.0, rate, x_is_time=True)),) if rate else ()
    return folder / "odd.xml", Run(
        "dynamics", np.linspace(0.0, 0.5, 21), ('ro"ck\\, é', "acc.y"), drives=drives
    )


@pytest.mark.parametrize(("gravity", "rate"), [("", 1.0), (' gravity="disable"', 1.0), ("", 0.0)])
def test_the_program_of_an_odd_model_gives_the_curves_of_the_engine(
    gravity: str, rate: float, tmp_path: Path
) -> None:
    """All curves are equal bit by bit, and the program needs none of the model's files."""
    model, run = write_odd_model(tmp_path, gravity, rate)
    motion = motion_source([each.profile for each in run.drives], run.x)
    text = MUJOCO.programs.write_program(model, run, motion, 'Of "odd" names\\', IMPOSED[0])
    wanted = call_engine("mujoco", model, run)
    for file in (model, tmp_path / "rocker.xml", tmp_path / "shapes" / "m.stl"):
        file.unlink()
    assert str(tmp_path) not in text
    found = program_curves(text, tmp_path)
    for name, curve in (wanted.channels | drive_curves(run, wanted)).items():
        assert found[name].tolist() == curve.tolist()
    assert list(read_curves(tmp_path / "curves.csv", run).channels) == list(run.channels)


@pytest.mark.parametrize("drive", [Imposed("servo", 0.5), Imposed("equality", 0.25)])
def test_default_classes_of_a_model_do_not_affect_its_drives(
    drive: Imposed, tmp_path: Path
) -> None:
    """The default classes have a gear and a range of actuators, and inactive equalities.

    Each of them would leave the crank 0.1 rad behind or more.
    """
    model, run = write_odd_model(tmp_path)
    motion = motion_source([each.profile for each in run.drives], run.x)
    found = program_curves(MUJOCO.programs.write_program(model, run, motion, "", drive), tmp_path)
    wanted = call_engine("mujoco", model, run).channels['ro"ck\\, é']
    assert np.ptp(wanted) > 0.1
    assert found['ro"ck\\, é'] == pytest.approx(wanted, abs=1e-3)


def test_long_lines_of_a_model_are_broken(tmp_path: Path) -> None:
    model, run = write_odd_model(tmp_path)
    text = MUJOCO.programs.write_program(model, replace(run, drives=()), "", "")
    assert max(map(len, text.splitlines())) <= 100


def test_large_files_of_a_model_are_named_by_their_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, run = write_odd_model(tmp_path, rate=0.0)
    monkeypatch.setattr("proofmass.sim.mujoco.program.MAX_EMBEDDED_BYTES", 100)
    text = MUJOCO.programs.write_program(model, run, "", "")
    assert str(tmp_path / "shapes" / "m.stl") in text
    assert program_curves(text, tmp_path)["t"].size == run.x.size


def test_a_shifted_start_of_a_motion_in_space_is_refused():
    case = load_case(shipped("tumbling_box.toml"))
    with pytest.raises(Unsupported, match="moves in space"):
        model_text_at(case, 0.1)
