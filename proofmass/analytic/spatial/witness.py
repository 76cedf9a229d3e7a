"""Comparison of the terms of a motion with those of a second, independent formulation.

The terms with which a motion was integrated come from a source such as MuJoCo. At some of its poses
this package computes every term by its own formulation; a defect in either would show there.
"""

from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.analytic.spatial.mechanism import Tree
from proofmass.analytic.spatial.terms import NAMES, Terms, TermSource, own_terms

STATES = 50
"""Number of poses of a motion at which the terms are computed a second time."""
AGREED = 1e-12
"""Largest difference of a term, as a share of the largest of its kind in the motion [1]."""


class TermsDiffer(ValueError):
    """Two formulations of the equations of motion differ; one of them has a defect."""


@dataclass(frozen=True)
class Witnessed:
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


def bear_witness(
    tree: Tree,
    source: TermSource,
    times: Array,
    q: Array,
    v: Array,
    when: str = "t",
    ctrl: Array | None = None,
) -> Witnessed:
    """Compare the terms of a motion with own ones at `STATES` of its poses.

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
        The difference is more than `AGREED`; the message has the term and the time.
    """
    some = np.unique(np.linspace(0, len(q) - 1, STATES).round().astype(int))
    controls = None if ctrl is None else ctrl[some]
    own = own_terms(tree, q[some], v[some], controls)
    each = len(some) * [None] if controls is None else controls
    given = [source.terms(*state) for state in zip(q[some], v[some], each, strict=True)]
    theirs = Terms(**{name: np.array([getattr(one, name) for one in given]) for name in NAMES})
    worst = Witnessed(len(some), 0.0, "mass")
    for name, scale in scales(own, v[some]).items():
        apart = np.abs(getattr(own, name) - getattr(theirs, name)).reshape(len(some), -1)
        if not apart.size:
            continue
        share = apart.max(axis=1) / scale
        k = int(np.argmax(np.where(np.isfinite(share), share, np.inf)))
        if not share[k] <= AGREED:
            raise TermsDiffer(
                f"the {NAMES[name]} of {source.name} and of proofmass's own formulation differ by "
                f"{share[k]:.3g} of the largest at {when} = {times[some[k]]:.6g}, where {AGREED:g} "
                f"is rounding: one of the two has a defect, and there is no reference"
            )
        if share[k] >= worst.difference:
            worst = Witnessed(len(some), float(share[k]), name)
    return worst


def scales(terms: Terms, v: Array) -> dict[str, float]:
    """Find the scale of each kind of term in a motion, by which differences are divided.

    It is the largest value of the kind; for gaps, in m and rad, it is 1.  The scale of drifts is at
    least that of accelerations, of the order of forces over masses, since the drifts of bodies at
    rest are rounding.
    """

    def largest(*parts: Array) -> float:
        return max((float(np.abs(part).max(initial=0.0)) for part in parts), default=0.0) or 1.0

    forces, mass = largest(terms.bias, terms.force), largest(terms.mass)
    rows = largest(terms.jacobian)
    bent = rows * max(float((v**2).max(initial=0.0)), forces / mass)
    return {
        "mass": mass,
        "bias": forces,
        "force": forces,
        "gap": 1.0,
        "jacobian": rows,
        "drift": max(largest(terms.drift), bent),
    }
