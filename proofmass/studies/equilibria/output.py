"""Equilibria of an assembly as rows, in a table of the terminal, CSV, JSON and a figure."""

import csv
from io import BytesIO, StringIO
from typing import Any

import numpy as np
from rich.table import Table

from proofmass.analytic.rods.assembly_search import RodEquilibria
from proofmass.base.wording import format_count, number
from proofmass.studies.equilibria.engine_rests import ELSEWHERE, STAYS, EngineRest
from proofmass.studies.equilibria.rod_input import RodInput

MAX_PANELS_DRAWN = 60
"""Equilibria that are drawn; of more, those of the lowest potential."""
COLUMNS_DRAWN = 6
"""Panels in a row of the figure."""
DRAWN_NODES = 121
"""Points of a drawn rod."""
STABLE_COLOUR, UNSTABLE_COLOUR, PLATFORM_COLOUR = "#0072B2", "#9A9A9A", "#D55E00"


EngineRests = dict[str, list[EngineRest]]
"""Where engines come to rest from the shape of each equilibrium, by engine."""


def equilibrium_rows(
    own: RodInput, found: RodEquilibria, rests: EngineRests
) -> list[dict[str, Any]]:
    """One row of numbers in SI units for each equilibrium, the lowest potential first."""
    a, state = found.problem.assembly, found.state
    rows = []
    for n in range(len(found)):
        row: dict[str, Any] = {
            "number": n + 1,
            "stable": bool(found.index[n] == 0),
            "index": int(found.index[n]),
            "potential": float(found.potential[n]),
            "energy": float(found.energy[n]),
            "x": float(state.pose[n, 0]),
            "y": float(state.pose[n, 1]),
            "phi": float(state.pose[n, 2]) if a.dof == 3 else None,
        }
        for i, name in enumerate(own.names):
            row |= {
                f"{name}.inflections": int(found.inflections[n, i]),
                f"{name}.alpha": float(found.alpha[n, i]),
                f"{name}.force_x": float(state.own[n, i, 0]),
                f"{name}.force_y": float(state.own[n, i, 1]),
                f"{name}.tip_moment": float(state.own[n, i, 2]) if a.clamped[i] else 0.0,
                f"{name}.clamp_moment": float(found.clamp_moment[n, i]),
            }
        row["residual"] = float(found.residual[n])
        for engine, ends in rests.items():
            row[engine] = ends[n].words
            row[f"{engine}.rests_in"] = ends[n].number
            row[f"{engine}.distance"] = ends[n].distance if ends[n].is_run else None
        rows.append(row)
    return rows


def equilibrium_table(found: RodEquilibria, rests: EngineRests) -> Table:
    """The table of the terminal."""
    a, state = found.problem.assembly, found.state
    table = Table(box=None, header_style="bold", pad_edge=False)
    heads = ["no.", "stability", "V [J]", "bending [J]", "x [m]", "y [m]"]
    heads += ["phi [deg]"] if a.dof == 3 else []
    heads += ["inflections", "largest alpha", "clamp moments [N m]", *rests]
    for head in heads:
        table.add_column(head, justify="left" if head == "stability" else "right")
    for n in range(len(found)):
        cells = [str(n + 1), format_stability(int(found.index[n]))]
        cells += [number(found.potential[n], 4), number(found.energy[n], 4)]
        cells += [f"{value:.4f}" for value in state.pose[n, :2]]
        cells += [f"{np.degrees(state.pose[n, 2]):.2f}"] if a.dof == 3 else []
        cells.append(", ".join(map(str, found.inflections[n])))
        cells.append(f"{found.alpha[n].max():.2f}")
        cells.append(", ".join(number(value, 3) for value in found.clamp_moment[n]))
        cells += [ends[n].words.partition(":")[0] for ends in rests.values()]
        table.add_row(*cells, style="bold" if found.index[n] == 0 else None)
    return table


def format_stability(index: int) -> str:
    """Whether an equilibrium is stable, by the number of its unstable directions.

    >>> format_stability(0), format_stability(2)
    ('stable', 'index 2')
    """
    return f"index {index}" if index else "stable"


def summary_lines(own: RodInput, found: RodEquilibria) -> list[str]:
    """The number of equilibria, and how complete they are, as sentences."""
    limits, stable = found.limits, int((found.index == 0).sum())
    words = "equilibria" if len(found) != 1 else "equilibrium"
    lines = [
        f"{own.title}: {len(found)} {words}, {stable} stable, with up to "
        f"{format_count(limits.inflections, 'inflection')} of a rod and loads up to "
        f"R = {limits.alpha:.4g}² EI/L²"
    ]
    if found.problem.assembly.clamped.any():
        lines[0] += f"; rods with two clamps turn by up to {limits.turns:g} turn(s)"
    lines.append(completeness(found))
    return lines


def rest_lines(found: RodEquilibria, rests: EngineRests) -> list[str]:
    """How many equilibria engines come to rest in, and why some were not run, as sentences."""
    stable, lines = found.index == 0, []
    for engine, ends in rests.items():
        run = np.array([end.is_run for end in ends])
        stays = np.array([end.words == STAYS for end in ends])
        line = (
            f"{engine}, started from the shape of each: stays in {int((stays & stable).sum())} of "
            f"the {int((run & stable).sum())} stable ones, and leaves "
            f"{int((~stays & run & ~stable).sum())} of the {int((run & ~stable).sum())} unstable "
            "ones"
        )
        elsewhere = [n + 1 for n, end in enumerate(ends) if end.words == ELSEWHERE]
        if elsewhere:
            line += f"; from no. {format_numbers(elsewhere)} it goes to a rest that is none of them"
        lines.append(line + ".")
        for why in dict.fromkeys(end.words for end in ends if not end.is_run):
            numbers = [n + 1 for n, end in enumerate(ends) if end.words == why]
            lines.append(f"{engine}, no. {format_numbers(numbers)}: {why}")
    return lines


def format_numbers(numbers: list[int]) -> str:
    """Rising numbers as text, three or more in a row as a range.

    >>> format_numbers([1, 2, 3, 5, 7, 8])
    '1 to 3, 5, 7, 8'
    """
    rows = [
        [numbers[k] for k in own]
        for own in np.split(np.arange(len(numbers)), np.flatnonzero(np.diff(numbers) != 1) + 1)
    ]
    return ", ".join(
        f"{row[0]} to {row[-1]}" if len(row) > 2 else ", ".join(map(str, row)) for row in rows
    )


def completeness(found: RodEquilibria) -> str:
    """Which part of the completeness is proven, and which is tested, as a sentence."""
    if not found.problem.assembly.is_plain:
        return (
            "Completeness is not proven: no bound of the loads is known. In thirty random "
            "assemblies with loads up to R = 7² EI/L² random starts of an independent method "
            "found no other equilibrium (docs/rod_assemblies.md); with larger loads random starts "
            "may miss some."
        )
    if found.is_bounded:
        return (
            f"It is proven that no rod of another equilibrium with as few inflections carries more "
            f"than R = {found.bound:.4g}² EI/L², and all up to there were searched for; that none "
            "below is missed is tested, not proven."
        )
    return (
        "Equilibria with larger loads may exist; that none below is missed is tested, not proven."
    )


def equilibria_csv(rows: list[dict[str, Any]]) -> str:
    """Rows as CSV; numbers with all digits, in SI units."""
    text = StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def draw_equilibria(own: RodInput, found: RodEquilibria, rests: EngineRests, ending: str) -> bytes:
    """A figure with a panel for each equilibrium, stable ones bold, all at the same scale."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from proofmass.report.style import RC

    shown = min(len(found), MAX_PANELS_DRAWN)
    columns = min(COLUMNS_DRAWN, max(shown, 1))
    lines = rod_lines(found)
    everything = np.concatenate([line[:, :shown].ravel() for line in lines])
    low = np.array([everything.real.min(), everything.imag.min()])
    size = np.array([np.ptp(everything.real), np.ptp(everything.imag)])
    margin = 0.05 * size.max()
    with rc_context(RC):
        rows = -(-shown // columns)
        ratio = (size[1] + 2 * margin) / (size[0] + 2 * margin)
        title = 0.35 + 0.12 * len(rests)
        figure = Figure((8.0, rows * (8.0 / columns * ratio + title) + 0.4), layout="constrained")
        panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        for n, axes in enumerate(panels):
            axes.set_axis_off()
            if n >= shown:
                continue
            stable = found.index[n] == 0
            for line in lines:
                axes.plot(
                    line[:, n].real,
                    line[:, n].imag,
                    color=STABLE_COLOUR if stable else UNSTABLE_COLOUR,
                    lw=2.0 if stable else 1.0,
                )
            tips = np.array([line[0, n] for line in lines])
            closed = np.append(tips, tips[0])
            axes.plot(closed.real, closed.imag, color=PLATFORM_COLOUR, lw=1.5, marker="o", ms=2.5)
            clamps = found.problem.clamp
            axes.plot(clamps.real, clamps.imag, "ks", ms=3)
            axes.set(
                xlim=(low[0] - margin, low[0] + size[0] + margin),
                ylim=(low[1] - margin, low[1] + size[1] + margin),
                aspect="equal",
            )
            axes.set_title(
                "\n".join(
                    [
                        f"{n + 1}: {format_stability(int(found.index[n]))}, "
                        f"{number(found.potential[n])} J",
                        *(f"{name}: {ends[n].words[:24]}" for name, ends in rests.items()),
                    ]
                ),
                fontsize=7,
                fontweight="bold" if stable else "normal",
            )
        more = "" if shown == len(found) else f", the lowest {shown} of them drawn"
        figure.suptitle(
            f"{own.title}: {len(found)} equilibria, {int((found.index == 0).sum())} stable{more}"
            + (
                f"\n{', '.join(rests)}: where the engine comes to rest from this shape"
                if rests
                else ""
            ),
            fontsize=9,
        )
        image = BytesIO()
        figure.savefig(image, format=ending, dpi=150)
    return image.getvalue()


def rod_lines(found: RodEquilibria) -> list[Any]:
    """Points (nodes, n) of each rod from its tip to its clamp, x + iy [m]."""
    a = found.problem.assembly
    lines = []
    for i, path in enumerate(found.paths(DRAWN_NODES)):
        base = found.problem.clamp[i] - a.length[i] * path.position[-1]
        lines.append(base + a.length[i] * path.position)
    return lines
