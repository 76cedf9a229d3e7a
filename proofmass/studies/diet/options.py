"""Options of the engine that cost time and may buy nothing: what to try in their place.

Each function gives, for a draft as it is by now, what to try one after the other until one holds:
the cheapest first.  A longer step, an integrator with fewer evaluations of the forces and fewer
iterations are cheaper by counting.  Another solver, Jacobian or cone may be either: those are taken
only where the clock shows that time is saved.
"""

from collections.abc import Callable
from functools import partial
from math import ceil

import mujoco
import numpy as np

from proofmass.check import FAILURES
from proofmass.isolate import isolated
from proofmass.studies.diet.cut import set_option
from proofmass.studies.diet.diet_table import OPTION
from proofmass.studies.diet.draft import Draft
from proofmass.studies.diet.feature import Feature
from proofmass.studies.diet.scene import Scene, Watch
from proofmass.studies.diet.trial import STEPPED, by_steps, most_iterations
from proofmass.wording import number

Rungs = Callable[[Draft, Scene], list[Feature]]
FEWER = (1, 2, 3, 5, 10, 20, 50)  # iterations that are tried
USUAL = {"iterations": 100, "ls_iterations": 50}  # MuJoCo's defaults
LOOSER = (1e-8, 1e-10, 1e-12, 1e-15, 1e-20, 1e-24)  # where the solver may stop, not lower
LONGER = (64, 32, 16, 8, 4, 2)  # times as long as a step is
LATEST = 60.0  # s
INTEGRATOR, SOLVER, JACOBIAN = mujoco.mjtIntegrator, mujoco.mjtSolver, mujoco.mjtJacobian
ELLIPTIC, PYRAMIDAL = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtCone.mjCONE_PYRAMIDAL
EVALUATIONS = {INTEGRATOR.mjINT_RK4: 4}
"""Of the forces in a step; 1 where nothing is said."""
CHEAPER = {  # of each integrator: with fewer evaluations, or fewer derivatives to factorize
    INTEGRATOR.mjINT_RK4: (INTEGRATOR.mjINT_EULER, INTEGRATOR.mjINT_IMPLICITFAST),
    INTEGRATOR.mjINT_IMPLICIT: (INTEGRATOR.mjINT_EULER, INTEGRATOR.mjINT_IMPLICITFAST)}


def stepped(scene: Scene) -> list[Watch]:
    """The runs of a scene that go by time steps."""
    return [watch for watch in scene.watches if by_steps(watch.run)]


def following(scene: Scene, option: str) -> list[Watch]:
    """Those of them that take an option from the model, and not from the sidecar."""
    return [watch for watch in stepped(scene) if option not in watch.run.settings]


def rung(option: str, words: str, value: float) -> Feature:
    """One value of an option."""
    return Feature(OPTION, words, partial(set_option, name=option, value=value))


def work(draft: Draft) -> float:
    """Evaluations of the forces in a second."""
    option = draft.spec.option
    return EVALUATIONS.get(INTEGRATOR(option.integrator), 1) / float(option.timestep)


def tolerances(draft: Draft, scene: Scene) -> list[Feature]:
    """A solver that may stop earlier, or after so few iterations that it never gets there."""
    watches, option = following(scene, "tolerance"), draft.spec.option
    if not watches:
        return []
    watch = max(watches, key=lambda w: w.before.seconds)
    used = taken(draft, watch, option.tolerance)
    found = [rung("tolerance", f"tolerance {number(option.tolerance)} to {number(t)}", t)
             for t in LOOSER if t > option.tolerance]
    if following(scene, "iterations"):
        found += [rung("iterations", f"iterations {option.iterations} to {n}", n)
                  for n in FEWER if n < min(used, option.iterations)]
    return found


def caps(draft: Draft, scene: Scene) -> list[Feature]:
    """Iterations beyond the usual number, which are allowed and not taken."""
    now, most = draft.spec.option.iterations, USUAL["iterations"]
    if now <= most or not following(scene, "iterations"):
        return []
    return [rung("iterations", f"iterations {now} to {most}", most)]


def searches(draft: Draft, scene: Scene) -> list[Feature]:
    """Iterations of the line search beyond the usual number."""
    now, most = draft.spec.option.ls_iterations, USUAL["ls_iterations"]
    if now <= most or not stepped(scene):
        return []
    return [rung("ls_iterations", f"ls_iterations {now} to {most}", most)]


def steps(draft: Draft, scene: Scene) -> list[Feature]:
    """Longer steps, as long as what is from sample to sample has room for them."""
    if not (watches := following(scene, "timestep")):
        return []
    now = float(draft.spec.option.timestep)
    runs = [watch.bound.run if watch.bound else watch.run for watch in watches]
    widths = [float(np.ptp(run.x)) / (run.x.size - 1) for run in runs if run.kind in STEPPED]
    values = [times * now for times in LONGER]
    if widths:  # a sweep that settles at each pose has no time between its samples
        count = max(1, ceil(min(widths) / now - 1e-9))
        values = [min(widths) / fewer for times in LONGER
                  if (fewer := ceil(count / times)) < count]
    # of what is off by rounding no digit is written
    values = list(dict.fromkeys(float(f"{step:.12g}") for step in values))
    return [rung("timestep", f"time step {number(now)} to {number(step)} s", step)
            for step in values]


def integrators(draft: Draft, scene: Scene) -> list[Feature]:
    """Integrators that evaluate less in a step."""
    now = INTEGRATOR(draft.spec.option.integrator)
    return [rung("integrator", f"integrator {told(now)} to {told(other)}", int(other))
            for other in CHEAPER.get(now, ()) if following(scene, "integrator")]


def solvers(draft: Draft, scene: Scene) -> list[Feature]:
    """The other solvers, where there is something to solve."""
    watches, now = following(scene, "solver"), SOLVER(draft.spec.option.solver)
    if not watches or not taken(draft, watches[0], draft.spec.option.tolerance):
        return []
    return [rung("solver", f"solver {told(now)} to {told(other)}", int(other))
            for other in (SOLVER.mjSOL_NEWTON, SOLVER.mjSOL_CG, SOLVER.mjSOL_PGS) if other != now]


def jacobians(draft: Draft, scene: Scene) -> list[Feature]:
    """The other way to keep Jacobian and inertia, sparse or dense."""
    now, watches = JACOBIAN(draft.spec.option.jacobian), stepped(scene)
    if not watches:
        return []
    sparse = mujoco.mj_isSparse(draft.compiled(watches[0].run.rods))
    other = JACOBIAN.mjJAC_DENSE if sparse else JACOBIAN.mjJAC_SPARSE
    return [rung("jacobian", f"jacobian {told(now)} to {told(other)}", int(other))]


def cones(draft: Draft, scene: Scene) -> list[Feature]:
    """Pyramids for elliptic friction cones."""
    if draft.spec.option.cone != ELLIPTIC or not stepped(scene):
        return []
    return [rung("cone", "cone elliptic to pyramidal", int(PYRAMIDAL))]


def told(value: object) -> str:
    """What an option's value is called in MJCF, but for Newton, CG, PGS and RK4 in capitals.

    >>> import mujoco
    >>> told(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    'implicitfast'
    """
    word = str(value.name)[6:]  # type: ignore[attr-defined]
    return word if word in ("CG", "PGS", "RK4") else word.capitalize() if word in (
        "NEWTON", "EULER") else word.lower()


def taken(draft: Draft, watch: Watch, tolerance: float) -> int:
    """Iterations that a run takes with a tolerance; all that it may, if it fails."""
    try:
        return int(isolated(most_iterations, draft.compiled(watch.run.rods), watch.brief,
                            tolerance, timeout=LATEST))
    except tuple(FAILURES):
        return int(draft.spec.option.iterations)


COUNTED: tuple[Rungs, ...] = (tolerances, caps, searches)
"""What is taken where it holds."""
ORDERS: tuple[tuple[Rungs, ...], ...] = ((steps, integrators), (integrators, steps))
"""Which goes first makes a difference: the way that is left with less work is taken."""
CLOCKED: tuple[Rungs, ...] = (cones, solvers, jacobians)
"""What is taken where it holds and the clock shows that it saves time."""
