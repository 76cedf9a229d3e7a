"""Motion profiles: value, rate and acceleration of a driven joint as functions of the run's x.

Profiles are small classes instead of closures, so that a run can be sent to another process.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from proofmass.base.arrays import Array
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.protocol.run import Run

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

DriveState = tuple[Array, Array, Array]
ALLOWED_LAG = 0.05
"""Allowed error of a driven joint as a share of the drive's range: soft drives lag; MuJoCo's lags
by 2e-3 with default settings."""

TABLE_TOLERANCE, MAX_TABLE_ROWS = 1e-12, 4000
"""Allowed error of a table of a profile half way between its rows [share of the range], and its
largest number of rows."""


@dataclass(frozen=True)
class Steady:
    """Constant speed; x is the drive value itself (a sweep) or time (dynamics)."""

    start: float
    rate: float
    x_is_time: bool

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration of the joint at samples x of a run."""
        value = self.start + self.rate * x if self.x_is_time else np.asarray(x, float)
        return value, np.full(x.shape, self.rate), np.zeros(x.shape)


@dataclass(frozen=True)
class Swing:
    """Swing between two values, at rest at both: a cosine of time."""

    start: float
    to: float
    period: float

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration of the joint at samples x of a run."""
        half, w = 0.5 * (self.to - self.start), 2 * np.pi / self.period
        cosine = np.cos(w * x)
        return (self.start + half * (1 - cosine), half * w * np.sin(w * x), half * w**2 * cosine)


@dataclass(frozen=True)
class InProportion:
    """A drive in proportion to another drive: start + ratio (value - origin)."""

    leader: Callable[[Array], DriveState]
    origin: float
    ratio: float
    start: float

    @property
    def breaks(self) -> Array:
        """Times at which a derivative of the value jumps [s]."""
        return np.asarray(getattr(self.leader, "breaks", ()), float)

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration of the joint at samples x of a run."""
        value, rate, acceleration = self.leader(x)
        return (
            self.start + self.ratio * (value - self.origin),
            self.ratio * rate,
            self.ratio * acceleration,
        )


@dataclass(frozen=True)
class FunctionProfile:
    """A function of time from a reference module, such as a motor profile.

    A function for several drives returns arrays (drives, n), of which this drive has one `row`.
    """

    function: Callable[..., DriveState]
    parameters: dict[str, float] = field(default_factory=dict)
    row: int | None = None

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration of the joint at samples x of a run."""
        value, rate, acceleration = self.function(x, **self.parameters)
        if self.row is None:
            return value, rate, acceleration
        return value[self.row], rate[self.row], acceleration[self.row]


@dataclass(frozen=True)
class Samples:
    """A recorded motion: exact at its samples, polynomials of fifth degree between them."""

    x: Array
    value: Array
    rate: Array
    acceleration: Array

    def __call__(self, x: Array) -> DriveState:
        """Value, rate and acceleration of the joint at samples x of a run."""
        if np.array_equal(x, self.x):
            return self.value, self.rate, self.acceleration
        spline = quintic_spline(self.x, self.value, self.rate, self.acceleration)
        return spline(x), spline(x, 1), spline(x, 2)


def quintic_spline(x: Array, value: Array, rate: Array, acceleration: Array) -> "PPoly":
    """Polynomials of fifth degree through values, rates and accelerations (n,) at places x (n,).

    scipy's ``BPoly.from_derivatives`` makes the same polynomials, but in a Python loop.

    Examples
    --------
    >>> x = np.linspace(0.0, 2.0, 3)
    >>> round(float(quintic_spline(x, x**5, 5 * x**4, 20 * x**3)(1.5)), 12) == 1.5**5
    True
    """
    from scipy.interpolate import PPoly  # slow to load

    h = np.diff(x)
    p, v, a = value[:-1], h * rate[:-1], h**2 * acceleration[:-1]
    miss = value[1:] - (p + v + 0.5 * a)  # error of the parabola at the end of each piece
    turn = h * rate[1:] - (v + a)
    bend = h**2 * acceleration[1:] - a
    pieces = np.array(
        [
            6 * miss - 3 * turn + 0.5 * bend,
            -15 * miss + 7 * turn - bend,
            10 * miss - 4 * turn + 0.5 * bend,
            0.5 * a,
            v,
            p,
        ]
    )
    return PPoly(pieces / h ** np.arange(5, -1, -1)[:, None], x)


def check_driven(run: Run, curves: Curves) -> None:
    """Refuse curves of an engine that did not move the driven joints as prescribed.

    Curves are compared at the motion that the drives really had, so that a mechanism that does not
    move would agree with the reference.

    Raises
    ------
    Diverged
        A driven joint is off its profile by more than `ALLOWED_LAG` times the largest range of all
        drives.
    """
    if curves.drive is None:
        return
    led = run.motion(curves.x)[0]
    off = np.abs(curves.drive[0] - led)
    way = float(np.ptp(led, axis=1).max(initial=0.0)) or 1.0  # [rad or m] if no drive moves
    if not (off <= ALLOWED_LAG * way).all():
        drive, sample = np.unravel_index(np.argmax(np.nan_to_num(off, nan=np.inf)), off.shape)
        raise Diverged(
            f"joint {run.drives[drive].joint!r} is at "
            f"{curves.drive[0][drive, sample]:.4g} where its drive leads it to "
            f"{led[drive, sample]:.4g}, at x = {curves.x[sample]:.4g}",
            curves,
        )


def motion_source(profiles: Sequence[object], x: Array) -> str:
    """Write ``motion(t)``: values, rates and accelerations (drives, n) of drives at times (n,).

    The source uses NumPy as ``np``.  A profile that is not a formula is written as a table of
    values, rates and accelerations, with polynomials of fifth degree between its rows.

    Parameters
    ----------
    profiles : sequence of callable
        See `proofmass.sim.protocol.run.Drive`.
    x : ndarray (n,)
        Times of the samples [s].

    Examples
    --------
    >>> print(motion_source([Steady(0.5, 2.0, x_is_time=True)], np.linspace(0.0, 1.0, 3)))
    def motion(t):
        \"\"\"Values, rates and accelerations (drives, n) of the drives at times (n,) [s].\"\"\"
        one = np.ones_like(t)
        return (
            np.array([0.5 + 2.0 * t]),
            np.array([2.0 * one]),
            np.array([0.0 * one]))
    """
    if not profiles:
        return ""
    formulas = [profile_formula(profile) for profile in profiles]
    if all(formulas):
        parts = [", ".join(one[k] for one in formulas if one) for k in range(3)]
        return FORMULA_SOURCE.format(
            *parts, one=ONES_LINE if any("* one" in part for part in parts) else ""
        )
    times = table_times(profiles, x)
    rows = np.array([np.broadcast_arrays(*profile(times)) for profile in profiles])  # type: ignore[operator]
    return TABLE_SOURCE.format(
        times=format_numbers(times),
        rows=",\n".join(
            f"    [{', '.join(format_numbers(part) for part in drive)}]" for drive in rows
        ),
    )


ONES_LINE = "    one = np.ones_like(t)\n"
FORMULA_SOURCE = '''\
def motion(t):
    """Values, rates and accelerations (drives, n) of the drives at times (n,) [s]."""
{one}    return (
        np.array([{}]),
        np.array([{}]),
        np.array([{}]))'''
TABLE_SOURCE = '''\
TIMES = np.array({times})  # s
TABLE = np.array([  # of each drive values, rates and accelerations at these times
{rows}])


def motion(t):
    """Values, rates and accelerations (drives, n) of the drives at times (n,) [s].

    They follow the polynomial of fifth degree through two rows of the table.
    """
    k = np.clip(np.searchsorted(TIMES, t, "right") - 1, 0, len(TIMES) - 2)
    h = TIMES[k + 1] - TIMES[k]
    s = (t - TIMES[k]) / h
    p, v, a = np.moveaxis(TABLE[:, :, k], 1, 0) * [[h**0], [h], [h**2]]
    q, w, b = np.moveaxis(TABLE[:, :, k + 1], 1, 0) * [[h**0], [h], [h**2]]
    c3 = 10 * (q - p) - 6 * v - 4 * w - 1.5 * a + 0.5 * b
    c4 = -15 * (q - p) + 8 * v + 7 * w + 1.5 * a - b
    c5 = 6 * (q - p) - 3 * v - 3 * w - 0.5 * a + 0.5 * b
    return (
        p + s * (v + s * (0.5 * a + s * (c3 + s * (c4 + s * c5)))),
        (v + s * (a + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h,
        (a + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / h**2)'''


def profile_formula(profile: object) -> tuple[str, str, str] | None:
    """A profile as Python expressions of t: value, rate, acceleration; None if it is no formula."""
    if isinstance(profile, Steady) and profile.x_is_time:
        return f"{profile.start!r} + {profile.rate!r} * t", f"{profile.rate!r} * one", "0.0 * one"
    if isinstance(profile, Swing):
        half, w = 0.5 * (profile.to - profile.start), 2 * math.pi / profile.period
        return (
            f"{profile.start!r} + {half!r} * (1 - np.cos({w!r} * t))",
            f"{half * w!r} * np.sin({w!r} * t)",
            f"{half * w**2!r} * np.cos({w!r} * t)",
        )
    if isinstance(profile, InProportion) and (leader := profile_formula(profile.leader)):
        value, rate, acceleration = leader
        return (
            f"{profile.start!r} + {profile.ratio!r} * ({value} - {profile.origin!r})",
            f"{profile.ratio!r} * ({rate})",
            f"{profile.ratio!r} * ({acceleration})",
        )
    return None


def table_times(profiles: Sequence[object], x: Array) -> Array:
    """Times of a table of profiles.

    They are so dense that half way between two of them no profile is off by more than
    `TABLE_TOLERANCE` of its range, unless this takes more than `MAX_TABLE_ROWS` rows.
    """
    times = x
    while times.size < MAX_TABLE_ROWS:
        middle = 0.5 * (times[:-1] + times[1:])
        off = 0.0
        for profile in profiles:
            value, rate, acceleration = np.broadcast_arrays(*profile(times))  # type: ignore[operator]
            spline = quintic_spline(times, value, rate, acceleration)
            exact = np.broadcast_to(profile(middle)[0], middle.shape)  # type: ignore[operator]
            span = float(np.ptp(value)) or 1.0
            off = max(off, float(np.abs(spline(middle) - exact).max()) / span)
        if off <= TABLE_TOLERANCE:
            break
        times = np.sort(np.append(times, middle))
    return times


def format_numbers(values: Array) -> str:
    """Write numbers with all their digits, four in a line."""
    numbers = [repr(float(value)) for value in values]
    rows = [", ".join(numbers[k : k + 4]) for k in range(0, len(numbers), 4)]
    return "[\n    " + ",\n    ".join(rows) + "]"
