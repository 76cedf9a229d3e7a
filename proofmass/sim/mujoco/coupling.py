"""Which bodies of a MuJoCo model act on each other, found while it moves.

A kinematic tree is a body that is joined to the world, with all that hangs on it.  Two trees act
on each other through a contact or an equality (a row of the constraint Jacobian with entries of
both), a tendon, an actuator or a flex.  Trees that none of these joins, not even through others,
move as they would alone: gravity and fluids act on each by itself, and what does not move passes
nothing on.
"""

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.model import begin
from proofmass.sim.protocol import Run

WRAP = mujoco.mjtWrap


def independent_groups(model: mujoco.MjModel, run: Run) -> list[list[str]]:
    """Groups of kinematic trees that do not act on each other in a run.

    Contacts are those that are there in a step of the run; what would touch later is not known.

    Parameters
    ----------
    model : mujoco.MjModel
    run : Run
        Of which the start, the settings and the last time are used; nothing is driven.

    Returns
    -------
    list of list of str
        The names of the bodies that are joined to the world, a list for each group.  One group of
        all where a plugin may join any two.
    """
    model, data = begin(model, run)
    count = model.ntree
    joined = np.eye(count, dtype=bool)
    if model.nplugin:
        joined[:] = True
    of_dof = np.zeros((model.nv, count))
    of_dof[np.arange(model.nv), model.dof_treeid] = 1.0
    for bodies in (*tendon_bodies(model), *actuator_bodies(model), *flex_bodies(model)):
        join(joined, model.body_treeid[bodies])
    for _ in range(max(1, round(float(run.x[-1] - run.x[0]) / model.opt.timestep))):
        mujoco.mj_step(model, data)
        rows = (np.abs(constraint_jacobian(model, data)) @ of_dof > 0).astype(int)
        joined |= rows.T @ rows > 0
    roots = [model.body(int(b)).name for b in model.tree_bodyadr]
    return [[roots[k] for k in np.flatnonzero(row)] for row in distinct(closed(joined))]


def constraint_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The Jacobian of all constraints that are active now, shape (constraints, dofs)."""
    if not data.nefc:
        return np.zeros((0, model.nv))
    if not mujoco.mj_isSparse(model):
        # rows of what turned out to move nothing are left at its end
        return np.asarray(data.efc_J).ravel()[: data.nefc * model.nv].reshape(data.nefc, model.nv)
    dense = np.zeros((data.nefc, model.nv))
    values, columns = data.efc_J.ravel(), data.efc_J_colind.ravel()
    for k, (first, n) in enumerate(zip(data.efc_J_rowadr, data.efc_J_rownnz, strict=True)):
        dense[k, columns[first : first + n]] = values[first : first + n]
    return dense


def tendon_bodies(model: mujoco.MjModel) -> list[list[int]]:
    """The bodies that each tendon runs over."""
    found = []
    for first, n in zip(model.tendon_adr, model.tendon_num, strict=True):
        bodies = []
        for kind, k in zip(
            model.wrap_type[first : first + n], model.wrap_objid[first : first + n], strict=True
        ):
            if kind == WRAP.mjWRAP_JOINT:
                bodies.append(int(model.jnt_bodyid[k]))
            elif kind == WRAP.mjWRAP_SITE:
                bodies.append(int(model.site_bodyid[k]))
            elif kind in (WRAP.mjWRAP_SPHERE, WRAP.mjWRAP_CYLINDER):
                bodies.append(int(model.geom_bodyid[k]))
        found.append(bodies)
    return found


def actuator_bodies(model: mujoco.MjModel) -> list[list[int]]:
    """The bodies of the two sites of each actuator that has two.

    One on a tendon acts where the tendon does, one on a joint or a body on a single tree.
    """
    two = (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK)
    return [
        model.site_bodyid[sites].tolist()
        for kind, sites in zip(model.actuator_trntype, model.actuator_trnid, strict=True)
        if int(kind) in two and min(sites) >= 0
    ]


def flex_bodies(model: mujoco.MjModel) -> list[list[int]]:
    """The bodies that carry each flex."""
    return [
        [*model.flex_vertbodyid[v : v + m].tolist(), *model.flex_nodebodyid[a : a + n].tolist()]
        for v, m, a, n in zip(
            model.flex_vertadr,
            model.flex_vertnum,
            model.flex_nodeadr,
            model.flex_nodenum,
            strict=True,
        )
    ]


def join(joined: np.ndarray, trees: np.ndarray) -> None:
    """Note, in place, that these trees act on each other; -1 is the world."""
    own = np.unique(trees[trees >= 0])
    joined[np.ix_(own, own)] = True


def closed(joined: np.ndarray) -> np.ndarray:
    """The transitive closure of a symmetric relation.

    >>> import numpy as np
    >>> chain = np.eye(4, dtype=bool); chain[0, 1] = chain[1, 0] = chain[1, 2] = chain[2, 1] = True
    >>> closed(chain)[0].tolist()
    [True, True, True, False]
    """
    while True:
        more = joined.astype(int) @ joined > 0
        if (more == joined).all():
            return joined
        joined = more


def distinct(rows: np.ndarray) -> list[np.ndarray]:
    """The rows that differ, in the order in which they first come."""
    return [row for k, row in enumerate(rows) if not (rows[:k] == row).all(axis=1).any()]
