"""A mechanism whose drives are held until Chipmunk comes to rest: poses, efforts and rates.

With all velocity taken out in every step, a step of Chipmunk is one Newton step of the holds in
the metric of the masses, so a linkage without free coordinates rests after a few of them.  Free
coordinates (springs, hanging bodies) sink to rest under critical damping.
"""

from dataclasses import dataclass

import numpy as np
import pymunk
from pymunk import batch

from sim.protocol import Array, Diverged
from sim.pymunk_close import close
from sim.pymunk_drive import Motor, add_drives, aim
from sim.pymunk_links import Links
from sim.pymunk_patience import enough
from sim.pymunk_pose import along, gaps, jacobian, potential, values
from sim.pymunk_rest import free_directions, pace
from sim.pymunk_space import FIELDS, Settings, build, put, taken

FAR = 3.0
"""Longest way to begin ahead, in ways between the last two rests: noise must not be drawn out."""
STILL = 1e-12
"""Largest remaining move in a step, in extents, that counts as rest at a sample."""
ROUGH = 1e-6
"""The same between samples, where the pose only has to stay on its branch."""
DOUBT = 12
"""Steps after which it is asked whether the loops can be closed at all."""
MOST = {True: 20000, False: 200}
"""Steps after which a pose that still moves is given up, with and without free coordinates."""
LEFT = 1e-3
"""Share of an error that a more patient solver may leave in a step."""
PATIENT = 10**6
"""Iterations that it may have."""
ROUNDING = 1e-16
"""What an iteration adds to the move in a step, in extents."""


@dataclass
class Held:
    """A space whose drives are held: the state of a sweep between its samples.

    ``usual`` and ``most`` are iterations of the solver in a step: at first, and used so far;
    ``keep`` is the share of velocity that free coordinates keep; ``past`` are the drives' values
    and the pose of the rest before this one.
    """

    links: Links
    space: pymunk.Space
    drives: list[Motor]
    dt: float
    free: bool
    pose: Array
    velocity: Array
    usual: int
    most: int = 0
    keep: float = 0.0
    past: tuple[Array, Array] | None = None

    def step(self, target: Array) -> None:
        """One engine step with the drives aimed at their values; keeps the state it leaves.

        The bodies move on with their velocity and `keep` a share of it.  Chipmunk's own damping
        would not do: it acts after the springs' impulses and weakens them.
        """
        aim(self.drives, target.tolist())
        kept = self.keep * self.velocity
        put(self.space, self.pose + self.dt * (self.velocity - kept), kept)
        self.space.step(self.dt)
        buffer = batch.Buffer()
        batch.get_space_bodies(self.space, FIELDS, buffer)
        (self.pose,), (self.velocity,) = taken(buffer, self.links)

    def stop(self) -> None:
        """Take all velocity out without moving."""
        self.velocity = np.zeros_like(self.velocity)

    def settle(self, target: Array, still: float = STILL) -> None:
        """Step until nothing moves and the drives have their values.

        Raises
        ------
        BadModel
            The loops cannot be closed there.
        Diverged
            They can, but Chipmunk does not come to rest.
        """
        rest = values(self.links.drives, self.pose), self.pose
        self.ahead(target)
        calm, began = 0, self.pose
        self.space.iterations = self.usual
        for count in range(MOST[self.free]):
            if self.free and count % 200 == 0:
                self.dt, self.keep = pace(self.links, self.pose)
            if count == DOUBT:
                self._doubt(began, target)
            self.step(target)
            moved = np.abs(self.velocity).max() * self.dt / self.links.extent
            if not np.isfinite(moved):
                break
            calm = calm + 1 if moved < max(still, ROUNDING * self.space.iterations) else 0
            if calm > 2:
                self.most, self.past = max(self.most, self.space.iterations), rest
                return
        close(self.links, began, target)
        gap = gaps(self.links, self.pose).max()
        raise Diverged(f"drives at {np.round(target, 4).tolist()}: not at rest after {count + 1} "
                       f"steps, loops open by {gap:.3g} m")

    def ahead(self, target: Array) -> None:
        """Begin where the last two rests point to, if the drives go on in the same direction.

        Nearer to the next rest, and on the smooth branch where two of them cross.
        """
        if self.past is None or self.free:
            return
        here = values(self.links.drives, self.pose)
        before, way = here - self.past[0], target - here
        share = float(way @ before) / float(before @ before or 1.0)
        straight = np.abs(way - share * before).max() <= 1e-3 * np.abs(way).max()
        if straight and 0 < share <= FAR:
            self.pose = self.pose + share * (self.pose - self.past[1])

    def _doubt(self, began: Array, target: Array) -> None:
        """Ask whether the loops can be closed; if so, begin there, with a more patient solver."""
        there = close(self.links, began, target)
        if not self.free:
            needed = enough(self.links, there[None], LEFT)
            self.space.iterations = min(max(self.usual, needed), PATIENT)
            self.pose = there
            self.stop()

    def efforts(self) -> Array:
        """Moments [N m] or forces [N] of the drives on their joints, in a pose at rest.

        Chipmunk tells only the size of an impulse.  Its sign is found by letting one drive go for
        a step: the joint falls the way that the drive held it back from.
        """
        here = values(self.links.drives, self.pose)
        self.stop()
        self.step(here)
        size = np.array([drive.impulse for drive in self.drives]) / self.dt
        return -size * np.sign([self._fall(k, here)[k] for k in range(len(size))])

    def _fall(self, k: int, here: Array) -> Array:
        """Rates of the driven joints after a step without the k-th drive."""
        self.stop()
        self.step(here)
        self.stop()
        self.drives[k].max_force = 0.0
        self.step(here)
        self.drives[k].max_force = float("inf")
        falls = along(lambda p: values(self.links.drives, p), self.pose, self.velocity)
        self.stop()
        return falls

    def rates(self, rate: Array) -> Array:
        """The engine's velocities (links + 1, 3) for rates of the drives, in a pose at rest."""
        size = np.abs(rate).max()
        if size == 0:
            return np.zeros_like(self.pose)
        ahead = values(self.links.drives, self.pose) + self.dt * rate / size
        for _ in range(MOST[False]):
            last = self.velocity
            self.stop()
            self.step(ahead)
            if np.abs(self.velocity - last).max() < STILL * np.abs(self.velocity).max():
                break
        velocity = self.velocity
        self.stop()
        return size * velocity


def hold(links: Links, target: Array, settings: Settings) -> Held:
    """The space with its drives at their first values."""
    pose = close(links, links.pose, target)
    space = build(links, settings["iterations"], settings["error_bias"])
    free = free_directions(links, pose).shape[1] > 0
    return Held(links, space, add_drives(space, links), _calm(links, pose), free, pose,
                np.zeros_like(pose), settings["iterations"])


def _calm(links: Links, pose: Array) -> float:
    """The step [s] in which the loads' rounding and a gap of rounding size make equal noise."""
    force = jacobian(lambda p: potential(links, p), pose).reshape(-1, 3)
    pull = np.abs(force / np.column_stack([links.mass, links.mass, links.moment / links.extent]))
    return float(np.sqrt(links.extent / pull.max())) if pull.any() else 1.0
