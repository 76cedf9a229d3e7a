"""Settings that studies try in engines of other interpreters."""

from typing import get_args

import pytest

from proofmass import load_case
from proofmass.run.solve import describe_dynamics
from proofmass.sim.engines import engine_of, hosted_names
from proofmass.sim.hosts.engine import HostedEngine
from proofmass.sim.protocol.tuning import Studied
from tests.shipped import MODELS


@pytest.fixture(scope="module")
def about() -> Studied:
    """What is studied: the motion of a four-bar."""
    return describe_dynamics(load_case(MODELS / "linkages/fourbar_released.toml"))


@pytest.mark.parametrize("name", hosted_names())
def test_engines_have_all_settings_that_are_tried(name: str, about: Studied) -> None:
    """Each setting is one that the engine reads, in a scan with a name of its own."""
    engine = engine_of(name)
    scans = list(engine.tuning.scans(about))
    assert len({scan.name for scan in scans}) == len(scans) > 0
    for scan in scans:
        sizes = [engine.tuning.size(scan.varied, one[scan.varied]) for one in scan.settings]
        assert sizes == sorted(sizes, reverse=True)
        assert all(engine.settings.read(one) for one in scan.settings)
    for recipe in engine.tuning.recipes(about):
        assert engine.settings.read({**recipe.parameters(1e-3), "timestep": 1e-3})


STEPPED = ("bullet", "box2d", "dart", "drake", "exudyn", "pinocchio", "rapier")


@pytest.mark.parametrize("name", STEPPED)
def test_steps_are_varied_with_all_schemes_and_with_defaults(name: str, about: Studied) -> None:
    """An engine is tried as it comes, and in each of its ways to step."""
    engine = engine_of(name)
    assert isinstance(engine, HostedEngine)
    scans = list(engine.tuning.scans(about))
    assert {scan.varied for scan in scans} == {"timestep"}
    assert any(scan.settings[0].get("defaults") for scan in scans)
    field = engine.settings.model_fields.get("scheme")
    tried = {scan.settings[0].get("scheme", field and field.default) for scan in scans}
    assert tried >= set(get_args(field.annotation) if field else ())
    assert any(recipe.plain for recipe in engine.tuning.recipes(about))


def test_an_engine_that_chooses_its_steps_is_asked_for_accuracies(about: Studied) -> None:
    """Its step is that of a record, on which no error depends."""
    scans = list(engine_of("simbody").tuning.scans(about))
    assert {scan.varied for scan in scans} == {"accuracy"}
    values = [one["accuracy"] for scan in scans for one in scan.settings]
    assert (max(values), min(values)) == (0.1, 1e-13)
