"""Tests of closed forms of MuJoCo's contacts, in bare MuJoCo: creep, and contacts by rounding."""

import numpy as np
import pytest

from docs.make.contacts import CREEPS, SLIDES, SLOPE, crept, hanging, phantom_depth
from proofmass.sim.mujoco.contacts import creep_rate

CREEP_SETTINGS = {
    **CREEPS,
    "another damping ratio": {"solref": (0.02, 0.7), "impedance": 0.95, "impratio": 2.0},
}


@pytest.mark.parametrize("name", CREEP_SETTINGS)
def test_creep_is_the_closed_form_at_every_step(name):
    predicted = creep_rate(pull=9.81 * np.sin(SLOPE), contacts=4, **CREEP_SETTINGS[name])
    for step in (2e-3, 1e-3):
        assert crept(step, **CREEP_SETTINGS[name]) == pytest.approx(predicted, rel=1e-5)


@pytest.mark.parametrize(
    ("joints", "share"), [("<freejoint/>", 1.0), (f'{SLIDES}<joint axis="0 1 0"/>', 2.0 / 3.0)]
)
def test_a_body_that_may_turn_creeps_by_its_inverse_mass(joints, share):
    """The contacts carry the weight unevenly and creep at one speed.

    MuJoCo's inverse mass of the body determines it.
    """
    predicted = creep_rate(pull=9.81 * np.sin(SLOPE), contacts=4, inverse_mass=share)
    assert crept(2e-3, joints=joints) == pytest.approx(predicted, rel=1e-4)


def test_a_sphere_creeps_with_one_contact():
    predicted = creep_rate(pull=9.81 * np.sin(SLOPE), contacts=1)
    assert crept(2e-3, geom="sphere") == pytest.approx(predicted, rel=1e-5)
    assert crept(2e-3, geom="sphere") != pytest.approx(predicted / 4, rel=0.5)


@pytest.mark.parametrize(
    "other", [{"impratio": 1.01}, {"impedance": 0.901}, {"solref": (0.0201, 1.0)}]
)
def test_other_settings_have_another_creep(other):
    predicted = creep_rate(pull=9.81 * np.sin(SLOPE), contacts=4)
    assert crept(2e-3, **other) != pytest.approx(predicted, rel=1e-4)


@pytest.mark.parametrize(
    "wrong", [{"impedance": 1.0}, {"solref": (0.0, 1.0)}, {"pull": -1.0}, {"contacts": 0}]
)
def test_invalid_parameters_of_the_creep_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        creep_rate(**{"pull": 1.0, "contacts": 4, **wrong})


@pytest.mark.parametrize("tilt", [1e-16, 1e-15, 1e-14, 1e-13, 1e-12])
def test_a_cylinder_above_a_floor_has_a_contact_by_rounding(tilt):
    """In a range of tilts MuJoCo 4.0.0 finds a contact of a cylinder that hangs above a floor.

    There should be none; the depth of the contact has a closed form.
    """
    hits, deepest, energy = hanging(tilt, "0 0 0", 1000)
    known = phantom_depth(tilt)
    assert (hits > 0, energy > 0) == (known > 0, known > 0)
    assert deepest == pytest.approx(known, rel=1e-3)
    assert (known > 0) == (tilt in (1e-15, 1e-14, 1e-13))
