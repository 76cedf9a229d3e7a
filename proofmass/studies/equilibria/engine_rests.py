"""In which equilibrium an engine comes to rest when its chains start from the shape of one.

The rests are told apart by the equilibria of chains of as many links, which `assembly_chain` finds
without an engine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods.assembly_chain import chain_shapes
from proofmass.analytic.rods.assembly_search import Advance
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve
from proofmass.sim.engines import computes_curves, engine_of
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged, Unsupported
from proofmass.studies.equilibria.written_case import ChainsInCase

SAME_REST = 1e-4
"""Largest difference of an engine's chain at rest and of the same chain without an engine, in
angles [rad] and places over the mean length.  MuJoCo and pymunk leave 1e-12; engines that only
step in time leave more."""
STAYS, ELSEWHERE, NOT_RUN = "stays", "another", "not run"


@dataclass(frozen=True)
class EngineRest:
    """Where the chain of an engine came to rest.

    Attributes
    ----------
    words : str
        ``stays``, ``to 3``, ``another`` or ``not run: ...``.
    number : int or None
        Number of the equilibrium, from 1; None if it is none of them.
    distance : float
        Distance from the equilibrium of chains [1], see `SAME_REST`; NaN without one.
    """

    words: str
    number: int | None = None
    distance: float = np.nan

    @property
    def is_run(self) -> bool:
        """Whether the engine came to rest."""
        return not self.words.startswith(NOT_RUN)


class RestFinder:
    """Equilibria with their chains, and the runs of engines from their shapes."""

    def __init__(self, chains: ChainsInCase):
        self.chains = chains

    @cached_property
    def arc(self) -> Array:
        """Arc lengths at which the runs of written cases have the shapes of rods [m]."""
        length = float(self.chains.assembly.length.min())
        return np.linspace(0.0, length, self.chains.links + 1)

    @cached_property
    def shapes(self) -> dict[str, Array]:
        """Curves (arc lengths, n) of the chains without an engine, by channel."""
        problem, found = self.chains.found.problem, dict[str, Array]()
        for i, name in enumerate(self.chains.names):
            rods = chain_shapes(problem, self.chains.chains, i, self.chains.links).at(self.arc)
            found |= {f"{name}.{part}": rods[key] for part, key in (("x", "x"), ("y", "y"))}
            found[f"{name}.angle"] = rods["t"]
        return found

    def distances(self, curves: Curves) -> Array:
        """Distances (n,) of an engine's rest from the equilibria of chains; inf without one."""
        length = self.chains.assembly.length.mean()
        worst = np.zeros(len(self.chains.found))
        for name, known in self.shapes.items():
            apart = curves.channels[name][:, None] - known
            if name.endswith(".angle"):
                apart = apart - TURN * np.round(apart[0] / TURN)
            else:
                apart = apart / length
            worst = np.maximum(worst, np.abs(apart).max(axis=0))
        return np.nan_to_num(worst, nan=np.inf)

    def rest(self, n: int, engine: str, folder: Path) -> EngineRest:
        """Where an engine comes to rest from the shape of equilibrium n."""
        for ending, text in self.chains.start_text(n, engine).items():
            write_atomically(folder / f"start.{ending}", text)
        try:
            curves = solve(load_case(folder / "start.toml"), "equilibrium", engine)
        except (Unsupported, Diverged, Crashed, TimedOut, OutOfMemory) as error:
            return EngineRest(f"{NOT_RUN}: {error}")
        except InputError as error:
            return EngineRest(f"{NOT_RUN}: {error.wrong}")
        if curves.missing.keys() & self.shapes.keys():
            missing = next(name for name in self.shapes if name in curves.missing)
            return EngineRest(f"{NOT_RUN}: no {missing}: {curves.missing[missing]}")
        apart = self.distances(curves)
        to = int(apart.argmin())
        if apart[to] > SAME_REST:
            return EngineRest(ELSEWHERE, None, float(apart[to]))
        return EngineRest(STAYS if to == n else f"to {to + 1}", to + 1, float(apart[to]))


def find_engine_rests(
    chains: ChainsInCase, engines: Sequence[str], advance: Advance | None = None
) -> dict[str, list[EngineRest]]:
    """Where engines come to rest from the shape of each equilibrium, by engine.

    Raises
    ------
    InputError
        An engine does not compute its curves from a model.
    """
    for engine in engines:
        if not computes_curves(engine):
            raise InputError(
                chains.own.file, "", f"{engine_of(engine).title} does not run models; leave it out"
            )
    finder, total = RestFinder(chains), len(engines) * len(chains.found)
    rests: dict[str, list[EngineRest]] = {engine: [] for engine in engines}
    with TemporaryDirectory() as folder:
        for k, engine in enumerate(engines):
            for n in range(len(chains.found)):
                if advance:
                    advance(f"{engine} from equilibrium {n + 1}", k * len(chains.found) + n, total)
                rests[engine].append(finder.rest(n, engine, Path(folder)))
    if advance:
        advance("engines", total, total)
    return rests
