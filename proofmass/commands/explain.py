"""``proofmass explain``: print which numbers of a model no run notices."""

import json
from dataclasses import asdict
from pathlib import Path

from proofmass.base.json_values import replace_nonfinite
from proofmass.batch.check import load_validated
from proofmass.commands.command import error_console, exit_on_error, find_sidecar, progress_bar
from proofmass.evidence.coverage import find_coverage
from proofmass.formats.explain import WIDTH, format_coverage
from proofmass.formats.terminal import describe_unmatched, make_console


def run_explain(path: Path, as_json: bool, jobs: int | None) -> None:
    """Run ``proofmass explain``; `proofmass.commands.cli` describes its arguments."""
    with exit_on_error("the groups that were tried are kept"):
        case = load_validated(find_sidecar(path))
        with progress_bar() as advance:
            found = find_coverage(case, jobs, advance)
    if as_json:
        print(json.dumps(replace_nonfinite(asdict(found)), indent=1, allow_nan=False))
        return
    out = make_console(WIDTH)
    for part in format_coverage(case, found):
        out.print(part)
    if case.unmatched:
        error_console.print(describe_unmatched(case))
