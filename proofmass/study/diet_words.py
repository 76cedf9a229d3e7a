"""What to make of a diet, in words."""

from collections.abc import Iterator, Sequence

from proofmass.study.diet_table import WHOLE, Entry
from proofmass.wording import number

RANK = {"harmless": 0, "drawn": 1, "matters": 2}


def ranked(entries: Sequence[Entry]) -> list[Entry]:
    """What goes first; all of it at once last of what could be run, unless nothing goes."""
    goes = any(e.outcome == "harmless" for e in entries if e.kind != WHOLE)
    return sorted((e for e in entries if goes or e.kind != WHOLE),
                  key=lambda e: 3 if e.kind == WHOLE else RANK.get(e.outcome, 4))


def sentences(entries: Sequence[Entry]) -> Iterator[str]:
    """What goes, what that saves, what stays and why; the last of the entries is the whole."""
    single, whole = [e for e in entries if e.kind != WHOLE], entries[-1]
    gone = [e for e in single if e.outcome == "harmless"]
    drawn = [e for e in single if e.outcome == "drawn"]
    if gone:
        yield (f"{len(gone)} of {len(single)} features go together: "
               f"{'; '.join(e.title for e in gone)}.")
        run, channel, share = whole.worst
        yield (f"The largest change is {number(share, 2)} of what is allowed, of {channel} in "
               f"{run}." if share else "No channel changes at all.")
        if whole.costs:
            yield (f"A step takes {number(1 - whole.saved_time, 3)} of its time, and "
                   f"{number(whole.saved_memory)} KB less memory.")
    else:
        matter = sum(e.outcome == "matters" for e in single)
        yield (f"Nothing is left to remove: of {len(single)} features, each taken out, "
               f"{matter} {'moves' if matter == 1 else 'move'} a channel by more than it may, and "
               f"{len(single) - matter - len(drawn)} are needed for the model to run.")
    if drawn:
        yield (f"Drawn, and kept for the eye: {'; '.join(e.name for e in drawn)}. --blind takes "
               f"them out as well.")
