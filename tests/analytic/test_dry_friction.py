"""Dry friction of joints in time: decisions, closed forms, and motions that others integrate."""

from functools import cache, partial

import mujoco
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import linprog, lsq_linear

from proofmass.analytic import planar, spatial
from proofmass.analytic.contacts import restitution
from proofmass.analytic.controls import ControlsInTime
from proofmass.analytic.joints_at_rest import RestForces, RestRows
from proofmass.analytic.motion_events import MotionWithEvents
from proofmass.analytic.numerics import NotCovered, SingularHere
from proofmass.analytic.planar.dynamics import free_motion
from proofmass.analytic.planar.mechanism import read
from proofmass.analytic.spatial.mechanism import read_tree
from proofmass.analytic.spatial.motion import integrate_motion
from proofmass.sim.smooth import SmoothTerms
from tests.analytic import friction_witness
from tests.analytic.friction_witness import brent, chain_model, random_chain
from tests.analytic.one_coordinate import follow as follow_one
from tests.analytic.one_coordinate import four_bar, four_bar_angles, slider_crank
from tests.shipped import shipped

HEAD = """<mujoco><compiler autolimits="true" angle="radian"/><option gravity="{}">
  <flag contact="disable"/></option>"""
LEVEL, WEIGHT = HEAD.format("0 0 0"), HEAD.format("0 -9.81 0")
SOLVERS = {"planar": planar, "spatial": spatial}
SOURCES = {"planar": lambda _: {}, "spatial": lambda model: {"terms": SmoothTerms(model)}}
BOTH_SOLVERS = pytest.mark.parametrize("solver", SOLVERS)


def compiled(text: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(text)


def solve(solver: str, model: mujoco.MjModel, times: np.ndarray, **more) -> dict[str, np.ndarray]:
    return SOLVERS[solver].solve(times, model=model, **more)


def events_of(
    solver: str,
    model: mujoco.MjModel,
    times: np.ndarray,
    controls: dict | None = None,
) -> MotionWithEvents:
    """A free motion with its events; that in space has the terms of MuJoCo."""
    if solver == "planar":
        mechanism, plane = read(model, "start")
        changing = ControlsInTime.of(plane.data, mechanism.ctrl, controls)
        stops = tuple(plane.stops(mechanism))
        return free_motion(mechanism, times, stops=stops, controls=changing)
    tree = read_tree(model, "start")
    changing = ControlsInTime.of(tree.data, tree.ctrl, controls)
    stops = tuple(spatial.stops_of_tree(tree))
    return integrate_motion(tree, SmoothTerms(model), times, stops, changing).followed


def event_times(motion: MotionWithEvents) -> np.ndarray:
    """All times of events [s], each once."""
    found = (motion.halts, motion.slips, motion.impacts, motion.releases)
    return np.array(sorted({time for events in found for time, _ in events}))


# --- the decision


def random_rows(random: np.random.Generator, stops: bool) -> RestRows:
    """Rows of which some depend on others."""
    n, free = int(random.integers(1, 6)), int(random.integers(1, 5))
    motions = random.normal(size=(n, free)) * 10.0 ** random.uniform(-1, 1)
    if n > 2 and random.uniform() < 0.5:
        motions[-1] = motions[:2].T @ random.normal(size=2)
    one_sided = random.uniform(size=n) < (0.4 if stops else 0.0)
    return RestRows(motions, 10.0 ** random.uniform(-1, 1, n), one_sided)


@pytest.mark.parametrize("stops", [False, True])
def test_decisions_have_the_accelerations_of_the_dual_problem(stops):
    """min |y + (E G)' lam|^2 over the bounds of lam: bounded least squares, another algorithm."""
    random, patterns = np.random.default_rng(5), set()
    for _ in range(150):
        rows = random_rows(random, stops)
        motions, bounds = rows.motions, rows.bounds
        y = random.normal(size=motions.shape[1]) * (np.abs(motions.T) @ bounds).max()
        low = np.where(rows.one_sided, 0.0, -bounds)
        high = np.where(rows.one_sided, np.inf, bounds)
        dual = lsq_linear(motions.T, -y, (low, high), method="bvls", tol=1e-15)
        known = motions @ (y + motions.T @ dual.x)
        senses = rows.decide(motions @ y)
        scale = np.abs(motions @ y).max()
        patterns |= set(senses.tolist())
        assert (np.sign(np.where(np.abs(known) > 1e-9 * scale, known, 0.0)) == senses).all()
    assert patterns == {-1.0, 0.0, 1.0}


@pytest.mark.parametrize("stops", [False, True])
def test_reserves_are_the_largest_and_the_motion_that_begins_proves_it(stops):
    """The dual: no forces within smaller bounds can hold the motion that begins.

    With r the reserve and w that motion, the power of the needed force is what the forces at their
    bounds can resist.
    """
    random = np.random.default_rng(6)
    seen = set()
    for _ in range(150):
        rows = random_rows(random, stops)
        pushes = rows.motions * rows.bounds[:, None]
        needed = pushes.T @ random.normal(size=len(pushes))
        found = rows.find_forces(needed)
        shares = found.forces / rows.bounds
        assert (
            np.abs(rows.motions.T @ found.forces - needed).max() < 1e-12 * np.abs(pushes).max() * 10
        )
        margins = np.where(rows.one_sided, shares, 1.0 - np.abs(shares))
        assert margins.min(initial=1.0) >= found.reserve - 1e-12
        assert (missing_power(rows, needed, 0.0) > -1e-9) == (found.reserve > -1e-9)
        assert missing_power(rows, needed, found.reserve) > -1e-9
        if found.reserve < 0.999:
            assert missing_power(rows, needed, found.reserve + 1e-3) < -1e-9
            assert abs(power_of_beginning(rows, needed, found)) < 1e-9
        seen.add(bool(found.reserve > 0))
    assert seen == {False, True}


def missing_power(rows: RestRows, needed: np.ndarray, reserve: float) -> float:
    """By Farkas negative if a motion has more power of the force than rows with a reserve take."""
    pushes, rubs = rows.motions * rows.bounds[:, None], ~rows.one_sided
    n, free = pushes.shape
    sides = np.block([[pushes, -np.diag(1.0 * rubs)], [-pushes[rubs], -np.eye(n)[rubs]]])
    cost = np.concatenate([reserve * pushes[~rubs].sum(axis=0) - needed, (1.0 - reserve) * rubs])
    limits = [(-1, 1)] * free + [(0, None)] * n
    return linprog(cost, sides, np.zeros(len(sides)), bounds=limits).fun


def power_of_beginning(rows: RestRows, needed: np.ndarray, found: RestForces) -> float:
    """The least power that a motion with the signs of `begins` lacks: 0 if it can begin."""
    pushes, moves = rows.motions * rows.bounds[:, None], found.begins != 0
    takes = np.where(rows.one_sided, -found.reserve, (1.0 - found.reserve) * found.begins)
    ahead, still = found.begins[moves, None] * pushes[moves], pushes[~moves]
    balance, ends = np.vstack([still, found.begins @ pushes]), np.append(np.zeros(len(still)), 1.0)
    best = linprog(
        needed + takes @ pushes, -ahead, np.zeros(len(ahead)), balance, ends, (None, None)
    )
    return np.inf if best.fun is None else best.fun


# --- closed forms


def block(friction: float = 3.0, start: float = 0.5) -> mujoco.MjModel:
    """A block of 2 kg on a spring of 100 N/m."""
    return compiled(f"""{LEVEL}<worldbody><body><joint name="x" type="slide" axis="1 0 0"
      stiffness="100" frictionloss="{friction}"/><geom size="0.1" mass="2"/></body></worldbody>
      <sensor><jointpos name="x" joint="x"/></sensor>
      <keyframe><key name="start" qpos="{start}"/></keyframe></mujoco>""")


@BOTH_SOLVERS
def test_a_block_on_a_spring_loses_two_shares_of_its_amplitude_in_a_half_cycle(solver):
    """Half-cycles of pi sqrt(m / k) are cosines about +-F/k, until the spring cannot move it."""
    half, lost, n = np.pi * np.sqrt(0.02), 2 * 3.0 / 100.0, 8
    t = np.linspace(0.0, 10 * half, 81)
    found = events_of(solver, block(), t)
    cycle = np.minimum(t // half, n)
    amplitude = 0.5 - lost / 2 - lost * cycle
    known = (-1.0) ** cycle * (amplitude * np.cos(np.pi * (t / half - cycle)) + lost / 2)
    known = np.where(t >= n * half, 0.5 - lost * n, known)
    assert np.abs(found.arrays()[0][:, 0] - known).max() < 1e-13
    assert np.abs(event_times(found) - half * np.arange(1, n + 1)).max() < 1e-13
    assert found.stuck_at_end == ("x",)
    spring = 50.0 * (0.5**2 - known[-1] ** 2)
    assert abs(found.friction_work[-1] + spring) < 1e-13


@BOTH_SOLVERS
def test_a_pendulum_comes_to_rest_as_the_quadrature_of_its_energy_says(solver):
    """Energy falls by F times the way; the time of a swing is the integral of dq / rate."""
    mass, length, inertia, friction, gravity = 0.5, 0.2, 1e-4, 0.15, 9.81
    model = compiled(f"""{WEIGHT}<worldbody><body><joint name="q" axis="0 0 1"
      frictionloss="{friction}"/><inertial pos="0 -0.2 0" mass="0.5" diaginertia="1e-4 1e-4 1e-4"/>
      </body></worldbody><sensor><jointpos name="q" joint="q"/></sensor>
      <keyframe><key name="start" qpos="2"/></keyframe></mujoco>""")
    weight, whole = mass * gravity * length, inertia + mass * length**2
    turn, turns = 2.0, [0.0]
    while abs(weight * np.sin(turn)) > friction:
        turn, time = swing_once(turn, weight, whole, friction)
        turns.append(turns[-1] + time)
    turns = turns[1:]
    found = events_of(solver, model, np.linspace(0.0, 3.0, 4))
    assert len(turns) == 5
    assert np.abs(event_times(found) - turns).max() < 1e-9
    assert abs(found.states[-1][0][0] - turn) < 1e-12
    # with 50 digits
    assert abs(event_times(found)[-1] - 2.462086854879044) < 2e-14
    assert abs(found.states[-1][0][0] + 0.06874481) < 5e-9


def swing_once(turn: float, weight: float, inertia: float, friction: float) -> tuple[float, float]:
    """The next turning point of a pendulum, and the time to it."""
    sense = -np.sign(turn)

    def energy(q: float) -> float:
        return weight * (np.cos(q) - np.cos(turn)) - friction * sense * (q - turn)

    end = brent(energy, -sense * np.arcsin(friction / weight), 3.0 * sense)
    middle, half = (turn + end) / 2, abs(end - turn) / 2
    # q = middle + half sin(s) takes the roots of the rate at both ends away
    time, _ = quad(
        lambda s: half * np.cos(s) / np.sqrt(2 * energy(middle + half * np.sin(s)) / inertia),
        -np.pi / 2,
        np.pi / 2,
        epsabs=1e-13,
        epsrel=1e-13,
        limit=200,
    )
    return end, time


@BOTH_SOLVERS
def test_an_arm_whose_friction_holds_it_does_not_move_at_all(solver):
    """Weights need 6.13125 and 1.03005 N m, of 8 and 2; with 1.03 N m the elbow gives way."""
    text = """{}<worldbody><body><joint name="shoulder" axis="0 0 -1" frictionloss="8"/>
      <inertial pos="0.2 0 0" mass="1.2" diaginertia="0.02 0.02 0.02"/><body pos="0.4 0 0">
      <joint name="elbow" axis="0 0 -1" frictionloss="{}"/><inertial pos="0.15 0 0" mass="0.7"
      diaginertia="0.008 0.008 0.008"/></body></body></worldbody><sensor><jointpos name="shoulder"
      joint="shoulder"/><jointpos name="elbow" joint="elbow"/></sensor></mujoco>"""
    t = np.linspace(0.0, 10.0, 21)
    found = events_of(solver, compiled(text.format(WEIGHT, 2.0)), t)
    assert not np.any(found.arrays()[0])
    assert not np.any(found.arrays()[1])
    assert not event_times(found).size
    needed = np.array([(1.2 * 0.2 + 0.7 * 0.55) * 9.81, 0.7 * 0.15 * 9.81])
    assert np.abs(found.forces[-1] + needed).max() < 1e-14
    assert np.abs(solve(solver, compiled(text.format(WEIGHT, 1.03)), t)["elbow"][1:]).min() > 1e-4


def test_a_screw_holds_its_load_or_turns_with_constant_acceleration():
    """The weight m g p on the screw needs 0.4905 of its friction."""
    mass, pitch, gravity, inertia = 2.0, 0.005, 9.81, 1e-3
    text = """{}<worldbody><body><joint name="lift" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body><body><joint name="turn"
      axis="0 0 1" frictionloss="{}"/><inertial pos="0 0 0" mass="1"
      diaginertia="0.001 0.001 0.001"/></body></worldbody><equality>
      <joint joint1="lift" joint2="turn" polycoef="0 0.005 0 0 0"/></equality>
      <sensor><jointpos name="turn" joint="turn"/></sensor></mujoco>"""
    weight, t = mass * gravity * pitch, np.linspace(0.0, 1.0, 5)
    held = events_of("spatial", compiled(text.format(HEAD.format("0 0 -9.81"), 0.2)), t)
    assert not np.any(held.arrays()[0])
    assert abs(np.linalg.norm(held.forces[-1]) / 0.2 - 0.4905) < 1e-15
    falls = solve("spatial", compiled(text.format(HEAD.format("0 0 -9.81"), 0.09)), t)["turn"]
    assert np.abs(falls + 0.5 * (weight - 0.09) / (inertia + mass * pitch**2) * t**2).max() < 1e-13


def two_masses() -> mujoco.MjModel:
    """2 kg on a spring of 80 N/m, and 1 kg on one of 120 N/m between them."""
    return compiled(f"""{LEVEL}<worldbody>
      <body><joint name="a" type="slide" axis="1 0 0" stiffness="80" frictionloss="3"/>
        <geom size="0.1" mass="2"/></body>
      <body><joint name="b" type="slide" axis="1 0 0" frictionloss="4"/><geom size="0.1" mass="1"/>
      </body></worldbody><tendon><fixed name="spring" stiffness="120" springlength="0">
        <joint joint="b" coef="1"/><joint joint="a" coef="-1"/></fixed></tendon>
      <sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/></sensor>
      <keyframe><key name="start" qpos="0.1 0.6"/></keyframe></mujoco>""")


@BOTH_SOLVERS
def test_two_masses_stick_and_slip_as_matrix_exponentials_say(solver):
    """Each phase is linear; its events are found by bisection between times on a fine grid."""
    mass, friction = np.array([2.0, 1.0]), np.array([3.0, 4.0])
    stiffness = np.array([[200.0, -120.0], [-120.0, 120.0]])
    times, end = follow_linear(mass, stiffness, friction, np.array([0.1, 0.6]), 3.0)
    found = events_of(solver, two_masses(), np.linspace(0.0, 3.0, 4))
    assert len(times) == 22
    assert np.abs(event_times(found) - times).max() < 1e-12
    assert np.abs(found.states[-1][0] - end).max() < 1e-13
    assert np.abs(end - [-0.01207582, -0.03107024]).max() < 5e-9


def follow_linear(mass, stiffness, friction, q, until) -> tuple[list[float], np.ndarray]:
    """Event times and end of masses on springs with dry friction, by matrix exponentials."""
    n, t, times = mass.size, 0.0, []
    state, senses = np.concatenate([q, np.zeros(n), [1.0]]), np.zeros(n)

    def force(state: np.ndarray) -> np.ndarray:
        return -stiffness @ state[:n]

    def start(state: np.ndarray, senses: np.ndarray) -> np.ndarray:
        breaks = (senses == 0) & (np.abs(force(state)) > friction * (1.0 + 1e-12))
        return np.where(breaks, np.sign(force(state)), senses)

    senses = start(state, senses)
    while True:
        moves = senses != 0
        flow = np.zeros((2 * n + 1, 2 * n + 1))
        flow[:n, n : 2 * n] = np.diag(1.0 * moves)
        flow[n : 2 * n, :n] = -stiffness * (moves / mass)[:, None]
        flow[n : 2 * n, -1] = -senses * friction / mass

        def reserve(time: float, state=state, flow=flow, senses=senses, moves=moves) -> np.ndarray:
            later = expm(flow * time) @ state
            rates, held = senses * later[n : 2 * n], 1.0 - np.abs(force(later)) / friction
            return np.where(moves, rates, held)

        grid = np.linspace(0.0, until - t, 401)
        first, when = -1, np.inf
        values = np.array([reserve(time) for time in grid])
        for k in range(n):
            positive = np.flatnonzero(values[:, k] > 1e-12)
            begin = positive[0] if positive.size else grid.size
            later = np.flatnonzero((np.arange(grid.size) > begin) & (values[:, k] < 0))
            if later.size:
                root = brent(lambda time, k=k: reserve(time)[k], grid[later[0] - 1], grid[later[0]])
                first, when = (k, root) if root < when else (first, when)
        if first < 0:
            return times, (expm(flow * (until - t)) @ state)[:n]
        t, state = t + when, expm(flow * when) @ state
        times.append(t)
        if moves[first]:
            state[n + first], senses = 0.0, np.where(np.arange(n) == first, 0.0, senses)
        else:
            pushed = np.sign(force(state)[first])
            senses = np.where(np.arange(n) == first, pushed, senses)
            continue
        senses = start(state, senses)


@BOTH_SOLVERS
def test_a_joint_that_sticks_has_no_rate_after_an_impact_only_if_friction_had_an_impulse(solver):
    """Rates after the impact follow from momentum alone: the shoulder, which stuck, is let go."""
    arm = """{}<worldbody><body><joint name="shoulder" axis="0 0 1" frictionloss="8"/>
      <inertial pos="0.2 0 0" mass="1.2" diaginertia="0.02 0.02 0.02"/><body pos="0.4 0 0">
      <joint name="elbow" axis="0 0 1" range="-0.5 9" solreflimit="0.01 1e-9"/><inertial
      pos="0.15 0 0" mass="0.7" diaginertia="0.008 0.008 0.008"/></body></body></worldbody>
      <keyframe><key name="start" qpos="0 0" qvel="0 -5.25156618"/></keyframe></mujoco>"""
    hit = 0.5 / 5.25156618  # nothing moves but the elbow, at a constant rate
    motion = events_of(solver, compiled(arm.format(LEVEL)), np.array([0.0, hit - 1e-9, hit + 1e-9]))
    reach = 0.4 * 0.15 * 0.7 * np.cos(0.5)
    fore = 0.008 + 0.7 * 0.15**2
    both = 0.02 + 1.2 * 0.2**2 + 0.7 * 0.4**2 + fore + 2 * reach
    # momentum of the shoulder: both v1 + (fore + reach) v2 is kept
    shoulder = -2 * 5.25156618 * (fore + reach) / both
    (_, before, _), (_, after, _) = motion.states[1:]
    assert not before[0]
    assert np.abs(after - [shoulder, 5.25156618]).max() < 1e-5  # friction acts for 1e-9 s
    assert abs(shoulder + 2.29425087) < 1e-8


# --- motions that others integrate


@cache
def followed(seed: int, stops: str) -> tuple:
    """A random chain, its model, and its motion by the witness."""
    chain = random_chain(seed, stops=bool(stops))
    chain.ratio = {"rest": 1e9, "rebound": 0.3}.get(stops, 1.0)
    own = restitution(chain.ratio) if stops != "rest" else 0.0
    chain.stops = [(joint, side, value, own) for joint, side, value, _ in chain.stops]
    return compiled(chain_model(chain)), friction_witness.follow(chain, 1.0)


CHAINS = [
    *[(seed, "") for seed in range(20)],
    *[(seed, "rest") for seed in range(100, 112)],
    *[(seed, "rebound") for seed in (100, 101, 102, 104, 106, 108, 109, 110)],
]


@BOTH_SOLVERS
@pytest.mark.parametrize(("seed", "stops"), CHAINS)
def test_random_chains_have_the_events_of_an_ode_with_all_patterns_tried(solver, seed, stops):
    """Two to four joints that all rub, on springs with dampers, some with a stop."""
    model, known = followed(seed, stops)
    found = events_of(solver, model, np.linspace(0.0, 1.0, 11))
    times = np.array(sorted({time for time, _ in known.events}))
    assert len(times) > 1
    assert event_times(found).shape == times.shape
    assert np.abs(event_times(found) - times).max() < 1e-9
    assert np.abs(found.states[-1][0] - known.q).max() < 1e-9


@pytest.mark.parametrize("seed", [202, 204, 205, 209, 213, 215])
def test_both_references_meet_stops_of_all_joints_at_the_same_times(seed):
    """The terms of their equations have nothing in common; some joints begin on their stops."""
    random, chain = np.random.default_rng(seed), random_chain(seed, damped=False)
    chain.ratio = 1e9 if seed % 2 else 0.4
    ways = random.uniform(0.0, 0.5, chain.start.size)
    ways[random.uniform(size=ways.size) < 0.2] = 0.0
    ends = enumerate((chain.start + ways).tolist())
    chain.stops = [(joint, 1.0, end, 0.0) for joint, end in ends]
    model, t = compiled(chain_model(chain)), np.linspace(0.0, 1.0, 11)
    one, two = (events_of(solver, model, t) for solver in SOLVERS)
    assert event_times(one).size > 3
    assert np.abs(event_times(one) - event_times(two)).max() < 1e-10
    assert np.abs(one.arrays()[0] - two.arrays()[0]).max() < 1e-10
    assert one.rested == two.rested


@BOTH_SOLVERS
@pytest.mark.parametrize("seed", range(30, 40))
def test_energy_falls_by_the_work_of_friction(solver, seed):
    """Without dampers and stops; the energies are those of sensors."""
    model = compiled(chain_model(random_chain(seed, damped=False)))
    t = np.linspace(0.0, 1.0, 41)
    curves = solve(solver, model, t, **SOURCES[solver](model))
    energy = curves["potential"] + curves["kinetic"]
    work = np.array(events_of(solver, model, t).friction_work)
    assert work[-1] < -1e-3
    assert (np.diff(work) <= 1e-15).all()
    assert np.abs(energy - energy[0] - work).max() < 1e-10


# --- loops


def slider_crank_model(crank: float) -> mujoco.MjModel:
    """The shipped slider-crank, let go from a crank angle."""
    model = mujoco.MjModel.from_xml_path(str(shipped("slider_crank_released.xml")))
    coupler = -np.arcsin(np.sin(crank) / 3)
    slider = 0.1 * np.cos(crank) + 0.3 * np.cos(coupler) - 0.4
    model.key_qpos[0] = [crank, coupler - crank, slider]
    return model


def bar(joint: str, length: float, mass: float, friction: float = 0.0) -> str:
    """A joint with friction, and the inertia of a uniform bar."""
    inertia = " ".join([repr(mass * length**2 / 12)] * 3)
    return f"""<joint name="{joint}" axis="0 0 1" frictionloss="{friction}"/>
      <inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="{inertia}"/>"""


def four_bar_model(crank: float) -> mujoco.MjModel:
    coupler, rocker = four_bar_angles(crank)
    return compiled(f"""{WEIGHT}<worldbody><body>{bar("crank", 0.1, 0.4)}
      <body pos="0.1 0 0">{bar("coupler", 0.28, 0.7, 0.02)}<site name="one" pos="0.28 0 0"/></body>
      </body><body pos="0.3 0 0">{bar("rocker", 0.24, 0.5, 0.03)}<site name="two" pos="0.24 0 0"/>
      </body></worldbody><equality><connect site1="one" site2="two"/></equality><sensor>
      <jointpos name="crank" joint="crank"/></sensor><keyframe>
      <key name="start" qpos="{crank} {coupler - crank} {rocker}"/></keyframe></mujoco>""")


@BOTH_SOLVERS
@pytest.mark.parametrize(
    ("make", "linkage", "start", "until"),
    [
        (slider_crank_model, slider_crank(), 0.3, 1.5),
        (slider_crank_model, slider_crank(), 1.2, 1.5),
        (four_bar_model, four_bar(), 1.0, 1.5),
        (four_bar_model, four_bar(), 2.5, 1.5),
    ],
    ids=["slider-crank 0.3", "slider-crank 1.2", "four-bar 1.0", "four-bar 2.5"],
)
def test_linkages_halt_when_an_equation_in_one_coordinate_says(solver, make, linkage, start, until):
    """Joints halt together, pass their own dead points, and stick together at the end."""
    known, end = follow_one(linkage, start, until)
    found = events_of(solver, make(start), np.array([0.0, until]))
    assert len(known) > 2
    assert event_times(found).shape == np.shape(known)
    assert np.abs(event_times(found) - known).max() < 1e-10
    assert abs(found.states[-1][0][0] - end) < 1e-10


FIVE_BAR = 2.0, 1.0
"""Angles of the two cranks."""


def five_bar() -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """A five-bar with friction at four pins: model, rates of the pins and of V by the cranks."""
    one, two = (0.1 * np.exp(1j * angle) for angle in FIVE_BAR)
    way = 0.25 + two - one
    up = np.angle(way) + np.arccos(abs(way) / 0.4)
    left, right = 0.2 * np.exp(1j * up), one + 0.2 * np.exp(1j * up) - 0.25 - two
    rows = np.array(
        [[(1j * left).real, -(1j * right).real], [(1j * left).imag, -(1j * right).imag]]
    )
    cranks = np.array([[(-1j * one).real, (1j * two).real], [(-1j * one).imag, (1j * two).imag]])
    bars = np.linalg.solve(rows, cranks)  # rates of the upper bars by those of the cranks
    pins = np.array([[1, 0], bars[0] - [1, 0], [0, 1], bars[1] - [0, 1]])
    heights = 0.3 * 0.5 * np.array([(1j * one).imag, (1j * two).imag])
    heights = heights + 0.5 * (np.array([(1j * one).imag, 0]) + 0.5 * (1j * left).imag * bars[0])
    heights = heights + 0.5 * (np.array([0, (1j * two).imag]) + 0.5 * (1j * right).imag * bars[1])
    angles = [2.0, up - 2.0, 1.0, np.angle(right) - 1.0]

    model = compiled(f"""{WEIGHT}<worldbody><body>{bar("a", 0.1, 0.3, 0.5)}
      <body pos="0.1 0 0">{bar("b", 0.2, 0.5, 0.15)}<site name="one" pos="0.2 0 0"/></body></body>
      <body pos="0.25 0 0">{bar("c", 0.1, 0.3, 0.55)}
      <body pos="0.1 0 0">{bar("d", 0.2, 0.5, 0.12)}<site name="two" pos="0.2 0 0"/></body></body>
      </worldbody><equality><connect site1="one" site2="two"/></equality><actuator>
      <motor name="on_a" joint="a"/><motor name="on_c" joint="c"/></actuator><keyframe>
      <key name="start" qpos="{" ".join(map(repr, map(float, angles)))}"/></keyframe></mujoco>""")
    return model, pins, 9.81 * heights


@BOTH_SOLVERS
def test_four_pins_of_a_five_bar_break_loose_when_a_ray_of_its_motions_says(solver):
    """Two degrees of freedom: the first of the motions in which one pin does not turn begins."""
    model, pins, weight = five_bar()
    friction = np.array([0.5, 0.15, 0.55, 0.12])
    loads = {"on_a": sine(1.3, 4.0), "on_c": sine(0.9, 6.3)}

    def power(t: float, way: np.ndarray) -> float:
        pushed = np.array([loads["on_a"](t)[0], loads["on_c"](t)[0]]) - weight
        return float(pushed @ way - friction @ np.abs(pins @ way))

    ways = [sense * np.array([-row[1], row[0]]) for row in pins for sense in (1, -1)]
    known = min(brent(lambda t, w=w: power(t, w), 0.0, 0.3) for w in ways if power(0.3, w) > 0)
    assert abs(known - 0.023769196106634) < 1e-14
    found = events_of(solver, model, np.linspace(0.0, 0.03, 4), controls=loads)
    assert abs(event_times(found)[0] - known) < 1e-13
    assert len(found.slips) == 3
    at_rest = np.isnan(found.forces[0])
    assert at_rest.all()  # of four pins that stick only two sums of moments are determined


def sine(size: float, frequency: float):
    """A control that follows a sine."""
    return partial(sine_profile, size, frequency)


def sine_profile(size: float, w: float, t):
    return size * np.sin(w * t), size * w * np.cos(w * t), -size * w * w * np.sin(w * t)


# --- traps


@BOTH_SOLVERS
@pytest.mark.parametrize(("share", "slips"), [(1.0 - 1e-9, 0), (1.0 + 1e-7, 2)])
def test_a_block_breaks_loose_at_a_peak_of_its_load_however_short(solver, share, slips):
    """A mechanism that sticks has no error: only the length of its steps finds the peak."""
    text = f"""{LEVEL}<worldbody><body><joint name="x" type="slide" axis="1 0 0"
      frictionloss="3"/><geom size="0.1" mass="2"/></body></worldbody><actuator>
      <motor name="push" joint="x"/></actuator></mujoco>"""
    loads = {"push": sine(3.0 * share, 2.0)}
    found = events_of(solver, compiled(text), np.linspace(0.0, 3.0, 4), controls=loads)
    assert len(found.slips) == slips
    if slips:
        first = np.arcsin(1.0 / share) / 2.0
        assert abs(found.slips[0][0] - first) < 1e-9
    else:
        assert not np.any(found.arrays()[0])


@BOTH_SOLVERS
def test_a_joint_with_friction_at_a_dead_point_at_rest_is_refused(solver):
    """The slider of a slider-crank with its crank at 0: friction has no effect there."""
    model = slider_crank_model(0.0)
    with pytest.raises(SingularHere, match="'slider' with friction"):
        solve(solver, model, np.array([0.0, 0.5]))


def test_friction_of_a_ball_is_refused():
    model = compiled(f"""{LEVEL}<worldbody><body><joint name="ball" type="ball" frictionloss="1"/>
      <geom size="0.1"/></body></worldbody></mujoco>""")
    with pytest.raises(NotCovered, match="frictionloss of joint 'ball', which is a ball joint"):
        solve("spatial", model, np.array([0.0, 1.0]))


def test_both_references_have_the_moments_of_drives_against_friction():
    """In a sweep, at rest and with inertia, where drives determine all joints."""
    model = mujoco.MjModel.from_xml_path(str(shipped("slider_crank_friction.xml")))
    turn = np.linspace(0.3, 2.0, 9)
    turn = np.concatenate([turn, turn[-2::-1]])
    rate = np.where(np.arange(17) < 9, 1.5, -1.5)
    for inertia in (False, True):
        asked = {"model": model, "joints": ("crank",), "inertia": inertia}
        one, two = (one.solve(turn, rate, 0.5, **asked) for one in (planar, spatial))
        forces = [name for name in two if "moment" in name or "force" in name]
        assert forces == ["holding_moment"]
        for name in forces:
            assert np.abs(one[name] - two[name]).max() < 1e-11 * np.abs(one[name]).max(), name
