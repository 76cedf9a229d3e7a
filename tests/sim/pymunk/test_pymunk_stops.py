"""Tests of light chains on their stops in pymunk, for which its solver needs many iterations.

Source: S. van Nes, The use of a rigid linkage balancer with torsion springs to realize nonlinear
moment-angle characteristics, MSc thesis TU Delft 2022.074 (van Nes 2022).
"""

import re
from pathlib import Path

import numpy as np
import pytest

from proofmass.design.template import write_case
from proofmass.sim.protocol.failures import NotSolved
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk import quasi_static
from proofmass.sim.pymunk.engine import simulate

# lines 2119 and 2169 of the thesis's text, whose preloads are never released
LOCKED_BALANCERS = {
    "three": {
        "length1": 0.4056,
        "length2": 0.3925,
        "length3": 0.4953,
        "rest_angle": 0.8973,
        "preload2": 0.5217,
        "low2": 0.0,
        **{f"stiffness{k}": 2.0217 for k in (1, 2, 3)},
        **{f"quadratic{k}": -0.958 for k in (1, 2, 3)},
    },
    "four": {
        "length1": 0.25,
        "length2": 0.2501,
        "length3": 0.25,
        "length4": 0.2501,
        "preload2": 0.6911,
        "preload3": 0.4107,
        "low2": 0.0,
        "low3": 0.0,
        **{f"stiffness{k}": 2.4835 for k in (1, 2, 3, 4)},
        **{f"quadratic{k}": -1.5903 for k in (1, 2, 3, 4)},
    },
}
# random lengths and springs with which joint 3 comes to its stop in steps of 1e-12 rad
BALANCER_WITH_SHORT_STEPS = {
    "length1": 0.35671057,
    "length2": 0.3456592,
    "length3": 0.44842218,
    "length4": 0.17554,
    "stiffness1": 4.3498,
    "stiffness2": 0.2945,
    "stiffness3": 1.518,
    "stiffness4": 0.0373,
    "preload3": 0.6971,
    "low3": 0.0,
    "rest_angle": 0.0606,
    "rest_angle2": -0.308,
    "mode": -1,
}
# random lengths and springs of a chain that is straight to 0.02 rad: a repetition of the
# iterations leaves much of an error
NEARLY_STRAIGHT_BALANCER = {
    "length1": 0.23149409,
    "length2": 0.28570825,
    "length3": 0.20806789,
    "length4": 0.27494166,
    "stiffness1": 0.1752,
    "stiffness2": 0.9795,
    "stiffness3": 0.7184,
    "stiffness4": 3.989,
    "preload2": 0.9402,
    "low2": 0.0,
    "high3": 0.967,
    "mode": -1,
}


def light_balancer_curves(folder: Path, parameters, degrees, channels):
    """Curves of a sweep of a balancer with segments of 1 to 4 g and a pendulum of 1 kg."""
    file = write_case(folder, "light", title="", source="", parameters=parameters)
    drive = Drive("pendulum", lambda x: (x, 0 * x, 0 * x))
    return simulate(
        file.with_suffix(".xml"), Run("sweep", np.radians(degrees), channels, (drive,))
    ).channels


@pytest.mark.parametrize("name", LOCKED_BALANCERS)
def test_a_large_preload_keeps_a_joint_on_its_stop(name, tmp_path):
    """Joint 2 stays on its stop, and the chain turns as a whole: M = k1 alpha + A1 alpha^2."""
    degrees = np.array([5.0, 10.0])
    got = light_balancer_curves(
        tmp_path, LOCKED_BALANCERS[name], degrees, ("deflection2", "holding_moment")
    )
    k, a, alpha = (
        LOCKED_BALANCERS[name]["stiffness1"],
        LOCKED_BALANCERS[name]["quadratic1"],
        np.radians(degrees),
    )
    np.testing.assert_allclose(got["deflection2"], 0, atol=1e-11)  # left within 1e-12 rad
    # 1e-12 of the mechanism a step; a chain straight but for 0.02 rad magnifies it
    np.testing.assert_allclose(got["holding_moment"], alpha * (k + a * alpha), atol=1e-9, rtol=0)


def test_a_step_without_solution_after_all_iterations_is_an_error(tmp_path, monkeypatch):
    """Tens of thousands of iterations are needed where a joint comes to its stop."""
    monkeypatch.setattr(quasi_static, "MAX_REPEATED_ITERATIONS", 2000)
    with pytest.raises(NotSolved, match="a step is not solved after 2000 iterations"):
        light_balancer_curves(tmp_path, LOCKED_BALANCERS["four"], [5.0], ("holding_moment",))


def test_a_joint_on_its_stop_is_no_error_of_the_model_if_the_loops_are_closed(
    tmp_path, monkeypatch
):
    """Here no number of short steps counts as rest."""
    monkeypatch.setattr(quasi_static, "STEPS_AT_REST", 1000)
    monkeypatch.setattr(quasi_static, "STEP_LIMITS", {True: 40})
    with pytest.raises(NotSolved, match="not at rest after 40 steps") as caught:
        light_balancer_curves(tmp_path, LOCKED_BALANCERS["four"], [5.0], ("holding_moment",))
    (gap,) = re.findall(r"open by (\S+) m", str(caught.value))
    assert float(gap) < 1e-15  # rounding of a mechanism of 1 m, which differs between processors


@pytest.mark.parametrize("doubt", [6, 8])
def test_a_short_step_next_to_a_stop_is_no_equilibrium(doubt, tmp_path, monkeypatch):
    """A short step next to a stop is not taken as an equilibrium.

    The holding moment is not read in such a step either, since rounding of 1e-16 m divided by the
    square of the step is a large moment.
    """
    monkeypatch.setattr(
        quasi_static, "STEPS_BEFORE_CHECK", doubt
    )  # the steps begin anew often and close to the stop
    got = light_balancer_curves(
        tmp_path,
        BALANCER_WITH_SHORT_STEPS,
        np.arange(5.0, 95.0, 5.0),
        ("deflection1", "holding_moment"),
    )
    # rest, to 1e-12 rad; the moment of spring 1 is all that holds the chain about O
    np.testing.assert_allclose(
        got["holding_moment"], 4.3498 * got["deflection1"], atol=1e-10, rtol=0
    )


def test_a_slowly_converging_solver_is_repeated(tmp_path):
    """The iterations are repeated until a step is solved.

    A repetition changes less than the remaining error; if it were taken as solved, the moves would
    oscillate without end.
    """
    got = light_balancer_curves(
        tmp_path, NEARLY_STRAIGHT_BALANCER, [10.0, 20.0], ("deflection1", "holding_moment")
    )
    # rest, to 1e-12 rad; the moment of spring 1 is all that holds the chain about O
    np.testing.assert_allclose(
        got["holding_moment"], 0.1752 * got["deflection1"], atol=1e-10, rtol=0
    )
