"""Read curves: how far the rocker of a four-bar swings, from a run in MuJoCo.

A run returns its curves as NumPy arrays in SI units. The rocker is at its limit positions where
crank and coupler are in line, so that two triangles give its angles there. Their difference must be
the range of the curve. The script also writes the curves as a CSV file, to the given folder or to a
temporary one.

    uv run python examples/read_curves.py [FOLDER]
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from proofmass import load_case, solve

MODELS = Path(__file__).parent.parent / "models"


def angle(third_side: float, rocker: float, ground: float) -> float:
    """Angle between rocker and ground in a triangle with the third side `third_side` [rad]."""
    return math.acos((rocker**2 + ground**2 - third_side**2) / (2 * rocker * ground))


def main(folder: Path) -> None:
    """Run the sweep, write its curves, and compare the swing with that of the triangles."""
    case = load_case(MODELS / "linkages" / "fourbar.toml")
    curves = solve(case, "sweep", "mujoco")  # in a process of its own
    (crank,), _, _ = curves.drive  # value, rate and acceleration of the drives, as they moved
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
