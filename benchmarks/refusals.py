"""Why the general references do not cover models of other projects: their refusals by reason.

    python -m benchmarks.refusals PATH ... [--quick]

Solves the free motion of each MJCF with a joint below the given folders for a short time by
`planar`, and by `spatial` if that does not cover it.  Prints the numbers of models that each of
them covers, and a table of the reasons of `spatial` where neither does, with a model of each.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks import ROOT, command
from benchmarks.screens import find_models
from proofmass.analytic import planar, spatial
from proofmass.base.read_once import forget_inputs
from proofmass.base.worker import call_isolated
from proofmass.reference.model_run import smooth_terms
from proofmass.screen.short_run import start_key
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadModel

TIME_LIMIT = 60.0
"""Processor time of one model [s]."""
TIMES = np.linspace(0.0, 0.1, 11)
"""Times of the motion [s]."""
NAME = re.compile(r"'[^']*'|\b[-+]?\d[\d.]*(e[-+]?\d+)?\b")
"""Names and numbers in a reason, by which models differ that are refused for the same."""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("paths", type=Path, nargs="*", default=[ROOT / "models"])
    given = parser.parse_args(argv)
    files = sorted(find_models(given.paths))
    importable = import_module("benchmarks.refusals").cover  # the worker cannot import __main__
    covered, refused = defaultdict(int), defaultdict(list)
    for file in files[:2] if given.quick else files:
        try:
            by, why = call_isolated(importable, file, timeout=TIME_LIMIT)
        except Exception as error:
            by, why = "", f"{type(error).__name__}: {error}"
        if by:
            covered[by] += 1
        elif why:
            refused[NAME.sub("…", why)].append((file, why))
    total = sum(covered.values()) + sum(map(len, refused.values()))
    counts = ", ".join(f"{count} by {by}" for by, count in sorted(covered.items())) or "none"
    print(f"{total} models with joints; covered: {counts}")
    print("\n| models | reason | for example |\n|---|---|---|")
    for group in sorted(refused.values(), key=len, reverse=True):
        file, why = group[0]
        print(f"| {len(group)} | {why} | {file.name} |")


def cover(file: Path) -> tuple[str, str]:
    """The reference that covers a model, or the reason of `spatial`; both empty without joints."""
    try:
        model = compile_model(file)
    except BadModel:
        return "", ""
    if not model.njnt:
        return "", ""
    forget_inputs()  # a worker has many models after each other
    key = start_key(model)
    start = model.key(key).name if key >= 0 else ""
    try:
        planar.solve(TIMES, model=model, start=start)
    except ValueError:
        pass
    else:
        return "planar", ""
    try:
        named = start or not model.nkey  # MuJoCo's terms want the name of the key
        terms = smooth_terms(model, start) if named else None
        spatial.solve(TIMES, model=model, start=start, terms=terms)
    except ValueError as error:
        return "", str(error)
    return "spatial", ""


if __name__ == "__main__":
    main()
