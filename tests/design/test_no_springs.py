"""Joints of a design that need no spring are named; what cannot be built is exit code 1."""

import json

import pytest

from proofmass.analytic.balancer.measures import chain_of, joints_without_springs
from proofmass.commands.design import cannot_be_built, print_design

CHAIN = {"length1": 0.5, "length2": 0.3, "length3": 0.4, "stiffness1": 1.0, "stiffness2": 0.0}
CHAIN["stiffness3"] = 2.0


@pytest.mark.parametrize(
    ("changes", "free"),
    [
        ({}, [2]),
        ({"stiffness2": 1e-9}, []),
        ({"stiffness1": 0.0, "stiffness3": 0.0, "stiffness2": 1.0}, [1, 3]),
        ({"preload2": 0.1, "low2": 0.0}, []),
        ({"quadratic2": 0.1}, []),
    ],
)
def test_a_joint_without_any_moment_needs_no_spring(changes, free):
    assert joints_without_springs(chain_of({**CHAIN, **changes})) == free


def test_the_joint_is_printed(capsys):
    print_design({"rmse": 0.0, "work_reduction": 0.0, "spread": 0.0, "parameters": CHAIN})
    assert "no spring needed in joint 2" in capsys.readouterr().out


def test_a_spring_that_no_strip_gives_cannot_be_built():
    good = {"clock_springs": [{"joint": 1, "strip": "907"}, {"joint": 2, "stiffness": 0.0}]}
    assert not cannot_be_built(good)
    assert cannot_be_built(json.loads(json.dumps(good).replace('"strip": "907"', '"why": "thin"')))
