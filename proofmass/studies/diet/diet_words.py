"""What to make of a diet, in words."""

from collections.abc import Iterator, Sequence

from proofmass.studies.diet.diet_table import NO_GAIN, OPTION, SAID, WHOLE, Entry
from proofmass.wording import number

RANK = {"harmless": 0, "drawn": 1, NO_GAIN: 2, "matters": 3}
SURE = "99 %"


def ranked(entries: Sequence[Entry]) -> list[Entry]:
    """What goes first; all of it at once last of what could be run, unless nothing goes."""
    entries = [e for e in entries if e.kind != SAID]
    goes = any(e.outcome == "harmless" for e in entries if e.kind != WHOLE)
    return sorted((e for e in entries if goes or e.kind != WHOLE),
                  key=lambda e: 4 if e.kind == WHOLE else RANK.get(e.outcome, 5))


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
        yield (f"{len(gone)} of {len(features)} features go together: "
               f"{'; '.join(e.title for e in gone)}.")
    else:
        matter = sum(e.outcome == "matters" for e in features)
        yield (f"Nothing is left to remove: of {len(features)} features, each taken out, "
               f"{matter} {'moves' if matter == 1 else 'move'} a channel by more than it may, and "
               f"{len(features) - matter - len(drawn)} are needed for the model to run.")
    if cheaper:
        yield f"Options are changed: {'; '.join(e.name for e in cheaper)}."
    if gone or cheaper:
        run, channel, share = whole.worst
        what = "error of a channel" if cheaper else "change"
        yield (f"The largest {what} is {number(share, 2)} of what is allowed, of {channel} in "
               f"{run}." if share else "No channel changes at all.")
        if whole.costs:
            yield f"{spent(whole)}, and {number(whole.saved_memory)} KB less memory."
    if stay := [e for e in options if e.outcome == "matters"]:
        yield ("Options that stay, since an error would be too large: "
               + "; ".join(f"{e.name} ({number(e.worst[2], 2)} of what is allowed, of {e.worst[1]})"
                           for e in stay) + ".")
    if drawn:
        yield (f"Drawn, and kept for the eye: {'; '.join(e.name for e in drawn)}. --blind takes "
               f"them out as well.")


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
