"""All equilibria of random assemblies of rods, by the search, by random chains and by shooting.

    python -m docs.make.rod_assemblies [folder] [--quick]

Writes docs/rod_assemblies.md.  Assemblies are kept one by one in the folder (reports), so that a
call continues where another was interrupted.
"""

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks import ROOT, command, folders
from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.assembly_newton import RodProblem
from proofmass.analytic.rods.assembly_search import RodEquilibria, SearchLimits, find_equilibria
from proofmass.base.arrays import Array
from tests.independent.rods.chain_starts import (
    ChainStates,
    chain_rests,
    random_states,
    shoot,
    shot_equilibrium,
)

ASSEMBLIES, QUICK_ASSEMBLIES = 30, 1
STARTS, QUICK_STARTS = (1000, 3000), (60, 60)  # random shapes of each assembly, least and most
BATCH = 500  # of them
LIMITS, QUICK_LIMITS = SearchLimits(2, 7.0, 1.0), SearchLimits(1, 4.0, 1.0)
MARGIN = 0.02  # alpha by which a chain's equilibrium may exceed the limit, before it is shot
SAME = 1e-4  # largest difference of unknowns of one equilibrium, in sizes of the rods
Row = dict[str, Any]
Starts = tuple[int, int]


def random_assembly(seed: int) -> RodProblem:
    """Two or three rods, of any clamps, lengths and loads, pinned or clamped to a platform."""
    random = np.random.default_rng(seed)
    k = 2 + seed % 2
    angle = 2 * np.pi * np.arange(k) / k + random.uniform(-0.5, 0.5, k)
    clamp = random.uniform(0.3, 0.7, k)[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    arm = random.uniform(-0.15, 0.15, (k, 2))
    return RodProblem(
        assembly(
            clamp,
            length=random.uniform(0.9, 1.2, k),
            stiffness=random.uniform(0.5, 1.5, k),
            arm=arm,
            angle=angle + np.pi + random.uniform(-1.0, 1.0, k),
            clamped=random.random(k) < 0.4,
            tip_angle=random.uniform(-np.pi, np.pi, k),
            curvature=random.uniform(-1.5, 1.5, k),
            couple=random.uniform(-1.0, 1.0, k) * (random.random(k) < 0.5),
        ),
        np.zeros(k),
        random.uniform(-1.0, 1.0, 3) * [3.0, 3.0, 0.5],
    )


def shot_unknowns(found: RodEquilibria, n: int) -> Array:
    """The unknowns of shooting at equilibrium n of the search."""
    a, state = found.problem.assembly, found.state
    rods = [
        [
            (found.clamp_moment[n, i]) * a.length[i] / a.stiffness[i],
            *(state.own[n, i, :2] * a.length[i] ** 2 / a.stiffness[i]),
        ]
        for i in range(a.rods)
    ]
    return np.append(np.ravel(rods), state.pose[n, a.free])


def is_within(problem: RodProblem, unknowns: Array, limits: SearchLimits) -> bool:
    """Whether shot rods are within the limits, by samples of their own integration."""
    a = problem.assembly
    for i in range(a.rods):
        m, x, y = unknowns[3 * i : 3 * i + 3]
        if np.sqrt(np.hypot(x, y)) > limits.alpha:
            return False
        u0 = a.curvature[i] * a.length[i]
        couple = a.couple[i] * a.length[i] ** 2 / a.stiffness[i]

        def rate(_: float, s: Array, x: float = x, y: float = y, u: float = u0, c: float = couple):  # type: ignore[no-untyped-def]
            return [s[1] + u, x * np.sin(s[0]) - y * np.cos(s[0]) - c]

        path = solve_ivp(
            rate, (0, 1), [problem.angle[i], m], t_eval=np.linspace(0, 1, 200), rtol=1e-9
        ).y
        bend = path[1] + u0
        if (bend[1:] * bend[:-1] < 0).sum() > limits.inflections:
            return False
        if a.clamped[i] and abs(path[0, -1] - path[0, 0]) > 2 * np.pi * limits.turns:
            return False
    return True


def distance(problem: RodProblem, one: Array, other: Array) -> float:
    """Largest difference of two states' unknowns; forces by their square roots."""
    k = problem.assembly.rods
    apart = np.abs(one - other)
    apart[: 3 * k] /= 1.0 + np.abs(one[: 3 * k])
    if 2 in problem.assembly.free:
        apart[-1] = 2.0 * abs(np.sin(0.5 * (one[-1] - other[-1])))
    return float(apart.max())


def chain_equilibria(
    problem: RodProblem, limits: SearchLimits, starts: Starts, seed: int, ours: list[Array]
) -> tuple[list[Array], int]:
    """Equilibria within limits to which chains and then shooting lead from random shapes.

    More than the least number of starts are made until all of the search's are reached.  Returns
    the number of starts too.
    """
    a, random = problem.assembly, np.random.default_rng(1000 + seed)
    found: list[Array] = []
    shot = set[tuple[float, ...]]()  # chains that led to shooting
    for begin in range(0, starts[1], BATCH):
        if begin >= starts[0] and reached(problem, ours, found).all():
            return found, begin
        count = min(BATCH, starts[1] - begin)
        rests = chain_rests(problem, random_states(problem, count, random))
        force = np.hypot(rests.force[..., 0], rests.force[..., 1])
        alpha = np.sqrt(force * a.length**2 / a.stiffness).max(axis=1)
        near = np.flatnonzero(alpha < limits.alpha * (1.0 + MARGIN))
        rows = np.column_stack([rests.pose[:, :2], rests.force.reshape(len(force), -1) / 10.0])
        keys = map(tuple, np.round(rows[near], 3) + 0.0)
        new = {key: n for key, n in zip(keys, near, strict=True) if key not in shot}
        shot |= new.keys()
        found += shoot_chains(problem, rests, np.array([*new.values()], int), limits, found)
    return found, starts[1]


def reached(problem: RodProblem, ours: list[Array], theirs: list[Array]) -> Array:
    """Which of our equilibria are among theirs."""
    return np.array(
        [any(distance(problem, one, two) < SAME for two in theirs) for one in ours], bool
    )


def shoot_chains(
    problem: RodProblem, rests: ChainStates, which: Array, limits: SearchLimits, known: list[Array]
) -> list[Array]:
    """The rods' own equilibria near those of chains that are not known yet."""
    new: list[Array] = []
    for n in which:
        shot = shot_equilibrium(problem, rests, int(n))
        if shot is None or not is_within(problem, shot, limits):
            continue
        if all(distance(problem, shot, one) > SAME for one in [*known, *new]):
            new.append(shot)
    return new


def study(seed: int, limits: SearchLimits, starts: Starts) -> Row:
    """The row of one assembly."""
    problem, began = random_assembly(seed), time.process_time()
    a, found = problem.assembly, find_equilibria(problem, limits)
    searched = time.process_time()
    ours = [shot_unknowns(found, n) for n in range(len(found))]
    gaps = [float(np.abs(shoot(problem, one)).max()) for one in ours]
    theirs, count = chain_equilibria(problem, limits, starts, seed, ours)
    missed = [
        one.tolist()
        for one, known in zip(theirs, reached(problem, theirs, ours), strict=True)
        if not known
    ]
    return {
        "seed": seed,
        "rods": a.rods,
        "clamped": int(a.clamped.sum()),
        "couples": int((a.couple != 0.0).sum()),
        "found": len(found),
        "stable": int((found.index == 0).sum()),
        "gap": max(gaps, default=0.0),
        "starts": count,
        "reached": int(reached(problem, ours, theirs).sum()),
        "missed": missed,
        "search": searched - began,
        "chains": time.process_time() - searched,
    }


def document(rows: list[Row], limits: SearchLimits, starts: Starts) -> str:
    """The text of the page, made of the rows."""
    total = sum(row["found"] for row in rows)
    confirmed = sum(row["reached"] for row in rows)
    missed = sum(len(row["missed"]) for row in rows)
    lines = [
        HEAD.format(
            assemblies=len(rows),
            inflections=limits.inflections,
            alpha=limits.alpha,
            least=starts[0],
            most=starts[1],
            total=total,
            reached=confirmed,
            missed=missed,
            gap=max(row["gap"] for row in rows),
            search=sum(row["search"] for row in rows) / 60.0,
            chains=sum(row["chains"] for row in rows) / 60.0,
        ),
        "| no. | rods | clamped tips | couples | equilibria | stable | residual of shooting |"
        " starts | reached by chains | found by chains alone | search, CPU s | chains, CPU s |",
        "|" + "---|" * 12,
    ]
    for row in rows:
        lines.append(
            f"| {row['seed']} | {row['rods']} | {row['clamped']} | {row['couples']} | "
            f"{row['found']} | {row['stable']} | {row['gap']:.0e} | {row['starts']} | "
            f"{row['reached']} | {len(row['missed'])} | {row['search']:.0f} | "
            f"{row['chains']:.0f} |"
        )
    return "\n".join([*lines, ""])


HEAD = """# All equilibria of assemblies of rods

`python -m docs.make.rod_assemblies` made this page. Each of {assemblies} random assemblies has two
or three precurved rods, each pinned or clamped to a platform, some with a couple along them, and a
dead force and moment on the platform. `proofmass.analytic.rods.assembly_search` finds {total}
equilibria with up to {inflections} inflections of a rod, loads up to R = {alpha:g}² EI/L² and rods
between two clamps that turn by up to one turn.

*Shooting* integrates the rods from their clamps by `scipy.integrate.solve_ivp`, without code of the
search; its residual at the search's equilibria is {gap:.0e} of the sizes of the rods at most.
*Chains* of 24 links with springs lead from random shapes of each assembly to rests, stable or not,
and shooting leads from these to equilibria of the rods: {least} shapes, and up to {most} until all
equilibria of the search are reached. They reach {reached} of the {total}, and {missed} that the
search does not find.

The search takes {search:.1f} minutes of one core in all, and the chains with shooting {chains:.1f}.
"""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports")
    given = parser.parse_args(argv)
    count, starts, limits = (
        (QUICK_ASSEMBLIES, QUICK_STARTS, QUICK_LIMITS)
        if given.quick
        else (ASSEMBLIES, STARTS, LIMITS)
    )
    with folders(given.quick, given.folder) as (folder, docs):
        folder.mkdir(exist_ok=True)
        file = folder / "rod_assemblies.jsonl"
        rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
        done = {row["seed"] for row in rows}
        with file.open("a") as out:
            for seed in range(count):
                if seed not in done:
                    rows.append(study(seed, limits, starts))
                    print(json.dumps(rows[-1]), file=out, flush=True)
        rows.sort(key=lambda row: row["seed"])
        (docs / "rod_assemblies.md").write_text(document(rows, limits, starts))


if __name__ == "__main__":
    main()
