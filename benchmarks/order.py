"""Order of convergence: every duration at its step, a half and a quarter of it, against its truth.

    python -m benchmarks.order [MODEL…]

Errors are the largest over the channels of a kind (position, rate, acceleration), as shares of the
reference's range, at the state the drive really had.  With steps h and errors e the order is

    log(e1/e2) / log(h1/h2)

and the wall is the error from which a smaller step gains less than order 1.
"""

import os
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from proofmass.case import Case, load_case
from proofmass.compare import reference_for
from proofmass.isolate import Crashed, TimedOut, isolated
from proofmass.recorded import Recorded
from proofmass.reference import compiled, module_of
from proofmass.solve import plan, simulate
from sim.protocol import Curves, Diverged, Unsupported

Array = NDArray[np.float64]
MODELS = Path(__file__).parent.parent / "models"
KINDS = {"position": ("rad", "m"), "rate": ("rad/s", "m/s"), "acceleration": ("rad/s^2", "m/s^2")}
LATEST = 1800.0  # s, for the run with the smallest step


@dataclass(frozen=True)
class Study:
    """Steps [s] (levels,), and for each kind of channel the errors (levels,) as shares of range."""

    steps: Array
    errors: dict[str, Array]

    def orders(self, kind: str) -> Array:
        """Observed order from each step to the next (levels - 1,)."""
        return np.diff(np.log(self.errors[kind])) / np.diff(np.log(self.steps))

    def wall(self, kind: str) -> float | None:
        """Error from which a smaller step gains less than order 1; None where all gain."""
        stuck = np.flatnonzero(self.orders(kind) < 1.0)
        return float(self.errors[kind][stuck[0]]) if stuck.size else None


def cases(engine: str, names: list[str]) -> Iterator[Case]:
    """Sidecars with a duration in this engine, but for recorded curves: they have an error too."""
    for file in sorted(MODELS.glob("*.toml")):
        case = load_case(file)
        run = case.run.get("duration")
        if run and engine in run.solvers and (not names or case.name in names) and not isinstance(
                module_of(case), Recorded):
            yield case


# The change points lie half way between two samples: with odd numbers of steps from one to the next
# no step ends on them.  Finer ones come so near that 3000 iterations leave the loop open.
ODD = {"change_point": (9, 27)}


def study(case: Case, engine: str, levels: int = 3) -> Study:
    """Run a case's duration with its tuned settings at its step, halved from level to level."""
    run = plan(case, "duration", engine)
    own = run.settings.get("timestep", compiled(case).opt.timestep)
    count, _ = run.steps(float(str(own)))  # as whole steps fit between samples
    counts = ODD.get(case.name, [count * 2**k for k in range(levels)])
    steps, rows = (run.x[1] - run.x[0]) / np.array(counts), []
    for step in steps:
        finer = replace(run, settings={**run.settings, "timestep": float(step)})
        curves = isolated(simulate, engine, case.model_path, finer, timeout=LATEST)
        rows.append(shares(case, curves))
    return Study(steps, {kind: np.array([row[kind] for row in rows]) for kind in rows[0]})


def shares(case: Case, curves: Curves) -> dict[str, float]:
    """Largest error of each kind of channel, as a share of the reference's range."""
    truth, found = reference_for(case, curves).channels, dict[str, float]()
    for name, channel in case.channels_of("duration").items():
        kind = next((k for k, units in KINDS.items() if channel.unit in units), None)
        span = float(np.ptp(truth[name]))
        if kind and span and name in curves.channels:
            error = float(np.abs(curves.channels[name] - truth[name]).max()) / span
            found[kind] = max(found.get(kind, 0.0), error)
    return found


def lines(case: Case, engine: str) -> list[str]:
    """The rows of the table for one case."""
    try:
        found = study(case, engine)
    except (Crashed, Diverged, TimedOut, Unsupported) as error:
        return [f"{case.name:32}{engine:8}{type(error).__name__}: {error}"]
    rows = []
    for kind, errors in found.errors.items():
        wall = found.wall(kind)
        rows.append(f"{case.name:32}{engine:8}{kind:14}{1e3 * found.steps[0]:8.3f}"
                    + "".join(f"{e:10.1e}" for e in errors)
                    + "".join(f"{p:8.2f}" for p in found.orders(kind))
                    + (f"{wall:10.1e}" if wall else f"{'-':>10}"))
    return rows


def main(*names: str) -> None:
    print(f"{'case':32}{'engine':8}{'':14}{'dt [ms]':>8}{'e(dt)':>10}{'e(dt/2)':>10}{'e(dt/4)':>10}"
          f"{'order':>8}{'order':>8}{'wall':>10}")
    tasks = [(case, engine) for engine in ("pymunk", "mujoco")
             for case in cases(engine, list(names))]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for rows in pool.map(lines, *zip(*tasks, strict=True)):
            print(*rows, sep="\n", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
