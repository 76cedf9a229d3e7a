"""A check as Markdown for a comment on a pull request, and for the summary of a workflow.

The comment begins with a line by which it is found again and replaced.
"""

import re
from collections import Counter
from collections.abc import Iterator
from itertools import groupby

from proofmass.base.files import OUTPUT_MARK
from proofmass.base.wording import format_mjcf_parts, number
from proofmass.batch.check import Result
from proofmass.verdict.comparison import Comparison
from proofmass.verdict.outcome import GOOD_OUTCOMES, Outcome

LONGEST = 60_000
"""Characters of a comment; GitHub accepts 65,536."""
MARKUP = re.compile(r"([\\`*_{}\[\]<>#|~@])")
"""Characters with a meaning in Markdown, and the one that calls a person."""
SIGNS = {"fault": "❌", "warning": "⚠️", "note": "·"}


def as_markdown(result: Result) -> str:
    """The comment on a result: what failed first, then the first screens of models."""
    blocks = [f"<!-- {OUTPUT_MARK} -->", f"### proofmass: {headline(result)}"]
    length = sum(map(len, blocks))
    rest = [*error_lines(result), *failed_lines(result), *screen_blocks(result)]
    for k, block in enumerate(rest):
        length += len(block) + 2
        if length > LONGEST:
            blocks.append(f"… {len(rest) - k} more: see the log of the check.")
            break
        blocks.append(block)
    return "\n\n".join(blocks) + "\n"


def plain(text: str) -> str:
    r"""A text in which nothing is markup, but for attributes, which are set as code.

    >>> plain('body <b> @all: damping="1"')
    'body \\<b\\> \\@all: `damping="1"`'
    """
    return format_mjcf_parts(
        text,
        code=lambda part: f"`{part.replace('`', '')}`",
        rest=lambda part: MARKUP.sub(r"\\\1", part),
    ).replace("\n", " ")


def headline(result: Result) -> str:
    """The numbers of cases with each outcome, and of models with faults."""
    worst = (
        min((c.outcome for c in rows), key=lambda outcome: outcome in GOOD_OUTCOMES)
        for _, rows in groupby(result.comparisons, lambda c: c.case)
    )
    counts = Counter(map(str, worst))
    parts = [f"{count} {outcome}" for outcome, count in counts.items()]
    faulty = sum(
        any(finding.severity.name == "FAULT" for finding in screen.findings)
        for screen in result.screens.values()
    )
    parts += [f"{faulty} with a fault at the start"] * bool(faulty)
    parts += [f"{len(result.errors)} with bad input"] * bool(result.errors)
    return ", ".join(parts) or "nothing was checked"


def error_lines(result: Result) -> Iterator[str]:
    """A line for each input at fault."""
    for error in result.errors:
        key = f", {plain(error.key)}" if error.key else ""
        yield f"❌ **{plain(error.file.name)}**{key}: {plain(error.wrong)}"


def failed_lines(result: Result) -> Iterator[str]:
    """A line for each case that differs or failed, with its cause if one was found."""
    causes = {d.case: cause.text for cause in result.causes for d in cause.diagnoses}
    for case, rows in groupby(result.comparisons, lambda c: c.case):
        screened = case in result.screens  # whose block says it
        bad = [c for c in rows if c.outcome not in GOOD_OUTCOMES and (c.channel or not screened)]
        if bad:
            why = causes.get(case) or describe_worst(bad)
            runs = ", ".join(dict.fromkeys(f"{c.run} {c.solver}" for c in bad))
            yield f"❌ **{plain(case)}** {bad[0].outcome} ({plain(runs)}): {plain(why)}"


def describe_worst(rows: list[Comparison]) -> str:
    """The message of a failure, or the channel that is farthest from its reference."""
    failed = next((c for c in rows if c.outcome != Outcome.DIFFERS), None)
    if failed is not None:
        return failed.message
    worst = max(rows, key=lambda c: c.share_of_allowed)
    allowed = f", where {number(worst.allowed)} {worst.unit} are allowed"
    return f"{worst.channel} is off by {number(worst.error_max)} {worst.unit}{allowed}"


def screen_blocks(result: Result) -> Iterator[str]:
    """The first screen of each model: what it is, and what is wrong; models with faults first."""
    if not result.screens:
        return
    from proofmass.formats.screen import describe_model  # loads MuJoCo

    messages = {c.case: f"{c.outcome}: {c.message}" for c in result.comparisons if not c.channel}
    ordered = sorted(
        result.screens.items(),
        key=lambda item: -max((f.severity for f in item[1].findings), default=0),
    )
    for name, screen in ordered:
        lines = [f"**{plain(name)}**: {plain(describe_model(screen))}"]
        for finding in screen.findings:
            remedy = f" — to do: {plain(finding.remedy)}" if finding.remedy else ""
            lines.append(f"- {SIGNS[finding.severity.name.lower()]} {plain(finding.text)}{remedy}")
        if name in messages:
            lines.append(f"- {plain(messages[name])}")
        yield "\n".join(lines)
