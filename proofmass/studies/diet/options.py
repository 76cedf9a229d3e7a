"""Features that may be removed from a scene, and engine options that may be made cheaper.

A feature may have parts, which are tried if it cannot be removed as a whole.  For example, the
parts of a feature of many geoms are its halves.  So all features that are not needed are removed at
once, and those that matter are found in a few runs.

For each engine option a function gives the values to try with an edited model, the cheapest first,
until one of them is harmless.  A longer step, an integrator with fewer evaluations of the forces
and fewer iterations have a lower cost, which can be counted.  Another solver, Jacobian or cone may
be cheaper or not, so it is taken only if the measured time is less.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import SupportsInt

import mujoco
import numpy as np

from proofmass.base.wording import number
from proofmass.sim.protocol.run import whole_steps
from proofmass.studies.diet.edits import (
    Cut,
    EditedModel,
    disable_contacts,
    divide_segments,
    make_planar,
    remove_drawn_geom,
    remove_limits,
    remove_material,
    replace_mesh_by_box,
    set_option,
    switch_off,
)
from proofmass.studies.diet.scene import DietScene, MonitoredRun
from proofmass.studies.diet.table import OPTION_KIND
from proofmass.studies.diet.trial import STEPPED_KINDS, has_time_steps, most_iterations
from proofmass.studies.measure import Measurement, measure

ENABLE_PREFIX = "mjENBL_"  # prefix of the names of flags, which they do not have in MJCF
CONTACT_FLAG = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
JointType, MESH = mujoco.mjtJoint, mujoco.mjtGeom.mjGEOM_MESH
DRAWN_GEOM = "drawn geom"
DELETED_LISTS = {  # lists of the spec whose elements are deleted, and the word for one element
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
    """A part of a model that its scene may not need, or another value of an engine option.

    Attributes
    ----------
    kind, name : str
        The kind of feature, and the name of this one.
    cut : callable
        Removes it from an edited model, in place; may raise ValueError.
    parts : tuple of Feature
        Features to try if it cannot be removed as a whole.
    edit : str
        Lines of MJCF that do the same; empty if elements are removed.
    """

    kind: str
    name: str
    cut: Cut
    parts: tuple["Feature", ...] = ()
    edit: str = ""


def split_in_halves(
    kind: str, names: list[str], cut: Callable[[EditedModel, str], None]
) -> Iterator[Feature]:
    """A feature of several elements, whose parts are its halves; nothing if there are no names."""
    if not names:
        return

    def all_of(edited: EditedModel) -> None:
        for name in names:
            cut(edited, name)

    half = len(names) // 2
    halves = (
        [*split_in_halves(kind, names[:half], cut), *split_in_halves(kind, names[half:], cut)]
        if half
        else []
    )
    yield Feature(
        kind,
        names[0] if len(names) == 1 else f"{len(names)}: {', '.join(names)}",
        all_of,
        tuple(halves),
    )


def chain_features(kind: str, choices: Iterable[tuple[str, Cut]]) -> Iterator[Feature]:
    """The first of some features, whose only part is the next: that is tried if the first fails."""
    later: tuple[Feature, ...] = ()
    for name, cut in reversed(list(choices)):
        later = (Feature(kind, name, cut, later),)
    yield from later


def list_features(edited: EditedModel, scene: DietScene) -> Iterator[Feature]:
    """All features that may be removed from an edited model, in the order in which to try them."""
    read, keys = scene.read, scene.keys
    spec = edited.spec
    sensors = [s.name for s in spec.sensors if read is not None and s.name not in read]
    yield from split_in_halves("sensor nobody reads", sensors, make_dropper("sensors"))
    yield from split_in_halves(
        "key", [k.name for k in spec.keys if k.name not in keys], make_dropper("keys")
    )
    yield from contact_features(edited)
    yield from solver_features(edited, scene.longest)
    yield from (subtree_feature(body) for body in spec.worldbody.bodies)
    yield from planar_features(edited)
    for kind, word in DELETED_LISTS.items():
        yield from split_in_halves(word, [e.name for e in getattr(spec, kind)], make_dropper(kind))
    limited = [j.name for j in spec.joints if has_limits(j)]
    yield from split_in_halves("limit", limited, remove_limits)
    yield from split_in_halves("material", [m.name for m in spec.materials], remove_material)
    meshes = [g.name for g in spec.geoms if g.type == MESH]
    yield from split_in_halves("mesh, as a box", meshes, replace_mesh_by_box)
    bare = [g.name for g in spec.geoms if g.type != MESH and not collides(edited, g)]
    yield from split_in_halves(DRAWN_GEOM, bare, remove_drawn_geom)
    yield from chain_features(
        "segments of rods",
        [
            (f"{k} times fewer", partial(divide_segments, share=k))
            for k in (8, 4, 2)
            if can_divide_segments(edited, k)
        ],
    )


def make_dropper(kind: str) -> Callable[[EditedModel, str], None]:
    """A function that deletes an element of one of the spec's lists."""
    return lambda edited, name: edited.drop(kind, name)


def collides(edited: EditedModel, geom: object) -> bool:
    """Whether a geom can collide with others, by its masks and the model's flag."""
    off = edited.spec.option.disableflags & CONTACT_FLAG
    return not off and bool(geom.contype or geom.conaffinity)  # type: ignore[attr-defined]


def contact_features(edited: EditedModel) -> Iterator[Feature]:
    """All contacts, which a flag disables; in parts the contacts of single geoms."""
    masked = [g.name for g in edited.spec.geoms if collides(edited, g)]
    if masked or (edited.spec.pairs and not edited.spec.option.disableflags & CONTACT_FLAG):
        yield Feature(
            "contact",
            "all",
            partial(switch_off, bit=CONTACT_FLAG),
            tuple(split_in_halves("contact of geom", masked, disable_contacts)),
            '<option><flag contact="disable"/></option>',
        )


def solver_features(edited: EditedModel, monitored: MonitoredRun) -> Iterator[Feature]:
    """Optional work of the solver: noslip iterations, and flags that are not set by default.

    See `loosen_tolerance` and `change_solver` for the other options of the solver.
    """
    if not has_time_steps(monitored.run):
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
            f'{name.removeprefix(ENABLE_PREFIX).lower()}="disable"'
            for name, bit in mujoco.mjtEnableBit.__members__.items()
            if name.startswith(ENABLE_PREFIX) and option.enableflags & int(bit)
        ]
        yield Feature(
            "flag",
            "what is enabled beside the defaults",
            partial(set_option, name="enableflags", value=0),
            edit=f"<option><flag {' '.join(flags)}/></option>",
        )


def subtree_feature(body: mujoco._specs.MjsBody) -> Feature:
    """A body with all its descendants; its parts are the subtrees of its child bodies."""
    name = body.name
    return Feature(
        "body",
        name,
        lambda edited: edited.drop("bodies", name),
        tuple(subtree_feature(child) for child in body.bodies),
    )


def planar_features(edited: EditedModel) -> Iterator[Feature]:
    """Free joints and ball joints, to be replaced by joints in a plane normal to a world axis."""
    for joint in edited.spec.joints:
        if joint.type in (JointType.mjJNT_FREE, JointType.mjJNT_BALL):
            kind = "free joint" if joint.type == JointType.mjJNT_FREE else "ball"
            yield from chain_features(
                f"{kind} in a plane",
                [
                    (
                        f"{joint.name} across {axis}",
                        partial(make_planar, name=joint.name, normal=normal),
                    )
                    for axis, normal in zip("zyx", np.eye(3)[::-1], strict=True)
                ],
            )


def has_limits(joint: mujoco._specs.MjsJoint) -> bool:
    """Whether a joint has active limits."""
    given = bool(np.ptp(joint.range))
    return bool(
        joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE
        or (joint.limited == mujoco.mjtLimited.mjLIMITED_AUTO and given)
    )


def can_divide_segments(edited: EditedModel, share: int) -> bool:
    """Whether the number of segments of all rods can be divided by a factor."""
    return bool(edited.rods) and all(
        rod.segments // share >= 2 and rod.segments % share == 0 for rod in edited.rods
    )


OptionMaker = Callable[[EditedModel, DietScene], list[Feature]]
TRIED_ITERATIONS = (1, 2, 3, 5, 10, 20, 50)  # iterations that are tried
DEFAULT_ITERATIONS = {"iterations": 100, "ls_iterations": 50}  # MuJoCo's defaults
TRIED_TOLERANCES = (1e-8, 1e-10, 1e-12, 1e-15, 1e-20, 1e-24)
"""Tolerances that are tried, if they are larger."""
STEP_FACTORS = (64, 32, 16, 8, 4, 2)  # factors on the time step that are tried
COUNTING_TIMEOUT = 60.0  # s, processor time of a run whose iterations are counted
INTEGRATOR, SOLVER, JACOBIAN = mujoco.mjtIntegrator, mujoco.mjtSolver, mujoco.mjtJacobian
ELLIPTIC, PYRAMIDAL = mujoco.mjtCone.mjCONE_ELLIPTIC, mujoco.mjtCone.mjCONE_PYRAMIDAL
EVALUATIONS_PER_STEP = {INTEGRATOR.mjINT_RK4: 4}
"""Evaluations of the forces per step; 1 for all other integrators."""
CHEAPER_INTEGRATORS = {  # integrators with fewer evaluations, or fewer derivatives to factorize
    INTEGRATOR.mjINT_RK4: (INTEGRATOR.mjINT_EULER, INTEGRATOR.mjINT_IMPLICITFAST),
    INTEGRATOR.mjINT_IMPLICIT: (INTEGRATOR.mjINT_EULER, INTEGRATOR.mjINT_IMPLICITFAST),
}


def stepped_runs(scene: DietScene) -> list[MonitoredRun]:
    """The runs of a scene that have time steps."""
    return [monitored for monitored in scene.monitored_runs if has_time_steps(monitored.run)]


def runs_with_model_option(scene: DietScene, option: str) -> list[MonitoredRun]:
    """The runs with time steps that take an option from the model, and not from the sidecar."""
    return [monitored for monitored in stepped_runs(scene) if option not in monitored.run.settings]


def option_feature(option: str, words: str, value: float, name: str = "") -> Feature:
    """A value of an option as a feature; `name` is the value's name in MJCF, if it has one."""
    edit = f'<option {option}="{name or repr(value)}"/>'
    return Feature(OPTION_KIND, words, partial(set_option, name=option, value=value), edit=edit)


def named_option_feature(option: str, now: SupportsInt, other: SupportsInt) -> Feature:
    """Another value of an option as a feature, if the values have names in MJCF."""
    before, after = format_option(now), format_option(other)
    return option_feature(option, f"{option} {before} to {after}", int(other), after)


def evaluations_per_second(edited: EditedModel) -> float:
    """Evaluations of the forces per second of the motion [1/s]."""
    option = edited.spec.option
    return EVALUATIONS_PER_STEP.get(INTEGRATOR(option.integrator), 1) / float(option.timestep)


def loosen_tolerance(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Larger tolerances of the solver, then fewer iterations than it takes to reach them."""
    monitored_runs, option = runs_with_model_option(scene, "tolerance"), edited.spec.option
    if not monitored_runs:
        return []
    monitored = max(monitored_runs, key=lambda w: w.before.cost)
    used = count_iterations(edited, monitored, option.tolerance)
    found = [
        option_feature("tolerance", f"tolerance {number(option.tolerance)} to {number(t)}", t)
        for t in TRIED_TOLERANCES
        if t > option.tolerance
    ]
    if runs_with_model_option(scene, "iterations"):
        found += [
            option_feature("iterations", f"iterations {option.iterations} to {n}", n)
            for n in TRIED_ITERATIONS
            if n < min(used, option.iterations)
        ]
    return found


def limit_iterations(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """The default limit of iterations, if the model allows more."""
    now, usual = edited.spec.option.iterations, DEFAULT_ITERATIONS["iterations"]
    if now <= usual or not runs_with_model_option(scene, "iterations"):
        return []
    return [option_feature("iterations", f"iterations {now} to {usual}", usual)]


def limit_line_search(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """The default limit of iterations of the line search, if the model allows more."""
    now, usual = edited.spec.option.ls_iterations, DEFAULT_ITERATIONS["ls_iterations"]
    if now <= usual or not stepped_runs(scene):
        return []
    return [option_feature("ls_iterations", f"ls_iterations {now} to {usual}", usual)]


def lengthen_step(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Longer time steps; a step of a run through time is not longer than a sample interval."""
    if not (monitored_runs := runs_with_model_option(scene, "timestep")):
        return []
    now = float(edited.spec.option.timestep)
    runs = [
        monitored.bound.run if monitored.bound else monitored.run for monitored in monitored_runs
    ]
    widths = [float(np.ptp(run.x)) / (run.x.size - 1) for run in runs if run.kind in STEPPED_KINDS]
    values = [times * now for times in STEP_FACTORS]
    if widths:  # empty if all runs are settled sweeps, whose samples have no time between them
        count = whole_steps(min(widths), now)
        values = [
            min(widths) / fewer for times in STEP_FACTORS if (fewer := ceil(count / times)) < count
        ]
    # 12 digits, so that no digits of rounding are written
    values = list(dict.fromkeys(float(f"{step:.12g}") for step in values))
    return [
        option_feature("timestep", f"time step {number(now)} to {number(step)} s", step)
        for step in values
    ]


def change_integrator(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Integrators with less work per step."""
    now = INTEGRATOR(edited.spec.option.integrator)
    return [
        named_option_feature("integrator", now, other)
        for other in CHEAPER_INTEGRATORS.get(now, ())
        if runs_with_model_option(scene, "integrator")
    ]


def change_solver(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """The other solvers, if the solver takes any iterations."""
    monitored_runs, now = runs_with_model_option(scene, "solver"), SOLVER(edited.spec.option.solver)
    if not monitored_runs or not count_iterations(
        edited, monitored_runs[0], edited.spec.option.tolerance
    ):
        return []
    return [
        named_option_feature("solver", now, other)
        for other in (SOLVER.mjSOL_NEWTON, SOLVER.mjSOL_CG, SOLVER.mjSOL_PGS)
        if other != now
    ]


def change_jacobian(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """The other storage of Jacobian and inertia matrix, sparse or dense."""
    now, monitored_runs = JACOBIAN(edited.spec.option.jacobian), stepped_runs(scene)
    if not monitored_runs:
        return []
    sparse = mujoco.mj_isSparse(edited.compiled(monitored_runs[0].run.rods))
    other = JACOBIAN.mjJAC_DENSE if sparse else JACOBIAN.mjJAC_SPARSE
    return [named_option_feature("jacobian", now, other)]


def change_cone(edited: EditedModel, scene: DietScene) -> list[Feature]:
    """Pyramidal friction cones, if the model has elliptic ones."""
    if edited.spec.option.cone != ELLIPTIC or not stepped_runs(scene):
        return []
    return [option_feature("cone", "cone elliptic to pyramidal", int(PYRAMIDAL), "pyramidal")]


def format_option(value: object) -> str:
    """The name of an option's value in MJCF.

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


def count_iterations(edited: EditedModel, monitored: MonitoredRun, tolerance: float) -> int:
    """Most iterations per step that a run takes with a tolerance; their limit if the run fails."""
    model = edited.compiled(monitored.run.rods)
    found = measure(most_iterations, model, monitored.brief, tolerance, timeout=COUNTING_TIMEOUT)
    return int(edited.spec.option.iterations) if isinstance(found, Measurement) else found


COUNTED_OPTIONS: tuple[OptionMaker, ...] = (loosen_tolerance, limit_iterations, limit_line_search)
"""Options that are changed if that is harmless."""
OPTION_ORDERS: tuple[tuple[OptionMaker, ...], ...] = (
    (lengthen_step, change_integrator),
    (change_integrator, lengthen_step),
)
"""Both orders of two options, since the result depends on the order: that with less work is
taken."""
TIMED_OPTIONS: tuple[OptionMaker, ...] = (change_cone, change_solver, change_jacobian)
"""Options that are changed if that is harmless and saves measured time."""
