"""Write a linkage that was designed for a path as a case: its MJCF and its sidecar."""

from pathlib import Path

import numpy as np

from proofmass.analytic.numerics import TURN
from proofmass.base.files import write_output
from proofmass.design.linkage_designs import LinkageDesign, wrap_angles
from proofmass.design.template import GRAVITY, design_templates

USUAL_STEP, USUAL_LOOP = 1e-3, 5e-3
"""Time step and time constant of the loop at 1 rad/s [s]; both go with the speed, so that engines
have the same relative errors for linkages of any size."""
ROUND_DIGITS = (1.0, 2.0, 5.0, 10.0)  # digits of a round speed
LINE_MASS = 1.0  # mass of a bar over its length [kg/m]; the path does not depend on it
DRAWN_RADIUS = 0.01  # radius of drawn bars over the size of the path [1]
DRAWN_LENGTH = 1e-3  # least length of a drawn bar over the size of the path [1]


def write_linkage_case(
    folder: Path, name: str, design: LinkageDesign, *, title: str, source: str
) -> Path:
    """Write ``NAME.xml`` and ``NAME.toml`` of a linkage whose crank makes a turn.

    The turn begins at the first point and has the sense in which the points are passed.  Bars are
    uniform, 1 kg/m.  The points are sites of the model, called ``target1`` and so on.

    Parameters
    ----------
    folder : path
        Folder of the files, created if it does not exist.
    name : str
        Name of both files.
    design : LinkageDesign
    title, source : str
        Title of the case, and source of its numbers.

    Returns
    -------
    Path
        The sidecar.
    """
    words = {"name": name, "title": title, "source": source, **case_words(design)}
    folder.mkdir(parents=True, exist_ok=True)
    for ending in ("xml", "toml"):
        text = design_templates().get_template(f"linkage.{ending}.jinja").render(words)
        write_output(folder / f"{name}.{ending}", text)
    return folder / f"{name}.toml"


def case_words(design: LinkageDesign) -> dict[str, object]:
    """What the templates of a linkage say."""
    p, size, start = design.parameters, design.path.size, float(design.angles[0])
    places = design.pose(start)
    coupler_angle = float(np.angle(places["Q"] - places["P"]))
    least, speed = DRAWN_LENGTH * size, crank_speed(design)
    words: dict[str, object] = {
        "kind": design.kind,
        "mode": design.task.kind.mode,
        "p": p,
        "pivot": (p["pivot_x"], p["pivot_y"]),
        "start": start,
        "end": start + design.task.sense * TURN,
        "rate": design.task.sense * speed,
        "timestep": USUAL_STEP / speed,
        "loop_time": USUAL_LOOP / speed,
        "coupler_start": float(wrap_angles(np.array(coupler_angle - start))),
        "radius": float(f"{DRAWN_RADIUS * size:.2g}"),
        "point": (p["point_along"], p["point_across"]),
        "draws_arm": float(np.hypot(p["point_along"], p["point_across"])) > least,
        "draws_side": float(np.hypot(p["point_along"] - p["coupler"], p["point_across"])) > least,
        "targets": [(float(z.real), float(z.imag)) for z in design.path.points],
        "masses": {key: LINE_MASS * p[key] for key in ("crank", "coupler", "rocker") if key in p},
    }
    if design.kind == "fourbar":
        rocker = float(np.angle(places["Q"] - places["B"]))
        other = places["B"]
    else:
        slide = (places["Q"] - places["G"]) * np.exp(-1j * p["guide_angle"])
        rocker, other = float(slide.real), places["G"]
        foot = other - places["A"]
        words |= {"slider_mass": LINE_MASS * p["crank"], "guide": (foot.real, foot.imag)}
    return words | {"other": (float(other.real), float(other.imag)), "other_start": rocker}


def crank_speed(design: LinkageDesign) -> float:
    """A round speed at which the crank pin is accelerated about as much as by gravity [rad/s].

    At a lower one weight would hide the accelerations that engines are compared in.
    """
    wanted = np.sqrt(GRAVITY / design.parameters["crank"])
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(min(ROUND_DIGITS, key=lambda digit: abs(np.log(digit * power / wanted))) * power)
