"""Runs give the same digits for any number of threads or parallel runs, and in any order.

With two threads OpenBLAS gives other last digits of `solve`, `inv`, `cholesky` and `eigh` from 100
equations on, and of products and singular values from 300 on.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.shipped import shipped

ROOT = Path(__file__).parents[2]
THREAD_VARIABLES = "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"
SOLVE_PROGRAM = """
import numpy as np
from proofmass.base.worker import call_isolated
rows = np.random.default_rng(0).normal(size=(400, 400))
answers = [call_isolated(np.linalg.solve, rows, rows[0], timeout=60.0),
           *call_isolated(np.linalg.eigh, rows + rows.T, timeout=60.0)]
print([answer.tobytes().hex() for answer in answers])
"""

REFERENCE_MODULE = """
import numpy as np
from proofmass.analytic.protocol import Reference
class Solved(Reference):
    def solve(self, motion, ask):
        rows = np.random.default_rng(0).normal(size=(400, 400))
        return {"solved": np.linalg.solve(rows, rows[0])[: motion.x.size]}
"""
SIDECAR = """
title = "solved"
source = "ours"
model = "fourbar.xml"
reference = "solved.py"
drive = { joint = "crank", to = 1.0 }
run.sweep = { n = 100, solvers = ["mujoco"] }
channels.rocker = { equals = "solved", unit = "rad" }
unchecked = true
"""
GATHER_PROGRAM = """
import numpy as np
from proofmass import Curves, load_case
from proofmass.batch.check import Result
from proofmass.report.data import plotted_run
from proofmass.studies.variants import evaluate_reference
from proofmass.base.worker import call_isolated
case = load_case("solved.toml")
wanted = evaluate_reference(case, "sweep")
drive = tuple(np.ones((3, 1, 100)))
found = {("solved", "sweep", "mujoco"): Curves(wanted.x, {}, drive=drive)}
run = call_isolated(plotted_run, Result([case], curves=found), case, "sweep", timeout=600)
print([one.channels["rocker"].tobytes().hex() for one in (wanted, run.reference["mujoco"])])
"""


def program_output(threads: int, *command: str, folder: Path = ROOT) -> str:
    """Standard output of a command of Python, with this number of threads for BLAS."""
    environment = {
        **os.environ,
        **dict.fromkeys(THREAD_VARIABLES, str(threads)),
        "PYTHONPATH": str(folder),
    }
    done = subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.stdout, done.stderr
    return done.stdout


NEEDS_TWO_PROCESSORS = pytest.mark.skipif(
    (os.cpu_count() or 1) < 2, reason="BLAS takes one thread on one processor"
)


EVALUATE_PROGRAM = """
import sys
from proofmass import load_case
from proofmass.reference.run_reference import RunReference
from proofmass.reference.evaluate import evaluate
from proofmass.sim.protocol.curves import Curves
from proofmass.run.solve import plan_run
case = load_case(sys.argv[1])
run = plan_run(case, "sweep", "mujoco")
x = run.x[:3]
state = run.motion(x)
if sys.argv[2:]:
    evaluate(case, "sweep", x, state, stiffness=case.parameters["stiffness"] * (1.0 + 1e-7))
near = tuple(part + 1e-12 for part in state)
reference = RunReference(case, "sweep", Curves(x, {}, drive=near))
print([curve.tobytes().hex() for at in (state, near)
       for curve in reference.as_driven(at).channels.values()])
"""


@pytest.mark.parametrize("name", [pytest.param("pfr3", marks=pytest.mark.slow), "rfr2_driven"])
def test_a_reference_does_not_depend_on_evaluations_before(name):
    """A search starts from a stored result nearby, but only from one of the same run."""
    sidecar = str(shipped(f"{name}.toml"))
    first, later = (
        program_output(1, "-c", EVALUATE_PROGRAM, sidecar, *more) for more in ((), ("before",))
    )
    assert first == later


@NEEDS_TWO_PROCESSORS
def test_workers_solve_equations_to_the_same_bits_with_any_number_of_threads():
    """Workers override the number of threads that the environment asks for."""
    one, two = (program_output(threads, "-c", SOLVE_PROGRAM) for threads in (1, 2))
    assert one == two


@NEEDS_TWO_PROCESSORS
@pytest.mark.slow
def test_reports_have_the_same_references_with_any_number_of_threads(tmp_path):
    """The reference solves 400 equations; it is a program beside the sidecar."""
    (tmp_path / "solved.py").write_text(REFERENCE_MODULE)
    (tmp_path / "solved.toml").write_text(SIDECAR)
    (tmp_path / "fourbar.xml").write_bytes(shipped("fourbar.xml").read_bytes())
    one, two = (
        program_output(threads, "-c", GATHER_PROGRAM, folder=tmp_path) for threads in (1, 2)
    )
    assert one == two


def test_check_gives_the_same_digits_with_any_number_of_threads_and_jobs(tmp_path):
    """The digits are the same with one thread and one job as with two of each and reversed cases.

    One case is rigid.  In the others engines find the equilibrium of chains of rods: those of 50
    segments have 100 coordinates in MuJoCo, those of 20 have 120 in pymunk.
    """
    pair, swing = (shipped(f"{name}.toml").read_text() for name in ("rfr2_natural", "pendulum"))
    both = 'solvers = ["mujoco", "pymunk"]'
    texts = {
        "coarse": pair.replace(both, 'solvers = ["pymunk"]'),
        "fine": pair.replace(both, 'solvers = ["mujoco"]').replace(
            "segments = 20", "segments = 50"
        ),
        "swing": swing.replace("until = 10.0", "until = 1.0"),
    }
    for name, text in texts.items():
        assert text not in (pair, swing)
        model = "pendulum" if name == "swing" else "rfr2_natural"
        (tmp_path / f"{name}.toml").write_text(text)
        (tmp_path / f"{name}.xml").write_text(shipped(f"{model}.xml").read_text())
    models = [str(tmp_path / f"{name}.toml") for name in texts]
    found = []
    for threads, jobs, order in ((1, 1, 1), (2, 2, -1)):
        rows = json.loads(
            program_output(
                threads, "-m", "proofmass", "check", "--json", "--jobs", str(jobs), *models[::order]
            )
        )["comparisons"]
        found.append(
            {
                (row["case"], row["run"], row["solver"], row["channel"]): {
                    name: value for name, value in row.items() if name != "seconds"
                }
                for row in rows
            }
        )
    assert {case for case, *_ in found[0]} == {"coarse", "fine", "swing"}
    assert found[1] == found[0]
