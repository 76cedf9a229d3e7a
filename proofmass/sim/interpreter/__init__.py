"""What runs in the interpreter of an engine; a script imports it as ``proofmass_host``.

It needs Python 3.9 and NumPy, and imports nothing of proofmass.  A script of an engine has::

    from proofmass_host import NeutralMechanism, Refused, LinkStates, record

    VERSIONS = {"engine": "1.2.3"}          # what computes, by the names of the packages

    def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates: ...
"""

from .checks import (
    Refused,
    RunEnded,
    Stopwatch,
    free_rows,
    held_joints,
    refuse_armatures,
    refuse_changing_loads,
    refuse_damped_balls,
    refuse_friction,
    refuse_gears,
    refuse_other_than_free_trees,
    refuse_rows,
)
from .forces import beside_linear, drive_rates, joint_forces, link_forces, pushes_on_links
from .geometry import (
    angles_of,
    frame_of_axis,
    in_space,
    matrix_of,
    matrix_of_xyzw,
    turn_about,
)
from .inertias import (
    SINGLE_ROUNDING,
    armatures_with_rotors,
    inertia_in_motion,
    inertia_with_armature,
    moment_in_plane,
    refuse_lost_inertia,
    refuse_ratio,
)
from .mechanism import (
    DriveRows,
    LinkStates,
    Mjcf,
    NeutralContact,
    NeutralGear,
    NeutralJoint,
    NeutralLink,
    NeutralLoad,
    NeutralLoop,
    NeutralMechanism,
    NeutralShape,
    NeutralSpring,
    WayToRest,
)
from .one_point import Impacts, balls_of, contact_parts, refuse_bounce
from .pair_values import (
    OVERLAP_TIME,
    contact_surfaces,
    split_by_harmonic_mean,
    split_by_minimum,
    split_by_product,
    surface_of,
)
from .planar import PlanarBodies, coupled_links
from .readings import joint_motion, joint_reader, slide_motion
from .record import record, rows_at_samples, without_steps
from .rests import NoRest, come_to_rest
from .runge_kutta import runge_kutta
from .sections import planar_contacts
from .serve import load_beside
from .starts import pivot_of, start_of_links, start_openings, start_velocity
from .tables import in_time, line_of, values_beyond
from .tree import TreeRow, joined_points, one_joint_each, tree_forces, tree_rows
from .urdf import ground_urdf, tree_urdf

__all__ = [
    "OVERLAP_TIME",
    "SINGLE_ROUNDING",
    "DriveRows",
    "Impacts",
    "LinkStates",
    "Mjcf",
    "NeutralContact",
    "NeutralGear",
    "NeutralJoint",
    "NeutralLink",
    "NeutralLoad",
    "NeutralLoop",
    "NeutralMechanism",
    "NeutralShape",
    "NeutralSpring",
    "NoRest",
    "PlanarBodies",
    "Refused",
    "RunEnded",
    "Stopwatch",
    "TreeRow",
    "WayToRest",
    "angles_of",
    "armatures_with_rotors",
    "balls_of",
    "beside_linear",
    "come_to_rest",
    "contact_parts",
    "contact_surfaces",
    "coupled_links",
    "drive_rates",
    "frame_of_axis",
    "free_rows",
    "ground_urdf",
    "held_joints",
    "in_space",
    "in_time",
    "inertia_in_motion",
    "inertia_with_armature",
    "joined_points",
    "joint_forces",
    "joint_motion",
    "joint_reader",
    "line_of",
    "link_forces",
    "load_beside",
    "matrix_of",
    "matrix_of_xyzw",
    "moment_in_plane",
    "one_joint_each",
    "pivot_of",
    "planar_contacts",
    "pushes_on_links",
    "record",
    "refuse_armatures",
    "refuse_bounce",
    "refuse_changing_loads",
    "refuse_damped_balls",
    "refuse_friction",
    "refuse_gears",
    "refuse_lost_inertia",
    "refuse_other_than_free_trees",
    "refuse_ratio",
    "refuse_rows",
    "rows_at_samples",
    "runge_kutta",
    "slide_motion",
    "split_by_harmonic_mean",
    "split_by_minimum",
    "split_by_product",
    "start_of_links",
    "start_openings",
    "start_velocity",
    "surface_of",
    "tree_forces",
    "tree_rows",
    "tree_urdf",
    "turn_about",
    "values_beyond",
    "without_steps",
]
