"""Errors of rods as MuJoCo's one-dimensional flex and as chains of links, by the elastica.

    python -m docs.make.rod_flex [--quick]

Writes docs/rod_flex.md.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT, command
from proofmass.analytic.rods import cantilever, rod_pinned
from proofmass.base.arrays import Array
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.mujoco.flex import cut_into_links
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Rod, Run

MODEL = """<mujoco><option gravity="0 0 0" integrator="implicitfast"><flag contact="disable"/>
  </option><worldbody><site name="clamp"/><site name="pin" pos="0.8 0.1 0"/></worldbody>
  <actuator>{load}</actuator><keyframe><key name="start" ctrl="{ctrl}"/></keyframe></mujoco>"""
LOAD = '<motor site="rod.tip" refsite="clamp" gear="0 {} 0 0 0 0"/>'
PIN = {"pin_x": 0.8, "pin_y": 0.1, "force_x": -20.0, "force_y": -7.0, "moment": -3.7}
ARC = np.linspace(0.0, 1.0, 21)
Shape = Callable[[Array], dict[str, Array]]
CASES: dict[str, tuple[float, Shape]] = {
    f"cantilever, P L^2/EI = {load:g}": (
        load,
        lambda s, load=load: cantilever.solve(s, force_y=load),
    )  # type: ignore[misc]
    for load in (1.0, 2.0, 10.0)
} | {"clamped, pinned at (0.8, 0.1) L": (0.0, lambda s: rod_pinned.solve(s, **PIN))}
LINKS = 10, 20, 40, 80
HEAD = """# Rods as MuJoCo's own flex

`python -m docs.make.rod_flex` made this page. Since version 3.17 a `<flex>` of dimension 1 bends.
It is a discrete elastic rod with three sliding joints for each point. A soft equality constrains
its edges, and the integrator `discrete` handles its bending stiffness, so that a step may be longer
than the fast modes. Setting `flex = true` in a run `equilibrium` builds a flex instead of the chain
of links (`proofmass/sim/mujoco/flex.py`). The clamp is an edge on the ground, half of which is
behind the clamp, so that all errors are of second order.

*Error* is the largest distance from the elastica at 21 places, over L. *Order* is the power of the
length h of an edge with which the error falls. *Chain* is the error of a chain of as many links
with springs, whose equilibrium is found by Newton's method. *Stretch* is that of the worst edge.
*Violation* is the constraint violation of the pin, over L.

| rod | edges | error | order | chain | stretch | violation | steps | CPU s |
|---|---|---|---|---|---|---|---|---|
"""
TAIL = """
A flex has these limits, and `mujoco:flex` refuses by name what it cannot do:

- Its clamp cannot be on a body that moves, so that no motor rotates or slides the clamp.
- It cannot be clamped at its far end.
- No moment can act at a point, because points do not rotate.
- Newton's method cannot find its equilibrium, because there are no joint springs to read. The
  engine steps until nothing moves.

MuJoCo computes no energy of a flex that bends, so that the energy is not shown. A bend b has the
energy EI/(2h) (2 tan b/2)^2, while that of a chain has EI/(2h) b^2. The edges of a flex are softer
than links.
"""


def solve_rod(load: float, links: int, flex: bool) -> Curves:
    """The equilibrium of the rod in MuJoCo; without a load the rod is pinned."""
    ends, turn = (("clamped", "free"), 0.0) if load else (("clamped", "pinned"), 1.25)
    rod = Rod("rod", "clamp", None if load else "pin", 1.0, 1.0, links, ends, turn=turn)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rod.xml"
        file.write_text(
            MODEL.format(load=LOAD.format(load) if load else "", ctrl="1" if load else "")
        )
        return simulate(
            file,
            Run(
                "equilibrium",
                ARC,
                ("rod.x", "rod.y"),
                rods=(rod,),
                settings={"flex": True} if flex else {},
            ),
        )


def error(curves: Curves, truth: dict[str, Array]) -> float:
    """Largest distance from the elastica."""
    return float(np.hypot(*(curves.channels[f"rod.{c}"] - truth[c] for c in "xy")).max())


def rows(counts: Sequence[int]) -> Iterator[str]:
    """Rows of the table, one for each rod and number of edges."""
    for name, (load, shape) in CASES.items():
        last: Any = None
        for links in counts:
            began = time.process_time()
            found, truth = solve_rod(load, links, True), shape(ARC)
            used, off = time.process_time() - began, error(found, truth)
            h = cut_into_links(
                Rod("rod", "clamp", None, 1.0, 1.0, links, ("clamped", "free"))
            ).lengths[-1]
            order = f"{np.log(last[0] / off) / np.log(last[1] / h):.2f}" if last else ""
            chain = error(solve_rod(load, links, False), truth)
            last = off, h
            yield (
                f"| {name} | {links} | {off:.2e} | {order} | {chain:.2e} | "
                f"{found.settings['stretch']:.1e} | {found.violation:.1e} | {found.steps} | "
                f"{used:.1f} |"
            )


def main(argv: Sequence[str] | None = None) -> None:
    quick = command(__doc__).parse_args(argv).quick
    page = HEAD + "\n".join(rows(LINKS[:1] if quick else LINKS)) + "\n" + TAIL
    if not quick:
        (ROOT / "docs" / "rod_flex.md").write_text(page)
    print(page)


if __name__ == "__main__":
    main()
