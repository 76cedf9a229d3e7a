"""The cost of recording: a recorded run compared with the bare loop (drive, step) of its space.

python -m benchmarks.stepping_pymunk [samples] [--quick]
"""

import time
from collections.abc import Sequence

import mujoco
import numpy as np
from pymunk import batch

from benchmarks import ROOT, command
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.dynamics import MIN_FIRST_ITERATIONS, prepare_space, step_through
from proofmass.sim.pymunk.model import read_links
from proofmass.sim.pymunk.space import aim_drives

MODEL = ROOT / "models" / "linkages" / "fourbar.xml"
SETTINGS = {"timestep": 1e-3, "iterations": 100, "error_bias": 0.0}


def main(argv: Sequence[str] | None = None) -> None:
    """Print recorded time over bare time, each the shortest of some repeats."""
    parser = command(__doc__)
    parser.add_argument("samples", type=int, nargs="?", default=361)
    given = parser.parse_args(argv)
    samples, repeats = (37, 1) if given.quick else (given.samples, 9)
    drive = Drive("crank", lambda t: (t, np.ones_like(t), np.zeros_like(t)))
    run = Run("dynamics", np.linspace(0.0, 2 * np.pi, samples), (), (drive,))
    links = read_links(mujoco.MjModel.from_xml_path(str(MODEL)), run.start, (0,))
    per, dt = run.steps(SETTINGS["timestep"])
    bare, recorded = [], []
    for _ in range(repeats):
        for times, with_record in ((bare, False), (recorded, True)):
            space, drives, targets, _ = prepare_space(links, run, per, {**SETTINGS, "timestep": dt})
            record = np.zeros(len(targets), bool)
            record[::per] = record[per - 1 :: per] = True
            began = time.perf_counter()
            if with_record:
                step_through(
                    space, dt, drives, targets, record, batch.Buffer(), MIN_FIRST_ITERATIONS
                )
            else:
                step = space.step
                for target in targets.tolist():
                    aim_drives(drives, target)
                    step(dt)
            times.append(time.perf_counter() - began)
    print(
        f"{len(targets)} steps, {per} a sample: bare {min(bare):.4f} s, "
        f"recorded {min(recorded):.4f} s, ratio {min(recorded) / min(bare):.3f}"
    )


if __name__ == "__main__":
    main()
