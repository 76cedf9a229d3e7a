"""Tests of energy, its gradient, joint values and free directions, each against a second method."""

import numpy as np
import pytest

from proofmass import load_case
from proofmass.sim.mjcf import compile_model
from proofmass.sim.pymunk import kinematics
from proofmass.sim.pymunk.kinematics import (
    constraint_values,
    energy_gradient,
    find_modes,
    free_directions,
    jacobian,
    joint_value,
    joint_values,
    potential,
    values_of,
)
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.model import read_links
from tests.shipped import shipped

CASE_NAMES = [
    "hacksaw_cutting",
    "inverted_slider_crank",
    "threeprr",
    "balancer_weight",
    "balancer_progressive_contact",
    "rfr2_natural",
    "rod_into_circle",
]


def links_of(name: str) -> Links:
    case = load_case(shipped(f"{name}.toml"))
    model = compile_model(case.model_path, case.rods)
    return read_links(model, case.start, tuple(model.joint(d.joint).id for d in case.drive))


@pytest.mark.parametrize("name", CASE_NAMES)
def test_the_energy_gradient_is_the_derivative_of_the_energy(name):
    """The cases have hinges, slides, loops, springs, stops, weights, motors and dead loads.

    Poses are random and do not satisfy the constraints.
    """
    links = links_of(name)
    stops = tuple(joint for joint in links.joints if joint.limits)
    random = np.random.default_rng(1)
    pose = links.pose + 0.3 * random.normal(size=(3, *links.pose.shape))
    pull = random.normal(size=constraint_values(links, pose).shape[-1] + len(stops))

    def energy(p):
        constrained_values = np.concatenate(
            [constraint_values(links, p), values_of(stops, p)], axis=-1
        )
        return potential(links, p) - constrained_values @ pull

    found = energy_gradient(links, pose, pull, stops)
    for one, gradient in zip(pose, found, strict=True):
        truth = jacobian(energy, one)
        # rounding of sums
        np.testing.assert_allclose(
            gradient[:-1].ravel(), truth, atol=1e-13 * np.abs(truth).max(), rtol=0
        )


@pytest.mark.parametrize("name", CASE_NAMES)
def test_values_of_all_joints_equal_those_of_each_joint(name):
    links = links_of(name)
    pose = links.pose + 0.3 * np.random.default_rng(2).normal(size=(3, *links.pose.shape))
    alone = np.stack([joint_value(joint, pose) for joint in links.joints], axis=-1)
    # on some processors, sines of many angles at once and of one differ in the last digit
    np.testing.assert_allclose(joint_values(links, pose), alone, rtol=1e-14, atol=1e-14)
    table = links.joint_table
    for k, joint in enumerate(links.joints):
        found = table.joint_forces(alone)[..., k]
        wanted = joint.load + joint.spring_force(alone[..., k])
        np.testing.assert_allclose(found, wanted, rtol=1e-14, atol=1e-14 * (1 + abs(joint.load)))


@pytest.mark.parametrize("name", ["fourbar", *CASE_NAMES])
@pytest.mark.parametrize("doubled", [False, True])
def test_free_directions_by_qr_or_svd_span_the_free_motions(name, doubled, monkeypatch):
    """Free directions satisfy the constraints and are orthonormal, with masses as weights.

    Linearly dependent rows do not change their number; QR then leaves them to an SVD.  The forces
    of the constraints that balance a load best are those of the pseudoinverse.
    """
    links = links_of(name)
    pose = links.pose + 0.01 * np.random.default_rng(3).normal(size=links.pose.shape)
    pose[-1] = 0.0  # the ground
    rows = jacobian(lambda p: constraint_values(links, p), pose)
    given_rows = np.vstack([rows, rows[:1] + rows[-1:]]) if doubled else rows
    called = []
    svd = np.linalg.svd
    monkeypatch.setattr(
        kinematics.np.linalg, "svd", lambda *a, **k: called.append(1) or svd(*a, **k)
    )
    moves = free_directions(links, given_rows)
    assert bool(called) == doubled
    rank = np.linalg.matrix_rank(rows * links.sizes, tol=1e-9)
    assert rank == len(rows)
    assert len(moves) == rows.shape[1] - rank
    flat = moves[:, :-1].reshape(len(moves), rows.shape[1])
    weights = links.inertia[:-1].ravel()
    np.testing.assert_allclose(flat * weights @ flat.T, np.eye(len(flat)), atol=1e-12, rtol=0)
    violations = np.abs(flat @ rows.T)  # parts of a row times parts of a move, summed up
    assert (violations <= 1e-13 * (np.abs(flat) @ np.abs(rows).T).max(initial=1.0)).all()
    load = np.random.default_rng(4).normal(size=len(weights))
    forces = kinematics._split_by_rows(links, given_rows, load)[1]
    inverse = np.linalg.pinv((given_rows / weights**0.5).T, rcond=1e-9)
    wanted = inverse @ (load / weights**0.5)
    # rounding, times the condition of the rows
    np.testing.assert_allclose(forces, wanted, atol=1e-9 * np.abs(wanted).max(), rtol=0)


@pytest.mark.parametrize("name", CASE_NAMES)
def test_constraint_forces_balance_springs_and_weights(name):
    """With the constraint forces, the gradient of the energy has a part along free motions only."""
    links = links_of(name)
    modes = find_modes(links, links.pose, ())
    left = energy_gradient(links, links.pose, modes.pull, ())
    load = energy_gradient(links, links.pose, np.zeros_like(modes.pull), ())
    free = modes.sum(modes.of(left)) * links.inertia
    size = np.abs(load / links.inertia.clip(min=links.inertia[:-1].min()) ** 0.5).max()
    rest = (left - free)[:-1] / links.inertia[:-1] ** 0.5
    assert np.abs(rest).max() <= 1e-11 * size
