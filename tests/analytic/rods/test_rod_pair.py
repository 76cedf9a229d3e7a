"""Two rods on one pin: shooting by scipy, units, and bad input."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.rods import rod_pair

PAIR = {
    "distance": 0.6,
    "theta1": np.radians(40.0),
    "theta2": np.radians(60.0),
    "force_x": 5.75,
    "force_y": -1.92,
    "pin_x": 0.19,
    "pin_y": 0.86,
    "moment1": 1.65,
    "moment2": -0.48,
    "push_x": 3.64,
    "push_y": 9.77,
}
S = np.array([0.0, 0.3, 1.0])


def test_scipy_s_shooting_reaches_the_pin():
    """Both rods, shot by scipy from their clamps, agree along their length and in their energy.

    The force on the first one follows from its moments at the clamp and at 0.3 of its length.
    """
    found, energy = rod_pair.solve(S, **PAIR), 0.0
    place = [found[f"x{k}"] + 1j * found[f"y{k}"] for k in (1, 2)]
    moments = [found[f"m{k}"] for k in (1, 2)]
    arms = np.array(
        [[z.imag[j] - z.imag[0], z.real[0] - z.real[j]] for z in place[:1] for j in (1, 2)]
    )
    force = np.linalg.solve(-arms, moments[0][0] - moments[0][1:])
    for k, n in ((1, force), (2, [PAIR["force_x"] - force[0], PAIR["force_y"] - force[1]])):

        def rate(s, z, n=n):
            turning = n[0] * np.sin(z[0]) - n[1] * np.cos(z[0])
            return [z[1], turning, np.cos(z[0]), np.sin(z[0]), 0.5 * z[1] ** 2]

        start = [PAIR[f"theta{k}"], -found[f"hold{k}"][0], place[k - 1][0].real, 0.0, 0.0]
        run = solve_ivp(rate, (0.0, 1.0), start, "DOP853", rtol=1e-12, atol=1e-14, t_eval=S)
        for name, curve in zip("tmxy", run.y, strict=False):
            # error of `integrate_to_tip`, of which the force of this test makes ten times as much
            np.testing.assert_allclose(found[f"{name}{k}"], curve, rtol=0, atol=1e-9)
        energy += run.y[4, -1]
    assert found["energy"][0] == pytest.approx(energy, rel=1e-9)
    np.testing.assert_allclose(moments, [[*one[:-1], 0.0] for one in moments], rtol=0, atol=1e-9)


@pytest.mark.parametrize(("length", "stiffness"), [(1e-6, 1e-12), (1e3, 1e9)])
def test_lengths_and_stiffness_only_scale(length, stiffness):
    """Places scale with L, moments and energy with EI/L, forces with EI/L^2."""
    moment, force = stiffness / length, stiffness / length**2
    units = {"distance": length, "pin": length, "moment": moment, "push": force, "force": force}
    given = {
        name: value * units.get(name.rstrip("12").partition("_")[0], 1.0)
        for name, value in PAIR.items()
    }
    one = rod_pair.solve(S, **PAIR)
    two = rod_pair.solve(S * length, **given, length=length, stiffness=stiffness)
    for name, unit in (("x2", length), ("t1", 1.0), ("m1", moment), ("energy", moment)):
        # rounding of the units, and Newton's tolerance
        np.testing.assert_allclose(two[name] / unit, one[name], rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"s": 2.0}, r"s must lie within \[0, 1.0\] \[m\], got 2.0"),
        ({"s": [0.5, np.nan]}, "s must lie within .* got nan"),
        ({"distance": -0.6}, r"distance must be zero or positive \[m\], got -0.6"),
        ({"distance": [0.6, 0.6]}, "distance must be zero or positive"),
        ({"distance": 2.1}, "clamps 1 and 2 are 2.1 m apart"),
        ({"length": [1.0, 1.0]}, "length must be a positive finite length"),
        ({"stiffness": 1e300}, "stiffness must be from 1e-40"),
        ({"theta1": [0.0, 1.0]}, "theta1 must be one number"),
        ({"push_y": np.nan}, "push_y must be finite"),
    ],
)
def test_bad_values_are_named(change, words):
    with pytest.raises(ValueError, match=words):
        rod_pair.solve(**{"s": 0.5} | PAIR | change)
