"""Properties of a mechanism: degrees of freedom, Grashof class, stroke, crank angles."""

import numpy as np
import pytest

from proofmass.batch.check import Result
from proofmass.reference.evaluate import properties
from proofmass.report import write_report
from proofmass.run.sidecar import load_case
from tests.shipped import shipped

EXPECTED_PROPERTIES = {  # with the lengths of B. Díaz Lozano 2019
    "fourbar": {
        "Grashof class": "crank-rocker, margin 0.5 m",
        "rocker swings": "47.18°",
        "time ratio": "1.0233",
        "transmission angle": "51.32° to 125.10°",
    },
    "triple_rocker": {"crank": "reaches 0.00° to 127.17° on either side"},
    "change_point": {"Grashof class": "change point, margin 0 m"},
    "slider_crank": {"stroke": "2 m"},
    "fivebar": {"crank angles": "2.13 % of all pairs cannot be assembled"},  # counted below
    "fivebar_regular": {"crank angles": "any two can be assembled"},
}


@pytest.mark.parametrize("name", EXPECTED_PROPERTIES)
def test_properties_of_linkages_have_the_known_values(name):
    found = properties(load_case(shipped(f"{name}.toml")))
    assert {key: found[key] for key in EXPECTED_PROPERTIES[name]} == EXPECTED_PROPERTIES[name]


def test_pairs_of_crank_angles_that_cannot_be_assembled_are_counted():
    """The couplers, of 3.5 m and 4 m, meet if the crank pins are 0.5 m to 7.5 m apart.

    The cranks are of 2 m and 1 m, and their fixed pins are 2 m apart.  Two million pairs are
    counted at the points of a lattice.
    """
    k = np.arange(2_000_000)
    left, right = 2 * np.pi * k / k.size, 2 * np.pi * (k * (5**0.5 - 1) / 2 % 1)
    apart = np.abs(2 * np.exp(1j * left) - 2 - np.exp(1j * right))
    share = np.mean((apart < 0.5) | (apart > 7.5))
    found = properties(load_case(shipped("fivebar.toml")))["crank angles"]
    # 0.005 %: the printed digits.  The count gives 2.12645 %, and the mean over 4e6 left angles of
    # the exact share of right angles gives 2.126519 %
    assert float(found.split()[0]) == pytest.approx(100 * share, abs=0.0051)


def test_a_reference_without_properties_returns_none():
    assert properties(load_case(shipped("pendulum.toml"))) == {}


def test_lengths_that_cannot_close_have_no_properties(models, edit):
    edit("fourbar.toml", r"coupler = 2.0", "coupler = 20.0")
    assert properties(load_case(models / "fourbar.toml")) == {}


def test_a_page_shows_the_properties(tmp_path):
    index = write_report(Result(cases=[load_case(shipped("fourbar.toml"))]), tmp_path)
    page = index.with_name("fourbar.html").read_text(encoding="utf-8")
    assert "<dt>degrees of freedom</dt><dd>1</dd>" in page
    assert "<dt>Grashof class</dt><dd>crank-rocker, margin 0.5 m</dd>" in page
