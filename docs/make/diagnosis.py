"""Comparison of the first cause that proofmass names with a fault that was planted.

    python -m docs.make.diagnosis [--quick]

Plants faults in two dozen cases, one at a time: wrong lengths, masses, stiffnesses and loads,
reversed signs, wrong units, offsets, shifted samples, exchanged quantities, other assembly modes.
Writes docs/diagnosis.md; with --quick it plants a few faults and prints the page.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks import ROOT
from proofmass import load_case, solve
from proofmass.base.strict import Kind
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.evidence.diagnosis import Diagnosis, Explanation, find_causes
from proofmass.sim.protocol.curves import Curves

HEAD = """# Why a run differs

When a run differs from its reference, `proofmass check` looks for one change of the case that would
explain the difference. For a four-bar whose rocker was made 1 % longer in the model it prints:

```
✗ cause: fourbar.xml, line 33: rocker_end x is 2.525 m; with 2.5 m all 64 curves of 4 runs agree
    33 - <site name="rocker_end" pos="2.525 0 0"/>
    33 + <site name="rocker_end" pos="2.5 0 0"/>
    with it the largest error is 0.41 of what is allowed, 2.4e-5 of what it was; known to ± 1e-12 m
```

The sentence has the file and the line of the wrong value, that value, and the right one. The line
is shown as it is and as it should be, to be copied. *Known to* is the distance from which on
another
value would be noticed. JSON, JUnit, SARIF, the report and the message of a failed pytest item have
it from the same object, `proofmass.evidence.diagnosis.Fault`. What is known about a run that failed
comes with what mends it: "make the time step at most 1.26 ms" where the step is beyond the
stability limit of the integrator, or the longest of its halves with which the run comes to its end.

A *cause* explains all curves that differ. Where the best change explains fewer, the line begins
with "most likely", the share of the curves, and those that it leaves. A cause that several runs
share, also of other cases that read the same file, is told once: a wrong number that one run finds
in a model is tried in all other runs of that model that differ.

The following changes of the case are tried:

- another value of each parameter of the reference, fitted to the curves of the engine, and of pairs
  of parameters if no single one explains all channels; the opposite sign of each parameter;
- another sign, unit, factor or offset of each channel, and another quantity of the reference;
- a shift along x by one or two samples or by any distance;
- another assembly mode;
- the number of the model that has the value of a fitted parameter. If the sidecar says 2.5 and the
  curves say 2.525, either may be wrong. The engine runs again with 2.5 in the model; what explains
  more curves comes first. If both explain as many, the sidecar is taken to be wrong if its value
  has more digits than the other one and than half of its other parameters, since people write
  round numbers; otherwise the model is, since it is what is tested. The other one is named too;
- the opposite sign of gravity, springs, loads, gears and axes of joints in the model;
- another value of each number of the model, if no single change so far explains all channels. The
  engine is then run again with changed models. It also finds a wrong number where the reference
  is a recorded curve, or where the reference reads the model itself and a channel is compared with
  a number;
- stops without a rebound, if those of the model have one and the engine's have none;
- the settings in which a run differs from another one of the same engine that agrees, one by one;
- half the time step, twice as many segments of rods, and other settings with which the engine
  should have a smaller error, such as half of MuJoCo's `solref` or more iterations of pymunk's
  solver.

A change *explains* a channel if the channel then differs by no more than twice its tolerance, or by
a thousandth of its difference before. Changes that the curves cannot distinguish are listed
together.

No clock decides. A search ends after 320 evaluations of the reference, after 800,000 steps of the
engine times degrees of freedom for the numbers of the model, and a run of more than 60,000 of these
is not made again; a pose of a sweep counts as 20 steps, an equilibrium as 100. What was tried is
listed as `tried`, and what the search left out because it had reached such a limit as `untried`.

The causes are in `proofmass check --json`: `causes` has each cause with its faults and runs,
`diagnoses` all that was found for each run. In Python they are in `proofmass.check(...).diagnoses`
and `proofmass.evidence.diagnosis.shared_causes`; `proofmass.evidence.diagnosis.find_causes`
describes the method.

Loops that are open in the start pose, by more than a millionth of the size, and differences that
end within the first tenth of a motion, are findings of their own.

For a failed run the terminal says which channel left its tolerance first, how far the loops are
open in the start pose, how the constraint violation grew, and with which shorter step the run comes
to its end.

A cause is a hypothesis: the change makes the reference agree with the curves.

## Planted faults

`python -m docs.make.diagnosis` planted {count} faults in {cases} cases, one at a time. The planted
fault is the first cause that is named for {first} of them, and it is among the first three causes
for {three}. For {side} the first sentence also has the wrong value at the side where it was
planted; a parameter of 4 kg in place of 2 kg does not show by itself whether the sidecar or the
model is wrong. A search takes {mean} s on average, and {slowest} s at most; they depend on the
load of the machine, which had two processors and twenty busy processes. The column *differing*
has the channels that differ, *place* the position of the planted fault among the named causes, and
*left* the share of the differences that the first cause leaves.

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
    """Faults of a case: each named parameter is multiplied by a factor."""
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
"""More than sixty faults in two dozen cases."""
NOT_NAMED = 99
"""Place of a fault that is not among the named causes."""


def case_of(name: str) -> Case:
    """A shipped case by its name."""
    (file,) = (ROOT / "models").rglob(f"{name}.toml")
    return load_case(file)


@cache
def solved(name: str, run: Kind, solver: str) -> tuple[Case, Curves]:
    """A shipped case, and the curves of one of its runs."""
    case = case_of(name)
    return case, solve(case, run, solver)


def plant(fault: Fault) -> tuple[Case, Curves]:
    """The case and the curves of the solver, one of them with the fault."""
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


def is_planted(cause: Explanation, fault: Fault, case: Case) -> bool:
    """Whether a cause is the planted fault, or the curves cannot distinguish it from the fault."""
    words = (cause.words, *cause.same)
    if fault.kind == "parameter":
        true = case.parameters[fault.where] / fault.amount
        found = [one for one in cause.faults if one.name == fault.where]
        mirrored = any(
            f": {fault.where} is " in w or w.startswith(f"{fault.where} ") for w in words
        )
        return (
            mirrored
            if not found
            else abs(float(found[0].right) / true - 1) < 0.05 * abs(fault.amount - 1)
        )
    if fault.kind == "mode":
        return words[0].startswith("mode ")
    if fault.kind == "shift":
        count, way = abs(int(fault.amount)), "late" if fault.amount > 0 else "early"
        return f"{['one sample', 'two samples'][count - 1]} {way}" in words[0]
    if fault.kind == "quantity":
        a, b = fault.where.split()
        return all(f"{name} equal to" in words[0] for name in (a, b))
    phrase = {
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
    return any(w.startswith(fault.where) and phrase in w for w in words)


def names_side(cause: Explanation, fault: Fault) -> bool:
    """Whether the sentence of a cause has the planted value as wrong, and the old one as right.

    A wrong parameter was planted in the sidecar, so that the sidecar has the wrong value.
    """
    one = cause.fault
    if one is None or fault.kind != "parameter":
        return one is None or one.file.suffix == ".toml"
    return one.file.suffix == ".toml" and one.name == fault.where and one.line is not None


def search(fault: Fault) -> tuple[int, Diagnosis]:
    """The place of the planted fault among the named causes, or `NOT_NAMED`; and the diagnosis."""
    case, curves = plant(fault)
    found = find_causes(case, fault.run, fault.solver, curves)
    places = (k for k, c in enumerate(found.causes, 1) if is_planted(c, fault, case))
    return next(places, NOT_NAMED), found


def row(fault: Fault, place: int, found: Diagnosis) -> str:
    """The row of a fault in the table."""
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
        str(place) if place < NOT_NAMED else "none",
        best.sentence.replace("|", "\\|") if best else "",
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
        side=sum(
            place == 1 and names_side(found.causes[0], fault) for fault, place, found in results
        ),
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
