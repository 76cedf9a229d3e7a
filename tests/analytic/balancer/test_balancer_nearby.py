"""Equilibria from those of a balancer nearby are the ones that following its own path gives."""

import numpy as np
import pytest

from proofmass.analytic.balancer import balancer, nearby, solve
from proofmass.analytic.balancer import friction as friction_module
from proofmass.analytic.balancer.friction import follow_with_friction
from proofmass.analytic.balancer.nearby import path_to
from proofmass.analytic.balancer.path import follow
from proofmass.analytic.remember import use_memory
from proofmass.run.sidecar import load_case
from tests.shipped import shipped

NEAR = 1e-6
"""The change of a parameter that sensitivities use, as a share of it."""
ANGLES = np.linspace(0.0, np.pi / 2, 31)
THERE_AND_BACK = np.radians([*np.linspace(0.0, 60.0, 7), *np.linspace(50.0, 0.0, 6)])


def parameters_of(name: str) -> dict:
    """The numbers of a shipped balancer that change its curves."""
    given = load_case(shipped(f"{name}.toml")).parameters
    return {k: v for k, v in given.items() if not k.startswith(("target", "expected"))}


def near(name: str, key: str) -> dict:
    """The numbers of a shipped balancer, one of them changed a little."""
    given = parameters_of(name)
    return {**given, key: given[key] * (1.0 + NEAR)}


def counted(patch: pytest.MonkeyPatch, module, name: str) -> list:
    """The calls of a function of a module from now on."""
    calls, original = [], getattr(module, name)
    patch.setattr(module, name, lambda *given: calls.append(given) or original(*given))
    return calls


@pytest.mark.parametrize("name", ["balancer_sine", "balancer_progressive_contact", "balancer4_sam"])
def test_curves_near_a_known_path_are_those_of_the_own_path(name, monkeypatch):
    follows, memory = counted(monkeypatch, nearby, "follow"), {}
    with use_memory(memory, store_results=True):
        known = solve(ANGLES, **parameters_of(name))
    assert len(follows) <= 1
    for key in ("length1", "stiffness2", "pendulum"):
        follows.clear()
        with use_memory(memory, store_results=False):
            found = solve(ANGLES, **near(name, key))
        assert follows == [], "the path was followed again"
        own = solve(ANGLES, **near(name, key))
        for curve, values in own.items():
            moved = np.abs(values - known[curve]).max()
            np.testing.assert_allclose(
                found[curve], values, rtol=0, atol=1e-6 * moved + 1e-11, err_msg=f"{key}: {curve}"
            )


def test_a_stop_that_switches_between_other_samples_is_noticed(monkeypatch):
    """The chain leaves its stop at another angle, past a sample: its own path is followed."""
    name = "balancer_progressive_contact"
    chain = balancer(**parameters_of(name))
    switches = follow(chain, np.pi / 2).switches
    at = switches[0][2]
    others = [follow(balancer(**near(name, key)), np.pi / 2).switches[0][2] for key in LENGTHS]
    key, later = max(zip(LENGTHS, others, strict=True), key=lambda one: abs(one[1] - at))
    assert abs(later - at) > 1e-9
    angles = np.array([0.0, 0.5 * (at + later), 1.5])
    follows, memory = counted(monkeypatch, nearby, "follow"), {}
    with use_memory(memory, store_results=True):
        path_to(chain, np.pi / 2, angles)
    follows.clear()
    with use_memory(memory, store_results=False):
        path_to(balancer(**near(name, key)), np.pi / 2, angles)
    assert len(follows) == 1


LENGTHS = ["length1", "length2", "length3"]


def with_friction(given: dict):
    """The chain and the friction of its joints of some numbers."""
    own = {k: v for k, v in given.items() if "friction" not in k}
    return balancer(**own), np.array([given.get(f"friction{i}", 0.0) for i in (1, 2, 3)])


@pytest.mark.parametrize("key", ["length2", "stiffness3", "friction3"])
def test_a_loop_near_a_known_one_is_its_own(key, monkeypatch):
    """Also its events are those of the known loop, though they come at other angles."""
    name, memory = "balancer_prototype", {}
    follows = counted(monkeypatch, friction_module, "follow_slips")
    with use_memory(memory, store_results=True):
        known, _ = follow_with_friction(*with_friction(parameters_of(name)), THERE_AND_BACK)
    follows.clear()
    with use_memory(memory, store_results=False):
        found, held = follow_with_friction(*with_friction(near(name, key)), THERE_AND_BACK)
    assert follows == [], "the loop was followed again"
    own, own_held = follow_with_friction(*with_friction(near(name, key)), THERE_AND_BACK)
    moved = np.abs(own.theta - known.theta).max() + np.abs(own.moment - known.moment).max()
    assert moved > 1e-8
    np.testing.assert_allclose(found.theta, own.theta, rtol=0, atol=1e-3 * moved)
    np.testing.assert_allclose(found.moment, own.moment, rtol=0, atol=1e-3 * moved)
    np.testing.assert_allclose(held, own_held, rtol=0, atol=1e-3 * moved)


def test_a_loop_of_other_angles_is_followed(monkeypatch):
    """A loop turns where its angles do: that of other ones, as near as they are, is no start."""
    given, memory = with_friction(parameters_of("balancer_prototype")), {}
    follows = counted(monkeypatch, friction_module, "follow_slips")
    with use_memory(memory, store_results=True):
        follow_with_friction(*given, THERE_AND_BACK)
    follows.clear()
    with use_memory(memory, store_results=False):
        follow_with_friction(*given, THERE_AND_BACK * (1.0 + NEAR))
    assert len(follows) == 1
