"""The degrees of freedom of a planar model, and whether its loops are over-constrained."""

from contextlib import suppress
from typing import TYPE_CHECKING

from proofmass.base.errors import InputError
from proofmass.base.read_once import read_once
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import reference_class

if TYPE_CHECKING:
    from mujoco import MjModel


def mobility(case: Case) -> int | None:
    """Degrees of freedom of a model in its start pose: joints minus independent loop equations.

    Returns
    -------
    int or None
        None for a model that is no planar linkage, for a start pose that does not close, which the
        engines report, and for redundant loops with a reference that covers them.

    Raises
    ------
    InputError
        The loops are over-constrained, so that forces in them are not determined, and the reference
        does not cover such loops.
    """
    from proofmass.analytic.planar import Overconstrained  # scipy is slow to load

    try:
        return model_dof(compiled_model(case), case.start)
    except Overconstrained as error:
        reference = reference_class(case)
        if reference and reference.in_space:  # the motion is the same, whatever the forces
            return None
        raise InputError(case.model_path, "", str(error)) from None
    except ValueError:
        return None


def leaves_dof(case: Case) -> bool:
    """Whether the drives of a case leave degrees of freedom, which a sweep has in equilibrium."""
    with suppress(InputError, ValueError):  # the run reports such an error
        reference, joints = reference_class(case), tuple(drive.joint for drive in case.drive)
        if reference is not None:
            own = reference.leaves_dof(compiled_model(case), case.start, joints)
            if own is not None:
                return own
        return (mobility(case) or 0) > len(case.drive)
    return False


@read_once(None)
def model_dof(model: "MjModel", start: str) -> int:
    """Degrees of freedom of a compiled model, computed once for all runs."""
    from proofmass.analytic.planar import read
    from proofmass.analytic.planar.kinematics import count_dof, nearest_pose

    mechanism, _ = read(model, start)
    return count_dof(mechanism, nearest_pose(mechanism, mechanism.start))
