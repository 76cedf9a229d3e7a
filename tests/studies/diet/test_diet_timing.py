"""Times in a diet: their intervals contain the true saving, for random samples and real models."""

from math import comb, inf
from pathlib import Path
from random import Random

import mujoco
import numpy as np
import pytest

from proofmass.studies.diet import trial
from proofmass.studies.diet.diet import TIMING_ROUNDS
from proofmass.studies.diet.scene import load_scene
from proofmass.studies.diet.trial import compare_costs, median_interval, saved_share, time_steps

PENDULUM = """<mujoco><option timestep="0.001"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
  <geom size=".1" pos="0.3 0 0" contype="0" conaffinity="0"/></body>{more}</worldbody>
  <sensor><jointpos name="angle" joint="hinge"/></sensor></mujoco>"""
TWENTY_BODIES = "".join(
    f'<body pos="{k} 9 0"><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body>'
    for k in range(20)
)


def noisy_ratios(rng: np.random.Generator, effect: float, n: int = TIMING_ROUNDS) -> list[float]:
    """Ratios of times as on a shared machine: skewed, and a fifth of the times is disturbed."""

    def times(factor: float) -> np.ndarray:
        own = 1 + 0.03 * rng.exponential(size=n)
        return factor * own * np.where(rng.random(n) < 0.2, 1 + 2 * rng.random(n), 1.0)

    return list(times(1 - effect) / times(1.0))


@pytest.mark.parametrize("n", [8, 9, 15, 16, 50])
def test_an_interval_is_the_narrowest_that_the_sign_test_allows(n):
    values = list(range(n))
    low, _, high = median_interval(values)
    k = int(low) + 1
    assert high == n - k

    def missed(k: int) -> float:
        return 2 * sum(comb(n, i) for i in range(k)) / 2**n

    assert missed(k) <= 0.01 < missed(k + 1)


def test_fewer_than_eight_values_have_an_infinite_interval():
    assert median_interval(range(7)) == (-inf, 3.0, inf)
    assert median_interval(range(8)) == (0, 3.5, 7)


def test_features_without_effect_show_no_saving():
    """Ten features without effect: the interval contains 0 for at least nine of them."""
    rng = np.random.default_rng(7)
    found = [saved_share(noisy_ratios(rng, 0.0)) for _ in range(10)]
    assert sum(low <= 0 <= high for low, _, high in found) >= 9


def test_the_interval_contains_the_effect_as_often_as_it_states():
    # the level of 99 % gives 99.26 % for 15 pairs by the sign test; the share that 1000 trials find
    # may be 3 sigma less
    rng = np.random.default_rng(8)
    for effect in (0.0, 0.2):
        found = [saved_share(noisy_ratios(rng, effect)) for _ in range(1000)]
        holds = np.mean([low <= effect <= high for low, _, high in found])
        assert holds >= 0.9926 - 3 * np.sqrt(0.0074 * 0.9926 / 1000)


def test_a_saving_of_two_fifths_is_found_in_noise():
    rng = np.random.default_rng(9)
    found = [saved_share(noisy_ratios(rng, 0.4)) for _ in range(10)]
    assert sum(low > 0 for low, _, _ in found) >= 9
    assert np.median([middle for _, middle, _ in found]) == pytest.approx(0.4, abs=0.03)


def test_a_narrower_interval_often_misses_the_effect():
    """A mutation: an interval of level 50 % misses the median in up to half of all trials."""
    rng = np.random.default_rng(7)
    missed = 0
    for _ in range(100):
        low, _, high = median_interval(noisy_ratios(rng, 0.0), level=0.5)
        missed += not low <= 1 <= high
    assert missed > 20


def test_pairs_are_ordered_at_random_and_compared_by_their_ratios(monkeypatch):
    """The ratios show that a model costs twice as much, and not that the machine gets slower."""
    asked = []

    def run(model, run):
        asked.append(model)
        data = type("Data", (), {"nbuffer": 1, "maxuse_arena": 2})
        curves = type("Curves", (), {"steps": 10, "cost": 1e-3})
        return (1 + 0.1 * (len(asked) // 2)) * {"one": 2.0, "two": 1.0}[model], curves, data

    monkeypatch.setattr(trial, "time_steps", run)
    monkeypatch.setattr(trial.mujoco, "mj_sizeModel", lambda model: 3)
    found = compare_costs(("one", "two"), None, 15, 0.0)  # type: ignore[arg-type]
    low, middle, high = found.saved
    assert middle == pytest.approx(0.5, abs=0.05)
    assert 0.4 < low <= high < 0.6
    pairs = [asked[k : k + 2] for k in range(0, len(asked), 2)]
    assert len(pairs) == 16
    assert all(set(pair) == {"one", "two"} for pair in pairs)
    assert len({pair[0] for pair in pairs}) == 2
    assert [c.size for c in found.costs] == [6, 6]
    order = [pair[0] == "one" for pair in pairs]
    lot = Random(0)
    assert order == [lot.sample((0, 1), 2)[0] == 0 for _ in pairs]


def compile_pendulum(folder: Path, more: str) -> tuple[mujoco.MjModel, object]:
    """The compiled model of a pendulum with more bodies in its scene, and its run."""
    file = folder / "pendulum.xml"
    file.write_text(PENDULUM.format(more=more))
    scene = load_scene(file, 1.0)
    return scene.edited.compiled(), scene.longest.run


def test_a_run_has_a_plausible_time_and_its_number_of_steps(tmp_path):
    model, run = compile_pendulum(tmp_path, "")
    seconds, curves, _ = time_steps(model, run)
    assert 0 < seconds < 10
    assert curves.steps == 1000
    assert seconds == curves.seconds  # of the steps alone


@pytest.mark.slow
def test_no_saving_and_a_known_saving_are_measured_on_this_machine(tmp_path):
    """Two equal models show no saving in at least nine of ten trials.

    The removal of twenty bodies shows a saving in each of three trials.
    """
    lean, run = compile_pendulum(tmp_path, "")
    same = [compare_costs((lean, lean), run, TIMING_ROUNDS, 0.2).saved for _ in range(10)]
    assert sum(low <= 0 <= high for low, _, high in same) >= 9
    fat, _ = compile_pendulum(tmp_path, TWENTY_BODIES)
    costs = [min(time_steps(model, run)[0] for _ in range(5)) for model in (lean, fat)]
    for _ in range(3):
        low, middle, _ = compare_costs((fat, lean), run, TIMING_ROUNDS, 0.2).saved
        assert low > 0
        assert middle == pytest.approx(1 - costs[0] / costs[1], abs=0.15)
