"""A preload of spring 3 of three segments: release, energies, preloads that never release.

The second formulation closes the chain by circles, as `tests.analytic.balancer.balancer_chain`, and
finds the least energy among the postures that the stop allows.
"""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from proofmass.analytic.balancer import along, balancer, events, follow, path, solve
from proofmass.analytic.balancer.measures import warnings
from proofmass.analytic.balancer.model import balancers
from proofmass.analytic.balancer.path import rest_posture, system
from tests.analytic.balancer.balancer_chain import segment_angles

CHAIN = {
    "length1": 0.45,
    "length2": 0.47,
    "length3": 0.46,
    "stiffness1": 1.2,
    "stiffness2": 0.3,
    "stiffness3": 0.2,
}
CLOSING = {"preload3": 0.3, "low3": 0.0, "rest_angle": 0.5}
OPENING = {"preload3": -0.3, "high3": 0.0, "rest_angle": -0.5}
RELEASED_AT_ONCE = {"preload3": -0.3, "high3": 0.0}
EACH_PRELOAD = pytest.mark.parametrize("preload", [CLOSING, OPENING, RELEASED_AT_ONCE])
LENGTHS = {"length": (0.45, 0.47, 0.46)}


def joint_deflections(theta1, alpha, rest_angle):
    """Deflections (3, ...) of the joints with the elbow up, by the intersection of circles."""
    rest = segment_angles(LENGTHS, rest_angle, 0.0)
    theta = segment_angles(LENGTHS, theta1, alpha)
    return np.diff(theta - rest.reshape(3, *[1] * (theta.ndim - 1)), axis=0, prepend=0.0)


def energy(theta1, alpha, preload):
    """Energy [J] of the springs less their energy at rest; infinite beyond the stop."""
    with np.errstate(invalid="ignore"):  # an arm that does not reach
        e = joint_deflections(theta1, alpha, preload.get("rest_angle", 0.0))
    stiff = np.array([1.2, 0.3, 0.2]).reshape(3, *[1] * (e.ndim - 1))
    found = (0.5 * stiff * e**2).sum(axis=0) + preload["preload3"] * e[2]
    return np.where(np.sign(preload["preload3"]) * e[2] > -1e-9, found, np.inf)


@EACH_PRELOAD
def test_the_chain_takes_the_least_energy_that_the_stop_allows(preload):
    alphas = np.radians([4.0, 12.0, 25.0, 50.0, 88.0])
    found = solve(alphas, **CHAIN, **preload)
    for k, alpha in enumerate(alphas):
        near = found["theta1"][k]
        grid = near + np.linspace(-0.3, 0.3, 6001)
        start = grid[energy(grid, alpha, preload).argmin()]
        best = minimize_scalar(
            energy, (start - 1e-4, start, start + 1e-4), args=(alpha, preload), tol=1e-12
        ).x
        # position of a minimum: root of rounding, divided by the root of the stiffness; of a locked
        # joint: the slack of 1e-9 of the stop, divided by the slope of e3
        assert near == pytest.approx(best, abs=3e-7 if preload is RELEASED_AT_ONCE else 1e-7)


@pytest.mark.parametrize("preload", [CLOSING, OPENING])
def test_joint_3_releases_where_its_load_reaches_the_preload(preload):
    """Locked segments 2 and 3 are a bar without moments: its force points from P1 to the tip."""
    rest = segment_angles(LENGTHS, preload["rest_angle"], 0.0)
    steps = 1j * np.array(LENGTHS["length"]) * np.exp(-1j * rest)
    p1, p2 = steps[0], steps[0] + steps[1]
    bar = (1j - p1) / abs(1j - p1)
    about = [(np.conj(1j - p) * bar).imag for p in (0.0, p2)]  # arms of a unit force at the tip
    alpha = abs(preload["preload3"]) / CHAIN["stiffness1"] * abs(about[0] / about[1])
    assert events(**CHAIN, **preload) == {"joint 3 released": pytest.approx(alpha, abs=1e-12)}
    below, above = solve(np.array([0.99, 1.01]) * alpha, **CHAIN, **preload)["deflection3"]
    assert abs(below) < 1e-14  # rounding
    assert np.sign(above) == np.sign(preload["preload3"])


@pytest.mark.parametrize("mode", [1, -1])
def test_deflection_of_joint_3_grows_with_the_square_of_beta(mode):
    """e3 = -mode c b^2 with b = beta, c by the law of cosines: q dq = r l1 sin b db at b = 0."""
    chain = CHAIN | {"mode": mode} | {"preload3": -0.3 * mode}
    chain |= {"high3": 0.0} if mode > 0 else {"low3": 0.0}
    l1, l2, l3 = LENGTHS["length"]
    q = 1.0 - l1
    c = l1 / (2.0 * l2 * l3 * np.sqrt(1.0 - ((l2**2 + l3**2 - q**2) / (2.0 * l2 * l3)) ** 2))
    for alpha in (1e-2, -1e-2):
        found = solve(np.array([alpha]), **chain)
        b = found["theta1"][0] - alpha
        assert found["deflection3"][0] == pytest.approx(-mode * c * b**2, rel=1e-3)  # O(b^2)
        assert found["node3_load"][0] == pytest.approx(found["moment3"][0], abs=1e-14)
        assert abs(found["moment3"][0]) == pytest.approx(0.3, abs=1e-4)  # k3 e3
    assert follow(balancer(**chain), 1.0).switches == []


@EACH_PRELOAD
def test_the_rest_posture_is_an_equilibrium_with_its_preload(preload):
    """Also where a force along the pendulum, and not the stop, carries the preload of joint 3."""
    chain = balancer(**CHAIN, **preload)
    residual, _ = system(chain, rest_posture(chain))
    assert np.abs(residual).max() < 1e-15  # of a preload of 0.3 N m


@EACH_PRELOAD
def test_moment_is_the_slope_of_the_energy(preload):
    h, at = 1e-4, np.radians([5.0, 30.0, 60.0, 85.0])
    nodes = at[:, None] + h * np.array([-1.0, 1.0])
    slope = np.diff(solve(nodes, **CHAIN, **preload)["energy"])[:, 0] / (2.0 * h)
    # h^2 M1''/6, with M1'' below 3 N m/rad^2
    assert slope == pytest.approx(solve(at, **CHAIN, **preload)["balancing_moment"], abs=1e-8)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"preload3": 0.3, "low3": 0.0}, "preload3 can never release.*high3 = 0 with a negative"),
        (
            {"preload3": -0.3, "high3": 0.0, "mode": -1},
            "preload3 can never release.*low3 = 0 with a positive",
        ),
        ({"low3": 0.0}, "preload3 can never release.*got 0 N m"),
        (
            RELEASED_AT_ONCE | {"preload2": 0.1, "low2": 0.0},
            "at most 1 of the joints of 3 segments",
        ),
        ({"preload3": 0.3}, "preload3 needs a stop that holds it at rest, low = 0"),
    ],
)
def test_a_preload_that_can_never_release_is_an_error(wrong, said):
    with pytest.raises(ValueError, match=said):
        solve(np.array([0.1]), **CHAIN, **wrong)


def test_a_path_ends_if_a_joint_meets_and_leaves_stops_too_often(monkeypatch):
    assert follow(balancer(**CHAIN, **CLOSING), 1.0).why == [""]
    monkeypatch.setattr(path, "MAX_SWITCHES", 0)
    assert "a joint rattles on its stop" in follow(balancer(**CHAIN, **CLOSING), 1.0).why[0]


def test_members_of_a_batch_that_can_never_release_are_nan():
    each = CHAIN | {"preload3": np.array([0.3, -0.3]), "rest_angle": np.array([0.0, 0.5])}
    batch = balancers(**each, low3=np.array([0.0, -np.inf]), high3=np.array([np.inf, 0.0]))
    assert np.isnan(batch.stiffness).all(axis=1).tolist() == [True, False]
    assert np.isfinite(batch.stiffness[1]).all()


def test_values_beyond_the_end_of_a_path_are_nan():
    """A path that is followed to 0.5 rad has no values at larger angles."""
    chain = balancer(**CHAIN, **CLOSING)
    found = along(chain, follow(chain, 0.5), np.array([0.1, 0.5, 0.51, 1.0]))
    for name in ("theta", "moment", "energy", "force"):
        known = np.isfinite(getattr(found, name)[0]).all(axis=-1)
        assert known.tolist() == [True, True, False, False], name


def test_a_warning_names_a_stop_that_the_load_presses():
    """Segment 1 behind the pendulum opens the elbow and presses joint 3 onto its stop.

    At angles below zero the joint leaves the stop: this is no error, a drive may go there.
    """
    pressed = CHAIN | CLOSING | {"rest_angle": -0.5}
    (warning,) = warnings(**pressed)
    assert warning.endswith("locked, and the load presses it onto its stop all the more")
    assert set(events(**pressed)) == set()
    assert np.ptp(solve(np.linspace(-1.0, 0.0, 20), **pressed)["deflection3"]) > 0.01


def test_a_preload_on_another_joint_changes_the_moment():
    at = np.radians([40.0, 80.0])
    second = CLOSING | {"preload2": 0.3, "low2": 0.0, "preload3": 0.0, "low3": -np.inf}
    found = [solve(at, **CHAIN, **given)["balancing_moment"] for given in (CLOSING, second)]
    assert np.abs(found[0] - found[1]).min() > 0.05
