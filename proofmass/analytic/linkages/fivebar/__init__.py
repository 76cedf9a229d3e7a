"""Planar five-bar linkage with both cranks driven: motion, inverse problem, workspace, charts."""

from proofmass.analytic.inverse import InverseProblem
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
    follow_path,
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
from proofmass.analytic.protocol import (
    Acceleration,
    ClosedForm,
    Length,
    Mass,
    Mode,
    OwnError,
    Position,
    VaryingForce,
)

__all__ = [
    "MODES",
    "WORKING_MODES",
    "FiveBar",
    "FivebarLengths",
    "aspects",
    "circle",
    "crank_angles",
    "follow_path",
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


class FiveBar(ClosedForm, function=solve, properties=properties):
    """Planar five-bar linkage with both cranks driven: motion, workspace, charts."""

    own_error = OwnError(1e-12, "the general planar solver, for random lengths")
    covers_inertia = True
    selects = True
    charts = (
        crank_angles,
        singular_poses,
        working_modes,
        workspace,
    )
    profiles = (
        circle,
        rectangle,
    )
    inverse = InverseProblem({"x": "tip_x", "y": "tip_y"}, follow_path, at_each_place=True)

    left_crank: Length
    left_coupler: Length
    right_coupler: Length
    right_crank: Length
    left_x: Position
    right_x: Position
    mode: Mode
    left_crank_mass: Mass
    left_coupler_mass: Mass
    right_coupler_mass: Mass
    right_crank_mass: Mass
    tip_mass: Mass
    gravity: Acceleration
    force_x: VaryingForce
    force_y: VaryingForce
