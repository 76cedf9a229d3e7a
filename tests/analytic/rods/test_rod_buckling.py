"""Buckling: charts against closed forms and shooting; columns of links in both engines."""

from functools import cache

import numpy as np
import pytest

from proofmass.analytic.rods import buckling, critical, elastica, equilibria, imperfect
from proofmass.analytic.rods.buckling import (
    free_column,
    pinned_column,
    pinned_column_chart,
    pinned_waves,
)
from proofmass.analytic.rods.cantilever import solve
from proofmass.analytic.rods.elastica import rods_of_chart
from proofmass.analytic.rods.shooting import integrate
from proofmass.sim.protocol import BadModel, Rod
from tests.sim.rod_models import ENGINES, model, pull, rest
from tests.verdicts import verdicts

EULER = np.pi**2 / 4.0
columns, leaning = cache(buckling), cache(imperfect)
EACH = pytest.mark.parametrize("engine", ENGINES)


def hencky(n):
    """Critical load of n links with half links at both ends: theta_i = sin(i pi/2n) at the i-th."""
    return 4.0 * n**2 * np.sin(np.pi / (4.0 * n)) ** 2


def column(engine, folder, load, n, turn=0.0):
    """Tip of a clamped and free column of links, and its direction, at rest."""
    rod = Rod("r", "ground", None, 1.0, 1.0, n, ("clamped", "free"), turn=turn)
    found = rest(
        engine,
        model(folder, actuators=pull("r.tip", -load), ctrl="1"),
        (rod,),
        ("r.x", "r.y", "r.angle"),
    ).channels
    return np.array([found[name][-1] for name in ("r.x", "r.y", "r.angle")])


def test_the_free_column_is_the_elastica_of_quarter_waves():
    """Loads by Legendre's K, the rise by Love's formula; higher modes are shorter columns."""
    y, load, falls = free_column(1)
    whole = elastica(load / EULER)
    # half of the digits at k = 0, and of 1 - k at the other end
    np.testing.assert_allclose(np.abs(y), whole["rise"], atol=1e-7)
    for mode in (2, 3):
        part, shorter, _ = free_column(mode)
        np.testing.assert_allclose(shorter, (2 * mode - 1) ** 2 * load, rtol=1e-11)  # of 1 - k
        np.testing.assert_allclose(np.abs(part), np.abs(y) / (2 * mode - 1), atol=1e-11)
        assert (free_column(mode)[2] == mode - 1).all()
    assert not falls.any()


@pytest.mark.parametrize("load", [0.7, 1.2, 5.0, 12.0])
def test_the_forks_count_is_that_of_all_equilibria(load):
    """A search over the tip's angle finds what the chart's lines cross at that load."""
    found = equilibria(force_x=-load * EULER)
    crossed, stable = 0, 0
    for line in columns().panels[0].lines:
        y = line.y[np.isfinite(line.y)] - load
        hits = int((y[1:] * y[:-1] < 0.0).sum()) if line.label != "straight" else 0
        crossed, stable = crossed + hits, stable + hits * line.stable
    assert crossed + 1 == found["theta"].size
    assert stable + (load < 1.0) == (found["unstable"] == 0).sum()


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_the_pinned_column_is_a_rod_on_its_line(mode):
    """Shot from the clamp: the tip on the tangent without moment, the middle; small deflections."""
    y, load, falls = pinned_column(mode)
    found = rods_of_chart(*pinned_column_chart(mode))
    rod = integrate(found.force.real, found.force.imag, found.moment, nodes=161)
    np.testing.assert_allclose(found.force.real, -load, rtol=1e-14)  # rounding
    np.testing.assert_allclose(rod.y[-1], 0.0, atol=1e-9)  # of order 8, 160 nodes
    np.testing.assert_allclose(rod.m[-1], 0.0, atol=1e-8)  # the same
    np.testing.assert_allclose(rod.y[80], y, atol=1e-9)  # the same
    assert load[0] == pytest.approx(pinned_waves()[mode - 1] ** 2, rel=1e-5)  # q^2, 1e-6
    assert falls[0] == mode - 1
    assert pinned_waves()[0] ** 2 == pytest.approx(critical("clamped-pinned"), rel=1e-14)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_a_dead_load_loses_a_pinned_mode_at_its_largest(mode):
    """Where dP/dx changes its sign one more direction falls."""
    _, load, falls = pinned_column(mode)
    assert abs(np.flatnonzero(np.diff(falls))[0] - load.argmax()) <= 1
    assert set(falls) == {mode - 1, mode}


def test_a_leaning_load_has_no_critical_one():
    """Deflections are those of `solve`; the other side begins in a fold above Euler's load."""
    line, island, other = (line for line in leaning(share=0.05).lines if "across" in line.label)
    for ratio in (0.3, 0.9, 1.0, 1.4):
        force = {"force_x": -ratio * EULER, "force_y": 0.05 * ratio * EULER}
        truth = solve(1.0, **force)["y"]
        assert np.interp(ratio, line.y, line.x) == pytest.approx(truth, abs=1e-3)  # chords
    least = np.nanmin(island.y)
    assert least == pytest.approx(np.nanmin(other.y), rel=1e-3)  # the fold, between points
    counts = [
        equilibria(force_x=-r * EULER, force_y=0.05 * r * EULER)["theta"].size
        for r in (least - 0.01, least + 0.01)
    ]
    assert least > 1.0
    assert counts == [1, 3]


def test_length_and_stiffness_only_scale():
    """Deflections go with L; the load is told over Euler's."""
    for chart in (columns, leaning):
        for one, two in zip(chart().lines, chart(length=3.0, stiffness=5.0).lines, strict=True):
            np.testing.assert_array_equal(two.x, 3.0 * one.x)
            np.testing.assert_array_equal(two.y, one.y)


@EACH
def test_a_bent_column_goes_straight_below_euler_and_stays_bent_above(engine, tmp_path):
    """At 0.9 and at 1.15172 of the critical load, where k = 1/2; and to the other side."""
    x, y, angle = column(engine, tmp_path, 0.9 * EULER, 20, turn=1.0)
    assert (x, y, angle) == pytest.approx((1.0, 0.0, 0.0), abs=1e-10)  # rest, over the softness
    truth = elastica(1.151719647)
    for side in (1.0, -1.0):
        tips = [column(engine, tmp_path, 1.151719647 * EULER, n, side) for n in (20, 40)]
        limit = (4.0 * tips[1] - tips[0]) / 3.0
        # what h^4 leaves, more than elsewhere: P is 15 % above the critical load
        assert limit == pytest.approx(
            [truth["span"], side * truth["rise"], side * truth["angle"]], abs=1e-5
        )
        assert abs(tips[0][1] - limit[1]) > 1e-4


@pytest.mark.parametrize("n", [5, 10, 20])
def test_a_straight_chain_gives_way_at_henckys_load(n, tmp_path):
    """MuJoCo finds it stable just below and unstable just above; the load is of second order."""
    x, y, _ = column("mujoco", tmp_path, (1.0 - 1e-6) * hencky(n), n)
    assert (x, y) == pytest.approx((1.0, 0.0), abs=1e-12)  # rounding
    with pytest.raises(BadModel, match="unstable"):
        column("mujoco", tmp_path, (1.0 + 1e-6) * hencky(n), n)
    assert EULER - hencky(n) == pytest.approx(EULER * np.pi**2 / (48.0 * n**2), rel=1e-2)  # h^4


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("stiffness = 1.0      #", "stiffness = 1.02 #"),
        ("turn = 1.0 ", "turn = -1.0 "),
        ("segments = 40", 'segments = 40\nscheme = "naive"'),
    ],
)
def test_a_wrong_column_is_found(old, new, edit):
    """Stiffer, on the other side, with a soft clamp."""
    file = edit("rod_buckled.toml", old, new)
    assert {c.solver for c in verdicts(file) if c.outcome == "differs"} == set(ENGINES)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match=r"share must be within \(0, 1\), got 0"):
        imperfect(share=0.0)
    with pytest.raises(ValueError, match="stiffness"):
        buckling(stiffness=-1.0)
