"""The failures of a check as SARIF 2.1.0, which code hosts show at the lines of the files."""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from proofmass.base.errors import InputError
from proofmass.base.files import OUTPUT_MARK
from proofmass.base.grouping import group_by
from proofmass.base.installation import own_version
from proofmass.base.lines import LineIndex, key_parts
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.formats.junit import failure_message
from proofmass.screen.finding import FindingKind
from proofmass.verdict.comparison import UNCHECKED_CASE, Comparison
from proofmass.verdict.outcome import GOOD_OUTCOMES, Outcome

if TYPE_CHECKING:
    from proofmass.evidence.diagnosis import SharedCause
    from proofmass.screen.finding import ModelFinding

SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
BAD_INPUT_RULE = "bad-input"
NOTHING_CHECKED = "nothing-checked"
BAD_OUTCOMES = [outcome for outcome in Outcome if outcome not in GOOD_OUTCOMES]


def as_sarif(result: Result) -> str:
    """The SARIF file of a result.

    It has one result for each cause, at the line of the wrong value, for each run without a known
    cause, for each finding of a first screen, at the line of its element, for each input with an
    error, and for each case without a check.
    """
    cases = {case.name: case for case in result.cases}
    lines = LineIndex()
    causes = result.causes
    explained = {run for cause in causes for run in cause.runs}
    failures = [c for c in result.comparisons if c.outcome not in GOOD_OUTCOMES]
    rows = group_by(failures, lambda c: (c.case, c.run, c.solver))
    found = [
        cause_result(
            cause, [c for d in cause.diagnoses for c in rows[d.case, d.run, d.solver]], cases, lines
        )
        for cause in causes
    ]
    found += [
        run_result(some, cases.get(run[0]), lines)
        for run, some in rows.items()
        if run not in explained
    ]
    found += [
        finding_result(screen.file, finding, lines)
        for screen in result.screens.values()
        if screen.file is not None
        for finding in screen.findings
        if finding.kind is not FindingKind.NOTHING_MOVES  # the outcome of the model says that
    ]
    found += [case_result(case, lines) for case in result.unchecked]
    found += [error_result(error, lines) for error in result.errors]
    rules = rules_of({each["ruleId"] for each in found})
    order = {rule["id"]: k for k, rule in enumerate(rules)}
    for each in found:
        each["ruleIndex"] = order[each["ruleId"]]
    return json.dumps(
        {
            "$schema": SARIF_SCHEMA,
            "version": "2.1.0",
            "properties": {"comment": OUTPUT_MARK},
            "runs": [
                {
                    "tool": {
                        "driver": {
                            "name": "proofmass",
                            "version": own_version(),
                            "rules": rules,
                        }
                    },
                    "invocations": [
                        {
                            "executionSuccessful": not result.errors,
                            "exitCode": result.exit_code,
                        }
                    ],
                    "columnKind": "unicodeCodePoints",
                    "results": found,
                }
            ],
        },
        indent=1,
        ensure_ascii=False,
    )


def rule_id(outcome: str) -> str:
    """The rule of an outcome.

    >>> rule_id("timed out")
    'timed-out'
    """
    return outcome.replace(" ", "-")


def rules_of(used: Iterable[str]) -> list[dict[str, Any]]:
    """The SARIF rules with these identifiers."""
    words = {rule_id(outcome): outcome.sentence for outcome in BAD_OUTCOMES}
    words[BAD_INPUT_RULE] = "a file is not usable: its key, line or whole is at fault"
    words[NOTHING_CHECKED] = "a case has no curve that a tolerance covers"
    words |= {kind.value: kind.sentence for kind in FindingKind}
    return [
        {"id": name, "shortDescription": {"text": text}}
        for name, text in words.items()
        if name in set(used)
    ]


def cause_result(
    cause: "SharedCause",
    rows: Sequence[Comparison],
    cases: Mapping[str, Case],
    lines: LineIndex,
) -> dict[str, Any]:
    """The SARIF result of a cause, at the line of the wrong value, for all runs that it explains.

    A cause without a place is at the worst of its curves.
    """
    worst = max(rows, key=lambda c: finite_or_zero(c.share_of_allowed))
    faults = cause.best.faults
    places = [location(fault.file, fault.line) for fault in faults]
    texts = [cause.text, *(f"{f.place} would be: {f.instead}" for f in faults if f.instead)]
    texts += [f"{where_of(worst)} {failure_message(worst)}"]
    name = " ".join(" ".join(map(str, (f.file.name, f.name, *f.values))) for f in faults)
    places = places or [channel_location(worst, cases.get(worst.case), lines)]
    name = name or f"{worst.case} {cause.best.words}"
    return sarif_result(rule_id(worst.outcome), "\n".join(texts), places, name)


def finite_or_zero(value: float) -> float:
    """A number, or 0 if it is not finite."""
    return value if math.isfinite(value) else 0.0


def run_result(rows: Sequence[Comparison], case: Case | None, lines: LineIndex) -> dict[str, Any]:
    """The SARIF result of a run that differs or failed, at the worst of its curves."""
    worst = max(rows, key=lambda c: finite_or_zero(c.share_of_allowed))
    places = [] if case is None else [channel_location(worst, case, lines)]
    more = f" ({len(rows)} curves)" if len(rows) > 1 else ""
    text = f"{where_of(worst)} {failure_message(worst)}{more}"
    return sarif_result(rule_id(worst.outcome), text, places, where_of(rows[0]))


def where_of(c: Comparison) -> str:
    """The case, the run, the solver and the channel of a comparison."""
    return " ".join([c.case, c.run, c.solver, c.channel]).strip()


def channel_location(c: Comparison, case: Case | None, lines: LineIndex) -> dict[str, Any]:
    """The line of a channel in the sidecar, or of its sensor in the model."""
    if case is None:
        return {}
    file, line = case.file, lines.line_of_key(case.file, ["channels", c.channel], exactly=True)
    if line is None and (sensor := lines.line_of_name(case.model_path, c.channel)):
        file, line = case.model_path, sensor
    return location(file, line)


def case_result(case: Case, lines: LineIndex) -> dict[str, Any]:
    """The SARIF result of a case of which nothing was checked."""
    return sarif_result(
        NOTHING_CHECKED, f"{case.name}: {UNCHECKED_CASE}", [location(case.file)], case.name
    )


def finding_result(file: Path, finding: "ModelFinding", lines: LineIndex) -> dict[str, Any]:
    """The SARIF result of a finding of a first screen, at the line of its element."""
    element, line = finding.element, None
    if element is not None:
        line = lines.line_of_element(file, element.tag, element.name)
    name = f"{file.name} {element or ''}".strip()
    level = {"FAULT": "error", "WARNING": "warning"}.get(finding.severity.name, "note")
    return sarif_result(finding.kind, str(finding), [location(file, line)], name, level)


def error_result(error: InputError, lines: LineIndex) -> dict[str, Any]:
    """The SARIF result of an input with an error, at the line of its key."""
    sidecar = error.file.suffix == ".toml"
    line = lines.line_of_key(error.file, key_parts(error.key)) if sidecar else None
    if line is None and (found_line := re.search(r"\bline (\d+)", f"{error.key} {error.wrong}")):
        line = int(found_line[1])
    words = f"{error.key}: {error.wrong}" if error.key else error.wrong
    return sarif_result(
        BAD_INPUT_RULE, words, [location(error.file, line)], f"{error.file.name} {error.key}"
    )


def sarif_result(
    rule: str, text: str, places: list[dict[str, Any]], name: str, level: str = "error"
) -> dict[str, Any]:
    """A SARIF result; `name` identifies it from one check to the next."""
    return {
        "ruleId": rule,
        "level": level,
        "message": {"text": text},
        "locations": places,
        "partialFingerprints": {"proofmass/v1": f"{rule} {name}".strip()},
    }


def location(file: Path, line: int | None = None) -> dict[str, Any]:
    """A SARIF location in a file, with a relative path if the file is below the current folder."""
    whole = Path(file).absolute()
    try:
        relative = whole.relative_to(Path.cwd())
        artifact = {"uri": quote_path(relative), "uriBaseId": "%SRCROOT%"}
    except ValueError:
        artifact = {"uri": whole.as_uri()}
    region = {} if line is None else {"region": {"startLine": line}}
    return {"physicalLocation": {"artifactLocation": artifact, **region}}


def quote_path(relative: Path) -> str:
    """A relative path, quoted as in a URI.

    >>> quote_path(Path("a b/ü.toml"))
    'a%20b/%C3%BC.toml'
    """
    root = Path.cwd().anchor
    return (Path(root) / relative).as_uri().removeprefix(Path(root).as_uri())
