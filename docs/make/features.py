"""What becomes of each feature of a model: the table of docs/engines.md, from the data of the runs.

    python -m docs.make.features [--quick]

It is written between two marks.
"""

from collections import Counter
from collections.abc import Sequence

from benchmarks import ROOT, command
from docs.make.marks import write_between
from proofmass.analytic.features import FEATURES
from proofmass.analytic.planar.support import SUPPORT as PLANAR
from proofmass.analytic.refined import SUPPORT as REFINED
from proofmass.analytic.spatial.support import SUPPORT as SPATIAL
from proofmass.analytic.support import Answers, RunKind, Support
from proofmass.sim.engines import default_engines, engine_of

PAGE = ROOT / "docs" / "engines.md"
BEGIN = "<!-- python -m docs.make.features writes from here to the next mark -->"
END = "<!-- to here -->"
SHORT = {
    RunKind.SWEEP: "sweep",
    RunKind.FREE_SWEEP: "free sweep",
    RunKind.MOVING_SWEEP: "moving sweep",
    RunKind.SETTLED_SWEEP: "settled sweep",
    RunKind.EQUILIBRIUM: "equilibrium",
    RunKind.FREE_MOTION: "free motion",
    RunKind.DRIVEN_MOTION: "driven motion",
}
"""Kinds of runs in cells."""


def columns() -> dict[str, Support]:
    """The engines and the general references by their names, with their answers."""
    engines = {engine_of(name).title: engine_of(name).support for name in default_engines()}
    return {**engines, "`planar`": PLANAR, "`spatial`": SPATIAL, "`refined`": REFINED}


def cell(answers: Answers) -> str:
    """The most frequent answer of a feature, and the kinds of runs with another one."""
    usual = Counter(answers.values()).most_common(1)[0][0]
    others: dict[str, list[str]] = {}
    for kind, answer in answers.items():
        if answer != usual:
            others.setdefault(answer, []).append(SHORT[kind])
    return "; ".join([usual, *(f"{', '.join(kinds)}: {one}" for one, kinds in others.items())])


def table() -> str:
    """The table as Markdown."""
    parties = columns()
    rows = [["feature", "in MJCF", *parties], ["---"] * (2 + len(parties))]
    for name, feature in FEATURES.items():
        rows.append([name, feature.mjcf, *(cell(support[name]) for support in parties.values())])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def page_with_table(text: str) -> str:
    """The text of the page with the present table."""
    return write_between(text, BEGIN, END, table())


def main(argv: Sequence[str] | None = None) -> None:
    """Write the table into the page; with ``--quick`` print it."""
    if command(__doc__).parse_args(argv).quick:
        print(table())
        return
    PAGE.write_text(page_with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
