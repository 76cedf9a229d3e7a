"""Equilibria of driven linkages on springs, weights, loads and stops: planar solver and others."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar, spatial
from proofmass.analytic.equilibrium import EquilibriumSolver, Unstable
from proofmass.analytic.numerics import NotCovered
from proofmass.analytic.planar import LinkageAtRest, SingularHere
from proofmass.analytic.planar.kinematics import Drives
from proofmass.batch.check import check
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.mujoco.engine import simulate as in_mujoco
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run
from proofmass.sim.pymunk.engine import simulate as in_pymunk
from tests.shipped import shipped, shipped_files

LIMBS_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0">
  <flag contact="disable" energy="enable"/></option><worldbody><site name="ground"/>
  <body name="bar"><joint name="bar"/><inertial pos=".5 0 0" mass="2" diaginertia=".1 .1 .2"/>
    <body name="two" pos="1 0 0"><joint name="two" stiffness="30" damping=".1" {two}/>
      <inertial pos=".2 0 0" mass="1" diaginertia=".1 .1 .2"/>
      <body name="three" pos=".4 0 0"><joint name="three" stiffness="10" springref=".3" {three}/>
        <inertial pos=".1 .1 0" mass=".5" diaginertia=".01 .01 .01"/>
        <site name="end" pos=".2 .1 0"/></body></body></body></worldbody>
  <actuator><motor name="drive" joint="bar"/>
    <motor name="pull" site="end" refsite="ground" gear="3 2 0 0 0 0"/></actuator>
  <sensor><actuatorfrc name="moment" actuator="drive"/><e_potential name="level"/>
    <jointpos name="two" joint="two"/><jointpos name="three" joint="three"/>
    <jointvel name="two_rate" joint="two"/><jointvel name="three_rate" joint="three"/>
    <framepos name="end" objtype="site" objname="end"/>
    <framelinvel name="velocity" objtype="site" objname="end"/>
    <framelinacc name="acceleration" objtype="site" objname="end"/></sensor>
  <keyframe><key name="start" qpos=".3 0 0" ctrl="0 {pull}"/></keyframe></mujoco>"""
ANGLES = np.linspace(0.3, 4.0, 38)


def write_limbs(folder: Path, two: str = "", three: str = "", pull: float = 1.0) -> Path:
    """Write a driven bar with two links on springs."""
    file = folder / f"limbs{len(list(folder.iterdir()))}.xml"
    file.write_text(LIMBS_MODEL.format(two=two, three=three, pull=pull))
    return file


def sweep_equilibria(
    file: Path, angles: np.ndarray = ANGLES, **arguments: object
) -> dict[str, np.ndarray]:
    """The planar reference of a sweep of the bar."""
    model = mujoco.MjModel.from_xml_path(str(file))
    return planar.solve(angles, model=model, joints=("bar",), **arguments)


def bar_profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The motion profile of the drive: its value is the time."""
    return t, np.ones_like(t), np.zeros_like(t)


CASES_ON_STOPS = (
    "balancer_sine_preload",
    "balancer_sine_free_preload",
    "balancer_progressive_contact",
    "balancer_progressive_locked",
)
DEFAULT_CASES = (
    "balancer4_sine",
    "balancer_weight",
    "balancer_extending",
    "balancer_sine_nonlinear",
    *CASES_ON_STOPS,
)
WITH_FRICTION = ("balancer_prototype",)


def balancer_parameters() -> list:
    """All cases of `models/balancers` that the planar reference covers; most of them are slow."""
    names = [file.stem for file in shipped_files("balancer*.toml")]
    return [
        pytest.param(name, marks=() if name in DEFAULT_CASES else pytest.mark.slow)
        for name in names
        if name not in WITH_FRICTION and "prescribed" not in name
    ]


@pytest.mark.parametrize("name", balancer_parameters())
def test_balancers_agree_with_their_own_reference(name):
    """The balancers' own reference solves chains with preloads and stops by another method.

    Rates have the rounding of differences of forces, 1e-12 of the stiffness.
    """
    case = load_case(shipped(f"{name}.toml"))
    run = plan_run(case, "sweep", "mujoco")
    state, model = run.motion(run.x), compiled_model(case)
    wanted = evaluate(case, "sweep", run.x, state).channels
    joints = tuple(drive.joint for drive in case.drive)
    args = (part[0] if len(part) == 1 else part for part in state)
    found = planar.solve(*args, model=model, start=case.start, joints=joints)
    shared = wanted.keys() & found.keys()
    assert len(shared) > 5
    for one in shared:
        error = 1e-11 if one.endswith("_rate") or "velocity" in one else 1e-12
        assert np.abs(found[one] - wanted[one]).max() < error * max(1.0, np.ptp(wanted[one])), one
    if name in CASES_ON_STOPS:
        stopped = [
            np.isclose(found[f"deflection{k}"], end, rtol=0, atol=1e-12).any()
            for k in (1, 2, 3)
            for joint in [model.joint(f"joint{k}")]
            for end in joint.range
            if model.jnt_limited[joint.id]
        ]
        assert any(stopped)


def test_the_moment_of_the_drive_is_the_slope_of_the_energy(tmp_path):
    """The energy is that of springs and weights, less the work of the load."""
    file, step = write_limbs(tmp_path, pull=2.0), 1e-4

    def energy(angles: np.ndarray) -> np.ndarray:
        found = sweep_equilibria(file, angles)
        return found["level"] - 6 * found["end.x"] - 4 * found["end.y"]

    found = sweep_equilibria(file)
    slope = [energy(np.array([a - step, a, a + step])) for a in ANGLES[::6]]
    slope = [(after - before) / (2 * step) for before, _, after in slope]
    assert np.abs(found["moment"][::6] - slope).max() < 1e-6
    assert np.ptp(found["two"]) > 0.25


def test_rates_are_slopes_of_the_path(tmp_path):
    found, step = sweep_equilibria(write_limbs(tmp_path)), 1e-4
    near = sweep_equilibria(write_limbs(tmp_path), np.array([1.0 - step, 1.0, 1.0 + step]))
    for name, rate in (("two", "two_rate"), ("end.x", "velocity.x"), ("end.y", "velocity.y")):
        slope = (near[name][2] - near[name][0]) / (2 * step)
        assert near[rate][1] == pytest.approx(slope, abs=1e-7)
    assert np.isnan(found["acceleration.x"]).all()
    assert all(np.isfinite(found[name]).all() for name in found if "acceleration" not in name)


@pytest.mark.parametrize("stops", [False, True])
def test_equilibria_are_those_of_both_engines(tmp_path, stops):
    """Joints reach their stops and leave them; pymunk has no rates of joints on springs."""
    ranges = ('limited="true" range="-1 .1"', 'limited="true" range="-.2 .3"') if stops else ()
    file = write_limbs(tmp_path, *ranges)
    angles = ANGLES[::2]
    known, names = sweep_equilibria(file, angles), ("moment", "two", "three", "end.x", "end.y")
    on = [np.isclose(known[name], end).sum() for name, end in (("two", 0.1), ("three", 0.3))]
    assert [0 < count < angles.size for count in on] == [stops, stops]
    run = Run("sweep", angles, (*names, "two_rate", "velocity.x"), (Drive("bar", bar_profile),))
    for engine, error in ((in_mujoco, 1e-11), (in_pymunk, 1e-8)):
        found = engine(file, run).channels
        assert set(names) <= found.keys()
        for name in found:
            assert np.abs(found[name] - known[name]).max() < error * max(1.0, np.ptp(known[name]))


@pytest.mark.parametrize("beyond", [-5e-5, 5e-5, 0.02])
@pytest.mark.parametrize("solve", [planar.solve, spatial.solve], ids=["planar", "spatial"])
def test_rates_near_a_slack_spring_are_those_of_their_side(solve, beyond):
    """A slide has springs of 300 N/m to its drive, 100 to a wall, and 200 more beyond 0.1 m."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option gravity="0 0 0">
      <flag contact="disable"/></option><worldbody>
      <body><joint name="d" type="slide" axis="1 0 0"/><geom size="0.1"/></body>
      <body pos="0 0 1"><joint name="x" type="slide" axis="1 0 0" stiffness="100"/>
        <geom size="0.1"/></body></worldbody>
      <tendon><fixed name="link" stiffness="300" springlength="0"><joint joint="d" coef="-1"/>
        <joint joint="x" coef="1"/></fixed>
        <fixed name="late" stiffness="200" springlength="-9 0.1"><joint joint="x" coef="1"/></fixed>
      </tendon><sensor><jointpos name="x" joint="x"/><jointvel name="rate" joint="x"/></sensor>
      <keyframe><key name="start"/></keyframe></mujoco>""")
    x = 0.1 + beyond
    drive = (400.0 * x + 200.0 * max(beyond, 0.0)) / 300.0
    found = solve(np.array([0.0, 0.9 * drive, drive]), model=model, joints=("d",))
    assert found["x"][-1] == pytest.approx(x, abs=1e-12)
    # the force is linear on both sides: rounding of a difference over 6e-6 of the size
    assert found["rate"][-1] == pytest.approx(0.75 if beyond < 0.0 else 0.5, abs=1e-8)


def test_equilibria_under_a_changing_load_are_those_of_mujoco(tmp_path):
    """Values and rates agree with MuJoCo; the last value is that of a model with that load."""
    file = write_limbs(tmp_path, pull=0.0)

    def profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return 2 * t**2, 4 * t, np.full_like(t, 4.0)

    size, rate, _ = profile(ANGLES)
    known = sweep_equilibria(file, controls={"pull": size}, control_rates={"pull": rate})
    alone = sweep_equilibria(write_limbs(tmp_path, pull=float(size[-1])), np.linspace(0.3, 4.0, 5))
    assert known["end.x"][-1] == pytest.approx(alone["end.x"][-1], abs=1e-12)
    names = ("two", "two_rate", "velocity.x", "velocity.y", "moment")
    load = (ChangingLoad("pull", profile),)
    run = Run("sweep", ANGLES, names, (Drive("bar", bar_profile),), loads=load)
    found = in_mujoco(file, run).channels
    assert np.abs(known["two_rate"] - sweep_equilibria(file)["two_rate"]).max() > 0.1
    for name in names:
        assert np.abs(found[name] - known[name]).max() < 1e-9


COLUMN_MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 0 0">
  <flag contact="disable"/></option><worldbody><site name="ground"/>
  <body name="arm" pos="1 0 0"><joint name="arm"/><geom size=".1"/></body>
  <body name="column"><joint name="column" stiffness="5" springref="{}" {}/>
    <inertial pos="0 .5 0" mass="1" diaginertia=".1 .1 .1"/><site name="top" pos="0 2 0"/></body>
  </worldbody><actuator><motor name="push" site="top" refsite="ground" gear="0 -1 0 0 0 0"/>
  </actuator><sensor><jointpos name="column" joint="column"/></sensor>
  <keyframe><key name="start" ctrl="0" qpos="0 {}"/></keyframe></mujoco>"""


def column_rotation(
    push: np.ndarray, ref: float = 0.0, more: str = "", start: float = 0.0
) -> np.ndarray:
    """Rotation of a rigid column on a torsion spring with a load at its top, at 2 m."""
    model = mujoco.MjModel.from_xml_string(COLUMN_MODEL.format(ref, more, start))
    turned = np.linspace(0.0, 1.0, push.size)
    return planar.solve(turned, model=model, joints=("arm",), controls={"push": push})["column"]


def test_a_column_buckles_at_its_critical_load():
    """The critical load is stiffness over length, 2.5 N; the message names where the path ends."""
    assert np.abs(column_rotation(np.linspace(0.0, 2.499, 6))).max() == 0.0
    with pytest.raises(Unstable, match=r"unstable with the drives at 0\.83333\d, between"):
        column_rotation(np.array([0.0, 1.0, 2.0, 3.0]))  # 2.5 N are at 2.5 / 3


def test_a_column_that_leans_follows_its_closed_form():
    """5 (turn - 0.1) = 2 P sin(turn), also above the critical load of a straight column."""
    push = np.linspace(0.0, 6.0, 31)
    turn = column_rotation(push, 0.1)
    assert turn[-1] > 1.5
    assert np.abs(5 * (turn - 0.1) - 2 * push * np.sin(turn)).max() < 1e-12


def test_a_start_pose_leads_to_the_equilibrium_on_its_side():
    push = np.full(3, 4.0)
    assert (column_rotation(push, start=0.2) > 1.0).all()
    assert column_rotation(push, start=-0.2) == pytest.approx(
        -column_rotation(push, start=0.2), abs=1e-12
    )
    with pytest.raises(Unstable, match="the start pose leads to no stable equilibrium"):
        column_rotation(push)


def test_dependent_stops_are_refused(tmp_path):
    """The stops are both ends of one range, at which no pose is at once."""
    model = mujoco.MjModel.from_xml_path(str(write_limbs(tmp_path, 'limited="true" range="-1 .1"')))
    mechanism, _ = planar.read(model, "start")
    statics = LinkageAtRest(mechanism, Drives.of(mechanism, ("bar",)))
    resting, values = EquilibriumSolver(statics), np.array([[0.3]])
    q = statics.begin(values[0])[None]
    resting.count(q)
    found = resting.equations(q, values, None, statics.stops)
    assert len(statics.stops) == 2
    with pytest.raises(SingularHere, match="a stop or a drive constrains what others"):
        found.solve_linear(-found.left, -found.gap)
    assert resting.next(q, (values, None), (values, None), statics.stops) is None


def test_sweeps_that_are_not_covered_are_refused(tmp_path):
    with pytest.raises(NotCovered, match="frictionloss of joint 'two' in a sweep with"):
        sweep_equilibria(write_limbs(tmp_path, 'frictionloss=".1"'))
    with pytest.raises(NotCovered, match="a path of equilibria has no inertia"):
        sweep_equilibria(write_limbs(tmp_path), inertia=True)
    free = COLUMN_MODEL.format(0.0, "", 0.0).replace('stiffness="5"', "")
    with pytest.raises(Unstable, match="the start pose leads to no stable equilibrium"):
        planar.solve([0.0, 0.1], model=mujoco.MjModel.from_xml_string(free), joints=("arm",))


LIMBS_SIDECAR = """title = "Limbs"
source = "of the tests"
reference = "planar"
drive = { joint = "bar", from = 0.3, to = 4.0, rate = 1.0 }
run.sweep = { n = 38 }
[channels]
moment = { unit = "N m" }
"acceleration.x" = { unit = "m/s^2" }
two = { unit = "rad" }
two_rate = { unit = "rad/s" }
"""


def test_a_sidecar_needs_only_the_drive(tmp_path):
    write_limbs(tmp_path).rename(tmp_path / "limbs.xml")
    (tmp_path / "limbs.toml").write_text(LIMBS_SIDECAR)
    case = load_case(tmp_path / "limbs.toml")
    shares = {
        name: case.tolerance_for("sweep", "mujoco", name).relative_to_range
        for name in ("two", "two_rate")
    }
    assert shares == {"two": 1e-12, "two_rate": 1e-10}  # rates contain differences of forces
    found = check([tmp_path], jobs=1, detectable=False)
    outcomes = {(c.solver, c.channel): c.outcome for c in found.comparisons}
    assert outcomes["mujoco", "two_rate"] == "agrees"
    for solver in ("mujoco", "pymunk"):
        assert outcomes[solver, "moment"] == outcomes[solver, "two"] == "agrees"
        assert outcomes[solver, "acceleration.x"] == "unsupported"


def write_finger(folder: Path, distal: str = "0 1.6") -> Path:
    """Write the finger with a stop of its proximal phalanx."""
    text = shipped("finger.xml").read_text(encoding="utf-8")
    for old, new in (
        ('<joint name="proximal"/>', '<joint name="proximal" range="-0.1 0.7"/>'),
        ('name="distal" range="0 1.6"', f'name="distal" range="{distal}"'),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    file = folder / "finger.xml"
    file.write_text(text, encoding="utf-8")
    return file


def driver_profile(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The motion profile of the driver: to 1.2 rad and back."""
    return 0.6 - 0.6 * np.cos(t), 0.6 * np.sin(t), 0.6 * np.cos(t)


def test_a_joint_that_reaches_its_stop_frees_another(tmp_path):
    """At every sample exactly one of the two joints is on its stop.

    Both can be on their stops at one driver angle only.
    """
    file, t = write_finger(tmp_path), np.linspace(0.0, 2 * np.pi, 21)
    model = mujoco.MjModel.from_xml_path(str(file))
    known = planar.solve(*driver_profile(t), model=model, joints=("driver",))
    on = known["proximal"] > 0.7 - 1e-12, known["distal"] < 1e-12
    assert [one.any() for one in on] == [True, True]
    assert (on[0] ^ on[1]).all()
    names = ("proximal", "distal", "tip.x", "tip.y", "moment")
    for engine, error in ((in_mujoco, 1e-11), (in_pymunk, 1e-9)):
        found = engine(file, Run("sweep", t, names, (Drive("driver", driver_profile),)))
        assert not found.stopped
        for name in names:
            assert np.abs(found.channels[name] - known[name]).max() < error


def test_a_limit_position_is_distinguished_from_an_instability(tmp_path):
    """The path in MuJoCo ends at the same driver angle."""
    file, angles = write_finger(tmp_path, "0 16"), np.linspace(0.0, 1.6, 9)
    model = mujoco.MjModel.from_xml_path(str(file))
    with pytest.raises(SingularHere, match="a limit position lies on the way: with the") as told:
        planar.solve(angles, model=model, joints=("driver",))
    run = Run("sweep", angles, ("distal",), (Drive("driver", bar_profile),))
    ended = in_mujoco(file, run).stopped
    assert ended.startswith("the loops cannot be closed beyond driver = 1.215")
    place = re.search(r"drives at ([\d.]+)", str(told.value))
    assert float(place[1]) == pytest.approx(float(ended.split()[-1]), abs=1e-5)


def random_chain(seed: int) -> str:
    """MJCF of a driven bar and links on springs, some with ranges, a slack spring and a load."""
    random = np.random.default_rng(seed)
    bodies, place, count = "", 0.0, int(random.integers(2, 5))
    for k in range(count):
        length, (low, high) = random.uniform(0.3, 1), random.uniform(0.05, 0.6, 2)
        stiff, rest = random.uniform(2, 60), random.uniform(-0.5, 0.5)
        spring = f'stiffness="{stiff}" springref="{rest}"' if k else ""
        if k and random.random() < 0.5:
            spring += f' range="{-low} {high}" limited="true"'
        if k and random.random() < 0.2:
            spring += ' type="slide" axis="1 .3 0"'
        bodies += (
            f'<body pos="{place} 0 0"><joint name="j{k}" {spring}/><inertial pos="{length / 2} '
            f'{random.uniform(-0.1, 0.1)} 0" mass="{random.uniform(0.2, 2)}" '
            f'diaginertia=".01 .01 .01"/><site name="s{k}" pos="{length} 0 0"/>'
        )
        place = length
    slack = sorted(random.uniform(0.1, 1, 2))
    cord = f'stiffness="{random.uniform(1, 30)}" springlength="{slack[0]} {slack[1]}"'
    frame = 'refsite="wall"' if random.random() < 0.5 else ""
    gear = " ".join(map(str, random.uniform(-3, 3, 2)))
    sensors = "".join(
        f'<jointpos name="j{k}" joint="j{k}"/><jointvel name="v{k}" joint="j{k}"/>'
        for k in range(1, count)
    )
    return f"""<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0">
      <flag contact="disable"/></option><worldbody><site name="wall" pos="1 1 0"/>{bodies}
      {"</body>" * count}</worldbody><tendon><spatial name="cord" {cord}><site site="wall"/>
      <site site="s{count - 1}"/></spatial></tendon><actuator><motor name="m" joint="j0"/>
      <motor name="l" site="s{count - 1}" {frame} gear="{gear} 0 0 0 0"/></actuator>
      <sensor><actuatorfrc name="m" actuator="m"/>{sensors}</sensor>
      <keyframe><key name="start" ctrl="0 1"/></keyframe></mujoco>"""


ORDINARY_SEEDS = (8, 11, 14, 15)
SLACK_SEEDS, SNAP_SEEDS = (166, 395), (108, 140)
"""Chains whose spring goes slack where the equilibrium moves fast; chains that snap in between."""


@pytest.mark.parametrize("seed", [*ORDINARY_SEEDS, *SLACK_SEEDS, *SNAP_SEEDS])
def test_random_chains_have_the_equilibria_of_mujoco(seed, tmp_path):
    """Chains have stops, slack springs and loads; both paths end at an unstable equilibrium."""
    file, x = tmp_path / "chain.xml", np.linspace(0.0, 3.0, 13)
    file.write_text(random_chain(seed))
    model = mujoco.MjModel.from_xml_path(str(file))
    names = tuple(model.sensor(s).name for s in range(model.nsensor))
    found = in_mujoco(file, Run("sweep", x, names, (Drive("j0", bar_profile),)))
    if seed in (14, *SNAP_SEEDS):
        with pytest.raises(Unstable) as told:
            planar.solve(x, model=model, joints=("j0",))
        (place,) = re.findall(r"drives at ([\d.]+)", str(told.value))
        assert found.stopped.startswith("the equilibrium becomes unstable beyond j0 = ")
        assert float(found.stopped.split()[-1]) == pytest.approx(float(place), abs=1e-4)
        return
    known = planar.solve(x, model=model, joints=("j0",))
    assert not found.stopped
    for name in names:
        off = np.abs(found.channels[name] - known[name]).max()
        assert off < 1e-8 * max(1.0, np.abs(known[name]).max()), name


PASSED_SNAP_SEEDS = (572, 590, 633)
"""Chains whose snap Newton's method passes from some samples, to another path of equilibria."""


@pytest.mark.parametrize("seed", PASSED_SNAP_SEEDS)
def test_a_snap_ends_a_path_for_any_samples(tmp_path, seed):
    """At the snap the joints fall short of the tangent, or move as slowly as before the fold."""
    file = tmp_path / "chain.xml"
    file.write_text(random_chain(seed))
    model, ends = mujoco.MjModel.from_xml_path(str(file)), list[float]()
    for n in (13, 241):
        x = np.linspace(0.0, 3.0, n)
        with pytest.raises(Unstable) as told:
            planar.solve(x, model=model, joints=("j0",))
        found = in_mujoco(file, Run("sweep", x, ("j1",), (Drive("j0", bar_profile),)))
        assert found.stopped.startswith("the equilibrium becomes unstable beyond j0 = ")
        ends += [float(found.stopped.split()[-1])]
        ends += [float(place) for place in re.findall(r"drives at ([\d.]+)", str(told.value))]
    assert ends == pytest.approx([ends[0]] * 4, abs=2e-5)
