"""Rigid 3PRR planar parallel robot: motion, inverse problem, all poses, workspace, and charts."""

from typing import Annotated

from proofmass.analytic.inverse import InverseProblem
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
    follow_path,
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
from proofmass.analytic.protocol import (
    Acceleration,
    ClosedForm,
    Length,
    Mass,
    OneOf,
    OwnError,
    Position,
    VaryingForce,
    VaryingMoment,
)

__all__ = [
    "MODES",
    "SIGNS",
    "WORKING_MODES",
    "RobotLengths",
    "ThreePrr",
    "WorkspaceSlice",
    "angles_of_place",
    "aspects_of_slice",
    "circle",
    "direct_poses",
    "follow_path",
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


class ThreePrr(ClosedForm, function=solve):
    """Rigid 3PRR planar parallel robot: motion, all poses, workspace, and charts."""

    own_error = OwnError(1e-12, "the general planar solver, for random lengths")
    covers_inertia = True
    selects = True
    charts = (
        direct_poses,
        leg_modes,
        singular_poses,
        slice_area,
        workspace,
        workspace_slice,
    )
    profiles = (circle,)
    inverse = InverseProblem({"x": "x", "y": "y", "phi": "psi"}, follow_path, at_each_place=True)

    side: Length
    leg: Length
    guide2_x: Position
    guide3_x: Position
    guide3_y: Position
    mode: Annotated[int, OneOf(MODES)]
    platform_mass: Mass
    leg_mass: Mass
    slider_mass: Mass
    load_x: VaryingForce
    load_y: VaryingForce
    load_moment: VaryingMoment
    gravity: Acceleration
