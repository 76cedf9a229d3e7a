"""The reference of many runs of a case, computed once where the same is asked for again."""

from proofmass.case import Case
from proofmass.compare import reference_for
from sim.protocol import Array, Curves

KEPT = 8  # references; the motions of driven runs differ, and nobody asks for them again
known: dict[tuple[str, int, bytes], dict[str, Array]] = {}


def truth(case: Case, curves: Curves) -> dict[str, Array]:
    """`reference_for`, channel by channel; free motions and exact sweeps have it in common.

    The integration of a free linkage takes longer than most runs that are held against it.
    """
    asked = case.model_copy(update={"settings": {}}).model_dump_json()
    where = b"".join(part.tobytes() for part in (curves.x, *(curves.drive or ())))
    key = asked, case.model_path.stat().st_mtime_ns, where
    if key not in known:
        while len(known) >= KEPT:
            del known[next(iter(known))]
        known[key] = reference_for(case, curves).channels
    return known[key]
