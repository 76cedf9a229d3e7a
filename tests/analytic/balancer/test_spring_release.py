"""Two springs and a contact that releases: against least energy, and wrong models differ."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from proofmass.analytic.balancer.spring_release import events, properties, solve
from tests.independent.balancer.laws import release_angle
from tests.verdicts import all_comparisons

CASES = [
    (connection, *np.random.default_rng(seed).uniform(0.5, 3.0, 3))
    for connection in ("series", "parallel")
    for seed in range(4)
]


def energy(gap: float, x: float, k1: float, k2: float, preload: float, connection: str) -> float:
    """Energy of both springs, spring 1 at a distance `gap` from its contact, balanced or not."""
    if connection == "series":
        return 0.5 * (k1 * (preload / k1 + gap) ** 2 + k2 * (x - gap) ** 2)
    return 0.5 * (k1 * (preload / k1 - x + gap) ** 2 + k2 * (preload / k2 + x) ** 2)


@pytest.mark.parametrize(("connection", "k1", "k2", "preload"), CASES)
def test_the_gap_has_the_least_energy_and_the_force_is_its_slope(connection, k1, k2, preload):
    parameters = {"stiffness1": k1, "stiffness2": k2, "preload": preload, "connection": connection}
    (release,) = events(**parameters).values()
    x = release * np.array([-0.5, 0.0, 0.4, 0.9, 1.1, 1.7, 3.0])
    found = solve(x, 2.0, **parameters)
    numbers = (k1, k2, preload, connection)
    for k, at in enumerate(x):
        least = minimize_scalar(
            energy,
            args=(at, *numbers),
            bounds=(0.0, 10.0 * release),
            method="bounded",
            options={"xatol": 1e-12},
        )
        assert found["gap"][k] == pytest.approx(least.x, abs=2e-7)  # square root of rounding
        assert found["energy"][k] == pytest.approx(
            energy(found["gap"][k], at, *numbers), rel=1e-14, abs=0
        )
        assert found["energy"][k] <= least.fun + 1e-13
    h = 1e-6 * release
    ahead, behind = solve(x + h, **parameters), solve(x - h, **parameters)
    np.testing.assert_allclose(
        found["force"], (ahead["energy"] - behind["energy"]) / (2 * h), rtol=1e-7, atol=1e-8
    )
    for name, slope in (("slope", "force"), ("gap_rate", "gap"), ("stretch2_rate", "stretch2")):
        rate = (ahead[slope] - behind[slope]) / (2 * h) * (1.0 if name == "slope" else 2.0)
        np.testing.assert_allclose(found[name], rate, rtol=1e-7, atol=1e-8)
    assert np.all(found["contact"] * found["gap"] == 0.0)


@pytest.mark.parametrize(("connection", "k1", "k2", "preload"), CASES)
def test_stiffnesses_are_those_of_equations_1_and_2(connection, k1, k2, preload):
    """In parallel stiffnesses add up, in series reciprocals; they are less beyond the release."""
    parameters = {"stiffness1": k1, "stiffness2": k2, "preload": preload, "connection": connection}
    (release,) = events(**parameters).values()
    slope = solve([0.0, 2.0 * release], **parameters)["slope"]
    wanted = [k2, 1.0 / (1.0 / k1 + 1.0 / k2)] if connection == "series" else [k1 + k2, k2]
    np.testing.assert_allclose(slope, wanted, rtol=1e-14)
    assert slope[1] < slope[0]
    # as for a joint of a balancer with a leverage of 1
    assert release == pytest.approx(
        release_angle(preload, 1.0, k2 if connection == "series" else k1)
    )
    assert (
        properties(**parameters)["stiffness"]
        == f"{slope[0]:.6g} N/m before, {slope[1]:.6g} N/m after"
    )


def test_without_a_preload_the_contact_is_released_at_once():
    found = solve([0.1, 0.2], stiffness1=2.0, stiffness2=2.0, preload=0.0, connection="series")
    np.testing.assert_allclose(found["force"], [0.1, 0.2], rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stiffness1": 0.0}, "stiffness1 must be positive and finite"),
        ({"stiffness2": np.inf}, "stiffness2 must be positive and finite"),
        ({"preload": -1.0}, r"preload must be zero or positive \[N\]"),
        ({"preload": np.nan}, r"preload must be zero or positive \[N\]"),
        ({"connection": "crossed"}, "connection must be one of series, parallel, got 'crossed'"),
        ({"place": np.nan}, "place must be finite"),
        ({"rate": np.nan}, "rate must be finite"),
        ({"rate": -np.inf}, "rate must be finite"),
    ],
)
def test_bad_parameters_are_named(change, words):
    parameters = {"stiffness1": 1.0, "stiffness2": 1.0, "preload": 1.0, "connection": "series"}
    with pytest.raises(ValueError, match=words):
        solve(**{"place": 0.0} | parameters | change)


def with_fewer_samples(file: Path) -> Path:
    """Sidecar `file` with 7 instead of 61 samples."""
    text, hits = re.subn("n = 61", "n = 7", file.read_text())
    assert hits
    file.write_text(text)
    return file


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("series", 'range="0 1"', 'range="-1 1"'),
        ("series", 'springref="-0.061"', 'springref="-0.062"'),
        ("series", 'stiffness="300"', 'stiffness="300.1"'),
        ("parallel", 'range="0 1"', 'range="-1 1"'),
        ("parallel", 'springref="0.0405"', 'springref="0.0406"'),
        ("parallel", 'springref="-0.081"', 'springref="-0.0811"'),
    ],
)
def test_a_wrong_spring_or_contact_differs(name, old, new, models):
    """Each preload, a stiffness, or a missing contact differs in both engines."""
    file = with_fewer_samples(models / f"springs_{name}.toml")
    assert {c.outcome.value for c in all_comparisons(file)} == {"agrees", "unsupported"}
    model = file.with_suffix(".xml")
    assert old in model.read_text()
    model.write_text(model.read_text().replace(old, new))
    found = all_comparisons(file)
    for solver in ("mujoco", "pymunk"):
        assert "differs" in {c.outcome.value for c in found if c.solver == solver}
