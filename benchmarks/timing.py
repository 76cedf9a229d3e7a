"""Timing several pieces of work against each other on a machine that others use as well.

The rounds are interleaved and the least of each is kept, since whatever disturbs a measurement
makes it longer; the time of the process stands beside that on the wall, which counts waiting too.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

SPELL = 0.2  # s, for which a row is timed in each round


@dataclass
class Row:
    """A way of solving a mechanism.

    Attributes
    ----------
    mechanism, method : str
    gives : str
        What it finds: p position, v velocity, a acceleration, h holding moments.
    poses : int
        Solved by one call of `work`.
    wall, own : float
        Shortest time of a call so far, on the wall and of this process alone [s].
    """

    mechanism: str
    method: str
    gives: str
    poses: int
    work: Callable[[], object]
    wall: float = float("inf")
    own: float = float("inf")

    def run(self, spell: float) -> None:
        """Time calls until a spell [s] is over, one at least."""
        end = time.perf_counter() + spell
        while True:
            wall, own = time.perf_counter(), time.process_time()
            self.work()
            self.own = min(self.own, time.process_time() - own)
            self.wall = min(self.wall, time.perf_counter() - wall)
            if time.perf_counter() >= end:
                return

    @property
    def speed(self) -> float:
        """Poses a second of process time."""
        return self.poses / self.own


def measure(rows: Iterable[Row], rounds: int, spell: float = SPELL) -> None:
    """Run every row once to warm up (compilers, caches), then `rounds` times in turn."""
    rows = list(rows)
    for row in rows:
        row.work()
    for _ in range(rounds):
        for row in rows:
            row.run(spell)
