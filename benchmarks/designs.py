"""Designs for 20 curves: the search over kinds against scipy's differential evolution.

    python -m benchmarks.designs [--curves 20] [--quick]

Both search the same kinds (`KINDS`), with the same errors at the same angles.  In differential
evolution (scipy, its default strategy) the kind is an integer variable beside the parameters; its
best design is polished by L-BFGS-B, as scipy does by default, with differences.  A design that
cannot be built has an error of `IMPOSSIBLE`.  An evaluation is
one design whose curve is computed, at few angles or at all, possible or not; terms together with
their derivatives count as two.  Prints a row for each curve, and writes the rows into
docs/designs_benchmark.json after each one, and from it the page of the same name; rows of curves
that are there already are kept.
"""

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution, minimize

from benchmarks import ROOT, command, folders
from proofmass.analytic.balancer.synthesis import Variant
from proofmass.base.arrays import Array
from proofmass.design.kinds import ANY_TARGET, KindsProblem, KindsSearch
from proofmass.design.search import Effort

NAME = "designs_benchmark.json"
KINDS = [
    Variant(ANY_TARGET, 3, springs, preload, free_angle=True, relaxed=True, mode=mode)
    for springs in ("linear", "each")
    for preload in ((), (2,))
    for mode in (1, -1)
]
"""Three segments, rest angle and lengths free: linear or nonlinear springs, with or without a
preload of joint 2, and both elbows."""
POPULATION = 240
"""Designs in a generation of differential evolution."""
GENERATIONS = 120
"""Largest number of generations."""
IMPOSSIBLE = 10.0
"""Error of a design that cannot be built [1]: more than any wanted moment."""
POLISH_STEP = 1e-7
"""Step of the differences of the polish, in the unit cube [1]."""
OUR_HEATS = ((5, 5), (2, 10), (1, 20))
"""Descents of each kind and their steps."""
QUARTER = np.pi / 2


def share(angle: Array) -> Array:
    """The pendulum's angle over 90 degrees [1]."""
    return angle / QUARTER


CURVES: dict[str, Callable[[Array], Array]] = {
    "sin a": np.sin,
    "1 - cos a": lambda a: 1.0 - np.cos(a),
    "x": share,
    "x^2": lambda a: share(a) ** 2,
    "x^0.7": lambda a: share(a) ** 0.7,
    "(sin a + x)/2": lambda a: 0.5 * (np.sin(a) + share(a)),
    "x exp(1 - x)": lambda a: share(a) * np.exp(1.0 - share(a)),
    "x + 0.1 sin(2 pi x)": lambda a: share(a) + 0.1 * np.sin(4.0 * a),
    "x - 0.1 sin(2 pi x)": lambda a: share(a) - 0.1 * np.sin(4.0 * a),
    "tanh(2 x)/tanh 2": lambda a: np.tanh(2.0 * share(a)) / np.tanh(2.0),
    "1 - (1 - x)^2": lambda a: 1.0 - (1.0 - share(a)) ** 2,
    "1 - (1 - x)^3": lambda a: 1.0 - (1.0 - share(a)) ** 3,
    "x^2 (3 - 2 x)": lambda a: share(a) ** 2 * (3.0 - 2.0 * share(a)),
    "sin(1.2 a)": lambda a: np.sin(1.2 * a),
    "1.5 sin a": lambda a: 1.5 * np.sin(a),
    "0.5 sin a": lambda a: 0.5 * np.sin(a),
    "(1 + 0.2 x) sin a": lambda a: (1.0 + 0.2 * share(a)) * np.sin(a),
    "log(1 + 3 x)/log 4": lambda a: np.log1p(3.0 * share(a)) / np.log(4.0),
    "(exp x - 1)/(e - 1)": lambda a: np.expm1(share(a)) / np.expm1(1.0),
    "2 x/(1 + x)": lambda a: 2.0 * share(a) / (1.0 + share(a)),
}
"""Wanted moments over m g r, with x = a/90 degrees."""


class ErrorOfKinds:
    """The error of designs of all kinds: a kind's number, and shares of its parameters."""

    def __init__(self, curve: Callable[[Array], Array]):
        self.problem, self.count = KindsProblem(KINDS, curve), 0

    def __call__(self, points: Array) -> Array:
        """Errors (B,) of designs (1 + d, B), or of one (1 + d,), as scipy hands them over."""
        rows = np.atleast_2d(points.T).copy()
        self.count += len(rows)
        rows[:, 0] = self.problem.codes(np.rint(rows[:, 0]).astype(int))
        rows[:, 1:] = np.clip(rows[:, 1:], 0.0, 1.0)
        found = np.linalg.norm(self.problem.residuals(rows), axis=-1)
        found = np.where(np.isfinite(found), found, IMPOSSIBLE)
        return found if points.ndim > 1 else found[0]

    def slopes(self, point: Array) -> Array:
        """Derivatives (1 + d,) of the error by differences, as scipy's polish forms them."""
        step = np.where(point > 0.5, -POLISH_STEP, POLISH_STEP)
        step[0] = 0.0
        found = self(np.column_stack([point, point[:, None] + np.diag(step)]))
        return np.append(0.0, (found[2:] - found[0]) / step[1:])


def evolve(curve: Callable[[Array], Array], quick: bool) -> tuple[float, int, str]:
    """The least error of differential evolution over all kinds, its evaluations, and the kind."""
    population, generations = (12, 1) if quick else (POPULATION, GENERATIONS)
    error = ErrorOfKinds(curve)
    d = error.problem.low.size
    bounds = [(0.0, len(KINDS) - 1.0), *[(0.0, 1.0)] * (d - 1)]
    places = np.random.default_rng(1).random((population, d)) * np.array([b for _, b in bounds])
    ended = differential_evolution(
        error,
        bounds,
        init=places,
        maxiter=generations,
        seed=1,
        vectorized=True,
        updating="deferred",
        polish=False,
        integrality=np.arange(d) == 0,
    )
    polish = {"maxiter": 1} if quick else {}
    polished = minimize(error, ended.x, jac=error.slopes, bounds=bounds, options=polish)
    words = name_kind(KINDS[round(ended.x[0])])
    return min(float(ended.fun), float(polished.fun)), error.count, words


def descend(curve: Callable[[Array], Array], quick: bool) -> tuple[float, int, str]:
    """The least error of the search over all kinds, its evaluations, and the kind."""
    problem = KindsProblem(KINDS, curve)
    heats = ((2, 1), (1, 1)) if quick else OUR_HEATS
    search = KindsSearch(problem, Effort(heats, 1, implicit=True))
    search.run()
    state = search.state
    best = int(state.values.argmin())
    words = name_kind(KINDS[problem.kind_numbers(state.places[best : best + 1])[0]])
    return float(state.values[best]), state.evaluations, words


def name_kind(kind: Variant) -> str:
    """A kind of the benchmark in words."""
    words = "nonlinear" if kind.springs == "each" else "linear"
    return f"{words}{', preload' * bool(kind.preload)}{', elbow down' * (kind.mode == -1)}"


def compare_searches(name: str, quick: bool) -> dict[str, Any]:
    """The row of a curve: least errors, evaluations and processor times of both."""
    row: dict[str, Any] = {"curve": name}
    for who, search in (("evolution", evolve), ("ours", descend)):
        began = time.process_time()
        error, count, kind = search(CURVES[name], quick)
        row[who] = {
            "rmse": error,
            "evaluations": count,
            "kind": kind,
            "cpu_seconds": round(time.process_time() - began, 1),
        }
    return row


def main(argv: Sequence[str] | None = None) -> None:
    """Compare curve by curve."""
    parser = command(__doc__)
    parser.add_argument("--curves", type=int, default=len(CURVES))
    given = parser.parse_args(argv)
    names = list(CURVES)[: 1 if given.quick else given.curves]
    with folders(given.quick, ROOT) as (_, docs):
        docs.mkdir(exist_ok=True)
        file = docs / NAME
        rows = json.loads(file.read_text()) if file.exists() else []
        known = {row["curve"] for row in rows}
        for name in names:
            if name not in known:
                rows.append(compare_searches(name, given.quick))
                file.write_text(json.dumps(rows, indent=1) + "\n")
        file.with_suffix(".md").write_text(page(rows))
        for row in rows:
            print(row_text(row), flush=True)


def row_text(row: dict[str, Any]) -> str:
    """A row of the table in text."""
    ours, theirs = row["ours"], row["evolution"]
    return (
        f"{row['curve']:<22} {theirs['rmse']:.6f} {theirs['evaluations']:7d}   "
        f"{ours['rmse']:.6f} {ours['evaluations']:6d}   {ours['rmse'] / theirs['rmse']:.3f} "
        f"{theirs['evaluations'] / ours['evaluations']:.1f}"
    )


PAGE = """# Designs for 20 curves, against differential evolution

<!-- Written by python -m benchmarks.designs -->

The search of `proofmass design balancer --all` and scipy's differential evolution design balancers
for {count} curves in closed form, with x = angle/90°. Both search the same eight kinds: three
segments, rest angle and lengths free; linear or nonlinear springs, with or without a preload of
joint 2, both elbows. Differential evolution has the kind as an integer variable, {population}
designs in a generation, at most {generations} generations, and its best design is polished by
L-BFGS-B with differences; it came to this limit for {limited} of the curves, and more generations
could lower its errors. An evaluation is one design whose curve is computed, possible or not;
terms with their derivatives count as two. Errors are root mean square over m g r.

{summary}

The search had {heats} (descents of each kind, steps), less than its usual effort, so that it has a
tenth of the evaluations or less. Not measured: four segments, contacts, usual lengths, and the
other kinds of the search; one seed was used for each.

| curve | evolution | evaluations | ours | evaluations | ratio of errors | kind (ours) |
|---|---|---|---|---|---|---|
{table}
"""
EQUAL_ERROR = 1e-4
"""Error below which both count as equal [1], as in the search over all kinds."""
GOAL_RATIO = 1.05
"""Ratio of the errors that is to be reached [1]."""


def page(rows: list[dict[str, Any]]) -> str:
    """The page with a row for each curve."""
    reached = [row for row in rows if is_reached(row)]
    shares = [row["ours"]["evaluations"] / row["evolution"]["evaluations"] for row in rows]
    missed = ", ".join(f"`{row['curve']}`" for row in rows if row not in reached)
    summary = (
        f"For {len(reached)} of {len(rows)} curves our error is at most {GOAL_RATIO:g} times that "
        f"of differential evolution, or both are below {EQUAL_ERROR:g}, with "
        f"{min(shares):.3f} to {max(shares):.3f} of its evaluations."
        + (f" Not reached: {missed}." if missed else "")
    )
    return PAGE.format(
        count=len(rows),
        population=POPULATION,
        generations=GENERATIONS,
        limited=sum(
            row["evolution"]["evaluations"] >= POPULATION * (GENERATIONS + 1) for row in rows
        ),
        heats=" then ".join(f"({count}, {steps})" for count, steps in OUR_HEATS),
        summary=summary,
        table="\n".join(map(table_row, rows)),
    )


def is_reached(row: dict[str, Any]) -> bool:
    """Whether our error is small enough beside that of differential evolution."""
    ours, theirs = (max(row[who]["rmse"], EQUAL_ERROR) for who in ("ours", "evolution"))
    return ours <= GOAL_RATIO * theirs


def table_row(row: dict[str, Any]) -> str:
    """A row of the page's table."""
    ours, theirs = row["ours"], row["evolution"]
    cells = [
        f"`{row['curve']}`",
        f"{theirs['rmse']:.2e}",
        str(theirs["evaluations"]),
        f"{ours['rmse']:.2e}",
        str(ours["evaluations"]),
        f"{ours['rmse'] / theirs['rmse']:.2g}",
        ours["kind"],
    ]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
