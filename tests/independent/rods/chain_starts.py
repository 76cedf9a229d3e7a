"""Equilibria of any assembly of rods by two formulations of their own, from random shapes.

Chains of rigid links with torsion springs, with Lagrange's multipliers for the attachments, lead
from random shapes to states near those of the rods.  Shooting with `scipy.integrate.solve_ivp`,
from the clamps, leads from these to the rods' own.  Neither uses wrenches on tips as coordinates,
elliptic functions or code of `proofmass.analytic`, apart from the data of the assembly.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from proofmass.analytic.rods.assembly_newton import RodProblem
from proofmass.base.arrays import Array

LINKS = 24  # of a rod
NEWTON_STEPS = 60
LONGEST_STEP = 0.6  # [rad] or share of the length
CONVERGED = 1e-9


@dataclass(frozen=True)
class ChainStates:
    """States (n,): angles (n, k, LINKS + 1), poses (n, 3), forces (n, k, 2), tip moments (n, k)."""

    angle: Array
    pose: Array
    force: Array
    moment: Array


def link_lengths() -> Array:
    """Lengths of the links of a rod of length 1: half ones at both ends."""
    lengths = np.full(LINKS + 1, 1.0 / LINKS)
    lengths[[0, -1]] /= 2.0
    return lengths


def random_states(problem: RodProblem, count: int, random: np.random.Generator) -> ChainStates:
    """Random shapes: bends of a few waves, the platform anywhere in reach, forces to match."""
    a, k = problem.assembly, problem.assembly.rods
    s = np.linspace(0.0, 1.0, LINKS + 1)
    waves = np.stack([s, np.sin(np.pi * s), np.sin(2 * np.pi * s), np.sin(3 * np.pi * s)])
    size = random.normal(0.0, 1.0, (count, k, 4)) * [3.0, 1.5, 1.0, 0.7]
    angle = problem.angle[:, None] + size @ waves
    angle[..., 0] = problem.angle
    centre = problem.clamp.mean()
    place = random.normal(0.0, 0.4, (count, 2)) * a.length.mean() + [centre.real, centre.imag]
    pose = np.column_stack([place, random.uniform(-np.pi, np.pi, count)])
    for c in range(3):
        if c not in a.free:
            pose[:, c] = 0.0 if np.isnan(a.held[c]) else a.held[c]
    unit = a.stiffness / a.length**2
    force = random.normal(0.0, 12.0, (count, k, 2)) * unit[:, None]
    return ChainStates(angle, pose, force, np.zeros((count, k)))


def chain_rests(problem: RodProblem, start: ChainStates) -> ChainStates:
    """States of chains at rest, stable or not, to which Newton's method leads."""
    a, k, free = problem.assembly, problem.assembly.rods, problem.assembly.free
    share, n = link_lengths(), len(start.pose)
    size = LINKS * k  # angles behind the clamps
    clamped = np.flatnonzero(a.clamped)
    multipliers = 2 * k + clamped.size
    angle, pose = start.angle.copy(), start.pose.copy()
    turns = np.round((angle[:, clamped, -1] - pose[:, 2:] - a.tip_angle[clamped]) / (2 * np.pi))
    force, moment = start.force.copy(), start.moment.copy()
    active, done = np.arange(n), np.zeros(n, bool)
    beyond = np.cumsum(share[::-1])[::-1] - share / 2.0  # lever of the weight, over the length
    for _ in range(NEWTON_STEPS):
        m = active.size
        if not m:
            break
        rows = size + free.size + multipliers
        matrix, right = np.zeros((m, rows, rows)), np.zeros((m, rows))
        balance = np.tile(problem.load, (m, 1))
        rotation = np.zeros(m)
        for i in range(k):
            length, spring = a.length[i] * share, a.stiffness[i] * LINKS / a.length[i]
            theta = angle[active, i]
            along = length * np.exp(1j * theta)
            n_tip = force[active, i] @ np.array([1.0, 1.0j])
            load = n_tip[:, None] + a.weight[i] * beyond * a.length[i]
            bend = spring * (np.diff(theta, axis=1) - a.curvature[i] * a.length[i] / LINKS)
            gradient = bend - np.pad(bend[:, 1:], ((0, 0), (0, 1)))
            gradient -= a.couple[i] * length[1:]
            gradient -= (np.conj(load) * 1j * along).real[:, 1:]
            own = slice(LINKS * i, LINKS * (i + 1))
            diagonal = 2.0 * spring - np.where(np.arange(LINKS) == LINKS - 1, spring, 0.0)
            block = np.zeros((m, LINKS, LINKS))
            block[:, range(LINKS), range(LINKS)] = diagonal + (np.conj(load) * along).real[:, 1:]
            block[:, range(LINKS - 1), range(1, LINKS)] = -spring
            block[:, range(1, LINKS), range(LINKS - 1)] = -spring
            matrix[:, own, own] = block
            arm = a.arm[i] * np.exp(1j * pose[active, 2])
            gap = (
                problem.clamp[i] + along.sum(axis=1) - arm - pose[active, 0] - 1j * pose[active, 1]
            )
            levers = np.stack([np.ones(m) + 0j, np.full(m, 1j), 1j * arm], axis=1)
            at = size + free.size + 2 * i
            for d, part in enumerate((np.real, np.imag)):
                matrix[:, at + d, own] = part(1j * along)[:, 1:]
                matrix[:, at + d, size : size + free.size] = -part(levers)[:, free]
                right[:, at + d] = part(gap)
            balance[:, :2] -= force[active, i]
            balance[:, 2] -= (np.conj(arm) * n_tip).imag
            rotation += (np.conj(arm) * n_tip).real
            if a.clamped[i]:
                j = int(np.flatnonzero(clamped == i)[0])
                row = size + free.size + 2 * k + j
                matrix[:, row, own.stop - 1] = 1.0
                if 2 in free:
                    matrix[:, row, size + int(np.flatnonzero(free == 2)[0])] = -1.0
                right[:, row] = (
                    theta[:, -1] - pose[active, 2] - a.tip_angle[i] - 2 * np.pi * turns[active, j]
                )
                gradient[:, -1] -= moment[active, i]
                balance[:, 2] -= moment[active, i]
            right[:, own] = gradient
        # V = E - F.P: its gradient by the platform is the wrench of the tips less the load
        right[:, size : size + free.size] = -balance[:, free]
        if 2 in free:
            at = size + int(np.flatnonzero(free == 2)[0])
            matrix[:, at, at] = -rotation
        split = size + free.size
        matrix[:, :split, split:] = -matrix[:, split:, :split].swapaxes(1, 2)
        matrix += 1e-14 * np.eye(rows)
        step = -np.linalg.solve(matrix, right[..., None])[..., 0]
        turn = np.abs(step[:, :size]).max(axis=1)
        scale = np.minimum(1.0, LONGEST_STEP / np.maximum(turn, 1e-12))
        moved = np.abs(step[:, size : size + 2]).max(axis=1) if free.size else 0.0 * turn
        scale = np.minimum(scale, LONGEST_STEP * a.length.mean() / np.maximum(moved, 1e-12))
        scaled = step * scale[:, None]
        angle[active, :, 1:] += scaled[:, :size].reshape(m, k, LINKS)
        for c, coordinate in enumerate(free):
            pose[active, coordinate] += scaled[:, size + c]
        change = scaled[:, split:]
        force[active] += change[:, : 2 * k].reshape(m, k, 2)
        moment[np.ix_(active, clamped)] += change[:, 2 * k :]
        done[active] = (turn < CONVERGED) & (scale == 1.0)
        going = np.isfinite(turn) & ~done[active]
        active = active[going]
    return ChainStates(angle[done], pose[done], force[done], moment[done])


def shoot(problem: RodProblem, unknowns: Array) -> Array:
    """Gaps and unbalance of rods that are integrated from their clamps.

    Unknowns are, for each rod, the moment m at the clamp and the force on the tip, in its units,
    and the platform's free coordinates.
    """
    a, k = problem.assembly, problem.assembly.rods
    pose = np.where(np.isnan(a.held), 0.0, a.held)
    pose[a.free] = unknowns[3 * k :]
    rows, balance = [], -problem.load.copy()
    length, unit, bend = a.scale
    for i in range(k):
        m0 = unknowns[3 * i] * a.stiffness[i] / a.length[i]
        n = unknowns[3 * i + 1 : 3 * i + 3] * a.stiffness[i] / a.length[i] ** 2
        w, total = a.weight[i], a.length[i]

        begin = [problem.clamp[i].real, problem.clamp[i].imag, problem.angle[i], m0]
        rod = (n, w, total, a.stiffness[i], a.curvature[i], a.couple[i])
        found = solve_ivp(rod_rate, (0.0, total), begin, "DOP853", None, args=rod, **TOLERANCES)
        x, y, theta, m = found.y[:, -1]
        arm = a.arm[i] * np.exp(1j * pose[2])
        rows += [(x - pose[0] - arm.real) / length, (y - pose[1] - arm.imag) / length]
        if a.clamped[i]:
            rows.append(np.sin(0.5 * (theta - pose[2] - a.tip_angle[i])))
        else:
            rows.append(m / bend)
        balance += [n[0], n[1], arm.real * n[1] - arm.imag * n[0] + (m if a.clamped[i] else 0.0)]
    return np.append(rows, (balance / [unit, unit, bend])[a.free])


TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}


def rod_rate(
    s: float,
    y: Array,
    n: Array,
    w: complex,
    total: float,
    bend: float,
    natural: float,
    couple: float,
) -> list[float]:
    """Derivatives of x, y, theta and m along a rod: the equations of the source."""
    x_load, y_load = n[0] + w.real * (total - s), n[1] + w.imag * (total - s)
    cos, sin = np.cos(y[2]), np.sin(y[2])
    return [cos, sin, y[3] / bend + natural, x_load * sin - y_load * cos - couple]


def shot_equilibrium(problem: RodProblem, chains: ChainStates, which: int) -> Array | None:
    """The unknowns of `shoot` at the equilibrium near a chain's, or None if there is none."""
    a = problem.assembly
    guess = []
    for i in range(a.rods):
        theta = chains.angle[which, i]
        bend = a.stiffness[i] * (
            (-1.5 * theta[0] + 2.0 * theta[1] - 0.5 * theta[2]) * LINKS / a.length[i]
            - a.curvature[i]
        )
        guess += [
            bend * a.length[i] / a.stiffness[i],
            *(chains.force[which, i] * a.length[i] ** 2 / a.stiffness[i]),
        ]
    start = np.append(guess, chains.pose[which, a.free])
    found = root(lambda u: shoot(problem, u), start, tol=1e-10)
    good = np.abs(shoot(problem, found.x)).max() < 1e-6
    return np.asarray(found.x) if good else None
