"""The designs of docs/balancer_designs.json have the figures stored beside them, not by chance."""

import json
from dataclasses import replace

import numpy as np
import pytest

from docs.make.design_balancer import variant_of
from proofmass.analytic.balancer.measures import TARGETS, precision_points, rmse, work_reduction
from proofmass.analytic.balancer.model import NUMBERED_DEFAULTS, balancers
from proofmass.analytic.balancer.path import along, balancing_moment, follow
from proofmass.analytic.balancer.synthesis import THESIS_POINTS, Synthesis
from proofmass.design.search import Effort, SavedSearch, is_at_edge, residual_norms
from tests.analytic.balancer.balancer_cases import OWN_DESIGNS_FILE

DESIGNS = json.loads(OWN_DESIGNS_FILE.read_text())


@pytest.mark.parametrize("mode", [1, -1], ids=["elbow up", "elbow down"])
@pytest.mark.parametrize("segments", [3, 4])
def test_a_stored_design_has_the_error_and_the_work_reduction_of_its_parameters(
    segments: int, mode: int
) -> None:
    designs = [
        design
        for design in DESIGNS
        if design["segments"] == segments and design["parameters"].get("mode", 1) == mode
    ]
    assert designs
    names = dict.fromkeys(name for design in designs for name in design["parameters"])
    chains = balancers(
        **{
            name: np.array(
                [
                    design["parameters"].get(name, NUMBERED_DEFAULTS.get(name[:-1], 0.0))
                    for design in designs
                ]
            )
            for name in names
        }
    )
    angle = precision_points(THESIS_POINTS[segments])
    with np.errstate(invalid="ignore"):  # beyond the end of a path all values are NaN
        moments = balancing_moment(chains, along(chains, follow(chains, np.pi / 2), angle))
    for design, moment in zip(designs, moments, strict=True):
        wanted = TARGETS[design["target"]](angle)
        found = float(rmse(moment, wanted)), float(work_reduction(moment, wanted, angle))
        ours = design["ours"]["rmse"], design["ours"]["work_reduction"]
        # The table has six decimals; the path is accurate to 1e-9.
        assert found == pytest.approx(ours, abs=1e-7), design


@pytest.mark.slow
def test_no_stored_design_is_at_an_edge() -> None:
    for design in DESIGNS:
        mode = int(design["parameters"].get("mode", 1))
        task = Synthesis(replace(variant_of(design), mode=mode), TARGETS[design["target"]])
        vectors = task.variant.vector(design["parameters"])[None]
        search = SavedSearch(task, Effort(((1, 1),)), start=vectors)
        places, terms = search.shares(vectors), search.terms(len(search.ends) - 1)
        assert not is_at_edge(places, residual_norms(terms, places), terms).any(), design
