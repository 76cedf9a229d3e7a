"""What scripts of engines get ready: one joint on each link, forces in joints, rows at samples."""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.run.solve import prescribed_run
from proofmass.sim.interpreter.forces import drive_rates, joint_forces
from proofmass.sim.interpreter.inertias import armatures_with_rotors
from proofmass.sim.interpreter.mechanism import NeutralMechanism
from proofmass.sim.interpreter.record import rows_at_samples
from proofmass.sim.interpreter.tree import one_joint_each, tree_forces, tree_rows
from proofmass.sim.neutral import SUPPORT, read_mechanism
from tests.shipped import shipped, shipped_case


def mechanism_of(name: str) -> NeutralMechanism:
    """The mechanism of a shipped case in its run in time."""
    case = shipped_case(shipped(f"{name}.toml"))
    reader = read_mechanism(case.model_path, prescribed_run(case, "dynamics"), SUPPORT, None)
    return reader.mechanism(0.0)


def test_every_link_has_one_joint_one_joint_each() -> None:
    """Those that are new come last, without mass; joints keep their numbers and places."""
    given = mechanism_of("tower_crane")
    assert any(len(given.joints_of(k)) > 1 for k in range(len(given.links)))
    made = one_joint_each(given)
    added = len(made.links) - len(given.links)
    assert added > 0
    assert all(len(made.joints_of(k)) == 1 for k in range(1, len(made.links)))
    assert [one.mass for one in made.links[-added:]] == [0.0] * added
    for one, two in zip(given.joints, made.joints, strict=True):
        assert one.name == two.name
        assert one.anchor is two.anchor
    chain = made.joints[given.joints_of(given.joints[-1].child)[-1]]
    assert made.links[chain.child] is given.links[given.joints[-1].child]


def test_forces_in_joints_are_those_of_springs_and_motors() -> None:
    """A spring of two powers and a motor in the joint of a pendulum, and nothing if driven."""
    plain = mechanism_of("pendulum")
    (joint,) = plain.joints
    assert tree_forces(plain.step, tree_rows(plain)) is None
    spring, motor = np.array([2.0, 3.0, 5.0]), np.array([0.7])
    bent = replace(joint, spring=spring, rest=joint.value - 0.1, damping=0.4, force=motor)
    made = replace(plain, joints=(bent,))
    ((number, force),) = joint_forces(made, 0, lambda j: (0.1, 0.5))
    assert number == 0
    powers = 3.0 * 0.2**2 + 5.0 * 0.2**3
    assert force == pytest.approx(0.7 - 2.0 * 0.2 - powers - 0.4 * 0.5)
    forces = tree_forces(made.step, tree_rows(made))
    assert forces is not None
    assert forces(0.0, np.array([0.1])) == pytest.approx([0.7 - powers])


def test_a_drive_reaches_its_next_value_and_has_a_heavy_rotor() -> None:
    """The rate makes up for what the joint is behind; other joints keep their armatures."""
    given = mechanism_of("fourbar")
    (drive,) = given.drives
    ((number, rate),) = drive_rates(given, 0, lambda j: (-0.01, 0.0))
    assert number == drive.joint
    way = drive.value[2] - given.joints[number].value + 0.01
    assert rate == pytest.approx(way / given.step)
    armatures = armatures_with_rotors(given, 10.0)
    assert armatures[number] > 9.0 * sum(one.mass for one in given.links) * given.size**2
    others = [one for j, one in enumerate(armatures) if j != number]
    assert others == [one.armature for j, one in enumerate(given.joints) if j != number]


def test_rows_end_before_the_first_sample_that_was_not_hit() -> None:
    """An engine that gave up stores its last time, which is no sample."""
    given = mechanism_of("pendulum")
    every = given.count * given.step
    times = every * np.array([0.0, 1.0, 2.0, 2.4])
    (rows,) = rows_at_samples(given, [np.column_stack([times, np.arange(4.0)])])
    assert rows.tolist() == [[0.0], [1.0], [2.0]]
