"""Searches for the limits of a case: each varies one parameter to an extreme until a run fails.

The parameters include the number of steps of a free motion, whose energy is checked without a
reference, since the motion may be chaotic; the size of the whole mechanism, with which the curves
must scale; and the stiffness of a spring in the last hinge that is not driven, over 12 decades.

The geometry is brought close to where the loops of a linkage can no longer be closed: a change
point, or a stretched arm.  Links of the last loop are shortened until the mechanism can just make
its whole motion.  At this length some of its bars come into line, and two assembly modes meet::

    1, 2, r, 3, the crank turning    r -> 2         coupler and rocker in line, folded
    1, c, r, 3, the crank turning    c + r -> 4     coupler and rocker in line, stretched
    five-bar                         the last coupler alone, or both, as in a four-bar

If the links are longer than this by a share g, the angle between the two modes is of the order
sqrt(g).  A constraint violation that is a share e of the loop's size rotates the bars by
e / sqrt(g), and leads to the other mode if g is smaller than e.  Other singular poses are limit
positions, at which the motion of a drive ends, and folds, in which a rod snaps to another
equilibrium.

The module `proofmass.studies.stress.limit_search` describes when a run counts as failed.
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from proofmass.analytic.planar import read
from proofmass.analytic.planar.kinematics import Drives, close_loops
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.strict import Kind
from proofmass.case.case import Case, Channel
from proofmass.reference.case_model import compiled_model
from proofmass.sim.dense import mass_matrix
from proofmass.studies import variants
from proofmass.studies.bounded import call_bounded
from proofmass.studies.invariants import conserves_energy, invariants
from proofmass.studies.measure import Measurement, StudyRun, measure, simulate_task, step_taken
from proofmass.studies.record import NAN, ParameterValue, Setting, format_kind
from proofmass.studies.store import (
    KEY_FIELDS,
    bytes_of_case_model,
    digest,
    digest_of_sources,
    task_key,
)
from proofmass.studies.stress import theory
from proofmass.studies.stress.boundary import (
    BoundaryKind,
    Failure,
    TrialResult,
    is_engine_warning,
)
from proofmass.studies.stress.limit_search import (
    LARGE_ERROR,
    MAX_SEARCH_STEPS,
    SEARCH_RUN_TIMEOUT,
    LimitSearch,
    NotApplicable,
    StressedCase,
    bisect,
    find_failure,
    kind_of_limit,
    measure_untimed,
    reference_follows_masses,
    require,
)
from proofmass.studies.stress.stable_steps import search_stable_step, with_stable_step
from proofmass.studies.study import Study
from proofmass.studies.variants import (
    evaluate_reference,
    has_hinged_leader,
    has_independent_motion,
    multiply_attribute,
    with_drive_distance,
    with_drive_swing,
    with_longer_run,
    with_model,
    with_planar_reference,
    with_whole_steps,
)
from proofmass.verdict.outcome import Outcome

MAX_ENERGY_SAMPLES = 2000  # samples of a run whose energy is checked, at most
MAX_ENERGY_ERROR = 0.01
"""Largest change of the energy, over the largest kinetic energy, with which a run does not fail."""
ENERGY_PARAMETER = "steps until the energy is off by 1 %"
ENERGY_SENSORS = {"e_kinetic": "kinetic", "e_potential": "potential"}
"""MJCF elements of the sensors of both energies, and the energy that each of them measures."""


def search_energy_error(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the number of steps of a free motion until the energy error exceeds a hundredth."""
    why = "energy: the motion is driven, loaded or damped, or the run has no time steps"
    require(stressed.kind == "dynamics" and not stressed.case.drive, why)
    with_sensors = with_energy_sensors(stressed.case, stressed.models)
    require(call_bounded(with_sensors, stressed.kind, conserves_energy, with_sensors), why)
    yield from stressed.search_schemes(
        ENERGY_PARAMETER,
        "1",
        stressed.seconds / stressed.step,
        MAX_SEARCH_STEPS,
        partial(try_step_count, stressed, with_sensors),
        [one for one in stressed.engine.theory.schemes if one.conserves],
    )


def with_energy_sensors(case: Case, folder: Path) -> Case:
    """The case with sensors of both energies as its only sensors, and without unused actuators.

    Actuators are unused if all controls of the keys are zero.
    """
    idle = not compiled_model(case).key_ctrl.any()

    def change(root: Element) -> None:
        for old in [one for one in root if one.tag == "sensor" or (one.tag == "actuator" and idle)]:
            root.remove(old)
        for key in root.iter("key") if idle else ():
            key.attrib.pop("ctrl", None)
        sensors = ElementTree.SubElement(root, "sensor")
        for tag, name in ENERGY_SENSORS.items():
            ElementTree.SubElement(sensors, tag, name=f"whole_{name}")

    changed = with_model(case, folder, change)
    return changed.model_copy(
        update={
            "channels": {
                f"whole_{name}": Channel(equals=0.0, unit="J") for name in ENERGY_SENSORS.values()
            }
        }
    )


def try_step_count(
    stressed: StressedCase, case: Case, parameters: dict[str, ParameterValue], steps: float
) -> TrialResult:
    """Run a number of steps, and compare the energy error with `MAX_ENERGY_ERROR`."""
    steps_per_sample = int(np.ceil(steps / MAX_ENERGY_SAMPLES))
    count = round(steps / steps_per_sample)
    own = case.with_run("dynamics", n=count + 1, until=count * steps_per_sample * stressed.step)
    task = StudyRun(
        own, "dynamics", stressed.setting.with_parameters(**parameters), "stress", timed=False
    )
    found = stressed.study.measure_one(
        replace(task, key=f"{task_key(task)}-energy"), measure_energy
    )
    if found.outcome != Outcome.RAN:
        limit = kind_of_limit(found)
        return TrialResult(
            Failure(
                f"{found.outcome}: {found.message}",
                limit,
                limit != BoundaryKind.OURS and not is_engine_warning(found.message),
            )
        )
    error = found.invariants.get("energy", 0.0)
    failed = Failure(f"energy off by {error:.2g}", BoundaryKind.INACCURATE, silent=True)
    return TrialResult(None if error <= MAX_ENERGY_ERROR else failed, found.step)


def measure_energy(task: StudyRun, timeout: float) -> Measurement:
    """Run a task in a worker process, and measure its energy alone."""
    return measure(simulate_energy, task, timeout=timeout)


def simulate_energy(task: StudyRun) -> Measurement:
    """Run a task in this process, and measure its energy alone."""
    curves = simulate_task(task)
    return Measurement(
        invariants=invariants(task.case, curves),
        seconds=curves.seconds,
        steps=curves.steps,
        step=step_taken(task.run, curves),
    )


CHAOS_ROUNDING = 1e-9  # share of a curve's range by which rounding may change it, at most, in chaos
MUJOCO_ZERO_LENGTH = 1e-6
"""Distance below which MuJoCo takes a distance as zero [m]: `kFrameEps` of src/user/user_model.cc.
"""


def search_size(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Scale all lengths up and down; the theory is the smallest size that MuJoCo compiles."""
    model = compiled_model(stressed.case)
    driven = [int(model.joint(drive.joint).type[0]) for drive in stressed.case.drive]
    require(
        not (stressed.case.rod or mujoco.mjtJoint.mjJNT_SLIDE in driven or stressed.case.recorded),
        "size: the reference has its own lengths",
    )
    require(
        len(variants.inertial_elements(stressed.case)) >= int((model.body_jntnum > 0).sum()),
        "size: bodies have their masses from geoms",
    )
    weighs = bool(model.opt.gravity.any()) if stressed.kind != "dynamics" else not driven
    smallest_size = smallest_compiled_size(model, weighs)
    limit = smallest_size if smallest_size > 1e-6 else 0.0
    if limit and not stressed.engine.native:  # the limit is MuJoCo's, not that of another engine
        limit = NAN
    for word, reach, expected in (("larger", 1e6, np.inf), ("smaller", 1e-6, limit)):
        yield stressed.search(
            f"all lengths {word}",
            "times",
            1.0,
            reach,
            partial(try_size, stressed, smallest_size),
            theory=expected,
            law="dimensional analysis, of what MuJoCo compiles",
        )


def try_size(stressed: StressedCase, smallest_size: float, factor: float) -> TrialResult:
    """Run at another size; below the size that MuJoCo compiles, only its own engine is run.

    MuJoCo reads the model for the other engines, which have no limit of their own there.
    """
    if factor < smallest_size and not stressed.engine.native:
        return TrialResult(
            Failure(
                f"MuJoCo, which reads the model for {stressed.setting.engine}, compiles "
                f"the same mechanism down to {smallest_size:.3g} times its size",
                BoundaryKind.OURS,
            )
        )
    found = stressed.run(variants.with_scaled_lengths(stressed.case, stressed.models, factor))
    return TrialResult(
        find_size_failure(found, stressed.run(stressed.case), stressed.kind), found.step
    )


def find_size_failure(measurement: Measurement, unscaled: Measurement, run: Kind) -> Failure | None:
    """The failure of a run of a scaled mechanism, judged by the run at its own size; None if none.

    By dimensional analysis the errors, as shares of ranges, do not depend on the size.  An error
    ten times as large shows another curve; smaller differences are rounding.
    """
    if failure := find_failure(measurement, run):
        return failure
    for kind, error in measurement.errors.items():
        if error > 10.0 * unscaled.errors[kind] + CHAOS_ROUNDING:
            return Failure(
                f"{format_kind(kind)} off by {error:.2g} of its range, "
                f"{unscaled.errors[kind]:.2g} at its size",
                BoundaryKind.INACCURATE,
                silent=True,
            )
    return None


def smallest_compiled_size(model: mujoco.MjModel, weighs: bool) -> float:
    """The smallest factor s on all lengths with which MuJoCo compiles the same mechanism.

    MuJoCo refuses inertias, which are scaled by s^2, up to mjMINVAL.  It moves points that are less
    than 1e-6 m from the origin of their body along each axis to that origin: sites, and centres of
    mass, which matter only if bodies weigh anything.
    """
    without_rotation = int(
        mujoco.mjtSameFrame.mjSAMEFRAME_BODYROT
    )  # axes parallel to those of the body
    site_positions = model.site_pos[model.site_sameframe == without_rotation]
    centres = model.body_ipos[(model.body_sameframe == without_rotation) & weighs]
    inertia = model.body_inertia[model.body_mass > 0]
    return float(
        np.concatenate(
            [
                MUJOCO_ZERO_LENGTH / np.abs(site_positions).max(axis=1),
                MUJOCO_ZERO_LENGTH / np.abs(centres).max(axis=1),
                np.sqrt(mujoco.mjMINVAL / inertia).max(axis=1),
            ]
        ).max()
    )


STIFFNESS_RATIO = 1e12  # ratio of the stiffest spring to the softest
FREE_MOTION_STEPS = 100
"""Steps of a free motion, since the reference has to follow each swing of the spring."""


def search_stiffness(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Stiffen a spring in the last hinge, starting with one that swings once during the run."""
    require(
        stressed.kind == "dynamics"
        and has_independent_motion(stressed.case)
        and not stressed.case.rod,
        "stiffness in motion: no time steps, a recorded curve, a motion profile, or rods",
    )
    free = not stressed.case.drive
    require(
        free or reference_follows_masses(stressed.case),
        "stiffness in motion: the spring moves the mechanism, and the reference has no spring",
    )
    joint, inertia = last_hinge(stressed.case)
    seconds = min(stressed.seconds, FREE_MOTION_STEPS * stressed.step) if free else stressed.seconds
    case = (
        with_short_run(with_planar_reference(stressed.case), seconds, stressed.step)
        if free
        else stressed.case
    )
    softest = inertia * (2.0 * np.pi / seconds) ** 2
    limit = NAN
    own_theory = stressed.engine.theory
    scheme = own_theory.scheme_of(stressed.setting.parameters, compiled_model(stressed.case))
    if free and compiled_model(case).nv == 1 and scheme:
        z = theory.largest_accurate_z(scheme, seconds / stressed.step)
        limit = inertia * (z / stressed.step) ** 2
    yield stressed.search(
        f"spring in {joint}",
        "N m/rad",
        softest,
        STIFFNESS_RATIO * softest,
        lambda stiffness: stressed.try_case(with_spring(case, stressed.models, joint, stiffness)),
        theory=limit,
        law="" if limit != limit else "powers of the step's matrix",
    )


def last_hinge(case: Case) -> tuple[str, float]:
    """The last hinge that is not driven, and the inertia about it in the start pose [kg m^2]."""
    model, driven = compiled_model(case), [drive.joint for drive in case.drive]
    hinges = [
        j
        for j in range(model.njnt)
        if model.joint(j).name not in driven and model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
    ]
    require(hinges, "stiffness in motion: there is no hinge that is not driven")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(case.start).id)
    mujoco.mj_forward(model, data)
    inertia = mass_matrix(model, data)
    return str(model.joint(hinges[-1]).name), float(inertia[hinges[-1], hinges[-1]])


def with_short_run(case: Case, seconds: float, step: float) -> Case:
    """The case with a dynamics run of a shorter duration, which is sampled after every step."""
    return with_whole_steps(case.with_run("dynamics", n=round(seconds / step) + 1), seconds, step)


def with_spring(case: Case, folder: Path, joint: str, stiffness: float) -> Case:
    """The case with a spring in a joint, which replaces the joint's own stiffness [N m/rad]."""

    def change(root: Element) -> None:
        hinge = next(one for one in root.iter("joint") if one.get("name") == joint)
        hinge.set("stiffness", repr(stiffness))

    return with_model(case, folder, change)


MAX_SEGMENTS, MAX_SEGMENTS_TIMEOUT = (200, 600.0)
"""Most segments of a rod, and processor time for so many [s]."""
MIN_STEPS = 4
"""Steps of the shortest runs: a motion there and back in two steps would look like none."""


def list_extremes(case: Case, study: Study) -> tuple[list[LimitSearch], list[str]]:
    """All searches that apply to a case, and the reasons why others do not apply.

    A run is given up after `SEARCH_RUN_TIMEOUT` if the study does not say when.
    """
    found: list[LimitSearch] = []
    skipped: list[str] = []
    study = study.inside_worker(SEARCH_RUN_TIMEOUT)
    kind: Kind = next(k for k in ("dynamics", "sweep", "equilibrium") if k in case.run)  # type: ignore
    first = dict[str, str]()
    for solver in case.run[kind].solvers:
        first.setdefault(solver.partition(":")[0], solver)
    for engine, solver in first.items():
        parameters = {k: v for k, v in case.settings.get(solver, {}).items() if k != "defaults"}
        stressed = StressedCase(case, kind, Setting(engine, parameters), study)
        steady = with_stable_step(stressed)
        for search in SEARCHES:
            try:
                found += search(stressed if search in STEP_SEARCHES else steady)
            except NotApplicable as why:
                skipped.append(str(why))
    return found, list(dict.fromkeys(skipped))


def search_time_step(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the time step, with every integrator; where it fails already, start below it."""
    require(stressed.kind == "dynamics", "time step: the run has no time steps")
    require(not stressed.case.recorded, "time step: a recorded curve has its own samples")
    searches = stressed.search_schemes(
        "time step",
        "s",
        stressed.step,
        stressed.seconds / MIN_STEPS,
        partial(try_time_step, stressed),
        stressed.engine.theory.schemes,
    )
    for one in searches:
        yield replace(one, least=stressed.seconds / MAX_SEARCH_STEPS)


def try_time_step(
    stressed: StressedCase, parameters: dict[str, ParameterValue], step: float
) -> TrialResult:
    """Run with a time step [s] and the settings of a scheme."""
    return stressed.try_in_steps(stressed.case, stressed.seconds, timestep=step, **parameters)


def search_drive_speed(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the speed of the drives, until the run has only `MIN_STEPS` steps."""
    require(
        stressed.kind == "dynamics" and stressed.case.drive,
        "drive speed: there is no drive, or the run has no time steps",
    )
    require(
        all(drive.to is not None for drive in stressed.case.drive) and not stressed.case.recorded,
        "drive speed: it is that of a motion profile or of a recorded curve",
    )
    yield stressed.search(
        "drive speed",
        "times",
        1.0,
        stressed.seconds / (MIN_STEPS * stressed.step),
        partial(try_drive_speed, stressed),
    )


def try_drive_speed(stressed: StressedCase, factor: float) -> TrialResult:
    """Run with all drives faster by a factor, for a duration shorter by the same factor.

    The first drive has the factor, and the others move in proportion to its progress.
    """
    case, leader = stressed.case, stressed.case.drive[0]
    faster = (
        {"period": leader.period / factor} if leader.period else {"rate": leader.speed * factor}
    )
    case = case.model_copy(update={"drive": (leader.model_copy(update=faster), *case.drive[1:])})
    until = case.run["dynamics"].until
    case = case.with_run("dynamics", until=until and until / factor)
    return stressed.try_in_steps(case, stressed.seconds / factor)


def search_gravity(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase gravity."""
    model = compiled_model(stressed.case)
    require(model.opt.gravity.any(), "gravity: there is none")
    require(
        reference_follows_masses(stressed.case) or "gravity" in stressed.case.parameters,
        "gravity: the reference has its own value",
    )
    yield stressed.search(
        "gravity",
        "times",
        1.0,
        1e6,
        lambda factor: stressed.try_case(
            variants.with_scaled_gravity(stressed.case, stressed.models, factor)
        ),
    )


def search_mass_ratio(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase and decrease the mass of the last body."""
    bodies = len(variants.inertial_elements(stressed.case))
    require(bodies > 1, "mass ratio: there is one body, or bodies have their masses from geoms")
    require(
        stressed.kind == "dynamics" and reference_follows_masses(stressed.case),
        "mass ratio: there is no inertia in statics, or the reference has its own masses",
    )
    for word, reach in (("heavier", 1e6), ("lighter", 1e-6)):
        yield stressed.search(
            f"last body {word}",
            "times",
            1.0,
            reach,
            lambda factor: stressed.try_case(
                variants.with_scaled_last_mass(stressed.case, stressed.models, factor)
            ),
        )


def search_spring_strength(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase and decrease the strength of all springs, rods and loads together."""
    model = compiled_model(stressed.case)
    require(model.jnt_stiffness.any(), "stiffness: there are no springs and no rods")
    require(
        stressed.kind != "dynamics" and not model.opt.gravity.any(),
        "stiffness: with gravity or inertia the reference would be another motion",
    )
    for word, reach in (("stronger", 1e6), ("weaker", 1e-6)):
        yield stressed.search(
            f"springs and loads {word}",
            "times",
            1.0,
            reach,
            lambda factor: stressed.try_case(
                variants.with_scaled_stiffness(stressed.case, stressed.models, factor)
            ),
        )


def search_segments(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the number of segments of the rods."""
    require(stressed.case.rod, "segments: there is no rod")
    fewest = min(rod.segments for rod in stressed.case.rods)
    slow = stressed.with_longest(MAX_SEGMENTS_TIMEOUT)
    yield stressed.search(
        "segments of each rod",
        "1",
        fewest,
        MAX_SEGMENTS,
        lambda n: slow.try_case(stressed.case, segments=round(n)),
    )


def search_run_length(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Continue the same motion, up to a million steps."""
    case = stressed.case
    require(
        stressed.kind == "dynamics" and not case.recorded,
        "long run: the run has no time steps, or a recorded curve ends",
    )
    require(
        not case.drive or case.drive[0].to is not None, "long run: the drive's motion profile ends"
    )
    require(not any(load.profile for load in case.load), "long run: the rows of a load end")
    own = stressed.seconds / stressed.step
    yield stressed.search(
        "steps",
        "1",
        own,
        MAX_SEARCH_STEPS,
        lambda count: stressed.try_in_steps(
            with_longer_run(case, count / own, stressed.seconds), count * stressed.step
        ),
    )


START_LENGTHS, END_LENGTH = ((1.1, 1.0), 0.2)
"""Links are shortened from one of these factors to this one."""
LENGTH_STEP = 0.02
"""Change of length from one closed start pose to the next, which keeps the branch."""
LENGTH_TOLERANCE = 1e-9  # relative tolerance of the shortest length


SiteNames = tuple[str, ...]
"""Names of the sites at the ends of links."""


def loop_ends(case: Case) -> Iterator[SiteNames]:
    """The sites that each loop constraint joins at the ends of moving links, the last loop first.

    Sites on the ground, and at the origin of their body, are left out.
    """
    model = compiled_model(case)
    for e in reversed(range(model.neq)):
        if int(model.eq_objtype[e]) == mujoco.mjtObj.mjOBJ_SITE:
            pair = int(model.eq_obj2id[e]), int(model.eq_obj1id[e])
            yield tuple(
                str(model.site(site).name)
                for site in pair
                if model.site_bodyid[site] and model.site_pos[site].any()
            )


def last_link(case: Case) -> SiteNames:
    """The site at the end of the last link in a loop; empty if no link is in a loop."""
    return next((links[:1] for links in loop_ends(case) if links), ())


def last_arm(case: Case) -> SiteNames:
    """The sites at the ends of both links of the last loop.

    Empty if a drive or another loop acts on one of the two bodies, or there is no such loop.
    """
    model, (last, *others) = compiled_model(case), [*loop_ends(case)] or [()]
    bodies = [int(model.site(link).bodyid[0]) for link in last]
    constrained = {int(model.site(link).bodyid[0]) for links in others for link in links}
    driven = {int(model.joint(drive.joint).bodyid[0]) for drive in case.drive}
    return last if len(bodies) == 2 and not {*bodies} & (constrained | driven) else ()


def with_scaled_links(case: Case, links: SiteNames, folder: Path, factor: float) -> Case:
    """The case with the lengths of links multiplied by a factor, and its start pose closed."""
    pose = close_start_pose(case, links, factor)

    def change(root: Element) -> None:
        for site in root.iter("site"):
            if site.get("name") in links:
                multiply_attribute(site, "pos", factor)
        key = next(key for key in root.iter("key") if key.get("name") == case.start)
        key.set("qpos", " ".join(map(repr, pose.tolist())))

    return with_model(case, folder, change)


def close_start_pose(case: Case, links: SiteNames, factor: float) -> Array:
    """Joint values of the start pose with the lengths of links multiplied by a factor.

    Raises
    ------
    InputError
        The loops cannot be closed with these lengths.
    """
    model = copy(compiled_model(case))
    sites = [model.site(link).id for link in links]
    lengths, joints = model.site_pos[sites].copy(), tuple(d.joint for d in case.drive)
    pose = read(model, case.start)[0].start
    for share in np.linspace(1.0, factor, int(abs(factor - 1.0) / LENGTH_STEP) + 2).tolist():
        model.site_pos[sites] = share * lengths
        mechanism, _ = read(model, case.start)
        try:
            pose = close_loops(mechanism, pose[None], Drives.of(mechanism, joints))[0]
        except ValueError as error:
            raise InputError(case.model_path, "", str(error)) from None
    return pose


def find_shortest_length(case: Case, links: SiteNames, kind: Kind, folder: Path) -> float:
    """Shortest length of links, over their own, with which the mechanism makes its whole motion.

    NaN if the reference does not have all poses with the longest links, or if it has all of them
    with the shortest links as well.
    """
    for longest in START_LENGTHS:
        holds, breaks, _ = bisect(
            partial(find_closing_failure, case, links, kind, folder),
            longest,
            END_LENGTH,
            LENGTH_TOLERANCE,
        )
        if holds == holds:
            return float(np.sqrt(holds * breaks))
    return float("nan")


def stored_shortest_length(case: Case, links: SiteNames, kind: Kind, study: Study) -> float:
    """The length of `find_shortest_length`, computed once for all engines and kept in the store.

    Its search is slow, since the reference takes short steps near singular poses.
    """
    name = repr((case.model_dump_json(include=KEY_FIELDS), links, kind, digest_of_sources()))
    return float(
        study.store.value(
            f"{digest(name.encode() + bytes_of_case_model(case))}.least.json",
            lambda: find_shortest_length(case, links, kind, study.models),
        )
    )


def find_closing_failure(
    case: Case, links: SiteNames, kind: Kind, folder: Path, factor: float
) -> Failure | None:
    """A failure if the mechanism cannot make its whole motion with links longer by a factor."""
    try:
        evaluate_reference(with_scaled_links(case, links, folder, factor), kind)
    except InputError as error:
        return Failure(error.wrong, BoundaryKind.UNSTABLE)
    return None


MAX_CRANK_TURNS = 2.0  # a crank is driven so far in search of its limit position
NEAREST_TURNING_POINT, LIMIT_TOLERANCE = (1e-9, 1e-12)
"""Nearest turning point to a limit [rad]; its tolerance [1]."""
FIRST_SPARE_LENGTH, LAST_SPARE_LENGTH = (0.05, 1e-7)
"""First and last excess length of a link, over the shortest that closes."""
SNAP_SEGMENTS = 10, 20, 40  # numbers of segments with which a rod is made to snap
SWEEP_SAMPLES = 41  # of a sweep there and back; an odd number has one sample at the turning point


def search_limit_position(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the distance of the drive until a limit position, in a sweep.

    In dynamics the drive then turns back closer and closer to that limit position.
    """
    case = stressed.case
    require(
        "sweep" in case.run
        and case.leader
        and case.leader.to is not None
        and len(case.drive) == 1
        and reference_follows_masses(case)
        and has_hinged_leader(case),
        "limit position: there is no single crank to drive further",
    )
    own_distance = abs(case.drive[0].way)
    swept = replace(stressed, kind="sweep", setting=Setting(stressed.setting.engine))
    reach = max(MAX_CRANK_TURNS * 2 * np.pi, 2 * own_distance)
    limit = boundary_value(
        *bisect(partial(find_reach_failure, case), own_distance, reach, LIMIT_TOLERANCE)[:2]
    )
    yield swept.search(
        "drive's way",
        "rad",
        own_distance,
        reach,
        lambda far: swept.try_case(with_drive_distance(case, far)),
        "sweep",
        theory=limit,
        law="where the reference has no pose any more",
    )
    if np.isfinite(limit) and stressed.kind == "dynamics":
        yield stressed.search(
            "drive turns back before its limit",
            "rad",
            limit - own_distance,
            NEAREST_TURNING_POINT,
            lambda distance: stressed.try_case(
                with_drive_swing(case, limit - distance, stressed.seconds)
            ),
        )


def boundary_value(holds: float, breaks: float) -> float:
    """The geometric mean of both sides of a boundary; infinite if there is no boundary."""
    return float(np.sqrt(holds * breaks)) if np.isfinite(breaks) else np.inf


def find_reach_failure(case: Case, distance: float) -> Failure | None:
    """A failure if the reference has no pose somewhere on the drive's way to a distance."""
    try:
        evaluate_reference(with_drive_distance(case, distance), "sweep")
    except InputError as error:
        return Failure(str(error), BoundaryKind.UNSTABLE)
    return None


def search_bars_in_line(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Shorten the last link until the engine leaves the assembly mode where bars are in line."""
    yield from search_spare_length(
        stressed,
        "bars in line",
        "length to spare where bars come in line",
        last_link(stressed.case),
    )


def search_stretched_arm(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Shorten both links of the last loop until they are stretched."""
    yield from search_spare_length(
        stressed,
        "stretched arm",
        "length to spare where an arm is stretched",
        last_arm(stressed.case),
    )


def search_spare_length(
    stressed: StressedCase, pose: str, parameter: str, links: SiteNames
) -> Iterator[LimitSearch]:
    """Shorten links towards the shortest length that closes, in a sweep and in dynamics."""
    require(
        stressed.case.drive
        and has_independent_motion(stressed.case)
        and reference_follows_masses(stressed.case)
        and links,
        f"{pose}: no such links in a driven loop",
    )
    case = with_planar_reference(stressed.case)
    kind_of_run: Kind = "dynamics" if "dynamics" in case.run else "sweep"
    length = stored_shortest_length(case, links, kind_of_run, stressed.study)
    require(np.isfinite(length), f"{pose}: no length of {' and '.join(links)} brings them there")
    for kind in (kind for kind in ("dynamics", "sweep") if kind in case.run):
        own = replace(stressed, case=case, kind=kind)
        yield own.search(
            parameter,
            "share",
            FIRST_SPARE_LENGTH,
            LAST_SPARE_LENGTH,
            partial(try_spare_length, own, links, length),
            own.integrator if kind == "dynamics" else kind,
        )


def try_spare_length(
    stressed: StressedCase, links: SiteNames, length: float, share: float
) -> TrialResult:
    """Run with links longer by a share than the shortest length that closes.

    The reference has all poses.  A sweep that stops before one of them has only not found it, so
    the limit is that of proofmass and not of the engine.
    """
    found = stressed.try_case(
        with_scaled_links(stressed.case, links, stressed.models, length * (1.0 + share))
    )
    if found.failure and found.failure.message.startswith("stopped"):
        return found._replace(failure=found.failure._replace(limit=BoundaryKind.OURS))
    return found


def search_rod_snap(stressed: StressedCase) -> Iterator[LimitSearch]:
    """Increase the distance of the drive until a rod does not return along its path."""
    case = stressed.case
    require(
        case.rod and "sweep" in case.run and len(case.drive) == 1 and has_independent_motion(case),
        "fold: no rod that a single drive bends",
    )
    own_distance = abs(case.drive[0].way)
    fold = boundary_value(
        *bisect(
            partial(find_return_failure, case), own_distance / 16, own_distance, LIMIT_TOLERANCE
        )[:2]
    )
    unit = "rad" if has_hinged_leader(case) else "m"
    # without `settled` the equilibrium is followed, and the sweep ends at its fold
    parameters = {k: v for k, v in stressed.setting.parameters.items() if k != "settled"}
    for pieces in SNAP_SEGMENTS:
        own = replace(
            stressed,
            kind="sweep",
            setting=Setting(stressed.setting.engine, {**parameters, "segments": pieces}),
        ).with_longest(max(stressed.study.longest or 0.0, case.run["sweep"].timeout))
        yield own.search(
            "drive's way until a rod snaps",
            unit,
            own_distance / 16,
            own_distance,
            partial(try_snap, own),
            f"{pieces} segments",
            theory=fold,
            law="where the reference's rod does not come back the way it went",
        )


def with_return_sweep(case: Case, distance: float) -> Case:
    """The case with a sweep to a distance and back, sampled at the same drive values both ways."""
    swung = with_drive_swing(case, distance, 1.0)
    return swung.with_run("sweep", n=SWEEP_SAMPLES, until=None)


def try_snap(stressed: StressedCase, distance: float) -> TrialResult:
    """Fail if the engine's rod does not return along its path; the error of the run is not used."""
    task = StudyRun(
        with_return_sweep(stressed.case, distance), "sweep", stressed.setting, "stress", timed=False
    )
    found = stressed.study.measure_one(task, measure_untimed)
    if found.outcome != Outcome.RAN:
        return TrialResult(find_failure(found, "sweep"))
    curves = stressed.study.store.curves(task_key(task))
    return TrialResult(
        find_return_difference(
            {name: curves[f"channel.{name}"] for name in position_channels(stressed.case)}
        )
    )


def find_return_failure(case: Case, distance: float) -> Failure | None:
    """A failure if the reference's rod does not return along its path."""
    wanted = evaluate_reference(with_return_sweep(case, distance), "sweep").channels
    return find_return_difference({name: wanted[name] for name in position_channels(case)})


def position_channels(case: Case) -> list[str]:
    """The channels of a sweep that are positions."""
    return [name for name, one in case.channels_of("sweep").items() if one.si_unit in ("m", "rad")]


def find_return_difference(curves: dict[str, Array]) -> Failure | None:
    """A failure if a curve of a sweep there and back differs on the way back."""
    for name, values in curves.items():
        difference = float(np.abs(values - values[::-1]).max())
        if difference > LARGE_ERROR * np.ptp(values):
            return Failure(
                f"{name} comes back {difference:.2g} away from where it went",
                BoundaryKind.UNSTABLE,
                silent=True,
            )
    return None


STEP_SEARCHES = search_time_step, search_stable_step
"""The searches that begin at the time step of the case, whether or not that is stable."""
SEARCHES: tuple[Callable[[StressedCase], Iterator[LimitSearch]], ...] = (
    search_time_step,
    search_stable_step,
    search_drive_speed,
    search_gravity,
    search_mass_ratio,
    search_spring_strength,
    search_stiffness,
    search_size,
    search_segments,
    search_limit_position,
    search_bars_in_line,
    search_stretched_arm,
    search_rod_snap,
    search_run_length,
    search_energy_error,
)
