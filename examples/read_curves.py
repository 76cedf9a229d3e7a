"""Read curves: how far the rocker of a four-bar swings, from a run in MuJoCo.

A run delivers its curves as NumPy arrays in SI units. The rocker stands still where crank and
coupler lie on one line, so its two limit positions follow from two triangles, and their
difference must be the range of the curve. The curves are written as CSV as well, in a folder that
may be given.

    uv run python examples/read_curves.py [FOLDER]
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from proofmass import load_case, solve

MODELS = Path(__file__).parent.parent / "models"


def angle(far: float, rocker: float, ground: float) -> float:
    """Angle between rocker and ground in a triangle whose third side is `far` [rad]."""
    return math.acos((rocker**2 + ground**2 - far**2) / (2 * rocker * ground))


def main(folder: Path) -> None:
    """Run, write and read the curves."""
    case = load_case(MODELS / "linkages" / "fourbar.toml")
    curves = solve(case, "sweep", "mujoco")  # in a process of its own
    (crank,), _, _ = curves.drive  # value, rate and acceleration of the drives as they really moved
    table = np.column_stack([curves.x, *curves.channels.values()])
    np.savetxt(
        folder / "fourbar.csv",
        table,
        delimiter=",",
        comments="",
        header=",".join(["crank", *curves.channels]),
    )
    print(
        f"{table.shape[0]} samples of {len(curves.channels)} channels, crank 0 to "
        f"{crank[-1]:.4f} rad, loops open by at most {curves.violation:.0e} m"
    )

    lengths = [case.parameters[name] for name in ("crank", "coupler", "rocker", "ground")]
    a, b, c, d = map(float, lengths)
    print(f"the rocker swings by {np.ptp(curves.channels['rocker']):.3f} rad in the run")
    print(f"the rocker swings by {angle(a + b, c, d) - angle(b - a, c, d):.3f} rad by geometry")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main(Path(sys.argv[1] if sys.argv[1:] else temporary))
