"""A mechanism whose drives are held until Chipmunk comes to rest: poses, efforts and rates.

With all velocity taken out in every step, a step of Chipmunk is one Newton step of the holds in
the metric of the masses, so a linkage without free coordinates rests after a few of them.  Free
coordinates (springs, hanging bodies) go down the slope of the energy, by the step's square over
their mass: `sim.pymunk_rest.stride` chooses steps after which they rest as soon.  They begin where
`sim.pymunk_rest.rest` finds the energy lowest, and so fall into the next valley where theirs ends.
"""

from dataclasses import dataclass, field

import numpy as np
import pymunk
from pymunk import batch

from sim.protocol import Array, BadModel, Diverged
from sim.pymunk_close import close, named
from sim.pymunk_drive import Motor, add_drives, aim
from sim.pymunk_links import Links
from sim.pymunk_modes import free_directions, sizes
from sim.pymunk_patience import enough
from sim.pymunk_pose import along, bound, gaps, jacobian, potential, values
from sim.pymunk_rest import rest, stride
from sim.pymunk_space import FIELDS, Settings, build, put, taken
from sim.pymunk_stops import Stops, beyond, ease, find_stops

FAR = 3.0
"""Longest way to begin ahead, in ways between the last two rests: noise must not be drawn out."""
STILL = 1e-12
"""Largest remaining move in a step, in extents or radians, that counts as rest at a sample."""
ROUGH = 1e-6
"""The same between samples, where the pose only has to stay on its branch."""
DOUBT = 12
"""Steps after which it is asked whether the loops can be closed at all, and where it rests."""
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

    ``velocity`` is what the last step gave to the pose, which stood still; ``calm`` is the step [s]
    for a pose without free coordinates; ``usual`` and ``most`` are iterations of the solver in a
    step: at first, and used so far; ``past`` are the drives' values and the pose of the rest before
    this one.
    """

    links: Links
    space: pymunk.Space
    drives: list[Motor]
    stops: Stops
    calm: float
    free: bool
    pose: Array
    usual: int
    dt: float = 0.0
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
        Diverged
            It does not agree.
        """
        aim(self.drives, target.tolist())
        ease(self.stops, self.pose, self.dt)
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
            if small or not self.free:
                return
        raise Diverged(f"drives at {np.round(target, 4).tolist()}: a step is not solved after "
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
            They can, but Chipmunk does not come to rest.
        """
        last = values(self.links.drives, self.pose), self.pose
        self.ahead(target)
        if self.free:  # its steps from a pose far from rest may lead to another one, further off
            self._doubt(self.pose, target)
        calm, began = 0, self.pose
        self.space.iterations = self.usual
        for count in range(MOST[self.free]):
            if count % DOUBT == 0 < count and (self.free or count == DOUBT):
                self._doubt(began, target)
            self.dt = stride(self.links, self.pose, self.calm) if self.free else self.calm
            self.step(target)
            on = beyond(self.stops, self.pose)
            self.pose = self.pose + self.dt * self.velocity
            moved = sizes(self.links, self.velocity) * self.dt
            if not np.isfinite(moved):
                break
            # a step to a stop is as short as the way there, and small whatever the forces are
            steady = moved < max(still, self.rounding) and beyond(self.stops, self.pose) == on
            calm = calm + 1 if steady else 0
            if calm > 2:
                self._free_of_stops(target)
                self.most, self.past = max(self.most, self.space.iterations), last
                return
        close(self.links, began, target)
        self._free_of_stops(target)
        gap = gaps(self.links, self.pose).max()
        raise Diverged(f"drives at {np.round(target, 4).tolist()}: not at rest after {count + 1} "
                       f"steps, loops open by {gap:.3g} m")

    def ahead(self, target: Array) -> None:
        """Begin where the last two rests point to, if the drives go on in the same direction.

        Nearer to the next rest, and on the smooth branch where two of them cross.
        """
        if self.past is None:
            return
        here = values(self.links.drives, self.pose)
        before, way = here - self.past[0], target - here
        share = float(way @ before) / float(before @ before or 1.0)
        straight = np.abs(way - share * before).max() <= 1e-3 * np.abs(way).max()
        if straight and 0 < share <= FAR:
            self.pose = self.pose + share * (self.pose - self.past[1])

    def _doubt(self, began: Array, target: Array) -> None:
        """Ask whether the loops can be closed; if so, begin there, with a more patient solver.

        Free coordinates begin where they are at rest by the energy.
        """
        if self.free:
            there = close(self.links, self.pose, target)
            self.pose = rest(self.links, there, target, self.calm)
        else:
            self.pose = close(self.links, began, target)
            needed = enough(self.links, self.pose[None], LEFT)
            self.space.iterations = min(max(self.usual, needed), PATIENT)

    def _free_of_stops(self, target: Array) -> None:
        """Raise `BadModel` if joints on their stops keep loops open or drives from their values."""
        off = max(gaps(self.links, self.pose).max(),
                  np.abs(values(self.links.drives, self.pose) - target).max(initial=0.0))
        names = [f"'{joint.name}'" for joint in beyond(self.stops, self.pose)]
        if names and off > ROUGH * self.links.extent:
            raise BadModel(f"joint {', '.join(names)} is on its stop before "
                           f"{named(self.links, target)}")

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


def hold(links: Links, target: Array, settings: Settings) -> Held:
    """The space with its drives at their first values.

    With free coordinates it is still in the start pose: they are to follow the drives at rest.
    """
    space = build(links, settings["iterations"], settings["error_bias"])
    pose = close(links, links.pose, values(links.drives, links.pose))
    free = len(free_directions(links, jacobian(lambda p: bound(links, p), pose))) > 0
    pose = pose if free else close(links, links.pose, target)
    return Held(links, space, add_drives(space, links), find_stops(links, space),
                _calm(links, pose), free, pose, settings["iterations"])


def _calm(links: Links, pose: Array) -> float:
    """The step [s] in which the loads' rounding and a gap of rounding size make equal noise.

    Springs count as if wound by a radian or an extent: they may be slack where the sweep begins.
    """
    wound = [abs(joint.stiffness[0]) * (links.extent if joint.hold.axis is not None else 1.0)
             for joint in links.joints]
    force = (np.abs(jacobian(lambda p: values(links.joints, p), pose)).T @ wound
             + np.abs(jacobian(lambda p: potential(links, p), pose))).reshape(-1, 3)
    pull = force / np.column_stack([links.mass, links.mass, links.moment / links.extent])
    return float(np.sqrt(links.extent / pull.max())) if pull.any() else 1.0
