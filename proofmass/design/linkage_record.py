"""What is told of designs for a path: records for JSON and CSV, and lines for a terminal."""

import csv
from collections.abc import Sequence
from io import StringIO
from typing import Any

import numpy as np

from proofmass.design.linkage_designs import FoundDesigns, LinkageDesign
from proofmass.design.linkage_path import PathTask

ANGLE_NAMES = ("ground_angle", "guide_angle")
"""Parameters that are angles, in degrees where a person reads."""


def describe_linkage(design: LinkageDesign) -> dict[str, Any]:
    """The record of a design, with angles in radians [SI]."""
    low, high = design.transmission
    pins = design.pose(float(design.angles[0]))
    return {
        "kind": design.kind,
        "mode": design.task.kind.mode,
        "sense": design.task.sense,
        "parameters": design.parameters,
        "pivots": {
            name: [pins[name].real, pins[name].imag] for name in ("A", "B", "G") if name in pins
        },
        "rms_error": design.rms,
        "largest_error": float(design.errors.max()),
        "sum_of_squares": float(np.sum(design.errors**2)),
        "structural_error": design.structural_error,
        "errors": design.errors.tolist(),
        "crank_angles": design.angles.tolist(),
        "transmission_angle": [low, high],
        "grashof": design.grashof,
        "in_order": design.in_order,
        "on_one_branch": design.on_one_branch,
    }


def describe_search(tasks: dict[str, PathTask], found: FoundDesigns) -> dict[str, Any]:
    """The record of the searches for a path and of their designs."""
    task = next(iter(tasks.values()))
    return {
        "points": [[z.real, z.imag] for z in task.path.points.tolist()],
        "closed": task.path.closed,
        "angles_from": task.path.angles_from if task.given_angles else None,
        "least_transmission_angle": task.transmission,
        "searches": list(tasks),
        "descents": found.descents,
        "within_1.2_of_best": found.reached,
        "designs": [describe_linkage(one) for one in found.designs],
    }


def as_csv(designs: Sequence[LinkageDesign]) -> str:
    """A table of designs, a row for each; columns of other kinds are empty."""
    names = list(dict.fromkeys(name for one in designs for name in one.parameters))
    heads = [f"{name} [{'deg' if name in ANGLE_NAMES else 'm'}]" for name in names]
    text = StringIO(newline="")
    rows = csv.writer(text)
    rows.writerow(
        [
            *("kind", "mode", "rms_error [m]", "largest_error [m]", "structural_error [m]"),
            *("transmission_min [deg]", "transmission_max [deg]", "grashof"),
            *heads,
        ]
    )
    for one in designs:
        told = {
            name: np.degrees(value) if name in ANGLE_NAMES else value
            for name, value in one.parameters.items()
        }
        rows.writerow(
            [
                *(one.kind, one.task.kind.mode, one.rms, float(one.errors.max())),
                one.structural_error,
                *(float(angle) for angle in np.degrees(one.transmission)),
                one.grashof,
                *(told.get(name, "") for name in names),
            ]
        )
    return text.getvalue()


def points_as_csv(design: LinkageDesign) -> str:
    """A table of the points of a path, and of how a design passes them."""
    text = StringIO(newline="")
    rows = csv.writer(text)
    rows.writerow(
        ["x [m]", "y [m]", "crank_angle [deg]", "error_x [m]", "error_y [m]", "error [m]"]
    )
    for point, angle, off in zip(
        design.path.points,
        np.degrees(design.angles),
        design.passed - design.path.points,
        strict=True,
    ):
        numbers = (point.real, point.imag, angle, off.real, off.imag, abs(off))
        rows.writerow([float(number) for number in numbers])
    return text.getvalue()


def design_lines(found: FoundDesigns) -> list[str]:
    """Lines for a terminal: the designs, the lengths of the best, and what the search claims."""
    lines = []
    for number, one in enumerate(found.designs, 1):
        low, high = np.degrees(one.transmission)
        lines.append(
            f"{number}: {kind_words(one)}: error {one.rms:.6g} m rms, {one.errors.max():.6g} m at "
            f"most; curve up to {one.structural_error:.3g} m from a spline through the points; "
            f"transmission angle {low:.1f} to {high:.1f} deg; {one.grashof}"
        )
    best = found.designs[0]
    lines += [f"  {name:<14}{told_value(name, value)}" for name, value in best.parameters.items()]
    lines += [
        f"  point {k}: off by {error:.6g} m at a crank angle of {angle:.3f} deg"
        for k, (error, angle) in enumerate(
            zip(best.errors, np.degrees(best.angles), strict=True), 1
        )
    ]
    lines.append(claim(found))
    return lines


def claim(found: FoundDesigns) -> str:
    """What the searches say of the best design."""
    return (
        f"{found.descents} descents found nothing better; of those refined, {found.reached} ended "
        f"within a factor 1.2 of the least error. They prove no optimum"
    )


def kind_words(design: LinkageDesign) -> str:
    """The kind and the assembly mode of a design."""
    if design.kind == "slider_crank":
        return "slider-crank"
    return f"{'open' if design.task.kind.mode > 0 else 'crossed'} four-bar"


def told_value(name: str, value: float) -> str:
    """A parameter with its unit, as a person reads it."""
    if name in ANGLE_NAMES:
        return f"{np.degrees(value): .6f} deg"
    return f"{value: .6g} m"


def shortfall(found: FoundDesigns) -> str:
    """Why no design is as asked, and by how much the nearest one misses; empty if one is."""
    near = found.nearest
    if not found.designs:
        if near.margin < 0.0:
            angle = np.degrees(near.task.transmission)
            return (
                f"no linkage within the bounds has a crank that turns fully with a transmission "
                f"angle from {angle:g} to {180 - angle:g} degrees; the nearest, a "
                f"{kind_words(near)}, lacks {-near.margin:.6g} m of length for it"
            )
        return "no linkage passes the points in their order within one turn of the crank"
    best = found.designs[0]
    worst = int(best.excess.argmax())
    if best.path.tolerances is not None and best.excess[worst] > 1.0:
        return (
            f"no linkage found meets the tolerances; the nearest misses point {worst + 1} by "
            f"{best.errors[worst]:.6g} m, where {best.path.tolerances[worst]:g} m are allowed"
        )
    return ""
