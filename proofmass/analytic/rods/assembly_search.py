r"""All equilibria of any planar assembly of rods, without a first guess.

Rods may be precurved, heavy, under couples, pinned or clamped to a platform that is free or held.

Newton's method (`assembly_newton`) leads to equilibria from batches of random starts.  In half of
them rods are bent in a few waves, with a platform anywhere in reach and forces that do not balance;
in the others rods have exact shapes under random loads and fit their clamps, but not each other.
Its unknowns need not fit together, so that nothing is solved before.  The search ends after some
batches without anything new: its completeness is tested, not proven.

Plain assemblies (see `assembly`) are searched by the closed form of `all_equilibria` instead, whose
loads have a proven bound, and their equilibria are solved once more here.

**Stability.** The second variation of the potential has, by Jacobi's field for each rod with a free
tip and the inertia of bordered matrices,

    sum_i zeros of Jacobi's field + negative eigenvalues of [[-C, A], [A', G]] - rows of C

negative directions, where C has the compliances of the tips, (2, 2) if pinned and else (3, 3), A
their motions by the platform, and G is the stiffness of the loads on it: the tips are free at
first, and the rows of C are the constraints that attach them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import simpson

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods.all_equilibria import Solutions, solutions, theoretical_bound
from proofmass.analytic.rods.assembly import Assembly
from proofmass.analytic.rods.assembly_newton import (
    OWN,
    SEGMENTS,
    RodGuess,
    RodProblem,
    bend_rods,
    join_guesses,
    newton_step,
    solve_guesses,
)
from proofmass.analytic.rods.equilibrium import state as rod_state
from proofmass.analytic.rods.tip_wrench import (
    FINE_STEPS,
    ROUGH_STEPS,
    NaturalRods,
    RodPath,
    march_from_tip,
    path_from_tip,
)
from proofmass.base.arrays import Array, Complex, Index

Advance = Callable[[str, int, int], None]
"""A function ``advance(label, done, total)`` that shows progress."""


@dataclass(frozen=True)
class SearchLimits:
    """How far an assembly is searched.

    Attributes
    ----------
    inflections : int
        Most changes of sign of the curvature of a rod; a straight rod has one at its pinned tip.
    alpha : float
        Largest alpha = L sqrt(R/EI) of the force R on the tip of any rod [1].
    turns : float
        Most turns by which a rod that is clamped at both ends may be twisted in the plane, from
        clamp to tip [1].
    """

    inflections: int = 2
    alpha: float = 12.0
    turns: float = 1.0


def held_value(a: Assembly, c: int) -> Array:
    """The value of a held coordinate; that of the angle of a pin is zero."""
    return np.array([a.held[c] if np.isfinite(a.held[c]) else 0.0])


def first_of_cells(rows: Array, size: float) -> Index:
    """Indices, in order, of the first of the rows (n, m) in each cell of a grid."""
    return np.sort(np.unique(np.floor(rows / size), axis=0, return_index=True)[1])


def state_rows(problem: RodProblem, guess: RodGuess) -> Array:
    """Coordinates (n, 3 k + 4) of states by whose differences they are told apart [1]."""
    a = problem.assembly
    own = guess.own[..., :3] / np.stack([problem.units(i)[:3] for i in range(a.rods)])
    force = own[..., 0] + 1j * own[..., 1]
    root = force / np.sqrt(np.maximum(np.abs(force), 1e-12))
    third = np.where(a.clamped, np.arcsinh(own[..., 2]), 0.0)
    place, phi = guess.pose[:, :2] / a.length.mean(), guess.pose[:, 2:]
    return np.concatenate([place, np.cos(phi), np.sin(phi), root.real, root.imag, third], axis=1)


def random_guesses(problem: RodProblem, limits: SearchLimits, count: int, seed: int) -> RodGuess:
    """Random starts, half of them waves and half of them exact shapes of rods."""
    dice, half = np.random.default_rng(seed), count // 2
    parts = [wavy_guesses(problem, limits, count - half, dice)]
    return join_guesses([*parts, bent_guesses(problem, limits, half, dice)], problem.assembly.rods)


def wavy_guesses(
    problem: RodProblem, limits: SearchLimits, count: int, dice: np.random.Generator
) -> RodGuess:
    """Starts whose rods are bent in a few waves, the platform in reach, and forces of any kind."""
    a = problem.assembly
    own, pose = np.zeros((count, a.rods, OWN)), np.zeros((count, 3))
    centre = problem.clamp.mean()
    pose[:, :2] = dice.normal(0.0, 0.4 * a.length.mean(), (count, 2))
    pose[:, :2] += np.array([centre.real, centre.imag])
    pose[:, 2] = dice.uniform(-np.pi, np.pi, count)
    hold_coordinates(a, pose)
    s = 1.0 - np.arange(SEGMENTS) / SEGMENTS  # from the tip to the last node
    waves = np.stack([s, *(np.sin(j * np.pi * s) for j in (1, 2, 3))])
    slopes = np.stack([1.0 + 0.0 * s, *(j * np.pi * np.cos(j * np.pi * s) for j in (1, 2, 3))])
    for i in range(a.rods):
        size = dice.normal(0.0, 1.0, (count, 4)) * WAVE_SIZES
        angle, bend = problem.angle[i] + size @ waves, size @ slopes
        force = dice.normal(0.0, 0.3 * limits.alpha, (count, 2))
        force *= np.hypot(force[:, :1], force[:, 1:])  # the root of the force is spread evenly
        third = bend[:, 0] if a.clamped[i] else angle[:, 0]
        if a.clamped[i]:
            turn = pose[:, 2] + a.tip_angle[i] - angle[:, 0]
            angle = angle + (TURN * np.round(turn / TURN))[:, None]
        nodes = np.stack([angle[:, 1:], bend[:, 1:]], axis=-1).reshape(count, -1)
        own[:, i] = np.column_stack([force, third, nodes]) * problem.units(i)
    return RodGuess(own, pose)


def bent_guesses(
    problem: RodProblem, limits: SearchLimits, count: int, dice: np.random.Generator
) -> RodGuess:
    """Starts whose rods have exact shapes under random loads and fit their clamps.

    A rod is integrated from its tip, whose load has any direction and a moment if it is clamped,
    and is turned as a whole so that its clamp has the right angle; only its weight is left out.
    The platform is where the tips are on average.  High loads are found by these starts, since no
    random wave is near the shape of a rod with a large force.
    """
    a = problem.assembly
    own, pose = np.zeros((count, a.rods, OWN)), np.zeros((count, 3))
    tips, turns = np.zeros((count, a.rods), complex), np.zeros((count, a.rods))
    none = np.zeros(count)
    for i in range(a.rods):
        rod = problem.unit_rod(i)
        light = NaturalRods(rod.curvature, rod.slope, 0.0 * rod.weight)
        alpha = limits.alpha * np.sqrt(dice.uniform(0.0, 1.0, count))
        force = alpha**2 * np.exp(1j * dice.uniform(-np.pi, np.pi, count))
        bend = dice.normal(0.0, TIP_BEND * limits.alpha, count) * float(a.clamped[i])
        nodes = states_at_nodes(light, force, bend, none)
        end = march_from_tip(light, force, bend, none, rule=ROUGH_STEPS, slopes=False)
        turn = problem.angle[i] - end.angle[0]
        turned = np.exp(1j * turn)
        tips[:, i], turns[:, i] = problem.clamp[i] - a.length[i] * end.base[0] * turned, turn
        force = force * turned
        nodes[:, 0::2] += turn[:, None]
        third = bend if a.clamped[i] else turn
        own[:, i] = np.column_stack([force.real, force.imag, third, nodes]) * problem.units(i)
    pose[:, 2] = dice.uniform(-np.pi, np.pi, count)
    clamped = np.flatnonzero(a.clamped)
    if clamped.size:
        led = clamped[dice.integers(0, clamped.size, count)]  # a rod that turns the platform
        pose[:, 2] = turns[np.arange(count), led] - a.tip_angle[led]
    hold_coordinates(a, pose)
    place = (tips - a.arm * np.exp(1j * pose[:, 2:])).mean(axis=1)
    pose[:, 0], pose[:, 1] = place.real, place.imag
    hold_coordinates(a, pose)
    for i in map(int, clamped):
        whole = TURN * np.round((pose[:, 2] + a.tip_angle[i] - turns[:, i]) / TURN)
        own[:, i, 3::2] += whole[:, None]
    return RodGuess(own, pose)


def hold_coordinates(a: Assembly, pose: Array) -> None:
    """Set the held coordinates of poses (n, 3), in place."""
    for c in np.setdiff1d(range(3), a.free):
        pose[:, c] = held_value(a, int(c))


ROUGH_NODES = 41
"""Nodes of a rod along which the inflections of a rough state are counted."""
STARTS_AT_ONCE = 4000
"""Random starts in a batch, whose seed is its number."""
IDLE_BATCHES, MAX_BATCHES = 3, 25
"""Batches without anything new after which a search ends, and most batches."""
ALPHA_MARGIN = 1.01
"""Ratio to the largest alpha that rough states may have: they are solved once more."""
TIP_BEND = 0.5
"""Standard deviation of the moment on a clamped tip, over alpha EI/L: the largest of a rod is 2."""
WAVE_SIZES = np.array([3.0, 1.5, 1.0, 0.7])
"""Standard deviations [rad] of a random rod's turn from end to end, and of its sines."""


def search_equilibria(
    problem: RodProblem, limits: SearchLimits, advance: Advance | None = None
) -> tuple[RodGuess, float]:
    """Equilibria by random starts, each once, and the least residual of all starts [1].

    Their inflections are not yet limited.  The search ends when `IDLE_BATCHES` batches of starts in
    succession find no new equilibrium within the load and with as few inflections.
    """
    a, most = problem.assembly, (MAX_FORCE_RATIO * limits.alpha) ** 2
    known, nearest, idle, within = join_guesses([], a.rods), np.inf, 0, 0
    for batch in range(MAX_BATCHES):
        if advance:
            advance("batches of random starts", batch, MAX_BATCHES)
        starts = random_guesses(problem, limits, STARTS_AT_ONCE, batch)
        ended, converged, least = solve_guesses(problem, starts, ROUGH_STEPS, ROUGH_TOLERANCE, most)
        nearest, new = min(nearest, least), ended[converged]
        new = new[largest_alpha(problem, new) <= limits.alpha * ALPHA_MARGIN]
        before = within
        known = distinct_states(problem, join_guesses([known, new], a.rods), ROUGH_DISTANCE)
        within = int(few_inflections(problem, known, limits.inflections).sum())
        idle = 0 if within > before else idle + 1
        if idle == IDLE_BATCHES:
            break
    if advance:
        advance("batches of random starts", MAX_BATCHES, MAX_BATCHES)
    return known, nearest


def few_inflections(problem: RodProblem, guess: RodGuess, most: int) -> NDArray[np.bool_]:
    """Whether no rod of states (n,) has more inflections, by a count along `ROUGH_NODES` nodes."""
    few = np.ones(len(guess), bool)
    for i in range(problem.assembly.rods) if len(guess) else ():
        path = rod_path(problem, guess, i, ROUGH_NODES)
        few &= path.inflections + ends_straight(problem.assembly, i) <= most
    return few


def largest_alpha(problem: RodProblem, guess: RodGuess) -> Array:
    """Largest alpha (n,) of the rods of states."""
    unit = problem.assembly.stiffness / problem.assembly.length**2
    force = np.hypot(guess.own[..., 0], guess.own[..., 1])
    return np.asarray(np.sqrt(force / unit).max(axis=1))


def states_at_nodes(rods: NaturalRods, force: Complex, moment: Array, angle: Array) -> Array:
    """Angles and moments M (n, 2 SEGMENTS - 2) at the nodes of rods of unit length."""
    rows: list[Array] = []
    for j in range(SEGMENTS - 1):
        at = j / SEGMENTS
        piece = NaturalRods(rods.curvature + rods.slope * at, rods.slope, rods.weight)
        found = march_from_tip(
            piece,
            force + rods.weight * at,
            moment,
            angle,
            rule=FINE_STEPS,
            length=1 / SEGMENTS,
            slopes=False,
        )
        angle, moment = found.angle[0], found.moment[0]
        rows += [angle, moment]
    return np.stack(rows, axis=-1)


def distinct_states(problem: RodProblem, guess: RodGuess, size: float) -> RodGuess:
    """One of each group of states whose coordinates differ by less than `size` [1]."""
    rows = state_rows(problem, guess)
    kept: list[int] = []
    for i in first_of_cells(rows, size):
        if not kept or np.abs(rows[kept] - rows[i]).max(axis=1).min() > size:
            kept.append(int(i))
    return guess[np.array(kept, int)]


def closed_form_states(problem: RodProblem, found: Solutions) -> RodGuess:
    """States of equilibria of the closed form, of a plain assembly."""
    a, n = problem.assembly, len(found)
    guess = RodGuess(np.zeros((n, a.rods, OWN)), np.zeros((n, 3)))
    guess.pose[:, : a.dof] = found.state.pose
    place = guess.pose[:, 0] + 1j * guess.pose[:, 1]
    for i in range(a.rods):
        unit, rods = problem.units(i), problem.unit_rod(i)
        force = found.state.force[:, i] @ np.array([1.0, 1.0j]) / unit[0]
        away = 2.0 * np.arcsin(np.minimum(found.complement[:, i], 1.0))
        tries = []
        for side in (1.0, -1.0):  # the tip's tangent is to either side of the load
            angle = np.angle(force) + side * away
            nodes = states_at_nodes(rods, force, np.zeros(n), angle)
            own = np.column_stack([force.real, force.imag, angle, nodes]) * unit
            arm = a.arm[i] * np.exp(1j * guess.pose[:, 2])
            bent = bend_rods(problem, i, own, place + arm, guess.pose[:, 2], FINE_STEPS)
            tries.append((np.abs(bent.gap).max(axis=1), own))
        closer = (tries[0][0] <= tries[1][0])[:, None]
        guess.own[:, i] = np.where(closer, tries[0][1], tries[1][1])
    return guess


@dataclass(frozen=True)
class RodEquilibria:
    """Equilibria (n,) of an assembly of k rods, the lowest potential first.

    Attributes
    ----------
    problem : RodProblem
    state : RodGuess (n,)
        Forces and moments on the tips, and poses [SI].
    clamp_moment : ndarray (n, k)
        Moment of each rod at its clamp, which holds it there [N m].
    energy, potential : ndarray (n,)
        Energy of bending of all rods, and that less the work of all dead loads [J].
    index : ndarray (n,)
        Number of negative directions of the potential [1]; 0 is stable.
    inflections : ndarray (n, k)
        Changes of sign of the curvature of each rod [1]; a straight rod has one at its pinned tip.
    alpha : ndarray (n, k)
        L sqrt(R/EI) of the force R on each tip [1].
    residual : ndarray (n,)
        Largest gap and unbalance, in sizes of the rods [1].
    limits : SearchLimits
    bound : float
        alpha [1] that no rod of any equilibrium exceeds, by proof; inf without one.
    nearest : float
        Least residual of all starts [1], which says how near the search came if it found nothing.
    """

    problem: RodProblem
    state: RodGuess
    clamp_moment: Array
    energy: Array
    potential: Array
    index: Index
    inflections: Index
    alpha: Array
    residual: Array
    limits: SearchLimits
    bound: float
    nearest: float

    def __len__(self) -> int:
        return len(self.state)

    def only(self, n: int) -> "RodEquilibria":
        """Equilibrium n alone."""
        one = np.array([n])
        parts = ("state", "clamp_moment", "energy", "potential", "index", "inflections", "alpha")
        return replace(self, **{name: getattr(self, name)[one] for name in (*parts, "residual")})

    @property
    def is_bounded(self) -> bool:
        """Whether it is proven that no equilibrium has larger loads than those of the search."""
        return bool(self.limits.alpha >= self.bound)

    def paths(self, nodes: int) -> list[RodPath]:
        """Each rod in all equilibria, at this number of nodes from its tip to its clamp."""
        return [
            rod_path(self.problem, self.state, i, nodes) for i in range(self.problem.assembly.rods)
        ]


def rod_path(problem: RodProblem, state: RodGuess, i: int, nodes: int | Array) -> RodPath:
    """Rod i of states (n,), in units of its length and stiffness but for the world's axes."""
    a, own = problem.assembly, state.own[:, i, :3] / problem.units(i)[:3]
    clamped = a.clamped[i]
    angle = state.pose[:, 2] + a.tip_angle[i] if clamped else own[:, 2]
    moment = own[:, 2] if clamped else np.zeros(len(state))
    path = path_from_tip(problem.unit_rod(i), own[:, 0] + 1j * own[:, 1], moment, angle, nodes)
    turns = TURN * np.round((path.angle[-1] - problem.angle[i]) / TURN)
    return replace(path, angle=path.angle - turns)


def describe_equilibria(
    problem: RodProblem, state: RodGuess, limits: SearchLimits, bound: float, nearest: float
) -> RodEquilibria:
    """Equilibria within the limits, by the states to which Newton's method leads from these."""
    a = problem.assembly
    state, converged, _ = solve_guesses(problem, state, FINE_STEPS, FINE_TOLERANCE)
    state = distinct_states(problem, state[converged], SAME_DISTANCE)
    if 2 in a.free:
        turned = -TURN * np.round(state.pose[:, 2] / TURN)
        state.pose[:, 2] += turned
        state.own[:, a.clamped, 3::2] += turned[:, None, None]  # nodes are counted from the tip
    step = newton_step(problem, state, FINE_STEPS)
    unit = a.stiffness / a.length**2
    alpha = np.sqrt(np.hypot(state.own[..., 0], state.own[..., 1]) / unit)
    shape = (len(state), a.rods)
    moment, inflections = np.zeros(shape), np.zeros(shape, int)
    energy, work, index, turns = (np.zeros(len(state)) for _ in range(4))
    for i in range(a.rods):
        path = rod_path(problem, state, i, PATH_NODES)
        bend = a.stiffness[i] / a.length[i]
        inflections[:, i] = path.inflections + ends_straight(a, i)
        moment[:, i] = bend * path.moment[-1]
        energy += bend * integral(0.5 * path.moment**2)
        place = tip_places(a, state, i) + a.length[i] * path.position
        load = (a.weight[i].conj() * place).real + a.couple[i] * path.angle
        work += a.length[i] * integral(load)
        size = 3 if a.clamped[i] else 2
        index += path.negative - size
        turned = np.abs(path.angle[0] - path.angle[-1])
        turns = np.maximum(turns, np.where(a.clamped[i], turned, 0.0))
    index += count_negative_eigenvalues(step.bordered)
    potential = energy - work - state.pose @ problem.load
    keep = (step.residual < CLOSED_RESIDUAL) & (alpha <= limits.alpha).all(axis=1)
    keep &= (inflections <= limits.inflections).all(axis=1)
    keep &= turns <= TURN * limits.turns + TURN_ROUNDING
    order = np.flatnonzero(keep)[np.argsort(potential[keep])]
    return RodEquilibria(
        problem,
        state[order],
        moment[order],
        energy[order],
        potential[order],
        index.astype(int)[order],
        inflections[order],
        alpha[order],
        step.residual[order],
        limits,
        bound,
        nearest,
    )


def ends_straight(a: Assembly, i: int) -> bool:
    """Whether the curvature of rod i is zero at its tip: it is straight by nature, and pinned."""
    return not (a.clamped[i] or a.curvature[i])


def tip_places(a: Assembly, state: RodGuess, i: int) -> Complex:
    """Positions (n,) of the tip of rod i, x + iy [m]."""
    pose = state.pose
    return np.asarray(pose[:, 0] + 1j * pose[:, 1] + a.arm[i] * np.exp(1j * pose[:, 2]))


def integral(values: Array) -> Array:
    """Integrals (n,) over a unit length of values (nodes, n), by Simpson's rule."""
    return np.asarray(simpson(values, dx=1.0 / (len(values) - 1), axis=0))


def count_negative_eigenvalues(matrix: Array) -> Index:
    """Number of negative eigenvalues (n,) of symmetric matrices (n, p, p)."""
    even = 0.5 * (matrix + matrix.swapaxes(1, 2))
    even = np.nan_to_num(even)
    return np.asarray((np.linalg.eigvalsh(even) < 0.0).sum(axis=1))


PATH_NODES = 201
"""Nodes of a rod along which energies are integrated and changes of sign are counted: 25 to a wave
of alpha = 50."""
ROUGH_TOLERANCE, FINE_TOLERANCE = 1e-5, 1e-6
"""Size of the last step of a rough and of a fine solution; the error is about its square, or the
rounding of the integration."""
ROUGH_DISTANCE, SAME_DISTANCE = 3e-4, 1e-6
"""Largest difference of rough and of fine states that are the same."""
CLOSED_RESIDUAL = 1e-8
"""Largest gap and unbalance of an equilibrium, in sizes of the rods."""
TURN_ROUNDING = 1e-6
"""[rad] by which a rod may turn by more than its limit: its integration is that accurate."""
MAX_FORCE_RATIO = 1.5
"""alpha beyond which a start is given up, over the largest one that is searched."""
LARGEST_PLAIN_ALPHA = 20.0
"""alpha up to which plain assemblies are searched: beyond it starts are drawn at random there, and
the integration from the tip loses digits."""


def find_equilibria(
    problem: RodProblem, limits: SearchLimits, advance: Advance | None = None
) -> RodEquilibria:
    """All equilibria of an assembly within limits.

    A plain assembly is searched by the closed form up to its proven bound, if that is less than
    the limit.

    Examples
    --------
    Two rods of a thesis (Table 7), of which it prints two equilibria of one inflection each:

    >>> from proofmass.analytic.rods.assembly import assembly
    >>> pair = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=0.052186)
    >>> problem = RodProblem(pair, np.radians([40.0, 60.0]), np.array([0.3, -0.1, 0.0]))
    >>> found = find_equilibria(problem, SearchLimits(inflections=1, alpha=10.0))
    >>> found.state.pose[:, :2].round(3).tolist(), found.index.tolist(), found.is_bounded
    ([[0.622, -0.242], [0.293, -0.341], [-0.081, -0.246]], [0, 0, 0], True)
    """
    if not problem.assembly.is_plain:
        found, nearest = search_equilibria(problem, limits, advance)
        return describe_equilibria(problem, found, limits, np.inf, nearest)
    given = rod_state(
        problem.assembly, inputs=problem.inputs, load=problem.load[: problem.assembly.dof]
    )
    modes = [limits.inflections] * problem.assembly.rods
    bound = theoretical_bound(given, modes, limits.alpha)
    reach = min(limits.alpha, bound)
    closed = solutions(
        problem.assembly,
        inputs=problem.inputs,
        load=problem.load[: problem.assembly.dof],
        modes=limits.inflections,
        most_load=max(1.0, reach),
    )
    return describe_equilibria(problem, closed_form_states(problem, closed), limits, bound, 0.0)
