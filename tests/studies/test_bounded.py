"""Calls in workers within the limits of a run, and those that must have more time."""

import pytest

from proofmass.base.errors import InputError
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut
from proofmass.run.sidecar import load_case
from proofmass.studies import bounded
from proofmass.studies.bounded import call_bounded, call_limited
from tests.shipped import shipped

CASE = load_case(shipped("pendulum.toml"))


@pytest.mark.parametrize(("least", "more"), [(0.0, 0.0), (1e3, 1e3)])
def test_a_call_has_the_limits_of_its_run_or_the_least_time(least, more, monkeypatch):
    limits = CASE.run["dynamics"]
    monkeypatch.setattr(bounded, "call_isolated", lambda function, *args, **given: (args, given))
    args, given = call_limited(CASE, "dynamics", abs, -1, least=least)
    assert args == (-1,)
    assert given == {"timeout": max(limits.timeout, more), "memory": limits.memory}


@pytest.mark.parametrize("kind", [TimedOut, OutOfMemory, Crashed])
def test_a_call_that_reaches_a_limit_is_bad_input(kind, monkeypatch):
    def fail(*_, **__):
        raise kind("no more")

    monkeypatch.setattr(bounded, "call_isolated", fail)
    with pytest.raises(InputError, match=r"run.dynamics: its model or its reference: no more"):
        call_bounded(CASE, "dynamics", abs, -1)
