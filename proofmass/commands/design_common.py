"""What the commands of ``proofmass design`` share: bounds as texts, and the check of cases."""

from collections.abc import Callable, Sequence
from pathlib import Path

from proofmass.batch.check import check
from proofmass.commands.command import error_console

Bounds = dict[str, tuple[float, float]]
"""The least and the largest value of parameters by their names [SI]."""


def parse_bounds(
    texts: Sequence[str], example: str, unit: Callable[[str], float] = lambda _: 1.0
) -> Bounds:
    """Bounds by parameter, from texts written as NAME=LOW:HIGH.

    `example` ends the message on a text that is written otherwise, and `unit` gives the SI value of
    a parameter's unit by its name.

    >>> parse_bounds(["length1=0.2:0.4"], ", such as length1=0.2:0.4")
    {'length1': (0.2, 0.4)}
    """
    given = {}
    for text in texts:
        name, _, pair = text.partition("=")
        low, _, high = pair.partition(":")
        try:
            given[name] = float(low) * unit(name), float(high) * unit(name)
        except ValueError:
            raise ValueError(f"--bound {text}: write it as NAME=LOW:HIGH{example}") from None
    return given


def check_cases(sidecars: list[Path], folder: Path, named: bool = False) -> int:
    """Check written cases in the engines, write their report, and return the exit code.

    Prints a headline for each case, after its name if `named`, and the name of the report.
    """
    from proofmass.report import headline, write_report  # matplotlib is slow to load

    result = check(sidecars)
    for error in result.errors:
        error_console.print(f"error: {error}", style="bold red", markup=False)
    for case in result.cases:
        name = f"{case.name}: " if named else ""
        print(f"{name}{headline(case, result.comparisons)}")
    print(write_report(result, folder / "report"))
    return result.exit_code
