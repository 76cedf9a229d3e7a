"""The creep of MuJoCo's contacts has the closed form that is told, in bare MuJoCo."""

import mujoco
import numpy as np
import pytest

from proofmass.sim.mujoco.contacts import creep_rate

ANGLE, FRICTION = 0.3, 0.6  # rad, 1: half of what friction can hold
SETTINGS = {
    "default": {},
    "impratio 10": {"impratio": 10.0},
    "a time constant of half": {"solref": (0.01, 1.0)},
    "stiffer impedance": {"impedance": 0.99},
    "stiffness and damping": {"solref": (-2000.0, -80.0)},
    "another damping ratio": {"solref": (0.02, 0.7), "impedance": 0.95, "impratio": 2.0},
}


SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'


def crept(step, geom="box", solref=(0.02, 1.0), impedance=0.9, impratio=1.0, joints=SLIDES):
    """Speed [m/s] at which a body of 2 kg slides down a slope in bare MuJoCo, after a second."""
    size = "0.1 0.1 0.02"
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="{step}" cone="elliptic"
      gravity="{-9.81 * np.sin(ANGLE)} 0 {-9.81 * np.cos(ANGLE)}" impratio="{impratio}"
      tolerance="1e-12"/>
      <default><geom friction="{FRICTION} 0 0" solref="{solref[0]} {solref[1]}"
      solimp="{impedance} {impedance}"/></default>
      <worldbody><geom type="plane" size="2 2 .1"/>
      <body pos="0 0 0.02">{joints}
      <geom type="{geom}" size="{size}" mass="2"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(1.0 / step))
    return -data.qvel[0]


@pytest.mark.parametrize("name", SETTINGS)
def test_creep_is_the_closed_form_at_every_step(name):
    told = creep_rate(pull=9.81 * np.sin(ANGLE), contacts=4, **SETTINGS[name])
    for step in (2e-3, 1e-3):
        assert crept(step, **SETTINGS[name]) == pytest.approx(told, rel=1e-5)


@pytest.mark.parametrize(
    ("joints", "share"), [("<freejoint/>", 1.0), (f'{SLIDES}<joint axis="0 1 0"/>', 2.0 / 3.0)]
)
def test_a_body_that_may_turn(joints, share):
    """Its contacts bear the weight unevenly and creep evenly, as MuJoCo's inverse mass has it."""
    told = creep_rate(pull=9.81 * np.sin(ANGLE), contacts=4, inverse_mass=share)
    assert crept(2e-3, joints=joints) == pytest.approx(told, rel=1e-4)


def test_a_sphere_has_one_contact():
    told = creep_rate(pull=9.81 * np.sin(ANGLE), contacts=1)
    assert crept(2e-3, "sphere") == pytest.approx(told, rel=1e-5)
    assert crept(2e-3, "sphere") != pytest.approx(told / 4, rel=0.5)


@pytest.mark.parametrize(
    "other", [{"impratio": 1.01}, {"impedance": 0.901}, {"solref": (0.0201, 1.0)}]
)
def test_other_settings_creep_otherwise(other):
    told = creep_rate(pull=9.81 * np.sin(ANGLE), contacts=4)
    assert crept(2e-3, **other) != pytest.approx(told, rel=1e-4)


@pytest.mark.parametrize(
    "wrong", [{"impedance": 1.0}, {"solref": (0.0, 1.0)}, {"pull": -1.0}, {"contacts": 0}]
)
def test_bad_parameters(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        creep_rate(**{"pull": 1.0, "contacts": 4, **wrong})
