"""What may be removed from a scene or made cheaper: features of its `MjSpec`, and engine options.

A feature may have parts, which are tried where it cannot go as a whole; one half of the geoms is an
example.  So all features that are not needed go at once, and those that matter are found in a few
runs.

For each engine option a function gives, for an edited model as it is, what to try in its place: the
cheapest first, until one holds.  A longer step, an integrator with fewer evaluations of the forces
and fewer iterations are cheaper by counting.  Another solver, Jacobian or cone may be cheaper or
not: it is taken only where the measured time is less.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import SupportsInt

import mujoco
import numpy as np

from proofmass.sim.protocol import whole_steps
from proofmass.studies.diet.edits import (
    Cut,
    EditedModel,
    coarser,
    enclose,
    flatten,
    masks_off,
    planar,
    set_option,
    switch_off,
    undraw,
    unlimit,
)
from proofmass.studies.diet.scene import DietScene, MonitoredRun
from proofmass.studies.diet.table import OPTION
from proofmass.studies.diet.trial import STEPPED, by_steps, most_iterations
from proofmass.studies.measure import Measurement, measure
from proofmass.wording import number

ENABLES = "mjENBL_"  # begins the names of flags that MJCF has without it
CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
JOINT, MESH = mujoco.mjtJoint, mujoco.mjtGeom.mjGEOM_MESH
DRAWN = "drawn geom"
WHOLE = {  # lists of elements that are deleted as they are, and what one of them is called
    "joints": "joint",
    "equalities": "equality",
    "actuators": "actuator",
    "tendons": "tendon",
    "pairs": "contact pair",
    "excludes": "exclude",
    "lights": "light",
    "cameras": "camera",
    "skins": "skin",
    "sites": "site",
    "textures": "texture",
    "meshes": "mesh",
    "hfields": "height field",
    "texts": "text",
    "numerics": "number",
    "tuples": "tuple",
}


@dataclass(frozen=True)
class Feature:
    """Something that a scene may not need.

    Attributes
    ----------
    kind, name : str
        What it is, and which.
    cut : callable
        Takes it out of an edited model, in place; may raise ValueError.
    parts : tuple of Feature
        To try if it cannot go as a whole.
    edit : str
        The same as lines of MJCF to paste; empty where elements are taken out.
    """

    kind: str
    name: str
    cut: Cut
    parts: tuple["Feature", ...] = ()
    edit: str = ""


def bundle(
    kind: str, names: list[str], cut: Callable[[EditedModel, str], None]
) -> Iterator[Feature]:
    """A feature of many, whose parts are its halves; none of none."""
    if not names:
        return

    def all_of(edited: EditedModel) -> None:
        for name in names:
            cut(edited, name)

    half = len(names) // 2
    halves = [*bundle(kind, names[:half], cut), *bundle(kind, names[half:], cut)] if half else []
    yield Feature(
        kind,
        names[0] if len(names) == 1 else f"{len(names)}: {', '.join(names)}",
        all_of,
        tuple(halves),
    )


def ladder(kind: str, rungs: Iterable[tuple[str, Cut]]) -> Iterator[Feature]:
    """The first rung that holds: each is tried where the one before does not."""
    below: tuple[Feature, ...] = ()
    for name, cut in reversed(list(rungs)):
        below = (Feature(kind, name, cut, below),)
    yield from below


def features(edited: EditedModel, scene: DietScene) -> Iterator[Feature]:
    """All that may go from an edited model of a scene, in the order in which it is tried."""
    read, keys = scene.read, scene.keys
    spec = edited.spec
    sensors = [s.name for s in spec.sensors if read is not None and s.name not in read]
    yield from bundle("sensor nobody reads", sensors, dropper("sensors"))
    yield from bundle("key", [k.name for k in spec.keys if k.name not in keys], dropper("keys"))
    yield from contacts(edited)
    yield from solver(edited, scene.longest)
    yield from (subtree(body) for body in spec.worldbody.bodies)
    yield from flat(edited)
    for kind, word in WHOLE.items():
        yield from bundle(word, [e.name for e in getattr(spec, kind)], dropper(kind))
    limited = [j.name for j in spec.joints if limits(j)]
    yield from bundle("limit", limited, unlimit)
    yield from bundle("material", [m.name for m in spec.materials], flatten)
    meshes = [g.name for g in spec.geoms if g.type == MESH]
    yield from bundle("mesh, as a box", meshes, enclose)
    bare = [g.name for g in spec.geoms if g.type != MESH and not collides(edited, g)]
    yield from bundle(DRAWN, bare, undraw)
    yield from ladder(
        "segments of rods",
        [(f"{k} times fewer", partial(coarser, share=k)) for k in (8, 4, 2) if fit(edited, k)],
    )


def dropper(kind: str) -> Callable[[EditedModel, str], None]:
    """Deletes an element of one of the spec's lists."""
    return lambda edited, name: edited.drop(kind, name)


def collides(edited: EditedModel, geom: object) -> bool:
    """Whether a geom can touch anything."""
    off = edited.spec.option.disableflags & CONTACT
    return not off and bool(geom.contype or geom.conaffinity)  # type: ignore[attr-defined]


def contacts(edited: EditedModel) -> Iterator[Feature]:
    """All contacts at once, by the flag; else geoms that touch nothing."""
    masked = [g.name for g in edited.spec.geoms if collides(edited, g)]
    if masked or (edited.spec.pairs and not edited.spec.option.disableflags & CONTACT):
        yield Feature(
            "contact",
            "all",
            partial(switch_off, bit=CONTACT),
            tuple(bundle("contact of geom", masked, masks_off)),
            '<option><flag contact="disable"/></option>',
        )


def solver(edited: EditedModel, monitored: MonitoredRun) -> Iterator[Feature]:
    """What the solver does beside its task; see `tolerances` and `solvers` for its options."""
    if not by_steps(monitored.run):
        return
    option = edited.spec.option
    if option.noslip_iterations:
        yield Feature(
            "solver",
            "noslip iterations",
            partial(set_option, name="noslip_iterations", value=0),
            edit='<option noslip_iterations="0"/>',
        )
    if option.enableflags & ~int(mujoco.mjtEnableBit.mjENBL_OVERRIDE):
        flags = [
            f'{name.removeprefix(ENABLES).lower()}="disable"'
            for name, bit in mujoco.mjtEnableBit.__members__.items()
            if name.startswith(ENABLES) and option.enableflags & int(bit)
        ]
        yield Feature(
            "flag",
            "what is enabled beside the defaults",
            partial(set_option, name="enableflags", value=0),
            edit=f"<option><flag {' '.join(flags)}/></option>",
        )


def subtree(body: mujoco._specs.MjsBody) -> Feature:
    """A body with all that hangs on it; its parts are the bodies that do."""
    name = body.name
    return Feature(
        "body",
        name,
        lambda edited: edited.drop("bodies", name),
        tuple(subtree(child) for child in body.bodies),
    )


def flat(edited: EditedModel) -> Iterator[Feature]:
    """Free joints and balls of bodies that stay in a plane across one of the world's axes."""
    for joint in edited.spec.joints:
        if joint.type in (JOINT.mjJNT_FREE, JOINT.mjJNT_BALL):
            kind = "free joint" if joint.type == JOINT.mjJNT_FREE else "ball"
            yield from ladder(
                f"{kind} in a plane",
                [
                    (f"{joint.name} across {axis}", partial(planar, name=joint.name, normal=normal))
                    for axis, normal in zip("zyx", np.eye(3)[::-1], strict=True)
                ],
            )


def limits(joint: mujoco._specs.MjsJoint) -> bool:
    """Whether a joint has limits."""
    given = bool(np.ptp(joint.range))
    return bool(
        joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE
        or (joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and given)
    )


def fit(edited: EditedModel, share: int) -> bool:
    """Whether all rods can be cut into so many times fewer segments."""
    return bool(edited.rods) and all(
        rod.segments // share >= 2 and rod.segments % share == 0 for rod in edited.rods
    )


Rungs = Callable[[EditedModel, DietScene], list[Feature]]
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
    INTEGRATOR.mjINT_IMPLICIT: (INTEGRATOR.mjINT_EULER, INTEGRATOR.mjINT_IMPLICITFAST),
}


def stepped(scene: DietScene) -> list[MonitoredRun]:
    """The runs of a scene that go by time steps."""
    return [monitored for monitored in scene.monitored_runs if by_steps(monitored.run)]


def following(scene: DietScene, option: str) -> list[MonitoredRun]:
    """Those of them that take an option from the model, and not from the sidecar."""
    return [monitored for monitored in stepped(scene) if option not in monitored.run.settings]


def rung(option: str, words: str, value: float, name: str = "") -> Feature:
    """One value of an option, and its name where MJCF has one for it."""
    edit = f'<option {option}="{name or repr(value)}"/>'
    return Feature(OPTION, words, partial(set_option, name=option, value=value), edit=edit)


def exchanged(option: str, now: SupportsInt, other: SupportsInt) -> Feature:
    """Another value of an option that has names for its values."""
    before, after = format_option(now), format_option(other)
    return rung(option, f"{option} {before} to {after}", int(other), after)


def work(edited: EditedModel) -> float:
    """Evaluations of the forces in a second."""
    option = edited.spec.option
    return EVALUATIONS.get(INTEGRATOR(option.integrator), 1) / float(option.timestep)


def tolerances(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """A solver that may stop earlier, or after so few iterations that it never gets there."""
    monitored_runs, option = following(scene, "tolerance"), edited.spec.option
    if not monitored_runs:
        return []
    monitored = max(monitored_runs, key=lambda w: w.before.seconds)
    used = taken(edited, monitored, option.tolerance)
    found = [
        rung("tolerance", f"tolerance {number(option.tolerance)} to {number(t)}", t)
        for t in LOOSER
        if t > option.tolerance
    ]
    if following(scene, "iterations"):
        found += [
            rung("iterations", f"iterations {option.iterations} to {n}", n)
            for n in FEWER
            if n < min(used, option.iterations)
        ]
    return found


def caps(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Iterations beyond the usual number, which are allowed and not taken."""
    now, most = edited.spec.option.iterations, USUAL["iterations"]
    if now <= most or not following(scene, "iterations"):
        return []
    return [rung("iterations", f"iterations {now} to {most}", most)]


def searches(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Iterations of the line search beyond the usual number."""
    now, most = edited.spec.option.ls_iterations, USUAL["ls_iterations"]
    if now <= most or not stepped(scene):
        return []
    return [rung("ls_iterations", f"ls_iterations {now} to {most}", most)]


def steps(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Longer steps; in runs through time at most one from sample to sample."""
    if not (monitored_runs := following(scene, "timestep")):
        return []
    now = float(edited.spec.option.timestep)
    runs = [
        monitored.bound.run if monitored.bound else monitored.run for monitored in monitored_runs
    ]
    widths = [float(np.ptp(run.x)) / (run.x.size - 1) for run in runs if run.kind in STEPPED]
    values = [times * now for times in LONGER]
    if widths:  # a sweep that settles at each pose has no time between its samples
        count = whole_steps(min(widths), now)
        values = [min(widths) / fewer for times in LONGER if (fewer := ceil(count / times)) < count]
    # of what is off by rounding no digit is written
    values = list(dict.fromkeys(float(f"{step:.12g}") for step in values))
    return [
        rung("timestep", f"time step {number(now)} to {number(step)} s", step) for step in values
    ]


def integrators(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Integrators that evaluate less in a step."""
    now = INTEGRATOR(edited.spec.option.integrator)
    return [
        exchanged("integrator", now, other)
        for other in CHEAPER.get(now, ())
        if following(scene, "integrator")
    ]


def solvers(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """The other solvers, where there is something to solve."""
    monitored_runs, now = following(scene, "solver"), SOLVER(edited.spec.option.solver)
    if not monitored_runs or not taken(edited, monitored_runs[0], edited.spec.option.tolerance):
        return []
    return [
        exchanged("solver", now, other)
        for other in (SOLVER.mjSOL_NEWTON, SOLVER.mjSOL_CG, SOLVER.mjSOL_PGS)
        if other != now
    ]


def jacobians(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """The other way to keep Jacobian and inertia, sparse or dense."""
    now, monitored_runs = JACOBIAN(edited.spec.option.jacobian), stepped(scene)
    if not monitored_runs:
        return []
    sparse = mujoco.mj_isSparse(edited.compiled(monitored_runs[0].run.rods))
    other = JACOBIAN.mjJAC_DENSE if sparse else JACOBIAN.mjJAC_SPARSE
    return [exchanged("jacobian", now, other)]


def cones(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Pyramids for elliptic friction cones."""
    if edited.spec.option.cone != ELLIPTIC or not stepped(scene):
        return []
    return [rung("cone", "cone elliptic to pyramidal", int(PYRAMIDAL), "pyramidal")]


def format_option(value: object) -> str:
    """What an option's value is called in MJCF, but for Newton, CG, PGS and RK4 in capitals.

    >>> import mujoco
    >>> format_option(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    'implicitfast'
    """
    word = str(value.name)[6:]  # type: ignore[attr-defined]
    return (
        word
        if word in ("CG", "PGS", "RK4")
        else word.capitalize()
        if word in ("NEWTON", "EULER")
        else word.lower()
    )


def taken(edited: EditedModel, monitored: MonitoredRun, tolerance: float) -> int:
    """Iterations that a run takes with a tolerance; all that it may, if it fails."""
    model = edited.compiled(monitored.run.rods)
    found = measure(most_iterations, model, monitored.brief, tolerance, timeout=LATEST)
    return int(edited.spec.option.iterations) if isinstance(found, Measurement) else found


COUNTED: tuple[Rungs, ...] = (tolerances, caps, searches)
"""What is taken where it holds."""
ORDERS: tuple[tuple[Rungs, ...], ...] = ((steps, integrators), (integrators, steps))
"""Which goes first makes a difference: the way that is left with less work is taken."""
CLOCKED: tuple[Rungs, ...] = (cones, solvers, jacobians)
"""What is taken where it holds and the clock shows that it saves time."""
