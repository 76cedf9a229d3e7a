"""What runs in the interpreter of an engine; a script imports it as ``proofmass_host``.

It needs Python 3.9 and NumPy, and imports nothing of proofmass.  A script of an engine has::

    from proofmass_host import NeutralMechanism, Refused, LinkStates, record

    VERSIONS = {"engine": "1.2.3"}          # what computes, by the names of the packages

    def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates: ...
"""

from .checks import Refused, Stopwatch, free_rows, refuse_gears, refuse_rows
from .geometry import angles_of, frame_of_axis, in_space, matrix_of, turn_about
from .impulses import (
    armatures_with_rotors,
    drive_rates,
    inertia_with_armature,
    joint_forces,
    joint_motion,
    joint_reader,
    link_forces,
    pivot_of,
    slide_motion,
    start_of_links,
    start_openings,
    start_velocity,
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
from .one_point import balls_of, refuse_bounce
from .pair_values import (
    OVERLAP_TIME,
    contact_surfaces,
    split_by_harmonic_mean,
    split_by_minimum,
    split_by_product,
    surface_of,
)
from .planar import SINGLE_ROUNDING, PlanarBodies, coupled_links, refuse_lost_inertia
from .record import record, rows_at_samples
from .rests import NoRest, come_to_rest
from .runge_kutta import runge_kutta
from .sections import planar_contacts
from .serve import load_beside
from .tree import TreeRow, in_time, joined_points, one_joint_each, tree_forces, tree_rows
from .urdf import ground_urdf, tree_urdf

__all__ = [
    "OVERLAP_TIME",
    "SINGLE_ROUNDING",
    "DriveRows",
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
    "Stopwatch",
    "TreeRow",
    "WayToRest",
    "angles_of",
    "armatures_with_rotors",
    "balls_of",
    "come_to_rest",
    "contact_surfaces",
    "coupled_links",
    "drive_rates",
    "frame_of_axis",
    "free_rows",
    "ground_urdf",
    "in_space",
    "in_time",
    "inertia_with_armature",
    "joined_points",
    "joint_forces",
    "joint_motion",
    "joint_reader",
    "link_forces",
    "load_beside",
    "matrix_of",
    "one_joint_each",
    "pivot_of",
    "planar_contacts",
    "record",
    "refuse_bounce",
    "refuse_gears",
    "refuse_lost_inertia",
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
]
