r"""Equilibria of flexible mechanisms: pose from clamps (direct), clamps from pose (inverse).

The module also computes their Jacobians, tip stiffness and singularities.

**A rod** is integrated as a chain of high order, which gives the rod's tip under an end load with
exact derivatives::

      m0  clamp         tip   n             z' = exp(i theta),   m = m0 + Im(conj(n) z),
     _|/________________.--->               theta' = m/EI        z, n = x + iy from the clamp
      |\   theta(s)

With theta frozen, z moves along a straight segment; with z frozen, theta changes in a hinge.  Such
segments and hinges in turn, with half a segment at both ends, are a chain of n rigid segments and
hinge springs, which is of second order.  The same chain with the segment lengths and hinges below,
some of them negative, is of sixth order.  Each part is solved exactly, so the map is symplectic,
and the tip stiffness that it gives is symmetric to rounding.

**An assembly** is closed and in balance where the following rows are zero.  Newton's method solves
them with their exact Jacobian.  The first two are those of each rod, where e is the far end of its
rigid extension; the others are those of the platform::

    m0 + Im(conj(n) (e - O)) = 0          the pin carries no moment
    e - P - exp(i phi) r     = 0          the end is at its pin
    sum n - F                = 0          the tips carry the dead load
    sum Im(conj(exp(i phi) r) n) - M = 0  about P

Source: Pérez Gámiz 2018, eqs 98 and 109; its eqs 104 and 113 have the wrong sign of F, and its last
moment equation, about the frame's origin, is a combination of these rows with the same determinant.
"""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.rods.assembly import Assembly
from proofmass.base.arrays import Array, Complex


def _odd_palindrome(first: list[float]) -> tuple[float, ...]:
    """A palindrome of sum 1 with an odd count, from the numbers before the middle one."""
    return (*first, 1.0 - 2.0 * sum(first), *first[::-1])


def _even_palindrome(first: list[float]) -> tuple[float, ...]:
    """A palindrome of sum 1 with an even count, from its first half without the last number."""
    half = [*first, 0.5 - sum(first)]
    return (*half, *half[::-1])


HINGE_SHARES = _odd_palindrome(
    [
        0.0378593198406116,
        0.102635633102435,
        -0.0258678882665587,
        0.314241403071447,
        -0.130144459517415,
        0.106417700369543,
        -0.00879424312851058,
    ]
)
STATE_COPIES, MAX_RODS_WITH_COPIES = 3, 64  # instead of broadcasting, for fewer rods
MAX_ROD_STEPS = 500  # five times those for eight inflections; rods that need more are inaccurate
SEGMENT_SHARES = _even_palindrome(
    [
        0.09171915262446165,
        0.183983170005006,
        -0.05653436583288827,
        0.004914688774712854,
        0.143761127168358,
        0.328567693746804,
    ]
)


def integrate_to_tip(
    angle: ArrayLike, moment: ArrayLike, force: ArrayLike, length: ArrayLike, stiffness: ArrayLike
) -> tuple[Complex, Array]:
    r"""Tip of planar inextensible rods, with derivatives with respect to m0, n_x and n_y.

    ::

        theta' = m/EI,   m' = n_x sin(theta) - n_y cos(theta),   x' = cos(theta),   y' = sin(theta)

    Parameters
    ----------
    angle : tangent at the clamp [rad], (...)
    moment : at the clamp, m0 [N m], (...)
    force : on the tip, n_x + i n_y [N], (...)
    length, stiffness : L [m] and EI [N m^2], (...)

    Returns
    -------
    z : ndarray (4, ...)
        Tip from the clamp, x + iy [m], and its derivatives with respect to m0, n_x, n_y.
    theta : ndarray (4, ...)
        Tangent at the tip [rad], and its derivatives.

    Notes
    -----
    The error is about 1e-11 of the length.  All rods of a batch take the largest number of steps
    that one of them needs, 4 + 5/2 L sqrt(|n|/EI + (m0/EI)^2/4).  Derivatives are those of the
    steps themselves: the same chain solves the variational equations.  Equations: J. Pérez Gámiz,
    TFG, UPV/EHU Bilbao 2018, eqs 30, 78, which uses forty steps of RK4, with an error of 1e-6 m,
    and forward differences.  Steps: S. Blanes and P. C. Moan, Practical symplectic partitioned
    Runge-Kutta and Runge-Kutta-Nyström methods, J. Comput. Appl. Math. 142, 2002, SRKN 14a.

    Examples
    --------
    A rod of length pi/2 bent into a quarter of a circle:

    >>> z, theta = integrate_to_tip(0.0, 1.0, 0.0, np.pi / 2, 1.0)
    >>> complex(z[0].round(9)), float(theta[0].round(9))
    ((1+1j), 1.570796327)
    """
    given = np.broadcast_arrays(
        np.asarray(angle, float), moment, np.asarray(force, complex), length, stiffness
    )
    shape = given[0].shape
    angle, m0, n, length, stiffness = (part.reshape(-1) for part in given)
    count = count_steps(m0, n, length, stiffness)
    # With few rods most of the time is spent in calls of NumPy, above all in those that broadcast.
    # The state is therefore stored three times, once for each of its three derivatives.  The signs
    # of the rows are chosen for the fewest calls.
    k, copies = n.size, STATE_COPIES if n.size < MAX_RODS_WITH_COPIES else 1
    base, rows = np.ones((copies, 1)), copies + 3
    turns = [np.tile(share * length / (count * stiffness), (rows, 1)) for share in HINGE_SHARES]
    ways = [share * length / count for share in SEGMENT_SHARES]
    signed = [np.concatenate([base * way, -base * way]) for way in ways]
    place, product, displacement = (np.zeros((2 * rows, k)) for _ in range(3))  # y, -x, -dy, -dx
    by_force = np.concatenate([base * n.real, base * n.imag, [-n.real] * 3, [n.imag] * 3])
    theta, lever, rotation = (np.zeros((rows, k)) for _ in range(3))
    theta[:copies] = angle
    addend = np.concatenate([base * m0, np.ones((1, k)), np.zeros((2, k))])  # m0, 1, y, -x
    y, x, dy, dx = np.split(displacement, [copies, 2 * copies, 2 * copies + 3])
    parts = np.split(product, [copies, 2 * copies, 2 * copies + 3])
    (p_y, p_x, p_dy, p_dx), y_x, one_of_each = (
        parts,
        displacement[: 2 * copies],
        displacement[copies - 1 :][:2],
    )
    lever_base, lever_by, last_two = lever[:copies], lever[copies:], addend[-2:]
    tangent, twist, multiply, add = theta[:copies], theta[copies:], np.multiply, np.add

    def find_lever() -> None:
        multiply(by_force, place, product)
        add(p_y, p_x, lever_base)
        add(p_dy, p_dx, lever_by)
        add(lever, addend, lever)

    def turn_hinge(turn: Array) -> None:
        multiply(lever, turn, rotation)
        add(theta, rotation, theta)

    def move_on(way: Array) -> None:
        np.sin(tangent, y)
        np.cos(tangent, x)
        multiply(y_x, way, y_x)
        multiply(twist, x, dy)
        multiply(twist, y, dx)
        add(place, displacement, place)
        add(last_two, one_of_each, last_two)

    find_lever()
    for _ in range(count):
        for turn, way in zip(turns, signed, strict=False):
            if way is not signed[0]:  # the lever is known where the step before had its last hinge
                find_lever()
            turn_hinge(turn)
            move_on(way)
        find_lever()
        turn_hinge(turns[-1])
    z = np.empty((4, k), complex)
    z.real[0], z.imag[0] = 0.0 - place[copies], place[0]
    z.real[1:], z.imag[1:] = 0.0 - place[-3:], 0.0 - place[-6:-3]
    return z.reshape(4, *shape), theta[copies - 1 :].reshape(4, *shape)


def count_steps(moment: Array, force: Complex, length: Array, stiffness: Array) -> int:
    """Number of steps that the most bent rod of a batch needs, at most `MAX_ROD_STEPS`."""
    rate = np.sqrt(np.abs(force) / stiffness + (moment / stiffness) ** 2 / 4.0)
    return int(min(np.ceil(4.0 + 2.5 * np.nanmax(length * rate, initial=0.0)), MAX_ROD_STEPS))


Columns = NDArray[np.int_]


@dataclass(frozen=True)
class RodState:
    """States (...) of one assembly of k rods whose platform has p degrees of freedom.

    Attributes
    ----------
    assembly : Assembly
    vector : ndarray (..., 4 k + 2 p)
        m0, n_x, n_y of each rod, pose, inputs, load [SI].
    """

    assembly: Assembly
    vector: Array

    def __getitem__(self, which: int | Columns | NDArray[np.bool_]) -> "RodState":
        """One state of a batch, or several of them."""
        return RodState(self.assembly, np.array(self.vector[which]))

    def part(self, name: str) -> Array:
        """Columns of `vector`: "rods", "pose", "inputs" or "load"."""
        return self.vector[..., columns(self.assembly, name)]

    def with_parts(self, **parts: ArrayLike) -> "RodState":
        """The same states with other values of some parts: pose, inputs or load."""
        vector = self.vector
        for name, value in parts.items():
            where = columns(self.assembly, name)
            given = _finite_rows(name, value, where.size)
            vector = np.broadcast_to(
                vector,
                (*np.broadcast_shapes(given.shape[:-1], vector.shape[:-1]), vector.shape[-1]),
            ).copy()
            vector[..., where] = given
        return RodState(self.assembly, vector)

    @property
    def moment(self) -> Array:
        """Moments at the clamps [N m], (..., k)."""
        return self.part("rods")[..., 0::3]

    @property
    def force(self) -> Array:
        """Forces of the platform on the tips [N], (..., k, 2)."""
        rods = self.part("rods")
        return np.stack([rods[..., 1::3], rods[..., 2::3]], axis=-1)

    @property
    def pose(self) -> Array:
        """x, y [m] of the platform's origin, and its angle phi [rad] if it is no pin, (..., p)."""
        return self.part("pose")

    @property
    def inputs(self) -> Array:
        """Angles that motors add to the clamps [rad], or positions on the guides [m], (..., k)."""
        return self.part("inputs")

    @property
    def load(self) -> Array:
        """Dead force [N] on the platform at its origin, and moment [N m] if it is no pin."""
        return self.part("load")

    @property
    def energy(self) -> Array:
        r"""Bending energy of each rod [J], (..., k).

        With m^2/(2 EI) + n . t = H, a constant along the rod, U = integral m^2/(2 EI) ds =
        H L - n . (p(L) - p(0)).  The program of Pérez Gámiz 2018 lacks the factor 1/2 and has an
        error in its Simpson rule.
        """
        a = self.assembly
        theta, _, n = clamps_and_forces(self)
        z = integrate_to_tip(theta, self.moment, n, a.length, a.stiffness)[0][0]
        head = self.moment**2 / (2.0 * a.stiffness) + (n.conj() * np.exp(1j * theta)).real
        return np.asarray(head * a.length - (n.conj() * z).real)

    def shape(self, fraction: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """x, y [m], theta [rad] and moment [N m] at fractions (m,) of the lengths, (..., k, m)."""
        a = self.assembly
        share = np.asarray(fraction, float)
        theta, clamp, n = (value[..., None] for value in clamps_and_forces(self))
        m0, length, stiffness = (
            self.moment[..., None],
            a.length[:, None] * share,
            a.stiffness[:, None],
        )
        z, turn = integrate_to_tip(theta, m0, n, length, stiffness)
        point = clamp + z[0]
        return point.real, point.imag, turn[0], m0 + (n.conj() * z[0]).imag


def columns(a: Assembly, *names: str) -> Columns:
    """Indices of parts of a state in its vector, in the order of the names; a read-only array."""
    return cached_columns(a.rods, a.dof, names)


@cache
def cached_columns(k: int, p: int, names: tuple[str, ...]) -> Columns:
    """`columns` of an assembly with k rods and p degrees of freedom, computed once."""
    every = np.split(np.arange(4 * k + 2 * p), np.cumsum([3 * k, p, k]))
    parts = dict(zip(("rods", "pose", "inputs", "load"), every, strict=True))
    found = np.concatenate([parts[name] for name in names])
    found.setflags(write=False)
    return found


def state(
    a: Assembly,
    *,
    inputs: ArrayLike = 0.0,
    pose: ArrayLike = 0.0,
    load: ArrayLike = 0.0,
    moment: ArrayLike = 0.0,
    force: ArrayLike = 0.0,
) -> RodState:
    """A state, or a first guess of one, from its parts; each part may be a batch (...).

    Parameters
    ----------
    a : Assembly of k rods, p degrees of freedom
    inputs : (..., k) [rad or m]
    pose, load : (..., p) [m, rad], [N, N m]
    moment : m0 of each rod, (..., k) [N m]
    force : n of each rod, (..., k, 2) [N]
    """
    if not a.is_plain:
        raise ValueError(
            "two or more straight rods without loads of their own, pinned to a free platform, are "
            "wanted here; proofmass.analytic.rods.assembly_search takes all others"
        )
    k, p = a.rods, a.dof
    given = {"inputs": (inputs, k), "pose": (pose, p), "load": (load, p), "moment": (moment, k)}
    parts = {name: _finite_rows(name, value, width) for name, (value, width) in given.items()}
    n = np.asarray(force, float)
    n = np.zeros((k, 2)) if n.ndim == 0 else n
    if n.shape[-2:] != (k, 2):
        raise ValueError(f"force must hold x, y of {k} rods, (..., {k}, 2), got {n.shape}")
    shape = np.broadcast_shapes(n.shape[:-2], *(part.shape[:-1] for part in parts.values()))
    rods = np.concatenate(
        [
            np.broadcast_to(parts["moment"], (*shape, k))[..., None],
            np.broadcast_to(n, (*shape, k, 2)),
        ],
        axis=-1,
    ).reshape(*shape, 3 * k)
    rest = [
        np.broadcast_to(parts[name], (*shape, given[name][1]))
        for name in ("pose", "inputs", "load")
    ]
    return RodState(a, np.concatenate([rods, *rest], axis=-1))


def _finite_rows(name: str, value: ArrayLike, width: int) -> Array:
    """A part (..., width) of a state; ValueError for another shape or an infinite number."""
    given = np.asarray(value, float)
    given = np.full(width, given) if given.ndim == 0 else given
    if given.shape[-1] != width or not np.isfinite(given).all():
        raise ValueError(f"{name} must be finite, (..., {width}), got {value!r}")
    return given


def clamps_and_forces(s: RodState) -> tuple[Array, Complex, Complex]:
    """Tangents theta_i [rad] and positions [m] of the clamps, forces on the tips [N]: (..., k)."""
    a, q = s.assembly, s.inputs
    n = s.force @ np.array([1.0, 1.0j])
    if a.guide is None:
        return a.angle + q, np.broadcast_to(a.clamp, q.shape), n
    return np.broadcast_to(a.angle, q.shape), a.clamp + q * a.guide, n


ROD_STEP_TOLERANCE = 1e-8  # of the last step, in sizes of the unknowns; the error is its square
MAX_TRIAL_STEPS = 60  # largest number of trial steps of Newton's method
MAX_DISTANCE_FROM_GUESS = 1e3  # in sizes of the unknowns, beyond which a state is given up
MIN_STEP_FRACTION = 1e-2  # a Newton step is halved as long as its fraction is larger than this
RESIDUAL_ROUNDING = 1e-10  # residual over its size below which a step may increase it


def closure(s: RodState) -> tuple[Array, Array]:
    """Residuals (..., 3 k + p) and their Jacobian (..., 3 k + p, 4 k + 2 p) by the vector."""
    a, k = s.assembly, s.assembly.rods
    theta, clamp, n = clamps_and_forces(s)
    end, end_slopes = rod_ends(a, theta, s.moment, n)
    x, y, *phi = np.moveaxis(s.pose, -1, 0)
    arm = a.arm * np.exp(1j * phi[0])[..., None] if phi else np.zeros_like(n)
    violation = clamp + end - (x + 1j * y)[..., None] - arm
    carried = np.stack([s.moment + (n.conj() * end).imag, violation.real, violation.imag], axis=-1)
    f = [carried.reshape(*s.vector.shape[:-1], 3 * k), wrench(n, arm, a.dof) - s.load]
    jacobian = np.zeros((*s.vector.shape[:-1], 3 * k + a.dof, s.vector.shape[-1]))
    _fill_rod_rows(jacobian, a, n, end, end_slopes)
    _fill_platform_rows(jacobian, a, n, arm)
    return np.concatenate(f, axis=-1), jacobian


def rod_ends(a: Assembly, theta: Array, moment: Array, n: Complex) -> tuple[Complex, Complex]:
    """Rod ends (..., k) from their clamps, and derivatives (4, ..., k) by m0, n_x, n_y, theta.

    The derivative by theta follows from the rotation of the whole rod when the clamp and the force
    rotate together.
    """
    z, angle = integrate_to_tip(theta, moment, n, a.length, a.stiffness)
    rigid = a.rigid_extension * np.exp(1j * angle[0])
    end = z[0] + rigid
    by_load = z[1:] + 1j * rigid * angle[1:]
    by_theta = 1j * end + n.imag * by_load[1] - n.real * by_load[2]
    return end, np.concatenate([by_load, by_theta[None]])


def wrench(n: Complex, arm: Complex, dof: int) -> Array:
    """Sums (..., p) of the forces (..., k) on the tips and of their moments about P."""
    rows = [n.real, n.imag, (arm.conj() * n).imag]
    return np.stack([row.sum(axis=-1) for row in rows[:dof]], axis=-1)


def _fill_rod_rows(
    jacobian: Array, a: Assembly, n: Complex, end: Complex, end_slopes: Complex
) -> None:
    """Write the derivatives of the rods' rows by their moments and forces, and by their inputs."""
    explicit = np.stack([np.ones_like(end.real), end.imag, -end.real, np.zeros_like(end.real)])
    moment = (n.conj() * end_slopes).imag + explicit
    for i in range(a.rods):
        rows = slice(3 * i, 3 * i + 3)
        block = np.stack([moment, end_slopes.real, end_slopes.imag])[..., i]  # (row, column, ...)
        block = np.moveaxis(block, (0, 1), (-2, -1))
        jacobian[..., rows, rows] = block[..., :3]
        q = columns(a, "inputs")[i]
        if a.guide is None:
            jacobian[..., rows, q] = block[..., 3]
        else:
            jacobian[..., rows, q] = [0.0, a.guide[i].real, a.guide[i].imag]


def _fill_platform_rows(jacobian: Array, a: Assembly, n: Complex, arm: Complex) -> None:
    """Write the derivatives of all rows by the pose, and those of the platform's balance."""
    k, p = a.rods, a.dof
    balance = np.arange(3 * k, 3 * k + p)
    x, y, *phi = columns(a, "pose")
    force_x, force_y = np.arange(1, 3 * k, 3), np.arange(2, 3 * k, 3)
    jacobian[..., force_x, x] = jacobian[..., force_y, y] = -1.0
    jacobian[..., balance[0], force_x] = jacobian[..., balance[1], force_y] = 1.0
    jacobian[..., balance, columns(a, "load")] = -1.0
    if phi:
        jacobian[..., force_x, phi[0]], jacobian[..., force_y, phi[0]] = arm.imag, -arm.real
        jacobian[..., balance[2], force_x] = -arm.imag
        jacobian[..., balance[2], force_y] = arm.real
        jacobian[..., balance[2], phi[0]] = -(arm.conj() * n).real.sum(axis=-1)


def residual_and_state_sizes(a: Assembly) -> tuple[Array, Array]:
    """Sizes [SI] of the residuals (3 k + p,) and of a state's vector (4 k + 2 p,).

    Numbers of different units are divided by them before they are compared.
    """
    length, force, moment = a.scale
    rods, pose = np.tile([moment, force, force], a.rods), [length, length, 1.0][: a.dof]
    load = [force, force, moment][: a.dof]
    inputs = np.full(a.rods, 1.0 if a.guide is None else length)
    return (
        np.concatenate([np.tile([moment, length, length], a.rods), load]),
        np.concatenate([rods, pose, inputs, load]),
    )


class NewtonSolution(NamedTuple):
    """States that Newton's method found from first guesses.

    Attributes
    ----------
    states : RodState (n,)
        NaN where the method found no root.
    moved : ndarray (n,)
        Distance from the first guess, each column over its size [1]; inf where the state is NaN.
    side : ndarray (n,)
        Sign of the determinant of the problem that was solved [1].
    """

    states: RodState
    moved: Array
    side: Array


def newton(
    s: RodState, free: Columns, max_distance: ArrayLike = MAX_DISTANCE_FROM_GUESS
) -> tuple[RodState, Array]:
    """Find closed and balanced states by Newton's method, and their distances from guesses `s`."""
    found = close_states(s, free, max_distance)
    return found.states, found.moved


def close_states(
    s: RodState, free: Columns, max_distance: ArrayLike = MAX_DISTANCE_FROM_GUESS
) -> NewtonSolution:
    """Find states (n, ...) that are closed and in balance, by some columns of their vectors.

    A step of Newton's method is halved as long as it does not reduce the residual.  States for
    which no root is found are NaN.

    Parameters
    ----------
    s : RodState (n,)
        First guesses.
    free : columns of the vectors that are unknown; the others stay as they are
    max_distance : distance (n,) from the guess [1] at which a state is given up

    Returns
    -------
    `NewtonSolution`
    """
    a, scale = s.assembly, residual_and_state_sizes(s.assembly)[1]
    solutions, active = np.full_like(s.vector, np.nan), np.arange(len(s.vector))
    side = np.full(len(solutions), np.nan)
    current, fraction, max_distance = (
        s.vector,
        np.ones(len(solutions)),
        np.broadcast_to(max_distance, len(solutions)),
    )
    norm, step, _ = _newton_step(a, current, free)
    for _ in range(MAX_TRIAL_STEPS):
        trial = current + fraction[:, None] * step
        near = np.linalg.norm((trial - s.vector[active]) / scale, axis=-1) <= max_distance[active]
        keep = near & (fraction > MIN_STEP_FRACTION)
        active, current, fraction, norm, step, trial = (
            values[keep] for values in (active, current, fraction, norm, step, trial)
        )
        if not active.size:
            break
        new_norm, new_step, matrix = _newton_step(a, trial, free)
        accepted = (new_norm <= norm) | (new_norm < RESIDUAL_ROUNDING)
        converged = accepted & (np.linalg.norm(step / scale, axis=-1) < ROD_STEP_TOLERANCE)
        solutions[active[converged]], side[active[converged]] = (
            trial[converged],
            np.sign(determinant(matrix[converged])),
        )
        current, step = (
            np.where(accepted[:, None], *pair) for pair in ((trial, current), (new_step, step))
        )
        norm, fraction = np.where(accepted, new_norm, norm), np.where(accepted, 1.0, fraction / 2.0)
        active, current, fraction, norm, step = (
            values[~converged] for values in (active, current, fraction, norm, step)
        )
    moved = np.linalg.norm((solutions - s.vector) / scale, axis=-1)
    return NewtonSolution(RodState(a, solutions), np.where(np.isfinite(moved), moved, np.inf), side)


def _newton_step(a: Assembly, vector: Array, free: Columns) -> tuple[Array, Array, Array]:
    """Norms (n,) of the residuals over their sizes, Newton's steps (n, columns), and Jacobians."""
    rows, scale = residual_and_state_sizes(a)
    f, jacobian = closure(RodState(a, vector))
    f, jacobian = f / rows, jacobian[..., free] * scale[free] / rows[:, None]
    step = np.zeros_like(vector)
    step[:, free] = solve_linear(jacobian, -f) * scale[free]
    return np.linalg.norm(f, axis=-1), step, jacobian


def determinant(matrix: Array) -> Array:
    """Determinants (...); NaN of matrices with NaN."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.det(matrix))


def solve_linear(matrix: Array, right: Array) -> Array:
    """Solutions (n, m) of n linear systems; NaN where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full_like(right, np.nan)
        pairs = zip(matrix, right, strict=True)
        return np.concatenate([solve_linear(m[None], r[None]) for m, r in pairs])


def solve_direct(guess: RodState) -> RodState:
    r"""Equilibria at given inputs and load, each the one that Newton's method finds from its guess.

    Parameters
    ----------
    guess : RodState (...)
        Its inputs and its load are kept; forces, clamp moments and pose are found.

    Returns
    -------
    RodState (...)
        Closed and balanced within 1e-10 of the sizes EI/L^2, EI/L and L.

    Raises
    ------
    ValueError
        Newton's method with halved steps finds no equilibrium, or the guess is a straight rod
        without load, whose tip no force moves along the rod at first order.

    Notes
    -----
    There are several equilibria at the same inputs, stable and unstable ones; the guess selects
    one.  Source: Pérez Gámiz 2018, eqs 98, 102 (2RFR), 109, 112 (3PFR), with exact derivatives
    instead of forward differences.

    Examples
    --------
    Two rods that lean on each other, both bent outwards:

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.equilibrium import state
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> found = solve_direct(state(a, inputs=np.radians([60.0, 120.0]), pose=[0.0, 0.9],
    ...                      moment=[0.5, -0.5], force=[[-0.5, 0.0], [0.5, 0.0]]))
    >>> (found.pose.round(6) + 0.0).tolist()
    [0.0, 0.948938]
    """
    return solve_for(guess, "pose")


def solve_for(guess: RodState, unknown: str) -> RodState:
    """States closed by their forces, clamp moments and "pose" or "inputs".

    ValueError names the first guess from which Newton's method finds none.
    """
    flat = guess.vector.reshape(-1, guess.vector.shape[-1])
    result, _ = newton(RodState(guess.assembly, flat), columns(guess.assembly, "rods", unknown))
    failed = ~np.isfinite(result.vector).all(axis=-1)
    if failed.any():
        first = RodState(guess.assembly, flat[np.argmax(failed)])
        given = first.inputs if unknown == "pose" else first.pose
        raise ValueError(
            f"no equilibrium is found from the guess at "
            f"{'inputs' if unknown == 'pose' else 'pose'} {given.tolist()}, load "
            f"{first.load.tolist()}: begin nearer, or follow a path to it"
        )
    return RodState(guess.assembly, result.vector.reshape(guess.vector.shape))


def solve_inverse(guess: RodState) -> RodState:
    r"""Inputs that hold the platform at given poses under given loads.

    Parameters
    ----------
    guess : RodState (...)
        Its pose and its load are kept; forces, clamp moments and inputs are found.

    Returns
    -------
    RodState (...)
        Closed and balanced within 1e-10 of the sizes EI/L^2, EI/L and L.

    Raises
    ------
    ValueError
        The numbers of inputs and of degrees of freedom differ; a pose is out of reach of a rod; or
        Newton's method finds no equilibrium from the guess.

    Notes
    -----
    Source: Pérez Gámiz 2018, eqs 98, 99 (2RFR), 109, 111 (3PFR).  In the derivative by the slide
    its program has cos and sin of the clamp's angle instead of the guide's, which is right only
    where both angles are equal.

    Examples
    --------
    >>> from proofmass.analytic.rods.assembly import assembly
    >>> from proofmass.analytic.rods.equilibrium import state
    >>> a = assembly([[-0.3, 0.0], [0.3, 0.0]])
    >>> found = solve_inverse(state(a, inputs=[1.0, 2.0], pose=[0.0, 0.948938],
    ...                       moment=[0.5, -0.5], force=[[-0.5, 0.0], [0.5, 0.0]]))
    >>> np.degrees(found.inputs).round(2).tolist()
    [60.0, 120.0]
    """
    check_square(guess)
    check_reach(guess)
    return solve_for(guess, "inputs")


def check_square(s: RodState) -> None:
    """ValueError unless there are as many inputs as degrees of freedom."""
    a = s.assembly
    if a.rods != a.dof:
        raise ValueError(
            f"the inverse problem needs as many rods as degrees of freedom, got {a.rods} rods "
            f"and {a.dof}"
        )


def check_reach(s: RodState) -> None:
    """ValueError for the first pose whose pin is beyond the rods' reach."""
    a, (x, y, *phi) = s.assembly, np.moveaxis(s.pose, -1, 0)
    arm = a.arm * np.exp(1j * phi[0])[..., None] if phi else 0.0
    offset = (x + 1j * y)[..., None] + arm - a.clamp
    distance = np.abs(offset) if a.guide is None else np.abs((offset * a.guide.conj()).imag)
    excess = (distance - (a.length + a.rigid_extension)).reshape(-1, a.rods)
    if excess.max(initial=0.0) > 0.0:
        which, rod = np.unravel_index(np.argmax(excess > 0.0), excess.shape)
        pose = s.pose.reshape(-1, a.dof)[which].tolist()
        raise ValueError(
            f"pose {pose} is out of reach: rod {rod + 1} is too short by {excess[which, rod]:.6g} m"
        )


@dataclass(frozen=True)
class Derivatives:
    r"""First derivatives about equilibria (...) of k rods whose platform has p degrees of freedom.

    Attributes
    ----------
    direct : ndarray (..., p, k)
        dP/dq at constant load [m/rad, 1; 1, rad/m].
    inverse : ndarray (..., k, p)
        dq/dP at constant load [SI]; NaN unless k = p.
    compliance : ndarray (..., p, p)
        Derivative of the pose by the load at constant inputs [m/N, 1/N, 1/(N m)], the inverse of
        the stiffness.  It is also finite with a straight rod, which does not yield along itself.
    stiffness : ndarray (..., p, p)
        Derivative of the wrench that the rods need, d(sum n, sum r x n)/dP at constant inputs
        [N/m, N, N m].  It is symmetric, and positive definite where the platform is stable and
        each of its rods is stable with its pin fixed.
    direct_determinant : ndarray (...)
        Determinant of the Jacobian by (m0_1, n_1, m0_2, n_2, .., P) [SI].  It is zero in a direct
        singularity, a fold of the equilibria, where the inputs no longer constrain the platform
        and dP/dq is infinite.
    rod_determinants : ndarray (..., k)
        Determinant of each rod alone, by (m0, n) with its pin fixed [SI].  It is zero where a rod
        with both ends fixed buckles and the stiffness has a pole.  direct_determinant is
        det(stiffness) times all of them.
    inverse_determinant : ndarray (...)
        Determinant of the Jacobian by (m0_1, n_1, q_1, m0_2, n_2, q_2, ..) [SI].  It is zero in an
        inverse singularity, where some motion of the platform needs infinite rates of the inputs;
        NaN unless k = p.
    """

    direct: Array
    inverse: Array
    compliance: Array
    stiffness: Array
    direct_determinant: Array
    rod_determinants: Array
    inverse_determinant: Array


def derivatives(s: RodState) -> Derivatives:
    r"""Exact first derivatives about closed states, by the implicit function theorem.

    With the rows f of `proofmass.analytic.rods.equilibrium` and R the columns of all rods::

        det(dP/dq) = (-1)^(p + 3 k (k - 1)/2) inverse_determinant/direct_determinant

    The sign follows from the order of the unknowns in the source; it is -1 for 2RFR and +1 for
    3RFR.

    Notes
    -----
    Source: Pérez Gámiz 2018, eqs 99, 102, 111, 112 (unknowns and their order), text lines 4017-4050
    and 6994-7090.  Its text calls zeros of the two determinants inverse and direct singularities,
    as here; its program evaluates det(dq/dP) and det(dP/dq) instead, whose zeros are those of the
    *other* determinant, under the same two names.
    """
    a, (_, jacobian) = s.assembly, closure(s)
    rods, pose, inputs = (columns(a, name) for name in ("rods", "pose", "inputs"))
    free, k, p = columns(a, "rods", "pose"), a.rods, a.dof
    given = np.concatenate([inputs, columns(a, "load")])
    pose_by_inputs, compliance = np.split(
        implicit_derivatives(jacobian, free, given)[..., 3 * k :, :], [k], axis=-1
    )
    inputs_by_pose, inverse = (
        np.full((*pose_by_inputs.shape[:-2], k, p), np.nan),
        np.nan * pose_by_inputs[..., 0, 0],
    )
    if k == p:
        held = columns(a, "rods", "inputs")
        inputs_by_pose = implicit_derivatives(jacobian, held, pose)[..., 3 * k :, :]
        inverse = determinant(jacobian[..., singularity_columns(a, "inverse")])
    own = jacobian[..., : 3 * k, :]
    rods_by_pose = implicit_derivatives(own, rods, pose)
    balance = jacobian[..., 3 * k :, :]
    stiffness = balance[..., rods] @ rods_by_pose + balance[..., pose]
    own = np.stack(
        [determinant(own[..., 3 * i : 3 * i + 3, 3 * i : 3 * i + 3]) for i in range(k)], -1
    )
    return Derivatives(
        pose_by_inputs,
        inputs_by_pose,
        compliance,
        stiffness,
        determinant(jacobian[..., free]),
        own,
        inverse,
    )


def singularity_columns(a: Assembly, which: str) -> Columns:
    """Columns of the Jacobian whose determinant is zero in a "direct" or "inverse" singularity."""
    if which == "direct":
        return columns(a, "rods", "pose")
    rods, inputs = columns(a, "rods"), columns(a, "inputs")
    return np.concatenate([[*rods[3 * i : 3 * i + 3], inputs[i]] for i in range(a.rods)])


def implicit_derivatives(jacobian: Array, unknown: Columns, given: Columns) -> Array:
    """Derivatives of unknown columns by given ones while all rows stay zero; NaN if singular."""
    matrix, right = jacobian[..., unknown], -jacobian[..., given]
    rows, width = right.shape[-2:]
    flat = [
        solve_linear(matrix.reshape(-1, rows, rows), right[..., i].reshape(-1, rows))
        for i in range(width)
    ]
    return np.stack(flat, axis=-1).reshape(*right.shape[:-2], matrix.shape[-1], width)
