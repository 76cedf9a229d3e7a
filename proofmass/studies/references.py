"""References of the runs of a study, at the motion that the drives really had.

Runs of a case whose drives move exactly as prescribed have the same reference, and so have all runs
of a free motion.  It is evaluated once and kept in a file of the store, since its evaluation may
take longer than a run.  References at other motions are used once and not kept.
"""

import io
from pathlib import Path

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.files import write_atomically
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.reference.evaluate import reference_for
from proofmass.reference.samples import run_samples
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Run


def has_one_reference(case: Case, kind: Kind) -> bool:
    """Whether all settings of a run have the same reference: a free motion without rods."""
    return kind == "dynamics" and not case.drive and not case.rod


def reference_at(case: Case, kind: Kind, curves: Curves, file: Path | None) -> dict[str, Array]:
    """Reference curves of a run, by channel, at the motion that its drives really had.

    Parameters
    ----------
    case, kind : Case, {"sweep", "dynamics", "equilibrium"}
        The case, and which of its runs.
    curves : Curves
        Curves of an engine, of which the samples and the motion of the drives are used.
    file : path, optional
        File that keeps this reference; it is written if it is not there.
    """
    if file and file.is_file():
        with np.load(file) as arrays:
            return dict(arrays)
    found = reference_for(case, kind, curves).channels
    if file:
        packed = io.BytesIO()
        np.savez(packed, **found)  # type: ignore[arg-type]  # digits do not compress
        write_atomically(file, packed.getvalue())
    return found


def moved_as_prescribed(run: Run, curves: Curves) -> bool:
    """Whether curves have all samples of a run, and its drives moved exactly as prescribed."""
    if not np.array_equal(curves.x, run.x) or (run.drives and curves.drive is None):
        return False
    return all(map(np.array_equal, curves.drive or (), run.motion(run.x) if run.drives else ()))


def write_reference(case: Case, kind: Kind, file: Path) -> None:
    """Write the reference of a free motion into its file."""
    reference_at(case, kind, Curves(run_samples(case, kind), {}), file)
