"""A diet as a table with a record for each channel of each feature, and in words."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.studies.diet.trial import Cost, TimeRange
from proofmass.studies.record import write_columns
from proofmass.wording import number

Displacements = dict[str, dict[str, float]]
EMPTY = ("",) * 7
SAID = "said"
"""The kind of an entry that is a sentence: what is monitored, what options are held against."""
OPTION = "option"
"""The kind of an entry that changes an option of the engine."""
NO_GAIN = "no gain"
"""The outcome of an option that could be changed and saves no time that the clock shows."""
WHOLE = "all of these"
"""The kind of the last entry: all that goes, taken out together."""
COLUMNS = {
    "kind": f"what was taken out; option: what was changed; {SAID}: the message is a sentence on "
    f"what is monitored; the last rows, {WHOLE}: all that is harmless at once",
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
    "edit": "what to paste into the MJCF instead; empty where elements are taken out",
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
    edit : str
        What to paste into the MJCF instead; empty where elements are taken out.
    """

    kind: str
    name: str
    outcome: str
    moved: Displacements = field(default_factory=dict)
    message: str = ""
    costs: tuple[Cost, ...] = ()
    saved: TimeRange | tuple[()] = ()
    edit: str = ""

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
        return max(
            (
                (run, name, share)
                for run, shares in self.moved.items()
                for name, share in shares.items()
            ),
            key=lambda w: w[2],
            default=("", "", float("nan")),
        )


def write_entries(entries: Iterable[Entry], file: Path) -> None:
    """Write ``NAME.csv``, and beside it what its columns are, ``diet.columns.md``."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in entries:
        costs = [
            *(c.seconds for c in entry.costs),
            *ordered(entry.saved),
            *(c.size for c in entry.costs),
        ]
        moved = [
            (run, name, str(share))
            for run, shares in entry.moved.items()
            for name, share in shares.items()
        ]
        for row in moved or [("", "", "")]:
            writer.writerow(
                (
                    entry.kind,
                    entry.name,
                    entry.outcome,
                    *row,
                    *(costs if entry.costs else EMPTY),
                    entry.message,
                    entry.edit,
                )
            )
    write_whole(file, text.getvalue())
    write_columns(file.with_name("diet.columns.md"), "a diet", "channel of a feature", COLUMNS)


def ordered(saved: TimeRange | tuple[()]) -> tuple[float | str, ...]:
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
            raise InputError(
                file, "", f"not the table of a diet: its columns are not {', '.join(COLUMNS)}"
            )
        rows = list(reader)
    whose = itemgetter("kind", "feature", "outcome", "message")
    return [entry(list(own)) for _, own in groupby(rows, whose)]


def entry(rows: list[dict[str, str]]) -> Entry:
    """An entry, of its rows."""
    first, moved = rows[0], dict[str, dict[str, float]]()
    for row in rows:
        if row["run"]:
            moved.setdefault(row["run"], {})[row["channel"]] = float(row["moved_over_allowed"])
    costs = tuple(
        Cost(float(first[f"seconds_{when}"]), int(first[f"bytes_{when}"]))
        for when in ("before", "after")
        if first[f"seconds_{when}"]
    )
    saved = tuple(
        float(first[f"seconds_saved{which}"])
        for which in ("_least", "", "_most")
        if first["seconds_saved"]
    )
    return Entry(
        first["kind"],
        first["feature"],
        first["outcome"],
        moved,
        first["message"],
        costs,
        saved if len(saved) == 3 else (),
        first["edit"],
    )


RANK = {"harmless": 0, "drawn": 1, NO_GAIN: 2, "matters": 3}
SURE = "99 %"


def ranked(entries: Sequence[Entry]) -> list[Entry]:
    """What goes first; all of it at once last of what could be run, unless nothing goes."""
    entries = [e for e in entries if e.kind != SAID]
    goes = any(e.outcome == "harmless" for e in entries if e.kind != WHOLE)
    return sorted(
        (e for e in entries if goes or e.kind != WHOLE),
        key=lambda e: 4 if e.kind == WHOLE else RANK.get(e.outcome, 5),
    )


def sentences(entries: Sequence[Entry]) -> Iterator[str]:
    """What goes, what that saves, what stays and why; the last of the entries is the whole."""
    yield from (e.message for e in entries if e.kind == SAID)
    single, whole = [e for e in entries if e.kind not in (WHOLE, SAID)], entries[-1]
    features = [e for e in single if e.kind != OPTION]
    options = [e for e in single if e.kind == OPTION]
    gone = [e for e in features if e.outcome == "harmless"]
    cheaper = [e for e in options if e.outcome == "harmless"]
    drawn = [e for e in features if e.outcome == "drawn"]
    if gone:
        yield (
            f"{len(gone)} of {len(features)} features go together: "
            f"{'; '.join(e.title for e in gone)}."
        )
    else:
        matter = sum(e.outcome == "matters" for e in features)
        yield (
            f"Nothing is left to remove: of {len(features)} features, each taken out, "
            f"{matter} {'moves' if matter == 1 else 'move'} a channel by more than it may, and "
            f"{len(features) - matter - len(drawn)} are needed for the model to run."
        )
    if cheaper:
        yield f"Options are changed: {'; '.join(e.name for e in cheaper)}."
    if gone or cheaper:
        run, channel, share = whole.worst
        what = "error of a channel" if cheaper else "change"
        yield (
            f"The largest {what} is {number(share, 2)} of what is allowed, of {channel} in {run}."
            if share
            else "No channel changes at all."
        )
        if whole.costs:
            yield f"{spent(whole)}, and {number(whole.saved_memory)} KB less memory."
    if stay := [e for e in options if e.outcome == "matters"]:
        yield (
            "Options that stay, since an error would be too large: "
            + "; ".join(
                f"{e.name} ({number(e.worst[2], 2)} of what is allowed, of {e.worst[1]})"
                for e in stay
            )
            + "."
        )
    if drawn:
        yield (
            f"Drawn, and kept for the eye: {'; '.join(e.name for e in drawn)}. --blind takes "
            f"them out as well."
        )


def spent(entry: Entry) -> str:
    """The share of its time that a run takes without something, with the interval of that."""
    if not entry.saved:
        return "Its time was not compared"
    low, middle, high = (1 - share for share in reversed(entry.saved))
    interval = f"{number(low, 3)} to {number(high, 3)}"
    if not entry.measurable:
        return f"The time of a run does not change measurably ({interval} of it with {SURE})"
    return f"A run takes {number(middle, 3)} of its time ({interval} with {SURE})"


def saving(entry: Entry) -> str:
    """The share of time that a feature costs, in per cent; "none" where none is measurable.

    >>> saving(Entry("light", "sun", "harmless", saved=(-0.02, 0.01, 0.03)))
    'none'
    >>> saving(Entry("contact", "all", "harmless", saved=(0.31, 0.328, 0.34)))
    '33 % (31 to 34)'
    """
    if not entry.saved:
        return "—"
    if not entry.measurable:
        return "none"
    low, middle, high = (number(100 * share, 2) for share in entry.saved)
    return f"{middle} % ({low} to {high})"
