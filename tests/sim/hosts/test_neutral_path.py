"""The path through plain data, a pipe and states of links, held against the built-in engine.

MuJoCo 4.0.0 in another interpreter must have the errors of MuJoCo 4.0.0 in this one: what differs
is the reading of the model, the message, and the evaluation of sensors from states.
"""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.case.case import Case
from proofmass.run.solve import prescribed_run, settings_of
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.failures import Unsupported
from proofmass.verdict.compare import compare
from tests.engines import why_not_there
from tests.shipped import MODELS, shipped, shipped_case

PATH_SHARE = 1e-5
"""Deviation of an error, as a share of itself, that rounding explains: an error of 1e-9 of a
coordinate of size 1 has seven digits, of which evaluation from states may change the last two."""
ROUNDING = 1e-11
"""Error, as a share of the range, below which an error is rounding itself, and so is its change."""
FEW = ("pendulum", "fourbar_forces", "andrews", "tower_crane", "heavy_top", "delta")
"""Cases of the quick test: springs between points, energies, balls, quaternions, and moments of
drives and forces of pins, in the plane and with a ball."""
CASES = sorted(path.stem for path in MODELS.rglob("*.toml"))


@pytest.fixture(scope="module", autouse=True)
def version() -> str:
    """The version in another interpreter."""
    if why := why_not_there("mujoco==4.0.0"):
        pytest.skip(why)
    return "mujoco==4.0.0"


def errors_of(case: Case, solver: str) -> dict[str, tuple[float, float]]:
    """By channel the largest error, absolute and as a share of the range."""
    settings = settings_of(case, "dynamics", "mujoco")
    run = replace(prescribed_run(case, "dynamics"), settings=settings)
    curves = engine_of(solver).simulate(case.model_path, run)
    found = compare(case, "dynamics", "mujoco", curves, detectable=False)
    return {c.channel: (c.error_max, c.relative_to_range) for c in found}


def check_path(name: str, version: str) -> int:
    """Compare the errors of both ways; the number of channels that both have."""
    case = shipped_case(shipped(f"{name}.toml"))
    own, through = errors_of(case, "mujoco"), errors_of(case, version)
    there = 0
    for channel, (error, share) in own.items():
        other = through[channel][0]
        if np.isnan(other):  # a channel that is not evaluated from states
            continue
        there += 1
        if share > ROUNDING:
            assert other == pytest.approx(error, rel=PATH_SHARE), channel
        elif share > 0:
            assert other <= error + ROUNDING * error / share, channel
    return there


@pytest.mark.parametrize("name", FEW)
def test_path_keeps_errors(name: str, version: str) -> None:
    """The errors are those of the built-in engine to five digits."""
    assert check_path(name, version) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_path_keeps_errors_of_every_case(name: str, version: str) -> None:
    """The same for every case with a run in time; one with rods of the sidecar is refused."""
    case = shipped_case(shipped(f"{name}.toml"))
    if "dynamics" not in case.run:
        pytest.skip("it has no run in time")
    try:
        assert check_path(name, version) >= 1
    except Unsupported as refused:
        assert case.rods, refused  # noqa: PT017
