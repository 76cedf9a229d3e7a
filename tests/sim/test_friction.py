"""Tests of dry friction in sweeps, in both engines: hysteresis loops, transitions, refusals."""

import re
from dataclasses import dataclass, replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar, spatial
from proofmass.analytic.balancer.friction import ChainWithFriction
from proofmass.analytic.balancer.model import OTHER_DEFAULTS, balancer
from proofmass.analytic.friction import follow_stick_slip
from proofmass.analytic.linkages import shaft_pendulum, slider_crank
from proofmass.base.errors import InputError
from proofmass.case.drive import Swing
from proofmass.design.template import write_case
from proofmass.reference.case_model import compiled_model
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run, solve_here
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.failures import BadModel, NotSolved, Unsupported
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.space import SlideFriction
from proofmass.verdict.compare import compare
from tests.analytic.balancer.balancer_table import parameters, rows
from tests.shipped import shipped, shipped_case, shipped_files

ENGINES = ("mujoco", "pymunk")
SHAFT_CASE = load_case(shipped("shaft_pendulum.toml"))
SLIDER_CRANK_CASE = load_case(shipped("slider_crank_friction.toml"))
SIDECARS_WITH_FRICTION = [
    f for f in shipped_files() if compiled_model(shipped_case(f)).dof_frictionloss.any()
]
SWEEPS_WITH_FRICTION = [f for f in SIDECARS_WITH_FRICTION if "sweep" in shipped_case(f).run]
MOTIONS_WITH_FRICTION = [f for f in SIDECARS_WITH_FRICTION if "dynamics" in shipped_case(f).run]
FRICTION_ATTRIBUTE = re.compile(r'frictionloss="([^"]+)"')


@dataclass(frozen=True)
class PiecewiseLinear:
    """A profile that is linear between its values at x = 0, 1, 2, ..."""

    values: tuple[float, ...]

    def __call__(self, x):
        rate = np.diff(self.values)[np.clip(np.ceil(x).astype(int) - 1, 0, len(self.values) - 2)]
        return np.interp(x, np.arange(len(self.values)), self.values), rate, 0.0 * x


def gauss_nodes(ends, nodes=24):
    """Nodes and weights of Gauss-Legendre quadrature on each interval between successive ends.

    The ends are nodes with weight zero.
    """
    places, shares = np.polynomial.legendre.leggauss(nodes)  # exact to rounding if it is smooth
    x, w = [np.array(ends[:1])], [np.zeros(1)]
    for first, last in pairwise(ends):
        half = 0.5 * (last - first)
        x += [first + half * (1 + places), [last]]
        w += [half * shares, [0.0]]
    return np.concatenate(x), np.concatenate(w)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_loop_area_of_the_shaft_equals_the_closed_form(engine):
    """The drive's work in a cycle is 2 friction (a - 2 p) + 2 bearing_friction a.

    a is the travel of the shaft and p the slip angle.  The quadrature goes from event to event, so
    that its error is rounding.
    """
    own = SHAFT_CASE.parameters
    p = shaft_pendulum.slip_angle(**{k: own[k] for k in ("length", "mass", "friction", "gravity")})
    travel = 2.0
    slip = [2 * p / travel, 1.0, 1.0 + 2 * p / travel, 2.0]
    x, weights = gauss_nodes([0.0, 1.0, 2.0, *np.array(slip) + 2.0], 8)
    run = Run(
        "sweep",
        x,
        ("holding_moment",),
        (Drive("shaft", PiecewiseLinear((0, travel, 0, travel, 0))),),
    )
    found = call_engine(engine, SHAFT_CASE.model_path, run)
    rate = run.motion(x)[1][0]
    area = (found.channels["holding_moment"] * rate * weights)[x > 2.0].sum()
    closed = 2 * own["friction"] * (travel - 2 * p) + 2 * own["bearing_friction"] * travel
    assert area == pytest.approx(closed, rel=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_stick_and_slip_change_in_the_sample_of_the_closed_form(engine):
    run = plan_run(with_one_period(SHAFT_CASE), "sweep", engine)
    found = call_engine(engine, SHAFT_CASE.model_path, run)
    (shaft,) = run.motion(run.x)[0]
    truth = shaft_pendulum.solve(shaft, **SHAFT_CASE.parameters)

    def slips(angle):
        return np.abs(np.diff(angle)) > 1e-9

    np.testing.assert_array_equal(slips(found.channels["slip"]), slips(truth["slip"]))
    assert slips(truth["slip"]).any()
    assert not slips(truth["slip"]).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_the_loop_area_of_the_slider_crank_is_friction_times_travel(engine):
    first, last = 0.3, 3.8  # over the dead centre at pi, where the slider turns back
    x, weights = gauss_nodes(
        [0.0, (np.pi - first) / (last - first), 1.0, 2 - (np.pi - first) / 3.5, 2.0]
    )
    run = Run(
        "sweep", x, ("holding_moment",), (Drive("crank", PiecewiseLinear((first, last, first))),)
    )
    found = call_engine(engine, SLIDER_CRANK_CASE.model_path, run)
    rate = run.motion(x)[1][0]
    area = (found.channels["holding_moment"] * rate * weights).sum()
    own = {k: v for k, v in SLIDER_CRANK_CASE.parameters.items() if "friction" not in k}
    at = slider_crank.solve(np.array([first, np.pi, last]), **own)
    pin_angle = at["coupler_angle"] - np.array([first, np.pi, last])
    travels = [last - first, np.abs(np.diff(pin_angle)).sum(), np.abs(np.diff(at["slide"])).sum()]
    names = ("crank_friction", "pin_friction", "slider_friction")
    closed = 2 * sum(
        SLIDER_CRANK_CASE.parameters[name] * way for name, way in zip(names, travels, strict=True)
    )
    assert area == pytest.approx(closed, rel=1e-12)


def test_closed_form_and_general_solver_agree_on_the_slider_crank():
    """Two references with different equations for the pin forces agree, at rest and in motion.

    No engine takes part.
    """
    run = plan_run(SLIDER_CRANK_CASE, "sweep", "mujoco")
    value, rate, acceleration = (part[0] for part in run.motion(run.x))
    model = compiled_model(SLIDER_CRANK_CASE)
    for inertia in (False, True):
        general = planar.solve(
            value, rate, acceleration, model=model, joints=("crank",), inertia=inertia
        )
        closed = slider_crank.solve(
            value, rate, acceleration, **SLIDER_CRANK_CASE.parameters, inertia=inertia
        )
        for name, channel in SLIDER_CRANK_CASE.channels.items():
            size = np.abs(closed[channel.equals]).max()
            np.testing.assert_allclose(
                general[name], closed[channel.equals], atol=1e-12 * size, rtol=0, err_msg=name
            )


PROTOTYPE_CASE = load_case(shipped("balancer_prototype.toml"))


def event_angles(angles):
    """Angles of the pendulum at which a joint of the prototype begins to stick or to slip.

    The given angles, through which the pendulum moves, are among them.
    """
    own = {
        k: v for k, v in PROTOTYPE_CASE.parameters.items() if k[-1] in "123" or k in OTHER_DEFAULTS
    }
    frictions = {k: own.pop(k) for k in tuple(own) if "friction" in k}
    chain, found = (
        ChainWithFriction(
            balancer(**own), np.array([frictions.get(f"friction{i}", 0.0) for i in (1, 2, 3)])
        ),
        [],
    )
    enter = chain.enter
    chain.enter = lambda senses: (found.append(chain.alpha), enter(senses))
    for angle in angles:
        follow_stick_slip(chain, np.array([angle]))
        found.append(angle)
    return np.array(found)


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("pymunk", marks=pytest.mark.slow)])
def test_the_loop_area_of_the_prototype_is_friction_times_travel(engine):
    """The drive's work in a cycle is the sum of friction times travel over the joints.

    The quadrature goes from event to event.
    """
    end = np.pi / 2
    here = event_angles([end, 0.0, end, 0.0])
    ends = here[np.flatnonzero(here == 0.0)[1] :]  # from the end of the first cycle on
    ends = ends[np.append(True, np.abs(np.diff(ends)) > 1e-9)]
    values = (0.0, end, 0.0, *ends[1:])
    x, weights = gauss_nodes(np.arange(len(values), dtype=float).tolist(), 16)
    names = ("holding_moment", "deflection2", "deflection3")
    run = Run("sweep", x, names, (Drive("pendulum", PiecewiseLinear(values)),))
    found = call_engine(engine, PROTOTYPE_CASE.model_path, run).channels
    second = x > 2.0
    area = (found["holding_moment"] * run.motion(x)[1][0] * weights)[second].sum()
    travels = [np.abs(np.diff(found[f"deflection{i}"][x >= 2.0])).sum() for i in (2, 3)]
    dissipated = sum(
        PROTOTYPE_CASE.parameters[f"friction{i}"] * way
        for i, way in zip((2, 3), travels, strict=True)
    )
    assert area == pytest.approx(dissipated, rel=1e-8)
    assert area > 0.004  # J


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_four_segments_with_friction_in_all_joints_agree(engine, tmp_path):
    """The chain has two degrees of freedom left: several joints stick at once, one, or none."""
    chain = parameters(rows()["1744"]) | {f"friction{i}": 0.004 * i for i in (1, 2, 3, 4)}
    chain["pendulum_friction"] = 0.003
    case = load_case(write_case(tmp_path, "four", title="4", source="-", parameters=chain))
    case = case.model_copy(
        update={"run": {"sweep": case.run["sweep"].model_copy(update={"n": 13})}}
    )
    found = compare(case, "sweep", engine, solve_here(case, "sweep", engine), detectable=False)
    assert_all_but_rates_in_pymunk_agree(found, engine)


def assert_all_but_rates_in_pymunk_agree(found, engine):
    """All channels agree, but a sweep at rest in pymunk has no rates."""
    assert len(found) > 20
    for one in found:
        no_rate = engine == "pymunk" and one.channel.endswith("_rate")
        assert one.outcome == ("unsupported" if no_rate else "agrees"), one.channel


def test_the_prototype_with_friction_agrees_in_pymunk():
    """The pendulum moves up and down once in eight intervals; the tolerances are the case's own."""
    sweep = PROTOTYPE_CASE.run["sweep"].model_copy(update={"n": 9, "until": 2.0})
    case = PROTOTYPE_CASE.model_copy(update={"run": {"sweep": sweep}})
    curves = solve_here(case, "sweep", "pymunk")
    found = compare(case, "sweep", "pymunk", curves, detectable=False)
    assert_all_but_rates_in_pymunk_agree(found, "pymunk")


def with_one_period(case):
    """The case with the first period of its drive, and a third of the intervals in it.

    The drive turns back at a sample.
    """
    sweep, period = case.run["sweep"], case.leader.period
    periods = round((sweep.until or period) / period)
    few = {"n": (sweep.n - 1) // (3 * periods) + 1, "until": period}
    return case.model_copy(update={"run": {"sweep": sweep.model_copy(update=few)}})


def friction_numbers(files):
    """Names of cases, each with the numbers of the joints with friction."""
    return [
        (file.stem, k)
        for file in files
        for k in range(len(FRICTION_ATTRIBUTE.findall(shipped_case(file).model_path.read_text())))
    ]


def enlarge_friction(file, number, factor):
    """Change one ``frictionloss`` of a model."""
    text = file.read_text()
    place = list(FRICTION_ATTRIBUTE.finditer(text))[number]
    larger = repr(factor * float(place[1]))
    file.write_text(text[: place.start(1)] + larger + text[place.end(1) :])


@pytest.mark.parametrize(
    ("name", "number", "engine"),
    [
        pytest.param(
            *one,
            engine,
            marks=[pytest.mark.slow] * (engine == "pymunk" and one[0] == "balancer_prototype"),
        )
        for one in friction_numbers(SWEEPS_WITH_FRICTION)
        for engine in ENGINES
    ],
)
def test_every_friction_that_is_0_1_percent_larger_differs(name, number, engine, models):
    """One ``frictionloss`` that is 0.1 % larger changes an outcome to "differs"."""
    enlarge_friction(models / load_case(shipped(f"{name}.toml")).model, number, 1.001)
    case = with_one_period(load_case(models / f"{name}.toml"))
    found = compare(case, "sweep", engine, solve_here(case, "sweep", engine), detectable=False)
    assert "differs" in {one.outcome for one in found}


@pytest.mark.parametrize(("name", "number"), friction_numbers(MOTIONS_WITH_FRICTION))
@pytest.mark.parametrize("engine", ENGINES)
def test_a_motion_with_5_percent_more_friction_in_one_joint_of_the_engine_differs(
    name, number, engine, models
):
    """The reference reads the model too, so the engine alone has the changed one."""
    case = load_case(shipped(f"{name}.toml"))
    own = compare(case, "dynamics", engine, solve_here(case, "dynamics", engine), detectable=False)
    assert {one.outcome for one in own} == {"agrees"}
    enlarge_friction(models / case.model, number, 1.05)
    curves = solve_here(load_case(models / f"{name}.toml"), "dynamics", engine)
    found = compare(case, "dynamics", engine, curves, detectable=False)
    assert "differs" in {one.outcome for one in found}


STICKING_PENDULUM = """<mujoco><option gravity="0 -9.81 0" integrator="implicitfast" tolerance="0">
<flag contact="disable"/></option><worldbody><body><joint name="p" frictionloss="0.3" {}/>
<inertial pos="0 -0.2 0" mass="0.5" diaginertia="1e-4 1e-4 1e-4"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("soft", "rate"),
    [("", 1.15e-2), ('solreffriction="0.005 1" solimpfriction="0.9999 0.9999 0.001"', 3.02e-6)],
)
def test_mujocos_own_friction_creeps(soft, rate):
    """MuJoCo's friction is soft: a joint that should stick creeps.

    Its rate is (1 - dmin)/dmin M/I dmax timeconst/2, with the moment M and the moment of inertia I.
    Therefore a sweep takes the bound of the friction and makes no time steps.
    """
    model = mujoco.MjModel.from_xml_string(STICKING_PENDULUM.format(soft))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.25
    mujoco.mj_step(model, data, 1000)  # 2 s, after which the transient of the start has decayed
    moment, inertia = 0.5 * 9.81 * 0.2 * np.sin(data.qpos[0]), 0.5 * 0.2**2 + 1e-4
    time, (dmin, dmax) = model.dof_solref[0, 0], model.dof_solimp[0, :2]
    creep = (1 - dmin) / dmin * moment / inertia * dmax * time / 2
    # the impedance is dmin, since friction has no width over which it could grow
    assert -data.qvel[0] == pytest.approx(creep, rel=0.05)
    assert creep == pytest.approx(rate, rel=0.1)


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_of_the_driven_joint_changes_only_its_force(engine, edit, models):
    """Friction of 2 N in a driven joint adds 2 N to its force and changes no other curve."""
    case = load_case(models / "springs_parallel.toml")
    smooth = solve_here(case, "sweep", engine).channels
    edit("springs_parallel.xml", '<joint name="handle"', '<joint name="handle" frictionloss="2"')
    rough = solve_here(case, "sweep", engine).channels
    for name, curve in smooth.items():
        added = 2.0 if name == "force" else 0.0
        np.testing.assert_allclose(rough[name], curve + added, atol=1e-11, rtol=0)


TWO_SLIDES_AND_A_HINGE = """<mujoco><compiler angle="radian"/><option gravity="0 0 -10">
<flag contact="disable"/></option><worldbody>
<body><joint name="a" type="slide" axis="0 0 1" frictionloss="2"/>{0}</body>
<body><joint name="b" type="slide" axis="0 0 1" frictionloss="3"/>{0}</body>
<body><joint name="c" axis="0 -1 0" frictionloss="4"/>{0}</body></worldbody><sensor>
<jointactuatorfrc name="F" joint="a"/><jointactuatorfrc name="G" joint="b"/>
<jointactuatorfrc name="M" joint="c"/></sensor></mujoco>"""


@pytest.mark.parametrize("engine", ENGINES)
def test_a_drive_without_motion_so_far_has_no_friction(engine, tmp_path):
    """Slide a goes up, down and up from the first sample on; slide b and hinge c move from x = 3.

    Each drive carries its weight, 10 N or the moment 10 N m cos c, and then friction as well.
    """
    file = tmp_path / "three.xml"
    file.write_text(
        TWO_SLIDES_AND_A_HINGE.format('<inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>')
    )
    ways = (0.0, 1.0, 0.0, 1.0, 2.0), (0.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0, 0.5)
    drives = tuple(Drive(name, PiecewiseLinear(way)) for name, way in zip("abc", ways, strict=True))
    run = Run("sweep", np.array([0.5, 1.5, 2.5, 3.5]), ("F", "G", "M"), drives)
    found = call_engine(engine, file, run).channels
    # rounding of impulses
    np.testing.assert_allclose(found["F"], [12.0, 8.0, 12.0, 12.0], atol=1e-9, rtol=0)
    np.testing.assert_allclose(found["G"], [10.0, 10.0, 10.0, 13.0], atol=1e-9, rtol=0)
    np.testing.assert_allclose(
        found["M"], [10.0, 10.0, 10.0, 10 * np.cos(0.25) + 4], atol=1e-9, rtol=0
    )


BLOCK_ON_A_SPRING = """<mujoco><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>
<body><joint name="hand" type="slide" axis="1 0 0"/>{0}<site name="hand"/></body>
<body pos="-1 0 0"><joint name="block" type="slide" axis="1 0 0" frictionloss="0.3"/>{0}
<site name="block"/></body></worldbody>
<tendon><spatial stiffness="2" springlength="1"><site site="hand"/><site site="block"/></spatial>
</tendon><sensor><jointpos name="block" joint="block"/><jointactuatorfrc name="F" joint="hand"/>
</sensor></mujoco>"""


@pytest.mark.parametrize("engine", ENGINES)
def test_a_block_on_a_spring_sticks_until_the_spring_exceeds_its_friction(engine, tmp_path):
    """A hand pulls a block by a spring of 2 N/m to 1 m and back, against friction of 0.3 N.

    The block lags 0.15 m behind the hand once it slips, and sticks for 0.3 m after the hand turns.
    """
    file = tmp_path / "block.xml"
    file.write_text(
        BLOCK_ON_A_SPRING.format('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')
    )
    drive = Drive("hand", PiecewiseLinear((0.0, 1.0, 0.0)))
    run = Run("sweep", np.linspace(0.0, 2.0, 21), ("block", "F"), (drive,))
    found = call_engine(engine, file, run).channels
    hand = 1.0 - np.abs(run.x - 1.0)
    block = np.where(run.x < 1, np.maximum(hand - 0.15, 0.0), np.minimum(hand + 0.15, 0.85))
    np.testing.assert_allclose(found["block"], block, atol=1e-9, rtol=0)  # rest, to 1e-12 m
    np.testing.assert_allclose(found["F"], 2 * (hand - block), atol=1e-9, rtol=0)


def test_a_motor_too_weak_to_let_a_joint_stick_is_an_error(monkeypatch, tmp_path):
    """With half the friction the engine's motor cannot hold the block until it should slip."""
    file = tmp_path / "block.xml"
    file.write_text(
        BLOCK_ON_A_SPRING.format('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')
    )
    stick = SlideFriction.stick

    def stick_half(motor: SlideFriction, value: float) -> None:
        stick(motor, value)
        motor.max_force /= 2

    monkeypatch.setattr(SlideFriction, "stick", stick_half)
    drive = Drive("hand", PiecewiseLinear((0.0, 0.1)))
    run = Run("sweep", np.array([0.0, 1.0]), ("block",), (drive,))
    with pytest.raises(NotSolved, match="joints 'block' should stick, but slip by"):
        call_engine("pymunk", file, run)


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_that_blocks_the_whole_mechanism_is_an_error(engine, edit):
    file = edit("shaft_pendulum.xml", 'frictionloss="0.3"', 'frictionloss="1.0"')
    run = replace(plan_run(SHAFT_CASE, "sweep", engine), x=np.array([0.0, 0.3, 0.6, 0.7]))
    with pytest.raises(BadModel, match="dry friction of joint 'pendulum' holds all that"):
        call_engine(engine, file, run)


def test_a_drive_that_turns_back_between_samples_is_an_error():
    run = SHAFT_CASE.run["sweep"].model_copy(update={"n": 96})
    case = SHAFT_CASE.model_copy(update={"run": {"sweep": run}})
    with pytest.raises(InputError, match="'shaft' turns back between samples 47 and 48") as error:
        plan_run(case, "sweep", "mujoco")
    assert error.value.key == "run.sweep.n"


@pytest.mark.parametrize("solver", [planar, spatial])
def test_a_pendulum_sticks_to_a_driven_shaft_and_slips_in_dynamics(solver):
    """Where it sticks it turns with the shaft; both references and pymunk agree on the slip."""
    t, profile = np.linspace(0, 2.0, 41), Swing(0, 2.0, 2.0)
    run = Run("dynamics", t, ("slip",), (Drive("shaft", profile),))
    file = shipped("shaft_pendulum.xml")
    model = mujoco.MjModel.from_xml_path(str(file))
    asked = {"model": model, "joints": ("shaft",), "in_time": (t, (profile,))}
    known = solver.solve(*profile(t), **asked)["slip"]
    stuck = np.flatnonzero(np.diff(known) == 0.0)
    assert 3 < stuck.size < 30
    assert np.ptp(known) > 0.5
    found = call_engine("pymunk", file, run).channels["slip"]
    assert np.abs(found - known).max() < 2e-3


ROW_OF_LINKS = """<mujoco><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>{}{}
</worldbody><keyframe><key name="start"/></keyframe></mujoco>"""
LINK = """<body pos="{0} 0 0"><joint name="j{1}" {2}/>
<inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>"""
SPRING_AND_FRICTION = 'stiffness="1" frictionloss="0.1"'


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_of_more_than_six_joints_is_refused(engine, tmp_path):
    links = "".join(LINK.format(int(k > 0), k, SPRING_AND_FRICTION if k else "") for k in range(8))
    file = tmp_path / "row.xml"
    file.write_text(ROW_OF_LINKS.format(links, 8 * "</body>"))
    run = Run("sweep", np.linspace(0, 1, 3), (), (Drive("j0", PiecewiseLinear((0.0, 1.0))),))
    with pytest.raises(Unsupported, match=r"frictionloss of 7 joints .* up to 6 are covered"):
        call_engine(engine, file, run)


def test_pymunk_refuses_stops_together_with_friction_of_free_joints(tmp_path):
    links = LINK.format(0, 0, "") + LINK.format(
        1, 1, SPRING_AND_FRICTION + ' limited="true" range="-1 1"'
    )
    file = tmp_path / "row.xml"
    file.write_text(ROW_OF_LINKS.format(links, 2 * "</body>"))
    run = Run("sweep", np.linspace(0, 1, 3), (), (Drive("j0", PiecewiseLinear((0.0, 1.0))),))
    with pytest.raises(Unsupported, match="joint ranges and dry friction of j1"):
        call_engine("pymunk", file, run)


def moved_up_and_down(x):
    """A way of 0.1 m up and back, at 1 m/s."""
    up = x < 0.1
    return np.where(up, x, 0.2 - x), np.where(up, 1.0, -1.0), 0.0 * x


@pytest.mark.parametrize("highest", [1.0, 0.03])
def test_a_joint_with_friction_that_its_stop_holds_leaves_it_by_the_closed_form(tmp_path, highest):
    """On the stop nothing is free: the drive, the loop and the stop determine all joints.

    The middle of two springs in series sticks between the two places where friction gives way,
    ``k1 gap + preload -+ F = k2 (x - gap)``, within its range.
    """
    joint = '<joint name="middle" stiffness="100" springref="-0.061" range="0 {}"'
    text, file = shipped("springs_series.xml").read_text(), tmp_path / "springs.xml"
    assert joint.format(1) in text
    file.write_text(text.replace(joint.format(1), joint.format(highest) + ' frictionloss="1"'))
    x = np.linspace(0.0, 0.2, 41)
    drive = Drive("handle", moved_up_and_down)
    found = engine_of("mujoco").simulate(file, Run("sweep", x, ("gap", "force"), (drive,)))
    k1, k2, preload, friction, gap, gaps = 100.0, 300.0, 6.1, 1.0, 0.0, []
    handle = moved_up_and_down(x)[0]
    for place in handle:
        low, high = ((k2 * place - preload + way * friction) / (k1 + k2) for way in (-1, 1))
        gap = min(max(min(max(gap, low), high), 0.0), highest)
        gaps.append(gap)
    np.testing.assert_allclose(found.channels["gap"], gaps, rtol=0, atol=1e-14)  # rounding
    np.testing.assert_allclose(
        found.channels["force"], k2 * (handle - gaps), rtol=0, atol=1e-12
    )  # rounding of 30 N
