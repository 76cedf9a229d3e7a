"""Rigid 3PRR planar parallel robot: motion, inverse problem, all poses, workspace, and charts."""

from proofmass.analytic.linkages.threeprr.charts import (
    direct_poses,
    leg_modes,
    singular_poses,
    slice_area,
    workspace,
    workspace_slice,
)
from proofmass.analytic.linkages.threeprr.kinematics import (
    MODES,
    SIGNS,
    WORKING_MODES,
    RobotLengths,
    circle,
    poses,
    solve,
    solve_inverse,
)
from proofmass.analytic.linkages.threeprr.maps import (
    WorkspaceSlice,
    angles_of_place,
    aspects_of_slice,
    reach_area_of_place,
    reach_of_place,
    type_2_of_slice,
    volume,
)

__all__ = [
    "MODES",
    "SIGNS",
    "WORKING_MODES",
    "RobotLengths",
    "WorkspaceSlice",
    "angles_of_place",
    "aspects_of_slice",
    "circle",
    "direct_poses",
    "leg_modes",
    "poses",
    "reach_area_of_place",
    "reach_of_place",
    "singular_poses",
    "slice_area",
    "solve",
    "solve_inverse",
    "type_2_of_slice",
    "volume",
    "workspace",
    "workspace_slice",
]
