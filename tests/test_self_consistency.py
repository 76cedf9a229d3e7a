"""Self-consistency of models without a sidecar: how well synthetic motions are known, and how long.

`Rung` draws its conclusions from several solutions of a motion by three criteria: `steps`, `close`
and `disturbed`, see `proofmass.self_consistency`.
"""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.check import check
from proofmass.outcome import Outcome
from proofmass.self_consistency import AGREEMENT_SHARE, Rung, why_failed
from proofmass.sim.protocol import OwnMotion, OwnRun

TIMES = np.linspace(0.0, 1.0, 101)
STEPS = [2e-3 / 2**k for k in range(7)]
SIZE = 2.0  # m
OFF = 0.05  # error per second of motion with a step of 2 ms [m/s]


def run(off, name="Euler, 2 ms", step=2e-3, seconds=1.0, **changed):
    """A run of a body that moves along x at 1 m/s, with an error [m] at each time."""
    points = np.zeros((TIMES.size, 1, 3, 3))
    points[:, 0, :, 0] = (TIMES + off)[:, None]
    return OwnRun(name, step, seconds, points, TIMES, 0 * TIMES, 0 * TIMES, **changed)


def motion(order=1.0, spread=0.0, **changed):
    """A motion that is solved in several ways.

    Its steps converge with an order, DOP853 has an error of 1e-10 m/s, and a disturbance grows as
    exp(spread t), with `spread` in 1/s.
    """
    runs = tuple(
        run(OFF * TIMES * (step / 2e-3) ** order, f"Euler, {1e3 * step:.4g} ms", step, 2.0**k)
        for k, step in enumerate(STEPS)
    )
    disturbed = run(runs[4].points[:, 0, 0, 0] - TIMES + 1e-9 * SIZE * np.exp(spread * TIMES))
    own = OwnMotion(
        TIMES,
        SIZE,
        runs,
        run(1e-10 * TIMES, "DOP853 at 1e-9", 0.0),
        run(1e-7 * TIMES, "DOP853 at 1e-6", 0.0),
        4,
        disturbed,
        (run(1e-4 * TIMES, "RK4, 2 ms", seconds=3.0),),
        None,
        1,
    )
    return replace(own, **changed)


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_a_motion_that_converges_is_known_to_its_end(order):
    """The error, the uncertainty, the cheapest better setting and the words of a good motion."""
    rung = Rung(motion(order))
    assert rung.until == 1.0
    assert rung.order == pytest.approx(order, abs=0.01)
    assert rung.error(rung.motion.runs[0]) == pytest.approx(OFF, rel=1e-6)
    assert rung.known == pytest.approx(OFF / 2 ** (6 * order), rel=1e-5)
    better = rung.better()
    assert (better.name, better.times) == ("RK4, 2 ms", 3.0)
    (cheaper,) = [rung.motion.others[0]]
    coarse = replace(rung.motion, others=(replace(cheaper, seconds=1e3),))
    assert Rung(coarse).better().name == ("Euler, 0.125 ms" if order == 1 else "Euler, 0.5 ms")
    few = replace(coarse, runs=coarse.runs[:2], compared=1, others=())
    assert Rung(few).better().name == "Euler, 1 ms"
    words = rung.words()
    known = "781 µm" if order == 1 else "12 µm"
    said = f"until 1 s, its end, known to {known} and off by 50 mm as it is (Euler, 2 ms). Steps"
    assert words.startswith(said)
    assert f"converge with order {order:g}, DOP853 at 1e-9 agrees with the finest and" in words


def test_a_clock_that_is_too_coarse_tells_no_cost():
    """Some clocks count in ticks of 16 ms, so that a short motion takes a time of zero."""
    own = motion()
    assert " × the time" in Rung(own).words()
    ticks = tuple(replace(one, seconds=0.0) for one in own.runs)
    rung = Rung(replace(own, runs=ticks))
    assert f"{rung.better().name}: " in rung.words()
    assert " × the time" not in rung.words()


def test_a_chaotic_motion_is_known_until_its_disturbances_and_steps_part():
    """The differences of steps and the disturbance grow as e^(30 t): 1e-9 is 1e-3 after 0.46 s."""
    own = motion(spread=30.0)
    grown = np.exp(30.0 * TIMES)
    off = [run(1e-9 * SIZE * grown * 2.0**-k, step=step) for k, step in enumerate(STEPS)]
    disturbed = run(off[4].points[:, 0, 0, 0] - TIMES + 1e-9 * SIZE * grown)
    rung = Rung(replace(own, runs=tuple(off), disturbed=disturbed))
    last = (
        np.log(AGREEMENT_SHARE / 1e-9 * 2**5) / 30.0
    )  # where the two finest steps differ by too much
    assert rung.until == pytest.approx(last, abs=0.03)
    assert "a disturbance of 1e-9 has grown" in rung.words()
    assert rung.growth == pytest.approx(np.exp(30.0), rel=1e-6)


def test_a_limit_that_is_wrong_in_silence_is_not_believed():
    """DOP853 stops moving at a force jump at 0.5 s with both of its error allowances.

    Its two solutions agree with each other, but not with the steps, which are used instead.
    """
    stuck = np.where(TIMES > 0.5, 0.5 - TIMES, 0.0)
    own = motion(close=run(stuck, "DOP853 at 1e-9"), rough=run(stuck, "DOP853 at 1e-6"))
    rung = Rung(own)
    assert rung.until == 1.0
    assert rung.best is own.runs[-1]
    assert rung.error(own.runs[0]) == pytest.approx(OFF * (1 - 2**-6), rel=1e-6)
    assert rung.known == pytest.approx(OFF * 2**-6, rel=0.02)
    assert "DOP853" not in rung.words()


def test_steps_that_do_not_converge_are_ill_posed_unless_something_else_agrees():
    """From 0.3 s on each step has a random error of up to 1 cm, although nothing is chaotic."""
    chosen = np.random.default_rng(1)
    late = TIMES > 0.3
    runs = tuple(run(1e-6 * step + late * chosen.uniform(-1e-2, 1e-2), step=step) for step in STEPS)
    same = run(runs[4].points[:, 0, 0, 0] - TIMES)
    rung = Rung(motion(runs=runs, disturbed=same))
    assert rung.until == pytest.approx(0.3)
    assert "finer steps do not converge there, though a disturbance grows" in rung.words()


def test_one_of_three_is_not_enough():
    """A motion is known if two of the criteria `steps`, `close` and `disturbed` are met."""
    stuck = run(0.1 * TIMES, "DOP853 at 1e-9")
    far = run(0.2 * TIMES)
    assert Rung(motion(close=stuck, rough=stuck)).until == 1.0
    assert Rung(motion(disturbed=far)).until == 1.0
    rung = Rung(motion(close=stuck, rough=stuck, disturbed=far))
    assert rung.until < 0.03
    apart = run(0.1 + TIMES, "DOP853 at 1e-9")
    none = Rung(replace(rung.motion, close=apart, rough=apart, disturbed=run(0.2 + TIMES)))
    assert not none.consistent
    assert none.words().startswith("no two ways of solving its motion agree at any time: ")


def test_a_way_without_steps_that_differs_from_itself_is_not_believed():
    """DOP853 agrees with the steps with its narrow error allowance, but not with its wide one.

    The disturbed start leads elsewhere too, so that only one criterion is met.
    """
    own = motion(rough=run(0.1 + TIMES, "DOP853 at 1e-6"), disturbed=run(0.2 + TIMES))
    assert not Rung(own).consistent


def test_steps_that_differ_by_little_and_do_not_converge_are_not_believed():
    """Every other step is 0.4 mm ahead, with a size of 2 m, and DOP853 leads elsewhere."""
    runs = tuple(run(4e-4 * (-1) ** k + 0 * TIMES, step=step) for k, step in enumerate(STEPS))
    stuck = run(0.1 + TIMES)
    rung = Rung(motion(runs=runs, close=stuck, rough=stuck, disturbed=runs[4]))
    assert not rung.consistent
    assert "finer steps do not converge there" in rung.words()


def test_steps_that_lead_to_another_motion_are_not_believed():
    """The runs with the two finest steps do not move, nor does the one with a disturbed start."""
    own = motion()
    still = [replace(run(-TIMES), step=step) for step in STEPS[5:]]
    apart = run(0.1 + TIMES)
    frozen = replace(own, runs=(*own.runs[:5], *still), compared=6, disturbed=still[-1])
    rung = Rung(replace(frozen, close=apart, rough=apart))
    assert rung.until <= 0.01
    assert "finer steps do not converge there" in rung.words()


def test_an_error_that_goes_away_again_is_told():
    """The error of a run is the largest one until T, not the one at T."""
    own = motion()
    there_and_back = replace(run(OFF * np.sin(np.pi * TIMES)), name="Euler, 2 ms")
    rung = Rung(replace(own, runs=(there_and_back, *own.runs[1:])))
    assert rung.error(there_and_back) == pytest.approx(OFF, rel=1e-6)


def test_the_softness_of_contacts_is_told_where_it_matters_more_than_the_step():
    assert "as stiff move it by 200 mm" in Rung(motion(stiffer=stiff(0.2))).words()
    assert "as stiff" not in Rung(motion(stiffer=stiff(1e-6))).words()


def stiff(off):
    """A run with stiffer contacts, with an error [m/s] to the run that it is compared with."""
    return run(motion().runs[4].points[:, 0, 0, 0] - TIMES + off * TIMES, "stiffer")


def first(one, samples, **changed):
    """The run, cut to its first samples."""
    own = {name: getattr(one, name)[:samples] for name in ("points", "energy", "depth", "gap")}
    return replace(one, **own, **changed)


def test_what_takes_too_long_is_known_as_far_as_it_was_followed():
    own = motion()
    runs = own.runs[0], *(first(one, 31) for one in own.runs[1:4])
    rung = Rung(replace(own, runs=runs, compared=3))
    assert rung.until == pytest.approx(0.3)
    assert "no more was followed in the time that there is" in rung.words()


def test_a_run_that_is_failed_is_no_motion():
    own = motion()
    failed = first(own.runs[0], 11, stopped="MuJoCo warning badqacc")
    assert (
        why_failed(replace(own, runs=(failed, *own.runs[1:])))
        == "MuJoCo warning badqacc, after 0.1 s"
    )
    late = first(own.runs[0], 11, stopped="its wall time was over", late=True)
    assert not why_failed(replace(own, runs=(late, *own.runs[1:])))
    assert not why_failed(own)
    finest = first(own.runs[-1], 31, stopped="not finite")
    rung = Rung(replace(own, runs=(*own.runs[:-1], replace(finest, name="Euler, 31 us"))))
    assert rung.until == pytest.approx(0.3)
    assert "Euler, 31 us fails: not finite" in rung.words()


def test_points_that_move_apart_in_one_body_alone_are_seen():
    """A body differs by a rotation: one of its three points is elsewhere, but its centre is not."""
    own = motion()
    turned = np.array(own.runs[-1].points)
    turned[50:, 0, 2, 1] += 0.1 * SIZE
    worse = replace(own, close=replace(own.close, points=turned), disturbed=run(0.1 * TIMES))
    assert Rung(worse).until < 0.5


BALL = """<mujoco><option timestep="0.004"/><worldbody>
  <body name="ball" pos="0 0 10"><freejoint/><geom size="0.1"/></body>
</worldbody></mujoco>"""
WALL = '<geom type="plane" size="1 1 1" pos="0 0 {}"/>'


def test_a_ball_that_falls_is_self_consistent_and_off_by_half_a_step(tmp_path):
    """Euler's method has an error of g t dt / 2: 20 mm after 1 s with steps of 4 ms."""
    file = tmp_path / "ball.xml"
    file.write_text(BALL)
    result = check([file])
    (found,) = result.comparisons
    assert found.outcome == Outcome.SELF_CONSISTENT
    assert result.exit_code == 0
    assert found.at == pytest.approx(1.0, abs=0.01)
    assert found.error_max == pytest.approx(9.81 * found.at * 4e-3 / 2, rel=1e-6)
    assert "RK4, 4 ms: 0 m" not in found.message


def test_a_model_that_is_failed_says_so(tmp_path):
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


def stopped_early() -> OwnRun:
    """The run of DOP853, which chooses its steps, ended by its time at the third sample."""
    way = run(0.0 * TIMES, "DOP853 at 1e-9", 0.0)
    return replace(way, points=way.points[:3], stopped="out of time", late=True)


def test_steps_that_fall_faster_than_their_order_tell_nothing():
    """Differences that fall with order 2.9 do not show convergence; those of order 1 do.

    A trampoline in MuJoCo has such differences: its error is 3 mm, while they indicate 0.2 mm.
    """
    early = stopped_early()
    fast, slow = (Rung(motion(order, close=early, rough=early)) for order in (2.9, 1.0))
    assert fast.until <= 0.02  # where DOP853 ended
    assert slow.until == 1.0


def test_a_motion_that_steps_alone_tell_is_known_to_the_last_difference():
    """The error is not extrapolated with the order of 2 that the steps show: it may not last."""
    early = stopped_early()
    rung = Rung(motion(2.0, close=early, rough=early))
    assert rung.order == pytest.approx(2.0, abs=0.01)
    assert rung.known == pytest.approx(float(rung.differences[-1][-1]))
