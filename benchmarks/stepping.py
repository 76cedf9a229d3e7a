"""The cost of recording: a run of proofmass compared with the bare loop of the same engine.

    python -m benchmarks.stepping [--quick]

Both do the same steps from the same start state with the same drive torque.  The bare loop writes
the torque and steps.  The run also reads the sensors at every sample, checks for failures and
returns curves.  Runs are interleaved, and the shortest of the repeats counts.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from benchmarks import ROOT, command
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.mujoco.dynamics import initialize_dynamics
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.mujoco.linkage import Linkage
from proofmass.sim.mujoco.model import load
from proofmass.sim.protocol.run import Run

REPEATS = 15


def bare(path: Path, run: Run) -> float:
    """Wall time [s] of the engine alone: torque and step."""
    model, data = load(path, run)
    count, step = run.steps(model.opt.timestep)
    model.opt.timestep = step
    times = run.x[0] + step * np.arange((run.x.size - 1) * count + 1)
    torque, dof = np.zeros(times.size - 1), 0
    if run.drives:
        linkage = Linkage(model, data, tuple(d.joint for d in run.drives))
        torque, _ = initialize_dynamics(linkage, run, times)
        torque, dof = torque[:, 0], linkage.dofs[0]
    applied = data.qfrc_applied
    began = time.perf_counter()
    for force in torque:
        applied[dof] = force
        mujoco.mj_step(model, data)
    return time.perf_counter() - began


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row for each case and setting."""
    quick = command(__doc__).parse_args(argv).quick
    print(f"{'case':<18}{'solver':<16}{'steps':>8}{'bare [s]':>10}{'run [s]':>10}{'ratio':>8}")
    for name in ("fourbar",) if quick else ("fourbar", "hacksaw", "pendulum"):
        case = load_case(ROOT / "models" / "linkages" / f"{name}.toml")
        for solver in case.run["dynamics"].solvers:
            if not solver.startswith("mujoco"):
                continue
            run = replace(plan_run(case, "dynamics", solver))
            alone, whole, steps = [], [], 0
            for _ in range(1 if quick else REPEATS):
                alone.append(bare(case.model_path, run))
                curves = simulate(case.model_path, run)
                whole.append(curves.seconds)
                steps = curves.steps
            ratio = min(whole) / min(alone)
            print(
                f"{name:<18}{solver:<16}{steps:>8}{min(alone):>10.4f}{min(whole):>10.4f}"
                f"{ratio:>8.3f}"
            )


if __name__ == "__main__":
    main()
