"""Files in the form of other programs' exports, made from closed forms with a known disturbance.

    python -m docs.make.shaped_exports

writes ``models/linkages/hacksaw_inventor_shaped.csv`` and
``models/balancers/balancer4_sam_shaped.csv``.  These files do not come from these programs, and
their first lines say how they were made.  Cases in the same folders compare them as recorded
curves.  Two other files drive a case: ``models/linkages/hacksaw_motor.csv``, a velocity profile,
and ``models/balancers/balancer4_sam_angles.csv``, three angles.

The disturbances are those of real exports: values have the digits that a program prints, at the
program's own times, and the zero of a joint was set by hand.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from proofmass import load_case
from proofmass.analytic.balancer import solve as balancer
from proofmass.analytic.linkages import hacksaw
from proofmass.base.arrays import Array

MODELS = Path(__file__).parents[2] / "models"
SHAPED = "MADE UP. Shaped like an export of {}, and not from it.\n"
STEP, ROWS = 0.004, 972  # time step [s] and number of the hacksaw's rows: 3.884 s
CRANK_ZERO = 0.02  # [deg] error of the zero of the hacksaw's crank
PENDULUM_ZERO = 0.01  # [deg] error of the zero of the balancer's pendulum
ANGLES = np.arange(0.0, 90.25, 0.5)  # [deg] of the balancer's rows
Columns = dict[str, tuple[Array, int]]
"""Values, and the number of printed decimals, by header."""


def inventor_shaped() -> tuple[str, Columns]:
    """The thirteen columns of the hacksaw report, in its units and with its signs."""
    times = STEP * np.arange(ROWS)
    angle, rate, acceleration = hacksaw.motor(times)
    off = angle + np.radians(CRANK_ZERO)
    known = hacksaw.solve(off, rate, acceleration, crank=0.075, coupler=0.170, offset=0.045)
    degrees = {name: np.degrees(curve) for name, curve in known.items()}
    head = f"""\
Made by python -m docs.make.shaped_exports from the closed form of the hacksaw, in
proofmass/analytic/linkages/hacksaw, driven by its motor profile.
Disturbance: the zero of the crank is off by {CRANK_ZERO} deg; values are rounded as printed.
A row every {1e3 * STEP:g} ms. Units and signs are those of the report's workbook:
R1 = -r1 and Theta3 = theta3 - 180 deg, its rates as they are."""
    return SHAPED.format("Inventor's dynamic simulation") + head, {
        "Tiempo [s]": (times, 3),
        "Theta2 [deg]": (np.degrees(off), 4),
        "w2 [deg/s]": (np.degrees(rate), 3),
        "A2 [deg/s^2]": (np.degrees(acceleration), 2),
        "Theta3 [deg]": (degrees["theta3"] - 180.0, 4),
        "W3 [deg/s]": (degrees["theta3_rate"], 3),
        "A3 [deg/s^2]": (degrees["theta3_acceleration"], 2),
        "R1 [m]": (-known["r1"], 7),
        "Vr1 [m/s]": (known["r1_rate"], 6),
        "Ar1 [m/s^2]": (known["r1_acceleration"], 5),
        "Theta1 [deg]": (degrees["theta1"], 4),
        "w1 [deg/s]": (degrees["theta1_rate"], 3),
        "A1 [deg/s^2]": (degrees["theta1_acceleration"], 2),
    }


def motor_profile() -> tuple[str, Columns]:
    """The velocity profile that the report's script writes for Inventor: 1000 rows in deg/s."""
    times = np.linspace(0.0, 2.0 * hacksaw.turn_time(), 1000)
    head = """\
The velocity of the hacksaw's motor, as the report's script writes it for Inventor to impose.
Made by python -m docs.make.shaped_exports from proofmass/analytic/linkages/hacksaw."""
    return head, {
        "t [s]": (times, 9),
        "w2 [deg/s]": (np.degrees(hacksaw.motor(times)[1]), 9),
    }


def sam_shaped() -> tuple[str, Columns]:
    """The columns that the thesis has from SAM: angles, loads of two nodes, moment, energy."""
    case = load_case(MODELS / "balancers" / "balancer4_sam.toml")
    alpha = np.radians(ANGLES + PENDULUM_ZERO)
    known = balancer(alpha, **case.parameters)
    head = f"""\
Made by python -m docs.make.shaped_exports from the closed form of the balancer, in
proofmass/analytic/balancer, with the numbers of balancer4_sam.toml.
Disturbance: the zero of the pendulum is off by {PENDULUM_ZERO} deg; values are rounded as printed.
A row every {ANGLES[1]:g} deg. Angles are clockwise from the upright."""
    return SHAPED.format("SAM") + head, {
        "alpha [deg]": (ANGLES, 1),
        "theta1 [deg]": (np.degrees(known["theta1"]), 4),
        "theta2 [deg]": (np.degrees(known["theta2"]), 4),
        "L2 [N m]": (known["node2_load"], 6),
        "L3 [N m]": (known["node3_load"], 6),
        "M [N m]": (known["holding_moment"], 6),
        "V [J]": (known["energy"], 6),
    }


def sam_angles() -> tuple[str, Columns]:
    """The three arrays of angles that appendix F has from the thesis's program for SAM."""
    case = load_case(MODELS / "balancers" / "balancer4_sam.toml")
    degrees = np.arange(0.0, 91.0)
    known = balancer(np.radians(degrees), **case.parameters)
    head = """\
Angles that bring balancer4_sam.toml to rest, to be prescribed: of the pendulum, of segment 1 and of
joint 2, the angle between segments 1 and 2.
Made by python -m docs.make.shaped_exports from proofmass/analytic/balancer.
A row every degree and every second. Angles are clockwise from the upright."""
    return head, {
        "t [s]": (degrees, 0),
        "alpha [deg]": (degrees, 0),
        "theta1 [deg]": (np.degrees(known["theta1"]), 12),
        "e2 [deg]": (np.degrees(known["deflection2"]), 12),
    }


FILES: dict[str, Callable[[], tuple[str, Columns]]] = {
    "linkages/hacksaw_inventor_shaped.csv": inventor_shaped,
    "linkages/hacksaw_motor.csv": motor_profile,
    "balancers/balancer4_sam_shaped.csv": sam_shaped,
    "balancers/balancer4_sam_angles.csv": sam_angles,
}


def text_of(name: str) -> str:
    """The text of one of the files."""
    head, columns = FILES[name]()
    lines = [f"# {line}" for line in head.splitlines()]
    lines.append(",".join(columns))
    cells = [
        [f"{value:.{digits}f}" for value in np.round(values, digits) + 0.0]  # no minus before zero
        for values, digits in columns.values()
    ]
    return "\n".join([*lines, *(",".join(row) for row in zip(*cells, strict=True))]) + "\n"


def main() -> None:
    """Write the files below models/; with --quick only their sizes are printed."""
    parser = argparse.ArgumentParser(description="Make files shaped like exports.")
    parser.add_argument("--quick", action="store_true", help="write nothing")
    quick = parser.parse_args().quick
    for name in FILES:
        text = text_of(name)
        if not quick:
            (MODELS / name).write_text(text, encoding="utf-8")
        print(f"models/{name}: {len(text.splitlines())} lines")


if __name__ == "__main__":
    main()
