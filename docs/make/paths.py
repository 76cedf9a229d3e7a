"""Write the files of the paths that shipped cases follow: ``python -m docs.make.paths``.

Each is a closed form, so that a test can compare the files with it.  The line of the pair of rods
is that of the source; the source gives no numbers of its other paths.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks import command
from proofmass.base.arrays import Array

MODELS = Path(__file__).parents[2] / "models"
DIVISIONS = 100
SHARES = np.arange(DIVISIONS + 1) / DIVISIONS
PIN = 0.2927527, -0.340761
"""The pin of the second solution of Table 7 [m], from which the source begins its paths."""
PLATFORMS = {
    "pfr3": (0.0021718675, -0.0016259632, 1.7443094488),
    "rfr3": (0.0164836451, 0.0206022059, 1.2027380807),
}
"""Poses x, y [m], phi [rad] of the equilibria in which the platforms of `pfr3` and `rfr3` begin."""


def eight() -> tuple[str, dict[str, Array]]:
    """A figure of eight of the five-bar's tip in 4 s, with a load that turns once."""
    u = 2.0 * np.pi * SHARES
    return (
        "A figure of eight, x = 500 + 1200 sin u, y = 6000 + 700 sin 2u mm, and a load of 20 N.",
        {
            "time [s]": 4.0 * SHARES,
            "x [mm]": 500.0 + 1200.0 * np.sin(u),
            "y [mm]": 6000.0 + 700.0 * np.sin(2.0 * u),
            "Fx [N]": 20.0 * np.cos(u),
            "Fy [N]": 20.0 * np.sin(u),
        },
    )


def swinging_ellipse() -> tuple[str, dict[str, Array]]:
    """An ellipse of the 3PRR's corner P while the platform swings, without times."""
    u = 2.0 * np.pi * SHARES
    return (
        "An ellipse of P, the platform's corner, while the platform swings and its load turns.",
        {
            "x [m]": 1.0 + 0.12 * np.cos(u),
            "y [m]": 0.85 + 0.08 * np.sin(u),
            "phi [deg]": -20.0 + 10.0 * np.sin(u),
            "Fx [N]": 5.0 * np.cos(u),
            "Fy [N]": 5.0 * np.sin(u),
            "M [N m]": 2.0 * np.sin(u),
        },
    )


def pin_line() -> tuple[str, dict[str, Array]]:
    """The straight path of the source: 0.5 m towards 180 degrees in 100 divisions."""
    x, y = PIN
    return (
        "0.5 m towards 180 degrees in 100 divisions, from the second solution of Table 7.",
        {"x [m]": x - 0.5 * SHARES, "y [m]": np.full(SHARES.size, y)},
    )


def platform_line() -> tuple[str, dict[str, Array]]:
    """The same line of the platform on sliders, which keeps its angle."""
    x, y, phi = PLATFORMS["pfr3"]
    return (
        "0.5 m towards 180 degrees in 100 divisions, without turning.",
        {
            "x [m]": x - 0.5 * SHARES,
            "y [m]": np.full(SHARES.size, y),
            "phi [rad]": np.full(SHARES.size, phi),
        },
    )


def platform_loop() -> tuple[str, dict[str, Array]]:
    """A circle of the platform on motors, which swings and bears a load that changes."""
    (x, y, phi), u = PLATFORMS["rfr3"], 2.0 * np.pi * SHARES
    return (
        "A circle of 20 mm below the first pose; the platform swings, and its load changes.",
        {
            "x [m]": x + 0.02 * np.sin(u),
            "y [m]": y + 0.02 * (np.cos(u) - 1.0),
            "phi [rad]": phi - 0.1 * np.sin(u),
            "Fy [N]": 0.5 + 0.1 * np.sin(u),
        },
    )


PATHS = {
    "linkages/fivebar_path.csv": eight,
    "linkages/threeprr_path.csv": swinging_ellipse,
    "rods/rfr2_line.csv": pin_line,
    "rods/pfr3_line.csv": platform_line,
    "rods/rfr3_path.csv": platform_loop,
}


def path_text(file: str) -> str:
    """The text of a file of `PATHS`."""
    words, columns = PATHS[file]()
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(repr(round(float(value), 12) + 0.0) for value in row) for row in rows]
    head = [f"# {words}", "# Made by python -m docs.make.paths.", ",".join(columns)]
    return "\n".join([*head, *lines]) + "\n"


def main(argv: Sequence[str] | None = None) -> None:
    """Make all files, and write them unless it shall be quick."""
    given = command(__doc__).parse_args(argv)
    for file in PATHS:
        text = path_text(file)
        if not given.quick:
            (MODELS / file).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
