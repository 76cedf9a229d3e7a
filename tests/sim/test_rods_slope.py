"""The written-out slope of pymunk's energy, against complex steps of the energy itself."""

import numpy as np
import pytest

from proofmass import load_case
from proofmass.sim.mjcf import compile_model
from proofmass.sim.pymunk.kinematics import bound, jacobian, potential, slope, values
from proofmass.sim.pymunk.model import read_links
from tests.shipped import shipped

NAMES = [
    "hacksaw_cutting",
    "inverted_slider_crank",
    "threeprr",
    "balancer_weight",
    "balancer_progressive_contact",
    "rfr2_natural",
    "rod_into_circle",
]


@pytest.mark.parametrize("name", NAMES)
def test_the_slope_is_that_of_the_energy(name):
    """Hinges, slides, loops, springs, stops, weights, motors and dead loads, in wild poses."""
    case = load_case(shipped(f"{name}.toml"))
    model = compile_model(case.model_path, case.rods)
    links = read_links(model, case.start, tuple(model.joint(d.joint).id for d in case.drive))
    stops = tuple(joint for joint in links.joints if joint.limits)
    random = np.random.default_rng(1)
    pose = links.pose + 0.3 * random.normal(size=(3, *links.pose.shape))
    pull = random.normal(size=bound(links, pose).shape[-1] + len(stops))

    def energy(p):
        held = np.concatenate([bound(links, p), values(stops, p)], axis=-1)
        return potential(links, p) - held @ pull

    found = slope(links, pose, pull, stops)
    for one, there in zip(pose, found, strict=True):
        truth = jacobian(energy, one)
        # rounding of sums
        np.testing.assert_allclose(there[:-1].ravel(), truth, atol=1e-13 * np.abs(truth).max())
