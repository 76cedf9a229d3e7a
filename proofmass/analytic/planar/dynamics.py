r"""Motion of a mechanism in time, in independent coordinates.

The coordinates z are those of the tangent plane of the loop equations at a reference pose.  A new
reference pose is taken whenever the motion has gone too far from the old one:

    G(q) = 0,  Nᵀ (q - q_r) = z        q̇ = V ż,   q̈ = V z̈ + γ

    (Vᵀ M V) z̈ = Vᵀ (Q - M γ - h)

Joints whose motion is prescribed count as loops that change with time: q_d - profile(t) = 0.
Joints that rest on a stop or stick by dry friction count as loops as well, and joints that slip
have a constant force (`proofmass.analytic.motion_events`).

The loops do not drift, since every evaluation closes them.  The integrator is DOP853 at 3e-14,
begun anew where the motion profile of a drive or of a control has a break
(`proofmass.analytic.controls`).  An error of about 1e-13 of the motion per swing remains, measured
on the pendulum's closed form and on the energy of a four-bar.

F. Potra and W. Rheinboldt, On the numerical solution of Euler-Lagrange equations, 1991.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from proofmass.analytic.controls import (
    NO_PRESCRIBED_JOINTS,
    ControlsInTime,
    Prescribed,
    smooth_pieces,
)
from proofmass.analytic.motion_events import (
    FrictionJoint,
    MotionWithEvents,
    Phase,
    StuckJoint,
    integrate_with_events,
    rest_in_steps,
)
from proofmass.analytic.numerics import CannotAssemble, SingularHere
from proofmass.analytic.planar.forces import (
    applied_forces,
    centre_jacobians,
    inertial_forces,
    mass_matrix,
)
from proofmass.analytic.planar.kinematics import (
    CLOSING_TOLERANCE,
    count_dof,
    linearise_loops,
    loop_bias,
    loop_jacobian,
    move_bodies,
    nearest_pose,
    nearest_rates,
    scaled_jacobian,
)
from proofmass.analytic.planar.mechanism import (
    Coupling,
    Mechanism,
    Overconstrained,
)
from proofmass.analytic.stops import Balance, State, Step, Stop
from proofmass.base.arrays import Array

if TYPE_CHECKING:
    from scipy.integrate import DOP853

INTEGRATION_TOLERANCE = 3e-14
"""Relative and absolute tolerance of a step, in `Mechanism.scale`."""
NEWTON_ROUNDING = 1e-15
"""Constraint violation, in `Mechanism.loop_units`, below which Newton's next step would be
rounding."""
MAX_STRETCH = 1.5
"""Norm of the derivative of q by z above which a new tangent plane is taken; it is 1 at the
reference pose."""


FREE_PHASE = Phase()
"""A phase in which no joint is at rest and none has dry friction."""
NO_SLOPES = 0.0, 0.0, 0.0, 0.0
"""Coefficients of the polynomial of a coupling that holds a joint at a value, after the first."""


class TangentChart:
    """The tangent plane of the constraints at a closed pose q (joints,), in `Mechanism.scale`."""

    def __init__(
        self,
        m: Mechanism,
        q: Array,
        drives: Prescribed = NO_PRESCRIBED_JOINTS,
        controls: ControlsInTime | None = None,
        phase: Phase = FREE_PHASE,
    ):
        self.m, self.q, self.at, self.drives, self.controls = m, q, q, drives, controls
        self.phase, self.friction = phase, phase.friction(len(m.joints))
        self.last = np.inf  # end of the smooth piece of the profiles that is integrated [s]
        self.held, self.units = m.rows + drives.rates.size, m.scale[drives.rates]
        driven = np.eye(len(m.joints))[drives.rates]
        rows = np.concatenate([scaled_jacobian(m, q[None])[0], driven])
        self.normal = np.linalg.svd(rows)[2][self.held :]
        self.coordinates = np.concatenate([driven, self.normal])
        self.into: Array = self.normal.T * m.scale[:, None]
        self.z = np.zeros(len(self.normal))

    @property
    def stretch(self) -> float:
        """Norm of the derivative of q by z at the pose that was evaluated last."""
        return float(np.linalg.norm(self.into / self.m.scale[:, None], 2))

    def close(self, z: Array, t: float) -> tuple[Array, Array]:
        """Find the closed pose (joints,) of coordinates z at a time, by Newton from the last pose.

        The second array has the derivatives of the joints by the values of loops, drives and
        coordinates (joints, joints).
        """
        if not self.held:  # an open chain, where the tangent plane is the whole space
            return self.q + self.into @ z, self.into
        m, q, last = self.m, self.at + self.into @ (z - self.z), np.inf
        q[self.drives.rates] = wanted = self.drives.profile(t)[0]
        wanted = np.concatenate([(wanted - self.q[self.drives.rates]) / self.units, z])
        while True:
            (violations,), (loops,) = linearise_loops(m, q[None])
            apart = self.coordinates @ ((q - self.q) / m.scale) - wanted
            errors = np.concatenate([violations / m.loop_units, apart])
            size = np.abs(errors).max()
            if not size < 0.5 * last or size < NEWTON_ROUNDING:
                break
            last = size
            q = q - np.linalg.solve(self.matrix(loops), errors) * m.scale
        if not size < CLOSING_TOLERANCE:
            raise CannotAssemble("the loops do not close: a free motion has left its branch")
        self.at, self.z = q, z
        return q, np.linalg.inv(self.matrix(loops)) * m.scale[:, None]

    def matrix(self, loops: Array) -> Array:
        """Jacobian of loops (rows, joints), drives and coordinates, in units (joints, joints)."""
        scaled = loops * self.m.scale / self.m.loop_units[:, None]
        return np.concatenate([scaled, self.coordinates])

    def motion(self, y: Array, t: float) -> tuple[Array, Array, Array, Array]:
        """Find pose, rates, accelerations (joints,) and z̈ of a state y = (z, ż) at a time."""
        m, half = self.m, y.size // 2
        q, inverse = self.close(y[:half], t)
        _, rate, acceleration = self.drives.profile(t)
        by_drives, self.into = inverse[:, m.rows : self.held], inverse[:, self.held :]
        into, v = self.into, self.into @ y[half:] + by_drives @ (rate / self.units)
        without_accelerations = move_bodies(m, q[None], v[None], np.zeros((1, v.size)))
        gamma = -inverse[:, : m.rows] @ (loop_bias(m, q[None], v[None])[0] / m.loop_units)
        gamma = gamma + by_drives @ (acceleration / self.units)
        centre = centre_jacobians(m, without_accelerations)
        matrix = mass_matrix(m, centre)[0]
        ctrl = self.controls.at(t)[None] if self.controls else None
        force = applied_forces(
            m, without_accelerations, centre, q[None], v[None], ctrl
        ) - inertial_forces(m, centre, without_accelerations)
        force = force[0] + self.friction - matrix @ gamma
        z_acceleration = np.linalg.solve(into.T @ matrix @ into, into.T @ force)
        a = into @ z_acceleration + gamma
        q, v, a = self.phase.fix(q, v, a)
        return q, v, a, z_acceleration

    def state(self, v: Array) -> Array:
        """State y of the reference pose with rates v (joints,)."""
        return np.concatenate([np.zeros(len(self.normal)), self.normal @ (v / self.m.scale)])

    def slope(self, t: float, y: Array) -> Array:
        """Time derivative of the state y."""
        return np.concatenate([y[y.size // 2 :], self.motion(y, min(t, self.last))[3]])


SHORT_STEP_SHARE = 0.1
"""Share of the longest step of a motion below which a step is short: it may end near a pose in
which the loops lose rank, since rounding grows there."""
SINGULAR_REGULARITY = 1e-2
"""Regularity below which a pose may be near a pose in which the loops lose rank."""
LEAP_SHARES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Lengths of one step over such a pose, as shares of the longest step."""
MAX_LEAP_MISMATCH = 1e-9
"""Largest difference, in `Mechanism.scale`, of the states after two steps over such a pose that
still count as one motion."""


def free_motion(
    m: Mechanism,
    times: Array,
    drives: Prescribed = NO_PRESCRIBED_JOINTS,
    stops: tuple[Stop, ...] = (),
    controls: ControlsInTime | None = None,
) -> MotionWithEvents:
    """Integrate the motion from the start at rising times, with its events.

    Joints without a drive start as near to the start pose as the loops allow.

    Raises
    ------
    CannotAssemble, SingularHere, Overconstrained
        The start pose is not regular; or the motion meets a pose in which degrees of freedom
        appear, and is not smooth behind it.
    NotCovered
        The start is beyond a stop.
    ValueError
        There is no time, or the times fall.
    """
    if not times.size or (np.diff(times) < 0.0).any():
        raise ValueError(f"a motion needs one or more times that do not fall, got {times}")
    value, rate, _ = drives.profile(float(times[0]))
    q = nearest_pose(m, m.start, drives.rates, value)
    if count_dof(m, q) <= drives.rates.size:
        raise SingularHere("the mechanism has no degree of freedom")
    v = nearest_rates(m, q, m.start_rate, drives.rates, rate)
    return integrate_with_events(FreeMechanism(m, drives, stops, controls), times, q, v)


class FreeMechanism:
    """A mechanism whose joints move freely between their stops, except for the driven ones."""

    def __init__(
        self,
        m: Mechanism,
        drives: Prescribed,
        stops: tuple[Stop, ...],
        controls: ControlsInTime | None = None,
    ):
        self.m, self.drives, self.controls = m, drives, controls
        own = controls.breaks if controls else ()
        self.breaks = tuple(sorted({*drives.breaks, *own}))
        self.stops = tuple(s for s in stops if s.rate not in drives.rates)
        self.changes_in_time = bool(drives.rates.size or controls)
        self.frictions = tuple(
            FrictionJoint(joint.name, k, k, joint.friction, float(m.scale[k]))
            for k, joint in enumerate(m.joints)
            if joint.friction and k not in drives.rates
        )
        self.at_rest: dict[tuple[Stop | StuckJoint, ...], Mechanism] = {(): m}

    def chart(self, phase: Phase, q: Array) -> TangentChart:
        """Make the tangent plane at a pose in a phase, whose joints at rest count as loops.

        Raises
        ------
        Overconstrained
            One of the stops depends on the other constraints.
        """
        if phase.held not in self.at_rest:
            self.at_rest[phase.held] = self.hold(phase, q)
        return TangentChart(self.at_rest[phase.held], q, self.drives, self.controls, phase)

    def hold(self, phase: Phase, q: Array) -> Mechanism:
        """The mechanism with couplings for the joints at rest, which must be independent.

        Joints that stick and depend on others have none: the others hold them.
        """
        m, driven = self.m, np.eye(q.size)[self.drives.rates]
        for one in phase.held:
            value = one.value - m.joints[one.rate].zero
            rest = Coupling(f"rest of {one.joint}", ((one.rate, 1.0),), (), (value, *NO_SLOPES))
            more = replace(m, couplings=(*m.couplings, rest))
            rows = np.concatenate([scaled_jacobian(more, q[None])[0], driven])
            if np.linalg.matrix_rank(rows, tol=MOTION_RANK_TOLERANCE) == len(rows):
                m = more
            elif isinstance(one, Stop):
                names = ", ".join(stop.joint for stop in phase.resting)
                raise Overconstrained(f"joints rest on stops that are not independent: {names}")
        return m

    def state(self, phase: Phase, t: float, q: Array, v: Array) -> State:
        """Add the accelerations to a pose and its rates."""
        chart = self.chart(phase, q)
        return chart.motion(chart.state(v), t)[:3]

    def balance(self, t: float, q: Array, v: Array, a: Array) -> Balance:
        """Constraints of loops and drives in a state, and the force they and stops must exert."""
        m, motion = self.m, move_bodies(self.m, q[None], v[None], a[None])
        centre, loops = centre_jacobians(m, motion), loop_jacobian(m, q[None])[0]
        ctrl = self.controls.at(t)[None] if self.controls else None
        force = inertial_forces(m, centre, motion) - applied_forces(
            m, motion, centre, q[None], v[None], ctrl
        )
        return Balance(
            np.vstack([loops, np.eye(q.size)[self.drives.rates]]),
            mass_matrix(m, centre)[0],
            force[0] + m.inertia.fixed @ a,
        )

    def steps(
        self, phase: Phase, t: float, q: Array, v: Array, end: float, longest: float
    ) -> Iterator[Step]:
        """Iterate over the motion in a phase from a state on, in steps up to a length."""
        for start, stop, last in smooth_pieces(t, end, self.breaks) if t < end else ():
            chart = self.chart(phase, q)
            chart.last = last
            if not chart.z.size and not self.drives.rates.size:
                yield from rest_in_steps(start, stop, (q, 0.0 * v, 0.0 * v), longest)
            elif not chart.z.size:
                yield from iterate_without_dof(chart, start, stop)
                q, v, _, _ = chart.motion(chart.state(v), stop)
            else:
                q, v = yield from self.piece(chart, start, v, stop, longest)

    def piece(
        self, chart: TangentChart, t: float, v: Array, end: float, longest_step: float
    ) -> Generator[Step, None, tuple[Array, Array]]:
        """Integrate over a time in which motion profiles are smooth, from the pose of a chart on.

        Pose and rates at the end are returned.
        """
        longest, q, solver = 0.0, chart.q, start_integrator(chart, t, v, end, longest_step)
        while solver.t < end:
            start = solver.t
            message = solver.step()
            if solver.status == "failed":
                raise SingularHere(f"the motion ends at t = {solver.t:.6g} s: {message}")
            longest = max(longest, solver.step_size)
            short = (
                solver.step_size < SHORT_STEP_SHARE * longest
                and regularity(chart.m, chart.at) < SINGULAR_REGULARITY
            )
            left = short or chart.stretch > MAX_STRETCH  # the step's end was evaluated last
            if short:
                solver = step_over_singularity(chart, solver.t, solver.y, longest, end)
            yield Step(start, solver.t, states_in_step(chart, cache(solver.dense_output)))
            if left or solver.t == end:
                q, v, _, _ = chart.motion(solver.y, solver.t)
            if left and solver.t < end:
                last, chart = chart.last, self.chart(chart.phase, q)
                chart.last = last
                step = min(solver.h_abs, longest, end - solver.t)
                solver = start_integrator(chart, solver.t, v, end, longest_step, step)
        return q, v


def states_in_step(
    chart: TangentChart, dense_output: Callable[[], Callable[[float], Array]]
) -> Callable[[float], State]:
    """Make the function that gives pose, rates and accelerations at a time within a step."""
    return lambda time: chart.motion(dense_output()(time), time)[:3]


MOTION_RANK_TOLERANCE = 1e-8
"""Singular values, in `Mechanism.scale`, below which rows of loops and stops count as dependent."""
STEPS_WITHOUT_DOF = 256
"""Number of steps of a motion in which stops and drives leave no degree of freedom."""


def iterate_without_dof(chart: TangentChart, t: float, end: float) -> Iterator[Step]:
    """Iterate over the steps of a mechanism whose drives and stops leave no degree of freedom."""
    times = np.linspace(t, end, STEPS_WITHOUT_DOF + 1).tolist()
    for start, last in pairwise(times):
        yield Step(start, last, states_in_step(chart, lambda: lambda _: chart.z))


def start_integrator(
    chart: TangentChart,
    t: float,
    v: Array,
    end: float,
    longest: float = np.inf,
    first_step: float | None = None,
) -> "DOP853":
    """Start the integrator of a motion from the pose of a chart at rates v (joints,)."""
    from scipy.integrate import DOP853  # slow to load

    return DOP853(
        chart.slope,
        t,
        chart.state(v),
        end,
        rtol=INTEGRATION_TOLERANCE,
        atol=INTEGRATION_TOLERANCE,
        max_step=longest,
        first_step=first_step,
    )


def regularity(m: Mechanism, q: Array) -> float:
    """Smallest over largest singular value of the loops' Jacobian in a pose (joints,)."""
    if not m.rows:
        return 1.0
    values = np.linalg.svd(scaled_jacobian(m, q[None])[0], compute_uv=False)
    return float(values[-1] / values[0])


def step_over_singularity(
    chart: TangentChart, t: float, y: Array, longest: float, end: float
) -> "DOP853":
    """Take one step over a pose in which the loops lose rank.

    The motion is smooth there, and only rounding grows.  Of several lengths the one is chosen whose
    stages stay furthest from the pose, and the second best must lead to the same motion.

    Raises
    ------
    SingularHere
        The two lead to different motions, or no two lengths lead over the pose.
    """
    from scipy.integrate import DOP853  # slow to load

    candidates = list[tuple[float, DOP853]]()
    for share in LEAP_SHARES:
        lowest_regularity = 1.0

        def slope(time: float, state: Array) -> Array:
            nonlocal lowest_regularity
            rate = chart.slope(time, state)
            lowest_regularity = min(lowest_regularity, regularity(chart.m, chart.at))
            return rate

        chart.motion(y, t)
        end_time = min(t + share * longest, end)
        solver = DOP853(slope, t, y, end_time, rtol=1.0, atol=np.inf, first_step=end_time - t)
        with suppress(CannotAssemble, np.linalg.LinAlgError):
            solver.step()
            solver.dense_output()
            candidates.append((lowest_regularity, solver))
    candidates.sort(key=lambda way: way[0])
    if len(candidates) > 1:
        best, other = candidates[-1][1], candidates[-2][1]
        early, late = (best, other) if best.t <= other.t else (other, best)
        check = DOP853(chart.slope, early.t, early.y, late.t, rtol=1e-12, atol=1e-12)
        with suppress(CannotAssemble, np.linalg.LinAlgError):
            chart.motion(early.y, early.t)
            while check.status == "running" and check.nfev < 2000:
                check.step()
            if check.status == "finished" and np.abs(check.y - late.y).max() < MAX_LEAP_MISMATCH:
                chart.motion(best.y, best.t)
                return best
    raise SingularHere(f"the motion ends at t = {t:.6g} s: the loops lose rank there")
