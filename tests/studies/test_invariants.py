"""Invariants of a run: for which models the energy is one, and how far it is violated."""

import mujoco
import numpy as np
import pytest

from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.curves import Curves
from proofmass.studies import invariants as invariants_module
from proofmass.studies.invariants import invariants
from tests.shipped import shipped

MODEL = """<mujoco><option {option}/><worldbody><site name="a"/>
  <body pos="1 0 0"><joint name="turn" pos="-1 0 0" {joint}/><geom size="0.1"/><site name="b"/>
</body></worldbody>
<tendon><spatial name="cord" {tendon}><site site="a"/><site site="b"/></spatial></tendon>
<actuator>{actuator}</actuator>
<sensor><e_kinetic name="kinetic"/><e_potential name="potential"/></sensor></mujoco>"""
CURVES = Curves(
    np.linspace(0.0, 1.0, 3),
    {"kinetic": np.array([0.0, 2.0, 1.0]), "potential": np.array([5.0, 3.02, 4.01])},
    violation=1e-4,
)
"""The sum is 5, 5.02 and 5.01 J; the largest kinetic energy is 2 J."""


def violations(monkeypatch, name: str = "pendulum.toml", **changed: str) -> dict[str, float]:
    """The invariants of a case whose model is `MODEL` with changed attributes."""
    parts = dict.fromkeys(("option", "joint", "tendon", "actuator"), "") | changed
    model = mujoco.MjModel.from_xml_string(MODEL.format(**parts))
    monkeypatch.setattr(invariants_module, "compiled_model", lambda case: model)
    return invariants(load_case(shipped(name)), CURVES)


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"tendon": 'stiffness="10"'},
        {
            "joint": 'frictionloss="0.1"',
            "option": "><flag frictionloss='disable'/></option><option",
        },
    ],
    ids=["free", "spring", "friction that is off"],
)
def test_the_change_of_energy_is_a_share_of_the_largest_kinetic_energy(monkeypatch, changed):
    assert violations(monkeypatch, **changed) == {
        "violation": 1e-4,
        "energy": pytest.approx(0.02 / 2.0),
    }


@pytest.mark.parametrize(
    "changed",
    [
        {"joint": 'damping="0.1"'},
        {"joint": 'damping="0 0.1 0"'},
        {"joint": 'frictionloss="0.1"'},
        {"tendon": 'damping="0.1"'},
        {"tendon": 'damping="0 0 0.1"'},
        {"tendon": 'frictionloss="0.1"'},
        {"option": 'density="1.2"'},
        {"option": 'viscosity="2e-5"'},
        {"actuator": '<motor joint="turn"/>'},
        {"name": "fourbar.toml"},
    ],
    ids=str,
)
def test_energy_is_no_invariant_where_something_takes_or_gives_it(monkeypatch, changed):
    """Linear and other damping of joints and tendons, friction, a fluid, a motor, a drive."""
    assert violations(monkeypatch, **changed) == {"violation": 1e-4}


@pytest.mark.parametrize(("axial", "stretch"), [(None, {"stretch": 0.0}), (1e3, {})])
def test_rods_have_no_stretch_only_if_none_of_them_can_stretch(axial, stretch):
    case = load_case(shipped("rod_cantilever.toml"))
    rods = {**case.rod, "other": case.rod["rod"].model_copy(update={"axial": axial})}
    found = invariants(case.model_copy(update={"rod": rods}), Curves(np.zeros(1), {}))
    found.pop("violation")
    assert found == stretch
