"""Euler's columns against the tip's closed form, eigenvalues and recomputed constants."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from proofmass.analytic.rods import critical, elastica, ends_meet, shape, tip
from proofmass.analytic.rods.column import ENDS, QUARTER_WAVES

DATA = json.loads((Path(__file__).parents[2] / "data" / "rod_elliptic.json").read_text())
EULER = {
    "clamped-free": 2.467401100272340,
    "pinned-pinned": 9.869604401089358,
    "clamped-pinned": 20.19072855642663,
    "clamped-clamped": 39.47841760435743,
}


@pytest.mark.parametrize("ends", ENDS)
def test_critical_loads(ends):
    """Critical loads are those of Euler, also for the document's steel rods."""
    found = critical(ends, length=2.0, stiffness=0.3)
    assert found == pytest.approx(EULER[ends] * 0.3 / 4.0, rel=1e-15, abs=0)
    # recomputed loads of the document's rods of 1.5 and 2 mm
    for diameter, loads in (
        (1.5e-3, (0.128763859, 1.053673894)),
        (2e-3, (0.406957381, 3.330129837)),
    ):
        stiffness = 210e9 * np.pi * (diameter / 2.0) ** 4 / 4.0
        for name, load in zip(("clamped-free", "clamped-pinned"), loads, strict=True):
            assert critical(name, stiffness=stiffness) == pytest.approx(load, abs=6e-10)


@pytest.mark.parametrize("ends", ENDS)
def test_critical_loads_as_eigenvalues(ends):
    """Ritz's method gives the critical load: EI int w''^2 = P int w'^2.

    w is a polynomial of a degree up to 13 that satisfies the conditions of the supports.
    """
    clamped = (
        2 if ends.startswith("clamped") else 1,
        {"free": 0, "pinned": 1, "clamped": 2}[ends.split("-")[1]],
    )
    base = (
        np.polynomial.Polynomial([0, 1]) ** clamped[0]
        * np.polynomial.Polynomial([1, -1]) ** clamped[1]
    )
    shapes = [base * np.polynomial.Polynomial.basis(k) for k in range(10)]

    def product(order):
        parts = [p.deriv(order) for p in shapes]
        whole = [[(a * b).integ() for b in parts] for a in parts]
        return np.array([[w(1.0) - w(0.0) for w in row] for row in whole])

    lowest = eigh(product(2), product(1), eigvals_only=True)[0]
    assert lowest == pytest.approx(critical(ends), rel=1e-7)  # monomials lose half the digits


def test_buckled_clamped_free_column_is_the_tip_under_its_axial_load():
    for k, ratio, x, y in DATA["postbuckling"]["rows"]:
        true = (2.0 * ellipk(k * k) / np.pi) ** 2
        assert true == pytest.approx(ratio, abs=6e-8)  # errors of its last digits, up to 5e-8
        bent = elastica(true)
        assert bent["k"] == pytest.approx(k, abs=1e-14 / k)  # P/P_cr - 1 is k^2/2
        assert [bent["span"], bent["rise"]] == pytest.approx([x, y], abs=6e-9)  # last digit
        rod = tip(np.pi, float(bent["k"]))
        assert rod["R"] / critical() == pytest.approx(true, rel=1e-12)
        assert rod["x"] == pytest.approx(float(bent["span"]), abs=1e-12)
        assert rod["y"] == pytest.approx(float(bent["rise"]), abs=1e-12)
        assert rod["theta"] == pytest.approx(float(bent["angle"]), abs=1e-12)
        assert rod["energy"] == pytest.approx(float(bent["energy"]), abs=1e-12)


@pytest.mark.parametrize(("ends", "quarters"), QUARTER_WAVES.items())
def test_columns_are_quarter_waves(ends, quarters):
    """A column consists of n quarter waves of length L/n, each with the shape of a clamped rod."""
    bent = elastica(1.7, ends, length=1.2, stiffness=0.4)
    part = tip(np.pi, float(bent["k"]), length=1.2 / quarters, stiffness=0.4)
    assert part["R"] == pytest.approx(1.7 * critical(ends, length=1.2, stiffness=0.4), rel=1e-12)
    assert quarters * part["x"] == pytest.approx(float(bent["span"]), rel=1e-12, abs=0)
    rises = 2.0 if ends == "clamped-clamped" else 1.0
    assert rises * part["y"] == pytest.approx(float(bent["rise"]), rel=1e-12, abs=0)
    assert quarters * part["energy"] == pytest.approx(float(bent["energy"]), rel=1e-12, abs=0)


def test_the_load_does_the_work_of_the_energy():
    """dU = -P d(span), by central differences."""
    load, step = 1.5, 1e-5
    ahead, behind = (elastica(load + d, "pinned-pinned") for d in (step, -step))
    work = load * critical("pinned-pinned") * (behind["span"] - ahead["span"])
    assert ahead["energy"] - behind["energy"] == pytest.approx(float(work), rel=1e-7)  # step^2


def test_the_ends_of_a_pinned_column_meet_at_a_known_load():
    """The ends of a pinned column meet where 2 E = K, at P/P_cr = (2 K/pi)^2 and angle 2 asin k."""
    k, ratio = ends_meet()
    phi = np.pi / 200 * np.arange(200)  # the mean of a periodic function, exact to rounding

    def mean(k, power):  # of cos(theta)^power over the arc, with sin(theta/2) = k sin(phi)
        square = (k * np.sin(phi)) ** 2
        return np.mean((1.0 - 2.0 * square) ** power / np.sqrt(1.0 - square))

    modulus = brentq(mean, 0.8, 0.99, args=(1,), xtol=1e-15)
    assert k == pytest.approx(modulus, abs=1e-14)  # rounding of 200 terms over the slope
    assert ratio == pytest.approx(mean(modulus, 0) ** 2, rel=1e-13, abs=0)
    assert 2.0 * ellipe(k * k) - ellipk(k * k) == pytest.approx(0.0, abs=1e-14)
    assert elastica(ratio, "pinned-pinned")["span"] == pytest.approx(0.0, abs=1e-14)
    angle = np.degrees(elastica(ratio, "pinned-pinned")["angle"])
    assert angle == pytest.approx(np.degrees(2.0 * np.arcsin(modulus)), abs=1e-10)
    half = shape(np.pi, k, 1, np.linspace(0.0, 1.0, 3))  # from its middle to one end
    assert half["x"][-1] == pytest.approx(0.0, abs=1e-15)


def test_just_beyond_the_critical_load():
    """The rise is sqrt(8 (P/P_cr - 1)) L/pi to first order."""
    excess = 1e-6
    bent = elastica(1.0 + excess, "pinned-pinned")
    # next term of the expansion, relative: 19/16 excess
    assert bent["rise"] == pytest.approx(np.sqrt(8.0 * excess) / np.pi, rel=1.2e-6)
    assert elastica(1.0)["rise"] == pytest.approx(0.0, abs=1e-7)  # root of a rounding error


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: critical("free-free"), "ends must be one of clamped-free"),
        (lambda: elastica(1.2, "clamped-pinned"), "ends must be one of"),
        (lambda: elastica(0.9), "load must be at least 1"),
        (lambda: elastica(1e4), "less than 1e4 critical loads"),
        (lambda: elastica(1.2, stiffness=[1.0, 2.0]), "stiffness must be positive"),
        (lambda: critical(length=1e-30, stiffness=1e300), "stiffness must be from 1e-40 to"),
        (lambda: critical(length=-1.0), "length must"),
        (lambda: critical(stiffness=0.0), "stiffness"),
    ],
)
def test_bad_value_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
