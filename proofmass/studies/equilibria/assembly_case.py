"""An assembly of rods, read from a case: its rods, and the compiled model that they join."""

from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.assembly_newton import RodProblem
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.sim.protocol.run import Rod
from proofmass.studies.equilibria.rod_input import RodInput

SITE = mujoco.mjtObj.mjOBJ_SITE
SLIDE, HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)
ON_SITE, ON_JOINT = mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_JOINT
AXIS_ROUNDING = 1e-9
"""Deviation of an axis from one of the world's that is rounding."""


@dataclass(frozen=True)
class Attachment:
    """Where the tips of rods meet: the body of a platform, or the tip of a rod.

    Attributes
    ----------
    body : int
        Of the platform; of the ground if the platform is held; -1 for the tip of a rod.
    tip : str
        Name of the rod whose tip is the pin; empty with a platform.
    """

    body: int
    tip: str


def read_case(case: Case) -> RodInput:
    """Read the assembly of a case at the start pose of its model, with its drives held there.

    Raises
    ------
    InputError
        A rod stretches, shears or leaves the plane, its clamp can move, the rods do not meet in one
        pin or platform, or a load turns with the rods.
    """
    if not case.rod:
        raise InputError(case.file, "rod", "missing: give a case with [rod.NAME], or an assembly")
    return CaseReader(case).read()


class CaseReader:
    """A case with its model at the start pose."""

    def __init__(self, case: Case):
        self.case, self.rods = case, {rod.name: rod for rod in case.rods}
        self.model = compiled_model(case)
        self.data = mujoco.MjData(self.model)
        keys = [self.model.key(k).name for k in range(self.model.nkey)]
        key = keys.index(case.start) if case.start in keys else 0
        mujoco.mj_resetDataKeyframe(self.model, self.data, key)
        mujoco.mj_kinematics(self.model, self.data)
        self.driven = {drive.joint for drive in case.drive}

    def fail(self, key: str, wrong: str) -> InputError:
        """An error of the case."""
        return InputError(self.case.file, key, wrong)

    def read(self) -> RodInput:
        """The assembly."""
        for name, rod in self.rods.items():
            self.check_rod(name, rod)
        meeting = self.find_meeting()
        load = self.find_load(meeting)
        held, origin = self.platform(meeting)
        frames = [self.clamp_frame(name, rod) for name, rod in self.rods.items()]
        arms, clamped, tips = [], [], []
        for name, rod in self.rods.items():
            arm, angle = self.attachment_frame(rod, meeting, origin)
            arms.append(arm)
            own_tip = meeting.tip == name and bool(load[2])
            clamped.append(rod.ends[1] == "clamped" or own_tip)
            tips.append(angle)
        try:
            built = assembly(
                [frame[0] for frame in frames],
                angle=[frame[1] for frame in frames],
                length=[rod.length for rod in self.rods.values()],
                stiffness=[rod.stiffness for rod in self.rods.values()],
                arm=arms,
                clamped=clamped,
                tip_angle=np.where(clamped, tips, 0.0),
                curvature=[rod.curvature[2] for rod in self.rods.values()],
                couple=[rod.couple for rod in self.rods.values()],
                weight=[self.weight(rod) for rod in self.rods.values()],
                held=held,
            )
        except ValueError as error:
            raise self.fail("rod", str(error)) from None
        problem = RodProblem(built, np.zeros(built.rods), load)
        return RodInput(self.case.file, self.case.title, tuple(self.rods), problem)

    def check_rod(self, name: str, rod: Rod) -> None:
        """Raise for a rod that is no inextensible planar rod with a clamp."""
        for key, said in (
            ("torsion", rod.spatial),
            ("axial", rod.axial is not None),
            ("shear", rod.shear is not None),
        ):
            if said:
                raise self.fail(
                    f"rod.{name}.{key}", "all equilibria are searched of planar rods that only bend"
                )
        if rod.ends[0] != "clamped":
            raise self.fail(f"rod.{name}.ends", "the rod's beginning is pinned; it must be clamped")
        if rod.load[2] or (rod.mass is not None and self.model.opt.gravity[2]):
            raise self.fail(f"rod.{name}", "its load leaves the plane of x and y")

    def site(self, name: str) -> int:
        """Number of a site."""
        return int(self.model.site(name).id)

    def free_joints(self, body: int) -> list[int]:
        """Joints from a body to the ground that no drive moves."""
        found = []
        while body:
            first = self.model.body_jntadr[body]
            for joint in range(first, first + self.model.body_jntnum[body]):
                if self.model.joint(joint).name not in self.driven:
                    found.append(joint)
            body = int(self.model.body_parentid[body])
        return found

    def frame(self, site: int) -> tuple[complex, float]:
        """Position [m] and angle [rad] of a site in the plane."""
        place, axes = self.data.site_xpos[site], self.data.site_xmat[site].reshape(3, 3)
        return complex(place[0], place[1]), float(np.arctan2(axes[1, 0], axes[0, 0]))

    def clamp_frame(self, name: str, rod: Rod) -> tuple[tuple[float, float], float]:
        """Position and tangent of a clamp."""
        site = self.site(rod.start)
        if self.free_joints(int(self.model.site_bodyid[site])):
            raise self.fail(
                f"rod.{name}.from",
                f"site {rod.start!r} moves freely; it must be on the ground, or on a body that "
                "drives lead",
            )
        axes = self.data.site_xmat[site].reshape(3, 3)
        if abs(axes[2, 2] - 1.0) > AXIS_ROUNDING:
            raise self.fail(f"rod.{name}.from", "the z axis of its site is not that of the world")
        place, angle = self.frame(site)
        return (place.real, place.imag), angle

    def find_meeting(self) -> Attachment:
        """The platform or the tip at which all rods meet."""
        places = dict[Attachment, str]()
        for name, rod in self.rods.items():
            if rod.end is None:
                places[Attachment(-1, name)] = name
            elif rod.end.endswith(".tip"):
                places[Attachment(-1, rod.end.removesuffix(".tip"))] = name
            else:
                places[Attachment(int(self.model.site_bodyid[self.site(rod.end)]), "")] = name
        if len(places) > 1:
            one, other = list(places.values())[:2]
            raise self.fail(
                f"rod.{other}.to", f"it does not meet rod {one!r} in one pin or on one platform"
            )
        return next(iter(places))

    def platform(self, meeting: Attachment) -> tuple[list[float | None], complex]:
        """What holds the platform's origin and angle, and its origin where it does not move."""
        if meeting.tip:
            return [None] * 3, 0j
        axes = self.data.xmat[meeting.body].reshape(3, 3)
        place = complex(*self.data.xpos[meeting.body][:2])
        held: dict[str, float | None] = {
            "x": place.real,
            "y": place.imag,
            "phi": float(np.arctan2(axes[1, 0], axes[0, 0])),
        }
        for joint in self.free_joints(meeting.body):
            axis, kind = self.data.xaxis[joint], int(self.model.jnt_type[joint])
            which = np.flatnonzero(np.abs(np.abs(axis) - 1.0) < AXIS_ROUNDING)
            name = {(SLIDE, 0): "x", (SLIDE, 1): "y", (HINGE, 2): "phi"}.get(
                (kind, int(which[0]) if which.size else -1)
            )
            if name is None or self.model.jnt_stiffness[joint]:
                raise self.fail(
                    "model",
                    f"joint {self.model.joint(joint).name!r} of the platform must be a slide along "
                    "x or y or a hinge about z, without a spring",
                )
            held[name] = None
        return list(held.values()), place

    def attachment_frame(
        self, rod: Rod, meeting: Attachment, origin: complex
    ) -> tuple[tuple[float, float], float]:
        """Point and angle of a rod's attachment in the frame of the platform."""
        if meeting.tip or rod.end is None:
            return (0.0, 0.0), 0.0
        place, angle = self.frame(self.site(rod.end))
        axes = self.data.xmat[meeting.body].reshape(3, 3)
        turn = float(np.arctan2(axes[1, 0], axes[0, 0]))
        arm = (place - origin) * np.exp(-1j * turn)
        return (float(arm.real), float(arm.imag)), angle - turn

    def weight(self, rod: Rod) -> tuple[float, float]:
        """Dead load per length [N/m], with the rod's own weight."""
        own = (rod.mass or 0.0) / rod.length * self.model.opt.gravity
        if self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            own = np.zeros(3)
        return float(rod.load[0] + own[0]), float(rod.load[1] + own[1])

    def find_load(self, meeting: Attachment) -> Array:
        """The dead load on the platform's origin (3,): force [N] and moment [N m]."""
        load = np.zeros(3)
        for k in range(self.model.nu):
            name, kind = self.model.actuator(k).name, self.model.actuator_trntype[k]
            size = self.data.ctrl[k] * self.model.actuator_gainprm[k, 0]
            if not size or (kind == ON_JOINT and self.leads(k)):
                continue
            site, other = self.model.actuator_trnid[k]
            if kind != ON_SITE or other < 0 or self.model.site_bodyid[other]:
                raise self.fail(
                    "model",
                    f"actuator {name!r} is no dead load: give a site, and a refsite on the ground",
                )
            load += self.site_load(k, int(site), int(other), float(size), meeting)
        return load

    def leads(self, actuator: int) -> bool:
        """Whether an actuator acts on a joint that a drive leads."""
        return self.model.joint(self.model.actuator_trnid[actuator, 0]).name in self.driven

    def site_load(
        self, actuator: int, site: int, other: int, size: float, meeting: Attachment
    ) -> Array:
        """The load (3,) that an actuator exerts on the platform at a site."""
        axes = self.data.site_xmat[other].reshape(3, 3)
        gear = size * self.model.actuator_gear[actuator]
        force, moment = axes @ gear[:3], axes @ gear[3:]
        name = self.model.site(site).name
        on_platform = not meeting.tip and self.model.site_bodyid[site] == meeting.body
        at_origin = on_platform and not np.abs(self.model.site_pos[site]).max() > AXIS_ROUNDING
        if not (at_origin or name == f"{meeting.tip}.tip"):
            raise self.fail(
                "model",
                f"actuator {self.model.actuator(actuator).name!r} acts at site {name!r}; it must "
                "be at the pin, or at the origin of the platform",
            )
        return np.array([force[0], force[1], moment[2]])
