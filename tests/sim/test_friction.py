"""Tests of dry friction in sweeps, in both engines: hysteresis loops, transitions, refusals."""

import re
from dataclasses import dataclass, replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from proofmass.analytic import planar
from proofmass.analytic.balancer.friction import ChainWithFriction
from proofmass.analytic.balancer.model import OTHER_DEFAULTS, balancer
from proofmass.analytic.friction import follow_stick_slip
from proofmass.analytic.linkages import shaft_pendulum, slider_crank
from proofmass.compare import compare
from proofmass.design.template import write_case
from proofmass.drive import Swing
from proofmass.errors import InputError
from proofmass.reference import compiled_model
from proofmass.sidecar import load_case
from proofmass.sim.protocol import BadModel, Drive, Run, Unsupported
from proofmass.solve import call_engine, plan_run, solve_here
from tests.analytic.balancer.balancer_table import parameters, rows
from tests.shipped import loaded, models_like, shipped

ENGINES = ("mujoco", "pymunk")
SHAFT = load_case(shipped("shaft_pendulum.toml"))
CRANK = load_case(shipped("slider_crank_friction.toml"))
RUBBING = [f for f in models_like() if compiled_model(loaded(f)).dof_frictionloss.any()]
FRICTION = re.compile(r'frictionloss="([^"]+)"')


@dataclass(frozen=True)
class Along:
    """A profile that is linear between its values at x = 0, 1, 2, ..."""

    values: tuple[float, ...]

    def __call__(self, x):
        rate = np.diff(self.values)[np.clip(np.ceil(x).astype(int) - 1, 0, len(self.values) - 2)]
        return np.interp(x, np.arange(len(self.values)), self.values), rate, 0.0 * x


def gauss(ends, nodes=24):
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
def test_a_cycle_of_the_shaft_loses_its_closed_area(engine):
    """The drive's work in a cycle is 2 friction (a - 2 p) + 2 bearing_friction a.

    a is the travel of the shaft and p the slip angle.  The quadrature goes from event to event, so
    that its error is rounding.
    """
    own = SHAFT.parameters
    p = shaft_pendulum.slip_angle(**{k: own[k] for k in ("length", "mass", "friction", "gravity")})
    way = 2.0
    slip = [2 * p / way, 1.0, 1.0 + 2 * p / way, 2.0]
    x, weights = gauss([0.0, 1.0, 2.0, *np.array(slip) + 2.0], 8)
    run = Run("sweep", x, ("holding_moment",), (Drive("shaft", Along((0, way, 0, way, 0))),))
    found = call_engine(engine, SHAFT.model_path, run)
    rate = run.motion(x)[1][0]
    area = (found.channels["holding_moment"] * rate * weights)[x > 2.0].sum()
    closed = 2 * own["friction"] * (way - 2 * p) + 2 * own["bearing_friction"] * way
    assert area == pytest.approx(closed, rel=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_stick_and_slip_change_in_the_sample_of_the_closed_form(engine):
    run = plan_run(brief(SHAFT), "sweep", engine)
    found = call_engine(engine, SHAFT.model_path, run)
    (shaft,) = run.motion(run.x)[0]
    truth = shaft_pendulum.solve(shaft, **SHAFT.parameters)

    def slips(angle):
        return np.abs(np.diff(angle)) > 1e-9

    np.testing.assert_array_equal(slips(found.channels["slip"]), slips(truth["slip"]))
    assert slips(truth["slip"]).any()
    assert not slips(truth["slip"]).all()


@pytest.mark.parametrize("engine", ENGINES)
def test_a_loop_of_the_slider_crank_is_the_friction_times_the_way_of_each_joint(engine):
    first, last = 0.3, 3.8  # over the dead centre at pi, where the slider turns back
    x, weights = gauss([0.0, (np.pi - first) / (last - first), 1.0, 2 - (np.pi - first) / 3.5, 2.0])
    run = Run("sweep", x, ("holding_moment",), (Drive("crank", Along((first, last, first))),))
    found = call_engine(engine, CRANK.model_path, run)
    rate = run.motion(x)[1][0]
    area = (found.channels["holding_moment"] * rate * weights).sum()
    own = {k: v for k, v in CRANK.parameters.items() if "friction" not in k}
    at = slider_crank.solve(np.array([first, np.pi, last]), **own)
    bent = at["coupler_angle"] - np.array([first, np.pi, last])
    ways = [last - first, np.abs(np.diff(bent)).sum(), np.abs(np.diff(at["slide"])).sum()]
    names = ("crank_friction", "pin_friction", "slider_friction")
    closed = 2 * sum(CRANK.parameters[name] * way for name, way in zip(names, ways, strict=True))
    assert area == pytest.approx(closed, rel=1e-12)


def test_the_closed_form_of_the_slider_crank_is_what_the_general_solver_finds():
    """Two references with different equations for the pin forces agree, at rest and in motion.

    No engine takes part.
    """
    run = plan_run(CRANK, "sweep", "mujoco")
    value, rate, acceleration = (part[0] for part in run.motion(run.x))
    model = compiled_model(CRANK)
    for inertia in (False, True):
        general = planar.solve(
            value, rate, acceleration, model=model, joints=("crank",), inertia=inertia
        )
        closed = slider_crank.solve(value, rate, acceleration, **CRANK.parameters, inertia=inertia)
        for name, channel in CRANK.channels.items():
            size = np.abs(closed[channel.equals]).max()
            np.testing.assert_allclose(
                general[name], closed[channel.equals], atol=1e-12 * size, rtol=0, err_msg=name
            )


PROTOTYPE = load_case(shipped("balancer_prototype.toml"))


def events(angles):
    """Angles of the pendulum at which a joint of the prototype begins to stick or to slip.

    The given angles, through which the pendulum moves, are among them.
    """
    own = {k: v for k, v in PROTOTYPE.parameters.items() if k[-1] in "123" or k in OTHER_DEFAULTS}
    rubs = {k: own.pop(k) for k in tuple(own) if "friction" in k}
    chain, found = (
        ChainWithFriction(
            balancer(**own), np.array([rubs.get(f"friction{i}", 0.0) for i in (1, 2, 3)])
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
def test_a_cycle_of_the_prototype_loses_the_friction_of_its_joints_times_their_way(engine):
    """The drive's work in a cycle is the sum of friction times travel over the joints.

    The quadrature goes from event to event.
    """
    end = np.pi / 2
    here = events([end, 0.0, end, 0.0])
    ends = here[np.flatnonzero(here == 0.0)[1] :]  # from the end of the first cycle on
    ends = ends[np.append(True, np.abs(np.diff(ends)) > 1e-9)]
    values = (0.0, end, 0.0, *ends[1:])
    x, weights = gauss(np.arange(len(values), dtype=float).tolist(), 16)
    names = ("holding_moment", "deflection2", "deflection3")
    run = Run("sweep", x, names, (Drive("pendulum", Along(values)),))
    found = call_engine(engine, PROTOTYPE.model_path, run).channels
    second = x > 2.0
    area = (found["holding_moment"] * run.motion(x)[1][0] * weights)[second].sum()
    ways = [np.abs(np.diff(found[f"deflection{i}"][x >= 2.0])).sum() for i in (2, 3)]
    lost = sum(
        PROTOTYPE.parameters[f"friction{i}"] * way for i, way in zip((2, 3), ways, strict=True)
    )
    assert area == pytest.approx(lost, rel=1e-8)
    assert area > 0.004  # J


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_four_segments_of_which_all_joints_rub_follow_the_reference(engine, tmp_path):
    """The chain has two degrees of freedom left: several joints stick at once, one, or none."""
    chain = parameters(rows()["1744"]) | {f"friction{i}": 0.004 * i for i in (1, 2, 3, 4)}
    chain["pendulum_friction"] = 0.003
    case = load_case(write_case(tmp_path, "four", title="4", source="-", parameters=chain))
    case = case.model_copy(
        update={"run": {"sweep": case.run["sweep"].model_copy(update={"n": 13})}}
    )
    found = compare(case, "sweep", engine, solve_here(case, "sweep", engine), detectable=False)
    assert {one.outcome for one in found} <= {"agrees", "unsupported"}


def test_the_built_balancer_rubs_in_pymunk_as_in_its_reference():
    """The pendulum moves up and down once in eight intervals; the tolerances are the case's own."""
    sweep = PROTOTYPE.run["sweep"].model_copy(update={"n": 9, "until": 2.0})
    case = PROTOTYPE.model_copy(update={"run": {"sweep": sweep}})
    curves = solve_here(case, "sweep", "pymunk")
    found = compare(case, "sweep", "pymunk", curves, detectable=False)
    assert {one.outcome for one in found} <= {"agrees", "unsupported"}
    assert "agrees" in {one.outcome for one in found}


def brief(case):
    """The case with the first period of its drive, and a third of the intervals in it.

    The drive turns back at a sample.
    """
    sweep, period = case.run["sweep"], case.leader.period
    ways = round((sweep.until or period) / period)
    few = {"n": (sweep.n - 1) // (3 * ways) + 1, "until": period}
    return case.model_copy(update={"run": {"sweep": sweep.model_copy(update=few)}})


NUMBERS = [
    (file.stem, k)
    for file in RUBBING
    for k in range(len(FRICTION.findall(loaded(file).model_path.read_text())))
]


@pytest.mark.parametrize(
    ("name", "number", "engine"),
    [
        pytest.param(
            *one,
            engine,
            marks=[pytest.mark.slow] * (engine == "pymunk" and one[0] == "balancer_prototype"),
        )
        for one in NUMBERS
        for engine in ENGINES
    ],
)
def test_every_friction_of_a_shipped_model_is_noticed(name, number, engine, models):
    """One ``frictionloss`` that is 0.1 % larger changes an outcome to "differs"."""
    file = models / load_case(shipped(f"{name}.toml")).model
    text = file.read_text()
    place = list(FRICTION.finditer(text))[number]
    larger = repr(1.001 * float(place[1]))
    file.write_text(text[: place.start(1)] + larger + text[place.end(1) :])
    case = brief(load_case(models / f"{name}.toml"))
    found = compare(case, "sweep", engine, solve_here(case, "sweep", engine), detectable=False)
    assert "differs" in {one.outcome for one in found}


CREEPING = """<mujoco><option gravity="0 -9.81 0" integrator="implicitfast" tolerance="0">
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
    model = mujoco.MjModel.from_xml_string(CREEPING.format(soft))
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
def test_a_drive_that_rubs_leaves_the_rest_of_springs_as_it_is(engine, edit, models):
    """Friction of 2 N in a driven joint adds 2 N to its force and changes no other curve."""
    case = load_case(models / "springs_parallel.toml")
    smooth = solve_here(case, "sweep", engine).channels
    edit("springs_parallel.xml", '<joint name="handle"', '<joint name="handle" frictionloss="2"')
    rough = solve_here(case, "sweep", engine).channels
    for name, curve in smooth.items():
        added = 2.0 if name == "force" else 0.0
        np.testing.assert_allclose(rough[name], curve + added, atol=1e-11, rtol=0)


@pytest.mark.parametrize("engine", ENGINES)
def test_friction_that_holds_the_whole_mechanism_is_an_error(engine, edit):
    file = edit("shaft_pendulum.xml", 'frictionloss="0.3"', 'frictionloss="1.0"')
    run = replace(plan_run(SHAFT, "sweep", engine), x=np.array([0.0, 0.3, 0.6, 0.7]))
    with pytest.raises(BadModel, match="dry friction of joint 'pendulum' holds all that"):
        call_engine(engine, file, run)


def test_a_drive_that_turns_back_between_samples_is_an_error():
    run = SHAFT.run["sweep"].model_copy(update={"n": 96})
    case = SHAFT.model_copy(update={"run": {"sweep": run}})
    with pytest.raises(InputError, match="'shaft' turns back between samples 47 and 48") as error:
        plan_run(case, "sweep", "mujoco")
    assert error.value.key == "run.sweep.n"


def test_chipmunk_refuses_friction_in_time():
    run = Run("dynamics", np.linspace(0, 0.1, 3), (), (Drive("shaft", Swing(0, 1, 1)),))
    with pytest.raises(Unsupported, match="frictionloss of joint 'shaft' in dynamics"):
        call_engine("pymunk", SHAFT.model_path, run)


ROW = """<mujoco><option gravity="0 0 0"><flag contact="disable"/></option><worldbody>{}{}
</worldbody><keyframe><key name="start"/></keyframe></mujoco>"""
LINK = """<body pos="{0} 0 0"><joint name="j{1}" {2}/>
<inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>"""
SPRING = 'stiffness="1" frictionloss="0.1"'


@pytest.mark.parametrize("engine", ENGINES)
def test_more_joints_than_are_covered_are_refused(engine, tmp_path):
    links = "".join(LINK.format(int(k > 0), k, SPRING if k else "") for k in range(8))
    file = tmp_path / "row.xml"
    file.write_text(ROW.format(links, 8 * "</body>"))
    run = Run("sweep", np.linspace(0, 1, 3), (), (Drive("j0", Along((0.0, 1.0))),))
    with pytest.raises(Unsupported, match=r"frictionloss of 7 joints .* up to 6 are covered"):
        call_engine(engine, file, run)


def test_chipmunk_refuses_stops_and_friction_of_free_joints_together(tmp_path):
    links = LINK.format(0, 0, "") + LINK.format(1, 1, SPRING + ' limited="true" range="-1 1"')
    file = tmp_path / "row.xml"
    file.write_text(ROW.format(links, 2 * "</body>"))
    run = Run("sweep", np.linspace(0, 1, 3), (), (Drive("j0", Along((0.0, 1.0))),))
    with pytest.raises(Unsupported, match="joint ranges and dry friction of j1"):
        call_engine("pymunk", file, run)
