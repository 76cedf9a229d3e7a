"""The free motion of a model: its samples, and the fine solution that it is compared with.

No engine runs: the curves of the model are functions of time that depend on the time step.
"""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Run
from proofmass.studies.diet import scene
from proofmass.studies.diet.edits import read_model
from proofmass.studies.diet.scene import MonitoredRun, with_fine_solution
from tests.studies.diet.test_diet_options import write_pendulum
from tests.studies.test_study_verdicts import release_bob, write_bob

NO_FINE = "Options may change a channel by no more than a feature may: there is no fine solution "
MODEL_STEP = 1e-3  # s, time step of the model


class PendulumCurves:
    """A pendulum whose curves are functions of time, with other functions for fine solutions.

    Parameters
    ----------
    own, fine, coarse : dict
        The curve of each channel with the model's own step, with an eighth of the step, and with a
        quarter of it; without `coarse` the last one is that of an eighth.
    """

    def __init__(self, folder, monkeypatch, own, fine, coarse=None, more=""):
        self.file = write_pendulum(folder, step=MODEL_STEP, more=more)
        self.own, self.solutions = own, {MODEL_STEP / 4: coarse or fine, MODEL_STEP / 8: fine}
        self.asked: list[Run] = []
        monkeypatch.setattr(scene, "run_original", self.done)

    def done(self, file, model, run):
        assert file == self.file
        assert model.opt.timestep == MODEL_STEP
        self.asked.append(run)
        return evaluate_curves(run.x, self.solutions[run.settings["timestep"]])

    def held(self, x, error=None, level=frozenset()):
        run = Run("passive", x, (), start="key")
        before = evaluate_curves(x, self.own)
        self.monitored = MonitoredRun("let go", run, {}, before, level)
        return with_fine_solution(
            self.file, read_model(self.file, probing=True), self.monitored, error
        )


def evaluate_curves(x, functions) -> Curves:
    return Curves(x, {name: f(x) for name, f in functions.items()})


def line(slope: float, start: float = 0.0):
    return lambda x: start + slope * x


SAMPLE_TIMES = 0.01 * np.arange(101)  # 1 s, with ten steps between samples


def test_the_reference_of_a_free_motion_is_its_fine_solution(tmp_path, monkeypatch):
    """The fine solution has an eighth of the step and Newton's method.

    The error of a channel against it may be 1.1 times its error with the model's own options.
    """
    fine = PendulumCurves(
        tmp_path, monkeypatch, {"a": line(2.002), "b": line(3.0)}, {"a": line(2.0), "b": line(3.0)}
    )
    held, words = fine.held(SAMPLE_TIMES)
    settings = {"solver": "Newton", "tolerance": 1e-14, "iterations": 100}
    assert [run.settings for run in fine.asked] == [
        {**settings, "timestep": MODEL_STEP / 4},
        {**settings, "timestep": MODEL_STEP / 8},
    ]
    for run in fine.asked:
        assert (run.kind, run.start) == ("passive", "key")
        assert run.x.tolist() == SAMPLE_TIMES[::2].tolist()  # 51 samples
    assert held.bound.run == replace(fine.asked[0], settings={})
    assert held.bound.case is None
    assert held.bound.reference["a"].tolist() == (2.0 * SAMPLE_TIMES[::2]).tolist()
    # the error of a is 2e-3 at the end; b has no error, so that 1e-9 of its size is allowed
    assert held.bound.allowed == {
        "a": pytest.approx(1.1 * 2e-3, rel=1e-9),
        "b": pytest.approx(1e-9 * 3.0, rel=1e-9, abs=0),
    }
    assert held == replace(fine.monitored, bound=held.bound)
    assert words == (
        "Options are compared with the fine solution of the same model, with steps of 1.25e-4 s "
        "and constraints solved by Newton's method to 1e-14, over the first 1 s: the error of a "
        "channel may be 1.1 times its error with the model's own options, 1e-9 of its size, "
        "whichever is more; --error SHARE allows more."
    )


def test_a_fine_solution_is_no_coarser_than_the_model(tmp_path, monkeypatch):
    fine = PendulumCurves(
        tmp_path,
        monkeypatch,
        {"a": line(1.0)},
        {"a": line(1.0)},
        more='tolerance="1e-15" iterations="200"',
    )
    fine.held(SAMPLE_TIMES)
    assert [(run.settings["tolerance"], run.settings["iterations"]) for run in fine.asked] == [
        (1e-15, 200)
    ] * 2


def test_a_share_of_the_range_may_be_allowed(tmp_path, monkeypatch):
    """The range is the largest one of a sensor's components, also for a component that is constant.

    So a component normal to the plane of a motion may have the same error as those in the plane.
    """
    own = {"place[0]": line(2.0, 5.0), "place[1]": line(0.0), "rate": line(0.5)}
    fine = PendulumCurves(tmp_path, monkeypatch, own, own)
    held, words = fine.held(SAMPLE_TIMES, 0.01)
    assert held.bound.allowed == {
        "place[0]": pytest.approx(0.02),
        "place[1]": pytest.approx(0.02),
        "rate": pytest.approx(0.005),
    }
    assert words.endswith(
        "the error of a channel may be 1.1 times its error with the model's own options, 1e-9 of "
        "its size or 0.01 of its range, whichever is most."
    )
    assert fine.held(SAMPLE_TIMES, 0.0)[1].endswith("--error SHARE allows more.")
    # 1.1 times the error with the model's own options is larger here
    off = PendulumCurves(tmp_path, monkeypatch, {"a": line(2.1)}, {"a": line(2.0)})
    assert off.held(SAMPLE_TIMES, 0.01)[0].bound.allowed["a"] == pytest.approx(0.11)


@pytest.mark.parametrize(
    ("steps", "n", "thin"),
    [
        (1, 501, 8),
        (10, 501, 4),
        (32, 501, 2),
        (33, 501, 1),
        (64, 501, 1),
        (1, 100, 2),
        (1, 99, 1),
        (1, 400, 8),
        (1, 3200, 64),
        (1, 9999, 64),
    ],
)
def test_samples_are_thinned_to_make_room_for_longer_steps(steps, n, thin, tmp_path, monkeypatch):
    """Samples are left out until a stride has at most 64 steps, while at least 50 samples remain.

    A time step can then be lengthened up to the distance of the samples.
    """
    fine = PendulumCurves(tmp_path, monkeypatch, {"a": line(1.0)}, {"a": line(1.0)})
    x = MODEL_STEP * steps * np.arange(n)
    assert fine.held(x)[0].bound.run.x.tolist() == x[::thin].tolist()
    assert thin == 1 or (thin * steps <= 64 and n // thin >= 50)


def test_a_motion_that_ends_early_is_compared_up_to_its_end(tmp_path, monkeypatch):
    """The curves are longer than the run, which ends where a nudge has grown too much.

    Errors after the end of the run do not count: the curve differs by 9 there.
    """
    fine = PendulumCurves(
        tmp_path, monkeypatch, {"a": lambda x: x + 9.0 * (x > 0.505)}, {"a": line(1.0)}
    )
    monitored = MonitoredRun(
        "let go", Run("passive", SAMPLE_TIMES[:51], ()), {}, evaluate_curves(SAMPLE_TIMES, fine.own)
    )
    held, _ = with_fine_solution(fine.file, read_model(fine.file, probing=True), monitored)
    assert held.bound.allowed["a"] == pytest.approx(1e-9 * 10.0, rel=1e-6, abs=0)


def test_potential_energies_are_compared_as_changes(tmp_path, monkeypatch):
    fine = PendulumCurves(tmp_path, monkeypatch, {"energy": line(2.0)}, {"energy": line(2.0, 7.0)})
    held, _ = fine.held(SAMPLE_TIMES, level=frozenset({"energy"}))
    assert held.bound.allowed["energy"] == pytest.approx(2e-9, rel=1e-6, abs=0)
    assert held.bound.reference["energy"][0] == 0.0


def test_a_model_far_from_its_fine_solution_has_no_reference(tmp_path, monkeypatch):
    """There is none if a channel differs from it by more than a tenth of its size at any sample.

    The message names the channel that does so first, and the time of that sample.
    """

    def off(by: float, when: float):
        return lambda x: 2.0 * (x == 0) + by * (x > when)

    own = {"z": line(0.0, 1.0), "a": off(0.3, 0.495), "b": off(1.0, 0.515)}
    true = {"z": line(0.0, 1.0), "a": off(0.0, 0.0), "b": off(0.0, 0.0)}
    fine = PendulumCurves(tmp_path, monkeypatch, own, true)
    held, words = fine.held(SAMPLE_TIMES)
    assert held is fine.monitored
    assert words == (
        f"{NO_FINE}to compare them with: a differs from it by a tenth of its size after 0.5 s; "
        "--seconds ends the run before that."
    )
    tenth = PendulumCurves(tmp_path, monkeypatch, {"a": off(0.2, 0.5)}, {"a": off(0.0, 0.0)})
    assert tenth.held(SAMPLE_TIMES)[0].bound.allowed["a"] == pytest.approx(0.22)


def test_a_fine_solution_that_fails_is_no_reference(tmp_path, monkeypatch):
    def fail(file, model, run):
        raise InputError(file, "", "as it is, its run diverged")

    fine = PendulumCurves(tmp_path, monkeypatch, {"a": line(1.0)}, {})
    monkeypatch.setattr(scene, "run_original", fail)
    held, words = fine.held(SAMPLE_TIMES)
    assert held is fine.monitored
    assert words == f"{NO_FINE}to compare them with: as it is, its run diverged."


def test_a_fine_solution_must_converge_to_half_the_allowed_error(tmp_path, monkeypatch):
    """The finest solution is a reference only if that with twice its step differs little from it.

    The difference may be half of the allowed error, which is 1.1 times 0.02 here, or 0.04.
    """
    for off, holds in ((1.09, True), (1.11, False), (-1.11, False)):
        fine = PendulumCurves(
            tmp_path,
            monkeypatch,
            {"a": line(4.02)},
            {"a": line(4.0)},
            {"a": line(4.0 + off * 0.01)},
        )
        held, words = fine.held(SAMPLE_TIMES)
        assert (held.bound is not None) == holds
        if not holds:
            assert held is fine.monitored
            assert words == (
                f"{NO_FINE}to compare them with: a still changes between steps of "
                "2.5e-4 s and 1.25e-4 s."
            )
    assert (
        PendulumCurves(
            tmp_path, monkeypatch, {"a": line(4.02)}, {"a": line(4.0)}, {"a": line(4.0111)}
        )
        .held(SAMPLE_TIMES, 0.01)[0]
        .bound
    )  # 0.01 of the range of 4, which is 0.04, is allowed


def test_a_free_motion_records_the_change_of_a_potential_energy(tmp_path, monkeypatch):
    file = write_bob(tmp_path)
    file.write_text(
        file.read_text().replace(
            "<keyframe>",
            """<sensor>
      <e_potential name="potential"/><e_kinetic name="kinetic"/><e_potential name="unread"/>
      </sensor><keyframe>""",
        )
    )
    monitored, _ = release_bob(file, 1.0, monkeypatch, potential=5.0, kinetic=5.0)
    assert monitored.level == {"potential"}  # the sensor "unread" has no channel
    assert (monitored.before.channels["potential"] == 0.0).all()
    assert (monitored.before.channels["kinetic"] == 5.0).all()


def test_a_nudge_that_grows_beyond_a_tenth_names_its_channel(tmp_path, monkeypatch):
    monitored, _ = release_bob(
        write_bob(tmp_path), 1.0, monkeypatch, lambda x: 0.25 * (x > 0.0), hinge=2.5
    )
    assert monitored.run.x.size == 101
    with pytest.raises(InputError, match="cannot be followed: most is lost") as error:
        release_bob(
            write_bob(tmp_path),
            1.0,
            monkeypatch,
            lambda x: 1.0 * (x > 0.05),
            a=2.0,
            most=1.0,
            z=4.0,
        )
    assert error.value.key == ""
    with pytest.raises(InputError) as error:
        release_bob(write_bob(tmp_path), 1.0, monkeypatch)
    assert (error.value.file, error.value.key) == (write_bob(tmp_path), "")


def test_a_free_motion_has_at_most_a_thousand_samples(tmp_path, monkeypatch):
    """Of 999 steps every one is a sample, of 1000 steps every other one."""
    for seconds, n in ((9.99, 1000), (10.0, 501)):
        monitored, _ = release_bob(write_bob(tmp_path), seconds, monkeypatch, hinge=1.0)
        assert monitored.run.x.size == n


LONG_SAMPLE_TIMES = 0.01 * np.arange(1001)


@pytest.mark.parametrize("part", [slice(None), slice(501), slice(0, None, 2), slice(0, 601, 4)])
@pytest.mark.parametrize(
    ("steps", "seconds", "wanted"),
    [(1000, 0.0, 500), (1000, 0.5, 100), (4000, 0.0, 500), (4000, 0.5, 400), (8000, 100.0, 4)],
)
def test_a_shortened_run_has_few_steps_for_any_samples(part, steps, seconds, wanted):
    """A shortened run has at most 500 steps, and at most as many as take 0.05 s of wall time.

    It has at least two samples.  This also holds for a run that has fewer samples, or ends earlier,
    than the measured one.
    """
    whole = Run("passive", LONG_SAMPLE_TIMES, ())
    run = replace(whole, x=LONG_SAMPLE_TIMES[part])
    monitored = MonitoredRun(
        "", whole, {}, Curves(LONG_SAMPLE_TIMES, {}, seconds=seconds, steps=steps)
    )
    per = round(steps / 1000 * (run.x[1] - run.x[0]) / 0.01)  # steps between samples
    samples = min(max(2, wanted // per), run.x.size)
    assert monitored.shortened(run).x.tolist() == run.x[:samples].tolist()
    assert monitored.brief.x.tolist() == monitored.shortened(whole).x.tolist()
    assert monitored.shortened(run, 50).x.size == min(max(2, min(wanted, 50) // per), run.x.size)
