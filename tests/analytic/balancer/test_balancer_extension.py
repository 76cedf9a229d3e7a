"""A pendulum that extends as it leans: virtual work, least energy, engines, and design."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from proofmass.analytic.balancer import flexing, solve
from proofmass.analytic.balancer.measures import TARGETS, weight_target
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.design.template import write_case
from proofmass.outcome import GOOD_OUTCOMES
from tests.analytic.balancer.balancer_table import parameters, rows
from tests.verdicts import verdicts

FREE = parameters(rows()["1766"])
LINES = pytest.mark.parametrize("line", ["1743", "1766", "1745", "1744"])
GROWS = {"extension1": 0.02, "extension2": 0.03}
ANGLES = np.radians([5.0, 25.0, 45.0, 65.0])


def reach(alpha):
    return 1.0 + 0.02 * alpha + 0.03 * alpha**2


def stretch(alpha):
    return 0.02 + 0.06 * alpha


@LINES
def test_drives_of_both_joints_do_all_work(line):
    """dV/dalpha = holding + extension force x dr/dalpha, without weight the balancing moment.

    The slope is by differences of the energy, which do not use any force.
    """
    given, h = parameters(rows()[line]) | GROWS, 1e-4
    for weight in (0.0, 0.8):
        there, above, below = (
            solve(ANGLES + step, weight=weight, **given) for step in (0.0, h, -h)
        )
        slope = (above["energy"] - below["energy"]) / (2.0 * h)
        work = there["holding_moment"] + there["extension_force"] * stretch(ANGLES)
        assert slope == pytest.approx(work, abs=2e-7)  # h^2 V'''/6
        fall = weight * (reach(ANGLES) * np.sin(ANGLES) - stretch(ANGLES) * np.cos(ANGLES))
        assert work == pytest.approx(there["balancing_moment"] - fall, abs=1e-13)
    assert np.abs(there["balancing_moment"] - there["moment1"]).max() > 1e-3


def test_the_chain_takes_the_least_energy_by_the_law_of_cosines():
    """Energy of three linear springs over the angle of segment 1, with r(alpha) in the triangle."""
    l1, l2, l3 = (FREE[f"length{i}"] for i in (1, 2, 3))
    k = [FREE[f"stiffness{i}"] for i in (1, 2, 3)]

    def angles(theta, alpha, r):
        gap = r * np.exp(1j * (np.pi / 2 - alpha)) - l1 * np.exp(1j * (np.pi / 2 - theta))
        d, toward = abs(gap), np.pi / 2 - np.angle(gap)
        near = np.arccos((d**2 + l2**2 - l3**2) / (2 * d * l2))
        far = np.arccos((d**2 + l3**2 - l2**2) / (2 * d * l3))
        return np.array([theta, toward - near, toward + far])

    rest = angles(FREE["rest_angle"], 0.0, 1.0)
    found = solve(ANGLES, **FREE, **GROWS)
    for n, alpha in enumerate(ANGLES):

        def energy(theta, alpha=alpha):
            e = np.diff(angles(theta, alpha, reach(alpha)) - rest, prepend=0.0)
            return 0.5 * (e**2 @ k)

        near = found["theta1"][n]
        best = minimize_scalar(energy, bounds=(near - 0.2, near + 0.2), options={"xatol": 1e-10})
        assert near == pytest.approx(best.x, abs=1e-7)  # square root of rounding
        assert found["energy"][n] == pytest.approx(best.fun, abs=1e-14)


def test_weight_is_the_target_of_its_own_energy_and_the_sine_without_extension():
    target = weight_target(0.02, 0.03)
    step = 1e-30
    slope = -target.height_energy(ANGLES + 1j * step).imag / step
    assert target(ANGLES) == pytest.approx(slope, abs=1e-15)
    assert weight_target(0.0, 0.0)(ANGLES) == pytest.approx(TARGETS["sine"](ANGLES), abs=1e-15)
    found = solve(ANGLES, target="weight", weight=1.0, **FREE, **GROWS)
    assert found["target"] == pytest.approx(target(ANGLES), abs=1e-15)
    assert found["target_energy"] == pytest.approx(found["weight_energy"], abs=1e-15)


def test_two_drives_or_one_angle_give_the_same():
    time = np.linspace(0.0, 2.0, 21)
    value, rate, acceleration = flexing(time, **GROWS)
    assert value[1] == pytest.approx(reach(value[0]) - 1.0, abs=1e-15)
    both, one = solve(value, rate, acceleration, **FREE, **GROWS), solve(value[0], **FREE, **GROWS)
    assert np.array_equal(both["holding_moment"], one["holding_moment"])
    h = 1e-5
    slopes = [
        (up - down) / (2.0 * h)
        for up, down in zip(
            flexing(time + h, **GROWS)[:2], flexing(time - h, **GROWS)[:2], strict=True
        )
    ]
    assert slopes[0] == pytest.approx(rate, abs=1e-8)  # h^2 a'''/6
    assert slopes[1] == pytest.approx(acceleration, abs=1e-7)


def test_a_design_is_worth_its_virtual_work():
    variant = Variant("weight", free_angle=True, extension=(0.02, 0.03))
    task = Synthesis(variant, weight_target(0.02, 0.03))
    vector = variant.vector(FREE)[None]
    known = solve(task.angles, target="weight", **FREE, **GROWS)["residual"]
    assert task.figures(vector).rmse[0] == pytest.approx(np.sqrt(np.mean(known**2)), rel=1e-9)
    still = Synthesis(Variant("sine", free_angle=True), np.sin).figures(vector).rmse[0]
    assert task.figures(vector).rmse[0] > 2 * still  # the design is for a constant length


def test_a_pendulum_of_no_length_is_refused():
    with pytest.raises(ValueError, match="pendulum must keep a positive length"):
        solve(ANGLES, extension1=-2.0, **FREE)


TALLER = 'name="pendulum_tip" pos="0 1.0 0"', 'name="pendulum_tip" pos="0 1.0000001 0"'


@pytest.mark.parametrize("change", [{}, {"extension2": 0.03001}, {"extension1": 0.0}, TALLER])
def test_engines_agree_and_another_extension_turns_the_verdict(change, tmp_path):
    file = write_case(
        tmp_path,
        "case",
        title="t",
        source="s",
        parameters=FREE | GROWS | {"weight": 1.0},
        target="weight",
    )
    text = file.read_text().replace("n = 181", "n = 5")
    if change is TALLER:
        model = file.with_suffix(".xml")
        assert TALLER[0] in model.read_text()
        model.write_text(model.read_text().replace(*TALLER))
    else:
        for name, value in change.items():  # only in the reference, not in the drive
            text = text.replace(f"{name} = {GROWS[name]}", f"{name} = {value}", 1)
    file.write_text(text)
    turned = {c.solver for c in verdicts(file) if c.outcome not in (*GOOD_OUTCOMES, "unsupported")}
    assert turned == ({"mujoco", "pymunk"} if change else set())
