"""A recorded curve as the reference: a CSV file from a test rig or another program.

Each column has a name and a unit. The sidecar names the columns that move the drive, and those that
a sensor must follow. Here a formula replaces the test rig: the position of the slider of a
slider-crank with a crank of 1 m and a coupler of 2 m. The first recording agrees. The second one
is 2 mm off, and differs.

    uv run python examples/recorded_curve.py [FOLDER]
"""

import math
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from proofmass import check

MODELS = Path(__file__).parent.parent / "models"
SIDECAR = """\
title = "Slider-crank against a recording"
source = "examples/recorded_curve.py: a formula in place of a test rig"
model = "slider_crank.xml"
reference = "rig.csv"
drive = { joint = "crank", profile = ["crank", "crank rate", "crank acceleration"] }
run.sweep.solvers = ["mujoco", "pymunk"]
channels."slider.x" = { equals = "slider", unit = "mm" }

[[tolerance]]
abs = 0.01
why = "the recording has two decimals"
"""


def record(file: Path, offset: float) -> None:
    """Write one turn of the crank in 3 s; `offset` is added to the position of the slider [mm]."""
    lines = ["t [s],crank [deg],crank rate [deg/s],crank acceleration [deg/s^2],slider [mm]"]
    for time in np.linspace(0.0, 3.0, 181):
        turn = math.radians(120 * time)
        slider = 1000 * (math.cos(turn) + math.sqrt(4 - math.sin(turn) ** 2)) + offset
        lines.append(f"{time:.6f},{120 * time:.6f},120,0,{slider:.2f}")
    file.write_text("\n".join(lines), encoding="utf-8")


def main(folder: Path) -> None:
    """Compare the model with a correct recording, and with one that is 2 mm off."""
    shutil.copy(MODELS / "linkages" / "slider_crank.xml", folder)
    (folder / "rig.toml").write_text(SIDECAR, encoding="utf-8")
    for offset in (0.0, 2.0):
        record(folder / "rig.csv", offset)
        for c in check([folder / "rig.toml"]).comparisons:
            print(f"recording {offset:g} mm off, {c.solver:8}{c.outcome}: {c.error_max:.3f} mm")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(Path(sys.argv[1] if sys.argv[1:] else temporary))
