"""Public threads and what a first screen says of a model with their numbers: docs/threads.md.

    python -m docs.make.threads [--quick]

The threads, the questions and the right answers stand in tests/data/threads/threads.toml.  The
answers of proofmass are made by screening each model, and the table is written between marks.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks import ROOT, command
from docs.make.marks import write_between
from proofmass.formats.screen import describe_model
from proofmass.screen.finding import ModelFinding
from proofmass.screen.screen import Screen, screen_model

PAGE = ROOT / "docs" / "threads.md"
FOLDER = ROOT / "tests" / "data" / "threads"
TABLE_BEGIN = "<!-- python -m docs.make.threads writes from here to the next mark -->"
TABLE_END = "<!-- to here -->"


@dataclass(frozen=True)
class Thread:
    """A public thread, and the answer that is right; the fields are those of threads.toml."""

    file: str
    links: tuple[str, ...]
    asked: str
    right: str
    supposed: bool = False
    kind: str = ""
    element: str = ""
    value: float | None = None
    within: float = 0.0
    says: str = ""

    @property
    def path(self) -> Path:
        """The model."""
        return FOLDER / self.file

    def answer(self, screen: Screen) -> str:
        """The sentence of a screen's worst findings that gives the right answer; empty if none."""
        if self.says:
            summary = describe_model(screen)
            return summary if self.says in summary else ""
        worst = max((finding.severity for finding in screen.findings), default=0)
        for finding in screen.findings:
            if finding.severity == worst and self.fits(finding):
                return str(finding)
        return ""

    def fits(self, finding: ModelFinding) -> bool:
        """Whether a finding has the right kind, element and value."""
        return (
            finding.kind == self.kind
            and (not self.element or self.element in f"{finding} {finding.element}")
            and (
                self.value is None
                or (
                    finding.value is not None
                    and abs(abs(finding.value) - self.value) <= self.within * self.value
                )
            )
        )


def threads() -> list[Thread]:
    """All threads of the table."""
    table: dict[str, Any] = tomllib.loads((FOLDER / "threads.toml").read_text(encoding="utf-8"))
    return [Thread(**row | {"links": tuple(row["links"])}) for row in table["thread"]]


def link(address: str) -> str:
    """A link to a thread on GitHub, such as mujoco#954."""
    project, number = address.split("/")[1], address.rsplit("/", 1)[1]
    return f"[{project}#{number}](https://github.com/{address})"


def row(thread: Thread, answer: str) -> str:
    """A row of the table."""
    links = ", ".join(map(link, thread.links))
    cells = (
        f"{links}: {thread.asked}{' *' if thread.supposed else ''}",
        thread.right,
        answer or "**no answer**",
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def table(answers: dict[Thread, str]) -> str:
    """The numbers of threads that are answered, and the table."""
    answered = [thread for thread, answer in answers.items() if answer]
    stated = [thread for thread in answers if not thread.supposed]
    lines = [
        f"**{len(answered)} of {len(answers)}** are answered by a finding of the worst kind in the "
        f"first paragraph. {len(stated)} of the threads state their cause, and "
        f"{sum(not thread.supposed for thread in answered)} of these are answered; in the others, "
        "with *, the cause is one that fits what they describe.",
        "",
        "| thread | what is right, and how it is known | what `proofmass check` says |",
        "|---|---|---|",
        *(row(thread, answer) for thread, answer in answers.items()),
    ]
    return "\n".join(lines)


def page_with_threads(text: str) -> str:
    """The page with its table made anew."""
    answers = {thread: thread.answer(screen_model(thread.path)) for thread in threads()}
    return write_between(text, TABLE_BEGIN, TABLE_END, table(answers))


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    given = parser.parse_args(argv)
    text = page_with_threads(PAGE.read_text(encoding="utf-8"))
    if not given.quick:
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
