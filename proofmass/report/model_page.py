"""The page of a model without a sidecar: what it is, what is wrong, what to do, what is known.

The page has the first screen of the model with the line of its file for each finding, a drawing of
its start with numbered marks at the findings, its modes, the steps that it bears, and until when
its motion is known.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf, isfinite, isinf
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment
from markupsafe import Markup, escape

from proofmass.base.lines import LineIndex
from proofmass.base.wording import format_mjcf_parts, number
from proofmass.base.worker import call_isolated
from proofmass.batch.check import Result, folder_of
from proofmass.report.page import case_facts, slug
from proofmass.sim.model_source import BINARY_ENDING, ModelSource
from proofmass.verdict.comparison import Comparison

if TYPE_CHECKING:
    from proofmass.report.model_drawing import ModelDrawing
    from proofmass.screen.finding import ModelFinding
    from proofmass.screen.screen import Screen

DRAW_SECONDS = 60.0
"""Limit of the processor time of a drawing [s]; those of public models take up to 3 s."""
SHOWN_MODES = 12
"""Modes in the table; a robot has twice as many as coordinates."""
BAR_OF_LIMIT = 75.0
"""Width of a bar that reaches the largest stable step [%]."""
STEP_WORDS = {
    "stable": "below the limit",
    "close": "close to the limit",
    "unstable": "above the limit: it blows up",
}


@dataclass(frozen=True)
class FindingLine:
    """A finding, its line in the file, and what to do."""

    finding: "ModelFinding"
    line: int | None
    text: str
    remedy: Markup


@dataclass(frozen=True)
class StepLine:
    """An integrator, its largest stable step, and how long the model's own step is beside it."""

    integrator: str
    own: bool
    limit: str
    share: float
    state: str

    @property
    def width(self) -> float:
        """The width of the bar [%]."""
        return min(BAR_OF_LIMIT * self.share, 100.0)


def model_pages(env: Environment, result: Result) -> Iterator[tuple[str, str]]:
    """Yield the names and texts of the pages of all models without a sidecar."""
    cases = {case.name for case in result.cases}
    for comparison in result.comparisons:
        screen = result.screens.get(comparison.case)
        if not comparison.channel and comparison.case not in cases and screen and screen.file:
            source = ModelSource(screen.file, within=folder_of(screen.file, result.paths))
            yield page_name(comparison.case), render_model(env, comparison, screen, source)


def page_name(name: str) -> str:
    """The file of the page of a model.

    >>> page_name("left/arm")
    'left,arm.html'
    """
    return f"{slug(name)}.html"


def render_model(
    env: Environment, comparison: Comparison, screen: "Screen", source: ModelSource
) -> str:
    """The page of a model."""
    from proofmass.formats.screen import describe_mobility, describe_model

    file, lines = source.file, LineIndex()
    drawing = draw_isolated(source, screen)
    findings = [finding_line(finding, lines, file) for finding in screen.findings]
    worst = screen.findings[0] if screen.findings else None
    return env.get_template("model.html").render(
        name=comparison.case,
        file=file.name,
        comparison=comparison,
        answer=worst.text if worst and worst.severity > 1 else "",
        findings=findings,
        drawing=Markup(drawing.svg) if drawing else "",
        drawing_words=drawing.words if drawing else "",
        summary=describe_model(screen),
        mobility=describe_mobility(screen.mobility) if screen.mobility else "",
        needed=needed_lines(screen),
        modes=list(mode_rows(screen)),
        more_modes=max(0, len(screen.modes) - SHOWN_MODES),
        steps=list(step_lines(screen)),
        step_words=STEP_WORDS,
        about=screen.steps.about if screen.steps else (),
        command=""
        if file.suffix == BINARY_ENDING
        else f"proofmass new {file.stem} --from {file.name}",
        facts=case_facts(file.parent),
    )


def draw_isolated(source: ModelSource, screen: "Screen") -> "ModelDrawing | None":
    """Draw a model in a worker; None if that fails, since the page has all numbers without it."""
    from proofmass.report.model_drawing import draw_model

    elements = [finding.element for finding in screen.findings]
    try:
        return call_isolated(draw_model, source, elements, timeout=DRAW_SECONDS)
    except Exception:
        return None


def finding_line(finding: "ModelFinding", lines: LineIndex, file: Path) -> FindingLine:
    """A finding with the line of its element in the file."""
    element = finding.element
    line = lines.line_of_element(file, element.tag, element.name) if element else None
    text = lines.text(file)[line - 1].strip() if line else ""
    return FindingLine(finding, line, text, with_code(finding.remedy))


def with_code(text: str) -> Markup:
    """A text whose attributes, such as ``timestep="0.002"``, are set as code.

    >>> with_code('damping="1" on <joint>')
    Markup('<code>damping=&#34;1&#34;</code> on &lt;joint&gt;')
    """
    return Markup(
        format_mjcf_parts(text, code=lambda part: f"<code>{escape(part)}</code>", rest=escape)
    )


def needed_lines(screen: "Screen") -> list[str]:
    """Sentences on the equalities whose equations others imply."""
    mobility = screen.mobility
    if mobility is None:
        return []
    return [
        f"{element}: {equations} equations, {needed} of which no other equality implies"
        for element, (equations, needed) in mobility.needed.items()
        if needed < equations
    ]


def mode_rows(screen: "Screen") -> Iterator[tuple[str, str, str, str]]:
    """Frequency, damping ratio, decay time and joint of the fastest modes."""
    from proofmass.screen.steps import format_seconds

    for mode in screen.modes[:SHOWN_MODES]:
        decay = -1.0 / mode.rate.real if mode.rate.real else inf
        time = "grows" if decay < 0 else "–" if isinf(decay) else format_seconds(decay)
        frequency = f"{number(mode.frequency)} Hz" if mode.oscillates else "–"
        damping = number(mode.damping, 2) if mode.oscillates else "–"
        yield frequency, damping, time, mode.joint.name


def step_lines(screen: "Screen") -> Iterator[StepLine]:
    """The largest stable step of each integrator, beside the model's own."""
    from proofmass.screen.steps import CLOSE_RATIO, format_seconds

    steps = screen.steps
    if steps is None:
        return
    for integrator, at_start in steps.limits.items():
        own = integrator == steps.integrator
        limit = steps.limit if own else at_start
        share = steps.own / limit if isfinite(limit) else 0.0
        state = "unstable" if share > 1.0 else "close" if share > CLOSE_RATIO else "stable"
        words = format_seconds(limit) if isfinite(limit) else "none up to 1 s"
        yield StepLine(integrator, own, words, share, state)
