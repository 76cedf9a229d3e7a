"""First screens of many models: how many fail, their processor time, and what they find.

    python -m benchmarks.screens PATH ... [--quick]

Screens each MJCF file with a world below the given folders, in a process of its own.  Prints a line
for each model with a fault, and the numbers of models and findings of each kind.
"""

import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks import ROOT, command
from proofmass.base.clock import processor_time
from proofmass.base.worker import call_isolated
from proofmass.screen.finding import Severity
from proofmass.screen.screen import Screen, screen_model
from proofmass.sim.protocol.failures import BadModel

TIME_LIMIT = 200.0
"""Processor time of a screen [s]."""


@dataclass(frozen=True)
class Screened:
    """A model, its screen or why there is none, and the processor time [s]."""

    file: Path
    screen: Screen | None
    seconds: float = 0.0
    refused: str = ""
    failed: str = ""


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("paths", type=Path, nargs="*", default=[ROOT / "models"])
    given = parser.parse_args(argv)
    files = sorted(find_models(given.paths))
    results = [screen_one(file) for file in (files[:2] if given.quick else files)]
    moving = [r for r in results if r.screen is not None and r.screen.mobility is not None]
    kinds = Counter(f.kind for r in moving if r.screen for f in r.screen.findings)
    for result in moving:
        for finding in result.screen.findings if result.screen else ():
            if finding.severity is Severity.FAULT:
                print(f"{result.file}: {finding}")
    for result in results:
        if result.failed:
            print(f"{result.file}: failed: {result.failed}")
    seconds = [result.seconds for result in moving] or [0.0]
    print(
        f"{len(results)} files, {sum(bool(r.refused) for r in results)} refused by MuJoCo, "
        f"{sum(bool(r.failed) for r in results)} failed, {len(moving)} with joints; processor time "
        f"of these: median {statistics.median(seconds):.2f} s, largest {max(seconds):.1f} s"
    )
    print(", ".join(f"{count} {kind}" for kind, count in kinds.most_common()))


def find_models(paths: Sequence[Path]) -> Iterator[Path]:
    """The MJCF files with a world below some folders."""
    for path in paths:
        for file in [path] if path.is_file() else path.rglob("*.xml"):
            if "<worldbody" in file.read_text(encoding="utf-8", errors="replace"):
                yield file


def screen_one(file: Path) -> Screened:
    """Screen one model."""
    from benchmarks.screens import timed_screen  # a worker finds no function of __main__

    try:
        return Screened(file, *call_isolated(timed_screen, file, timeout=TIME_LIMIT))
    except BadModel as error:
        return Screened(file, None, refused=str(error))
    except Exception as error:
        return Screened(file, None, failed=f"{type(error).__name__}: {error}")


def timed_screen(file: Path) -> tuple[Screen, float]:
    """Screen one model in this process, and take the processor time [s]."""
    begin = processor_time()
    found = screen_model(file)
    return found, processor_time() - begin


if __name__ == "__main__":
    main()
