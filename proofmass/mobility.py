"""How many degrees of freedom a planar model has, and whether its loops hold something twice."""

from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING

from proofmass.case import Case
from proofmass.errors import InputError
from proofmass.reference import compiled

if TYPE_CHECKING:
    from mujoco import MjModel


def mobility(case: Case) -> int | None:
    """Degrees of freedom of a model in its start pose: joints less independent loop equations.

    Returns
    -------
    int or None
        None for what is no planar linkage, and for a start pose that does not close: the engines
        say what is wrong with it.

    Raises
    ------
    InputError
        The loops are over-constrained: forces in them would not be determined.
    """
    from proofmass.analytic.planar import Overconstrained  # scipy is slow to load

    try:
        return model_dof(compiled(case), case.start)
    except Overconstrained as error:
        raise InputError(case.model_path, "", str(error)) from None
    except ValueError:
        return None


def leaves_dof(case: Case) -> bool:
    """Whether the drives of a case leave degrees of freedom, which rest in a sweep."""
    with suppress(InputError, ValueError):  # which the run names
        if case.reference == SPATIAL:
            from proofmass.analytic import spatial  # scipy is slow to load

            tree, _ = spatial.sources(compiled(case), case.start, None)
            return spatial.leaves_dof(tree, tuple(drive.joint for drive in case.drive))
        return (mobility(case) or 0) > len(case.drive)
    return False


SPATIAL = "spatial"
"""The reference of models that move in space, whose loops may be over-constrained."""
KEPT = 64
"""Models that are remembered: a search for what a case notices compiles thousands."""


@lru_cache(KEPT)
def model_dof(model: "MjModel", start: str) -> int:
    """Degrees of freedom of a compiled model, found once for all runs."""
    from proofmass.analytic.planar import read
    from proofmass.analytic.planar.kinematics import count_dof, nearest

    mechanism, _ = read(model, start)
    return count_dof(mechanism, nearest(mechanism, mechanism.start))
