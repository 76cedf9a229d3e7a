"""The failures of a check as SARIF 2.1.0, which code hosts show at the lines of the files."""

import json
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import proofmass
from proofmass.case import Case
from proofmass.check import Result
from proofmass.compare import UNCHECKED_CASE, Comparison
from proofmass.errors import InputError
from proofmass.files import OUTPUT_MARK, read_text
from proofmass.junit import failure_message
from proofmass.outcome import GOOD_OUTCOMES, Outcome

SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
BAD_INPUT = "bad-input"
NOTHING_CHECKED = "nothing-checked"
BAD_OUTCOMES = [outcome for outcome in Outcome if outcome not in GOOD_OUTCOMES]
TABLE_PATTERN = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
KEY_PATTERN = re.compile(r"^\s*((?:[\w-]+|\"[^\"]*\")(?:\s*\.\s*(?:[\w-]+|\"[^\"]*\"))*)\s*=")


def as_sarif(result: Result) -> str:
    """The SARIF file of a result: its failures, inputs with errors, and cases without a check."""
    cases = {case.name: case for case in result.cases}
    lines = LineIndex()
    found = [
        channel_result(c, cases.get(c.case), lines)
        for c in result.comparisons
        if c.outcome not in GOOD_OUTCOMES
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
                            "version": proofmass.__version__,
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
    words[BAD_INPUT] = "a file is not usable: its key, line or whole is at fault"
    words[NOTHING_CHECKED] = "a case has no curve that a tolerance covers"
    return [
        {"id": name, "shortDescription": {"text": text}}
        for name, text in words.items()
        if name in set(used)
    ]


def channel_result(c: Comparison, case: Case | None, lines: "LineIndex") -> dict[str, Any]:
    """The SARIF result of a channel that differs or failed, at its line in sidecar or model."""
    places = []
    if case is not None:
        file, line = case.file, lines.line_of_key(case.file, ["channels", c.channel], exactly=True)
        if line is None and (sensor := lines.line_of_name(case.model_path, c.channel)):
            file, line = case.model_path, sensor
        places = [location(file, line)]
    where = " ".join([c.case, c.run, c.solver, c.channel]).strip()
    return sarif_result(rule_id(c.outcome), f"{where} {failure_message(c)}", places, where)


def case_result(case: Case, lines: "LineIndex") -> dict[str, Any]:
    """The SARIF result of a case of which nothing was checked."""
    return sarif_result(
        NOTHING_CHECKED, f"{case.name}: {UNCHECKED_CASE}", [location(case.file)], case.name
    )


def error_result(error: InputError, lines: "LineIndex") -> dict[str, Any]:
    """The SARIF result of an input with an error, at the line of its key."""
    sidecar = error.file.suffix == ".toml"
    line = lines.line_of_key(error.file, key_parts(error.key)) if sidecar else None
    if line is None and (found_line := re.search(r"\bline (\d+)", f"{error.key} {error.wrong}")):
        line = int(found_line[1])
    words = f"{error.key}: {error.wrong}" if error.key else error.wrong
    return sarif_result(
        BAD_INPUT, words, [location(error.file, line)], f"{error.file.name} {error.key}"
    )


def sarif_result(rule: str, text: str, places: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """A SARIF result; `name` identifies it from one check to the next."""
    return {
        "ruleId": rule,
        "level": "error",
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


class LineIndex:
    """The lines of keys and names in files; each file is read once."""

    def __init__(self) -> None:
        self.texts: dict[Path, list[str]] = {}

    def text(self, file: Path) -> list[str]:
        """The lines of a file; empty if it cannot be read."""
        if file not in self.texts:
            try:
                self.texts[file] = read_text(file).splitlines()
            except InputError:
                self.texts[file] = []
        return self.texts[file]

    def line_of_key(self, file: Path, wanted: list[str], exactly: bool = False) -> int | None:
        """The line of a key in a sidecar, or of the nearest table that contains it.

        With `exactly` only the line of the key itself is given.
        """
        best, deepest = None, 0
        table, counts = list[str](), Counter[str]()
        for number, line in enumerate(self.text(file), 1):
            if head := TABLE_PATTERN.match(line):
                here = table = key_parts(head[2])
                if head[1] == "[[":  # a list of tables, whose numbers are parts of the key
                    here = table = [*table, str(counts[head[2]])]
                    counts[head[2]] += 1
            elif given := KEY_PATTERN.match(line):
                here = [*table, *key_parts(given[1])]
            else:
                continue
            if here == wanted[: len(here)] and len(here) > deepest:
                best, deepest = number, len(here)
        return best if deepest == len(wanted) or not exactly else None

    def line_of_name(self, file: Path, channel: str) -> int | None:
        """The line of a model that names the sensor of a channel, with or without its axis."""
        names = (channel, channel.rpartition(".")[0])
        for name in filter(None, names):
            pattern = re.compile(rf"\bname\s*=\s*([\"']){re.escape(name)}\1")
            for number, line in enumerate(self.text(file), 1):
                if pattern.search(line):
                    return number
        return None


def key_parts(key: str) -> list[str]:
    """The parts of a dotted key; a quoted text is one part.

    >>> key_parts('settings."mujoco:fine".timestep'), key_parts("tolerance.0.why")
    (['settings', 'mujoco:fine', 'timestep'], ['tolerance', '0', 'why'])
    """
    return [quoted or bare for quoted, bare in re.findall(r'"([^"]*)"|([\w:-]+)', key)]
