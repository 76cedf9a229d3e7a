"""A model without a sidecar in a version of an engine: its motion, and the error of its step."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from proofmass.run.fingerprint import digest, package_versions
from proofmass.sim.engines import engine_of
from proofmass.sim.model_files import files_of_model
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Run
from proofmass.studies.cells import CellResult, ChannelError, ResultAndCurves, measure_isolated
from proofmass.studies.store import digest_of_sources

UNTIL, SAMPLES = 1.0, 101
"""Length of the motion [s], and the number of times at which it is compared."""
BARE_TIMEOUT, BARE_MEMORY = 300.0, 8.0
"""Limits of a motion with its step and with half of it: processor time [s], and memory [GiB]."""
STEP_CHANNEL = "centres of all bodies"
"""Name of the only channel of a model without a sidecar."""


@dataclass(frozen=True)
class BareCell:
    """The motion of a model without a sidecar, from its key ``start``, by a solver.

    Its error is the distance from the same motion with half the step, and its curves are the
    centres of mass of its bodies.

    Attributes
    ----------
    model : Path
        The MJCF file.
    name : str
    solver : str
        An engine with a version.
    """

    model: Path
    name: str
    solver: str

    @property
    def key(self) -> str:
        """Digest of all that the result depends on."""
        files = [self.model, *files_of_model(self.model)]
        parts = {
            "model": [digest(file.read_bytes()) for file in files],
            "motion": (UNTIL, SAMPLES),
            "versions": package_versions(self.solver),
            "sources": digest_of_sources(),
        }
        return digest(json.dumps(parts, sort_keys=True).encode())

    def measure(self) -> ResultAndCurves:
        """Step in a worker, once more with half the step; the result, and the curves [m]."""
        empty = CellResult(self.name, "passive", self.solver)
        return measure_isolated(measure_bare, self, empty, timeout=BARE_TIMEOUT, memory=BARE_MEMORY)


def measure_bare(cell: BareCell, empty: CellResult) -> ResultAndCurves:
    """Do what `BareCell.measure` does, in this process."""
    run = Run("passive", np.linspace(0.0, UNTIL, SAMPLES), ())
    whole = follow(cell, run)
    finer = follow(cell, replace(run, settings={"timestep": 0.5 * whole.made_step}))
    gap = max(
        (
            float(np.abs(whole.channels[name] - finer.channels[name]).max())
            for name in whole.channels
        ),
        default=0.0,
    )
    size = max((float(np.ptp(curve)) for curve in whole.channels.values()), default=0.0)
    error = ChannelError(STEP_CHANNEL, "m", "position", gap, gap / size if size else 0.0, size)
    found = replace(
        empty,
        errors=(error,),
        seconds=whole.seconds,
        step=whole.made_step,
        settings=dict(whole.settings),
        versions=whole.versions,
    )
    return found, {"x": whole.x, **whole.channels}


def follow(cell: BareCell, run: Run) -> Curves:
    """The curves of a passive run.

    Raises
    ------
    Diverged
        The motion is lost.
    """
    curves = engine_of(cell.solver).simulate(cell.model, run)
    if not all(np.isfinite(curve).all() for curve in curves.channels.values()):
        raise Diverged("a position is not finite")
    return curves
