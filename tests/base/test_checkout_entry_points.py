"""Entry points of a checkout are those of its `pyproject.toml`, whatever is installed."""

import tomllib

from proofmass.base.entry_points import (
    CHECKOUT,
    OWN_DISTRIBUTION,
    all_entry_points,
    distribution_of,
    entry_points_of_checkout,
)


def test_those_of_this_checkout_are_found_and_belong_to_this_distribution():
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    stated = {
        (group, name, value)
        for group, own in project["entry-points"].items()
        for name, value in own.items()
        if group.startswith("proofmass.")
    }
    found = [e for e in all_entry_points() if distribution_of(e) == OWN_DISTRIBUTION]
    assert {(e.group, e.name, e.value) for e in found} == stated
    assert len(found) == len(stated)


def test_another_project_or_no_file_is_no_checkout(tmp_path):
    assert entry_points_of_checkout(tmp_path) is None
    file = tmp_path / "pyproject.toml"
    for text in ("[project", "[tool]\nx = 1\n", '[project]\nname = "other"\n'):
        file.write_text(text)
        assert entry_points_of_checkout(tmp_path) is None
    file.write_text(
        '[project]\nname = "proofmass"\n[project.entry-points."proofmass.engines"]\na = "b:C"\n'
    )
    (entry,) = entry_points_of_checkout(tmp_path)
    assert (entry.group, entry.name, entry.value) == ("proofmass.engines", "a", "b:C")
