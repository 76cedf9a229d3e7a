"""Drive laws: joint value, rate and acceleration as functions of the run's x.

They are small classes, not closures, so that a run can be sent to another process.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from sim.protocol import Array, Curves, Diverged, Run

State = tuple[Array, Array, Array]
LAG = 0.05
"""Share of its way that a driven joint may be off: a soft drive lags, MuJoCo's default one by 2e-3.
"""


@dataclass(frozen=True)
class Steady:
    """Constant speed; x is the drive value itself (a sweep) or time (a duration)."""

    start: float
    rate: float
    x_is_time: bool

    def __call__(self, x: Array) -> State:
        value = self.start + self.rate * x if self.x_is_time else np.asarray(x, float)
        return value, np.full(x.shape, self.rate), np.zeros(x.shape)


@dataclass(frozen=True)
class Swing:
    """To and fro between two values, at rest at both: a cosine of time."""

    start: float
    to: float
    period: float

    def __call__(self, x: Array) -> State:
        half, w = 0.5 * (self.to - self.start), 2 * np.pi / self.period
        cosine = np.cos(w * x)
        return (self.start + half * (1 - cosine), half * w * np.sin(w * x), half * w**2 * cosine)


@dataclass(frozen=True)
class InProportion:
    """A drive that keeps its share of another's way: start + ratio (value - origin)."""

    leader: Callable[[Array], State]
    origin: float
    ratio: float
    start: float

    def __call__(self, x: Array) -> State:
        value, rate, acceleration = self.leader(x)
        return (self.start + self.ratio * (value - self.origin), self.ratio * rate,
                self.ratio * acceleration)


@dataclass(frozen=True)
class Law:
    """A function of time that a reference module brings along, such as a motor profile.

    A law of several drives gives arrays (drives, n), of which this is one `row`.
    """

    function: Callable[..., State]
    parameters: dict[str, float] = field(default_factory=dict)
    row: int | None = None

    def __call__(self, x: Array) -> State:
        value, rate, acceleration = self.function(x, **self.parameters)
        if self.row is None:
            return value, rate, acceleration
        return value[self.row], rate[self.row], acceleration[self.row]


@dataclass(frozen=True)
class Samples:
    """A recorded drive: exact at its samples.

    Between them a cubic through value and rate, and a straight line through the accelerations.
    """

    x: Array
    value: Array
    rate: Array
    acceleration: Array

    def __call__(self, x: Array) -> State:
        if np.array_equal(x, self.x):
            return self.value, self.rate, self.acceleration
        spline = CubicHermiteSpline(self.x, self.value, self.rate)
        return spline(x), spline(x, 1), np.interp(x, self.x, self.acceleration)


def check_driven(run: Run, curves: Curves) -> None:
    """Refuse curves of an engine that did not move the driven joints.

    Curves are compared at the state that the drives really had, in which a mechanism that stands
    still would agree.

    Raises
    ------
    Diverged
        A driven joint is off its law by more than `LAG` of the longest way of all drives.
    """
    if curves.drive is None:
        return
    led = run.motion(curves.x)[0]
    off = np.abs(curves.drive[0] - led)
    way = float(np.ptp(led, axis=1).max(initial=0.0)) or 1.0  # all of them are held: rad or m
    if not (off <= LAG * way).all():
        drive, sample = np.unravel_index(np.argmax(np.nan_to_num(off, nan=np.inf)), off.shape)
        raise Diverged(f"joint {run.drives[drive].joint!r} is at "
                       f"{curves.drive[0][drive, sample]:.4g} where its drive leads it to "
                       f"{led[drive, sample]:.4g}, at x = {curves.x[sample]:.4g}")
