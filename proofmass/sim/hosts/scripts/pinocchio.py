"""Pinocchio: its accelerations with loops by the proximal solver, and RK4 steps of this script.

Rotations are integrated in the tangent space (Munthe-Kaas).  Drives and gears are forces, found by
the response to unit forces; driven coordinates are those of tables.  After a step the others close
loops and gears to rounding.  Springs and loads are applied forces.
"""

from functools import partial

import numpy as np
import pinocchio as pin
from proofmass_host import LinkStates, NeutralMechanism, record, runge_kutta

VERSIONS = {"pin": pin.__version__, "numpy": np.__version__}
SINGLE = {"hinge": pin.JointModelRevoluteUnaligned, "slide": pin.JointModelPrismaticUnaligned}
SPATIAL = {"ball": pin.JointModelSpherical, "free": pin.JointModelFreeFlyer}
WORLD, END, POINT = pin.ReferenceFrame.WORLD, pin.ArgumentPosition.ARG1, pin.ContactType.CONTACT_3D
SHIFT, ITERATIONS = 1e-12, 100  # of the proximal solver
NOISE, TINY_LEVER = 1e-13, 1e-7  # shares of the largest response of drives, lever of loops


def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates:
    """Integrate by RK4, and read the links at the samples."""
    motion = ProximalMotion(mechanism, settings)
    return record(mechanism, motion.step, motion.read, motion.joint)


class ProximalMotion:
    """A mechanism in motion; `ids` and `origins` are those of the last joint of each link."""

    def __init__(self, mechanism, settings):
        self.mechanism, self.model, joints = mechanism, pin.Model(), mechanism.joints
        self.half, self.model.gravity.linear = 0, mechanism.gravity
        self.ids, self.origins = [0] * len(mechanism.links), [np.zeros(3)] * len(mechanism.links)
        self.v = np.concatenate([mechanism.start_rates(j) for j in range(len(joints))])
        for j, one in enumerate(joints):
            base = one.child if self.ids[one.child] else one.parent
            kind = SINGLE[one.kind](one.axis) if one.kind in SINGLE else SPATIAL[one.kind]()
            place = pin.SE3(np.eye(3), one.anchor - self.origins[base])
            self.ids[one.child] = self.model.addJoint(self.ids[base], kind, place, str(j))
            self.origins[one.child] = one.anchor
        for k, link in enumerate(mechanism.links[1:], 1):
            inertia = pin.Inertia(link.mass, link.centre - self.origins[k], link.inertia)
            self.model.appendBodyToJoint(self.ids[k], inertia, pin.SE3.Identity())
        self.q = self.start = pin.neutral(self.model)
        tables = self.model.idx_qs, self.model.idx_vs, self.model.nvs
        self.iq, self.iv, sizes = (np.array(list(one)[1:]) for one in tables)
        self.model.armature = np.repeat([one.armature for one in joints], sizes)
        self.damping = np.repeat([one.damping for one in joints], sizes)
        self.data, unit = self.model.createData(), np.eye(self.model.nv)[self.iv]
        driven = np.array([one.joint for one in mechanism.drives], int)
        self.idle = np.setdiff1d(np.arange(self.model.nv), self.iv[driven])
        self.gears = [unit[one.one] - one.ratio * unit[one.two] for one in mechanism.gears]
        self.pushes = np.array([*unit[driven], *self.gears])
        own = () if settings["defaults"] else (settings["accuracy"], SHIFT, ITERATIONS)
        self.respond = self.add_loops(pin.ProximalSettings(*own))

    def add_loops(self, solver):
        """Close loops; returns the accelerations at coordinates, rates and forces."""
        loops, found = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop in self.mechanism.loops:
            sides = (loop.a, loop.on_a), (loop.b, loop.on_b)
            a, b = ((self.ids[k], pin.SE3(np.eye(3), at - self.origins[k])) for k, at in sides)
            loops.append(pin.RigidConstraintModel(POINT, self.model, *a, *b))
            found.append(loops[-1].createData())
        pin.initConstraintDynamics(self.model, self.data, loops, found)
        own = {"contact_models": loops, "contact_datas": found, "prox_settings": solver}
        return partial(pin.constraintDynamics, self.model, self.data, **own)

    def accelerate(self, q, v, half):
        """The accelerations, with the forces in drives and gears that they need."""
        force, pushes, drives = self.applied_forces(q, v, half), self.pushes, self.mechanism.drives
        found = self.respond(q, v, force)
        if len(pushes) and np.isfinite(found).all():
            response = pushes @ np.array([self.respond(q, v, force + p) - found for p in pushes]).T
            wanted = [one.acceleration[half] for one in drives] + [0.0] * len(self.gears)
            for _ in range(2):  # the second time removes the rounding of the response
                force += np.linalg.lstsq(response, wanted - pushes @ found, rcond=NOISE)[0] @ pushes
                found = self.respond(q, v, force)
        return found

    def applied_forces(self, q, v, half):
        """Forces on the coordinates: springs, dampers, motors and loads."""
        force = -self.damping * v
        for j in self.mechanism.singles:
            one, i = self.mechanism.joints[j], self.iv[j]
            force[i] = one.passive_force(one.value + q[self.iq[j]], v[i])
            force[i] += one.force[half % one.force.size]
        if rest := self.mechanism.rest:  # without gravity
            force -= rest.drag * pin.rnea(self.model, self.data, q, 0.0 * v, v)
        pin.computeJointJacobians(self.model, self.data, q)
        for one in self.mechanism.springs:
            gap, lever = self.gap(one)
            length = np.linalg.norm(gap)
            force -= one.pull(length, gap @ lever @ v / length) * (gap / length) @ lever
        for one in self.mechanism.loads:
            turn = self.data.oMi[self.ids[one.link]].rotation if one.follows else np.eye(3)
            load = np.append(turn @ one.force, turn @ one.moment)
            force += one.share[half % one.share.size] * load @ self.point(one.link, one.at)[1]
        return force

    def point(self, link, at):
        """Place of a point of a link, given at the start, and the Jacobian (6, nv) of its rates."""
        place = self.data.oMi[self.ids[link]].act(at - self.origins[link])
        lever = pin.getJointJacobian(self.model, self.data, self.ids[link], WORLD).reshape(6, -1)
        return place, lever + np.vstack([np.cross(lever[3:], place, axis=0), 0.0 * lever[3:]])

    def gap(self, one):
        """The way (3,) from one end of a loop or spring to the other, and its Jacobian (3, nv)."""
        (a, lever_a), (b, lever_b) = self.point(one.a, one.on_a), self.point(one.b, one.on_b)
        return b - a, (lever_b - lever_a)[:3]

    def moved(self, change, faster, half):
        """Coordinates and rates after changes, the driven ones by their tables."""
        q, v = pin.integrate(self.model, self.q, change), self.v + faster
        for one in self.mechanism.drives:
            q[self.iq[one.joint]] = one.value[half] - self.mechanism.joints[one.joint].value
            v[self.iv[one.joint]] = one.rate[half]
        return q, v

    def slopes(self, change, faster, half):
        """Slopes of coordinates, in the tangent space, and of rates where they are changed."""
        q, v = self.moved(change, faster, half)
        turned = pin.dIntegrate(self.model, self.q, change, END)
        slope = np.linalg.solve(turned, v) if self.model.nq > self.model.nv else v
        return slope, self.accelerate(q, v, half)

    def step(self, i):
        """Make a step, and move the coordinates that are not driven to close loops and gears."""
        first, self.half = (self.v, self.accelerate(self.q, self.v, 2 * i)), 2 * i + 2
        changes = runge_kutta(self.slopes, first, i, self.mechanism.step)
        self.q, self.v = self.moved(*changes, self.half)
        closes = (self.gears or self.mechanism.loops) and np.isfinite(self.q).all()
        for of_rates in (False, False, True) if closes else ():
            pin.computeJointJacobians(self.model, self.data, self.q)
            moved = pin.difference(self.model, self.start, self.q)
            parts = [(np.array([one @ moved]), one) for one in self.gears]
            gaps, levers = zip(*parts, *(self.gap(loop) for loop in self.mechanism.loops))
            rows, change = np.vstack(levers), np.zeros(self.model.nv)
            missing = -rows @ self.v if of_rates else -np.concatenate(gaps)
            change[self.idle] = np.linalg.lstsq(rows[:, self.idle], missing, rcond=TINY_LEVER)[0]
            self.q = pin.integrate(self.model, self.q, (not of_rates) * change)
            self.v = self.v + of_rates * change

    def read(self, link):
        """Place, rotation, velocities and accelerations of a link."""
        if link == 1:
            self.known = self.accelerate(self.q, self.v, self.half)
            pin.forwardKinematics(self.model, self.data, self.q, self.v, self.known)
            pin.computeJointJacobians(self.model, self.data)
        place, lever = self.point(link, self.mechanism.links[link].centre)
        velocity, omega = (lever @ self.v).reshape(2, 3)
        change = pin.getAcceleration(self.model, self.data, self.ids[link], WORLD)
        acceleration = change.linear + np.cross(change.angular, place) + np.cross(omega, velocity)
        turn, alpha = self.data.oMi[self.ids[link]].rotation.copy(), change.angular.copy()
        return place, turn, velocity, omega, acceleration, alpha

    def joint(self, j):
        """Coordinate, rate and acceleration of a hinge or slide at the sample that was read."""
        return self.q[self.iq[j]], self.v[self.iv[j]], self.known[self.iv[j]]
