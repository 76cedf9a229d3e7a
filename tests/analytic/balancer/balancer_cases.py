"""The balancers in `models/`, which `proofmass.design.template` writes, mostly thesis designs.

``python -m tests.analytic.balancer.balancer_cases`` writes them again.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from proofmass.design.template import SOLVERS, write_case
from tests.analytic.balancer.balancer_table import DATA, parameters, rows
from tests.independent.balancer import prototype
from tests.shipped import MODELS

OWN_DESIGNS_FILE = Path(__file__).parents[3] / "docs" / "balancer_designs.json"
THESIS_SOURCE = (
    "S. van Nes, The use of a rigid linkage balancer with torsion springs to realize "
    "nonlinear moment-angle characteristics, MSc thesis TU Delft 2022.074, {}; masses of the "
    "segments are ours"
)
SETTLED_CASES = ("balancer_sine_free_preload", "balancer_progressive_contact", "balancer4_sine")
"""Cases with runs of 5e5 steps: a stop is left, a stop is met, two joints move."""


@dataclass(frozen=True)
class Design:
    """Contents of a case: texts, parameters, target, and designs that it is compared with."""

    title: str
    place: str
    parameters: Mapping[str, float]
    target: str = "sine"
    target_moment: float = 1.0
    changed: Mapping[str, float] = field(default_factory=dict)
    beside: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def write(self, folder: Path, name: str) -> Path:
        """Write model and sidecar; return the path of the sidecar."""
        solvers = (SOLVERS[0], "mujoco:settled", *SOLVERS[1:]) if name in SETTLED_CASES else SOLVERS
        source = self.place if self.beside else THESIS_SOURCE.format(self.place)
        return write_case(
            folder,
            name,
            title=self.title,
            source=source,
            parameters={**self.parameters, **self.changed},
            target=self.target,
            target_moment=self.target_moment,
            solvers=solvers,
            beside=self.beside,
        )


def thesis_design(line: int, title: str, **changed: float) -> Design:
    """A row of the thesis's tables as a case."""
    found = rows()[str(line)]
    return Design(
        title,
        f"Fig. {found['figure']}, line {line}",
        parameters(found),
        found["target"],
        changed=changed,
    )


def own_design(line: int, title: str) -> Design:
    """A design of ours, compared with the thesis's of the same springs, joints and bounds."""
    theirs = rows()[str(line)]
    ours = next(d for d in json.loads(OWN_DESIGNS_FILE.read_text()) if d["line"] == line)
    chain = {"pendulum": 1.0, **ours["parameters"]}
    return Design(
        title,
        f"python -m docs.make.design_balancer {line}",
        chain,
        theirs["target"],
        beside={f"van Nes 2022, line {line}": {**parameters(theirs), "target": theirs["target"]}},
    )


def third_preload_design(target: str, springs: str, option: str, title: str) -> Design:
    """A design of ours with a preload of spring 3, compared with ours without a preload."""
    ours, bare = (
        next(
            d["parameters"]
            for d in json.loads(OWN_DESIGNS_FILE.read_text())
            if (d["target"], d["variant"], d["option"], d["segments"]) == (target, kind, option, 3)
        )
        for kind in (f"{springs}preload 3", springs.strip() or "regular")
    )
    return Design(
        title,
        f'python -m docs.make.design_balancer "{target} 3 {springs}preload 3 {option}"',
        {"pendulum": 1.0, **ours},
        target,
        beside={"designed without a preload": {"pendulum": 1.0, **bare, "target": target}},
    )


SAM_DESIGN = DATA["others"][0]
EXTENDING = {
    "length1": 0.4998059906957808,
    "length2": 0.49404732892788594,
    "length3": 0.3596921548964842,
    "stiffness1": 1.0205119218463403,
    "stiffness2": 1.353107950233032,
    "stiffness3": 0.7006551570717843,
    "rest_angle": 1.0225316908942226,
}
DESIGNS = {
    "balancer_sine": thesis_design(1743, "Sine by three linear springs"),
    "balancer_sine_preload": thesis_design(1745, "Sine by linear springs, one of them preloaded"),
    "balancer_sine_nonlinear": thesis_design(1753, "Sine by three equal quadratic springs"),
    "balancer_sine_free": thesis_design(1766, "Sine by linear springs, rest angle free"),
    "balancer_sine_free_preload": thesis_design(1768, "Sine by a preload, rest angle free"),
    "balancer_progressive_locked": thesis_design(
        1839, "A preload that never opens: one spring, a straight line"
    ),
    "balancer_progressive_contact": thesis_design(1860, "Progressive by a stop that is met"),
    "balancer_laevo": thesis_design(2107, "Moment of the Laevo exoskeleton"),
    "balancer_sine180": thesis_design(
        2178, "Half a turn of a sine in a quarter turn of the pendulum"
    ),
    "balancer4_sine": thesis_design(1747, "Sine by four segments, two preloads"),
    "balancer4_sam": Design(
        "Four equal segments, checked in SAM by the thesis",
        f"Table F.1 as in {SAM_DESIGN['source'].split(':')[0]}",
        SAM_DESIGN["parameters"],
    ),
    "balancer_prototype": Design(
        "The built balancer with its springs as measured, and dry friction",
        "listing N.3, lines 2369-2387, springs as measured; friction of joints 2 and 3, whose "
        "bearings the thesis suspects (lines 980-982), is ours: as large as would alone lower the "
        "work reduction to the 93.47 % that it measured",
        prototype.parameters(),
        target_moment=prototype.WEIGHT * prototype.PENDULUM,
        changed={"friction2": 0.00263, "friction3": 0.00263, "expected": "van Nes N.2"},
    ),
    "balancer_designed": own_design(1766, "Sine by three linear springs, designed anew"),
    "balancer_designed_laevo": own_design(2107, "Moment of the Laevo exoskeleton, designed anew"),
    "balancer_third_preload": third_preload_design(
        "progressive-degressive",
        "nonlinear ",
        "rest angle",
        "A preload of spring 3 that releases",
    ),
    "balancer_third_preload_at_once": third_preload_design(
        "degressive-progressive", "", "standard", "A preload of spring 3 that holds at no moment"
    ),
    "balancer_extending": Design(
        "A pendulum that extends by a tenth as it leans, balanced by three linear springs",
        "proofmass design balancer --free-angle --extension 0:0.04",
        {"pendulum": 1.0, **EXTENDING, "extension2": 0.04, "weight": 1.0},
        "weight",
        beside={
            "designed for a pendulum that keeps its length": {
                "pendulum": 1.0,
                **next(
                    d["parameters"]
                    for d in json.loads(OWN_DESIGNS_FILE.read_text())
                    if d["line"] == 1766
                ),
                "extension2": 0.04,
                "weight": 1.0,
                "target": "weight",
            }
        },
    ),
    "balancer_weight": thesis_design(
        1766, "A pendulum of 1 N balanced by three linear springs", weight=1.0
    ),
}

if __name__ == "__main__":
    for name, design in DESIGNS.items():
        design.write(MODELS / "balancers", name)
