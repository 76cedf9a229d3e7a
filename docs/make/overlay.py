"""Curves over those of their reference: the first picture of README.

    python -m docs.make.overlay [--quick]

Runs the hacksaw in time, and the sine balancer in a sweep, in MuJoCo and pymunk.  Draws position,
velocity and acceleration of the slide, and the moment over the angle, on the reference, with the
largest errors as shares of the ranges.  Writes docs/overlay.png; with --quick it runs and draws the
balancer alone and writes nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks import ROOT, command, replacing_pages
from proofmass import compare, load_case, solve
from proofmass.base.strict import Kind
from proofmass.base.wording import format_share
from proofmass.report.style import PALETTE, RC
from proofmass.sim.engines import format_solver
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.comparison import Comparisons


class Panel(NamedTuple):
    """A curve of a case that is drawn: its run, its channel, its title and its axes."""

    file: str
    run: Kind
    channel: str
    title: str
    x: str
    y: str


PANELS = (
    Panel("linkages/hacksaw", "dynamics", "r1", "hacksaw: position", "time [s]", "slide [m]"),
    Panel(
        *("linkages/hacksaw", "dynamics", "r1_rate"),
        *("hacksaw: velocity", "time [s]", "slide [m/s]"),
    ),
    Panel(
        *("linkages/hacksaw", "dynamics", "r1_acceleration"),
        *("hacksaw: acceleration", "time [s]", "slide [m/s²]"),
    ),
    Panel(
        *("balancers/balancer_sine", "sweep", "holding_moment"),
        *("balancer: moment", "angle of the pendulum [°]", "moment [N m]"),
    ),
)
SOLVERS = ("mujoco", "pymunk")
SIZE = (11.0, 3.1)  # [inches]
PALE = "#c3c7cd"
"""Colour of the reference, which lies below the curves."""
MARKS = 18
"""Marks of an engine on a curve."""
PICTURE = ROOT / "docs" / "overlay.png"


def main() -> None:
    """Draw and write, or draw one panel and write nothing."""
    quick = command(__doc__).parse_args().quick
    with plt.rc_context(RC):
        figure = draw(PANELS[-1:] if quick else PANELS)
    if quick:
        print(f"{len(figure.axes)} panel")
        return
    with replacing_pages():
        figure.savefig(PICTURE, dpi=150)
    print(f"{PICTURE.relative_to(ROOT)} is written")


def draw(panels: Sequence[Panel]) -> Figure:
    """Draw the panels side by side, with one legend."""
    figure, axes = plt.subplots(1, len(panels), figsize=SIZE, squeeze=False, layout="constrained")
    found = {key: run(*key) for key in dict.fromkeys((p.file, p.run) for p in panels)}
    for ax, panel in zip(axes[0], panels, strict=True):
        draw_panel(ax, panel, found[panel.file, panel.run])
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
    )
    return figure


def run(file: str, kind: Kind) -> dict[str, tuple[Curves, Comparisons]]:
    """The curves of a run in both engines, and their comparisons with the reference."""
    case = load_case(ROOT / "models" / f"{file}.toml")
    curves = {solver: solve(case, kind, solver) for solver in SOLVERS}
    return {
        solver: (own, compare(case, kind, solver, own, detectable=False))
        for solver, own in curves.items()
    }


def draw_panel(ax: Axes, panel: Panel, found: dict[str, tuple[Curves, Comparisons]]) -> None:
    """Draw a channel of both engines on its reference, with the largest errors below the axis."""
    errors, scale = [], 1.0 if panel.run == "dynamics" else 180 / np.pi
    for k, (solver, (curves, rows)) in enumerate(found.items()):
        if rows.reference and not k:
            wanted = rows.reference.channels[panel.channel]
            ax.plot(scale * curves.x, wanted, color=PALE, linewidth=6, label="reference")
        every = (k * len(curves.x) // (2 * MARKS), max(len(curves.x) // MARKS, 1))
        ax.plot(
            scale * curves.x,
            curves.channels[panel.channel],
            **PALETTE[solver].line,
            linewidth=1.2,
            markersize=4,
            markevery=every,
            label=format_solver(solver),
        )
        (row,) = (c for c in rows if c.channel == panel.channel)
        errors.append(f"{format_solver(solver)} to {format_share(row.relative_to_range)}")
    ax.set_title(panel.title, fontsize=10)
    ax.set_xlabel(f"{panel.x}\n{', '.join(errors)}\nof the range", fontsize=8)
    ax.set_ylabel(panel.y, fontsize=8)
    ax.tick_params(labelsize=8)


if __name__ == "__main__":
    main()
