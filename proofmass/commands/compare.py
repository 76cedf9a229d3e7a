"""``proofmass compare``: a measured loop beside sines, fits, other files and cases."""

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from proofmass.base.errors import InputError
from proofmass.base.files import protect, write_output
from proofmass.base.json_values import replace_nonfinite
from proofmass.base.units import si_unit
from proofmass.base.wording import format_count, number
from proofmass.commands.command import error_console, exit_on_error
from proofmass.evidence.loops import LoopFile, LoopReference, make_references, read_loop
from proofmass.formats.terminal import make_console

FIGURE_ENDINGS = ".svg", ".png", ".pdf"
FIGURE_POINTS = 400
"""Points of a curve of a reference in the figure."""
STYLES = {"up": "-", "down": "--"}
"""Lines of the branches."""
SAME_CURVE = 1e-3
"""Share of its range up to which the branches of a reference are drawn as one line."""
REFERENCE_COLORS = "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00"
"""Colours of references, which differ in black and white too by their order."""


def run_compare(
    file: Path, x: str, y: str, references: list[str], output: Path | None, as_json: bool
) -> None:
    """Run ``proofmass compare``; `proofmass.commands.cli` describes its arguments."""
    with exit_on_error("nothing is written"):
        if output is not None and output.suffix not in FIGURE_ENDINGS:
            words = f"give a name that ends in {', '.join(FIGURE_ENDINGS)}"
            raise InputError(output, "--output", words)
        own = read_loop(file, x, y)
        found = make_references(own, references)
        if output is not None:
            protect([file, *(Path(one.name.partition(":")[0]) for one in found)])
            write_output(output, draw_loop(own, found, output.suffix[1:]))
    if as_json:
        print(json.dumps(replace_nonfinite(loop_data(own, found)), indent=1, allow_nan=False))
        return
    for line in loop_lines(own):
        print(line)
    if found:
        make_console().print(reference_table(own, found))
    if output is not None:
        error_console.print(f"{output}")


def loop_lines(own: LoopFile) -> list[str]:
    """Branches, area and friction of a loop, as lines.

    Angles are in the unit of the file, works in joules of SI.
    """
    loop, (x_unit, y_unit) = own.loop, own.units
    x_factor, y_factor = si_unit(x_unit)[1], si_unit(y_unit)[1]
    low, high = (number(end / x_factor) for end in loop.ends)
    lines = [
        f"{own.file.name}: {own.y} [{y_unit}] over {own.x} [{x_unit}], "
        f"{format_count(loop.angle.size, 'row')}, {count_branches(len(loop.branches))}"
    ]
    for one in loop.branches:
        ends = [number(end / x_factor) for end in one.ends]
        whole = "" if one in loop.whole else ", not whole: left out"
        name, ends = ("up", ends) if one.rises else ("down", ends[::-1])
        lines.append(
            f"  {name:4}  rows {one.first + 1} to {one.last + 1}, "
            f"{' to '.join(ends)} {x_unit}{whole}"
        )
    lines.append(f"from {low} to {high} {x_unit}:")
    for name, one in loop.sides.items():
        lines.append(f"  work {name:4}  {number(one.work, 4)} J")
    if len(loop.sides) > 1:
        share = loop.area / loop.sides["up"].work
        lines.append(f"  area       {number(loop.area, 4)} J, {100.0 * share:.3g} % of the way up")
        lines.append(
            f"  friction   {number(loop.half_width / y_factor, 4)} {y_unit}, "
            "half the distance of the branches"
        )
    return lines


def format_percent(share: float) -> str:
    """A percentage, or a dash for none.

    >>> format_percent(93.469), format_percent(float("nan"))
    ('93.47 %', '—')
    """
    return "—" if np.isnan(share) else f"{share:.2f} %"


def count_branches(count: int) -> str:
    """A number of branches.

    >>> count_branches(1), count_branches(2)
    ('1 branch', '2 branches')
    """
    return f"{count} branch{'es' * (count != 1)}"


def reference_table(own: LoopFile, found: list[LoopReference]) -> Table:
    """The loop against each reference: errors in the unit of the file, reductions of work [%]."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("against", overflow="fold")
    names = [*own.loop.sides, "both"] if len(own.loop.sides) > 1 else ["both"]
    heads = [f"rms [{own.units[1]}]", "largest", f"at [{own.units[0]}]"]
    for head in [*heads, f"work less: {names[0]}", *names[1:]]:
        table.add_column(head, justify="right")
    x_factor, y_factor = (si_unit(unit)[1] for unit in own.units)
    for one in found:
        errors = one.errors
        cells = [number(errors.rms / y_factor), number(errors.largest / y_factor)]
        cells += [number(errors.at / x_factor)]
        table.add_row(
            one.words, *cells, *(format_percent(errors.reductions[name]) for name in names)
        )
    return table


def loop_data(own: LoopFile, found: list[LoopReference]) -> dict[str, Any]:
    """All numbers of a loop in SI units."""
    loop = own.loop
    return {
        "file": own.file.name,
        "x": own.x,
        "y": own.y,
        "ends": loop.ends,
        "branches": [
            {
                "rises": one.rises,
                "rows": [one.first + 1, one.last + 1],
                "ends": one.ends,
                "whole": one in loop.whole,
            }
            for one in loop.branches
        ],
        "work": {name: one.work for name, one in loop.sides.items()},
        "area": loop.area,
        "half_width": loop.half_width,
        "references": [
            {"name": one.name, "words": one.words, "ends": one.ends, **vars(one.errors)}
            for one in found
        ],
    }


def draw_loop(own: LoopFile, found: list[LoopReference], ending: str) -> bytes:
    """A figure of the loop and its references."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from proofmass.report.style import RC

    x_factor, y_factor = (si_unit(unit)[1] for unit in own.units)
    with rc_context(RC):
        figure = Figure((5.5, 3.6), layout="constrained")
        axes = figure.subplots()
        for name, side in own.loop.sides.items():
            axes.plot(
                side.angle / x_factor,
                side.moment / y_factor,
                STYLES[name],
                color="#0072B2",
                label=f"{own.y}, {name}",
            )
        for one, color in zip(found, REFERENCE_COLORS, strict=False):
            angle = np.linspace(*one.ends, FIGURE_POINTS)
            drawn = [curve(angle) for curve in one.curves.values()]
            near = SAME_CURVE * float(np.ptp(drawn[0]))
            alike = all(np.abs(curve - drawn[0]).max() <= near for curve in drawn)
            for name, curve in zip(one.curves, drawn[:1] if alike else drawn, strict=False):
                axes.plot(
                    angle / x_factor,
                    curve / y_factor,
                    STYLES[name],
                    color=color,
                    lw=1.0,
                    label=Path(one.name).name + ("" if alike else f", {name}"),
                )
        axes.set(xlabel=f"{own.x} [{own.units[0]}]", ylabel=f"{own.y} [{own.units[1]}]")
        figure.legend(loc="outside lower center", ncols=2, fontsize=8)
        image = BytesIO()
        figure.savefig(image, format=ending, dpi=200)
    return image.getvalue()
