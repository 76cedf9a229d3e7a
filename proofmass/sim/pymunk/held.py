"""A mechanism whose drives are held until Chipmunk comes to rest: poses, efforts and rates.

Every pose is at rest by the engine's own answer: a step from standstill gives it no velocity.
With all velocity taken out in every step, a step of Chipmunk is one Newton step of the holds in
the metric of the masses, so a linkage without free coordinates rests after a few of them.  Free
coordinates (springs, hanging bodies) get a velocity down the slope of the engine's energy;
`proofmass.sim.pymunk.rest.toward_rest` chooses how far they go along it, and so they fall into the
next valley where theirs ends.  They begin beside the start pose: an engine that does nothing stays
there, and is not at rest in the right pose by having been put into it.
"""

from dataclasses import dataclass, field

import numpy as np
import pymunk
from pymunk import batch

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import BadModel, Diverged, NotSolved
from proofmass.sim.pymunk.close import close, missing, named
from proofmass.sim.pymunk.drive import Motor, add_drives, aim
from proofmass.sim.pymunk.links import Links
from proofmass.sim.pymunk.modes import free_directions, sizes
from proofmass.sim.pymunk.patience import enough
from proofmass.sim.pymunk.pose import along, bound, gaps, jacobian, potential, values
from proofmass.sim.pymunk.rest import toward_rest
from proofmass.sim.pymunk.space import FIELDS, Settings, build, put, taken
from proofmass.sim.pymunk.stops import Stops, beyond, ease, find_stops

FAR = 3.0
"""Longest way to begin ahead, in ways between the last two rests: noise must not be drawn out."""
STILL = 1e-12
"""Largest remaining move in a step, in extents or radians, that counts as rest at a sample."""
ROUGH = 1e-6
"""The same between samples, where the pose only has to stay on its branch."""
DOUBT = 12
"""Steps after which it is asked whether the loops can be closed at all."""
BESIDE = 1e-3
"""How far beside the start pose free coordinates begin, in extents or radians."""
MOST = {True: 1000, False: 200}
"""Steps after which a pose that still moves is given up, with and without free coordinates."""
LEFT = 1e-3
"""Share of an error that a more patient solver may leave in a step."""
PATIENT = 10**6
"""Iterations that it may have, in a step and its repetitions."""
ROUNDING = 1e-16
"""What an iteration adds to the move in a step, in extents or radians."""
AGREED = 1e-6
"""Share by which a step may differ from its repetition: stops and steps of all lengths ask more of
the solver than it does at once."""


@dataclass
class Held:
    """A space whose drives are held: the state of a sweep between its samples.

    ``velocity`` is what the last step of ``dt`` [s] gave to the pose, which stood still; ``usual``
    and ``most`` are iterations of the solver in a step: at first, and used so far; ``past`` are the
    drives' values and the pose of the rest before this one.
    """

    links: Links
    space: pymunk.Space
    drives: list[Motor]
    stops: Stops
    dt: float
    free: bool
    pose: Array
    usual: int
    velocity: Array = field(default_factory=lambda: np.zeros(1))
    most: int = 0
    past: tuple[Array, Array] | None = None

    @property
    def rounding(self) -> float:
        """What the solver's iterations add to the move in a step, in extents or radians."""
        return ROUNDING * self.space.iterations

    def step(self, target: Array) -> None:
        """One engine step from rest with the drives aimed at their values: finds the velocity.

        With free coordinates it is repeated until the solver, which goes on from its last impulses,
        agrees with itself: a step that is not solved throws joints off the stops that hold them,
        and the next solution has to begin without the stops' impulses.

        Raises
        ------
        NotSolved
            It does not agree.
        """
        aim(self.drives, target.tolist())
        ease(self.stops, self.pose, self.dt)
        if not self.free:
            self._solve()
            return
        noise = self.rounding / self.dt
        change = np.nan
        for _ in range(0, PATIENT, self.space.iterations):
            last, before = self.velocity, change
            self._solve()
            change = float(sizes(self.links, self.velocity - last))
            error = AGREED * sizes(self.links, self.velocity) + noise
            # changes in a geometric row add up to change before / (before - change); at last they
            # do not fall any more, and are rounding
            small = change * before <= error * (before - change) or before <= change <= error
            if small:
                return
        raise NotSolved(f"drives at {np.round(target, 4).tolist()}: a step is not solved after "
                        f"{PATIENT} iterations")

    def _solve(self) -> None:
        """Let the engine step: the velocity as far as its iterations find it."""
        put(self.space, self.pose, np.zeros_like(self.pose))
        self.space.step(self.dt)
        buffer = batch.Buffer()
        batch.get_space_bodies(self.space, FIELDS, buffer)
        _, (self.velocity,) = taken(buffer, self.links)

    def settle(self, target: Array, still: float = STILL) -> None:
        """Step until nothing moves and the drives have their values.

        Raises
        ------
        BadModel
            The loops cannot be closed there, or stops are in the way.
        Diverged
            They can, but Chipmunk does not close them.
        NotSolved
            It does not come to rest in the steps that there are.
        """
        last = values(self.links.drives, self.pose), self.pose
        self.ahead(target)
        calm, began = 0, self.pose
        self.space.iterations = self.usual
        for count in range(MOST[self.free]):
            if count == DOUBT:
                self._doubt(began, target)
            self.step(target)
            if not np.isfinite(self.velocity).all():
                break
            on, move = beyond(self.stops, self.pose), self.dt * self.velocity
            if self.free:
                move = toward_rest(self.links, self.pose, self.velocity, self.dt)
            self.pose = self.pose + move
            moved = sizes(self.links, move)
            # a step to a stop is as short as the way there, and small whatever the forces are
            steady = moved < max(still, self.rounding) and beyond(self.stops, self.pose) == on
            calm = calm + 1 if steady else 0
            if calm > 2:
                if self._missed(target):
                    raise self._lost(target, "at rest")
                self.most, self.past = max(self.most, self.space.iterations), last
                return
        close(self.links, began, target)
        kind = NotSolved if np.isfinite(self.velocity).all() else Diverged
        raise self._lost(target, f"not at rest after {count + 1} steps", kind)

    def ahead(self, target: Array) -> None:
        """Begin where the last two rests point to, if the drives go on in the same direction.

        Nearer to the next rest, and on the smooth branch where two of them cross; unless less is
        held there than here, as after a snap to another equilibrium.
        """
        if self.past is None:
            return
        here = values(self.links.drives, self.pose)
        before, way = here - self.past[0], target - here
        share = float(way @ before) / float(before @ before or 1.0)
        straight = np.abs(way - share * before).max() <= 1e-3 * np.abs(way).max()
        there = self.pose + share * (self.pose - self.past[1])
        poses = np.stack([there, self.pose])
        amiss = np.abs(missing(self.links, poses, target) / self.links.bounds).max(axis=-1)
        if straight and 0 < share <= FAR and amiss[0] < amiss[1]:
            self.pose = there

    def _doubt(self, began: Array, target: Array) -> None:
        """Ask whether the loops can be closed; if so, begin again with a more patient solver.

        Free coordinates go on from where they are, since each of their steps is solved.
        """
        there = close(self.links, began, target)
        if not self.free:
            needed = enough(self.links, there[None], LEFT)
            self.space.iterations = min(max(self.usual, needed), PATIENT)
            self.pose = began

    def _missed(self, target: Array) -> bool:
        """Whether a loop is open or a drive not at its value by more than `ROUGH`."""
        off = missing(self.links, self.pose, target) / self.links.bounds
        return bool(np.abs(off).max(initial=0.0) > ROUGH)

    def _lost(self, target: Array, how: str, kind: type[Diverged] = Diverged) -> Exception:
        """The error of a pose that is not what it should be: stops are in the way, or nothing."""
        names = [f"'{joint.name}'" for joint in beyond(self.stops, self.pose)]
        if names and self._missed(target):
            return BadModel(f"joint {', '.join(names)} is on its stop before "
                            f"{named(self.links, target)}")
        here = named(self.links, values(self.links.drives, self.pose))
        return kind(f"drives at {np.round(target, 4).tolist()}: {how}, loops open by "
                    f"{gaps(self.links, self.pose).max():.3g} m"
                    + (f", {here}" if here else ""))

    def efforts(self) -> Array:
        """Moments [N m] or forces [N] of the drives on their joints, in a pose at rest.

        Chipmunk tells only the size of an impulse.  Its sign is found by letting one drive go for
        a step: the joint falls the way that the drive held it back from.
        """
        here = values(self.links.drives, self.pose)
        self.step(here)
        size = np.array([drive.impulse for drive in self.drives]) / self.dt
        return -size * np.sign([self._fall(k, here)[k] for k in range(len(size))])

    def _fall(self, k: int, here: Array) -> Array:
        """Rates of the driven joints after a step without the k-th drive."""
        self.step(here)
        self.drives[k].max_force = 0.0
        self.step(here)
        self.drives[k].max_force = float("inf")
        return along(lambda p: values(self.links.drives, p), self.pose, self.velocity)

    def rates(self, rate: Array) -> Array:
        """The engine's velocities (links + 1, 3) for rates of the drives, in a pose at rest."""
        size = np.abs(rate).max()
        if size == 0:
            return np.zeros_like(self.pose)
        ahead = values(self.links.drives, self.pose) + self.dt * rate / size
        for _ in range(MOST[False]):
            last = self.velocity
            self.step(ahead)
            if sizes(self.links, self.velocity - last) < STILL * sizes(self.links, self.velocity):
                break
        return size * self.velocity


def hold(links: Links, settings: Settings) -> Held:
    """The space in its start pose; with free coordinates beside it, see `BESIDE`.

    Raises
    ------
    BadModel
        The loops cannot be closed there.
    """
    space = build(links, settings["iterations"], settings["error_bias"])
    pose = close(links, links.pose, values(links.drives, links.pose))
    moves = free_directions(links, jacobian(lambda p: bound(links, p), pose))
    return Held(links, space, add_drives(space, links), find_stops(links, space),
                _step(links, pose), len(moves) > 0, links.pose + _beside(links, moves),
                settings["iterations"])


def _beside(links: Links, moves: Array) -> Array:
    """A move in all free directions (n, links + 1, 3), whatever basis they are given in."""
    shares = np.pad(np.cos(np.arange(links.sizes.size)) * links.sizes, (0, 3))
    way = np.tensordot(np.tensordot(moves, links.weights * shares.reshape(-1, 3), 2), moves, 1)
    return np.asarray(BESIDE * way / (sizes(links, way) or 1.0))


def _step(links: Links, pose: Array) -> float:
    """The step [s] in which the loads' rounding and a gap of rounding size make equal noise.

    Springs count as if wound by a radian or an extent: they may be slack where the sweep begins.
    """
    wound = [abs(joint.stiffness[0]) * (links.extent if joint.hold.axis is not None else 1.0)
             for joint in links.joints]
    force = (np.abs(jacobian(lambda p: values(links.joints, p), pose)).T @ wound
             + np.abs(jacobian(lambda p: potential(links, p), pose))).reshape(-1, 3)
    pull = force / np.column_stack([links.mass, links.mass, links.moment / links.extent])
    return float(np.sqrt(links.extent / pull.max())) if pull.any() else 1.0
