"""Is the first cause that proofmass names the fault that was planted?

    python -m benchmarks.diagnosis [--quick]

Plants faults in two dozen cases, one at a time: wrong lengths, masses, stiffnesses and loads,
turned signs, wrong units, offsets, shifted samples, exchanged quantities, other assembly modes.
Writes docs/diagnosis.md; with --quick it plants a few and writes nothing.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks import ROOT
from proofmass import load_case, solve
from proofmass.case import Case
from proofmass.diagnosis import Diagnosis, Explanation, find_causes
from proofmass.sim.protocol import Curves
from proofmass.strict import Kind
from proofmass.wording import number

HEAD = """# Why a run differs

When a run differs from its reference, `proofmass check` looks for one change of the case that would
explain it. Of a four-bar whose rocker was made 1 % longer in the model it says:

```
  cause: in fourbar.xml: site of rocker_end x = 2.5 m instead of 2.525 m (-0.9901 %)
         puts all 17 channels right, 3.3e-14 of the error left
         next best: rocker = 2.525 m instead of 2.5 m (+1 %) (16 of 17 channels right, 3.3e-14 left)
         2.525 stands in fourbar.xml, line 33
```

The centre of mass was left in its place, so that the holding moment does not follow the parameter
of the reference, and the number of the model explains more. Each
parameter of the reference is fitted to the curves of the engine alone, and pairs of parameters if
no single one explains all. Also tried are the sign, unit, factor and offset of each channel, other
quantities of the reference, shifts by a sample or any step, other assembly modes, and, in a run in
time that is short, half the time step. A change *explains* a channel if the channel then differs by
no more than twice its tolerance, or by a thousandth of what it differed by. Changes that the curves
do not tell apart are listed together. The causes are in `proofmass check --json` under `diagnoses`,
in Python in `proofmass.check(...).diagnoses`, and in the message of a failed pytest item;
`proofmass.diagnosis.find_causes` describes the method.

Of a failed run the terminal says which channel left its tolerance first, how the constraint
violation grew, and with which shorter step the run comes to its end.

Where no single change of the reference explains all, each number of the model is fitted as well, by
running the engine again with changed models, if one run is quick: of the four-bar above it names
the site of the rocker's end, which the moment follows. So a wrong number is found too where the
reference is a recorded curve, or where it reads the model itself and a channel is held to a number.

A cause is a hypothesis: the change makes the reference agree with the curves. Whether the model or
the sidecar has the wrong number is for people to decide.

## Planted faults

`python -m benchmarks.diagnosis` planted {count} faults in {cases} cases. The first cause named is
the planted one in {first}, and it is among the first three in {three}. A search takes {mean} s on
average, {slowest} s at most. *Left* is the share of the differences that the first cause leaves.

| case | run | engine | fault | differing | place | first cause | left | seconds |
|---|---|---|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Fault:
    """A fault of a case: what is changed, by what, and the words that a cause must begin with."""

    case: str
    kind: str  # parameter, factor, offset, shift, quantity or mode
    where: str
    amount: float
    run: Kind = "sweep"
    solver: str = "mujoco"


def parameter(case: str, **changes: float) -> Iterator[Fault]:
    """Faults of parameters of one case, each by a factor."""
    for name, factor in changes.items():
        yield Fault(case, "parameter", name, factor)


PARAMETERS = [
    *parameter("fourbar", rocker=1.01, ground=0.9, coupler_mass=2.0, gravity=1.01),
    *parameter("fourbar_crossed", crank=1.05, point_across=-1.0),
    *parameter("double_crank", coupler=1.002, rocker_mass=0.5),
    *parameter("double_rocker", coupler=0.99),
    *parameter("triple_rocker", ground=1.001),
    *parameter("change_point", coupler=1.01),
    *parameter("slider_crank", crank=1.02),
    *parameter("slider_crank_offset", guide_y=1.1, coupler=0.95),
    *parameter("slider_crank_inclined", guide_angle=1.05),
    *parameter("inverted_slider_crank", ground_x=1.01),
    *parameter("hacksaw", crank=0.99),
    *parameter("fivebar", left_coupler=1.03),
    *parameter("fivebar_circle", right_coupler=0.99),
    *parameter("threeprr", leg=1.01),
    *parameter("threeprr_circle", side=1.02),
    *parameter("balancer_sine", stiffness1=1.1, length2=1.01, pendulum=0.9),
    *parameter("balancer_laevo", stiffness2=0.95),
    *parameter("balancer_prototype", stiffness3=1.02, length1=0.98),
    *parameter("balancer_weight", weight=1.02),
]
RUNS: list[Fault] = [
    Fault("pendulum", "parameter", "length", 1.01, "dynamics"),
    Fault("pendulum", "parameter", "gravity", 0.99, "dynamics"),
    Fault("fourbar", "parameter", "coupler", 1.01, "dynamics", "pymunk"),
    Fault("rod_cantilever", "parameter", "stiffness", 1.1, "equilibrium"),
    Fault("rod_pinned", "parameter", "length", 1.05, "equilibrium"),
    Fault("rod_into_circle", "parameter", "moment", 0.9, "equilibrium"),
    Fault("rod_buckled", "parameter", "stiffness", 0.8, "equilibrium"),
    Fault("fourbar", "parameter", "rocker", 1.005, "sweep", "pymunk"),
    Fault("slider_crank", "parameter", "coupler", 1.01, "dynamics", "pymunk"),
]
CHANNELS = [
    Fault("fourbar", "factor", "holding_moment", -1.0),
    Fault("fourbar_crossed", "factor", "rocker_rate", -1.0),
    Fault("slider_crank", "factor", "slider.x", -1.0),
    Fault("balancer_sine", "factor", "holding_moment", -1.0),
    Fault("hacksaw", "factor", "theta1", 180 / np.pi),
    Fault("fourbar", "factor", "coupler.angle", 180 / np.pi),
    Fault("double_rocker", "factor", "rocker_rate", np.pi / 180),
    Fault("triple_rocker", "factor", "pin.x", 1e3),
    Fault("slider_crank_mirrored", "factor", "slider.x", 1e-3),
    Fault("fivebar", "factor", "tip.y", 1e3),
    Fault("inverted_slider_crank_held", "factor", "end.x", 1e3),
    Fault("balancer_laevo", "factor", "energy", 1e3),
    Fault("fourbar", "offset", "rocker", np.pi),
    Fault("hacksaw_cutting", "offset", "theta3", 2 * np.pi),
    Fault("double_crank_crossed", "offset", "coupler.angle", -np.pi / 2),
    Fault("threeprr", "offset", "platform.angle", np.pi),
    Fault("slider_crank_offset", "offset", "slider.x", 0.05),
    Fault("fourbar", "shift", "", 1),
    Fault("slider_crank", "shift", "", -1),
    Fault("balancer_sine", "shift", "", 1),
    Fault("pendulum", "shift", "", 1, "dynamics"),
    Fault("fivebar_down", "shift", "", -2),
    Fault("fourbar", "quantity", "pin.x pin.y", 0.0),
    Fault("slider_crank_inclined", "mode", "", 0.0),
    Fault("fourbar_crossed", "mode", "", 0.0),
    Fault("double_crank", "mode", "", 0.0),
]
FAULTS = [*PARAMETERS, *RUNS, *CHANNELS]
"""Sixty and some faults in two dozen cases."""


def case_of(name: str) -> Case:
    """A shipped case by its name."""
    (file,) = (ROOT / "models").rglob(f"{name}.toml")
    return load_case(file)


@cache
def solved(name: str, run: Kind, solver: str) -> tuple[Case, Curves]:
    """A shipped case, and the curves of one of its runs."""
    case = case_of(name)
    return case, solve(case, run, solver)


def planted(fault: Fault) -> tuple[Case, Curves]:
    """The case with the fault, and the solver's curves, of which channels may be at fault."""
    case, curves = solved(fault.case, fault.run, fault.solver)
    channels = dict(curves.channels)
    if fault.kind == "parameter":
        changed = {fault.where: case.parameters[fault.where] * fault.amount}
        return case.model_copy(update={"parameters": {**case.parameters, **changed}}), curves
    if fault.kind == "mode":
        changed = {"mode": -float(case.parameters["mode"])}
        return case.model_copy(update={"parameters": {**case.parameters, **changed}}), curves
    if fault.kind == "factor":
        channels[fault.where] = fault.amount * channels[fault.where]
    elif fault.kind == "offset":
        channels[fault.where] = fault.amount + channels[fault.where]
    elif fault.kind == "quantity":
        a, b = fault.where.split()
        channels[a], channels[b] = channels[b], channels[a]
    else:
        channels = {name: np.roll(y, int(fault.amount))[3:-3] for name, y in channels.items()}
        drive = curves.drive and tuple(part[:, 3:-3] for part in curves.drive)
        return case, replace(curves, x=curves.x[3:-3], channels=channels, drive=drive)
    return case, replace(curves, channels=channels)


def names(cause: Explanation, fault: Fault, case: Case) -> bool:
    """Whether a cause, or one that the curves do not tell apart from it, is the planted one."""
    words = (cause.words, *cause.same)
    if fault.kind == "parameter":
        true = case.parameters[fault.where] / fault.amount
        return any(w.startswith(f"{fault.where} = ") for w in words) and (
            fault.where not in cause.changes
            or abs(cause.changes[fault.where][1] / true - 1) < 0.05 * abs(fault.amount - 1)
        )
    if fault.kind == "mode":
        return words[0].startswith("mode = ")
    if fault.kind == "shift":
        count, way = abs(int(fault.amount)), "late" if fault.amount > 0 else "early"
        return f"{['one sample', 'two samples'][count - 1]} {way}" in words[0]
    if fault.kind == "quantity":
        a, b = fault.where.split()
        return all(f"{name} equal to" in words[0] for name in (a, b))
    turned = {
        ("factor", -1.0): "with the opposite sign",
        ("factor", 180 / np.pi): "in degrees",
        ("factor", np.pi / 180): "in radians",
        ("factor", 1e3): "in thousandths",
        ("factor", 1e-3): "in thousands ",
        ("offset", np.pi): "half a turn ahead",
        ("offset", 2 * np.pi): "a whole turn ahead",
        ("offset", -np.pi / 2): "a quarter turn behind",
        ("offset", 0.05): "off by 0.05",
    }[fault.kind, fault.amount]
    return any(w.startswith(fault.where) and turned in w for w in words)


def search(fault: Fault) -> tuple[int, Diagnosis]:
    """The place of the planted cause among those that are named, 99 if it is not; and all."""
    case, curves = planted(fault)
    found = find_causes(case, fault.run, fault.solver, curves)
    there = (k for k, c in enumerate(found.causes, 1) if names(c, fault, case))
    return next(there, 99), found


def row(fault: Fault, place: int, found: Diagnosis) -> str:
    """A row of the table."""
    amount = {"shift": f"{fault.amount:+.0f} samples", "mode": "other", "quantity": "exchanged"}
    what = f"{fault.kind} {fault.where} {amount.get(fault.kind, f'{fault.amount:.6g}')}"
    what = what.replace("  ", " ")
    best = found.causes[0] if found.causes else None
    cells = [
        fault.case,
        fault.run,
        fault.solver,
        what,
        f"{len(found.differing)} of {found.checked}",
        str(place) if place < 99 else "none",
        best.words if best else "",
        number(best.left, 2) if best else "",
        f"{found.seconds:.2f}",
    ]
    return f"| {' | '.join(cells)} |"


def main(arguments: list[str]) -> None:
    """Plant all faults, or a few, and write the page."""
    quick = "--quick" in arguments
    faults = FAULTS[:3] if quick else FAULTS
    results = [(fault, *search(fault)) for fault in faults]
    seconds = [found.seconds for _, _, found in results]
    text = HEAD.format(
        count=len(faults),
        cases=len({fault.case for fault in faults}),
        first=sum(place == 1 for _, place, _ in results),
        three=sum(place <= 3 for _, place, _ in results),
        mean=number(float(np.mean(seconds)), 2),
        slowest=number(max(seconds), 2),
    )
    text += "\n" + "\n".join(row(*result) for result in results) + "\n"
    if quick:
        print(text)
    else:
        (ROOT / "docs" / "diagnosis.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
