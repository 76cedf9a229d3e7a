"""Quick tasks for tests of studies: the pendulum for 0.5 s, in time steps of 10 ms and less."""

import tempfile
from pathlib import Path

import pytest

from proofmass.run.sidecar import load_case
from proofmass.studies.measure import StudyRun
from proofmass.studies.record import Setting
from tests.shipped import MODELS

TIME_STEPS = 0.01, 0.005, 0.0025, 0.002, 0.001
SERIES_PARAMETERS = (
    ("mujoco", {"integrator": "Euler"}),
    ("mujoco", {"integrator": "RK4"}),
    ("mujoco", {"integrator": "implicitfast"}),
    ("pymunk", {"iterations": 10}),
)


def tasks(models: Path = MODELS / "linkages") -> list[StudyRun]:
    """The runs of four convergence series with five time steps each."""
    case = load_case(models / "pendulum.toml")
    short = case.run["dynamics"].model_copy(update={"until": 0.5, "n": 51})
    case = case.model_copy(update={"run": {"dynamics": short}})
    return [
        StudyRun(
            case,
            "dynamics",
            Setting(engine, {**parameters, "timestep": step}),
            "trade",
            f"{engine} {' '.join(map(str, parameters.values()))}",
            "timestep",
            step,
        )
        for engine, parameters in SERIES_PARAMETERS
        for step in TIME_STEPS
    ]


@pytest.fixture(autouse=True)
def own_locks(tmp_path_factory, monkeypatch):
    """Give each test lock files of its own, so that no other study on this machine delays it."""
    folder = str(tmp_path_factory.mktemp("locks"))
    monkeypatch.setenv("TMPDIR", folder)
    monkeypatch.setattr(tempfile, "tempdir", folder)
