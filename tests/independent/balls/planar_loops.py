"""The loops of any planar linkage from the numbers of its compiled MJCF, as series of balls.

Covered are hinges about z, slides, `connect` between sites, and the sensors of the cases.  The
numbers of the compiled model count as exact.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from flint import acb, acb_series, arb

from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from tests.independent.balls.linkages import Variables
from tests.independent.balls.loops import CaseNumbers, Inertia, Loops, NotProven, squared, turn

SENSOR, OBJECT, EQUALITY = mujoco.mjtSensor, mujoco.mjtObj, mujoco.mjtEq
POINT_SENSORS = SENSOR.mjSENS_FRAMEPOS, SENSOR.mjSENS_FRAMELINVEL, SENSOR.mjSENS_FRAMELINACC
ANGLE_SENSORS = SENSOR.mjSENS_FRAMEXAXIS, SENSOR.mjSENS_FRAMEANGVEL, SENSOR.mjSENS_FRAMEANGACC
JOINT_SENSORS = SENSOR.mjSENS_JOINTPOS, SENSOR.mjSENS_JOINTVEL, SENSOR.mjSENS_USER


def vector(numbers: np.ndarray) -> acb:
    """The x and y of a vector of the model."""
    return acb(float(numbers[0]), float(numbers[1]))


@dataclass(frozen=True)
class PlanarLoops:
    """The loops of a compiled model; calling it is a `Form`.

    `driven` and `free` are the numbers of the driven joints and of the others, whose values are the
    unknowns.
    """

    model: mujoco.MjModel
    driven: tuple[int, ...]
    free: tuple[int, ...]

    def __call__(self, p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
        """The loops at drives u and other joints q."""
        m = self.model
        values = dict(zip(self.driven, u, strict=True)) | dict(zip(self.free, q, strict=True))
        frames = self.frames(values, 0 * u[0])
        sites = [
            frames[body][0] + frames[body][1] * vector(at)
            for body, at in zip(m.site_bodyid, m.site_pos, strict=True)
        ]
        connects = [k for k in range(m.neq) if m.eq_type[k] == EQUALITY.mjEQ_CONNECT]
        gears = [k for k in range(m.neq) if m.eq_type[k] == EQUALITY.mjEQ_JOINT]
        found = Loops([sites[m.eq_obj1id[k]] - sites[m.eq_obj2id[k]] for k in connects])
        found.scalars = [self.gear(k, values) for k in gears]
        if not whole:
            return found
        for body in range(1, m.nbody):
            place, unit, angle = frames[body]
            centre = place + unit * vector(m.body_ipos[body])
            inertia = arb(float(m.body_inertia[body][2]))
            mass = arb(float(m.body_mass[body]))
            found.masses.append(Inertia(m.body(body).name, mass, centre, inertia, angle))
        self.add_sensors(found, values, frames, sites)
        return found

    def gear(self, k: int, values: dict[int, acb_series]) -> acb_series:
        """The error of the gear between the joints of the equality number k."""
        m = self.model
        one, two = (
            values[joint] - acb(float(m.qpos0[m.jnt_qposadr[joint]]))
            for joint in (m.eq_obj1id[k], m.eq_obj2id[k])
        )
        shift, ratio = (acb(float(number)) for number in m.eq_data[k][:2])
        return one - shift - ratio * two

    def frames(
        self, values: dict[int, acb_series], zero: acb_series
    ) -> list[tuple[acb_series, acb_series, acb_series]]:
        """Place, unit vector along x and angle of each body."""
        m, found = self.model, [(zero, zero + 1, zero)]
        for body in range(1, m.nbody):
            place, unit, angle = found[m.body_parentid[body]]
            place += unit * vector(m.body_pos[body])
            half = acb(float(m.body_quat[body][0]), float(m.body_quat[body][3]))
            unit = unit * (half * half / acb(squared(half)))  # its length is 1 but for rounding
            first = m.body_jntadr[body]
            for joint in range(first, first + m.body_jntnum[body]):
                moved = values[joint] - acb(float(m.qpos0[m.jnt_qposadr[joint]]))
                if m.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
                    place += unit * vector(m.jnt_axis[joint]) * moved
                    continue
                moved, at = moved * acb(round(m.jnt_axis[joint][2])), vector(m.jnt_pos[joint])
                place += unit * at
                unit, angle = unit * turn(moved), angle + moved
                place -= unit * at
            found.append((place, unit, angle))
        return found

    def add_sensors(
        self,
        found: Loops,
        values: dict[int, acb_series],
        frames: list[tuple[acb_series, acb_series, acb_series]],
        sites: list[acb_series],
    ) -> None:
        """Add the curves that the sensors of the model record."""
        m = self.model
        for k in range(m.nsensor):
            kind, at, label = int(m.sensor_type[k]), int(m.sensor_objid[k]), m.sensor(k).name
            of_site, of_joint = (m.sensor_objtype[k] == one for one in OBJECT_TYPES)
            if kind in POINT_SENSORS:
                point = sites[at] if of_site else frames[at][0]
                found.channels[f"{label}.x"] = point, POINT_SENSORS.index(kind), "real"
                found.channels[f"{label}.y"] = point, POINT_SENSORS.index(kind), "imag"
            elif kind in ANGLE_SENSORS and not of_site:
                order = ANGLE_SENSORS.index(kind)
                name = label + (".z" if order else ".angle")
                found.channels[name] = frames[at][2], order, "real"
            elif kind in JOINT_SENSORS and of_joint:
                found.channels[label] = values[at], JOINT_SENSORS.index(kind), "real"
            elif kind == SENSOR.mjSENS_ACTUATORFRC and m.actuator_trnid[at][0] in self.driven:
                found.moments[label] = self.driven.index(int(m.actuator_trnid[at][0]))


OBJECT_TYPES = OBJECT.mjOBJ_SITE, OBJECT.mjOBJ_JOINT


def planar_loops(case: Case) -> tuple[PlanarLoops, list[float], float]:
    """The loops of a case's model, the free joints of its start key, and gravity along -y.

    Raises
    ------
    NotProven
        The model has an element that is not covered.
    """
    m = compiled_model(case)
    require_covered(m)
    driven = [m.joint(one.joint).id for one in case.drive]
    free = [joint for joint in range(m.njnt) if joint not in driven]
    if not free or not m.neq:
        raise NotProven("joints move freely beside the drives: the reference integrates them")
    start = m.key(case.start).qpos
    guess = [float(start[m.jnt_qposadr[joint]]) for joint in free]
    return PlanarLoops(m, tuple(driven), tuple(free)), guess, -float(m.opt.gravity[1])


def require_covered(m: mujoco.MjModel) -> None:
    """Raise NotProven for an element that `PlanarLoops` does not model."""
    connects = (m.eq_type == EQUALITY.mjEQ_CONNECT) & (m.eq_objtype == OBJECT_TYPES[0])
    gears = (m.eq_type == EQUALITY.mjEQ_JOINT) & ~m.eq_data[:, 2:5].any(axis=1)
    if not np.all(connects | (gears & (m.eq_obj2id >= 0))):
        raise NotProven("loops other than connect between sites, and gears of another kind")
    axes = np.where(m.jnt_type == mujoco.mjtJoint.mjJNT_HINGE, np.abs(m.jnt_axis[:, 2]), 1.0)
    if np.any(axes != 1.0) or np.any(m.body_quat[:, 1:3]) or np.any(m.opt.gravity[[0, 2]]):
        raise NotProven("joints about other axes than z, turned bodies, or gravity not along y")
    if m.ntendon or np.any(m.jnt_stiffness) or np.any(m.dof_armature):
        raise NotProven("tendons, springs or armature of a model are not written in balls")
    if np.any(m.dof_damping) or np.any(m.dof_frictionloss):
        raise NotProven("dampers or dry friction")
