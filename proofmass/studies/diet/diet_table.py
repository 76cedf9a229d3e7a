"""What became of each feature of a model in a diet, as a table: a row for each channel of each."""

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.studies.diet.trial import Cost, Interval
from proofmass.studies.table import write_columns

Moved = dict[str, dict[str, float]]
EMPTY = ("",) * 7
SAID = "said"
"""The kind of an entry that is a sentence: what is watched, what options are held against."""
OPTION = "option"
"""The kind of an entry that changes an option of the engine."""
NO_GAIN = "no gain"
"""The outcome of an option that could be changed and saves no time that the clock shows."""
WHOLE = "all of these"
"""The kind of the last entry: all that goes, taken out together."""
COLUMNS = {
    "kind": f"what was taken out; option: what was changed; {SAID}: the message is a sentence on "
            f"what is watched; the last rows, {WHOLE}: all that is harmless at once",
    "feature": "which",
    "outcome": "harmless: it goes; drawn: it could, but a picture needs it; no gain: it could, and "
               "saves no time that is measured; matters: it changes a channel; needed: something "
               "else names it; otherwise how the model fails without it",
    "run": "of the scene: case and run; or the motion from the key",
    "channel": "of that run",
    "moved_over_allowed": "largest change of that channel over what it may change; once options "
                          "were changed, largest error over what it may be [1]",
    "seconds_before": "processor time of a step of the model with it, median of the rounds [s]; "
                      "what goes is gone from later trials, and for the last rows it is all there",
    "seconds_after": "the same without it; of a longer step the time of what a step was before [s]",
    "seconds_saved": "share of the time that is saved, median of pairs of runs [1]",
    "seconds_saved_least": "lower end of the interval that holds that median with a probability of "
                           "0.99, whatever the noise, if that is independent from pair to pair [1]",
    "seconds_saved_most": "upper end of it [1]; no change is measured if 0 is within",
    "bytes_before": "memory of the model and of the state it is stepped with",
    "bytes_after": "the same without the feature",
    "message": "why it is needed, or how the model fails",
}


@dataclass(frozen=True)
class Entry:
    """What became of a feature.

    Attributes
    ----------
    kind, name : str
        What it is, and which.
    outcome : str
        harmless: it goes; drawn: it could, but a picture needs it; matters: it changes a channel;
        needed: something else names it; otherwise how the model fails without it.
    moved : dict of str to dict of str to float
        For each run, how far each channel moves, over what it may.
    message : str
        Why it is needed, or how the model fails.
    costs : tuple of two Cost
        With and without it; none if the model fails.
    saved : Interval
        Share of time that its removal saves: least, median, most; empty without costs.
    """

    kind: str
    name: str
    outcome: str
    moved: Moved = field(default_factory=dict)
    message: str = ""
    costs: tuple[Cost, ...] = ()
    saved: Interval | tuple[()] = ()

    @property
    def title(self) -> str:
        """Kind and name."""
        return f"{self.kind} {self.name}".strip()

    @property
    def saved_time(self) -> float:
        """Share of a step's time that it costs; of entries with costs."""
        return self.saved[1] if self.saved else float("nan")

    @property
    def measurable(self) -> bool:
        """Whether 0 is outside the interval of the time that it costs."""
        if not self.saved:
            return False
        low, _, high = self.saved
        return not low <= 0 <= high

    @property
    def saved_memory(self) -> float:
        """Memory that it costs [KB]; of entries with costs."""
        before, after = self.costs
        return (before.size - after.size) / 1024

    @property
    def worst(self) -> tuple[str, str, float]:
        """Run and channel that move most, and how far over what they may."""
        return max(((run, name, share) for run, shares in self.moved.items()
                    for name, share in shares.items()), key=lambda w: w[2],
                   default=("", "", float("nan")))


def write_entries(entries: Iterable[Entry], file: Path) -> None:
    """Write ``NAME.csv``, and beside it what its columns are, ``diet.columns.md``."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in entries:
        costs = [*(c.seconds for c in entry.costs), *ordered(entry.saved),
                 *(c.size for c in entry.costs)]
        moved = [(run, name, str(share)) for run, shares in entry.moved.items()
                 for name, share in shares.items()]
        for row in moved or [("", "", "")]:
            writer.writerow((entry.kind, entry.name, entry.outcome, *row,
                             *(costs if entry.costs else EMPTY), entry.message))
    write_whole(file, text.getvalue())
    write_columns(file.with_name("diet.columns.md"), "a diet", "channel of a feature", COLUMNS)


def ordered(saved: Interval | tuple[()]) -> tuple[float | str, ...]:
    """An interval as the table has it: the median first."""
    return (saved[1], saved[0], saved[2]) if saved else ("",) * 3


def read_entries(file: Path) -> list[Entry]:
    """The entries that `write_entries` wrote.

    Raises
    ------
    InputError
        It is another table.
    """
    with file.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        if reader.fieldnames != list(COLUMNS):
            raise InputError(file, "", "not the table of a diet: its columns are not "
                             f"{', '.join(COLUMNS)}")
        rows = list(reader)
    whose = itemgetter("kind", "feature", "outcome", "message")
    return [entry(list(own)) for _, own in groupby(rows, whose)]


def entry(rows: list[dict[str, str]]) -> Entry:
    """An entry, of its rows."""
    first, moved = rows[0], dict[str, dict[str, float]]()
    for row in rows:
        if row["run"]:
            moved.setdefault(row["run"], {})[row["channel"]] = float(row["moved_over_allowed"])
    costs = tuple(Cost(float(first[f"seconds_{when}"]), int(first[f"bytes_{when}"]))
                  for when in ("before", "after") if first[f"seconds_{when}"])
    saved = tuple(float(first[f"seconds_saved{which}"]) for which in ("_least", "", "_most")
                  if first["seconds_saved"])
    return Entry(first["kind"], first["feature"], first["outcome"], moved, first["message"], costs,
                 saved if len(saved) == 3 else ())
