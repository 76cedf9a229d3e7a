"""The data of a case's page as one dict for JSON, which the scripts of the page draw.

The data of study pages are made in their own folders, such as `proofmass.studies.trade.page`.

Curves are little-endian binary numbers in base64: the reference as float64, the signed differences
of the solvers to it as float32, whose rounding is 6e-8 of a difference.  All values are in SI; the
factors to the displayed units are given with them.  Poses of the mechanism are integers of 16 bits
with a scale; their rounding, 3e-5 of the largest value, is too small to be seen in a drawing.
"""

import json
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from proofmass.base.arrays import Array
from proofmass.base.json_values import replace_nonfinite
from proofmass.base.wording import format_unit
from proofmass.case.case import Case
from proofmass.report.data import PlottedRun, displayed_unit, drive_curves, drive_units
from proofmass.report.style import Look
from proofmass.report.svg_markers import MARKER_PATHS
from proofmass.report.tables import format_setting
from proofmass.report.words import RUNS, quantity_kind
from proofmass.sim.engines import format_solver, is_variant
from proofmass.sim.motion import Motion
from proofmass.sim.picture import Picture
from proofmass.verdict.compare import scale_of
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import FAILED_OUTCOMES, Outcome

MAX_PAGE_BYTES = 700_000  # [bytes] largest size of a page, with its data
MAX_RUNS_CHARACTERS = 560_000
"""Largest size of the runs' data [characters], before the rest of the page is known."""
LARGEST_INTEGER = 2**15 - 1  # largest integer of 16 bits
MIN_REFERENCE_SHIFT = 1e-3
"""A solver's reference that is farther from the drawn one than this share of its range has a curve
of its own."""


def case_data(
    case: Case,
    recorded: Mapping[str, Any],
    motions: Mapping[str, Motion],
    style: Mapping[str, Look],
) -> dict[str, Any]:
    """Return the dict of a case.

    Parameters
    ----------
    case : Case
    recorded : mapping
        From `recorded_data`.
    motions : mapping of str to Motion
        Motions of the mechanism by run.
    style : mapping of str to Look
        From `proofmass.report.style.solver_looks`.

    Returns
    -------
    dict
        For ``json.dumps``.
    """
    solvers = [solver for run in recorded["runs"].values() for solver in run["solvers"]]
    return {
        "name": case.name,
        "title": case.title,
        "parameters": dict(case.parameters),
        "solvers": {solver: solver_data(solver, style) for solver in solvers},
        **recorded,
        "motions": {kind: motion_data(motion) for kind, motion in motions.items()},
    }


def recorded_data(case: Case, runs: Iterable[PlottedRun]) -> dict[str, Any]:
    """Return the part of the dict that needs the model: drives, curves and comparisons of runs."""
    runs = list(runs)
    units = drive_units(case) if any(run.curves for run in runs) else [""] * len(case.drive)
    return {
        "drives": [
            {"joint": drive.joint, "unit": unit}
            for drive, unit in zip(case.drive, units, strict=True)
        ],
        "runs": runs_data(runs, MAX_RUNS_CHARACTERS),
    }


def runs_data(runs: Sequence[PlottedRun], max_characters: int) -> dict[str, Any]:
    """Return the data of the runs by kind, in at most `max_characters` characters.

    Samples are left out, first of the runs that have most.  Ends, extremes, jumps and the places of
    the largest errors are kept, even if the data are then longer than `max_characters`.
    """
    lengths = {run.kind: len(run.longest.x) for run in runs if run.curves}
    most = max(lengths.values(), default=1)  # samples of a run, without those that must be kept
    while True:
        every = {kind: -(-length // most) for kind, length in lengths.items()}
        found: dict[str, Any] = {run.kind: run_data(run, every.get(run.kind, 1)) for run in runs}
        if (size := len(script_json(found))) <= max_characters or most == 1:
            return found
        most = max(min(most * max_characters // size, most - 1), 1)


def script_json(data: Mapping[str, Any]) -> Markup:
    """Return a dict as JSON that is safe in an element ``script``."""
    text = json.dumps(replace_nonfinite(data), separators=(",", ":"), allow_nan=False, default=str)
    return Markup(text.replace("<", "\\u003c"))


def solver_data(solver: str, style: Mapping[str, Look]) -> dict[str, Any]:
    """Return the label of a solver, its dash pattern, and its marker as a path of SVG."""
    look = style[solver]
    return {
        "label": format_solver(solver),
        "dash": list(look.dash[1]),
        "marker": MARKER_PATHS[look.marker],
        "variant": is_variant(solver),
    }


def run_data(run: PlottedRun, every: int) -> dict[str, Any]:
    """Return the data of a run: samples, curves of the reference, and differences of solvers.

    One of every `every` samples is drawn, see `kept_samples`.
    """
    found: dict[str, Any] = {
        "label": RUNS[run.kind].label,
        "solvers": {},
        "failed": {s: {"outcome": str(c.outcome), "why": c.message} for s, c in run.failed.items()},
        "channels": {},
    }
    for solver in run.solvers:
        own = {c.channel: comparison_data(run, c) for c in run.rows if c.solver == solver}
        if own:
            found["solvers"][solver] = {"comparisons": own}
    if not run.curves:
        return found
    index = kept_samples(run, every)
    x = run.longest.x
    found |= {
        "x": encode_numbers(x[index], "<f8"),
        "name": run.x_name,
        "unit": run.x_unit,
        "scale": run.x_scale,
        "samples": len(x),
        "every": every,
        "drawn": len(index),
    }
    for name in run.channels:
        channel = run.case.channels[name]
        unit, factor = displayed_unit(channel.unit)
        curve = run.longest.channels[name]
        found["channels"][name] = {
            "unit": format_unit(channel.unit),
            "factor": 1 / channel.factor,
            "read": format_unit(unit),
            "read_factor": factor if unit.startswith("deg") else 1 / channel.factor,
            "kind": quantity_kind(channel.unit),
            "range": float(np.ptp(curve)) / channel.factor,
            "curve": encode_numbers(curve[index], "<f8"),
        }
        if places := run.jumps.of(name):
            found["channels"][name]["jumps"] = np.searchsorted(index, places).tolist()
    for solver, curves in run.curves.items():
        reference, drawn = run.reference[solver], index[index < len(curves.x)]
        one = found["solvers"][solver]
        one |= {
            "stopped": curves.stopped,
            "end": float(curves.x[-1]),
            "early": len(curves.x) < len(x),
            "seconds": curves.seconds,
            "steps": curves.steps,
            "violation": curves.violation,
            "settings": {key: format_setting(value) for key, value in curves.settings.items()},
            "differences": {},
            "shifts": {},
            "jumps": {},
        }
        for name in run.channels:
            if name not in curves.channels:
                continue
            wanted = reference.channels[name]
            one["differences"][name] = encode_numbers(
                (curves.channels[name] - wanted)[drawn], "<f4"
            )
            if places := run.jumps_of[solver].of(name):
                one["jumps"][name] = np.searchsorted(index, places).tolist()
            shift = wanted - run.longest.channels[name][: len(wanted)]
            if np.nan_to_num(np.abs(shift)).max() > MIN_REFERENCE_SHIFT * (
                np.ptp(wanted) or np.inf
            ):
                one["shifts"][name] = encode_numbers(shift[drawn], "<f4")
    for name, (profile, moved, unit) in drive_curves(run).items():
        read, factor = displayed_unit(unit)
        found["channels"][name] = {
            "unit": format_unit(unit),
            "factor": 1.0,
            "read": format_unit(read),
            "read_factor": factor,
            "kind": "drive",
            "range": float(np.ptp(profile)),
            "curve": encode_numbers(profile[index], "<f8"),
        }
        for solver, values in moved.items():
            drawn = index[index < len(values)]
            found["solvers"][solver]["differences"][name] = encode_numbers(
                values[drawn] - profile[drawn], "<f4"
            )
    return found


def kept_samples(run: PlottedRun, every: int) -> Array:
    """Return the samples that are drawn.

    These are one of every `every` samples, the last one, extremes, both sides of jumps, and the
    places of the largest errors.
    """
    x = run.longest.x
    chosen = {*range(0, len(x), every), len(x) - 1}
    for jumps in (run.jumps, *run.jumps_of.values()):
        chosen |= {side for k in jumps.every() for side in (k, k + 1) if side < len(x)}
    for curve in run.longest.channels.values() if every > 1 else ():
        if np.isfinite(curve).any():
            chosen |= {int(np.nanargmin(curve)), int(np.nanargmax(curve))}
    for c in run.rows if every > 1 else ():
        if np.isfinite(c.at):
            chosen.add(int(np.abs(x - c.at).argmin()))
    return np.array(sorted(chosen))


def comparison_data(run: PlottedRun, c: Comparison) -> dict[str, Any]:
    """Return a comparison, with the errors as shares of the range for the page's first table."""
    scale = float("nan")
    if c.solver in run.curves and c.channel in run.reference[c.solver].channels:
        curves, reference = run.curves[c.solver], run.reference[c.solver].channels[c.channel]
        factor = run.case.channels[c.channel].factor
        scale = scale_of(run.case, run.kind, c.channel, curves, reference) / factor
    tolerance = run.case.tolerance_for(run.kind, c.solver, c.channel)
    failed = c.outcome in (*FAILED_OUTCOMES, Outcome.UNSUPPORTED)
    agrees = c.outcome == Outcome.AGREES  # then the message is the reason of the tolerance
    return {
        "outcome": str(c.outcome),
        "message": "" if agrees else c.message,
        "error": finite_or_none(c.error_max),
        "at": finite_or_none(c.at),
        "later": round_share(c.error_later / scale if scale else np.nan),
        "allowed": None if failed else finite_or_none(c.allowed),
        "share": round_share(c.error_max / scale if scale else np.nan),
        "allowed_share": None if failed else round_share(c.allowed / scale if scale else np.nan),
        "ratio": None if failed or not c.allowed > 0 else round_share(c.share_of_allowed),
        "why": tolerance.why if tolerance else "",
        "detectable": {
            name: [round_share(change.size), change.relative]
            for name, change in c.detectable.items()
        },
    }


def motion_data(motion: Motion) -> dict[str, Any]:
    """Return the mechanism of a run at its poses; links of a rod are the points of a line."""
    picture = motion.picture
    in_rods = {k for links in motion.rods.values() for k in links}
    rigid = [k for k in range(len(motion.bodies)) if k not in in_rods]
    number = {k: i for i, k in enumerate(rigid)}
    spots = list[dict[str, Any]]()
    for spot in motion.spots:
        one: dict[str, Any] = {
            "name": spot.name,
            "kind": spot.kind,
            "body": number.get(spot.body, -1),
            "at": round_points(spot.at),
            "to": None if spot.to is None else round_points(spot.to),
            "driven": spot.driven,
            "ground": spot.ground,
            "spring": spot.spring,
        }
        if spot.body in in_rods:  # a spot on a rod's link refers to a line of one point
            one["rod"] = len(spots)
        spots.append(one)
    projected = list[dict[str, Any]]()
    if motion.along:
        projected, spots = projected_data(picture)
    return {
        "x": encode_numbers(picture.x, "<f8"),
        "axes": list(picture.axes),
        "along": motion.along,
        "stopped": picture.stopped,
        "used": list(motion.used),
        "unfit": motion.unfit,
        "bodies": [
            {
                "name": motion.bodies[k].name,
                "outlines": list(map(round_points, motion.bodies[k].outlines)),
            }
            for k in rigid
        ],
        "ground": [round_points(outline[0]) for outline in picture.ground.outlines],
        "spots": spots,
        "lines": [
            {
                "name": name,
                **line_data(motion, rod_vertices(motion, links)),
            }
            for name, links in motion.rods.items()
        ]
        + projected
        + [
            {"spot": i, **line_data(motion, [(spot.body, spot.at)])}
            for i, spot in enumerate(motion.spots)
            if spot.body in in_rods
        ],
        "coils": [
            {
                "name": coil.name,
                "body": [number.get(body, -1) for body in coil.body],
                "at": [round_points(at) for at in coil.at],
            }
            for coil in motion.coils
            if not in_rods & set(coil.body)
        ],
        "places": encode_integers(motion.places[:, rigid]),
        "away": {s: encode_integers(rows[:, rigid]) for s, rows in motion.away.items()},
        "limits": {name: np.flatnonzero(on).tolist() for name, on in motion.at_limit.items()},
        "jumps": list(motion.jumps),
    }


def projected_data(picture: Picture) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return lines and spots of a mechanism in space, projected to the drawing at all poses."""
    lines = list[dict[str, Any]]()
    for link in picture.links:
        for outline in link.outlines:
            closed = np.concatenate([outline, outline[:, :1]], axis=1)
            shape = closed if outline.shape[1] > 2 else outline
            lines.append({"name": link.name, "points": encode_integers(shape), "away": {}})
    for coil in picture.coils:
        lines.append(
            {"name": coil.name, "points": encode_integers(coil.ends), "away": {}, "coil": True}
        )
    spots = list[dict[str, Any]]()
    for mark in picture.marks:
        number = len(spots)
        spots.append(
            {
                "name": mark.name,
                "kind": mark.kind,
                "body": -1,
                "at": [0.0, 0.0],
                "to": None,
                "driven": mark.driven,
                "ground": mark.ground,
                "spring": False,
                "rod": number,
            }
        )
        lines.append({"spot": number, "points": encode_integers(mark.at[:, None]), "away": {}})
    return lines, spots


def rod_vertices(motion: Motion, links: tuple[int, ...]) -> list[tuple[int, Array]]:
    """Return the vertices of a rod's line: the start of each link, and the far end of the last."""
    found = [(link, np.zeros(2)) for link in links]
    points = np.vstack([np.zeros((1, 2)), *motion.bodies[links[-1]].outlines])
    return [*found, (links[-1], points[np.linalg.norm(points, axis=1).argmax()])]


def line_data(motion: Motion, places: list[tuple[int, Array]]) -> dict[str, Any]:
    """Return points of bodies at all poses, and the differences of the solvers to them."""
    bodies = [body for body, _ in places]
    about = np.array([at for _, at in places])
    turn = motion.places[:, bodies, 2]
    cos, sin = np.cos(turn), np.sin(turn)
    turned = np.stack(
        [cos * about[:, 0] - sin * about[:, 1], sin * about[:, 0] + cos * about[:, 1]], axis=-1
    )
    across = np.stack([-turned[..., 1], turned[..., 0]], axis=-1)
    return {
        "points": encode_integers(motion.places[:, bodies, :2] + turned),
        "away": {
            solver: encode_integers(rows[:, bodies, :2] + rows[:, bodies, 2:] * across)
            for solver, rows in motion.away.items()
        },
    }


def round_points(points: Array) -> list[float]:
    """Return the coordinates of points one after the other, to six digits."""
    return [float(f"{value:.6g}") for value in np.ravel(points)]


def finite_or_none(value: float) -> float | None:
    """Return a number if it is finite, else None: JSON has no NaN."""
    return float(value) if np.isfinite(value) else None


def round_share(value: float) -> float | None:
    """Return a finite number to four digits, else None; for shares, which are shown with two."""
    return float(f"{value:.4g}") if np.isfinite(value) else None


def encode_numbers(values: Array, kind: str) -> str:
    """Encode numbers as base64; `kind` is their type in numpy's notation."""
    return b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def encode_integers(rows: Array) -> dict[str, Any]:
    """Encode an array as integers of 16 bits, with a scale for each entry of its last axis.

    The least integer stands for a value that is not finite.
    """
    flat = rows.reshape(-1, rows.shape[-1])
    largest = np.nan_to_num(np.abs(flat), posinf=0.0).max(axis=0, initial=0.0)
    scale = np.where(largest > 0, largest, 1.0) / LARGEST_INTEGER
    numbers = np.where(
        np.isfinite(flat), np.round(np.nan_to_num(flat) / scale), -LARGEST_INTEGER - 1
    )
    return {
        "shape": list(rows.shape),
        "scale": scale.tolist(),
        "numbers": encode_numbers(numbers, "<i2"),
    }
