"""The table of a diet, with a row for each channel of each feature, and sentences on it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from pathlib import Path

from proofmass.base.files import write_output
from proofmass.base.wording import number
from proofmass.studies.diet.trial import Cost, TimeRange
from proofmass.studies.record import format_cells, read_cells, write_columns

ChannelChanges = dict[str, dict[str, float]]
EMPTY_COSTS = ("",) * 7
SENTENCE_KIND = "said"
"""The kind of an entry that is only a sentence: what is monitored, or what options are compared
with."""
OPTION_KIND = "option"
"""The kind of an entry that changes an option of the engine."""
NO_GAIN = "no gain"
"""The outcome of an option that could be changed, and saves no measurable time."""
WHOLE_KIND = "all of these"
"""The kind of the last entry: all harmless changes together."""
DIET_COLUMNS = {
    "kind": "kind of the feature that was removed; option: an option that was changed; "
    f"{SENTENCE_KIND}: the message is a sentence on what is monitored; the last rows, "
    f"{WHOLE_KIND}: all harmless changes at once",
    "feature": "name of the feature",
    "outcome": "harmless: it is removed; drawn: it is not needed, but drawn, and kept; no gain: "
    "the change is harmless, and saves no measurable time; matters: it changes a channel; needed: "
    "another element refers to it; otherwise how the model fails without it",
    "run": "case and run of the scene; or the free motion from the key",
    "channel": "channel of that run",
    "moved_over_allowed": "largest change of that channel over the allowed one; if options were "
    "changed, largest error over the allowed one [1]",
    "seconds_before": "processor time of a step of the model with the feature, median of the "
    "rounds [s]; later trials are without the harmless features, and the last rows have all",
    "seconds_after": "the same without the feature; for a longer step the time per original step "
    "[s]",
    "seconds_saved": "share of the time that is saved, median of pairs of runs [1]",
    "seconds_saved_least": "lower end of the interval that contains that median with a probability "
    "of 0.99, for any noise that is independent from pair to pair [1]",
    "seconds_saved_most": "upper end of it [1]; if the interval contains 0, no change is measured",
    "bytes_before": "memory of the model and of its state",
    "bytes_after": "the same without the feature",
    "message": "why it is needed, or how the model fails",
    "edit": "MJCF to paste for the same change; empty if elements are removed",
}


@dataclass(frozen=True)
class Entry:
    """The result of a feature or an option.

    Attributes
    ----------
    kind, name : str
        The kind of feature, and the name of this one.
    outcome : str
        harmless: it is removed; drawn: it is not needed, but drawn, and kept; no gain: the change
        is harmless, and saves no measurable time; matters: it changes a channel; needed: another
        element refers to it; otherwise how the model fails without it.
    moved : dict of str to dict of str to float
        For each run the largest change of each channel, over the allowed one.
    message : str
        Why it is needed, or how the model fails.
    costs : tuple of two Cost
        With and without it; empty if the model fails.
    saved : TimeRange
        Share of time that its removal saves: lower end, median, upper end; empty without costs.
    edit : str
        MJCF to paste for the same change; empty if elements are removed.
    """

    kind: str
    name: str
    outcome: str
    moved: ChannelChanges = field(default_factory=dict)
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
        """Median share of a step's time that is saved; NaN without times."""
        return self.saved[1] if self.saved else float("nan")

    @property
    def measurable(self) -> bool:
        """Whether the interval of the saved time does not contain 0."""
        if not self.saved:
            return False
        low, _, high = self.saved
        return not low <= 0 <= high

    @property
    def saved_memory(self) -> float:
        """Memory that is saved [KB]; for entries with costs only."""
        before, after = self.costs
        return (before.size - after.size) / 1024

    @property
    def worst(self) -> tuple[str, str, float]:
        """The run and channel with the largest change, and that change over the allowed one."""
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
    """Write entries to a CSV file, and the description of its columns to ``diet.columns.md``."""
    rows = []
    for entry in entries:
        costs = [
            *(c.seconds for c in entry.costs),
            *interval_cells(entry.saved),
            *(c.size for c in entry.costs),
        ]
        moved = [
            (run, name, str(share))
            for run, shares in entry.moved.items()
            for name, share in shares.items()
        ]
        for row in moved or [("", "", "")]:
            cells = (
                entry.kind,
                entry.name,
                entry.outcome,
                *row,
                *(costs if entry.costs else EMPTY_COSTS),
                entry.message,
                entry.edit,
            )
            rows.append(dict(zip(DIET_COLUMNS, cells, strict=True)))
    write_output(file, format_cells(rows, DIET_COLUMNS))
    write_columns(file.with_name("diet.columns.md"), "a diet", "channel of a feature", DIET_COLUMNS)


def interval_cells(saved: TimeRange | tuple[()]) -> tuple[float | str, ...]:
    """The cells of an interval in the order of the columns, with the median first."""
    return (saved[1], saved[0], saved[2]) if saved else ("",) * 3


def read_entries(file: Path) -> list[Entry]:
    """Read the entries from a file of `write_entries`.

    Raises
    ------
    InputError
        The file is not the table of a diet.
    """
    rows = read_cells(file, DIET_COLUMNS, "a diet", "proofmass diet")
    whose = itemgetter("kind", "feature", "outcome", "message")
    return [entry_of_rows(list(own)) for _, own in groupby(rows, whose)]


def entry_of_rows(rows: list[dict[str, str]]) -> Entry:
    """The entry that some rows of a table describe."""
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


OUTCOME_RANKS = {"harmless": 0, "drawn": 1, NO_GAIN: 2, "matters": 3}
"""Place of an outcome in the order of entries."""
CONFIDENCE = "99 %"
"""Probability of the intervals of time, as text."""


def sort_entries(entries: Sequence[Entry]) -> list[Entry]:
    """Entries without sentences, sorted by outcome, harmless ones first.

    The entry of all changes comes after those of models that run, and is left out if no change is
    harmless.
    """
    entries = [e for e in entries if e.kind != SENTENCE_KIND]
    goes = any(e.outcome == "harmless" for e in entries if e.kind != WHOLE_KIND)
    return sorted(
        (e for e in entries if goes or e.kind != WHOLE_KIND),
        key=lambda e: 4 if e.kind == WHOLE_KIND else OUTCOME_RANKS.get(e.outcome, 5),
    )


def summary_sentences(entries: Sequence[Entry]) -> Iterator[str]:
    """Sentences on what is removed, what that saves, and what stays and why.

    The last of the entries must be that of all changes together.
    """
    yield from (e.message for e in entries if e.kind == SENTENCE_KIND)
    single, whole = [e for e in entries if e.kind not in (WHOLE_KIND, SENTENCE_KIND)], entries[-1]
    features = [e for e in single if e.kind != OPTION_KIND]
    options = [e for e in single if e.kind == OPTION_KIND]
    gone = [e for e in features if e.outcome == "harmless"]
    cheaper = [e for e in options if e.outcome == "harmless"]
    drawn = [e for e in features if e.outcome == "drawn"]
    if gone:
        yield (
            f"{len(gone)} of {len(features)} features can be removed together: "
            f"{'; '.join(e.title for e in gone)}."
        )
    else:
        matter = sum(e.outcome == "matters" for e in features)
        yield (
            f"Nothing can be removed: of {len(features)} features, each tried by itself, "
            f"{matter} {'changes' if matter == 1 else 'change'} a channel by more than is allowed, "
            f"and {len(features) - matter - len(drawn)} are needed for the model to run."
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
            yield f"{format_time_share(whole)}, and {number(whole.saved_memory)} KB less memory."
    if stay := [e for e in options if e.outcome == "matters"]:
        yield (
            "Options that are not changed, since an error would be too large: "
            + "; ".join(
                f"{e.name} ({number(e.worst[2], 2)} of what is allowed, of {e.worst[1]})"
                for e in stay
            )
            + "."
        )
    if drawn:
        yield (
            f"Only drawn, and kept: {'; '.join(e.name for e in drawn)}. --blind removes them as "
            f"well."
        )


def format_time_share(entry: Entry) -> str:
    """A phrase on the share of its former time that a run takes after a change, with interval."""
    if not entry.saved:
        return "Its time was not compared"
    low, middle, high = (1 - share for share in reversed(entry.saved))
    interval = f"{number(low, 3)} to {number(high, 3)}"
    if not entry.measurable:
        return f"The time of a run does not change measurably ({interval} of it with {CONFIDENCE})"
    return f"A run takes {number(middle, 3)} of its time ({interval} with {CONFIDENCE})"


def format_saving(entry: Entry) -> str:
    """The share of time that is saved, in per cent; "none" if no change is measurable.

    >>> format_saving(Entry("light", "sun", "harmless", saved=(-0.02, 0.01, 0.03)))
    'none'
    >>> format_saving(Entry("contact", "all", "harmless", saved=(0.31, 0.328, 0.34)))
    '33 % (31 to 34)'
    """
    if not entry.saved:
        return "—"
    if not entry.measurable:
        return "none"
    low, middle, high = (number(100 * share, 2) for share in entry.saved)
    return f"{middle} % ({low} to {high})"
