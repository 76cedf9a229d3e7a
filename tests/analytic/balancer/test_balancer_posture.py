"""Prescribed postures against equilibria, virtual work and the thesis's check in SAM."""

import re

import numpy as np
import pytest

from proofmass.analytic.balancer import posture, solve
from proofmass.design.template import write_case
from proofmass.verdict.outcome import GOOD_OUTCOMES
from tests.analytic.balancer.balancer_table import DATA, parameters, rows
from tests.shipped import shipped
from tests.verdicts import all_comparisons

SAM_DESIGN = DATA["others"][0]  # Table F.1 as in lines 4200-4212
CASE_NAME = "balancer4_sam_prescribed"


def without_stops(chain):
    return {k: v for k, v in chain.items() if not k.startswith(("low", "high"))}


def drive_inputs(found, angle, n):
    return np.stack([angle, *(found[f"deflection{i}"] for i in range(1, n - 1))])


@pytest.mark.parametrize("line", ["1743", "1766", "2107", "1744", "1754"])
def test_an_equilibrium_needs_no_drive_other_than_the_pendulums(line):
    chain, angle = parameters(rows()[line]), np.radians(np.arange(5.0, 91.0, 5.0))
    n, rest = rows()[line]["segments"], solve(angle, **chain)
    found = posture.solve(drive_inputs(rest, angle, n), **chain)
    for i in range(1, n - 1):
        # rounding of the deflections times the stiffness, over the sine of the last elbow
        assert np.abs(found[f"drive_moment{i}"]).max() < 1e-12
    for name in ("holding_moment", "energy", "node2_load", "force_x", f"theta{n}"):
        assert found[name] == pytest.approx(rest[name], abs=1e-12)


@pytest.mark.parametrize("line", ["1766", "1747", "1757"])
def test_drives_do_the_whole_work_on_any_path(line):
    """dV = holding dalpha + sum drive_i de_i, by differences along a path off all equilibria."""
    chain = without_stops(parameters(rows()[line])) | {"weight": 0.4}
    n, h = rows()[line]["segments"], 1e-5

    def path(s):
        alpha, one, two = 0.3 + 0.4 * s, 0.25 * s + 0.1 * s**2, 0.1 - 0.2 * s
        return np.stack([alpha, one, two][: n - 1])

    s = np.linspace(0.0, 1.0, 9)
    there = posture.solve(path(s), **chain)
    slope, rates = (
        (of(s + h) - of(s - h)) / (2.0 * h)
        for of in (lambda x: posture.solve(path(x), **chain)["energy"], path)
    )
    drives = ["holding_moment", *(f"drive_moment{i}" for i in range(1, n - 1))]
    power = sum(there[name] * rate for name, rate in zip(drives, rates, strict=True))
    assert np.abs(there["drive_moment1"]).max() > 0.01
    assert slope == pytest.approx(power, abs=1e-8)  # h^2 V'''


def test_loads_and_energy_of_the_thesis_check_in_sam():
    """Appendix F prescribes angles and reads loads and energy; the moment curve is a recomputation.

    While joints 2 and 3 are locked the drives carry the moments of the stops; the work is the same.
    """
    angle = np.radians(6.0) * np.arange(1, 16)
    rest = solve(angle, **SAM_DESIGN["parameters"])
    found = posture.solve(drive_inputs(rest, angle, 4), **without_stops(SAM_DESIGN["parameters"]))
    assert found["energy"] == pytest.approx(rest["energy"], abs=1e-13)
    work = found["holding_moment"] + sum(
        found[f"drive_moment{i}"] * rest[f"deflection{i}_rate"] for i in (1, 2)
    )
    assert work == pytest.approx(SAM_DESIGN["recomputed"]["moments"], abs=6e-6)  # five digits kept
    both, third = np.degrees(angle) > 58.4, np.degrees(angle) > 31.7  # released at 58.325, 31.611
    assert np.abs(found["drive_moment2"][both]).max() < 1e-12
    assert np.abs(found["drive_moment1"][third]).max() < 1e-12
    assert found["node3_load"][third] == pytest.approx(rest["node3_load"][third], abs=1e-12)
    assert found["node2_load"][both] == pytest.approx(rest["moment2"][both], abs=1e-12)
    assert (found["drive_moment2"][~both] > 0.02).all()  # moment of the stop of joint 2
    assert (found["drive_moment1"][~third] < -0.02).all()


def test_angles_that_are_no_equilibrium_need_drives():
    """Wrong angles appear only as moments of the drives, which SAM did not show to the thesis."""
    angle = np.radians([70.0, 80.0])
    angles = drive_inputs(solve(angle, **SAM_DESIGN["parameters"]), angle, 4)
    angles[1] += 1e-3
    found = posture.solve(angles, **without_stops(SAM_DESIGN["parameters"]))
    assert np.abs(found["drive_moment1"]).min() > 1e-4


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (np.zeros((2, 3)), "angle needs 3 rows, the pendulum's and those of 2 deflections, got 2"),
        (np.array([0.1, 3.0, 0.0]), "cannot reach the tip at alpha = 5.7"),
    ],
)
def test_impossible_postures_are_refused(given, said):
    with pytest.raises(ValueError, match=said):
        posture.solve(given, **without_stops(SAM_DESIGN["parameters"]))


def test_the_model_is_that_of_the_balancer_without_stops(tmp_path):
    own = shipped(f"{CASE_NAME}.xml").read_text().splitlines()
    parts = write_case(
        tmp_path, CASE_NAME, title="", source="", parameters=SAM_DESIGN["parameters"]
    )
    text = parts.with_suffix(".xml").read_text().replace(' range="0.0 10.0"', "")
    more = [line for line in own if line not in text.splitlines()]
    assert len(more) == 6  # two lines of comment, motors of joints 1 and 2 and their sensors
    sensors = text.partition("<sensor>")[2].splitlines()
    less = [line for line in text.splitlines() if line not in own and line not in sensors]
    assert (
        less.pop(0) == "       centres of mass balance the chain: what weighs is the tip alone. -->"
    )
    # no remaining sensor uses these sites
    assert [re.match(' *<site name="(.*?)"', line)[1] for line in less] == ["node1", "node2"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('springref="-5.67619', 'springref="-5.67618'),  # spring 2: its drive differs
        ('stiffness="0.31"', 'stiffness="0.3100001"'),
        ('pos="-0.2 0.21 0"', 'pos="-0.2 0.2100001 0"'),
    ],
)
def test_a_changed_model_differs_in_both_engines(old, new, tmp_path):
    for name in (f"{CASE_NAME}.toml", f"{CASE_NAME}.xml", "balancer4_sam_angles.csv"):
        text = shipped(name).read_text()
        assert name.endswith(".csv") or (old in text) == name.endswith("xml")
        (tmp_path / name).write_text(text.replace(old, new))
    found = all_comparisons(tmp_path / f"{CASE_NAME}.toml")
    assert {c.solver for c in found if c.outcome not in GOOD_OUTCOMES} == {"mujoco", "pymunk"}
