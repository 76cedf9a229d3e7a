"""Curves of closed forms have the powers of length, mass and time of their sensors' units."""

import numpy as np
import pytest

from proofmass import load_case
from proofmass.analytic.protocol import Ask, InputMotion, Length, Reference
from proofmass.base.units import unit_powers
from proofmass.reference.case_model import compiled_model
from proofmass.reference.dimensions import curve_powers
from proofmass.reference.find import reference_class
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.samples import run_samples
from proofmass.sim.contents import joints
from tests.shipped import shipped

CASES = (
    *("ball_bounces", "ball_rolls", "balls_in_row", "block_rocks", "block_slides", "fourbar"),
    *("fivebar", "hacksaw", "inverted_slider_crank", "swinging_block_forces", "pendulum"),
    *("slider_crank", "threeprr"),
)
"""A case with a run in time for each closed form but those of rods, which take a second each."""


@pytest.mark.parametrize("name", CASES)
def test_powers_are_those_of_the_units_of_sensors(name):
    """MuJoCo's sensors say what a channel is; nothing of that is known to the closed form."""
    case = load_case(shipped(f"{name}.toml"))
    x = run_samples(case, "dynamics")[1:60:13]
    drives = [np.broadcast_arrays(*profile(x)) for profile in drive_profiles(case, "dynamics")]
    units = [joints(compiled_model(case))[drive.joint] for drive in case.drive]
    state = tuple(map(np.array, zip(*drives, strict=True))) if drives else None
    motion = InputMotion(x, state)
    found = curve_powers(reference_class(case), case.parameters, motion, "m" in units)
    compared = {n: c for n, c in case.channels.items() if isinstance(c.equals, str)}
    assert compared
    curves = reference_class(case).evaluate(case.parameters, motion, Ask(inertia=True))
    for channel in compared.values():
        if channel.equals in found:
            assert found[channel.equals] == unit_powers(channel.unit)[:3], channel.equals
        else:
            assert not curves[channel.equals].any(), channel.equals


def test_a_hidden_constant_and_a_curve_of_zeros_are_left_out():
    class Hidden(Reference):
        crank: Length

        def solve(self, motion, ask):
            return {
                "whole": self.crank * np.cos(motion.x),
                "zero": 0.0 * motion.x,
                "length": self.crank + 0.0 * motion.x,
                "area": self.crank**2 + 0.0 * motion.x,
                "odd": self.crank + 0.1 + 0.0 * motion.x,
            }

    found = curve_powers(Hidden, {"crank": 1.0}, InputMotion(np.linspace(0.1, 1.0, 5)), False)
    assert found == {"length": (1.0, 0.0, 0.0), "area": (2.0, 0.0, 0.0)}
