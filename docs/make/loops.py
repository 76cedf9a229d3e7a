"""The example of docs/loops.md: the output of ``proofmass compare``, and its figure.

    python -m docs.make.loops [--quick]

The loop is made from the polynomial of listing N.2 of van Nes 2022, with its first exponent
corrected (docs/errata.md), dry friction of 1.6 N mm and noise of 0.2 N mm and 0.05 deg.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import ROOT, command
from docs.make.marks import write_between

PAGE, PICTURE = ROOT / "docs" / "loops.md", ROOT / "docs" / "loop.png"
BEGIN = "<!-- python -m docs.make.loops writes from here to the next mark: output -->"
END = "<!-- to here: output -->"
MOMENT = 4.4283e-11, -8.2536e-9, 4.8168e-7, -1.4378e-5, 1.1225e-3, -2.9428e-4
"""Coefficients of the moment [N m] over the angle [deg], the highest power first."""
FRICTION, NOISE, ANGLE_NOISE = 1.6, 0.2, 0.05
"""Moment of friction and noise of the moment [N mm], and noise of the angle [deg]."""
WIDTH = 100
"""Letters of a line of the terminal that is shown."""
WORDS = (
    *("compare", "loop.csv", "--with", "sine=58.64", "--with", "fit=5"),
    *("--with", "balancer_prototype.toml", "-o", "loop.png"),
)


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command in a folder, and write its output and its figure into docs/."""
    given = command(__doc__).parse_args(argv)
    with TemporaryDirectory() as folder:
        there = Path(folder)
        for name in ("balancer_prototype.toml", "balancer_prototype.xml"):
            shutil.copy(ROOT / "models" / "balancers" / name, there / name)
        write_loop(there / "loop.csv")
        words = [sys.executable, "-m", "proofmass", *WORDS]
        done = subprocess.run(
            words,
            cwd=there,
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "COLUMNS": f"{WIDTH}"},
        )
        if not given.quick:
            shutil.copy(there / "loop.png", PICTURE)
    text = f"```\n$ proofmass {' '.join(WORDS)}\n{done.stdout.rstrip()}\n```"
    print(text)
    if not given.quick:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(write_between(page, BEGIN, END, text), encoding="utf-8")


def write_loop(file: Path) -> None:
    """Write a loop that begins at 40 degrees and goes up and down twice."""
    rng = np.random.default_rng(2)
    cycle = np.concatenate([np.linspace(0.0, 90.0, 1000), np.linspace(90.0, 0.0, 1000)])
    angle = np.concatenate([np.linspace(40.0, 0.0, 200), cycle, cycle])
    side = np.concatenate([-np.ones(200), *2 * [np.repeat([1.0, -1.0], 1000)]])
    moment = 1e3 * np.polyval(MOMENT, angle) + FRICTION * side
    rows = np.column_stack(
        [
            angle + ANGLE_NOISE * rng.standard_normal(angle.size),
            moment + NOISE * rng.standard_normal(angle.size),
        ]
    )
    np.savetxt(file, rows, "%.4f", ",", header="alpha [deg],M [N mm]", comments="")


if __name__ == "__main__":
    main()
