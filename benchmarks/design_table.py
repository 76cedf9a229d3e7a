"""What the thesis's balancers and ours are worth: a table, a sentence and a figure."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from analytic.balancer import solve
from analytic.balancer.measures import precision_points
from analytic.balancer.targets import TARGETS
from proofmass.report.style import RC

Row = dict[str, Any]
HELD = {"printed": (4, 2), "recomputed": (15, 15), "narrower": (7, 5)}  # digits that count


def missed(row: Row) -> list[str]:
    """What a design of ours is worse in, the print at its own digits."""
    words = []
    for kind, (fine, coarse) in HELD.items():
        theirs = row.get(kind, {"why": "-"})
        if "ours" in row and "why" not in theirs:
            if not round(row["ours"]["rmse"], fine) <= round(theirs["rmse"], fine):
                words.append(f"rmse {kind}")
            if not (round(row["ours"]["work_reduction"], coarse)
                    >= round(theirs["work_reduction"], coarse)):
                words.append(f"work reduction {kind}")
    return words


def table(rows: list[Row]) -> Iterator[str]:
    """The rows as a Markdown table."""
    yield ("| line | figure | target | segments | springs | free | printed | recomputed | ours | "
           "elbow | worse in | s |")
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for row in rows:
        held = {"recomputed": row.get("narrower", {"why": "-"}), "printed": {"why": "-"}, **row}
        pair = {k: held[k].get("why") or f"{held[k]['rmse']:.6f} / {held[k]['work_reduction']:.3f}"
                for k in ("printed", "recomputed", "ours")}
        yield (f"| {row['line'] or '-'} | {row['figure'] or '-'} | {row['target']} | "
               f"{row['segments']} | {row['variant']} | {row['option']} | {pair['printed']} | "
               f"{pair['recomputed']} | "
               f"{pair['ours']} | {'down' if 'mode' in row['parameters'] else 'up'} | "
               f"{', '.join(missed(row))} | {row['cpu_seconds']:.0f} |")


HEAD = """# Balancers designed again

`python -m benchmarks.design_balancer` made this. The first 112 rows are the variants of S. van Nes,
The use of a rigid linkage balancer with torsion springs to realize nonlinear moment-angle
characteristics, MSc thesis TU Delft 2022.074, figures M.1 to M.20: root mean square error over
m g r and work reduction in percent, as printed, of the printed parameters recomputed on the exact
path from rest, and of our design within the same bounds at the same points (90 for three segments,
15 for four). Below them stand the 56 variants that its tables M.1 to M.5 have a dash for, within
its widest bounds; in place of its figures they have those of our own design with an option less,
than which a design that may do more must not be worse. Every design of ours reaches 90 degrees on a
stable path and keeps its elbow bent, which is up, as in all of the thesis's tables, unless nothing
as good was found that way. "Worse in" compares with the print at its own digits. Parameters
stand in `balancer_designs.json`.

![Errors of the sharpest design of each target beside the thesis's best row](balancer_designs.png)

{summary}

"""


def summary(rows: list[Row]) -> str:
    """What came out, in one sentence."""
    theirs, dashes = ([row for row in rows if bool(row["line"]) is real] for real in (True, False))
    good, own = (sum(not missed(row) for row in part) for part in (theirs, dashes))
    ratio = np.median([row["ours"]["rmse"] / row["printed"]["rmse"] for row in theirs])
    used = [row["cpu_seconds"] for row in rows]
    down = sum("mode" in row["parameters"] for row in theirs)
    return (f"{good} of {len(theirs)} are as good as the thesis or better in all figures; {down} "
            f"of all have their elbow down. The median error is {ratio:.2f} of the printed one. "
            f"Of the {len(dashes)} where it has a dash, {own} are as good as ours with an option "
            f"less. CPU time: {sum(used):.0f} s in all, {max(used):.0f} s for the longest.")


def draw(rows: list[Row], thesis: dict[str, Row]) -> Figure:
    """Curves of the sharpest design of each target beside the thesis's best row."""
    angle = precision_points(180)
    with rc_context(RC):
        figure = Figure((9.5, 5.6), layout="constrained")
        for axes, name in zip(figure.subplots(2, 3).ravel(), TARGETS, strict=True):
            own = [row for row in rows if row["target"] == name]
            best = min(own, key=lambda row: row["ours"]["rmse"])
            theirs = max((row for row in own if "why" not in row["recomputed"]),
                         key=lambda row: row["recomputed"]["work_reduction"])
            wanted = TARGETS[name](angle)
            for label, line, row, look in (
                    ("thesis", theirs["line"], thesis[str(theirs["line"])], "--"),
                    ("ours", best["line"], best, "-")):
                error = solve(angle, **row["parameters"])["balancing_moment"] - wanted
                axes.semilogy(np.degrees(angle), np.abs(error), look, label=f"{label}, {line}")
            axes.set(xlabel="pendulum angle [deg]", ylabel="|M1 - target| / m g r")
            axes.set_title(name, loc="left")
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8)
        return figure
