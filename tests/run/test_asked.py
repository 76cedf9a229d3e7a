"""Runs by engines that a command asks for."""

from proofmass.run.asked import engine_without_version, with_engines
from tests.shipped import shipped, shipped_case


def test_other_versions_have_settings_and_tolerances_of_the_engine():
    """A version is judged as the engine is, with the same settings; another engine is not."""
    case = shipped_case(shipped("threeprr.toml"))
    assert case.settings["mujoco"]
    asked = with_engines(case, ("mujoco==3.6.0", "bullet"))
    assert asked.settings["mujoco==3.6.0"] == case.settings["mujoco"]
    assert "bullet" not in asked.settings
    for channel in case.channels:
        own = case.tolerance_for("dynamics", "mujoco", channel)
        found = asked.tolerance_for("dynamics", "mujoco==3.6.0", channel)
        assert (found and found.why) == (own and own.why)
    assert {run.solvers for run in asked.run.values()} == {("mujoco==3.6.0", "bullet")}
    assert asked.refine is None


def test_sweeps_of_other_versions_are_not_judged_as_newtons():
    """They come to rest by steps: tolerances of poses by Newton's method say nothing of them."""
    case = shipped_case(shipped("fourbar.toml"))
    asked = with_engines(case, ("mujoco==3.6.0",))
    assert case.tolerance_for("sweep", "mujoco", "pin.x")
    assert asked.tolerance_for("sweep", "mujoco==3.6.0", "pin.x") is None
    assert asked.tolerance_for("dynamics", "mujoco==3.6.0", "pin.x")


def test_pymunk_in_another_version_is_another_host():
    """The host of pymunk has settings of its own, so that it is not judged as the engine here."""
    case = shipped_case(shipped("fourbar.toml"))
    asked = with_engines(case, ("pymunk==6.8.1",))
    assert asked.tolerance_for("dynamics", "pymunk==6.8.1", "rocker") is None


def test_names_without_versions():
    """A variant stays."""
    assert engine_without_version("mujoco==3.3.7:default") == "mujoco:default"
    assert engine_without_version("drake") == "drake"
