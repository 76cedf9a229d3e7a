"""Newton in an interpreter of its own: loops in the plane and in space, drives, refusals.

A step takes 0.1 s of a processor, so that runs have a few samples.
"""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.reference.run_reference import RunReference
from proofmass.run.solve import prescribed_run
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Unsupported
from tests.engines import why_not_there
from tests.shipped import shipped, shipped_case


@pytest.fixture(scope="module", autouse=True)
def newton() -> None:
    """Skip where uv cannot get it."""
    if why := why_not_there("newton"):
        pytest.skip(why)


def first_samples(name: str, samples: int) -> tuple[Curves, dict[str, np.ndarray]]:
    """The curves of the first samples of a case, and the reference at its drives."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = prescribed_run(case, "dynamics")
    run = replace(run, x=run.x[:samples], settings={})
    curves = engine_of("newton").simulate(case.model_path, run)
    return curves, RunReference(case, "dynamics", curves).as_driven(curves.drive).channels


@pytest.mark.parametrize(
    ("name", "channels", "most"),
    [
        # lengths of 0.1 to 1 m; single precision and the regularization of 1e-6 open loops by 1e-5
        ("fourbar", ("pin.x", "pin.y", "rocker"), 5e-5),
        ("threeprr", ("p.x", "p.y"), 1e-4),
        ("spherical_fourbar", ("pin.x", "pin.y", "pin.z"), 5e-5),
    ],
)
def test_driven_loops_follow_the_reference(name, channels, most):
    curves, exact = first_samples(name, 4)
    for channel in channels:
        assert np.ptp(exact[channel]) > 3 * most, channel
        assert np.abs(curves.channels[channel] - exact[channel]).max() < most, channel


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gear_pair", "'mesh'"),
        ("delta", "'left_1' with several joints"),
        ("driven_cart", "'upper' with an inertia of 1e-09 kg m2"),
    ],
)
def test_it_refuses_by_name(name, said):
    with pytest.raises(Unsupported, match=said):
        first_samples(name, 3)
