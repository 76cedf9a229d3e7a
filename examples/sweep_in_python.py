"""A sweep in Python: statics of a four-bar over a third of a turn, with a changed case.

A sweep is quasi-static: at each sample the crank is at rest, and the motor carries the weight of
the links. The case is read from its sidecar; the script changes the range of the drive and the
number of samples. The model has no friction and no springs, so that in either engine the work of
the motor between two poses is the change of the potential energy.

    uv run python examples/sweep_in_python.py
"""

import math
from pathlib import Path

import numpy as np

from proofmass import load_case, solve

MODELS = Path(__file__).parent.parent / "models"
SAMPLES = 61


def main() -> None:
    """Sweep a third of a turn in both engines, and compare the work with the energy."""
    case = load_case(MODELS / "linkages" / "fourbar.toml")
    drive = case.drive[0].model_copy(update={"start": 0.5, "to": 0.5 + 2 * math.pi / 3})
    run = case.run["sweep"].model_copy(update={"n": SAMPLES})
    case = case.model_copy(update={"drive": (drive,), "run": {"sweep": run}})
    a, b, c, gravity = (
        float(case.parameters[name]) for name in ("crank", "coupler", "rocker", "gravity")
    )
    m = [float(case.parameters[f"{name}_mass"]) for name in ("crank", "coupler", "rocker")]

    for engine in ("mujoco", "pymunk"):
        curves = solve(case, "sweep", engine)
        crank, channels = curves.x, curves.channels
        coupler, rocker = channels["coupler.angle"], channels["rocker"]
        heights = (
            a / 2 * np.sin(crank),
            a * np.sin(crank) + b / 2 * np.sin(coupler),
            c / 2 * np.sin(rocker),
        )  # [m] heights of the centres of three uniform bars
        energy = gravity * sum(mass * height for mass, height in zip(m, heights, strict=True))
        moment = channels["holding_moment"]
        work = simpson(moment, crank)
        print(
            f"{engine:8}moment {moment[0]:.3f} to {moment[-1]:.3f} N m, work {work:.5f} J, "
            f"energy {energy[-1] - energy[0]:.5f} J"
        )


def simpson(y: np.ndarray, x: np.ndarray) -> float:
    """Integral by Simpson's rule over an odd number of samples at equal distances."""
    h = (x[-1] - x[0]) / (x.size - 1)
    return float(h / 3 * (y[0] + y[-1] + 4 * y[1:-1:2].sum() + 2 * y[2:-1:2].sum()))


if __name__ == "__main__":
    main()
