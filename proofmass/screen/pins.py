"""Pins that lie outside the bodies that they join, and free ends that coincide and are not joined.

A connect takes its anchor in the frame of one body; the other body's anchor follows from the start
pose.  A wrong pose or a wrong frame is no error for MuJoCo: the pin then lies in the air beside a
link, and the mechanism moves as if the link had an arm up to there.  The drawing, which is the
geoms, shows it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, Severity
from proofmass.screen.mobility import CLOSURES, equality_element
from proofmass.screen.pose import RestPose
from proofmass.sim.contents import anchor_bodies

OUTSIDE_SHARE = 0.05
"""Distance of a pin from every geom of a body, as a share of the body's size, that is told."""
EXTENT_SHARE = 1e-4
"""Least such distance, and tolerance of places, as a share of the model's extent."""
COINCIDENT_ENDS_SHARE = 0.02
"""Distance of two free ends that coincide, as a share of the smaller geom."""
APART_SHARE = 1e-3
"""Least distance of the centres of two geoms whose ends coincide, as a share of the extent."""
MAX_BARS = 100
"""Geoms whose ends are compared; of more, the first."""
GEOM = mujoco.mjtGeom
BARS = int(GEOM.mjGEOM_CAPSULE), int(GEOM.mjGEOM_CYLINDER), int(GEOM.mjGEOM_BOX)
SITE = mujoco.mjtObj.mjOBJ_SITE


@dataclass(frozen=True)
class LoopPin:
    """One end of a connect or weld.

    Attributes
    ----------
    equality, body : int
        Their numbers.
    place : ndarray (3,)
        The point that is fixed on the body [m].
    """

    equality: int
    body: int
    place: Array


def find_pins(pose: RestPose) -> list[LoopPin]:
    """The two ends of each active connect and weld."""
    model, data, found = pose.model, pose.data, []
    for e in np.flatnonzero(data.eq_active):
        if int(model.eq_type[e]) not in CLOSURES:
            continue
        one, other, numbers = model.eq_obj1id[e], model.eq_obj2id[e], model.eq_data[e]
        if model.eq_objtype[e] == SITE:
            for s in (one, other):
                found.append(LoopPin(int(e), int(model.site_bodyid[s]), data.site_xpos[s].copy()))
            continue
        weld = model.eq_type[e] == CLOSURES[1]  # its anchor is a point of the second body
        places = (
            (other if weld else one, numbers[:3]),
            (other, numbers[:3] if weld else numbers[3:6]),
        )
        for body, (frame, place) in zip((one, other), places, strict=True):
            turned = data.xmat[frame].reshape(3, 3) @ place
            found.append(LoopPin(int(e), int(body), data.xpos[frame] + turned))
    return found


def judge_pins(pose: RestPose) -> Iterator[ModelFinding]:
    """Pins that lie outside every geom of a body that they join."""
    pins = find_pins(pose)
    found = ((pin, gap_of(pose, pin)) for pin in pins)
    gaps = {(pin.equality, pin.body): gap for pin, gap in found if gap is not None}
    bodies = {e: {pin.body for pin in pins if pin.equality == e} for e, _ in gaps}
    for (e, body), (gap, size) in gaps.items():
        if gap <= max(OUTSIDE_SHARE * size, EXTENT_SHARE * pose.model.stat.extent):
            continue
        # two connects make a hinge; one of them may lie in the air, on its axis
        if any(
            other != e and b == body and bodies[other] == bodies[e] and near <= OUTSIDE_SHARE * size
            for (other, b), (near, _) in gaps.items()
        ):
            continue
        element, on = equality_element(pose.model, e), pose.element("body", body)
        # the author placed both sites himself, and a weld holds the same two bodies anywhere
        meant = pose.model.eq_objtype[e] == SITE or pose.model.eq_type[e] == CLOSURES[1]
        yield ModelFinding(
            FindingKind.PIN,
            Severity.NOTE if meant else Severity.WARNING,
            f"the pin of {element} lies {number(gap)} m outside every geom of {on}, whose size is "
            f"{number(size, 2)} m",
            "" if meant else propose_anchor(pose, e) or f"check its anchor, and the start of {on}",
            element,
            gap,
        )


def propose_anchor(pose: RestPose, equality: int) -> str:
    """The anchor of a connect at which free ends of its two bodies coincide; empty without any."""
    group, bodies = pose.model.body_weldid, anchor_bodies(pose.model, equality)
    for one, other in coincident_ends(pose):
        if {one.body, other.body} != {int(group[body]) for body in bodies}:
            continue
        turn = pose.data.xmat[bodies[0]].reshape(3, 3)
        place = turn.T @ (one.place - pose.data.xpos[bodies[0]])
        tiny = EXTENT_SHARE * pose.model.stat.extent
        written = " ".join(f"{x:.6g}" for x in np.where(np.abs(place) > tiny, place, 0.0))
        ends = f"{pose.element('body', one.body)} and {pose.element('body', other.body)}"
        return f'anchor="{written}", where free ends of {ends} coincide'
    return ""


def gap_of(pose: RestPose, pin: LoopPin) -> tuple[float, float] | None:
    """The distance of a pin from the geoms of its body, and the size of these [m].

    None for the ground, a mocap body, and a body without geoms.  Bodies without joints between them
    count as one.
    """
    model = pose.model
    group = model.body_weldid
    geoms = np.flatnonzero(group[model.geom_bodyid] == group[pin.body])
    if not group[pin.body] or not geoms.size or model.body_mocapid[pin.body] >= 0:
        return None
    distance = min(distance_to_geom(pose, int(g), pin.place) for g in geoms)
    return distance, 2.0 * float(model.geom_rbound[geoms].max())


def distance_to_geom(pose: RestPose, geom: int, place: Array) -> float:
    """The distance of a point from a geom [m], 0 inside; meshes and ellipsoids count as boxes."""
    model, data = pose.model, pose.data
    local = data.geom_xmat[geom].reshape(3, 3).T @ (place - data.geom_xpos[geom])
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == GEOM.mjGEOM_PLANE:
        return max(float(local[2]), 0.0)
    if kind == GEOM.mjGEOM_SPHERE:
        return max(float(np.linalg.norm(local)) - size[0], 0.0)
    if kind == GEOM.mjGEOM_CAPSULE:
        axis = np.array([0.0, 0.0, np.clip(local[2], -size[1], size[1])])
        return max(float(np.linalg.norm(local - axis)) - size[0], 0.0)
    if kind == GEOM.mjGEOM_CYLINDER:
        across, along = np.hypot(local[0], local[1]) - size[0], abs(local[2]) - size[1]
        return float(np.hypot(max(across, 0.0), max(along, 0.0)))
    centre, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
    return float(np.linalg.norm(np.maximum(np.abs(local - centre) - half, 0.0)))


@dataclass(frozen=True)
class FreeEnd:
    """An end of a bar that no joint and no loop holds.

    Attributes
    ----------
    geom, body : int
        The bar, and the first of the bodies that have no joints between them.
    place : ndarray (3,)
        [m]
    """

    geom: int
    body: int
    place: Array


def judge_free_ends(pose: RestPose) -> Iterator[ModelFinding]:
    """Ends of bars of two bodies that coincide, though nothing joins them."""
    group = pose.model.body_weldid
    closed = (anchor_bodies(pose.model, int(pin.equality)) for pin in find_pins(pose))
    told = {frozenset(int(group[body]) for body in pair) for pair in closed}
    for one, other in coincident_ends(pose):
        pair = frozenset((one.body, other.body))
        if pair in told:
            continue
        told.add(pair)
        first, second = (pose.element("body", body) for body in (one.body, other.body))
        yield ModelFinding(
            FindingKind.FREE_ENDS,
            Severity.WARNING,
            f"the free ends of {first} and {second} coincide, and nothing joins them",
            "if they are one pin, add a connect between them",
            second,
        )


def coincident_ends(pose: RestPose) -> Iterator[tuple[FreeEnd, FreeEnd]]:
    """Free ends of two bodies that coincide; not of neighbours and of coupled bodies."""
    model, data = pose.model, pose.data
    group, coupled = model.body_weldid, coupled_bodies(pose)
    for one, other in combinations(free_ends(pose), 2):
        bars = [one.geom, other.geom]
        if (
            one.body != other.body
            and group[model.body_parentid[one.body]] != other.body
            and group[model.body_parentid[other.body]] != one.body
            and not {one.body, other.body} <= coupled
            and np.linalg.norm(one.place - other.place)
            <= COINCIDENT_ENDS_SHARE * model.geom_rbound[bars].min()
            and np.linalg.norm(np.diff(data.geom_xpos[bars], axis=0))
            >= APART_SHARE * model.stat.extent
        ):
            yield one, other


def free_ends(pose: RestPose) -> list[FreeEnd]:
    """The ends of capsules, cylinders and boxes of moving bodies at which no joint or pin lies."""
    model, data = pose.model, pose.data
    group, extent = model.body_weldid, model.stat.extent
    used = np.array([*data.xanchor, *(pin.place for pin in find_pins(pose))]).reshape(-1, 3)
    moving = (group[model.geom_bodyid] > 0) & np.isin(model.geom_type, BARS)
    found = []
    for g in np.flatnonzero(moving)[:MAX_BARS]:
        halves = model.geom_aabb[g][3:]
        long = int(np.argmax(halves))
        half = model.geom_size[g][1] if model.geom_type[g] == BARS[0] else halves[long]
        axis = data.geom_xmat[g].reshape(3, 3)[:, long]
        near = model.geom_size[g][0] / 2.0 + EXTENT_SHARE * extent
        for place in (data.geom_xpos[g] + half * axis, data.geom_xpos[g] - half * axis):
            if np.linalg.norm(used - place, axis=1).min(initial=np.inf) > near:
                found.append(FreeEnd(int(g), int(group[model.geom_bodyid[g]]), place))
    return found


def coupled_bodies(pose: RestPose) -> set[int]:
    """Bodies whose joints an active equality couples, such as the fingers of a gripper."""
    model = pose.model
    on_joints = (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & pose.data.eq_active.astype(bool)
    pairs = np.column_stack([model.eq_obj1id[on_joints], model.eq_obj2id[on_joints]])
    return {int(model.body_weldid[model.jnt_bodyid[j]]) for j in pairs[pairs >= 0]}
