"""Compare two engines: the same motion in MuJoCo and in pymunk, with three time steps.

A slider-crank moves in time. For each engine the script prints the largest error of the slider's
position compared with the closed form, and the order with which the error falls when the time step
is halved. pymunk is of second order here. The error of MuJoCo hardly falls: its cause is the soft
constraint of the loop, whose stiffness follows from `solref` and not from the time step.

    uv run python examples/compare_two_engines.py
"""

import math
from pathlib import Path

from proofmass import Case, compare, load_case, solve

MODELS = Path(__file__).parent.parent / "models"
SAMPLES = 360  # number of samples of a turn, which takes 2 pi s
STEPS = [2 * math.pi / SAMPLES / count for count in (8, 16, 32)]  # s
RUN = "dynamics"


def error(case: Case, engine: str, step: float) -> tuple[float, float]:
    """Largest error of the slider's position [m], and the wall time of the run [s]."""
    changed = case.model_copy(update={"settings": {engine: {"timestep": step}}})
    curves = solve(changed, RUN, engine)
    found = {c.channel: c for c in compare(changed, RUN, engine, curves, detectable=False)}
    return found["slide"].error_max, curves.seconds


def main() -> None:
    """Print a table: engine, time step, error, order, wall time."""
    case = load_case(MODELS / "linkages" / "slider_crank.toml")
    print(f"{'engine':8}{'step [s]':>10}{'error [m]':>12}{'order':>8}{'wall time [s]':>15}")
    for engine in ("mujoco", "pymunk"):
        previous_error = math.nan
        for step in STEPS:
            largest_error, seconds = error(case, engine, step)
            order = math.log2(previous_error / largest_error)
            print(f"{engine:8}{step:10.2e}{largest_error:12.2e}{order:8.2f}{seconds:15.3f}")
            previous_error = largest_error


if __name__ == "__main__":
    main()
