"""Runs of a compiled model: once for its channels, or in pairs for its cost.

These functions are called in worker processes; `compare_costs_isolated` starts its own.

`independent_groups` finds which bodies act on each other while a model moves.  A kinematic tree is
a body that is joined to the world, with all its descendants.  Two trees act on each other through
a contact or an equality (a row of the constraint Jacobian with entries of both), a tendon, an
actuator or a flex.  Trees that none of these joins, directly or through other trees, move as they
would alone: gravity and fluids act on each tree by itself, and bodies that do not move transmit
nothing.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, inf
from random import Random

import mujoco
import numpy as np
from scipy.sparse.csgraph import connected_components

from proofmass.base.arrays import Array
from proofmass.base.worker import Crashed, call_isolated
from proofmass.sim.mujoco.engine import run_compiled
from proofmass.sim.mujoco.model import prepare_model
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Diverged, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.studies.measure import Measurement, pin_process, reserve_processor
from proofmass.verdict.outcome import Outcome

FREE_MOTION = "passive"  # the kind of run of a free motion, which is no run of a sidecar
STEPPED_KINDS = ("dynamics", FREE_MOTION)  # kinds of runs with time steps
MIN_ROUNDS_SECONDS = 0.5  # s, least counted time of all rounds
MAX_TIMED_PAIRS = 250  # pairs of runs at most, since very short runs take longer than counted
INTERVAL_LEVEL = 0.99  # probability with which an interval contains its median

TimeRange = tuple[float, float, float]
"""The lower end of an interval, the median, and the upper end."""


@dataclass(frozen=True)
class Cost:
    """Processor time per step [s], the median of the rounds, and memory of model and data [bytes].

    For a model with another time step it is the time per step of the first model, over the same
    duration of the motion.
    """

    seconds: float
    size: int


@dataclass(frozen=True)
class CostComparison:
    """The costs of two models, and the share of the first one's time that the second one saves.

    Attributes
    ----------
    costs : tuple of two Cost
        The costs of the first and of the second model.
    saved : TimeRange
        The share, from the ratios of times of pairs of runs, one run after the other.
    """

    costs: tuple[Cost, Cost]
    saved: TimeRange


def has_time_steps(run: Run) -> bool:
    """Whether a run has time steps."""
    return run.kind in STEPPED_KINDS or bool(run.settings.get("settled"))


def attempt(model: mujoco.MjModel, run: Run, nudge: float = 0.0) -> Curves:
    """One run of a copy of a model; every joint is displaced by `nudge` at the start [rad or m].

    An exception that is not one of an engine's own counts as a crash of that run.
    """
    try:
        return run_model(model, run, nudge)[0]
    except (BadModel, Unsupported, Diverged):
        raise
    except Exception as error:
        raise Crashed(f"{type(error).__name__}: {error}") from error


def failed_outcome(found: Measurement) -> str:
    """The outcome that a diet gives to a feature without which a run failed.

    >>> failed_outcome(Measurement(outcome=Outcome.NO_START))
    'needed'
    """
    words = {str(Outcome.NO_START): "needed", str(Outcome.NOT_SOLVED): str(Outcome.DIVERGED)}
    return words.get(found.outcome, found.outcome)


def run_model(model: mujoco.MjModel, run: Run, nudge: float = 0.0) -> tuple[Curves, mujoco.MjData]:
    """A run, and the engine's state at its end."""
    model, data = prepare_model(copy.copy(model), run)
    mujoco.mj_integratePos(model, data.qpos, np.full(model.nv, nudge), 1.0)
    return run_compiled(model, data, run), data


def groups(model: mujoco.MjModel, run: Run) -> list[list[str]]:
    """The bodies of a model in groups that do not act on each other in a run."""
    return independent_groups(copy.copy(model), run)


def compare_costs_isolated(
    models: tuple[mujoco.MjModel, mujoco.MjModel], run: Run, rounds: int, timeout: float
) -> CostComparison:
    """Call `compare_costs` in a process of its own, on a processor of its own."""
    with reserve_processor() as core:
        return call_isolated(
            compare_costs, models, run, rounds, MIN_ROUNDS_SECONDS, core, timeout=timeout
        )


def compare_costs(
    models: tuple[mujoco.MjModel, mujoco.MjModel],
    run: Run,
    rounds: int,
    span: float,
    core: int | None = None,
) -> CostComparison:
    """The costs of two models that are run in pairs, after a pair that warms up.

    The first model of each pair is chosen at random, so that a periodic disturbance of the machine
    does not affect one model more often; a disturbance longer than a pair affects both.  The times
    are those of the processor, not wall times, so that other processes have as little effect as
    possible.  There are at least `rounds` pairs, and more if they count less than `span` [s].
    """
    times: list[list[float]] = [[], []]
    sizes, steps, random = [0, 0], 0, Random(0)
    round_number, counted = 0, 0.0
    with pin_process(core):
        while round_number <= rounds or (counted < span and round_number <= MAX_TIMED_PAIRS):
            for k in random.sample((0, 1), 2):
                seconds, curves, data = time_steps(models[k], run)
                sizes[k] = int(mujoco.mj_sizeModel(models[k]) + data.nbuffer + data.maxuse_arena)
                steps = curves.steps if k == 0 else steps
                counted += curves.cost
                if round_number:
                    times[k].append(seconds)
            round_number += 1
    one, two = (
        Cost(float(np.median(t)) / steps, size) for t, size in zip(times, sizes, strict=True)
    )
    return CostComparison((one, two), saved_share([b / a for a, b in zip(*times, strict=True)]))


def time_steps(model: mujoco.MjModel, run: Run) -> tuple[float, Curves, mujoco.MjData]:
    """Processor time of the steps of a run [s], curves, and end state.

    Their time is without that of their preparation, which takes as long as a hundred steps and does
    not grow with the run: it would hide what a feature costs in a short one.
    """
    curves, data = run_model(model, run)
    return curves.seconds, curves, data


def saved_share(ratios: Sequence[float]) -> TimeRange:
    """The share of time that is saved, with its interval, from ratios of times after to before.

    >>> saved_share([0.5] * 9)
    (0.5, 0.5, 0.5)
    """
    low, middle, high = median_interval(ratios)
    return 1 - high, 1 - middle, 1 - low


def median_interval(values: Sequence[float], level: float = INTERVAL_LEVEL) -> TimeRange:
    """The median of values, and an interval that contains the median of their distribution.

    The interval is from the k-th value from below to the k-th from above.  For any distribution,
    each of n independent values is below its median with probability 1/2.  So the interval does not
    contain the median with probability 2 P(B < k), where B is binomial with n and 1/2 (the sign
    test).  With fewer than 8 values the interval is infinite at the level 0.99.

    Parameters
    ----------
    values : sequence of float
        Independent values of one quantity [its unit].
    level : float
        Least probability [1] with which the interval contains the median.

    Returns
    -------
    tuple of float
        Lower end of the interval, median, and upper end [its unit], the unit of the values.

    >>> median_interval(range(1, 16))
    (3, 8.0, 13)
    >>> median_interval([1.0, 2.0])
    (-inf, 1.5, inf)
    """
    ranked, n, k, below = sorted(values), len(values), 0, 0
    while 2 * (below + comb(n, k)) <= (1 - level) * 2**n:
        below += comb(n, k)
        k += 1
    middle = float(np.median(ranked))
    return (ranked[k - 1], middle, ranked[n - k]) if k else (-inf, middle, inf)


def most_iterations(model: mujoco.MjModel, run: Run, tolerance: float) -> int:
    """Most iterations that the solver takes in a step of a run, with a tolerance."""
    model.opt.tolerance, most = tolerance, 0

    def look(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        nonlocal most
        most = max(most, int(data.solver_niter.max()))  # of the step before

    mujoco.set_mjcb_control(look)
    try:
        run_model(model, run)
    finally:
        mujoco.set_mjcb_control(None)
    return most


WrapType = mujoco.mjtWrap


def independent_groups(model: mujoco.MjModel, run: Run) -> list[list[str]]:
    """Groups of kinematic trees that do not act on each other in a run.

    Contacts count if they exist in a step of the run; later contacts are not known.

    Parameters
    ----------
    model : mujoco.MjModel
    run : Run
        Its start, settings and last time are used; no drives act.

    Returns
    -------
    list of list of str
        The names of the bodies that are joined to the world, in a list for each group.  All are in
        one group if the model has plugins, since these may act on any bodies.
    """
    model, data = prepare_model(model, run)
    count = model.ntree
    joined = np.eye(count, dtype=bool)
    if model.nplugin:
        joined[:] = True
    of_dof = np.zeros((model.nv, count))
    of_dof[np.arange(model.nv), model.dof_treeid] = 1.0
    for bodies in (*tendon_bodies(model), *actuator_bodies(model), *flex_bodies(model)):
        join_trees(joined, model.body_treeid[bodies])
    for _ in range(max(1, round(float(run.x[-1] - run.x[0]) / model.opt.timestep))):
        mujoco.mj_step(model, data)
        rows = (np.abs(constraint_jacobian(model, data)) @ of_dof > 0).astype(int)
        joined |= rows.T @ rows > 0
    roots = [model.body(int(b)).name for b in model.tree_bodyadr]
    number, group = connected_components(joined)
    return [[roots[k] for k in np.flatnonzero(group == one)] for one in range(number)]


def constraint_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """The Jacobian of all constraints that are active now, shape (constraints, dofs)."""
    if not data.nefc:
        return np.zeros((0, model.nv))
    if not mujoco.mj_isSparse(model):
        # the buffer is longer than nefc rows, since rows that moved nothing were dropped
        return np.asarray(data.efc_J).ravel()[: data.nefc * model.nv].reshape(data.nefc, model.nv)
    dense = np.zeros((data.nefc, model.nv))
    values, columns = data.efc_J.ravel(), data.efc_J_colind.ravel()
    for k, (first, n) in enumerate(zip(data.efc_J_rowadr, data.efc_J_rownnz, strict=True)):
        dense[k, columns[first : first + n]] = values[first : first + n]
    return dense


def tendon_bodies(model: mujoco.MjModel) -> list[list[int]]:
    """The bodies that each tendon acts on."""
    found = []
    for first, n in zip(model.tendon_adr, model.tendon_num, strict=True):
        bodies = []
        for kind, k in zip(
            model.wrap_type[first : first + n], model.wrap_objid[first : first + n], strict=True
        ):
            if kind == WrapType.mjWRAP_JOINT:
                bodies.append(int(model.jnt_bodyid[k]))
            elif kind == WrapType.mjWRAP_SITE:
                bodies.append(int(model.site_bodyid[k]))
            elif kind in (WrapType.mjWRAP_SPHERE, WrapType.mjWRAP_CYLINDER):
                bodies.append(int(model.geom_bodyid[k]))
        found.append(bodies)
    return found


def actuator_bodies(model: mujoco.MjModel) -> list[list[int]]:
    """The bodies of the two sites of each actuator that has two sites.

    An actuator on a tendon acts on the tendon's bodies, one on a joint or a body on a single tree.
    """
    two = (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK)
    return [
        model.site_bodyid[sites].tolist()
        for kind, sites in zip(model.actuator_trntype, model.actuator_trnid, strict=True)
        if int(kind) in two and min(sites) >= 0
    ]


def flex_bodies(model: mujoco.MjModel) -> list[list[int]]:
    """The bodies to which the vertices and nodes of each flex belong."""
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


def join_trees(joined: np.ndarray, trees: np.ndarray) -> None:
    """Mark, in place, that these trees act on each other; -1 is the world."""
    own = np.unique(trees[trees >= 0])
    joined[np.ix_(own, own)] = True
