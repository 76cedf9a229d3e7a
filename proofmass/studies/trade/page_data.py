"""What the work-precision diagram of a page shows, as one dict for its script.

Every setting is a marker, every convergence series a curve, and every kind of error a tab.
Numbers that are none are None.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from proofmass.front import nondominated
from proofmass.outcome import Outcome
from proofmass.report.case_data import finite
from proofmass.report.marks import MARKS, Tone
from proofmass.report.style import Look
from proofmass.studies.record import KINDS, NAN, StudyRow
from proofmass.studies.trade.advice import pasted, timed
from proofmass.studies.trade.figure import LOST, Name, good, letter, name_of, planned, work
from proofmass.studies.trade.noise import band, interval, perhaps
from proofmass.studies.trade.orders import off
from proofmass.studies.trade.verdict import Verdict, able, front
from proofmass.studies.trade.words import format_setting
from proofmass.wording import format_solver, number

TITLES = {
    "position": "Position",
    "velocity": "Velocity",
    "acceleration": "Acceleration",
    "force": "Force or torque",
    "energy": "Energy",
}
"""Kinds of errors as tabs."""


def page_data(
    rows: Sequence[StudyRow],
    verdicts: Sequence[Verdict],
    looks: Mapping[Name, Look],
    tones: Mapping[str, Tone],
    usual: float,
) -> dict[str, Any]:
    """All that the diagram of one run of a case shows.

    Parameters
    ----------
    rows, verdicts : sequence of StudyRow, sequence of Verdict
        The settings of that run, and the verdicts on its series.
    looks : mapping of (str, str) to Look
        The look of each series, from `figure.dressed`.
    tones : mapping of str to Tone
        Tones of the colours of these looks, for light and dark pages.
    usual : float
        Usual ratio of the greatest to the least wall time of a setting [1], from
        `noise.usual_spread`.
    """
    names = list(looks)
    return {
        "case": rows[0].case,
        "run": rows[0].run,
        "kinds": [kind_data(rows, verdicts, kind, looks, usual) for kind in kinds(rows)],
        "work": "segments" if all(row.varied == "segments" for row in rows) else "time steps",
        "series": [
            series_data(name, look, tones[look.colour], verdicts) for name, look in looks.items()
        ],
        "settings": [setting_data(row, rows, names.index(name_of(row)), usual) for row in rows],
        "top": LOST,
    }


def kinds(rows: Sequence[StudyRow]) -> list[str]:
    """Kinds of errors that there are."""
    return [kind for kind in KINDS if any(kind in row.errors for row in rows)]


def series_data(name: Name, look: Look, tone: Tone, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    """How a series is called and looks, and with which order its errors fall."""
    orders = {
        v.kind: f"order {number(v.observed)}, expected {number(v.expected)}"
        + (" ✗" if off(v.observed, v.expected) else "")
        for v in verdicts
        if name_of(v) == name and isfinite(v.observed)
    }
    return {
        "engine": name[0],
        "title": format_solver(name[0]),
        "name": name[1],
        "letter": letter(look),
        "css": tone.css,
        "mark": MARKS.get(look.marker, MARKS["o"]),
        "dash": list(look.dash[1]),
        "orders": orders,
    }


def setting_data(
    row: StudyRow, rows: Sequence[StudyRow], series: int, usual: float
) -> dict[str, Any]:
    """One marker."""
    steps = work(row) or planned(row, rows)
    low, at, high = interval(row, usual)
    return {
        "series": series,
        "words": format_setting(row),
        "ran": row.outcome == Outcome.RAN,
        "outcome": f"{row.outcome}: {row.message}" if row.message else str(row.outcome),
        "errors": {
            kind: row.errors[kind] for kind in kinds(rows) if isfinite(row.errors.get(kind, NAN))
        },
        "seconds": [finite(low), finite(at), finite(high)],
        "time": timed(row, usual) if row.seconds > 0 else "",
        "repeats": len(row.repeats),
        "work": finite(steps) or None,
        "step": f"{number(1e3 * row.step)} ms" if row.step > 0 else "",
        "violation": finite(row.invariants.get("violation", NAN)),
        "energy": finite(row.invariants.get("energy", NAN)),
        "load": finite(row.load),
        "text": pasted(row),
    }


def kind_data(
    rows: Sequence[StudyRow],
    verdicts: Sequence[Verdict],
    kind: str,
    looks: Mapping[Name, Look],
    usual: float,
) -> dict[str, Any]:
    """The fronts and the error floors of a kind of error, settings and series by their numbers.

    `front` is that of the least wall times; `tied` are the settings that may be on it as well, for
    all the clock can tell; `band` is where the front lies; `fewest` is the front over steps.
    """
    shown = [row for row in rows if good(row, kind)]
    numbers = {id(row): k for k, row in enumerate(rows)}
    best = [numbers[id(row)] for row in front(shown, kind)]
    maybe = [numbers[id(row)] for row in perhaps(shown, kind, usual)]
    stepped = [row for row in able(shown, kind) if work(row) > 0]
    aims = np.array([(work(row), row.errors[kind]) for row in stepped]).reshape(-1, 2)
    names = list(looks)
    return {
        "key": kind,
        "title": TITLES[kind],
        "front": best,
        "tied": [k for k in maybe if k not in best],
        "band": band(shown, kind, usual),
        "fewest": [numbers[id(stepped[k])] for k in nondominated(aims)],
        "floors": [
            {
                "series": names.index(name_of(v)),
                "level": v.floor,
                "cause": v.cause,
                "evidence": v.evidence,
            }
            for v in verdicts
            if v.kind == kind and v.floor > 0 and name_of(v) in looks
        ],
    }
