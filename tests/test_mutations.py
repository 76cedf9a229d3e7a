"""Every verdict can fail: a wrong model, a wrong curve, a NaN turn it."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from proofmass.case import load_case
from proofmass.compare import compare
from proofmass.solve import solve

MODELS = Path(__file__).parent.parent / "models"

# where each length of the drawing stands in the MJCF: element path, attribute, index, sign
LENGTHS = {
    "fourbar": {
        "crank": [(".//body[@name='coupler']", "pos", 0, 1)],
        "coupler": [(".//site[@name='coupler_end']", "pos", 0, 1)],
        "rocker": [(".//site[@name='rocker_end']", "pos", 0, 1)],
        "ground": [(".//body[@name='rocker']", "pos", 0, 1)],
    },
    "hacksaw": {
        "crank": [(".//site[@name='crank_end']", "pos", 0, 1)],
        "coupler": [(".//site[@name='coupler_end']", "pos", 0, -1)],
        "offset": [(".//body[@name='slider']", "pos", 1, 1)],
    },
    "pendulum": {"length": [(".//inertial", "pos", 1, -1), (".//body", "pos", 1, 1)]},
}
OTHERS = {  # sidecars that share a model
    "fourbar_crossed": "fourbar", "hacksaw_recorded": "hacksaw",
}
CASES = [(case, key) for case in (*LENGTHS, *OTHERS) for key in LENGTHS[OTHERS.get(case, case)]]


def lengthen(file: Path, places: list[tuple[str, str, int, int]], by: float) -> None:
    """Make a length of the MJCF longer by `by` [m]."""
    tree = ElementTree.parse(file)
    for path, attribute, index, sign in places:
        element = tree.find(path)
        numbers = [float(x) for x in element.get(attribute).split()]
        numbers[index] += sign * by
        element.set(attribute, " ".join(map(repr, numbers)))
    tree.write(file)


def outcomes(case, kind: str, solver: str) -> set[str]:
    return {c.outcome for c in compare(case, kind, solver, solve(case, kind, solver))}


@pytest.mark.parametrize(("name", "key"), CASES)
@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
def test_a_length_wrong_by_three_times_its_would_notice_differs(name, key, solver, models):
    case = load_case(models / f"{name}.toml")
    truth = load_case(models / f"{OTHERS.get(name, name)}.toml")
    for kind in case.run:
        base = compare(truth, kind, solver, solve(truth, kind, solver))
        notices = [c.would_notice[key] for c in base if c.would_notice]
        good = {c.outcome for c in compare(case, kind, solver, solve(case, kind, solver))}
        assert "agrees" in good
        assert "differs" not in good
        kept = case.model_path.read_text()
        lengthen(case.model_path, LENGTHS[OTHERS.get(name, name)][key],
                 3 * min(notices) * truth.parameters[key])
        assert "differs" in outcomes(case, kind, solver), kind
        case.model_path.write_text(kept)


@pytest.fixture(scope="module")
def sweep():
    case = load_case(MODELS / "hacksaw.toml")
    return case, solve(case, "sweep", "mujoco")


WRONG = {
    "sign": lambda y: -y,
    "off by one sample": lambda y: np.roll(y, 1),
    "a NaN": lambda y: np.where(np.arange(y.size) == 500, np.nan, y),
    "an infinity": lambda y: np.where(np.arange(y.size) == 500, np.inf, y),
    "a constant added": lambda y: y + 1e-9 * np.ptp(y),
    "a scale": lambda y: y * (1 + 1e-9),
    "one whole turn": lambda y: y + 2 * np.pi,
}


@pytest.mark.parametrize("how", WRONG)
def test_a_wrong_curve_differs_in_every_channel(how, sweep):
    case, curves = sweep
    for name in case.channels:
        changed = {**curves.channels, name: WRONG[how](curves.channels[name])}
        found = compare(case, "sweep", "mujoco", replace(curves, channels=changed))
        assert {c.channel for c in found if c.outcome == "differs"} == {name}


def test_signs_of_the_document_are_tested(sweep):
    """theta3 without its half turn, r1 not negated, Vr negated: each is seen."""
    case, curves = sweep
    for name, change in {"theta3": curves.channels["theta3"] - np.pi,
                         "r1": -curves.channels["r1"],
                         "r1_rate": -curves.channels["r1_rate"]}.items():
        found = compare(case, "sweep", "mujoco",
                        replace(curves, channels={**curves.channels, name: change}))
        assert [c.channel for c in found if c.outcome != "agrees"] == [name]


@pytest.mark.parametrize(("old", "new"), [
    ('gravity="0 -9.81 0"', 'gravity="0 9.81 0"'),
    ('pos="0.5 0 0" mass="1"', 'pos="0.5 0 0" mass="1.001"'),
    ('<joint name="rocker"/>', '<joint name="rocker" stiffness="0.01"/>'),
])
def test_a_wrong_load_turns_the_holding_moment_and_nothing_else(old, new, models, edit):
    edit("fourbar.xml", old, new)
    case = load_case(models / "fourbar.toml")
    found = compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"))
    assert [c.channel for c in found if c.outcome != "agrees"] == ["holding_moment"]


def test_the_other_branch_of_a_twin_key_is_refused(models, edit):
    edit("fourbar_crossed.toml", 'start = "crossed"', 'start = "start"')
    case = load_case(models / "fourbar_crossed.toml")
    with pytest.raises(Exception, match=r"assembles the model in mode \+1"):
        compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"))
