"""Choose a setting: the cheapest one that is accurate enough, and a program that uses it.

`proofmass choose` searches the settings of an engine for the cheapest one whose error is small
enough, and writes a program that needs only NumPy and the engine. The script runs that program as
a process of its own, and computes by how much the energy of the released pendulum changes.

    uv run python examples/choose_a_setting.py [FOLDER]
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

MODELS = Path(__file__).parent.parent / "models"
ERROR = 1e-3  # largest allowed error of the angle, as a share of its range
GRAVITY, LENGTH = 9.81, 1.0  # m/s2, m: values of the model


def main(folder: Path) -> None:
    """Choose a setting, run its program, and read the curves that the program writes."""
    program, curves = folder / "run.py", folder / "curves.csv"
    command = [
        sys.executable,
        "-m",
        "proofmass",
        "choose",
        MODELS / "linkages" / "pendulum.toml",
        "--error",
        str(ERROR),
        "--solver",
        "mujoco",
        "--budget",
        "20",
        "--store",
        folder / "trade",
        "-o",
        program,
    ]
    subprocess.run([str(part) for part in command], check=True, capture_output=True)
    print(program.read_text(encoding="utf-8").split('"""')[1].split("\n\n")[1])

    # -I: the interpreter ignores environment variables, and imports nothing from its folder
    subprocess.run(
        [sys.executable, "-I", str(program), str(curves)], check=True, capture_output=True
    )
    table = np.genfromtxt(curves, delimiter=",", names=True)
    energy = 0.5 * (LENGTH * table["rate"]) ** 2 - GRAVITY * LENGTH * np.cos(table["angle"])
    print(
        f"{table.size} samples; the energy changes by at most "
        f"{np.ptp(energy) / (GRAVITY * LENGTH):.1e} of m g L"
    )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(Path(sys.argv[1] if sys.argv[1:] else temporary))
