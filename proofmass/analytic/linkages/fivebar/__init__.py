"""Planar five-bar linkage with both cranks driven: motion, inverse problem, workspace, charts."""

from proofmass.analytic.linkages.fivebar.charts import (
    crank_angles,
    singular_poses,
    working_modes,
    workspace,
)
from proofmass.analytic.linkages.fivebar.kinematics import (
    MODES,
    WORKING_MODES,
    FivebarLengths,
    circle,
    jacobians,
    properties,
    rectangle,
    solve,
    solve_inverse,
    unassembled_share,
)
from proofmass.analytic.linkages.fivebar.maps import (
    aspects,
    reach_area,
    type_2,
)

__all__ = [
    "MODES",
    "WORKING_MODES",
    "FivebarLengths",
    "aspects",
    "circle",
    "crank_angles",
    "jacobians",
    "properties",
    "reach_area",
    "rectangle",
    "singular_poses",
    "solve",
    "solve_inverse",
    "type_2",
    "unassembled_share",
    "working_modes",
    "workspace",
]
