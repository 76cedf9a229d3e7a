"""A pendulum that extends as it leans: virtual work, least energy, engines, and design."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from proofmass.analytic.balancer import flexing, solve
from proofmass.analytic.balancer.measures import TARGETS, weight_target
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.design.template import write_case
from proofmass.verdict.outcome import GOOD_OUTCOMES
from tests.analytic.balancer.balancer_table import parameters, rows
from tests.verdicts import all_comparisons

LINE_1766 = parameters(rows()["1766"])
EACH_LINE = pytest.mark.parametrize("line", ["1743", "1766", "1745", "1744"])
EXTENSION = {"extension1": 0.02, "extension2": 0.03}
ANGLES = np.radians([5.0, 25.0, 45.0, 65.0])


def pendulum_length(alpha):
    return 1.0 + 0.02 * alpha + 0.03 * alpha**2


def length_slope(alpha):
    return 0.02 + 0.06 * alpha


@EACH_LINE
def test_drives_of_both_joints_do_the_whole_work(line):
    """dV/dalpha = holding + extension force x dr/dalpha, without weight the balancing moment.

    The slope is by differences of the energy, which do not use any force.
    """
    chain, h = parameters(rows()[line]) | EXTENSION, 1e-4
    for weight in (0.0, 0.8):
        there, above, below = (
            solve(ANGLES + step, weight=weight, **chain) for step in (0.0, h, -h)
        )
        slope = (above["energy"] - below["energy"]) / (2.0 * h)
        work = there["holding_moment"] + there["extension_force"] * length_slope(ANGLES)
        assert slope == pytest.approx(work, abs=2e-7)  # h^2 V'''/6
        fall = weight * (
            pendulum_length(ANGLES) * np.sin(ANGLES) - length_slope(ANGLES) * np.cos(ANGLES)
        )
        assert work == pytest.approx(there["balancing_moment"] - fall, abs=1e-13)
    assert np.abs(there["balancing_moment"] - there["moment1"]).max() > 1e-3


def test_the_chain_takes_the_least_energy_by_the_law_of_cosines():
    """Energy of three linear springs over the angle of segment 1, with r(alpha) in the triangle."""
    l1, l2, l3 = (LINE_1766[f"length{i}"] for i in (1, 2, 3))
    k = [LINE_1766[f"stiffness{i}"] for i in (1, 2, 3)]

    def angles(theta, alpha, r):
        gap = r * np.exp(1j * (np.pi / 2 - alpha)) - l1 * np.exp(1j * (np.pi / 2 - theta))
        d, toward = abs(gap), np.pi / 2 - np.angle(gap)
        near = np.arccos((d**2 + l2**2 - l3**2) / (2 * d * l2))
        far = np.arccos((d**2 + l3**2 - l2**2) / (2 * d * l3))
        return np.array([theta, toward - near, toward + far])

    rest = angles(LINE_1766["rest_angle"], 0.0, 1.0)
    found = solve(ANGLES, **LINE_1766, **EXTENSION)
    for n, alpha in enumerate(ANGLES):

        def energy(theta, alpha=alpha):
            e = np.diff(angles(theta, alpha, pendulum_length(alpha)) - rest, prepend=0.0)
            return 0.5 * (e**2 @ k)

        near = found["theta1"][n]
        best = minimize_scalar(energy, bounds=(near - 0.2, near + 0.2), options={"xatol": 1e-10})
        assert near == pytest.approx(best.x, abs=1e-7)  # square root of rounding
        assert found["energy"][n] == pytest.approx(best.fun, abs=1e-14)


def test_weight_target_is_its_energy_slope_and_a_sine_if_not_extended():
    target = weight_target(0.02, 0.03)
    step = 1e-30
    slope = -target.height_energy(ANGLES + 1j * step).imag / step
    assert target(ANGLES) == pytest.approx(slope, abs=1e-15)
    assert weight_target(0.0, 0.0)(ANGLES) == pytest.approx(TARGETS["sine"](ANGLES), abs=1e-15)
    found = solve(ANGLES, target="weight", weight=1.0, **LINE_1766, **EXTENSION)
    assert found["target"] == pytest.approx(target(ANGLES), abs=1e-15)
    assert found["target_energy"] == pytest.approx(found["weight_energy"], abs=1e-15)


def test_two_drives_and_one_angle_give_the_same_moment():
    time = np.linspace(0.0, 2.0, 21)
    value, rate, acceleration = flexing(time, **EXTENSION)
    assert value[1] == pytest.approx(pendulum_length(value[0]) - 1.0, abs=1e-15)
    both, one = (
        solve(value, rate, acceleration, **LINE_1766, **EXTENSION),
        solve(value[0], **LINE_1766, **EXTENSION),
    )
    assert np.array_equal(both["holding_moment"], one["holding_moment"])
    h = 1e-5
    slopes = [
        (up - down) / (2.0 * h)
        for up, down in zip(
            flexing(time + h, **EXTENSION)[:2], flexing(time - h, **EXTENSION)[:2], strict=True
        )
    ]
    assert slopes[0] == pytest.approx(rate, abs=1e-8)  # h^2 a'''/6
    assert slopes[1] == pytest.approx(acceleration, abs=1e-7)


def test_rmse_of_a_design_is_that_of_its_residual():
    variant = Variant("weight", free_angle=True, extension=(0.02, 0.03))
    task = Synthesis(variant, weight_target(0.02, 0.03))
    vector = variant.vector(LINE_1766)[None]
    known = solve(task.angles, target="weight", **LINE_1766, **EXTENSION)["residual"]
    assert task.figures(vector).rmse[0] == pytest.approx(np.sqrt(np.mean(known**2)), rel=1e-9)
    rigid_rmse = Synthesis(Variant("sine", free_angle=True), np.sin).figures(vector).rmse[0]
    assert task.figures(vector).rmse[0] > 2 * rigid_rmse  # the design is for a constant length


def test_a_pendulum_of_no_length_is_refused():
    with pytest.raises(ValueError, match="pendulum must keep a positive length"):
        solve(ANGLES, extension1=-2.0, **LINE_1766)


LONGER_PENDULUM = 'name="pendulum_tip" pos="0 1.0 0"', 'name="pendulum_tip" pos="0 1.0000001 0"'


@pytest.mark.parametrize(
    "change", [{}, {"extension2": 0.03001}, {"extension1": 0.0}, LONGER_PENDULUM]
)
def test_engines_agree_and_a_wrong_extension_differs(change, tmp_path):
    file = write_case(
        tmp_path,
        "case",
        title="t",
        source="s",
        parameters=LINE_1766 | EXTENSION | {"weight": 1.0},
        target="weight",
    )
    text = file.read_text().replace("n = 181", "n = 5")
    if change is LONGER_PENDULUM:
        model = file.with_suffix(".xml")
        assert LONGER_PENDULUM[0] in model.read_text()
        model.write_text(model.read_text().replace(*LONGER_PENDULUM))
    else:
        for name, value in change.items():  # only in the reference, not in the drive
            text = text.replace(f"{name} = {EXTENSION[name]}", f"{name} = {value}", 1)
    file.write_text(text)
    differing = {
        c.solver for c in all_comparisons(file) if c.outcome not in (*GOOD_OUTCOMES, "unsupported")
    }
    assert differing == ({"mujoco", "pymunk"} if change else set())
