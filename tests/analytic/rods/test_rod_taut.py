"""Straight or taut rods between a clamp and a pin: a second formulation, and small sags."""

import numpy as np
import pytest

from proofmass.analytic.remember import use_memory
from proofmass.analytic.rods import rod_pinned
from proofmass.analytic.rods.rod_pinned import pinned, solve
from tests.independent.rods.cosserat import Section
from tests.independent.rods.cosserat import pinned as collocated

TAUT = {"pin_x": 1.0, "pin_y": 0.0, "length": 0.98, "stiffness": 0.05, "axial": 50.0}
GUESS = {"force_x": 1.3, "force_y": 0.4, "moment": -0.07}
LEANING = {"weight_x": 0.3, "weight_y": -1.0, "shear": 30.0}


def test_collocation_in_the_frame_of_the_sections():
    """All curves of a taut rod that shears are those of a second formulation, to 1e-8."""
    s = np.linspace(0.0, 0.98, 8)
    reference = collocated(s, Section(0.05, 50.0, 30.0), (1.0, 0.0), (0.3, -1.0))
    rod = solve(s, **TAUT, **GUESS, **LEANING)
    for name, values in reference.items():
        # tolerance of the collocation for its residual, summed
        np.testing.assert_allclose(rod[name], values, rtol=0, atol=1e-8)


@pytest.mark.parametrize("length", [0.98, 1.0])
def test_a_small_sag_is_that_of_a_beam_in_tension(length):
    """A small weight bends a straight rod like a beam in tension.

    The linear equation is EI theta'' = (1 + T/EA) (T theta - V - w (L - s)).
    """
    small, s, ei, ea = 1e-5, np.linspace(0.0, length, 9), 0.05, 50.0
    stretch = 1.0 / length
    tension = ea * (stretch - 1.0)
    if tension:
        k = np.sqrt(stretch * tension / ei)
        # theta = a cosh(k s) + b sinh(k s) + (V + w (L - s))/T
        end, mean = k * length, length / tension
        rows = [
            [1.0, 0.0, 1.0 / tension],
            [k * np.sinh(end), k * np.cosh(end), 0.0],
            [np.sinh(end) / k, (np.cosh(end) - 1.0) / k, mean],
        ]
        weight = [-length / tension, 1.0 / tension, -(length**2) / (2.0 * tension)]
        a, b, v = np.linalg.solve(rows, weight)
        theta = a * np.cosh(k * s) + b * np.sinh(k * s) + (v + length - s) / tension
    else:  # the propped beam: y = w s^2 (3 L^2 - 5 L s + 2 s^2)/(48 EI)
        theta = s * (6.0 * length**2 - 15.0 * length * s + 8.0 * s**2) / (48.0 * ei)
    guess = {"force_x": tension, "force_y": -0.4 * small, "moment": 0.1 * small}
    rod = solve(s, **TAUT | {"length": length}, **guess, weight_y=small)
    # terms of third order in the weight, and Newton's 1e-12 over the weight
    np.testing.assert_allclose(rod["theta"] / small, theta, rtol=0, atol=2e-6)


def test_the_pin_s_force_keeps_the_rod_in_balance():
    """The clamp's moment balances those of the pin's force and of the weight about the clamp."""
    s, weights = np.polynomial.legendre.leggauss(30)
    rod = solve(0.49 * (1.0 + s), **TAUT, **GUESS, **LEANING)
    moment = -0.49 * weights @ (rod["x"] + 0.3 * rod["y"]) + rod["force_y"][0]
    assert moment == pytest.approx(-rod["hold"][0], abs=1e-11)  # rounding, order 8


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"axial": 0.0}, "^axial must be a positive stiffness"),
        ({"shear": np.nan}, "^shear must be a positive stiffness"),
        ({"axial": np.inf}, "^length must reach beyond the pin"),
        ({"weight_y": np.nan}, "^weight_y must be finite"),
    ],
)
def test_bad_values_are_named(given, message):
    with pytest.raises(ValueError, match=message):
        solve(0.5, **TAUT | GUESS | given)


def test_a_straight_rod_stretches_to_its_pin():
    """The pin's force is that of a rod with axial stiffness, EA (1/L - 1), and has no moment."""
    rod = pinned(1.0, 0.0, (1.0, 0.0, 0.0), length=0.98, axial=50.0)
    assert rod.converged
    # Newton's tolerance of 1e-12 of the length, times EA
    np.testing.assert_allclose(rod.unknowns, [50.0 * (1.0 / 0.98 - 1.0), 0.0, 0.0], atol=1e-9)


def test_neighbours_share_a_search(monkeypatch):
    """A parameter changed by 1e-6 needs three Newton steps or fewer from its neighbour's root.

    Differences over 1e-6 and 4e-6 give the same derivative.
    """
    steps, newton = [], rod_pinned.newton

    def counted(*given):
        log, size = newton(*given)
        steps.append(log.iterations)
        return log, size

    monkeypatch.setattr(rod_pinned, "newton", counted)
    numbers, memory = TAUT | GUESS | {"weight_y": -1.01}, {}
    with use_memory(memory, store_results=True):
        solve(0.5, **numbers)
    searched = steps[0]
    steps.clear()
    with use_memory(memory, store_results=False):
        up, down, wide, narrow = (
            solve(0.5, **numbers | {"weight_y": -1.01 + h})["y"] for h in (1e-6, -1e-6, 4e-6, -4e-6)
        )
    assert searched > 4 > max(steps)
    # error of Newton's last step over 1e-6
    assert (up - down) / 2e-6 == pytest.approx((wide - narrow) / 8e-6, rel=1e-4)
