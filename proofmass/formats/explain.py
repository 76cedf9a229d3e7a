"""``proofmass explain``: the wrong numbers that a case notices or not, as text for a terminal."""

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from textwrap import wrap

from rich.table import Table

from proofmass.base.units import si_unit
from proofmass.base.wording import format_unit, number
from proofmass.case.case import Case
from proofmass.evidence.coverage import Coverage
from proofmass.evidence.coverage_search import Finding, is_decreased
from proofmass.formats.terminal import (
    describe_own_numbers,
)
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import properties
from proofmass.reference.recorded_rows import describe_rows
from proofmass.run.solve import with_computing_solvers
from proofmass.sim.engines import format_solver
from proofmass.sim.numbers import CHANGE_SHARE

WIDTH = 80
FORCES_AND_ENERGIES = ("N", "N m", "J")
"""Units of the channels that depend on inertia and damping in a prescribed motion."""
MOTION_KINDS = ("inertia", "armature", "damping")
LOAD_KINDS = (
    "mass",
    "centre of mass",
    "gravity",
    "stiffness",
    "load",
    "rest angle",
    "spring length",
)
SOFTNESS_KINDS = ("softness of the loop", "softness of the stop")
START_KINDS = ("zero", "direction")
NO_EFFECT_SHARE = 1e-6
"""Share of a tolerance: if a change moves a channel by less, the channel does not depend on it."""
PLURALS = {
    "mass": "masses",
    "mass of a rod": "masses of the rods",
    "load of a rod": "loads of the rods",
    "couple along a rod": "couples along the rods",
    "stiffness of a rod": "stiffnesses of the rods",
    "axial stiffness of a rod": "axial stiffnesses of the rods",
    "shear stiffness of a rod": "shear stiffnesses of the rods",
    "torsion stiffness of a rod": "torsion stiffnesses of the rods",
    "stiffness of a rod about y": "stiffnesses about y of the rods",
    "natural curvature of a rod": "natural curvatures of the rods",
    "centre of mass": "centres of mass",
    "stiffness": "stiffnesses",
    "softness of the loop": "softness of the loop",
    "softness of the stop": "softness of the stop",
    "gravity": "gravity",
    "damping": "damping",
    "friction": "friction",
    "armature": "armature",
    "inertia": "inertias",
}
"""Plurals of kinds of numbers that are not formed by an added s."""
TRIED_SENTENCE = (
    "Tried are masses, inertias, centres of mass, places and directions of bodies, joints, sites "
    "and loops, zeros, springs, damping, armature, friction, ranges, gravity, loads, gears, how "
    "soft loops and joint limits are, and lengths, stiffnesses, masses and loads of rods: each "
    f"changed by {100 * CHANGE_SHARE:.0f} %, one that is 0 by {100 * CHANGE_SHARE:.0f} % of a size "
    "made of the mechanism's length, mass and time, up and down. Left out are elements that are "
    "only drawn, numbers normal to the plane of motion, and the settings of the engines."
)


def format_coverage(case: Case, found: Coverage) -> Iterator[str | Table]:
    """The text and tables on a coverage, in the order of the output; texts are wrapped."""
    yield from wrap_lines(f"{case.name}: {case.title}")
    yield ""
    yield "Who checks what"
    yield from format_checks(found)
    for solver in with_computing_solvers(case)[1]:
        yield from wrap_lines(
            f"{format_solver(solver)}: recorded curves; no number of the model acts on them", "  "
        )
    if found.differing:
        yield from wrap_lines(
            f"differ already, and are not used: {', '.join(found.differing)}; "
            f"`proofmass check {case.file.name}` names the cause"
        )
    yield ""
    yield "What the reference reads"
    yield from wrap_lines(format_reference_coverage(case, found), "  ")
    for name, value in properties(case).items() if found.reads_model else ():
        yield from wrap_lines(f"{name}: {value}", "  ")
    noticing = [one for one in found.parameters if one.noticed and not one.refused]
    if noticing:
        yield ""
        yield "Noticed in the parameters of the reference, from this change on"
        yield from noticed_tables(sorted(noticing, key=lambda one: one.measure))
    for words, some in (
        ("not noticed", [one for one in found.parameters if not one.noticed]),
        ("not known", [one for one in found.parameters if one.refused]),
    ):
        if some:
            yield from wrap_lines(f"{words}: {', '.join(one.of for one in some)}", "  ")
    yield ""
    yield from format_model_coverage(case, found)


def format_model_coverage(case: Case, found: Coverage) -> Iterator[str | Table]:
    """The text and tables on the numbers of the model."""
    if found.left_out or not found.numbers:
        yield from wrap_lines(format_not_tried(case, found))
        return
    changed = [one for one in found.noticed if not one.refused]
    if changed:
        yield f"Noticed in {case.model}, from this change on"
        yield from noticed_tables(changed)
        yield ""
    if failed := [one for one in found.noticed if one.refused]:
        yield "Refused, or failed: the run says so"
        for one in sorted(format_refusals(failed)):
            yield from wrap_lines(one, "  ")
        yield ""
    yield "Not noticed by any run"
    for words in format_not_noticed(case, found):
        yield from wrap_lines(words, "  ")
    if not found.unnoticed:
        yield "  nothing of what was tried"
    yield ""
    yield from wrap_lines(TRIED_SENTENCE)


def format_not_tried(case: Case, found: Coverage) -> str:
    """The sentence that no number of the model was tried, and why."""
    why = found.left_out or "no run of the case checks anything"
    return f"No number of {case.model} was tried: {why}."


def wrap_lines(text: str, indent: str = "") -> Iterator[str]:
    """The lines of a text, all but the first with two more spaces of indent."""
    yield from wrap(
        text,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=f"{indent}  ",
        break_on_hyphens=False,
    )


def format_checks(found: Coverage) -> Iterator[str]:
    """Lines on how closely each solver is checked, with the reasons of its tolerances."""
    for one in found.runs:
        head = f"{one.run}, {format_solver(one.solver)}: "
        if not one.checked:
            yield from wrap_lines(f"{head}shown, not checked", "  ")
            continue
        yield from wrap_lines(
            f"{head}{one.checked} of {one.channels} channels, the nearest to its limit "
            f"{one.channel}: {number(one.error)} of its range, {number(one.allowed)} allowed",
            "  ",
        )
        for why in one.why:
            yield from wrap_lines(why, "    ")


def format_reference_coverage(case: Case, found: Coverage) -> str:
    """A sentence on what the reference reads from the model, and the effect of a wrong number."""
    if case.recorded:
        words = dict.fromkeys(filter(None, (describe_rows(case, kind) for kind in case.run)))
        return "; ".join((f"the recorded curve {case.reference}", *words, "nothing of the model"))
    if found.reads_model:
        return describe_own_numbers(case)
    return (
        f"{case.reference} has its parameters from the sidecar, and nothing from "
        f"{case.model}: a wrong number of the model is wrong in the engines alone"
    )


def noticed_tables(some: Sequence[Finding]) -> Iterator[str | Table]:
    """Tables of numbers with their smallest noticed changes, one for each run and solver."""
    for run, solver in dict.fromkeys((one.run, one.solver) for one in some):
        yield f"  by {run}, {format_solver(solver)}"
        table = Table(box=None, show_header=False, pad_edge=True, padding=(0, 0, 0, 2))
        table.add_column("", width=0)
        table.add_column(overflow="fold")
        for _ in range(2):
            table.add_column(justify="right", no_wrap=True)
        table.add_column(overflow="fold")
        for one in (one for one in some if (one.run, one.solver) == (run, solver)):
            table.add_row("", *table_cells(one), one.channel)
        yield table


def table_cells(one: Finding) -> tuple[str, str, str]:
    """The name of a number, its smallest noticed change, and that change as a share."""
    name = one.of if one.kind == "parameter" else one.name
    change = f"{number(abs(one.change), 2)} {format_unit(one.unit)}".removesuffix(" 1").strip()
    return name, change, f"{number(100 * one.share, 2)} %" if one.value else ""


def format_refusals(some: Sequence[Finding]) -> Iterator[str]:
    """Phrases on numbers with which runs fail, one for each kind and reason."""
    for (kind, why), group in groupby(some, key=lambda one: (one.kind, one.refused)):
        yield f"{name_numbers(kind, list(group))}: {why}"


def format_not_noticed(case: Case, found: Coverage) -> Iterator[str]:
    """Phrases on numbers that no run notices, one for each kind, with the reason if it is known."""
    for kind, some in found.unnoticed.items():
        why = reason_not_noticed(case, found, kind, some)
        yield name_numbers(kind, some) + (f": {why}" if why else "")


def name_numbers(kind: str, some: Sequence[Finding]) -> str:
    """A phrase that names the numbers of a kind.

    >>> one, two = (Finding("inertia", name, "1", 1.0, 0.1, False) for name in ("a", "b"))
    >>> name_numbers("inertia", [one]), name_numbers("inertia", [one, two])
    ('inertia of a', 'inertias of a and b')
    """
    names = [one.of for one in some]
    if len(names) == 1:
        return f"{kind} of {names[0]}"
    return f"{PLURALS.get(kind, f'{kind}s')} of {', '.join(names[:-1])} and {names[-1]}"


def steady_joints(case: Case) -> set[str]:
    """The driven joints and their bodies, if the rate of the drives is constant."""
    if case.leader is None or not case.leader.steady:
        return set()
    model = compiled_model(case)
    driven = [drive.joint for drive in case.drive]
    return {*driven, *(model.body(model.joint(joint).bodyid[0]).name for joint in driven)}


def reason_not_noticed(case: Case, found: Coverage, kind: str, some: Sequence[Finding] = ()) -> str:
    """Why numbers of a kind are not noticed, if that follows from the case; otherwise empty."""
    if found.reads_model and kind not in SOFTNESS_KINDS:
        return "the reference reads them from the model as well"
    dynamics_runs = [one for one in found.runs if one.run == "dynamics" and one.checked]
    with_forces = {
        one.run
        for one in found.runs
        for unit in one.units
        if one.checked and si_unit(unit or "1")[0] in FORCES_AND_ENERGIES
    }
    if kind in MOTION_KINDS:
        if not dynamics_runs:
            return "all runs that are checked are at rest, where nothing of it acts"
        if case.drive and "dynamics" not in with_forces:
            return (
                "nothing of it acts at rest; in dynamics the drives prescribe the motion, and no "
                "moment, force or energy is checked"
            )
        if (
            kind in ("inertia", "armature")
            and some
            and steady_joints(case) >= {one.of for one in some}
        ):
            return "a drive of constant rate has no acceleration, without which nothing of it acts"
    weightless = not any(one.value for one in found.numbers if one.kind == "gravity")
    if kind in ("mass", "centre of mass") and weightless and not dynamics_runs:
        return "there is no gravity, and all runs that are checked are at rest"
    if kind in LOAD_KINDS and case.drive and not with_forces and not case.rod:
        return "the drives prescribe the motion, and no moment, force or energy is checked"
    if kind in SOFTNESS_KINDS:
        closed_at_rest = "a run at rest closes them to rounding"
        return (
            f"{closed_at_rest}; in dynamics they stay within the tolerances"
            if dynamics_runs
            else closed_at_rest
        )
    if kind in START_KINDS:
        return "it changes the pose that the start is sought from, and nothing that is checked"
    return describe_effect(some)


def describe_effect(some: Sequence[Finding]) -> str:
    """A phrase on how little numbers move any channel; empty if it was not measured for all.

    >>> ball = Finding("mass", "ball", "kg", 2.0, 0.2, False, moved=1e-12)
    >>> describe_effect([ball])
    'no checked channel depends on it: 10 % more or less moves none by a millionth of its tolerance'
    """
    if not some or any(math.isnan(one.moved) for one in some):
        return ""
    one = max(some, key=lambda one: one.moved)
    it = "it" if len(some) == 1 else "one of them"
    step = f"{number(one.tried, 2)} {format_unit(one.unit)}"
    if one.value:
        step = f"{number(100 * one.tried / abs(one.value), 2)} %"
    more = (
        f"{step} more or less" if is_decreased(one.kind, one.value, one.tried) else f"{step} more"
    )
    if one.moved < NO_EFFECT_SHARE:
        return (
            f"no checked channel depends on {it}: {more} moves none by a millionth of its tolerance"
        )
    return (
        f"it does little: {more} of {it} moves no checked channel by more than "
        f"{number(one.moved, 2)} of its tolerance "
        f"({one.channel}, {one.run}, {format_solver(one.solver)})"
    )
