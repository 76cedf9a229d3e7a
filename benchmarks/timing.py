"""Times of several pieces of work, compared on a machine that others use as well.

The rounds are interleaved and the shortest time of each piece is kept, because every disturbance
makes a measurement longer.  The time of the process is measured in addition to the wall time, which
includes waiting.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

SPELL = 0.2  # time [s] for which a row is timed in each round


@dataclass
class Row:
    """A way of solving a mechanism.

    Attributes
    ----------
    mechanism, method : str
    gives : str
        Results: p position, v velocity, a acceleration, h holding moments.
    poses : int
        Number of poses that one call of `work` solves.
    wall, own : float
        Shortest wall time and process time of a call so far [s].
    """

    mechanism: str
    method: str
    gives: str
    poses: int
    work: Callable[[], object]
    wall: float = float("inf")
    own: float = float("inf")

    def run(self, spell: float) -> None:
        """Time calls for `spell` [s], at least one."""
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
        """Poses per second of process time."""
        return self.poses / self.own


def measure(rows: Iterable[Row], rounds: int, spell: float = SPELL) -> None:
    """Run every row once to warm up (compilers, caches), then `rounds` times in turn."""
    rows = list(rows)
    for row in rows:
        row.work()
    for _ in range(rounds):
        for row in rows:
            row.run(spell)
