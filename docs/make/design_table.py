"""The thesis's balancers compared with ours: a table, a summary and figures."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import TARGETS, precision_points
from proofmass.report.style import RC

Row = dict[str, Any]
KEY = ("target", "segments", "variant", "option")
SAME_SHARE = 0.01  # of an error: two designs that differ by less are equally good
DIGITS = {"printed": (4, 2), "recomputed": (15, 15), "narrower": (7, 5)}  # decimals compared


def compare_figures(row: Row) -> dict[str, int]:
    """Each figure of our design compared with the others': 1 better, 0 the same, -1 worse."""
    found = {}
    for kind, (fine, coarse) in DIGITS.items():
        theirs = row.get(kind, {"why": "-"})
        if "ours" in row and "why" not in theirs:
            for name, digits, sign in (("rmse", fine, -1), ("work_reduction", coarse, 1)):
                own, other = (round(of[name], digits) for of in (row["ours"], theirs))
                found[f"{name.replace('_', ' ')} {kind}"] = sign * ((own > other) - (own < other))
    return found


def worse_figures(row: Row) -> list[str]:
    """The figures in which our design is worse, printed ones at their own digits."""
    return [figure for figure, sign in compare_figures(row).items() if sign < 0]


def table(rows: list[Row]) -> Iterator[str]:
    """The rows as a Markdown table."""
    yield (
        "| line | figure | target | segments | springs | free | printed | recomputed | ours | "
        "elbow | worse in | s |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|---|"
    for row in rows:
        known = {"recomputed": row.get("narrower", {"why": "-"}), "printed": {"why": "-"}, **row}
        pair = {
            k: known[k].get("why") or f"{known[k]['rmse']:.6f} / {known[k]['work_reduction']:.3f}"
            for k in ("printed", "recomputed", "ours")
        }
        yield (
            f"| {row['line'] or '-'} | {row['figure'] or '-'} | {row['target']} | "
            f"{row['segments']} | {row['variant']} | {row['option']} | {pair['printed']} | "
            f"{pair['recomputed']} | "
            f"{pair['ours']} | {'down' if 'mode' in row['parameters'] else 'up'} | "
            f"{', '.join(worse_figures(row))} | {row['cpu_seconds']:.0f} |"
        )


HEAD = """# Balancers designed again

`python -m docs.make.design_balancer` made this page. The first 112 rows of the table are the
variants in figures M.1 to M.20 of S. van Nes, The use of a rigid linkage balancer with torsion
springs to realize nonlinear moment-angle characteristics, MSc thesis TU Delft 2022.074. Each row
has three pairs of root mean square error over m g r and work reduction in percent: as printed; of
the printed parameters, recomputed on the exact path from rest; and of our design within the same
bounds at the same points (90 for three segments, 15 for four).

The next 56 rows are the variants for which the thesis's tables M.1 to M.5 have a dash, within its
widest bounds. In place of the thesis's numbers they have those of our own design with one option
less: a design with more freedom must not be worse. The last 40 rows, "preload 3", are the rows "3
Seg.: prestress spring 3" of the thesis's figures, all of them dashes, within the bounds of the
figures.
In place of the thesis's numbers they have those of our own design without a preload. Where the rest
angle is free, both signs of the preload were tried. The joint limit of a preload keeps joint 3 on
one side, so that such a design may be worse than one without a preload.

Every design of ours reaches 90 degrees on a stable path and keeps its elbow bent. It still does so
if a parameter changes by a millionth of the distance between its bounds: the least errors lie where
a fold or a joint that stays on its stop is just avoided, and there the last digits would decide.
The elbow is up, as in all of the thesis's tables, unless no design as good was found in this way.
"Worse in" lists the numbers in which our design is worse; printed numbers are compared at the
printed digits. The parameters are in `balancer_designs.json`.

![Errors of our best design of each target and of the thesis's best row](balancer_designs.png)

The thesis's figures 5 and 6 show the work reduction of its balancers of three and of four segments.
The following figures show it together with that of our designs, and with the rows that the thesis
left out.

![Work reduction of three segments by target and system: printed, and ours](balancer_designs_3.png)

![Work reduction of four segments by target and system: printed, and ours](balancer_designs_4.png)

{summary}

"""


def summary(rows: list[Row]) -> str:
    """The result in a few sentences."""
    theirs, dashes = ([row for row in rows if bool(row["line"]) is real] for real in (True, False))
    third = [row for row in dashes if row["variant"].endswith("3")]
    dashes = [row for row in dashes if row not in third]
    least = {row["line"]: min(compare_figures(row).values()) for row in theirs}
    same, worse = ([line for line, sign in least.items() if sign == own] for own in (0, -1))
    up = [row for row in theirs if "mode" not in row["parameters"]]
    ratio = np.median([row["ours"]["rmse"] / row["printed"]["rmse"] for row in theirs])
    used = [row["cpu_seconds"] for row in rows]
    return (
        f"Of {len(theirs)} designs {len(theirs) - len(same) - len(worse)} are better than the "
        f"thesis's in all numbers; {len(same)} are the same at the printed digits in some number "
        f"and worse in none (lines {listed(same)}); {len(worse)} are worse in some number "
        f"(lines {listed(worse)}). {len(theirs) - len(up)} of the {len(theirs)} have their "
        f"elbow down, where the thesis has it up; {sum(least[row['line']] >= 0 for row in up)} "
        f"are as good or better with the elbow up. The median error is {ratio:.2f} of the "
        f"printed one. Of the {len(dashes)} designs where the thesis has a dash, "
        f"{sum(not worse_figures(row) for row in dashes)} are at least as good as ours with one "
        f"option less. {gain_of_spring_3(third, rows)}"
        f"CPU time: {sum(used):.0f} s in all, {max(used):.0f} s for the longest."
    )


def gain_of_spring_3(third: list[Row], rows: list[Row]) -> str:
    """A sentence on the gain by a preload of spring 3."""
    if not third:
        return ""
    known = {tuple(row[k] for k in KEY): row["ours"]["rmse"] for row in rows}
    others = {"preload 3": "preload", "nonlinear preload 3": "nonlinear preload"}
    beaten, better = 0, 0
    for row in third:
        second = known[tuple((row | {"variant": others[row["variant"]]})[k] for k in KEY)]
        beaten += row["ours"]["rmse"] < (1 - SAME_SHARE) * second
        better += row["ours"]["rmse"] < (1 - SAME_SHARE) * row["narrower"]["rmse"]
    return (
        f"With a preload of spring 3 the error is at least {SAME_SHARE:.0%} less than without a "
        f"preload in {better} of {len(third)} rows, and at least {SAME_SHARE:.0%} less than with "
        f"a preload of spring 2 in {beaten} rows. "
    )


def listed(lines: list[int]) -> str:
    """Line numbers of the thesis, separated by commas."""
    return ", ".join(map(str, lines)) or "none"


def page(rows: list[Row]) -> str:
    """docs/balancer_designs.md."""
    return HEAD.format(summary=summary(rows)) + "\n".join(table(rows)) + "\n"


def draw(rows: list[Row], thesis: dict[str, Row]) -> Figure:
    """The figure of the errors of our best design and the thesis's best row of each target."""
    angle = precision_points(180)
    with rc_context(RC):
        figure = Figure((9.5, 5.6), layout="constrained")
        names = dict.fromkeys(row["target"] for row in rows)
        for axes, name in zip(figure.subplots(2, 3).ravel(), names, strict=True):
            own = [row for row in rows if row["target"] == name]
            best = min(own, key=lambda row: row["ours"]["rmse"])
            theirs = max(
                (row for row in own if "why" not in row["recomputed"]),
                key=lambda row: row["recomputed"]["work_reduction"],
            )
            wanted = TARGETS[name](angle)
            for label, line, row, look in (
                ("thesis", theirs["line"], thesis[str(theirs["line"])], "--"),
                ("ours", best["line"], best, "-"),
            ):
                error = solve(angle, **row["parameters"])["balancing_moment"] - wanted
                axes.semilogy(np.degrees(angle), np.abs(error), look, label=f"{label}, {line}")
            axes.set(xlabel="pendulum angle [deg]", ylabel="|M1 - target| / m g r")
            axes.set_title(name, loc="left", pad=20.0)  # points: the legend's line is below
            axes.legend(
                loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8, borderaxespad=0.0
            )
        return figure


SYSTEMS = {  # of the thesis's figures 5 and 6, with a preload of spring 3 added
    ("regular", "standard"): ("#0072B2", "regular"),
    ("preload", "standard"): ("#D55E00", "preload"),
    ("preload 3", "standard"): ("#E69F00", "preload of spring 3"),
    ("regular", "rest angle"): ("#009E73", "rest angle free"),
    ("preload", "rest angle"): ("#882255", "preload, rest angle free"),
    ("preload 3", "rest angle"): ("#CC79A7", "preload of spring 3, rest angle free"),
}
REDUCTIONS = (40, 60, 80, 90, 95, 98, 99, 99.5, 99.8, 99.9, 99.99)  # [%] ticks of the axis


def has_system(rows: list[Row], segments: int, variant: str, option: str) -> bool:
    """Whether the rows have such a system."""
    wanted = segments, variant, option
    return any((row["segments"], row["variant"], row["option"]) == wanted for row in rows)


def draw_systems(rows: list[Row], segments: int) -> Figure:
    """The figure of work reduction by target and system: printed left, ours right."""
    names = list(dict.fromkeys(row["target"] for row in rows if row["line"]))
    with rc_context(RC):
        figure = Figure((9.5, 4.6), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, kind, title in zip(
            panels, ("printed", "ours"), ("thesis, as printed", "designed again"), strict=True
        ):
            shown = {s: look for s, look in SYSTEMS.items() if has_system(rows, segments, *s)}
            for k, ((variant, option), (colour, label)) in enumerate(shown.items()):
                for springs, marker in (("", "o"), ("nonlinear ", "s")):
                    word = f"{springs}{variant}".replace("nonlinear regular", "nonlinear")
                    own = [
                        row
                        for row in rows
                        if (row["segments"], row["variant"], row["option"])
                        == (segments, word, option)
                        and kind in row
                    ]
                    x = [
                        names.index(row["target"]) + 0.1 * (k - (len(shown) - 1) / 2) for row in own
                    ]
                    left = [100.0 - row[kind]["work_reduction"] for row in own]
                    text = f"{label}, nonlinear springs" if springs else label
                    axes.plot(
                        x,
                        left,
                        marker,
                        color=colour,
                        markersize=4.5,
                        label=text if own else None,
                        markerfacecolor="none" if springs else colour,
                    )
            axes.set_title(title)
            axes.set_xticks(range(len(names)), [name.replace("-", "-\n") for name in names])
            axes.set(xlabel="target", yscale="log", xlim=(-0.5, len(names) - 0.5))
            axes.set_yticks([100.0 - w for w in REDUCTIONS], [f"{w:g}" for w in REDUCTIONS])
            axes.minorticks_off()
        panels[0].set(ylabel="work reduction [%]", ylim=(65.0, 0.005))
        figure.legend(*panels[1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        return figure
