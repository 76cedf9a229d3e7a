"""Comparison of the terms of a motion with those of a second, independent formulation.

The terms with which a motion was integrated come from a source such as MuJoCo. At some of its poses
this package computes every term by its own formulation; a defect in either would show there.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.spatial.mechanism import Tree
from proofmass.analytic.spatial.terms import (
    own_terms,
)
from proofmass.analytic.term_source import TERM_NAMES, Terms, TermSource
from proofmass.base.arrays import Array

COMPARED_POSES = 50
"""Number of poses of a motion at which the terms are computed a second time."""
MAX_TERM_DIFFERENCE = 1e-12
"""Largest difference of a term, as a share of the largest of its kind in the motion [1]."""


class TermsDiffer(ValueError):
    """Two formulations of the equations of motion differ; one of them has a defect."""


@dataclass(frozen=True)
class TermComparison:
    """Difference of two formulations along a motion.

    Attributes
    ----------
    states : int
        Number of poses at which they were compared.
    difference : float
        The largest difference of a term, as a share of the largest of its kind [1].
    term : str
        The term with this difference.
    """

    states: int
    difference: float
    term: str


def compare_terms(
    tree: Tree,
    source: TermSource,
    times: Array,
    q: Array,
    v: Array,
    when: str = "t",
    ctrl: Array | None = None,
) -> TermComparison:
    """Compare the terms of a motion with own ones at `COMPARED_POSES` of its poses.

    Parameters
    ----------
    tree : Tree
    source : TermSource
        Source of the terms with which the motion was integrated.
    times : ndarray (n,)
        Times of the samples [s].
    q, v : ndarray (n, poses), (n, rates)
        The motion [SI].
    when : str
        Name of `times` in the error message.
    ctrl : ndarray (n, controls), optional
        By default the controls of the key [SI].

    Returns
    -------
    Witnessed

    Raises
    ------
    TermsDiffer
        The difference is more than `MAX_TERM_DIFFERENCE`; the message has the term and the time.
    """
    numbers = np.unique(np.linspace(0, len(q) - 1, COMPARED_POSES).round().astype(int))
    controls = None if ctrl is None else ctrl[numbers]
    proofmass_terms = own_terms(tree, q[numbers], v[numbers], controls)
    pose_controls = len(numbers) * [None] if controls is None else controls
    term_list = [
        source.terms(*state) for state in zip(q[numbers], v[numbers], pose_controls, strict=True)
    ]
    source_terms = Terms(
        **{name: np.array([getattr(one, name) for one in term_list]) for name in TERM_NAMES}
    )
    worst = TermComparison(len(numbers), 0.0, "mass")
    for name, scale in term_scales(tree, proofmass_terms, v[numbers]).items():
        difference = np.abs(getattr(proofmass_terms, name) - getattr(source_terms, name)).reshape(
            len(numbers), -1
        )
        if not difference.size:
            continue
        share = difference.max(axis=1) / scale
        k = int(np.argmax(np.where(np.isfinite(share), share, np.inf)))
        if not share[k] <= MAX_TERM_DIFFERENCE:
            raise TermsDiffer(
                f"the {TERM_NAMES[name]} of {source.name} and of proofmass's own formulation "
                f"differ by {share[k]:.3g} of the largest at "
                f"{when} = {times[numbers[k]]:.6g}, where {MAX_TERM_DIFFERENCE:g} is rounding: "
                "one of the two has a defect, and there is no reference"
            )
        if share[k] >= worst.difference:
            worst = TermComparison(len(numbers), float(share[k]), name)
    return worst


def term_scales(tree: Tree, terms: Terms, v: Array) -> dict[str, float]:
    """Find the scale of each kind of term in a motion, by which differences are divided.

    It is the largest value of the kind; for violations, in m and rad, it is 1.  The scale of forces
    is at least that of weights and gyroscopic moments, which may cancel but for rounding, as in a
    wheel on a vertical axis.  The scale of drifts is at least that of accelerations, of the order
    of forces over masses, since the drifts of bodies at rest are rounding.
    """

    def largest(*parts: Array) -> float:
        return max((float(np.abs(part).max(initial=0.0)) for part in parts), default=0.0) or 1.0

    moving = tree.masses[0][tree.moved.any(axis=1)].sum()
    weight = moving * np.linalg.norm(tree.gravity) * tree.size / tree.sizes
    gyroscopic = tree.turns * v**2 * np.diagonal(terms.mass, axis1=1, axis2=2)
    forces, mass = largest(terms.bias, terms.force, weight, gyroscopic), largest(terms.mass)
    rows = largest(terms.jacobian)
    acceleration_scale = rows * max(float((v**2).max(initial=0.0)), forces / mass)
    return {
        "mass": mass,
        "bias": forces,
        "force": forces,
        "gap": 1.0,
        "jacobian": rows,
        "drift": max(largest(terms.drift), acceleration_scale),
    }
