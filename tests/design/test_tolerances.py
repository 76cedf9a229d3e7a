"""Tolerances of balancers: sampled bands against linear propagation, engines and a closed form."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from docs.make.tolerance_band import DESIGNS, ENGINE_ANGLES, run_engines
from proofmass.analytic.balancer import solve
from proofmass.commands.cli import design as app
from proofmass.commands.tolerances import parse_tolerances
from proofmass.design.tolerances import (
    DEFAULT_TOLERANCES,
    deviate,
    deviated_moments,
    draw_shares,
    find_band,
    list_deviations,
)
from tests.shipped import shipped

FREE, PRELOADED = DESIGNS.values()
EACH_DESIGN = pytest.mark.parametrize("parameters", DESIGNS.values(), ids=["free", "preloaded"])
PAIR = {"length1": 0.6, "length2": 0.7, "stiffness1": 1.1, "stiffness2": 0.4, "quadratic1": -0.2}
ANGLES = np.radians([10.0, 45.0, 90.0])


@EACH_DESIGN
def test_small_tolerances_have_the_deviation_of_linear_propagation(parameters):
    """Derivatives of `solve`, by differences of one parameter after the other, times deviations.

    The springs' angles, for which `solve` has no parameter, are exact here.
    """
    small = {"length": 1e-5, "stiffness": 1e-3, "preload": 1e-3}
    deviations, samples = list_deviations(parameters, small), 4000
    band = find_band(parameters, deviations, ANGLES, samples)

    def moment(name, move):
        given = dict(parameters) | {"pendulum": 1.0}
        own = name.replace("spring", "stiffness")
        given[own] *= 1.0 + move / (given[own] if name[:6] in ("length", "pendul") else 1.0)
        return solve(ANGLES, **given)["balancing_moment"]

    step = 1e-6
    slopes = [(moment(d.name, step) - moment(d.name, -step)) / (2 * step) for d in deviations]
    sizes = np.array([d.size for d in deviations])[:, None]
    expected = np.sqrt(np.sum((np.array(slopes) * sizes) ** 2 / 3.0, axis=0))
    assert band.linear == pytest.approx(expected, rel=1e-3)  # the square of the tolerances
    # the standard deviation of samples is off by less than 1/sqrt(2 S), for kurtosis up to 3
    assert band.moments.std(axis=0) == pytest.approx(expected, rel=4 / np.sqrt(2 * samples))


def test_a_spring_that_is_set_wrongly_has_a_closed_form():
    """Two segments turn with the pendulum: M = k (a + d) + A (a + d)^2."""
    deviations = [d for d in list_deviations(PAIR, {"angle": 0.1}) if d.name == "set1"]
    shares = np.array([[-1.0], [0.0], [0.5]])
    found = deviated_moments(PAIR, deviations, shares, ANGLES)
    wound = ANGLES + 0.1 * shares
    assert found == pytest.approx(1.1 * wound - 0.2 * wound**2, abs=1e-12)


def test_a_band_of_one_spring_is_that_of_a_uniform_number():
    deviations = [d for d in list_deviations(PAIR, {"stiffness": 0.1}) if d.name == "spring1"]
    samples = 4000
    band = find_band(PAIR, deviations, ANGLES, samples)
    exact = 1.1 * ANGLES - 0.2 * ANGLES**2
    # percentiles of uniform numbers are off by sqrt(p (1 - p)/S) of their range, four times that
    off = 4 * 0.2 * np.sqrt(0.025 * 0.975 / samples)
    assert band.low / exact == pytest.approx(0.905, abs=off)
    assert band.high / exact == pytest.approx(1.095, abs=off)
    assert (band.most <= 1.1 * exact + 1e-12).all()
    assert band.shares == {"stiffness": 1.0}


@EACH_DESIGN
def test_engines_have_the_moments_of_the_same_balancers(parameters, tmp_path):
    """The springs of the models are set wrongly as well; `docs.make.tolerance_band` runs 1,000."""
    deviations = list_deviations(parameters, DEFAULT_TOLERANCES)
    shares = draw_shares(len(deviations), 3, seed=1)
    theirs, ours = run_engines(parameters, shares, tmp_path)
    band = find_band(parameters, deviations, ENGINE_ANGLES, 300)
    for moments in theirs.values():
        # 1e-12: rounding of the pose times the stiffness
        assert np.abs(moments - ours).max() < 1e-12
        assert ((moments > band.least - 0.02) & (moments < band.most + 0.02)).all()
    exact = deviated_moments(parameters, [], np.zeros((1, 0)), ENGINE_ANGLES)
    assert np.abs(ours - exact).max() > 1e-3  # models without deviations would be noticed


def test_the_same_seed_gives_the_same_balancers():
    deviations = list_deviations(FREE, DEFAULT_TOLERANCES)
    once, twice, other = (find_band(FREE, deviations, ANGLES, 20, s).moments for s in (1, 1, 2))
    assert np.array_equal(once, twice)
    assert not np.array_equal(once, other)


def test_what_may_be_off():
    names = [one.name for one in list_deviations(PRELOADED, DEFAULT_TOLERANCES)]
    lengths = ["length1", "length2", "length3", "pendulum"]
    springs = ["spring1", "spring2", "spring3"]
    assert names == [*lengths, *springs, "preload2", "set1", "set3", "rest_angle"]
    free = {**FREE, "stiffness2": 0.0, "high2": 0.4}
    names = [one.name for one in list_deviations(free, {"angle": 0.01, "stiffness": 0.1})]
    assert names == ["spring1", "spring3", "set1", "set3", "high2", "rest_angle"]
    half = list_deviations(FREE, {"length": 1e-4}, pendulum=0.5)[0]
    assert half.size == pytest.approx(2e-4)  # on the design's pendulum of 1 m
    off, _ = deviate(FREE, list_deviations(FREE, {"stiffness": 0.1}), np.array([[1.0, 0.0, -1.0]]))
    assert off["stiffness1"] == pytest.approx(1.1 * FREE["stiffness1"])
    assert off["stiffness3"] == pytest.approx(0.9 * FREE["stiffness3"])


def test_a_design_that_none_of_the_balancers_reaches():
    """Lengths that are off by half a metre leave no chain that reaches 90 degrees."""
    short = {**FREE, "length1": 0.25, "length2": 0.3, "length3": 0.3, "rest_angle": 3.0}
    with pytest.raises(ValueError, match="none of 5 balancers within these tolerances reaches 90"):
        find_band(short, list_deviations(short, {"stiffness": 0.01}), ANGLES, 5)


def run_tolerances(*args):
    return CliRunner().invoke(app, ["tolerances", *map(str, args)])


def test_the_command_writes_the_band(tmp_path):
    file = shipped("balancer_sine_free.toml")
    answer = run_tolerances(file, "--samples", 50, "-o", tmp_path)
    assert answer.exit_code == 0, answer.output
    assert "of 50 balancers within them the rms error is" in answer.output
    record = json.loads((tmp_path / "tolerances.json").read_text())
    band = {name: np.array(record[name]) for name in ("least", "low", "nominal", "high", "most")}
    assert (band["least"] <= band["low"]).all()
    assert (band["low"] < band["high"]).all()
    assert (band["high"] <= band["most"]).all()
    assert sum(record["shares"].values()) == pytest.approx(1.0)
    assert (tmp_path / "tolerances.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--tolerance", "length=1kg"), "write it as length=0.1mm"),
        (("--tolerance", "mass=1%"), "write it as length=0.1mm"),
        (("--tolerance", "stiffness=five"), "write it as length=0.1mm"),
        (("--tolerance", "angle=1e3deg"), "must be from 0 to less than"),
        (("--pendulum", "-1"), "the length must be positive"),
    ],
)
def test_tolerances_that_are_none_are_refused(tmp_path, options, words):
    answer = run_tolerances(shipped("balancer_sine_free.toml"), *options, "-o", tmp_path)
    assert answer.exit_code == 2
    assert words in answer.output
    assert "no balancer" in run_tolerances(shipped("fourbar.toml"), "-o", tmp_path).output


def test_tolerances_have_units():
    found = parse_tolerances(["length=0.1mm", "stiffness = 5 %", "preload=0", "angle=0.5deg"])
    assert found == pytest.approx(
        {"length": 1e-4, "stiffness": 0.05, "preload": 0.0, "angle": np.radians(0.5)}
    )
