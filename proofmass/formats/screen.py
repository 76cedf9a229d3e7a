"""The first screen of a model as text and as data: what it is, what is wrong, what to do."""

from collections.abc import Iterator
from math import isinf
from typing import Any

from rich.text import Text

from proofmass.base.wording import format_count, format_list, number
from proofmass.screen.finding import ModelFinding, Severity
from proofmass.screen.mobility import Mobility
from proofmass.screen.screen import Screen
from proofmass.screen.stable_step import LONGEST_STEP
from proofmass.screen.steps import StableSteps, format_seconds

SIGNS = {
    Severity.FAULT: ("✗", "bold red"),
    Severity.WARNING: ("!", "yellow"),
    Severity.NOTE: ("·", "dim"),
}
MAX_FINDINGS = 12
"""Findings that are printed; JSON has all of them."""


def screen_lines(screen: Screen, name: str = "") -> Iterator[Text]:
    """The lines of a screen: what the model is, then the findings, the worst first.

    `name` is that of a model without a file.
    """
    called = screen.name if screen.file else name or screen.name
    yield Text(f"{called}: {describe_model(screen)}", style="bold")
    for finding in screen.findings[:MAX_FINDINGS]:
        sign, style = SIGNS[finding.severity]
        yield Text.assemble((f"  {sign} ", style), finding.text)
        if finding.remedy:
            yield Text(f"    to do: {finding.remedy}", style="dim")
    if left := screen.findings[MAX_FINDINGS:]:
        yield Text(f"  {len(left)} more: see --json", style="dim")


def describe_model(screen: Screen) -> str:
    """What a model is, in a sentence without a full stop.

    The mobility, the constraints, the fastest modes, and the largest stable steps.
    """
    if screen.mobility is None:
        return "nothing is known of its motion"
    parts = [describe_mobility(screen.mobility), describe_modes(screen)]
    if screen.steps is not None:
        parts.append(describe_steps(screen.steps))
    return "; ".join(filter(None, parts))


def describe_mobility(found: Mobility) -> str:
    """Bodies, joints, loops and degrees of freedom.

    >>> describe_mobility(Mobility(3, 3, 3, 1, 0, 3, 2, 2, 0.5, {}))
    '3 bodies, 3 joints, 1 loop (3 equations, 1 redundant), 1 degree of freedom'
    """
    parts = [format_count(found.bodies, "body"), format_count(found.joints, "joint")]
    if found.equations:
        named = [
            format_count(count, noun)
            for count, noun in ((found.loops, "loop"), (found.couplings, "coupling"))
            if count
        ]
        redundant = f", {found.redundant} redundant" if found.redundant else ""
        equations = f"({format_count(found.equations, 'equation')}{redundant})"
        parts.append(f"{format_list(named)} {equations}")
    degrees = "degree" if found.dof == 1 else "degrees"
    return ", ".join([*parts, f"{found.dof} {degrees} of freedom"])


def describe_modes(screen: Screen) -> str:
    """The slowest and the fastest oscillation, and the fastest decay."""
    oscillations = [mode for mode in screen.modes if mode.oscillates]
    decays = [mode for mode in screen.modes if not mode.oscillates and mode.rate.real < 0.0]
    parts = []
    if oscillations:
        ends = dict.fromkeys((oscillations[-1], oscillations[0]))
        named = [
            f"{number(mode.frequency)} Hz (ζ = {number(mode.damping, 2)}, {mode.joint})"
            for mode in ends
        ]
        parts.append(f"oscillates with {' to '.join(named)}")
    if decays:
        fastest = decays[0]
        seconds = format_seconds(-1.0 / fastest.rate.real)
        parts.append(f"decays within {seconds} ({fastest.joint})")
    return ", ".join(parts)


def describe_steps(steps: StableSteps) -> str:
    """The largest stable step of the model's integrator, at the start and on the way."""
    if not steps.integrator:
        return ""
    if isinf(steps.limit):
        aside = f", {format_list(steps.about)} aside" if steps.about else ""
        longest = format_seconds(LONGEST_STEP)
        return f"no unstable step up to {longest} about its start ({steps.integrator}){aside}"
    about = "about " if steps.about else ""
    return f"largest stable step {about}{format_seconds(steps.limit)} ({steps.integrator})"


def screen_data(screen: Screen) -> dict[str, Any]:
    """A screen as data; numbers that are not finite are left to the writer."""
    steps, mobility = screen.steps, screen.mobility
    return {
        "summary": describe_model(screen),
        "findings": [finding_data(finding) for finding in screen.findings],
        "mobility": None
        if mobility is None
        else vars(mobility)
        | {
            "degrees_of_freedom": mobility.dof,
            "redundant": mobility.redundant,
            "needed": {str(element): list(needed) for element, needed in mobility.needed.items()},
        },
        "modes": [
            {
                "rate": [mode.rate.real, mode.rate.imag],
                "frequency": mode.frequency,
                "damping": mode.damping,
                "joint": mode.joint.name,
            }
            for mode in screen.modes
        ],
        "steps": None
        if steps is None
        else {
            "step": steps.own,
            "integrator": steps.integrator,
            "limits": steps.limits,
            "limit_on_the_way": steps.way_limit,
            "ratio": steps.ratio,
            "joint": steps.breaking.joint.name if steps.breaking else None,
            "cause": str(steps.breaking.cause) if steps.breaking else None,
            "about": list(steps.about),
        },
    }


def finding_data(finding: ModelFinding) -> dict[str, Any]:
    """A finding as data."""
    element = finding.element
    return {
        "kind": finding.kind,
        "severity": finding.severity.name.lower(),
        "text": finding.text,
        "remedy": finding.remedy,
        "element": None if element is None else {"kind": element.kind, "name": element.name},
        "value": finding.value,
    }
