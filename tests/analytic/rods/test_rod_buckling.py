"""Buckling: charts against closed forms and shooting, and columns of links in both engines."""

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
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Rod
from tests.sim.rod_models import ENGINES, dead_load, equilibrium_curves, write_model
from tests.verdicts import all_comparisons

EULER = np.pi**2 / 4.0
column_chart, imperfect_chart = cache(buckling), cache(imperfect)
EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)


def hencky_load(n):
    """Critical load of a chain of n cells, with half links at both ends; theta_i = sin(i pi/2n)."""
    return 4.0 * n**2 * np.sin(np.pi / (4.0 * n)) ** 2


def tip_of_column(engine, folder, load, n, turn=0.0):
    """Tip x, y [m] and its direction [rad] at rest, of a clamped and free column of links."""
    rod = Rod("r", "ground", None, 1.0, 1.0, n, ("clamped", "free"), turn=turn)
    found = equilibrium_curves(
        engine,
        write_model(folder, actuators=dead_load("r.tip", -load), ctrl="1"),
        (rod,),
        ("r.x", "r.y", "r.angle"),
    ).channels
    return np.array([found[name][-1] for name in ("r.x", "r.y", "r.angle")])


def test_the_free_column_is_the_elastica_of_quarter_waves():
    """The chart of the free column has the loads by Legendre's K and the rise by Love's formula.

    Higher modes are those of columns that are shorter by 1/(2 mode - 1).
    """
    y, load, falls = free_column(1)
    whole = elastica(load / EULER)
    # half of the digits are missing at k = 0, and those of 1 - k at the other end
    np.testing.assert_allclose(np.abs(y), whole["rise"], atol=1e-7)
    for mode in (2, 3):
        part, shorter, _ = free_column(mode)
        np.testing.assert_allclose(shorter, (2 * mode - 1) ** 2 * load, rtol=1e-11)  # of 1 - k
        np.testing.assert_allclose(np.abs(part), np.abs(y) / (2 * mode - 1), atol=1e-11, rtol=0)
        assert (free_column(mode)[2] == mode - 1).all()
    assert not falls.any()


@pytest.mark.parametrize("load", [0.7, 1.2, 5.0, 12.0])
def test_chart_lines_have_all_equilibria_of_a_load(load):
    """A search over the tip's angle finds as many equilibria as the chart's lines have there."""
    found = equilibria(force_x=-load * EULER)
    crossed, stable = 0, 0
    for line in column_chart().panels[0].lines:
        y = line.y[np.isfinite(line.y)] - load
        hits = int((y[1:] * y[:-1] < 0.0).sum()) if line.label != "straight" else 0
        crossed, stable = crossed + hits, stable + hits * line.stable
    assert crossed + 1 == found["theta"].size
    assert stable + (load < 1.0) == (found["unstable"] == 0).sum()


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_a_pinned_column_is_a_rod_with_its_tip_on_the_clamp_tangent(mode):
    """A rod that is shot from the clamp has its tip on the clamp's tangent, without a moment.

    The deflection of its middle is that of the chart; small deflections begin at q^2 EI/L^2.
    """
    y, load, falls = pinned_column(mode)
    found = rods_of_chart(*pinned_column_chart(mode))
    rod = integrate(found.force.real, found.force.imag, found.moment, nodes=161)
    np.testing.assert_allclose(found.force.real, -load, rtol=1e-14)  # rounding
    np.testing.assert_allclose(rod.y[-1], 0.0, atol=1e-9)  # order 8 with 160 steps
    np.testing.assert_allclose(rod.m[-1], 0.0, atol=1e-8)  # the same
    np.testing.assert_allclose(rod.y[80], y, atol=1e-9, rtol=0)  # the same
    assert load[0] == pytest.approx(pinned_waves()[mode - 1] ** 2, rel=1e-5)  # q^2, 1e-6
    assert falls[0] == mode - 1
    assert pinned_waves()[0] ** 2 == pytest.approx(critical("clamped-pinned"), rel=1e-14, abs=0)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_a_pinned_mode_gets_a_negative_direction_at_its_largest_load(mode):
    """A mode of a pinned column gets one more negative direction where its load is the largest."""
    _, load, falls = pinned_column(mode)
    assert abs(np.flatnonzero(np.diff(falls))[0] - load.argmax()) <= 1
    assert set(falls) == {mode - 1, mode}


def test_a_column_under_a_leaning_load_has_no_critical_load():
    """A load that leans bends the column from the start, so that there is no critical load.

    Deflections to this side are those of `solve`; those to the other side begin at a fold above
    Euler's load, where the number of equilibria rises from 1 to 3.
    """
    line, island, other = (
        line for line in imperfect_chart(share=0.05).lines if "across" in line.label
    )
    for ratio in (0.3, 0.9, 1.0, 1.4):
        force = {"force_x": -ratio * EULER, "force_y": 0.05 * ratio * EULER}
        reference = solve(1.0, **force)["y"]
        assert np.interp(ratio, line.y, line.x) == pytest.approx(reference, abs=1e-3)  # chords
    least = np.nanmin(island.y)
    assert least == pytest.approx(np.nanmin(other.y), rel=1e-3)  # the fold is between points
    counts = [
        equilibria(force_x=-r * EULER, force_y=0.05 * r * EULER)["theta"].size
        for r in (least - 0.01, least + 0.01)
    ]
    assert least > 1.0
    assert counts == [1, 3]


def test_length_and_stiffness_only_scale():
    """Deflections are proportional to L; loads are drawn over Euler's load and do not change."""
    for chart in (column_chart, imperfect_chart):
        for one, two in zip(chart().lines, chart(length=3.0, stiffness=5.0).lines, strict=True):
            np.testing.assert_array_equal(two.x, 3.0 * one.x)
            np.testing.assert_array_equal(two.y, one.y)


@EACH_ENGINE
def test_a_bent_column_goes_straight_below_euler_and_stays_bent_above(engine, tmp_path):
    """A bent column of links is straight at 0.9 of the critical load and bent at 1.15172 of it.

    The latter is the load with k = 1/2; the column stays bent to the side on which it begins.
    """
    x, y, angle = tip_of_column(engine, tmp_path, 0.9 * EULER, 20, turn=1.0)
    assert (x, y, angle) == pytest.approx((1.0, 0.0, 0.0), abs=1e-10)  # residual over the stiffness
    reference = elastica(1.151719647)
    for side in (1.0, -1.0):
        tips = [tip_of_column(engine, tmp_path, 1.151719647 * EULER, n, side) for n in (20, 40)]
        limit = (4.0 * tips[1] - tips[0]) / 3.0
        # the error of order h^4, larger than elsewhere since P is 15 % above the critical load
        assert limit == pytest.approx(
            [reference["span"], side * reference["rise"], side * reference["angle"]], abs=1e-5
        )
        assert abs(tips[0][1] - limit[1]) > 1e-4


@pytest.mark.parametrize("n", [5, 10, 20])
def test_a_straight_chain_is_unstable_above_henckys_load(n, tmp_path):
    """In MuJoCo a straight chain is stable below Hencky's load and unstable above, within 1e-6.

    Hencky's load differs from Euler's by a term of second order in 1/n.
    """
    x, y, _ = tip_of_column("mujoco", tmp_path, (1.0 - 1e-6) * hencky_load(n), n)
    assert (x, y) == pytest.approx((1.0, 0.0), abs=1e-12)  # rounding
    with pytest.raises(BadModel, match="unstable"):
        tip_of_column("mujoco", tmp_path, (1.0 + 1e-6) * hencky_load(n), n)
    assert EULER - hencky_load(n) == pytest.approx(
        EULER * np.pi**2 / (48.0 * n**2), rel=1e-2
    )  # h^4


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("stiffness = 1.0      #", "stiffness = 1.02 #"),
        ("turn = 1.0 ", "turn = -1.0 "),
        ("segments = 40", 'segments = 40\nscheme = "naive"'),
    ],
)
def test_a_wrong_column_differs(old, new, edit):
    """A stiffer column, one on the other side and one with a soft clamp differ in both engines."""
    file = edit("rod_buckled.toml", old, new)
    assert {c.solver for c in all_comparisons(file) if c.outcome == "differs"} == set(ENGINES)


def test_bad_rods_in_space_are_refused_with_their_key():
    with pytest.raises(ValueError, match=r"share must be within \(0, 1\), got 0"):
        imperfect(share=0.0)
    with pytest.raises(ValueError, match="share must be one number"):
        imperfect(share=[0.1, 0.2])
    with pytest.raises(ValueError, match="stiffness"):
        buckling(stiffness=-1.0)
    for chart in (buckling, imperfect):
        with pytest.raises(ValueError, match="length must be a positive finite length"):
            chart(length=-1.0)
