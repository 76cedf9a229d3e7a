"""Programs of pymunk that run without proofmass, compared with `simulate` and with mathematics.

A program runs in an interpreter of its own (``python -I``), in an empty folder, so that it cannot
import this project.
"""

import ast
import csv
import re
from dataclasses import dataclass, replace
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from proofmass.base.arrays import Array
from proofmass.base.units import FORCE_UNITS
from proofmass.case.case import Case
from proofmass.case.drive import Swing, motion_source
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.samples import run_samples
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.curves import Curves, drive_columns
from proofmass.sim.protocol.failures import BadSetting, Diverged, Unsupported
from proofmass.sim.protocol.programs import Imposed
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import ENGINE as PYMUNK
from proofmass.sim.pymunk.engine import simulate
from proofmass.sim.pymunk.program import IMPOSED
from tests.programs import run_standalone
from tests.shipped import shipped, shipped_case, shipped_files
from tests.studies.trade.driven import drive_curves

PYMUNK_CASES = sorted(
    file.stem
    for file in shipped_files()
    if "pymunk" in getattr(shipped_case(file).run.get("dynamics"), "solvers", ())
)
QUICK_CASES = (
    "pendulum",
    "fourbar_released",
    "fourbar",
    "slider_crank",
    "threeprr",
    "hacksaw",
    "double_rocker",
    "inverted_slider_crank_held",
    "arm_servos",
)
ALLOWED_MODULES = {"csv", "math", "sys", "time", "numpy", "pymunk"}
SAMPLES = 21
NO_ROUNDING: dict[str, float] = {}
EXACT_SETTINGS = {
    "iterations": 1000,
    "error_bias": 0.0,
}  # for chains without loops: exact up to rounding


@dataclass(frozen=True)
class ProgramOutput:
    """A program's text, its samples and curves, and the number of steps that it printed."""

    text: str
    x: Array
    curves: dict[str, Array]
    steps: int


def run_in_new_folder(folder: Path, text: str) -> CompletedProcess[str]:
    """Run a program in a new folder."""
    folder.mkdir()
    (folder / "run.py").write_text(text, encoding="utf-8")
    return run_standalone(folder / "run.py")


def run_and_read(folder: Path, text: str) -> ProgramOutput:
    """Run a program in a new folder to its end, and read its curves."""
    done = run_in_new_folder(folder, text)
    assert (done.returncode, done.stderr) == (0, "")
    with (folder / "curves.csv").open(newline="", encoding="utf-8") as stream:
        head, *rows = csv.reader(stream)
    x, *columns = np.array(rows, float).T
    told = re.fullmatch(r"(\d+) steps in (\S+) s; curves in curves.csv\n", done.stdout)
    assert told is not None
    assert float(told[2]) > 0
    assert head[0] == "t"
    return ProgramOutput(text, x, dict(zip(head[1:], columns, strict=True)), int(told[1]))


def assert_alike(
    got: dict[str, Array],
    wanted: dict[str, Array],
    share: float,
    rounding: dict[str, float] = NO_ROUNDING,
) -> None:
    """Assert that curves have the same names in the same order, and nearly the same values.

    The largest difference that is allowed is `share` times the range, plus `rounding` of the
    channel [its unit], which does not depend on the range in these few samples.
    """
    assert list(got) == list(wanted)
    for name, curve in wanted.items():
        size = float(np.ptp(curve)) or float(np.abs(curve).max()) or 1.0
        atol = share * size + rounding.get(name, 0.0)
        np.testing.assert_allclose(got[name], curve, atol=atol, rtol=0, err_msg=name)


def rounding_by_channel(case: Case, run: Run, dt: float) -> dict[str, float]:
    """Differences of channels by rounding of points and of tables of motion profiles [their units].

    1e-14 m or rad is six roundings of a point 8 m away (2^-49 m).  A rate divides it by dt, an
    acceleration by dt^2.  A force multiplies the acceleration by all masses, a moment also by the
    square of the mechanism's size.
    """
    orders = {"rad": 0, "m": 0, "rad/s": 1, "m/s": 1, "rad/s^2": 2, "m/s^2": 2}
    model = compiled_model(case)
    mass = float(model.body_mass.sum())
    moved = {"N": mass, "N m": mass * float(model.stat.extent) ** 2}
    order = {
        name: orders[unit]
        for name in run.channels
        if (unit := case.channels[name].si_unit) in orders
    }
    for each in run.drives:
        order |= {name: k for k, name in enumerate(drive_columns(each.joint))}
    units = {name: case.channels[name].si_unit for name in run.channels}
    forces = {n: 1e-14 * moved[unit] / dt**2 for n, unit in units.items() if unit in moved}
    return {name: 1e-14 / dt**k for name, k in order.items()} | forces


def motion_source_of(run: Run) -> str:
    """Source code of the motion of a run's drives."""
    return motion_source([drive.profile for drive in run.drives], run.x)


def run_of(case: Case, samples: int = SAMPLES) -> Run:
    """A run of the first samples of a case's dynamics in pymunk."""
    drives = tuple(
        Drive(d.joint, law)
        for d, law in zip(case.drive, drive_profiles(case, "dynamics"), strict=True)
    )
    return Run(
        "dynamics",
        run_samples(case, "dynamics")[:samples],
        tuple(case.channels_of("dynamics")),
        drives,
        case.start,
        case.settings.get("pymunk", {}),
        case.rods,
    )


def run_program_and_engine(
    case: Case, run: Run, folder: Path, drive: Imposed = IMPOSED[0]
) -> tuple[ProgramOutput, Curves]:
    """The output of the program of a run, with the settings that the run used, and its curves."""
    wanted = simulate(case.model_path, run)
    run = replace(run, settings=wanted.settings)
    motion = motion_source_of(run)
    text = PYMUNK.programs.write_program(case.model_path, run, motion, case.title, drive)
    shown = {  # of forces and moments a program has those of drives, not those between bodies
        name: curve
        for name, curve in wanted.channels.items()
        if not (case.channels[name].si_unit in FORCE_UNITS and "." in name)
    }
    return run_and_read(folder / "bare", text), replace(
        wanted, channels=shown | drive_curves(run, wanted)
    )


@pytest.mark.parametrize(
    "name",
    [
        name if name in QUICK_CASES else pytest.param(name, marks=pytest.mark.slow)
        for name in PYMUNK_CASES
    ],
)
def test_a_program_gives_the_curves_of_simulate(name, tmp_path):
    case = load_case(shipped(f"{name}.toml"))
    run = run_of(case)
    got, wanted = run_program_and_engine(case, run, tmp_path)
    np.testing.assert_allclose(got.x, wanted.x, rtol=1e-15)  # rounding, since the samples are cut
    assert got.steps == wanted.steps
    # 1e-9: rounding of motion profiles, and the cosines of numpy and math
    dt = float(str(wanted.settings["timestep"]))
    assert_alike(got.curves, wanted.channels, 1e-9, rounding_by_channel(case, run, dt))


@pytest.mark.parametrize("name", ["fourbar", "inverted_slider_crank"])
def test_motors_give_the_curves_of_gears(name, tmp_path):
    case = load_case(shipped(f"{name}.toml"))
    run = run_of(case)
    got, wanted = run_program_and_engine(case, run, tmp_path, Imposed("motor"))
    assert "SimpleMotor" in got.text
    assert "GearJoint" not in got.text.partition("drives = [")[2]
    still = {
        n: c
        for n, c in wanted.channels.items()
        if n in case.channels and case.channels[n].unit in ("rad", "m")
    }
    # 1e-13 m of rounding in the ends of grooves, which are 100 extents away
    assert_alike({n: got.curves[n] for n in still}, still, 1e-11)
    # accelerations divide this rounding by dt^2 = 1e-6 s^2, and have ranges of 0.02; the rates of
    # drives are constant, so that their differences are rounding
    dt = float(str(wanted.settings["timestep"]))
    assert_alike(got.curves, wanted.channels, 1e-5, rounding_by_channel(case, run, dt))


def test_a_motor_does_not_drift(tmp_path):
    """The motor corrects its rate at every step: after 100 turns, with few iterations, no drift."""
    file = tmp_path / "wheel.xml"
    inertial = '<inertial pos="0.1 0 0" mass="1" diaginertia="1 1 1"/></body>'
    file.write_text(
        planar_mjcf(
            f'<body><joint axis="0 0 1"/>{inertial}'  # the wheel's axis is opposite
            f'<body name="wheel"><joint name="wheel" axis="0 0 -1"/>{inertial}',
            '<jointpos name="value" joint="wheel"/>'
            '<framexaxis name="way" objtype="xbody" objname="wheel"/>',
        )
    )
    run = Run(
        "dynamics",
        np.linspace(0, 10, 11),
        ("value", "way.angle"),
        (Drive("wheel", lambda t: (4 + 20 * np.pi * t, 20 * np.pi + 0 * t, 0 * t)),),
        settings={"timestep": 1e-3, "iterations": 10, "error_bias": 0.0},
    )
    motion = "def motion(t):\n    return 4 + 20 * np.pi * t[None], 0 * t[None], 0 * t[None]"
    text = PYMUNK.programs.write_program(file, run, motion, "", Imposed("motor"))
    got, truth = run_and_read(tmp_path / "bare", text).curves, 4 + 20 * np.pi * run.x
    # rounding is 1e-13 rad at 600 rad, and is corrected in the next step
    np.testing.assert_allclose(got["value"], truth, atol=1e-11, rtol=0)
    np.testing.assert_allclose(
        got["way.angle"], 2 * np.pi - truth, atol=1e-11, rtol=0
    )  # from (-pi, pi]
    # The mutation corrects the present angle, not that after the step: the step turns the wheel by
    # 0.06 rad before the motor acts.
    late, hits = re.subn(r" \+ TIMESTEP \* \(b\.angular_velocity - .*\)", "", text)
    assert hits == 1
    assert abs(run_and_read(tmp_path / "late", late).curves["value"] - truth).max() > 0.01


def planar_mjcf(
    bodies: str,
    sensors: str = "",
    more: str = "",
    qpos: str = "",
    qvel: str = "",
    ctrl: str = "",
    gravity: str = "0 -9.81 0",
) -> str:
    """Text of an MJCF without contacts, with its start pose in a key."""
    key = "".join(
        f' {name}="{text}"'
        for name, text in (("qpos", qpos), ("qvel", qvel), ("ctrl", ctrl))
        if text
    )
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="{gravity}">'
        f'<flag contact="disable"/></option><worldbody>{bodies}</worldbody>{more}'
        f'<sensor>{sensors}</sensor><keyframe><key name="start"{key}/></keyframe></mujoco>'
    )


# A model in the x-z plane with its normal along -y, about which two hinges turn backwards.  It has
# springs of all kinds, a damper, joint limits, constant loads on hinges and a slide, two loads on
# one site, an armature, a body on the ground, names that are no Python variables, and two names
# that the program itself uses.
RICH_MODEL = planar_mjcf(
    '<body name="time"><joint name="lift &#34;1&#34;" type="slide" axis="0.6 0 0.8" '
    ' stiffness="40 3 2" springref="0.1" limited="true" range="-0.2 0.21"/>'
    ' <inertial pos="0 0 0" mass="1.5" diaginertia=".1 .1 .1"/>'
    ' <body name="2nd arm"><joint name="arm" axis="0 -1 0" stiffness="5" springref="0.3" '
    '  damping="0.2"/><inertial pos="0.4 0.1 0" mass="1" diaginertia=".01 .05 .05"/>'
    '  <site name="tip" pos="0.8 0 0.1" euler="0.1 0.2 0.3"/></body>'
    ' <body><joint name="flap" axis="0 1 0" pos="0 0 0.1" stiffness="2 1 3" limited="true" '
    '  range="-0.5 0.4"/><inertial pos="-0.3 0 0.1" mass="0.7" diaginertia=".01 .03 .03"/></body>'
    "</body>"
    '<body name="ground"><joint name="wheel" axis="0 1 0" armature="0.02" '
    ' stiffness="0.4" springref="0.9"/>'
    ' <inertial pos="0.1 0 0" mass="1" diaginertia=".01 .01 .01"/>'
    ' <body name="rail"><joint name="rail" type="slide" axis="1 0 0.2" stiffness="30" '
    '  springref="-0.05" damping="0.5"/>'
    '  <inertial pos="0.2 0 0.3" mass="0.4" diaginertia=".01 .01 .01"/></body></body>'
    '<body name="post" pos="1 0 2"><inertial pos="0 0 1" mass="3" diaginertia="1 1 1"/></body>'
    '<site name="here"/>',
    '<jointpos name="arm" joint="arm"/><jointvel name="flap_rate" joint="flap"/>'
    '<user name="lift_acc" objtype="joint" objname="lift &#34;1&#34;" dim="1"/>'
    '<jointpos name="lift, &#34;m&#34;" joint="lift &#34;1&#34;"/>'
    '<jointvel name="rail_rate" joint="rail"/><jointpos name="rail" joint="rail"/>'
    '<framepos name="tip" objtype="site" objname="tip"/>'
    '<framelinvel name="tip_v" objtype="site" objname="tip"/>'
    '<framelinacc name="tip_a" objtype="site" objname="tip"/>'
    '<framexaxis name="pointer" objtype="site" objname="tip"/>'
    '<framexaxis name="way" objtype="xbody" objname="2nd arm"/>'
    '<frameangvel name="turning" objtype="xbody" objname="2nd arm"/>'
    '<frameangacc name="spin" objtype="xbody" objname="2nd arm"/>'
    '<e_potential name="potential"/><e_kinetic name="kinetic"/>'
    '<actuatorfrc name="push" actuator="push"/><jointactuatorfrc name="moment" joint="arm"/>',
    '<actuator><motor name="push" joint="lift &#34;1&#34;"/><motor name="twist" joint="arm"/>'
    '<motor name="turn" joint="flap"/>'
    ' <general name="pull" site="tip" refsite="here" gear="1 0 -2 0 0.3 0"/>'
    ' <general name="pull 2" site="tip" refsite="here" gear="0 0 1 0 0 0"/></actuator>',
    qpos="0.05 0.4 0.1 0.2 0.1",
    qvel="0.3 0 1 2 0",
    ctrl="-3 0.7 0.4 0.5 0.2",
    gravity="0.5 0 -9.81",
)
CHANNELS = (
    "arm",
    "flap_rate",
    "lift_acc",
    'lift, "m"',
    "rail_rate",
    "rail",
    "potential",
    "kinetic",
    "push",
    "moment",
    "way.angle",
    *(
        f"{name}.{part}"
        for part in "xyz"
        for name in ("tip", "tip_v", "tip_a", "pointer", "turning", "spin")
    ),
)
WHEEL_DRIVE = Drive("wheel", Swing(0.2, 1.0, 0.7))


@pytest.mark.parametrize("drives", [(), (WHEEL_DRIVE,)])
def test_a_program_has_springs_limits_loads_and_all_channels(drives, tmp_path):
    file, on_joint = tmp_path / "rich.xml", '<jointactuatorfrc name="moment" joint="arm"/>'
    assert on_joint in RICH_MODEL  # forces of loads on sites are included in this sensor
    file.write_text(RICH_MODEL.replace(on_joint, '<actuatorfrc name="moment" actuator="twist"/>'))
    run = Run(
        "dynamics",
        np.linspace(0, 0.5, 51),
        CHANNELS,
        drives,
        settings={"timestep": 2e-3, **EXACT_SETTINGS},
    )
    wanted = simulate(file, run)
    assert set(wanted.channels) == set(CHANNELS)
    text = PYMUNK.programs.write_program(file, run, motion_source_of(run), "")
    got = run_and_read(tmp_path / "bare", text)
    # The program's linear springs are Chipmunk's own.  Their ends are 100 extents away and have
    # 1e-14 m of rounding, which an acceleration divides by dt^2.
    assert_alike(got.curves, wanted.channels | drive_curves(run, wanted), 1e-7)
    # The mutation: joint limits are reached, so that without them the motion differs.
    free, hits = re.subn(r"space\.add\(pymunk\.(RotaryLimit|Slide)Joint\([^#]*?\)\)\n", "", text)
    assert hits == 2
    gone = run_and_read(tmp_path / "free", free).curves['lift, "m"']
    assert abs(gone - got.curves['lift, "m"']).max() > 0.01


ARM_DRIVE = Drive("arm", Swing(0.4, 0.3, 0.9))


def test_a_program_computes_the_moments_of_drives(tmp_path):
    """The program computes the moments of two drives.

    One hinge has a spring, a damper and a load on its body; the other one has only a spring.
    """
    file = tmp_path / "rich.xml"
    sensor = '<jointactuatorfrc name="wheel" joint="wheel"/><jointactuatorfrc name="moment"'
    file.write_text(
        RICH_MODEL.replace('limited="true"', 'limited="false"').replace(
            '<jointactuatorfrc name="moment"', sensor
        )
    )
    run = Run(
        "dynamics",
        np.linspace(0, 0.5, 51),
        ("arm", "moment", "wheel"),
        (ARM_DRIVE, WHEEL_DRIVE),
        settings={"timestep": 2e-3, **EXACT_SETTINGS},
    )
    wanted = simulate(file, run)
    text = PYMUNK.programs.write_program(file, run, motion_source_of(run), "")
    got = run_and_read(tmp_path / "bare", text).curves
    assert_alike(
        got, wanted.channels | drive_curves(run, wanted), 1e-7
    )  # tolerance as in the test above
    # The mutations: without a load, a spring, a damper, or the inertia, a moment differs.
    for k, (pattern, instead, name) in enumerate(
        [
            (r"\[\.\.\., bodies\.index\(body\), :2\] \+= force", "[..., 0, 0] += 0.0", "moment"),
            (r" - damping \* along", " - 0.0 * along", "moment"),
            (r"load \+ spring_force", "load + 0.0 * spring_force", "wheel"),
            (r"needed = mass \* acceleration", "needed = 0 * acceleration", "wheel"),
            (r"dx \* force\[1\] - dy", "dx * force[1] + dy", "moment"),
        ]
    ):
        wrong, hits = re.subn(pattern, instead, text)
        assert hits == 1
        off = run_and_read(tmp_path / f"wrong {k}", wrong).curves[name] - got[name]
        assert abs(off).max() > 1e-3 * np.ptp(got[name]), pattern
    limited = tmp_path / "limited.xml"
    limited.write_text(RICH_MODEL)
    text = PYMUNK.programs.write_program(
        limited, replace(run, channels=("moment", "arm")), motion_source_of(run), ""
    )
    assert '"moment":' not in text  # a joint limit may act, whose force the program does not know


def test_a_pendulum_falls_as_its_elliptic_function(tmp_path):
    """The reference is theta = -2 asin(k sn(K + w t, k)); the error is of second order.

    It is the angle of a point mass that is released from the horizontal.
    """
    run, errors = Run("dynamics", np.linspace(0, 10, 101), ("angle",)), []
    k, w = np.sin(np.pi / 4), np.sqrt(9.81)
    truth = -2 * np.arcsin(k * ellipj(ellipk(k**2) + w * run.x, k**2)[0])
    for dt in (2e-3, 1e-3):
        text = PYMUNK.programs.write_program(
            shipped("pendulum.xml"),
            replace(run, settings={"timestep": dt, "iterations": 10, "error_bias": 0.0}),
            "",
            "",
        )
        errors.append(abs(run_and_read(tmp_path / f"{dt}", text).curves["angle"] - truth).max())
    # The period is off by (w dt)^2 / 24, a phase of 1e-5 rad after 10 s; a wide swing has more.
    assert errors[1] < 1e-4
    # Terms of third order take away 10 % at 4 ms, 5 % at 2 ms, 2.5 % at 1 ms.
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.08)


ARM, BLOCK = 0.8, 1.5  # kg
LOADED_MODEL = planar_mjcf(
    f'<body><joint name="arm" axis="0 -1 0" stiffness="6 2 3" springref="0.3"/><inertial '
    f' pos="0.4 0 0.1" mass="{ARM}" diaginertia=".01 .05 .05"/>'
    '<site name="tip" pos="1 0 0"/></body>'
    f'<body><joint name="block" type="slide" axis="0.6 0 -0.8" stiffness="20" springref="-0.1"/>'
    f' <inertial pos="3 0 0" mass="{BLOCK}" diaginertia=".01 .01 .01"/></body><site name="here"/>',
    '<jointpos name="arm" joint="arm"/><jointpos name="block" joint="block"/>',
    '<actuator><motor name="push" joint="block"/><motor name="twist" joint="arm"/>'
    '<general name="pull" site="tip" refsite="here" gear="1 0 -2 0 0.3 0"/></actuator>',
    qpos="0.2 0.1",
    qvel="0.5 -0.3",
    ctrl="4 0.7 0.9",
    gravity="1 0 -9.81",
)


def rates_of_arm_and_block(_, state):
    """Rates of the state of arm and block, computed in three dimensions.

    The state is the arm's angle, the block's displacement, and their rates.
    """
    angle, way, angle_rate, way_rate = state
    gravity, normal, along = np.array([1, 0, -9.81]), np.array([0, -1, 0]), np.array([0.6, 0, -0.8])
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )  # about -y
    centre, tip = turn @ [0.4, 0, 0.1], turn @ [1, 0, 0]
    wound, stretched = angle - 0.3, way + 0.1
    moment = normal @ (
        np.cross(centre, ARM * gravity)
        + np.cross(tip, 0.9 * np.array([1, 0, -2]))
        + 0.9 * np.array([0, 0.3, 0])
    )
    moment += 0.7 - wound * (6 + 2 * wound + 3 * wound**2)
    force = BLOCK * gravity @ along - 20 * stretched + 4
    return angle_rate, way_rate, moment / (0.05 + ARM * centre @ centre), force / BLOCK


def test_springs_and_loads_are_those_of_an_independent_integration(tmp_path):
    """The error against an integration by DOP853 is of second order."""
    file = tmp_path / "loaded.xml"
    file.write_text(LOADED_MODEL)
    run, errors = Run("dynamics", np.linspace(0, 2, 41), ("arm", "block")), []
    truth = solve_ivp(
        rates_of_arm_and_block,
        (0, 2),
        [0.2, 0.1, 0.5, -0.3],
        "DOP853",
        run.x,
        rtol=1e-12,
        atol=1e-12,
    ).y[:2]
    for dt in (4e-3, 2e-3):
        text = PYMUNK.programs.write_program(
            file, replace(run, settings={"timestep": dt, **EXACT_SETTINGS}), "", ""
        )
        curves = run_and_read(tmp_path / f"{dt}", text).curves
        errors.append(abs(np.array([curves["arm"], curves["block"]]) - truth).max(axis=1))
    assert (errors[1] < 1e-4).all()  # (w dt)^2 / 24 of a phase of 10 rad, w about 5 rad/s
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.15)  # terms of third order


def test_a_start_from_the_plain_pose_is_a_hundred_times_worse(tmp_path):
    """The error of the released four-bar is 1.1e-6 of the range with the program's own start.

    With a start from the plain pose and zero rates it is 4.3e-4.  Both are errors against the
    equations of motion in the first second, at 0.2 ms.  The error of a start without the step
    before it is of first order, that of the program of second order: their ratio is 74 at 1 ms, 375
    at 0.2 ms, 750 at 0.1 ms.
    """
    case = load_case(shipped("fourbar_released.toml"))
    run = replace(
        run_of(case, 101), settings={"timestep": 2e-4, "iterations": 100, "error_bias": 0.0}
    )
    truth = evaluate(case, "dynamics", run.x, None).channels
    text = PYMUNK.programs.write_program(case.model_path, run, "", "")
    place = "for body, ((x, y, angle)"
    plain = "START = [((*body.position, 0.0), (0.0, 0.0, 0.0)) for body in bodies[:-1]]\n"
    assert text.count(place) == 1
    errors = []
    for k, program in enumerate((text, text.replace(place, plain + place))):
        got = run_and_read(tmp_path / str(k), program).curves
        errors.append(
            max(
                abs(got[n] - truth[n]).max() / np.ptp(truth[n])
                for n in got
                if case.channels[n].unit in ("rad", "m")
            )
        )
    assert errors[0] < 3e-6  # second order: 2.9e-5 at 1 ms
    assert errors[1] > 100 * errors[0]


def test_a_failed_program_prints_the_message_of_simulate(tmp_path):
    """The case is a five-bar near a singular pose, with too few iterations."""
    case = load_case(shipped("fivebar.toml"))
    run = replace(run_of(case), settings={"timestep": 2e-3, "iterations": 50, "error_bias": 0.0})
    with pytest.raises(Diverged) as failed:
        simulate(case.model_path, run)
    done = run_in_new_folder(
        tmp_path / "bare",
        PYMUNK.programs.write_program(case.model_path, run, motion_source_of(run), ""),
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", f"{failed.value}\n")
    assert not (tmp_path / "bare" / "curves.csv").exists()


def test_a_value_that_is_not_finite_is_an_error(tmp_path):
    case = load_case(shipped("pendulum.toml"))
    run = replace(run_of(case, 3), settings={"timestep": 2e-3, **EXACT_SETTINGS})
    text = PYMUNK.programs.write_program(case.model_path, run, "", "")
    wrong, hits = re.subn(r"return 0\.5 \* \(early", "return np.nan * (early", text)
    assert hits == 1
    done = run_in_new_folder(tmp_path / "bare", wrong)
    assert (done.returncode, done.stderr) == (1, "rate is not finite at time 0 s\n")


UNUSUAL_HEADER = (
    'Line one, "quoted" and \\N{DASH} \\.\n\n"""import os"""\0\x1b é \u2028 ends in a quote"'
)


@pytest.mark.parametrize(
    ("head", "doc"), [("", None), (UNUSUAL_HEADER, UNUSUAL_HEADER), ("\\", "\\")]
)
def test_a_program_stands_alone_with_any_docstring(head, doc, tmp_path):
    case = load_case(shipped("slider_crank.toml"))
    run = replace(run_of(case, 3), settings={"timestep": 5e-3, **EXACT_SETTINGS})
    text = PYMUNK.programs.write_program(case.model_path, run, motion_source_of(run), head)
    tree = ast.parse(text)
    told = ast.get_docstring(tree, clean=False)
    assert (told and told.removesuffix("\n")) == doc
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert imported <= ALLOWED_MODULES
    for word in ("proofmass", "sim.", "analytic", "spring"):
        assert word not in text
    assert max(map(len, text.replace(UNUSUAL_HEADER, "").splitlines())) < 200
    run_and_read(tmp_path / "bare", text)


@pytest.mark.parametrize(
    ("change", "drive", "error", "named"),
    [
        ({"kind": "sweep"}, Imposed("gear"), Unsupported, "such as sweep"),
        ({"settings": {"timestep": 1e-3}}, Imposed("gear"), BadSetting, "iterations: missing"),
        ({}, Imposed("motor"), Unsupported, "a motor on slide joint 'slider_1'"),
        ({}, Imposed("belt"), ValueError, "'belt'; known: gear, motor"),
    ],
)
def test_a_program_that_cannot_be_written_is_refused(change, drive, error, named):
    case = load_case(shipped("threeprr.toml"))
    run = replace(run_of(case), **{"settings": {"timestep": 1e-3, **EXACT_SETTINGS}, **change})
    with pytest.raises(error, match=named):
        PYMUNK.programs.write_program(case.model_path, run, "", "", drive)
