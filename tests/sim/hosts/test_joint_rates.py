"""Laws of what impulse engines get in common: velocities from rates of joints, and open starts."""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.run.solve import prescribed_run
from proofmass.sim.interpreter.forces import link_forces
from proofmass.sim.interpreter.joint_rates import follow_joints
from proofmass.sim.interpreter.mechanism import LinkStates, NeutralMechanism
from proofmass.sim.interpreter.starts import (
    move_links,
    start_of_links,
    start_openings,
    start_velocity,
)
from proofmass.sim.neutral import NeutralReader, read_mechanism
from tests.shipped import shipped, shipped_case

LOOPS = "fourbar", "threeprr", "inverted_slider_crank", "delta", "stewart", "universal_joint"


def reader_of(name: str) -> NeutralReader:
    """A shipped model in the start of its run in time."""
    case = shipped_case(shipped(f"{name}.toml"))
    run = prescribed_run(case, "dynamics")
    return read_mechanism(case.model_path, replace(run, settings={}))


def states_at_start(mechanism: NeutralMechanism) -> LinkStates:
    """The states of all links at the start, with rates of joints and without velocities."""
    states = LinkStates.empty(replace(mechanism, samples=1))
    rows = [(one.value, one.rate, 0.0) for one in mechanism.joints]
    states.coordinates = np.array(rows).T[:, None]
    for k, one in enumerate(mechanism.links):
        kinds = [mechanism.joints[j].kind for j in mechanism.joints_of(k)]
        if "free" in kinds:
            states.velocity[0, k] = one.velocity
        if "free" in kinds or "ball" in kinds:
            states.omega[0, k] = one.omega
    return states


@pytest.mark.parametrize(
    "name", ["driven_cart", "threeprr", "delta", "stewart", "heavy_top", "tower_crane"]
)
def test_links_move_with_the_rates_of_joints(name):
    mechanism = reader_of(name).mechanism()
    states = states_at_start(mechanism)
    follow_joints(mechanism, states)
    for k, one in enumerate(mechanism.links):
        assert states.velocity[0, k] == pytest.approx(one.velocity, abs=1e-12)
        assert states.omega[0, k] == pytest.approx(one.omega, abs=1e-12)


def speeds_of_loops(mechanism: NeutralMechanism) -> np.ndarray:
    """The rates at which the loops open at the start (loops, 3) [m/s]."""

    def speed(k: int, at: np.ndarray) -> np.ndarray:
        one = mechanism.links[k]
        return start_velocity(mechanism, k) + np.cross(one.omega, at - one.centre)

    return np.array([speed(o.b, o.on_b) - speed(o.a, o.on_a) for o in mechanism.loops])


@pytest.mark.parametrize("name", LOOPS)
def test_a_start_opens_loops_by_a_step_of_their_rate(name):
    reader = reader_of(name)
    mechanism = reader.mechanism(-0.5 * reader.step)
    speeds = speeds_of_loops(mechanism)
    assert np.abs(speeds).max() > 1e-6
    for share in (1.0, 0.2):
        shifts, turns = move_links(mechanism, start_openings(mechanism, share))

        def moved(k: int, at: np.ndarray, shifts=shifts, turns=turns) -> np.ndarray:
            return shifts[k] + np.cross(turns[k], at - mechanism.links[k].centre)

        opened = [moved(o.b, o.on_b) - moved(o.a, o.on_a) for o in mechanism.loops]
        wanted = mechanism.step / share * speeds
        assert np.array(opened) == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("name", LOOPS)
def test_the_plain_reading_starts_closed(name):
    mechanism = reader_of(name).mechanism()
    assert not start_openings(mechanism, 1.0).any()
    places, turns, velocities = map(np.array, zip(*start_of_links(mechanism), strict=True))
    assert np.array_equal(places, [one.centre for one in mechanism.links])
    assert np.array_equal(velocities, [one.velocity for one in mechanism.links])
    assert not turns.any()


def test_springs_pull_their_ends_together_with_one_force():
    mechanism = reader_of("andrews").mechanism()
    here = {
        k: (one.centre, np.eye(3), one.velocity, one.omega) for k, one in enumerate(mechanism.links)
    }
    pulls = list(link_forces(mechanism, 0, here.__getitem__))
    (spring,) = mechanism.springs
    for link, place, force, moment in pulls:
        near, far = (spring.on_a, spring.on_b) if link == spring.a else (spring.on_b, spring.on_a)
        way = far - near
        length = np.linalg.norm(way)
        assert place == pytest.approx(near)
        assert force == pytest.approx(spring.pull(length, 0.0) * way / length)
        assert not moment.any()
    assert {link for link, *_ in pulls} == {spring.a, spring.b} - {0}
