"""Runs give the same digits whatever the environment, the number of runs side by side, the order.

With two threads OpenBLAS gives other last digits of `solve`, `inv`, `cholesky` and `eigh` from 100
equations on, and of products and singular values from 300 on.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NAMES = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"
SOLVED = """
import numpy as np
from proofmass.isolate import isolated
rows = np.random.default_rng(0).normal(size=(400, 400))
answers = [isolated(np.linalg.solve, rows, rows[0], timeout=60.0),
           *isolated(np.linalg.eigh, rows + rows.T, timeout=60.0)]
print([answer.tobytes().hex() for answer in answers])
"""


def printed(threads: int, *command: str) -> str:
    """Standard output of a command of Python, with BLAS told to take so many threads."""
    environment = {**os.environ, **dict.fromkeys(NAMES, str(threads))}
    done = subprocess.run([sys.executable, *command], cwd=ROOT, env=environment,
                          capture_output=True, text=True, timeout=600)
    assert done.stdout, done.stderr
    return done.stdout


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="BLAS takes one thread on one processor")
def test_workers_solve_equations_to_the_same_bits_with_any_number_of_threads():
    one, two = (printed(threads, "-c", SOLVED) for threads in (1, 2))
    assert one == two


def test_check_gives_the_same_digits_with_any_number_of_threads_and_of_runs_side_by_side(tmp_path):
    """Two rigid cases, and chains of rods that both engines bring to rest; in another order too.

    Rods of 50 segments have 100 coordinates in MuJoCo; those of 20 have 120 in pymunk.
    """
    models = [f"models/{name}.toml" for name in ("rfr2_natural", "slider_crank", "pendulum")]
    fine = tmp_path / "fine.toml"
    fine.write_text((ROOT / models[0]).read_text().replace("segments = 20", "segments = 50")
                    .replace('solvers = ["mujoco", "pymunk"]', 'solvers = ["mujoco"]'))
    fine.with_suffix(".xml").write_text((ROOT / "models/rfr2_natural.xml").read_text())
    models.append(str(fine))
    found = []
    for threads, jobs, order in ((1, 1, 1), (2, 2, -1)):
        rows = json.loads(printed(threads, "-m", "proofmass", "check", "--json", "--jobs",
                                  str(jobs), *models[::order]))["comparisons"]
        found.append({(row["case"], row["run"], row["solver"], row["channel"]):
                      {name: value for name, value in row.items() if name != "seconds"}
                      for row in rows})
    assert {case for case, *_ in found[0]} == {"rfr2_natural", "slider_crank", "pendulum", "fine"}
    assert found[1] == found[0]
