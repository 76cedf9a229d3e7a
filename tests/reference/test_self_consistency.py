"""Self-consistency of models without a sidecar: how well synthetic motions are known, and how long.

`Rung` draws its conclusions from several solutions of a motion by three criteria: `steps`, `close`
and `disturbed`, see `proofmass.reference.self_consistency`.
"""

import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from proofmass.batch.check import check
from proofmass.batch.work import check_model_here
from proofmass.reference.self_consistency import (
    AGREEMENT_SHARE,
    Rung,
    choose_cheaper,
    why_failed,
)
from proofmass.sim.model_source import ModelSource
from proofmass.sim.protocol.own_equations import OwnMotion, OwnRun, UntriedWay
from proofmass.verdict.outcome import Outcome

TIMES = np.linspace(0.0, 1.0, 101)
STEPS = [2e-3 / 2**k for k in range(7)]
SIZE = 2.0  # m
ERROR_RATE = 0.05  # error per second of motion with a step of 2 ms [m/s]


def make_run(error, name="Euler, 2 ms", step=2e-3, seconds=1.0, **changed):
    """A run of a body that moves along x at 1 m/s, with an error [m] at each time."""
    points = np.zeros((TIMES.size, 1, 3, 3))
    points[:, 0, :, 0] = (TIMES + error)[:, None]
    if step:
        changed = {"evaluations": (4 if name.startswith("RK4") else 1) / step, **changed}
    return OwnRun(name, step, seconds, points, TIMES, 0 * TIMES, 0 * TIMES, **changed)


def make_motion(order=1.0, spread=0.0, **changed):
    """A motion that is solved in several ways.

    Its steps converge with an order, DOP853 has an error of 1e-10 m/s, and a disturbance grows as
    exp(spread t), with `spread` in 1/s.
    """
    runs = tuple(
        make_run(
            ERROR_RATE * TIMES * (step / 2e-3) ** order, f"Euler, {1e3 * step:.4g} ms", step, 2.0**k
        )
        for k, step in enumerate(STEPS)
    )
    disturbed = make_run(runs[4].points[:, 0, 0, 0] - TIMES + 1e-9 * SIZE * np.exp(spread * TIMES))
    solved = OwnMotion(
        TIMES,
        SIZE,
        runs,
        make_run(1e-10 * TIMES, "DOP853 at 1e-9", 0.0),
        make_run(1e-7 * TIMES, "DOP853 at 1e-6", 0.0),
        4,
        disturbed,
        (make_run(1e-4 * TIMES, "RK4, 2 ms", seconds=3.0),),
        None,
        1,
    )
    return replace(solved, **changed)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_a_motion_that_converges_is_known_to_its_end(order):
    """The error, the uncertainty, the cheapest better setting and the words of a good motion."""
    rung = Rung(make_motion(order))
    assert rung.until == 1.0
    assert rung.order == pytest.approx(order, abs=0.01)
    assert rung.error(rung.motion.runs[0]) == pytest.approx(ERROR_RATE, rel=1e-6)
    assert rung.known == pytest.approx(ERROR_RATE / 2 ** (6 * order), rel=1e-5)
    better = rung.better()
    assert (better.name, better.times) == ("RK4, 2 ms", 4.0)
    assert "RK4, 2 ms: 100 µm in 4 × the evaluations" in rung.words()
    (cheaper,) = [rung.motion.others[0]]
    coarse = replace(rung.motion, others=(replace(cheaper, evaluations=1e9),))
    assert Rung(coarse).better().name == ("Euler, 0.125 ms" if order == 1 else "Euler, 0.5 ms")
    few = replace(coarse, runs=coarse.runs[:2], compared=1, others=())
    assert Rung(few).better().name == "Euler, 1 ms"
    words = rung.words()
    known = "781 µm" if order == 1 else "12 µm"
    beginning = f"until 1 s, its end, off by 50 mm, known to {known}, as it is (Euler, 2 ms). Steps"
    assert words.startswith(beginning)
    assert f"converge with order {order:g}, DOP853 at 1e-9 agrees with the finest and" in words


def test_loops_that_are_open_at_the_start_are_reported():
    """A key in degrees leaves loops open, which then close by a jerk that can be solved closely."""
    motion = make_motion()
    own = motion.runs[0]
    opened = replace(motion, runs=(replace(own, gap=0 * TIMES + 0.9), *motion.runs[1:]))
    assert "Its loops are open by 0.9 m or rad at the start" in Rung(opened).words()
    angle = replace(own, gap=0 * TIMES + 1.5e-3, opening_unit="rad")  # its size is 2 m
    turned = Rung(replace(motion, runs=(angle, *motion.runs[1:])))
    assert "Its loops are open by 1.5e-3 rad at the start" in turned.words()
    closed = replace(motion, runs=(replace(own, gap=0 * TIMES + 1e-5), *motion.runs[1:]))
    assert "open" not in Rung(closed).words()


def test_the_cost_of_a_setting_is_no_time():
    own = make_motion()
    slow = tuple(replace(one, seconds=1e3 * one.seconds) for one in own.runs)
    assert Rung(replace(own, runs=slow)).words() == Rung(own).words()
    uncounted = tuple(replace(one, evaluations=np.nan) for one in own.runs)
    rung = Rung(replace(own, runs=uncounted))
    assert f"{rung.better().name}: " in rung.words()
    assert "the evaluations" not in rung.words()


def untried(name, order, error=ERROR_RATE, seconds=1.0, tried=None):
    """Ways with an integrator of an order, from the model's own step to 1/64 of it."""
    stages = 4 if name == "RK4" else 1

    def way(step):
        def solve(limit):
            if tried is not None:
                tried.append((name, 1e3 * step, limit))
            off = error * TIMES * (step / 2e-3) ** order
            return make_run(off, f"{name}, {1e3 * step:g} ms", step, work=0.3)

        return UntriedWay(stages / step, solve, seconds)

    return [way(step) for step in STEPS]


def test_the_cheapest_way_in_evaluations_is_found_without_trying_dearer_ones():
    # the model's own RK4 is of first order, as contacts leave it: half the step for half the error
    tried = list[tuple[str, float, float]]()
    own = make_motion(others=())
    runs = tuple(replace(one, evaluations=4 / one.step) for one in own.runs)
    contacts = replace(own, runs=runs)
    assert Rung(contacts).better().times == 16
    ways = untried("Euler", 1.0, seconds=1e3, tried=tried)
    found = replace(contacts, others=choose_cheaper(contacts, ways))
    better = Rung(found).better()
    assert (better.name, better.times) == ("Euler, 0.125 ms", 4.0)
    # 1, 2, 4, .. evaluations in the time of an own step with 4; none after the one that is enough
    assert [step for _, step, _ in tried] == [2.0, 1.0, 0.5, 0.25, 0.125]


def test_without_contacts_rk4_is_advised_since_its_order_pays():
    own, tried = make_motion(others=()), list[tuple[str, float, float]]()
    ways = [*untried("RK4", 4.0, 1e-4, 1e3, tried), *untried("implicitfast", 1.0, tried=tried)]
    better = Rung(replace(own, others=choose_cheaper(own, ways))).better()
    assert (better.name, better.times) == ("RK4, 2 ms", 4.0)
    assert [name for name, *_ in tried] == ["implicitfast"] * 2 + ["RK4"]


def test_ways_are_tried_in_the_time_that_there_is_and_only_if_an_error_is_known():
    own, tried = make_motion(others=()), list[tuple[str, float, float]]()
    ways = untried("Euler", 1.0, seconds=0.5, tried=tried)
    assert len(choose_cheaper(own, ways)) == 2  # each counts 0.3 s
    assert [limit for *_, limit in tried] == [0.5, pytest.approx(0.2)]
    assert choose_cheaper(replace(own, runs=own.runs[-1:] * 7), ways) == ()
    assert choose_cheaper(make_motion(dof=0), ways) == ()


def test_a_chaotic_motion_is_known_until_disturbance_and_steps_diverge():
    """The differences of steps and the disturbance grow as e^(30 t): 1e-9 is 1e-3 after 0.46 s."""
    own = make_motion(spread=30.0)
    grown = np.exp(30.0 * TIMES)
    off = [make_run(1e-9 * SIZE * grown * 2.0**-k, step=step) for k, step in enumerate(STEPS)]
    disturbed = make_run(off[4].points[:, 0, 0, 0] - TIMES + 1e-9 * SIZE * grown)
    rung = Rung(replace(own, runs=tuple(off), disturbed=disturbed))
    last = (
        np.log(AGREEMENT_SHARE / 1e-9 * 2**5) / 30.0
    )  # where the two finest steps differ by too much
    assert rung.until == pytest.approx(last, abs=0.03)
    assert "a disturbance of 1e-9 has grown" in rung.words()
    assert rung.growth == pytest.approx(np.exp(30.0), rel=1e-6)


def test_a_wrong_solution_of_dop853_is_not_used():
    """DOP853 stops moving at a force jump at 0.5 s with both of its error allowances.

    Its two solutions agree with each other, but not with the steps, which are used instead.
    """
    stuck = np.where(TIMES > 0.5, 0.5 - TIMES, 0.0)
    own = make_motion(
        close=make_run(stuck, "DOP853 at 1e-9"), rough=make_run(stuck, "DOP853 at 1e-6")
    )
    rung = Rung(own)
    assert rung.until == 1.0
    assert rung.best is own.runs[-1]
    assert rung.error(own.runs[0]) == pytest.approx(ERROR_RATE * (1 - 2**-6), rel=1e-6)
    assert rung.known == pytest.approx(ERROR_RATE * 2**-6, rel=0.02)
    assert "DOP853" not in rung.words()


def test_a_motion_is_known_until_its_steps_no_longer_converge():
    """From 0.3 s on each step has a random error of up to 1 cm, although nothing is chaotic.

    The disturbance grows 500 times only.
    """
    chosen = np.random.default_rng(1)
    late = TIMES > 0.3
    runs = tuple(
        make_run(1e-6 * step + late * chosen.uniform(-1e-2, 1e-2), step=step) for step in STEPS
    )
    near = make_run(runs[4].points[:, 0, 0, 0] - TIMES + 500 * 1e-9 * SIZE * late)
    rung = Rung(make_motion(runs=runs, disturbed=near))
    assert rung.until == pytest.approx(0.3)
    assert "do not converge there, though a disturbance grows 500 times only" in rung.words()


def test_one_of_three_criteria_is_not_enough():
    """A motion is known if two of the criteria `steps`, `close` and `disturbed` are met."""
    stuck = make_run(0.1 * TIMES, "DOP853 at 1e-9")
    far = make_run(0.2 * TIMES)
    assert Rung(make_motion(close=stuck, rough=stuck)).until == 1.0
    assert Rung(make_motion(disturbed=far)).until == 1.0
    rung = Rung(make_motion(close=stuck, rough=stuck, disturbed=far))
    assert rung.until < 0.03
    apart = make_run(0.1 + TIMES, "DOP853 at 1e-9")
    none = Rung(replace(rung.motion, close=apart, rough=apart, disturbed=make_run(0.2 + TIMES)))
    assert not none.consistent
    assert none.words().startswith("no two ways of solving its motion agree at any time: ")


def test_a_solution_of_dop853_that_contradicts_itself_does_not_count():
    """DOP853 agrees with the steps with its narrow error allowance, but not with its wide one.

    The disturbed start leads elsewhere too, so that only one criterion is met.
    """
    own = make_motion(
        rough=make_run(0.1 + TIMES, "DOP853 at 1e-6"), disturbed=make_run(0.2 + TIMES)
    )
    assert not Rung(own).consistent


def test_small_differences_of_steps_that_do_not_fall_do_not_count():
    """Every other step is 0.4 mm ahead, with a size of 2 m, and DOP853 leads elsewhere."""
    runs = tuple(make_run(4e-4 * (-1) ** k + 0 * TIMES, step=step) for k, step in enumerate(STEPS))
    stuck = make_run(0.1 + TIMES)
    rung = Rung(make_motion(runs=runs, close=stuck, rough=stuck, disturbed=runs[4]))
    assert not rung.consistent
    assert "finer steps do not converge there" in rung.words()


def test_finer_steps_that_lead_to_another_motion_do_not_count():
    """The runs with the two finest steps do not move, nor does the one with a disturbed start."""
    own = make_motion()
    unmoving = [replace(make_run(-TIMES), step=step) for step in STEPS[5:]]
    apart = make_run(0.1 + TIMES)
    frozen = replace(own, runs=(*own.runs[:5], *unmoving), compared=6, disturbed=unmoving[-1])
    rung = Rung(replace(frozen, close=apart, rough=apart))
    assert rung.until <= 0.01
    assert "finer steps do not converge there" in rung.words()


def test_an_error_that_vanishes_again_is_reported():
    """The error of a run is the largest one until T, not the one at T."""
    own = make_motion()
    there_and_back = replace(make_run(ERROR_RATE * np.sin(np.pi * TIMES)), name="Euler, 2 ms")
    rung = Rung(replace(own, runs=(there_and_back, *own.runs[1:])))
    assert rung.error(there_and_back) == pytest.approx(ERROR_RATE, rel=1e-6)


def test_softness_of_contacts_is_reported_if_it_exceeds_the_step_error():
    assert "as stiff move it by 200 mm" in Rung(make_motion(stiffer=stiffer_run(0.2))).words()
    assert "as stiff" not in Rung(make_motion(stiffer=stiffer_run(1e-6))).words()
    # above the uncertainty of 0.8 mm, and below the error of 50 mm
    assert "as stiff" not in Rung(make_motion(stiffer=stiffer_run(1e-2))).words()


def stiffer_run(error):
    """A run with stiffer contacts, with an error [m/s] to the run that it is compared with."""
    return make_run(make_motion().runs[4].points[:, 0, 0, 0] - TIMES + error * TIMES, "stiffer")


def cut_run(one, samples, **changed):
    """The run, cut to its first samples."""
    own = {name: getattr(one, name)[:samples] for name in ("points", "energy", "depth", "gap")}
    return replace(one, **own, **changed)


def test_a_motion_that_takes_too_long_is_known_as_far_as_computed():
    own = make_motion()
    runs = own.runs[0], *(cut_run(one, 31) for one in own.runs[1:4])
    rung = Rung(replace(own, runs=runs, compared=3))
    assert rung.until == pytest.approx(0.3)
    assert "no more was followed in the time that there is" in rung.words()


def test_a_failed_run_is_reported_with_its_reason_and_time():
    own = make_motion()
    failed = cut_run(own.runs[0], 11, stopped="MuJoCo warning badqacc")
    assert (
        why_failed(replace(own, runs=(failed, *own.runs[1:])))
        == "MuJoCo warning badqacc, after 0.1 s"
    )
    late = cut_run(own.runs[0], 11, stopped="its wall time was over", late=True)
    assert not why_failed(replace(own, runs=(late, *own.runs[1:])))
    assert not why_failed(own)
    never = cut_run(own.runs[0], 1, stopped="its wall time was over", late=True)
    assert why_failed(replace(own, runs=(never,))) == "its wall time was over, after 0 s"
    finest = cut_run(own.runs[-1], 31, stopped="not finite")
    rung = Rung(replace(own, runs=(*own.runs[:-1], replace(finest, name="Euler, 31 us"))))
    assert rung.until == pytest.approx(0.3)
    assert "Euler, 31 us fails: not finite" in rung.words()


def test_a_rotation_of_one_body_alone_is_detected():
    """A body differs by a rotation: one of its three points is elsewhere, but its centre is not."""
    own = make_motion()
    turned = np.array(own.runs[-1].points)
    turned[50:, 0, 2, 1] += 0.1 * SIZE
    worse = replace(own, close=replace(own.close, points=turned), disturbed=make_run(0.1 * TIMES))
    assert Rung(worse).until < 0.5


FALLING_BALL = """<mujoco><option timestep="0.004"/><worldbody>
  <body name="ball" pos="0 0 10"><freejoint/><geom size="0.1"/></body>
</worldbody></mujoco>"""
WALL = '<geom type="plane" size="1 1 1" pos="0 0 {}"/>'


def test_a_falling_ball_is_self_consistent_with_the_error_of_euler(tmp_path):
    """Euler's method has an error of g t dt / 2: 20 mm after 1 s with steps of 4 ms.

    RK4 is recommended instead: it is exact under constant acceleration, except for rounding.
    """
    file = tmp_path / "ball.xml"
    file.write_text(FALLING_BALL)
    result = check([file])
    (found,) = result.comparisons
    assert found.outcome == Outcome.SELF_CONSISTENT
    assert result.exit_code == 0
    assert found.at == pytest.approx(1.0, abs=0.01)
    assert found.error_max == pytest.approx(9.81 * found.at * 4e-3 / 2, rel=1e-6)
    ((way, error),) = re.findall(r"\. (\w+, \S+ ms): (\S+) nm in 4 × the ev", found.message)
    assert way == "RK4, 4 ms"
    assert 0.0 < float(error) < 1e-3  # 250 steps, each rounds a height of 10 m by 2e-15 m


LANDING_BOX = """<mujoco><option timestep="0.003" integrator="{}"/><worldbody>
  <geom type="plane" size="3 3 1"/><body pos="0 0 0.3"><freejoint/>
  <geom type="box" size="0.1 0.1 0.1" mass="1"/></body></worldbody>
  <keyframe><key qpos="0 0 0.3 1 0 0 0" qvel="0.5 0 0 0 1 0"/></keyframe></mujoco>"""


def test_with_contacts_steps_of_one_evaluation_are_cheaper_than_rk4(tmp_path):
    """Contacts leave RK4 at first order: it needs 1/16 of the step, and Euler 1/32."""
    file = tmp_path / "box.xml"
    file.write_text(LANDING_BOX.format("RK4"))
    (found,) = check([file]).comparisons
    step, error, times = re.search(
        r"Euler, (\S+) ms: (\S+) µm in (\S+) × the evaluations", found.message
    ).groups()
    assert (float(step), float(times)) == (3.0 / 32, 8.0)
    assert 1e-6 * float(error) <= 0.1 * found.error_max
    # the program of the advice, beside RK4 that costs as much, in bare MuJoCo
    true, euler, rk4 = (
        fall(integrator, 3e-3 / parts)
        for integrator, parts in (("RK4", 256), ("Euler", 32), ("RK4", 8))
    )
    assert np.abs(euler - true).max() < np.abs(rk4 - true).max()


def fall(integrator, step):
    """The places (100, 3) of the box each 9 ms in bare MuJoCo."""
    model = mujoco.MjModel.from_xml_string(LANDING_BOX.format(integrator))
    model.opt.timestep = step
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    places = []
    for _ in range(100):
        mujoco.mj_step(model, data, round(9e-3 / step))
        places.append(data.xipos[1].copy())
    return np.array(places)


def test_a_model_that_diverges_is_reported(tmp_path):
    """The model has a spring that is too stiff for its step."""
    file = tmp_path / "spring.xml"
    file.write_text(
        '<mujoco><option timestep="0.1" integrator="RK4"/><worldbody><body><joint name="j" '
        'type="slide" axis="1 0 0" stiffness="1e5"/><geom size="0.1"/></body></worldbody>'
        '<keyframe><key qpos="0.1"/></keyframe></mujoco>'
    )
    (found,) = check([file]).comparisons
    assert found.outcome == Outcome.DIVERGED
    assert "MuJoCo warning" in found.message


def interrupted_run() -> OwnRun:
    """The run of DOP853, which chooses its steps, ended by its time at the third sample."""
    way = make_run(0.0 * TIMES, "DOP853 at 1e-9", 0.0)
    return replace(way, points=way.points[:3], stopped="out of time", late=True)


def test_differences_that_fall_faster_than_their_order_do_not_count():
    """Differences that fall with order 2.3 do not show convergence; those of order 1 do.

    A trampoline in MuJoCo has differences of order 2.9: its error is 3 mm, while they indicate
    0.2 mm.  Differences that fall with order 0.5 show no convergence either.
    """
    early = interrupted_run()
    for order in (0.5, 2.3, 2.9):
        rung = Rung(make_motion(order, close=early, rough=early))
        assert rung.until <= 0.02  # where DOP853 ended
        assert "finer steps do not converge there" in rung.words()
    assert Rung(make_motion(1.0, close=early, rough=early)).until == 1.0


def test_a_motion_known_by_steps_alone_has_the_error_of_the_last_ones():
    """The error is not extrapolated with the order of 2 that the steps show: it may not last."""
    early = interrupted_run()
    rung = Rung(make_motion(2.0, close=early, rough=early))
    assert rung.order == pytest.approx(2.0, abs=0.01)
    assert rung.known == pytest.approx(float(rung.differences[-1][-1]))


def test_a_run_that_ends_before_the_others_has_no_error_and_no_softness():
    """It is as exact as the best one until it ends, and is not recommended."""
    short = make_run(1e-10 * TIMES, "RK4, 2 ms")
    short = replace(short, points=short.points[:5])
    rung = Rung(make_motion(others=(short,), stiffer=short))
    assert rung.whole_run
    assert rung.error(short) == np.inf
    assert np.isnan(rung.softness)
    assert rung.better().name != short.name


def test_the_solution_that_others_are_compared_with_is_not_recommended():
    """DOP853 leads elsewhere, so that the finest step is the best and has no error."""
    apart = make_run(0.1 + TIMES)
    own = make_motion(order=2.0)
    rung = Rung(replace(own, close=apart, rough=apart, others=(), runs=own.runs[-4:], compared=3))
    assert rung.best is rung.fine
    slow = replace(rung.fine, evaluations=1e-3)  # the cheapest by far
    runs = (*rung.motion.runs[:-1], slow)
    assert Rung(replace(rung.motion, runs=runs)).better().name != slow.name


def rounded_motion(share, **changed):
    """A motion whose steps differ by shares of its size that neither fall nor converge."""
    off = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 6.0, 9.0])  # differences of 1, 5 and 3
    runs = tuple(
        make_run(share * SIZE * error * TIMES, step=step)
        for step, error in zip(STEPS, off, strict=True)
    )
    same = make_run(runs[4].points[:, 0, 0, 0] - TIMES)
    return make_motion(runs=runs, disturbed=same, **changed)


def test_differences_that_are_only_rounding_need_not_fall():
    """Differences up to `ROUNDING_SHARE` of the size are rounding, larger ones are not.

    They grow in time: the second one is 5e-9 of the size after 1 s, and above 1e-9 from 0.2 s on.
    The uncertainty is the rest of a series whose terms fall by `MIN_FALL`, the least that counts.
    """
    apart = make_run(0.1 + TIMES, "DOP853 at 1e-9")
    rung = Rung(rounded_motion(1e-10, close=apart, rough=apart))
    assert rung.until == 1.0
    assert np.isnan(rung.order)
    assert rung.known == pytest.approx(3e-10 * SIZE / 0.6, rel=1e-5)  # rounding of 1 m: 2e-16 m
    larger = Rung(rounded_motion(1e-9, close=apart, rough=apart))
    assert larger.until == pytest.approx(0.2, abs=0.011)  # a sample


def test_the_solution_of_dop853_is_right_until_it_differs_from_the_steps():
    """DOP853 stops moving at 0.5 s, so that at 0.51 s it is 10 mm off, where 2 mm are allowed."""
    stuck = make_run(np.where(TIMES > 0.505, 0.5 - TIMES, 0.0), "DOP853 at 1e-9")
    rung = Rung(make_motion(close=stuck, rough=stuck))
    assert rung.until == 1.0
    assert rung.close_agrees_until == pytest.approx(0.5)
    assert not rung.is_sure
    sure = Rung(make_motion())
    assert sure.close_agrees_until == 1.0
    assert sure.is_sure


def test_a_solution_of_dop853_that_differs_at_the_end_alone_is_not_the_best():
    off = make_run(np.where(TIMES == 1.0, 0.1, 0.0), "DOP853 at 1e-9")
    rung = Rung(make_motion(close=off, rough=off))
    assert rung.until == 1.0
    assert rung.best is rung.fine


def test_the_size_of_a_model_of_points_is_the_distance_that_it_moves():
    """A difference of 0.5 % of the way is 5 mm after 1 s, and too large from the start on."""
    off = tuple(make_run(5e-3 * 2.0 ** (6 - k) * TIMES, step=step) for k, step in enumerate(STEPS))
    apart = make_run(0.1 + TIMES)
    own = make_motion(runs=off, close=apart, rough=apart, disturbed=off[4])
    assert not Rung(replace(own, extent=0.0)).consistent
    assert Rung(replace(own, extent=1.0)).until == pytest.approx(0.2, abs=0.011)  # a sample


def test_an_order_of_zero_at_the_end_leaves_an_uncertainty():
    """The error of DOP853 is too large at first only: the way grows to 1 m, with a size of 0.1 m.

    The steps converge until 0.5 s.  From then on their differences are 0.2 mm each, so that DOP853
    and the disturbed start alone agree.  The uncertainty is that of the least order that counts.
    """
    late = TIMES > 0.505
    runs = tuple(
        make_run(np.where(late, 2e-4 * k, 1e-4 * 2.0**-k * TIMES), step=step)
        for k, step in enumerate(STEPS)
    )
    close = make_run(runs[-1].points[:, 0, 0, 0] - TIMES + 2e-4, "DOP853 at 1e-9")
    disturbed = make_run(runs[4].points[:, 0, 0, 0] - TIMES)
    rung = Rung(make_motion(runs=runs, close=close, rough=close, disturbed=disturbed, extent=0.1))
    assert rung.until == 1.0
    assert rung.best is rung.fine
    assert not rung.steps_converge[-1]
    assert rung.known == pytest.approx(2e-4 / 0.6)


def test_a_model_without_joints_is_not_self_consistent():
    rung = Rung(make_motion(dof=0))
    assert not rung.consistent
    assert rung.words() == "nothing moves: the model has no joints"


def test_a_disturbance_that_grows_after_the_known_time_is_its_reason():
    """At 0.51 s, after T, it is as it was; at 0.8 s it has grown 1e7 times, and its run ends."""
    grown = make_motion().runs[4].points[:, 0, 0, 0] - TIMES + 1e-9 * SIZE * 10.0 ** (9 * TIMES)
    apart = np.where(TIMES > 0.505, 0.01 + TIMES, 0.0)
    off = [make_run(apart * (k % 2), step=step) for k, step in enumerate(STEPS)]
    close = make_run(apart * 2)
    for samples in (TIMES.size, 81):
        disturbed = cut_run(make_run(np.where(TIMES > 0.6, grown, 0.0)), samples)
        rung = Rung(make_motion(runs=tuple(off), close=close, rough=close, disturbed=disturbed))
        assert rung.until == pytest.approx(0.5)
        end = f"at {TIMES[samples - 1]:g} s"
        assert f"a disturbance of 1e-9 has grown .. times {end}" == re.sub(
            r"grown \S+ times", "grown .. times", rung.why()
        )


def test_a_motion_whose_other_ways_end_early_is_not_said_to_differ():
    """The steps converge to the end, and the two other ways ended at their third sample."""
    early = interrupted_run()
    disturbed = cut_run(make_motion().disturbed, 3)
    rung = Rung(make_motion(close=early, rough=early, disturbed=disturbed))
    assert rung.until == pytest.approx(0.02)
    assert "no more was followed in the time that there is" in rung.words()


def test_energies_at_the_end_are_compared_with_their_swing():
    """The energy of the finest run rises by 2 J and ends 0.1 J above that of the run before it."""
    own = make_motion()
    runs = *own.runs[:-1], replace(own.runs[-1], energy=2.0 * TIMES)
    other = replace(runs[-2], energy=1.9 * TIMES, gap=1e-3 * TIMES)
    rung = Rung(replace(own, runs=(*runs[:-2], other, runs[-1])))
    assert rung.describe_end() == (
        "energies at the end differ by 5 % of their swing, largest constraint violations are "
        "1e-3 and 0 m or rad"
    )


def test_the_check_of_a_model_has_the_cost_and_the_violation_of_its_own_run(monkeypatch, tmp_path):
    """A loop opens by up to 1 mm; 51 of 101 samples of 10 ms are 250 steps of 2 ms."""
    own = make_motion()
    first = cut_run(replace(own.runs[0], gap=2e-3 * TIMES), 51)
    late = replace(first, stopped="its wall time was over", late=True)
    motion = replace(own, runs=(late, *own.runs[1:]))
    engine = SimpleNamespace(own_equations=SimpleNamespace(solve_motion=lambda *_, **__: motion))
    monkeypatch.setattr(sys.modules[check_model_here.__module__], "engine_of", lambda _: engine)
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    found = check_model_here(ModelSource(tmp_path / "arm.xml"))
    assert (found.case, found.outcome, found.steps) == ("arm", Outcome.SELF_CONSISTENT, 250)
    assert (found.violation, found.at) == (pytest.approx(1e-3), pytest.approx(0.5))
    assert found.error_max == pytest.approx(ERROR_RATE * 0.5, rel=1e-6)
    assert found.uncertainty == pytest.approx(ERROR_RATE * 0.5 / 2**6, rel=1e-5)
