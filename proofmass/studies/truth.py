"""The reference of many runs of a case, computed once where the same is asked for again.

That of a free motion is kept in a file as well: its integration takes longer than most runs, and
must not count as time of the one that happens to be first.
"""

import io
from pathlib import Path

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.case import Case
from proofmass.compare import reference_for
from proofmass.files import write_whole
from proofmass.reference import grid
from proofmass.sim.protocol import Curves
from proofmass.strict import Kind

KEPT = 8  # references; the motions of driven runs differ, and nobody asks for them again
known: dict[tuple[str, int, bytes], dict[str, Array]] = {}


def truth(case: Case, curves: Curves) -> dict[str, Array]:
    """`reference_for`, channel by channel; free motions and exact sweeps have it in common.

    The integration of a free linkage takes longer than most runs that are held against it.
    """
    if (key := key_of(case, curves)) not in known:
        keep(key, reference_for(case, curves).channels)
    return known[key]


def key_of(case: Case, curves: Curves) -> tuple[str, int, bytes]:
    """What a reference depends on."""
    asked = case.model_copy(update={"settings": {}}).model_dump_json()
    where = b"".join(part.tobytes() for part in (curves.x, *(curves.drive or ())))
    return asked, case.model_path.stat().st_mtime_ns, where


def keep(key: tuple[str, int, bytes], channels: dict[str, Array]) -> None:
    """Remember a reference in this process, and forget the oldest one."""
    while len(known) >= KEPT:
        del known[next(iter(known))]
    known[key] = channels


def write_truth(case: Case, kind: Kind, file: Path) -> None:
    """Write the reference of a free motion into a file, for `read_truth` in other processes."""
    packed = io.BytesIO()
    np.savez(packed, **truth(case, Curves(grid(case, kind), {})))  # type: ignore[arg-type]
    write_whole(file, packed.getvalue())


def read_truth(case: Case, kind: Kind, file: Path) -> None:
    """Remember the reference that `write_truth` wrote, if it did; the case is the same."""
    key = key_of(case, Curves(grid(case, kind), {}))
    if key not in known and file.is_file():
        with np.load(file) as arrays:
            keep(key, dict(arrays))
