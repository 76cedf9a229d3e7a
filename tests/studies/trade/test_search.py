"""The search for the cheapest setting, with families whose errors and processor times are
formulas."""

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from shutil import copyfile

import numpy as np
import pymunk
import pytest

from proofmass.case.case import Case
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.programs import Imposed
from proofmass.sim.pymunk.tried_settings import bias_of_share
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade import search as module
from proofmass.studies.trade.program import ProgramRun
from proofmass.studies.trade.search import (
    TIMING_REPEATS,
    SettingFamily,
    is_outdone,
    list_families,
    next_runs,
    refine_for_drives,
    repeats_another,
    row_error,
    search,
    select_affordable,
    select_for_comparison,
    step_between,
)
from proofmass.studies.trade.series import Limits
from proofmass.studies.trade.verify import Check, try_other_drives
from tests.shipped import shipped

SAMPLE_DISTANCE = 3.14159265358979 / 180


@pytest.fixture(scope="module")
def fourbar() -> Case:
    return load_case(shipped("fourbar.toml"))


class FormulaFamilies:
    """Replaces the families and runs of a search by formulas, and records the runs in `asked`.

    Each family has a name, and a tuple: order, scale and floor of the error, processor time of a
    step [s], and optionally whether it is the engine's defaults (`plain`).  The error is
    scale * step^order + floor; with order 0 all runs diverge.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **families: tuple):
        self.families = families
        self.asked: list[tuple[str, float, int]] = []
        monkeypatch.setattr(
            module,
            "list_families",
            lambda case, engine: [
                SettingFamily(
                    "mujoco",
                    name,
                    setting_of_family(name),
                    SAMPLE_DISTANCE,
                    one[4] if len(one) > 4 else False,
                )
                for name, one in families.items()
            ],
        )
        monkeypatch.setattr(
            Study, "run", lambda study, tasks, *, repeats: self.run(tasks, repeats, study.longest)
        )

    def run(self, tasks: list[StudyRun], repeats: int, timeout: float) -> list[StudyRow]:
        rows = []
        for task in tasks:
            self.asked.append((task.series, task.value, repeats))
            order, scale, floor, cost, *_ = self.families[task.series]
            steps = round(6.28 / task.value)
            row = StudyRow(
                "choose",
                "fourbar",
                "dynamics",
                "mujoco",
                task.series,
                "timestep",
                task.value,
                dict(task.setting.parameters),
                {"position": scale * task.value**order + floor},
                seconds=cost * steps,
                steps=steps,
                repeats=(1.0,) * repeats,
            )
            if order == 0:
                row = replace(row, errors={}, seconds=nan, outcome="diverged")
            elif row.seconds > timeout:
                row = replace(row, errors={}, seconds=nan, outcome="timed out")
            rows.append(row)
        return rows

    def best(self, needed: float) -> float:
        """The least processor time [s] of a good enough run with whole numbers of steps per
        sample."""
        costs = [inf]
        for order, scale, floor, cost, *_ in self.families.values():
            costs += [
                cost * round(6.28 * n / SAMPLE_DISTANCE)
                for n in range(1, 4001)
                if order and scale * (SAMPLE_DISTANCE / n) ** order + floor <= needed
            ][:1]
        return min(costs)


def setting_of_family(name: str) -> Callable[[float], Setting]:
    """The function that gives the setting of a family for a time step."""
    return lambda step: Setting("mujoco", {"timestep": step, "integrator": name})


@pytest.mark.parametrize("needed", [1e-2, 1e-4, 1e-6, 1e-7])
def test_the_cheapest_setting_is_found_within_a_quarter(
    needed: float, fourbar: Case, monkeypatch, tmp_path
) -> None:
    """The cheapest good enough run that is found takes at most 1.25 times the least processor time.

    Steps between a good and a bad one are tried until their ratio is 1.25; since 0.8 of the error
    is aimed at, a step is 0.8 (first order) to 0.8^(1/4) (fourth order) of the largest good one.
    The family of first order is the cheapest for large errors.
    """
    world = FormulaFamilies(
        monkeypatch,
        first=(1.0, 0.5, 0.0, 1e-6),
        fourth=(4.0, 100.0, 0.0, 5e-6),
        second=(2.0, 50.0, 0.0, 2e-6),
    )
    rows = search(fourbar, "position", needed, Study(Store(tmp_path)))
    good = min(row.seconds for row in rows if row.errors["position"] <= needed)
    assert good <= 1.25 * world.best(needed)
    assert len(world.asked) < 40
    chosen = min(
        (row for row in rows if row.errors["position"] <= needed), key=lambda row: row.seconds
    )
    assert len(chosen.repeats) == TIMING_REPEATS  # it is timed again in rounds
    assert all(row.errors["position"] <= needed for row in rows if row.repeats)
    steps = [(series, value) for series, value, repeats in world.asked if not repeats]
    assert len(steps) == len(set(steps))
    numbers = np.array([SAMPLE_DISTANCE / value for _, value in steps])
    assert numbers == pytest.approx(np.round(numbers), rel=1e-12)


def test_families_that_cannot_be_cheaper_are_given_up(fourbar: Case, monkeypatch, tmp_path) -> None:
    """An expensive family ends with its first step, a failing one after `MAX_BAD_STEPS` steps."""
    world = FormulaFamilies(
        monkeypatch, good=(4.0, 1.0, 0.0, 1e-6), dear=(4.0, 1e3, 0.0, 1e-3), failed=(0, 0, 0, 0)
    )
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    counts = {
        name: sum(series == name and not repeats for series, _, repeats in world.asked)
        for name in world.families
    }
    assert counts["dear"] == 1
    assert counts["failed"] == module.MAX_BAD_STEPS
    assert counts["good"] >= 1


def test_families_that_are_worse_than_another_are_given_up(
    fourbar: Case, monkeypatch, tmp_path
) -> None:
    """After three steps a family ends whose errors are larger and fall no faster, or are all large.

    A family whose errors are larger but fall faster is followed as far as the processor time
    allows.
    """
    world = FormulaFamilies(
        monkeypatch,
        ahead=(2.0, 1.0, 0.0, 1e-6),
        behind=(2.0, 200.0, 0.0, 1e-6),
        far=(1e-9, 3.0, 0.0, 1e-6),
        late=(4.0, 1e7, 0.0, 1e-6),
    )
    rows = search(fourbar, "position", 1e-14, Study(Store(tmp_path)), limits=Limits(longest=10.0))
    counts = {
        name: sum(series == name and not repeats for series, _, repeats in world.asked)
        for name in world.families
    }
    assert counts["far"] == counts["behind"] == module.MAX_BAD_STEPS
    least = {
        name: min(row.errors["position"] for row in rows if row.series == name)
        for name in ("ahead", "late")
    }
    assert least["late"] < least["ahead"]


def test_an_error_floor_ends_a_family(fourbar: Case, monkeypatch, tmp_path) -> None:
    world = FormulaFamilies(monkeypatch, floor=(2.0, 50.0, 1e-4, 1e-6))
    rows = search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    assert len(world.asked) < module.MAX_RUNS_OF_FAMILY
    assert min(row.errors["position"] for row in rows) < 2e-4


def test_a_constant_large_error_ends_a_family(fourbar: Case, monkeypatch, tmp_path) -> None:
    """This also holds for defaults, which are not given up for a better family.

    A family whose error falls by 4 % from step to step goes on.
    """
    world = FormulaFamilies(
        monkeypatch, other=(1e-9, 0.6, 0.0, 1e-6, True), late=(0.03, 0.6, 0.0, 1e-6, True)
    )
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    counts = {
        name: sum(series == name and not repeats for series, _, repeats in world.asked)
        for name in world.families
    }
    assert counts["other"] == module.MAX_BAD_STEPS
    assert counts["late"] > module.MAX_BAD_STEPS


@pytest.mark.parametrize(
    ("errors", "needed", "limit", "step"),
    [
        ({1: 0.5}, 1e-6, inf, 1 / 4),  # another motion: a quarter
        ({1: 0.05}, 1e-6, inf, 1 / 2),  # no order yet: a half
        ({1: 0.5, 1 / 4: 0.05}, 1e-6, inf, 1 / 8),  # another motion shows no order
        ({1: 1e-2, 1 / 2: 9e-3}, 1e-6, inf, 1 / 4),  # the error hardly falls: once more
        ({1: 1e-2, 1 / 2: 9e-3, 1 / 4: 8.5e-3}, 1e-6, inf, None),  # it is a floor
        ({1: 1e-2, 1 / 2: 3e-3, 1 / 4: 2.9e-3}, 1e-6, inf, 1 / 8),  # it falls over two refinements
        ({1: 4e-3, 1 / 2: 1e-3}, 1e-4, inf, 1 / 8),  # by the order: (0.8 / 10)^(1/2) / 2 = 1 / 7.1
        ({1: 4e-3, 1 / 2: 1e-3}, 6.4e-4 / 0.8, inf, 1 / 3),  # 0.8 of what is needed: 1 / 2.5
        ({1: 4e-3, 1 / 2: 1e-3}, 1e-9, inf, 1 / 60),  # a thirtieth at most
        ({1: 4e-3, 1 / 2: 1e-3}, 1e-6, 0.05, 1 / 8),  # too long: a quarter shows whether it holds
        ({1: 16e-3, 1 / 2: 4e-3, 1 / 4: 1e-3}, 1e-6, 0.05, None),  # the order is known to hold
        ({1: 8e-3, 1 / 2: 4e-3, 1 / 4: 1e-3}, 1e-6, 0.05, 1 / 16),  # 1, then 2
        ({1: 1e-4}, 1e-4, inf, None),  # the first step is good enough
        ({1: 1e-4, 1 / 4: 1e-3}, 1e-4, inf, None),  # also if a shorter one is not
    ],
)
def test_the_next_step_follows_from_the_last_errors(errors, needed, limit, step) -> None:
    """A step of h seconds takes 1 ms / h; there is a whole number of steps in the sample of 1 s."""
    family = SettingFamily("mujoco", "one", setting_of_family("one"), 1.0)
    family.rows = [row_with(h, error) for h, error in errors.items()]
    found = family.next("position", needed, limit)
    assert found == (step if step is None else pytest.approx(step, rel=1e-12))


def test_families_without_a_next_step() -> None:
    """They are good enough defaults, twelve runs, and an engine without an answer or the feature.

    A failed run with a coarse step is followed by finer steps.
    """

    def next_step(rows: list[StudyRow], plain: bool = False) -> float | None:
        family = SettingFamily("mujoco", "one", setting_of_family("one"), 1.0, plain, rows=rows)
        return family.next("position", 1e-4, inf)

    good, coarse = row_with(1 / 10, 1e-5), row_with(1, 1e-2)
    assert next_step([coarse, good]) is not None
    assert next_step([coarse, good], plain=True) is None
    many = [row_with(2.0**-k, 0.9 - 0.05 * k) for k in range(module.MAX_RUNS_OF_FAMILY)]
    assert next_step(many[1:]) is not None
    assert next_step(many) is None
    for outcome, step in (("diverged", 1 / 4), ("timed out", None), ("unsupported", None)):
        assert next_step([replace(coarse, outcome=outcome, errors={})]) == step


def family_with(engine: str = "mujoco", plain: bool = False, **errors: float) -> SettingFamily:
    """A family whose settings have steps of 1, 1/4, 1/16 ... s, with these errors in turn."""
    family = SettingFamily(engine, engine, setting_of_family(engine), 1.0, plain)
    family.rows = [row_with(4.0**-k, error) for k, error in enumerate(errors.values())]
    return family


def test_a_family_whose_errors_are_all_large_is_outdone_by_one_with_half_of_that() -> None:
    """The other one has two runs, takes no longer, and is of the same engine."""
    far = family_with(a=0.9, b=0.9, c=0.9)
    for other, expected in (
        (family_with(a=0.9, b=0.049), True),
        (family_with(a=0.9, b=0.051), False),
        (family_with(a=0.049), False),
        (family_with("pymunk", a=0.9, b=0.049), False),
        (family_with(a=0.9, b=0.9, c=0.9, d=0.049), False),
    ):
        assert is_outdone(far, [far, other], "position") == expected
    assert not is_outdone(family_with(a=0.9, b=0.9), [family_with(a=0.9, b=1e-3)], "position")


@pytest.mark.parametrize(("step", "expected"), [(1 / 4, True), (1 / 8, False)])
def test_only_the_same_error_with_the_same_step_repeats_another_family(step, expected) -> None:
    other, family = family_with(), family_with()
    other.rows, family.rows = ([replace(row_with(h, 1e-3), seconds=10.0)] for h in (step, 1 / 4))
    assert repeats_another(family, [other, family], "position") == expected


def test_defaults_are_followed_whatever_another_engine_costs(fourbar: Case) -> None:
    """Its cheapest good setting takes 1 ms; the next run of the other engine should take 2 s."""
    cheap = family_with("mujoco", a=1e-5)
    for plain in (True, False):
        family = family_with("pymunk", plain, a=0.05)
        family.rows = [replace(family.rows[0], seconds=1.0)]
        asked = list(next_runs(fourbar, family, [cheap, family], "position", 1e-4, inf, 2.0))
        assert bool(asked) == plain


def row_with(step: float, error: float) -> StudyRow:
    """A run with an error, whose processor time is 1 ms over the step."""
    errors = {"position": error}
    return StudyRow("", "", "", "", "", "timestep", step, errors=errors, seconds=1e-3 / step)


def test_steps_between_a_good_and_a_bad_one_need_three_runs_at_most() -> None:
    """The order of the errors shows how near the good step is to the best one: three runs suffice.

    Bisection to 5 % would take nine runs.
    """
    needed, coarse, fine, runs = 5e-7, 8e-7, 4e-7, 0
    while (
        step := step_between(*(row_at(h) for h in (coarse, fine)), "position", needed)
    ) is not None:
        assert fine < step < coarse
        coarse, fine = (coarse, step) if row_at(step).errors["position"] <= needed else (step, fine)
        runs += 1
    assert runs <= 3
    assert row_at(fine).errors["position"] <= needed < row_at(coarse).errors["position"]


def test_no_step_between_is_tried_if_the_order_predicts_little_gain() -> None:
    """No step between is tried if the good step is long and near the predicted best step.

    Short runs are tried in any case.  A good step with an error well below the needed one leaves
    more to gain; so does a coarse step with a very large error, since its order is too high.
    """
    good = StudyRow("", "", "", "", "", "timestep", 1e-3, errors={"position": 7e-5}, seconds=1.0)
    bad = replace(good, value=1e-2, errors={"position": 7e-4}, seconds=0.1)
    assert step_between(bad, good, "position", 1e-4) is None
    short = replace(good, seconds=0.01)
    assert step_between(replace(bad, seconds=0.001), short, "position", 1e-4) is not None
    better = replace(good, errors={"position": 6e-5})
    far = replace(bad, errors={"position": 9e-2})
    assert step_between(bad, better, "position", 1e-4) is not None
    assert step_between(far, better, "position", 1e-4) is not None


@pytest.mark.parametrize(
    ("error", "needed", "step"), [(1e-9, 4e-2, 4.0), (4e-6, 5.1e-6, 2.0), (0.0, 4e-2, 2.0)]
)
def test_a_step_between_keeps_a_third_of_the_distance_from_both(error, needed, step) -> None:
    """Between 8 and 1, whose distance is three halvings, it is at most 4 and at least 2."""
    coarse = StudyRow("", "", "", "", "", "timestep", 8.0, errors={"position": 5e-2}, seconds=0.01)
    fine = replace(coarse, value=1.0, errors={"position": error})
    assert step_between(coarse, fine, "position", needed) == pytest.approx(step)


def test_a_step_between_is_the_middle_where_the_errors_show_no_order() -> None:
    assert step_between(row_with(8, 0.2), row_with(2, 1e-3), "position", 0.1) == 4.0
    assert step_between(row_with(8, 1e-3), row_with(2, 0.98e-3), "position", 0.99e-3) == 4.0


def test_only_a_run_to_the_end_has_a_finite_error() -> None:
    row = row_with(1, 1e-3)
    assert row_error(row, "position") == 1e-3
    assert row_error(row, "velocity") == inf
    assert row_error(replace(row, outcome="stopped"), "position") == inf
    assert row_error(row_with(1, nan), "position") == inf


def row_at(step: float) -> StudyRow:
    """A run whose error is proportional to step^0.33, and is 5e-7 at a step of 7.9e-7 s."""
    error = {"position": 4e-7 * (step / 4e-7) ** 0.33}
    return StudyRow("", "", "", "", "", "timestep", step, errors=error, seconds=1e-6 / step)


def test_defaults_are_followed_further_for_comparison(fourbar: Case, monkeypatch, tmp_path) -> None:
    """Defaults are followed up to `DEFAULTS_COST_RATIO` times the cheapest processor time.

    Another family with the same errors ends earlier.
    """
    world = FormulaFamilies(
        monkeypatch,
        good=(4.0, 1.0, 0.0, 1e-6),
        plain=(1.0, 0.01, 0.0, 1e-6, True),
        other=(1.0, 0.01, 0.0, 1e-6),
    )
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    finest = {
        name: min(value for series, value, _ in world.asked if series == name)
        for name in ("plain", "other")
    }
    assert finest["plain"] < finest["other"]


def test_no_run_is_longer_than_allowed(fourbar: Case, monkeypatch, tmp_path) -> None:
    world = FormulaFamilies(monkeypatch, slow=(1.0, 1.0, 0.0, 1e-3))
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)), limits=Limits(longest=10.0))
    assert all(1e-3 * 6.28 / value <= 10.0 for _, value, _ in world.asked)


def test_a_budget_ends_the_search(fourbar: Case, monkeypatch, tmp_path) -> None:
    """The limits report that the budget left settings out."""
    world = FormulaFamilies(monkeypatch, good=(1.0, 1.0, 0.0, 1e-6))
    limits = Limits(budget=1e-9)
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)), limits=limits)
    assert limits.short
    assert "the budget left some out" in limits.words
    asked, world.asked = len(world.asked), []
    limits = Limits()
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)), limits=limits)
    assert len(world.asked) > asked
    assert not limits.short
    assert "left" not in limits.words


def test_no_run_is_started_that_would_exceed_the_budget(
    fourbar: Case, monkeypatch, tmp_path
) -> None:
    """With a budget of 0.6 s only one of two families that need 0.4 s each is followed to the end.

    A family of first order with 1e-4 s a step needs a run of 25 s or more for an error of 1e-5, and
    coarser runs before.  A budget of 10 s is too small for it, one of 60 s is enough.
    """
    world = FormulaFamilies(monkeypatch, one=(1.0, 0.5, 0.0, 1e-6), two=(1.0, 0.51, 0.0, 1e-6))
    limits = Limits(budget=0.6)
    search(fourbar, "position", 1e-5, Study(Store(tmp_path)), limits=limits)
    assert limits.short
    assert 0.3 < limits.spent <= 0.6
    world = FormulaFamilies(monkeypatch, slow=(1.0, 0.5, 0.0, 1e-4))
    limits = Limits(longest=60.0, budget=10.0)
    rows = search(fourbar, "position", 1e-5, Study(Store(tmp_path)), limits=limits)
    assert limits.short
    assert limits.spent == pytest.approx(sum(row.seconds for row in rows))
    assert limits.spent <= 10.0
    enough = Limits(longest=60.0, budget=60.0)
    rows = search(fourbar, "position", 1e-5, Study(Store(tmp_path)), limits=enough)
    assert min(row.errors["position"] for row in rows) <= 1e-5
    assert not enough.short
    assert 25.0 < enough.spent <= 60.0
    assert len(world.asked) < module.MAX_RUNS_OF_FAMILY * 2


def test_a_first_run_is_predicted_by_the_other_families_of_its_engine(fourbar: Case) -> None:
    """A coarse run of 0.1 s predicts 100 s for the first run of a family with 1/1000 of its step.

    Before any family of the engine has run, the families with the longest step start, and the fine
    one waits; another engine's run predicts nothing.
    """

    def family(engine: str, step: float) -> SettingFamily:
        return SettingFamily(engine, f"{engine} {step}", setting_of_family("any"), 1.0, first=step)

    coarse, equal, fine = (family("mujoco", step) for step in (1.0, 1.0, 1e-3))
    every = [fine, coarse, equal, family("pymunk", 0.1)]

    def started(left: float) -> list[SettingFamily]:
        tasks = [
            (one, StudyRun(fourbar, "dynamics", one.at(step), value=step))
            for one in every
            if not one.rows and (step := one.next("position", 1e-6, inf))
        ]
        return [one for one, _ in select_affordable(tasks, every, left)]

    assert started(20.0) == [coarse, equal, every[3]]
    coarse.rows.append(replace(row_at(1.0), seconds=0.1))
    assert started(20.0) == [equal, every[3]]
    assert started(101.0) == [fine, equal, every[3]]


def test_timed_out_runs_count_towards_the_budget(fourbar: Case, monkeypatch, tmp_path) -> None:
    """A timed-out run counts with the longest processor time of a run, 30 s.

    The other family, of first order with 1e-5 s a step, needs a run of 2.5 s or more for an error
    of 1e-5 after coarser ones: 32 s are too few for both families, and 60 s are enough.
    """
    for budget, short in ((32.0, True), (60.0, False)):
        FormulaFamilies(monkeypatch, slow=(1.0, 0.5, 0.0, 1e2), one=(1.0, 0.5, 0.0, 1e-5))
        limits = Limits(longest=30.0, budget=budget)
        rows = search(fourbar, "position", 1e-5, Study(Store(tmp_path)), limits=limits)
        (slow,) = [row for row in rows if row.series == "slow"]
        assert slow.outcome == "timed out"
        rest = [row for row in rows if row.series == "one"]
        assert {row.outcome for row in rest} == {"ran"}
        assert limits.spent == pytest.approx(30.0 + sum(row.seconds for row in rest))
        assert limits.short == short
        assert (min(row.errors["position"] for row in rest) > 1e-5) == short


def test_a_family_with_the_same_errors_as_an_earlier_one_ends(
    fourbar: Case, monkeypatch, tmp_path
) -> None:
    """A family ends after its first step if an earlier one has the same errors and processor times.

    It goes on if it is much cheaper, if the earlier family is the defaults, which are not refined
    once a step is good enough, or if runs are too short for reliable processor times.
    """
    counts = {}
    for dear, cost, plain in (
        (1e-3, 1e-3, False),
        (1e-3, 5e-4, False),
        (1e-3, 1e-3, True),
        (1e-6, 1e-6, False),
    ):
        one = (2.0, 50.0, 0.0, dear, plain)
        world = FormulaFamilies(monkeypatch, one=one, same=(2.0, 50.0, 0.0, cost))
        search(fourbar, "position", 1e-4, Study(Store(tmp_path)))
        steps = {(series, value) for series, value, _ in world.asked}
        counts[cost, plain] = sum(series == "same" for series, _ in steps)
        assert any(series == "one" and value < SAMPLE_DISTANCE / 2 for series, value in steps)
    assert counts[1e-3, False] == 1
    assert counts[5e-4, False] > 1
    assert counts[1e-3, True] > 1
    assert counts[1e-6, False] > 1


def test_families_that_reach_the_same_setting_are_followed_once(
    fourbar: Case, monkeypatch, tmp_path
) -> None:
    """From an eighth of a sample on both families have the same settings.

    Their coarse steps give other errors, and so would predict other fine steps.  The second family
    ends after its first fine step.
    """
    world = FormulaFamilies(monkeypatch, one=(2.0, 50.0, 0.0, 1e-6), other=(1.9, 40.0, 0.0, 1e-6))
    limit = Setting("mujoco", {"timestep": SAMPLE_DISTANCE / 8, "integrator": "limit"})

    def at(name: str) -> Callable[[float], Setting]:
        return lambda step: (
            setting_of_family(name)(step)
            if step > SAMPLE_DISTANCE / 8
            else limit.with_parameters(timestep=step)
        )

    monkeypatch.setattr(
        module,
        "list_families",
        lambda case, engine: [
            SettingFamily("mujoco", name, at(name), SAMPLE_DISTANCE) for name in ("one", "other")
        ],
    )
    search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    fine = [
        series
        for series, value, repeats in world.asked
        if value < SAMPLE_DISTANCE / 8 and not repeats
    ]
    assert fine.count("one") >= 2
    assert fine.count("other") == 1


def test_settings_with_yielding_drives_are_tried_with_finer_steps(fourbar: Case) -> None:
    """The error of such a drive goes with the square of the step: 1/100 of it needs a step of 1/10.

    `solref` keeps its ratio to the step.  Settings with an error that is too large, small enough,
    or NaN are left out; of the others the cheapest `MAX_DRIVE_REFINEMENTS` are refined.
    """
    parameters = {"timestep": SAMPLE_DISTANCE, "solref": (4 * SAMPLE_DISTANCE, 1.0)}
    row = StudyRow(
        "choose",
        "fourbar",
        "dynamics",
        "mujoco",
        "RK4",
        "timestep",
        SAMPLE_DISTANCE,
        parameters,
        {"position": 1e-8},
        seconds=1.0,
    )
    (task,) = refine_for_drives(fourbar, [(row, 1e-2)], 1e-4)
    assert SAMPLE_DISTANCE / 14 < task.value <= SAMPLE_DISTANCE * (0.8 * 1e-2) ** 0.5
    assert task.setting.parameters["solref"] == pytest.approx((4 * task.value, 1.0))
    assert not refine_for_drives(fourbar, [(row, 0.2), (row, 1e-5), (row, nan)], 1e-4)
    many = [(replace(row, seconds=float(k)), 1e-2) for k in (5, 1, 4, 2, 3)]
    assert len(refine_for_drives(fourbar, many, 1e-4)) == module.MAX_DRIVE_REFINEMENTS
    # a run of 1 s needs a thirtieth of its step, one of 2 s almost half, which is cheaper
    slow = replace(row, seconds=2.0, series="slow")
    first, _ = refine_for_drives(fourbar, [(row, 9e-2), (slow, 3e-4)], 1e-4)
    assert first.series == "slow"


def test_the_best_gain_of_each_other_kind_of_drive_is_reported(fourbar: Case, monkeypatch) -> None:
    """The report has the error of the program with that gain, or the reason why it failed."""
    given = {
        Imposed("servo", 2.0): ProgramRun(failure="failed"),
        Imposed("servo", 0.5): ProgramRun({"position": 3e-4}, 2.0, 9),
        Imposed("servo", 0.2): ProgramRun({"position": 2e-3}, 1.0, 9),
    }
    monkeypatch.setattr(
        "proofmass.studies.trade.verify.run_with_drive",
        lambda case, setting, drive, *_: given.get(drive, ProgramRun(failure="failed")),
    )
    setting = Setting("mujoco", {"timestep": 1e-3})
    check = Check(
        1e-6, 1e-6, "", setting, ProgramRun({"position": 1e-6}, 1.0, 9), Imposed("flywheel")
    )
    found = try_other_drives(fourbar, check, "position", None)
    assert [drive.kind for drive, _ in found] == ["servo", "equality"]
    assert found[0][0].gain == 0.5
    told = replace(check, others=tuple(found)).describe_other_drives("position", 1e-4)
    assert told == [
        "its drive moved by a servo of gain 0.5 instead: 3e-4 off in 2 s, not good enough",
        "its drive moved by an equality of gain 0.5 instead: failed",
    ]
    assert (
        "enough"
        not in replace(check, others=tuple(found)).describe_other_drives("position", 1e-3)[0]
    )


@pytest.mark.parametrize("step", [1e-2, 1e-4])
@pytest.mark.parametrize("share", [0.003, 0.03])
def test_a_step_corrects_the_given_share_of_a_constraint_violation(share, step):
    """Chipmunk makes one step of a free body whose pin has a constraint violation of 0.1 m."""
    space, body = pymunk.Space(), pymunk.Body(1.0, 1.0)
    body.position = 1.0, 0.0
    pin = pymunk.PivotJoint(space.static_body, body, (0.9, 0.0), (0.0, 0.0))
    pin.error_bias = bias_of_share(share, step)
    space.add(body, pin)
    space.step(step)
    assert -body.velocity.x * step / 0.1 == pytest.approx(
        share, rel=1e-11, abs=0
    )  # 1 / step roundings


def test_the_settings_of_a_model_begin_with_a_step_that_fits_its_samples(fourbar):
    for step, first in ((1.0, SAMPLE_DISTANCE), (1e-3, 1e-3)):
        case = fourbar.model_copy(update={"settings": {"mujoco": {"timestep": step}}})
        assert next(list_families(case, "mujoco")).first == pytest.approx(first, rel=1e-12)


def test_families_with_few_iterations_have_a_bias_per_step(fourbar):
    """A step of such a family corrects the same share of a violation, whatever its length."""
    found = [
        one
        for one in list_families(fourbar, "pymunk")
        if one.name == "pymunk, bias 0.01 a step, 3 iterations"
    ]
    assert len(found) == 1
    for step in (1e-2, 1e-3):
        bias = found[0].at(step).parameters["error_bias"]
        assert bias**step == pytest.approx(0.99, rel=1e-12, abs=0)


def test_of_long_runs_only_the_cheapest_is_made(fourbar: Case, monkeypatch, tmp_path) -> None:
    """Of three similar families only the cheapest is run with the step that is good enough.

    That run takes seconds.  Without the order by cost the other two would be run with such a step
    as well.
    """
    world = FormulaFamilies(
        monkeypatch,
        cheap=(1.0, 1.0, 0.0, 1e-4),
        dear=(1.0, 1.01, 0.0, 2e-4),
        dearer=(1.0, 1.02, 0.0, 3e-4),
    )
    rows = search(fourbar, "position", 3e-4, Study(Store(tmp_path)))
    longest = {
        name: max(row.seconds for row in rows if row.series == name) for name in world.families
    }
    assert longest["cheap"] > 2.0
    assert longest["dear"] < longest["cheap"]
    assert longest["dearer"] < longest["cheap"]


def test_a_step_that_takes_too_long_is_not_tried_once_the_order_is_known(
    fourbar: Case, monkeypatch, tmp_path
) -> None:
    """An error of first order needs a run of 250 s, and a run may take 30 s.

    Three steps show the order, and none of the runs takes a second.  With an error of second order
    the needed step is found.
    """
    world = FormulaFamilies(monkeypatch, first=(1.0, 0.5, 0.0, 1e-4))
    rows = search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    assert 3 <= len(rows) <= 5
    assert max(row.seconds for row in rows) < 1.0
    world = FormulaFamilies(monkeypatch, second=(2.0, 0.5, 0.0, 1e-4))
    rows = search(fourbar, "position", 1e-6, Study(Store(tmp_path)))
    assert min(row.errors["position"] for row in rows) <= 1e-6
    assert min(row.seconds for row in rows if row.errors["position"] <= 1e-6) <= 1.25 * world.best(
        1e-6
    )


def test_a_free_motion_without_a_reference_is_given_up_after_one_round(tmp_path) -> None:
    """The elbow has a spring that yields, for which there is no reference.

    All settings with the longest step are tried; the setting of the model, with a shorter one, is
    not, and no engine runs.
    """
    models = Path(__file__).parents[2] / "data" / "chosen"
    text = (models / "double_pendulum.xml").read_text(encoding="utf-8")
    yielding = text.replace('range="-170 170"', 'range="-170 170" stiffness="1" springyield="1"')
    assert yielding != text
    (tmp_path / "double_pendulum.xml").write_text(yielding, encoding="utf-8")
    copyfile(models / "double_pendulum.toml", tmp_path / "double_pendulum.toml")
    case = load_case(tmp_path / "double_pendulum.toml")
    rows = search(case, "position", 1e-3, Study(Store(tmp_path)), engine="pymunk")
    own, *others = list_families(case, "pymunk")
    assert own.first is not None
    assert own.first < own.sample
    assert [row.series for row in rows] == [family.name for family in others]
    assert {row.outcome for row in rows} == {"no reference"}
    assert all("elbow" in row.message and row.steps == 0 for row in rows)


def test_the_cheapest_good_or_the_most_accurate_default_is_compared() -> None:
    def row(error: float, seconds: float) -> StudyRow:
        return StudyRow(
            "", "", "", "", "", "", 1.0, errors={"position": error}, seconds=seconds, outcome="ran"
        )

    rows = [row(1e-3, 1.0), row(1e-5, 3.0), row(1e-4, 2.0)]
    assert select_for_comparison(rows, "position", 1e-4) is rows[2]
    assert select_for_comparison(rows, "position", 1e-6) is rows[1]
