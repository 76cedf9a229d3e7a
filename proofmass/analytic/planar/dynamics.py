r"""Forces on the joints of a mechanism, and its free motion in independent coordinates.

Joint forces and masses are sums over bodies of force times Jacobian.  The coordinates z are those
of the tangent plane of the loop equations at a reference pose, which changes whenever the motion
has turned away from it:

    G(q) = 0,  Nᵀ (q - q_r) = z        q̇ = V ż,   q̈ = V z̈ + γ

    (Vᵀ M V) z̈ = Vᵀ (Q - M γ - h)

No loop drifts: every evaluation closes them.  The integrator is DOP853 at 3e-14; what remains is
an error of about 1e-13 of the motion for each swing, measured on the pendulum's closed form and on
the energy of a four-bar.

F. Potra and W. Rheinboldt, On the numerical solution of Euler-Lagrange equations, 1991.
"""

import numpy as np

from proofmass.analytic.numerics import Array, Complex
from proofmass.analytic.planar.kinematics import (
    CLOSED,
    BodyMotion,
    Drives,
    bias,
    fitting,
    freedoms,
    jacobian,
    loop_jacobian,
    move,
    nearest,
    residual,
    scaled_jacobian,
)
from proofmass.analytic.planar.mechanism import CannotAssemble, Mechanism, SingularHere


def centres(m: Mechanism, motion: BodyMotion) -> Complex:
    """Derivatives of the centres of the bodies that have inertia by the joints (n, k, joints)."""
    own = m.inertia
    return jacobian(m, motion, own.bodies, motion.points(own.bodies, own.centre))


def applied(m: Mechanism, centre: Complex, q: Array, v: Array | float = 0.0) -> Array:
    """Gravity, springs, dampers and constant loads on the joints (n, joints) [N m, or N]."""
    rest, stiffness, damping, _, load = m.springs
    weight = m.inertia.mass @ (centre.real * m.gravity.real + centre.imag * m.gravity.imag)
    return np.asarray(load - stiffness * (q - rest) - damping * v + weight)


def mass(m: Mechanism, centre: Complex) -> Array:
    """Mass matrix of the joints, loops open (n, joints, joints)."""
    weighted = np.sqrt(m.inertia.mass)[:, None] * centre
    x, y = weighted.real, weighted.imag
    return np.asarray(m.inertia.fixed + x.swapaxes(1, 2) @ x + y.swapaxes(1, 2) @ y)


def inertial(m: Mechanism, centre: Complex, motion: BodyMotion) -> Array:
    """What turns and guides the bodies of a motion whose joints do not accelerate, as forces on the
    joints (n, joints)."""
    own = m.inertia
    pull = own.mass * motion.points(own.bodies, own.centre, 2).T
    bent = pull.real[:, None] @ centre.real + pull.imag[:, None] @ centre.imag
    return np.asarray(bent[:, 0])


def holding(m: Mechanism, q: Array, d: Drives) -> Array:
    """Moments (or forces) that hold the drives at rest in closed poses (n, drives).

    Virtual work: for each drive, what the applied forces do along the motion that it allows.
    """
    motion = move(m, q)
    force = applied(m, centres(m, motion), q)
    force[:, d.driven] -= [m.joints[j].load for j in d.driven]  # its own motor is the drive
    matrix = loop_jacobian(m, motion, q)
    tangent = -np.linalg.solve(matrix[..., d.following], matrix[..., d.driven])
    return np.asarray(-force[:, d.driven] - np.einsum("nfd,nf->nd", tangent, force[:, d.following]))


def potential(m: Mechanism, motion: BodyMotion, q: Array) -> Array:
    """Energy of gravity and joint springs [J] (n,)."""
    energy = sum(0.5 * j.stiffness * (q[:, k] - j.rest) ** 2 for k, j in enumerate(m.joints))
    for b, body in enumerate(m.bodies):
        energy = energy - body.mass * (motion.point(b, body.centre).conj() * m.gravity).real
    return np.asarray(energy)


def kinetic(m: Mechanism, motion: BodyMotion, v: Array) -> Array:
    """Energy of motion [J] (n,)."""
    energy = sum(0.5 * j.armature * v[:, k] ** 2 for k, j in enumerate(m.joints))
    for b, body in enumerate(m.bodies):
        energy = energy + 0.5 * (
            body.mass * np.abs(motion.point(b, body.centre, 1)) ** 2
            + body.moment * motion.turn[1][b] ** 2
        )
    return np.asarray(energy)


ACCURACY = 3e-14
"""Relative and absolute tolerance of a step, in `Mechanism.scale`."""
ROUNDING = 1e-15
"""Loops that are open by less, in sizes of the mechanism: Newton's next step would be noise."""
TILT = 1.5
"""Stretch of the map from z to q at which a new tangent plane is taken; 1 where it touches."""


class TangentChart:
    """The tangent plane of the loops at a closed pose q (joints,), in own units."""

    def __init__(self, m: Mechanism, q: Array):
        self.m, self.q, self.at = m, q, q
        self.normal = np.linalg.svd(scaled_jacobian(m, q[None])[0])[2][m.rows :]
        self.into: Array = self.normal.T * m.scale[:, None]
        self.z = np.zeros(len(self.normal))

    @property
    def stretch(self) -> float:
        """How much the map from z to q stretched in the last pose asked for."""
        return float(np.linalg.norm(self.into / self.m.scale[:, None], 2))

    def close(self, z: Array) -> tuple[Array, Array]:
        """The closed pose (joints,) of coordinates z, by Newton from the last one.

        And there the derivatives of the joints by the loops and the coordinates (joints, joints).
        """
        if not self.m.rows:  # an open chain, where the tangent plane is the whole space
            return self.q + self.into @ z, self.into
        m, q, last = self.m, self.at + self.into @ (z - self.z), np.inf
        while True:
            motion = move(m, q[None])
            wrong = np.concatenate(
                [
                    residual(m, motion, q[None])[0] / m.size,
                    self.normal @ ((q - self.q) / m.scale) - z,
                ]
            )
            size = np.abs(wrong).max()
            if not size < 0.5 * last or size < ROUNDING:
                break
            last = size
            q = q - np.linalg.solve(self.matrix(q, motion), wrong) * m.scale
        if not size < CLOSED:
            raise CannotAssemble("a free motion left its branch")
        self.at, self.z = q, z
        return q, np.linalg.inv(self.matrix(q, motion)) * m.scale[:, None]

    def matrix(self, q: Array, motion: BodyMotion) -> Array:
        """Jacobian of loops and coordinates together (joints, joints)."""
        loops = loop_jacobian(self.m, motion, q[None])[0]
        return np.concatenate([loops * self.m.scale / self.m.size, self.normal])

    def motion(self, y: Array) -> tuple[Array, Array, Array, Array]:
        """Pose, rates, accelerations (joints,) and z̈ of a state y = (z, ż)."""
        m, half = self.m, y.size // 2
        q, inverse = self.close(y[:half])
        self.into = into = inverse[:, m.rows :]
        v = into @ y[half:]
        still = move(m, q[None], v[None], np.zeros((1, v.size)))
        gamma = -inverse[:, : m.rows] @ (bias(m, still, q[None], v[None])[0] / m.size)
        centre = centres(m, still)
        matrix = mass(m, centre)[0]
        force = applied(m, centre, q[None], v[None]) - inertial(m, centre, still)
        force = force[0] - matrix @ gamma
        bend = np.linalg.solve(into.T @ matrix @ into, into.T @ force)
        return q, v, into @ bend + gamma, bend

    def state(self, v: Array) -> Array:
        """The state y of the pose where the plane touches, at rates v (joints,)."""
        return np.concatenate([np.zeros(len(self.normal)), self.normal @ (v / self.m.scale)])

    def slope(self, _: float, y: Array) -> Array:
        """Rate of the state."""
        return np.concatenate([y[y.size // 2 :], self.motion(y)[3]])


def free_motion(m: Mechanism, times: Array) -> tuple[Array, Array, Array]:
    """Poses, rates and accelerations (n, joints) of the motion from the start pose at rising times.

    Raises
    ------
    CannotAssemble, SingularHere, Overconstrained
        The start pose; or the motion meets a pose where degrees of freedom appear.
    """
    from scipy.integrate import DOP853  # slow to load

    q = nearest(m, m.start)
    if not freedoms(m, q):
        raise SingularHere("the mechanism has no degree of freedom")
    chart, v = TangentChart(m, q), fitting(m, q, m.start_rate)
    found = [chart.motion(chart.state(v))[:3]]
    solver = DOP853(chart.slope, times[0], chart.state(v), times[-1], rtol=ACCURACY, atol=ACCURACY)
    while len(found) < len(times):
        message = solver.step()
        if solver.status == "failed":
            raise SingularHere(f"no further than t = {solver.t:.6g} s: {message}")
        inside = solver.dense_output()
        while len(found) < len(times) and times[len(found)] <= solver.t:
            found.append(chart.motion(inside(times[len(found)]))[:3])
        q, v, _, _ = chart.motion(solver.y)
        if chart.stretch > TILT and solver.status == "running":
            chart = TangentChart(m, q)
            solver = DOP853(
                chart.slope,
                solver.t,
                chart.state(v),
                times[-1],
                rtol=ACCURACY,
                atol=ACCURACY,
                first_step=min(solver.h_abs, times[-1] - solver.t),
            )
    q, v, a = (np.array(part) for part in zip(*found, strict=True))
    return q, v, a
