"""A torsion-spring balancer, or a batch of them: lengths, springs, stops and rest posture.

Springs are linear or quadratic and may be wound up to a preload.  The cosine rule gives the angles
of the last two segments, which connect the chain with the pendulum's tip.
"""

from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import check_one_of
from proofmass.analytic.protocol import (
    Angle,
    AngularStiffness,
    Force,
    Length,
    Mode,
    Moment,
    Quantity,
    Reference,
)
from proofmass.base.arrays import Array


def preload_spring(
    stiffness: Array, quadratic: Array, preload: Array
) -> tuple[Array, Array, Array]:
    r"""Wind up a spring ``M = k x + A x^2`` to its preload M0.

    With the deflection e counted from the preloaded state, x = e + e*::

        M = M0 + k' e + A e^2,    e* = 2 M0/(k + k'),    k' = sqrt(k^2 + 4 A M0)

    e* is the root that is reached first when the slack spring is wound up.

    Parameters
    ----------
    stiffness, quadratic : ndarray (...)
        k [N m/rad] and A [N m/rad^2] of the slack spring.
    preload : ndarray (...)
        M0 [N m].

    Returns
    -------
    stiffness, deflection, energy : ndarray (...)
        k' [N m/rad], e* [rad] and k e*^2/2 + A e*^3/3 [J].  k' is NaN where the spring never
        reaches M0.  Without any stiffness the moment is constant and e* is infinite; there is no
        slack state from which the energy could count, so that it is set to 0.

    Notes
    -----
    Source: van Nes 2022, eq. 12-17 with alpha* for e*.

    Examples
    --------
    >>> k, deflection, energy = preload_spring(np.array(2.0), np.array(-0.5), np.array(1.5))
    >>> float(k), float(deflection), round(float(energy), 6)
    (1.0, 1.0, 0.833333)
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        stiff = np.where(preload == 0, stiffness, np.sqrt(stiffness**2 + 4 * quadratic * preload))
        deflection = np.where(preload == 0, 0.0, 2 * preload / (stiffness + stiff))
        energy = deflection**2 * (stiffness / 2 + quadratic * deflection / 3)
    return stiff, deflection, np.where(np.isfinite(deflection), energy, 0.0)


def close_chain(pendulum: Array | float, length: Array, first: Array, mode: Array | int) -> Array:
    """Find the angles of all segments from those of the first ones, for an upright pendulum.

    ::

                 tip
          q2    /|         v = tip - P, from the end P of the given segments
        elbow  / |         d = |v|, its direction b = atan2(v_x, v_y)
             \\  v          A = acos((d^2 + a^2 - c^2)/(2 d a))   at P
           a  \\ |          C = acos((d^2 + c^2 - a^2)/(2 d c))   at the tip
               \\P          mode +1: b - A and b + C;  mode -1: b + A and b - C

    Parameters
    ----------
    pendulum : float or ndarray (...)
        Length r [m]; the tip is at (0, r).
    length : ndarray (..., n)
        Lengths [m]; a and c are the last two.
    first : ndarray (..., n - 2)
        Angles of the first segments, clockwise from the pendulum [rad].
    mode : +1 or -1, or an array (...) [1]
        Elbow up: the last segment is turned clockwise against the one before; or elbow down.

    Returns
    -------
    ndarray (..., n)
        All angles, clockwise from the pendulum [rad]; NaN where the segments cannot reach.

    Notes
    -----
    Source: van Nes 2022, appendix A (the cosine rule); the two-argument arc tangent replaces the
    sectors of its listings N.3 and N.4.

    Examples
    --------
    >>> close_chain(np.array(1.0), np.array([0.5, 0.5, 0.5]), np.array([0.0]), 1).round(6).tolist()
    [0.0, -1.047198, 1.047198]
    """
    a, c = length[..., -2], length[..., -1]
    x = -(length[..., :-2] * np.sin(first)).sum(axis=-1)
    y = pendulum - (length[..., :-2] * np.cos(first)).sum(axis=-1)
    d, toward = np.hypot(x, y), np.arctan2(x, y)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.arccos((d**2 + a**2 - c**2) / (2 * d * a))
        far = np.arccos((d**2 + c**2 - a**2) / (2 * d * c))
    last = np.stack([toward - mode * near, toward + mode * far], axis=-1)
    return np.concatenate([np.broadcast_to(first, (*last.shape[:-1], first.shape[-1])), last], -1)


MAX_ALONG_SINE = 1e-9
"""Largest sine of the angle at which segment 1 counts as lying along the pendulum."""
NUMBERED_PARAMETERS = ("length", "stiffness", "quadratic", "preload", "low", "high")
"""Parameters of every joint or segment; its number is appended to the name."""
REQUIRED_PARAMETERS = ("length", "stiffness")
"""Parameters of every joint or segment without a default."""
NUMBERED_DEFAULTS = {"quadratic": 0.0, "preload": 0.0, "low": -np.inf, "high": np.inf}
"""Defaults of the other parameters of joints."""
OTHER_DEFAULTS = {
    "pendulum": 1.0,
    "extension1": 0.0,
    "extension2": 0.0,
    "rest_angle": 0.0,
    "rest_angle2": 0.0,
    "weight": 0.0,
    "mode": 1,
}
"""Defaults of the parameters that are not those of a joint or segment."""


@dataclass(frozen=True)
class Balancer:
    """A batch of B balancers of n segments; the first axis of every array is the batch.

    Attributes
    ----------
    pendulum, extension1, extension2, weight : ndarray (B,)
        Length [m] of the pendulum, which grows with its angle to
        ``r = pendulum + extension1 alpha + extension2 alpha^2`` [m/rad, m/rad^2], and weight at the
        tip [N].
    length, rest : ndarray (B, n)
        Segments' lengths [m] and angles in the rest posture, clockwise from the upright [rad].
    stiffness, quadratic, preload : ndarray (B, n)
        Springs: ``M = preload + stiffness e + quadratic e^2`` for the deflection e from rest
        [N m/rad, N m/rad^2, N m].  `stiffness` is that of the preloaded spring.
    stored : ndarray (B, n)
        Energy of each spring at rest [J].
    low, high : ndarray (B, n)
        Stops of each joint's deflection [rad]; infinite where there are none.
    stopped : tuple of int
        Joints that have a stop in any balancer of the batch, counted from 0.

    Notes
    -----
    If segment 1 of three lies along the pendulum at rest, a rotation of it by b to either side
    winds joint 3 in the same sense, by -mode c b^2 with c > 0 (`loose`).  A stop from which joint 3
    then moves away is left whatever the spring's moment; a stop on the other side locks the chain
    for ever.
    """

    pendulum: Array
    extension1: Array
    extension2: Array
    weight: Array
    length: Array
    rest: Array
    stiffness: Array
    quadratic: Array
    preload: Array
    stored: Array
    low: Array
    high: Array
    stopped: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.length)

    def __getitem__(self, which: Any) -> "Balancer":
        """Select some balancers of the batch."""
        arrays = {f.name: getattr(self, f.name)[which] for f in fields(self)[:-1]}
        return Balancer(**arrays, stopped=self.stopped)

    @property
    def segments(self) -> int:
        """Number of segments n."""
        return self.length.shape[1]

    def reach(self, alpha: Array) -> Array:
        """Length r [m] of the pendulum at angles (B,), or at angles (A,) for a batch of one."""
        return self.pendulum + alpha * (self.extension1 + alpha * self.extension2)

    def stretch(self, alpha: Array) -> Array:
        """Derivative dr/dalpha of the pendulum's length [m/rad]."""
        return self.extension1 + 2.0 * alpha * self.extension2

    @property
    def loose(self) -> NDArray[np.int_]:
        """Sense (B,) in which any motion from rest winds joint 3: -1 or 1; 0 if it depends."""
        if self.segments != 3:
            return np.zeros(len(self), int)
        along = np.abs(np.sin(self.rest[:, 0])) < MAX_ALONG_SINE
        way = np.sin(self.rest[:, 2] - self.rest[:, 1]) * np.cos(self.rest[:, 0])
        return np.where(along & (np.abs(way) > MAX_ALONG_SINE), -np.copysign(1.0, way), 0.0).astype(
            int
        )

    def moments(self, deflection: Array) -> Array:
        """Spring moments [N m] at deflections (B, ..., n)."""
        m, k, a = (
            self.insert_axes(p, deflection) for p in (self.preload, self.stiffness, self.quadratic)
        )
        return m + deflection * (k + a * deflection)

    def slopes(self, deflection: Array) -> Array:
        """Stiffness dM/de [N m/rad] of the springs at deflections (B, ..., n)."""
        k, a = (self.insert_axes(p, deflection) for p in (self.stiffness, self.quadratic))
        return k + 2.0 * a * deflection

    def energies(self, deflection: Array) -> Array:
        """Energy [J] of each spring at deflections (B, ..., n), including that of its preload."""
        m, k, a, v = (
            self.insert_axes(p, deflection)
            for p in (self.preload, self.stiffness, self.quadratic, self.stored)
        )
        return v + deflection * (m + deflection * (k / 2 + a * deflection / 3))

    def insert_axes(self, values: Array, like: Array) -> Array:
        """Insert axes of size 1 after the batch into values (B, n), or (B,), to broadcast."""
        between = like.ndim - 2
        return values.reshape(len(values), *[1] * between, *values.shape[1:]) if between else values


def balancer(**parameters: ArrayLike) -> Balancer:
    """Make balancers from the parameters of a sidecar; each may be an array (B,), for a batch.

    See `proofmass.analytic.balancer.solve` for their names and meaning.

    Raises
    ------
    ValueError
        A parameter is unknown, missing or out of its domain; a preload has no stop that carries it
        at rest, is more than its spring can carry, or can never be released; or the lengths cannot
        reach the tip.
    """
    found = balancers(**parameters)
    check_reach(found)
    check_release(found)
    check_preload(found)
    return found


def balancers(**parameters: ArrayLike) -> Balancer:
    """Make balancers as `balancer` does, with NaN in `rest` or `stiffness` of impossible ones.

    Impossible are lengths that cannot reach the tip, preloads that a spring cannot carry, and
    preloads that can never be released; they raise no error here.
    """
    n = next((count for count in (4, 3) if f"length{count}" in parameters), 2)
    known = [f"{name}{i}" for name in NUMBERED_PARAMETERS for i in range(1, n + 1)] + list(
        OTHER_DEFAULTS
    )
    if unknown := [key for key in parameters if key not in known]:
        raise ValueError(f"unknown parameter {unknown[0]!r}; known: {', '.join(known)}")
    if missing := [
        k for k in known if k.rstrip("1234") in REQUIRED_PARAMETERS and k not in parameters
    ]:
        raise ValueError(f"{missing[0]} is missing")
    flat = {key: np.atleast_1d(np.asarray(value, float)) for key, value in parameters.items()}
    check_one_of((1, -1), mode=float(flat.get("mode", np.ones(1))[0]))
    size = max(v.size for v in flat.values())
    table = {
        name: np.stack(
            [
                np.broadcast_to(flat.get(f"{name}{i}", NUMBERED_DEFAULTS.get(name, 0.0)), size)
                for i in range(1, n + 1)
            ],
            axis=-1,
        )
        for name in NUMBERED_PARAMETERS
    }
    single = {k: np.broadcast_to(flat.get(k, v), size) for k, v in OTHER_DEFAULTS.items()}
    check_parameters(table, single)
    rest = close_chain(
        single["pendulum"],
        table["length"],
        np.stack([single["rest_angle"], single["rest_angle2"]], axis=-1)[:, : n - 2],
        single["mode"],
    )
    stiff, _, stored = preload_spring(table["stiffness"], table["quadratic"], table["preload"])
    has_stop = np.isfinite(table["low"]) | np.isfinite(table["high"])
    found = Balancer(
        single["pendulum"],
        single["extension1"],
        single["extension2"],
        single["weight"],
        table["length"],
        rest,
        stiff,
        table["quadratic"],
        table["preload"],
        stored,
        table["low"],
        table["high"],
        tuple(np.flatnonzero(has_stop.any(axis=0)).tolist()),
    )
    found.stiffness[is_locked(found)] = np.nan
    return found


def is_locked(b: Balancer) -> NDArray[np.bool_]:
    """Whether a stop of joint 3 locks each chain (B,) whatever the spring's moment."""
    return ((b.loose < 0) & (b.low[:, -1] == 0)) | ((b.loose > 0) & (b.high[:, -1] == 0))


def first_fault(faulty: Array) -> tuple[int, int]:
    """Find the first faulty balancer of a batch, and its first faulty joint (counted from 1)."""
    number, joint = np.argwhere(faulty)[0]
    return int(number), int(joint) + 1


def check_parameters(table: dict[str, Array], single: dict[str, Array]) -> None:
    """Raise ValueError for the first parameter that is out of its domain."""
    parameters = {**table, **{k: v[:, None] for k, v in single.items()}}
    low, high, preload = table["low"], table["high"], table["preload"]
    faults = [
        (name, np.isnan(v) if name in ("low", "high") else ~np.isfinite(v), "must be finite")
        for name, v in parameters.items()
    ]
    faults += [
        (name, parameters[name] <= 0, "must be positive [m]") for name in ("length", "pendulum")
    ]
    faults += [
        (
            "stiffness",
            (table["stiffness"] < 0) & (table["quadratic"] == 0),
            "must not be negative [N m/rad]",
        ),
        ("low", low > 0, "must not be above 0, the rest posture [rad]"),
        ("high", high < 0, "must not be below 0, the rest posture [rad]"),
        ("high", ~(low < high), "must be above low [rad]"),
        (
            "rest_angle",
            (parameters["rest_angle"] != 0) & (low.shape[1] == 2),
            "is of a balancer of three segments or more, and there is no length3 [rad]",
        ),
        (
            "rest_angle2",
            (parameters["rest_angle2"] != 0) & (low.shape[1] < 4),
            "is of a balancer of four segments, and there is no length4 [rad]",
        ),
        ("preload", (preload > 0) & (low != 0), "needs a stop that holds it at rest, low = 0"),
        ("preload", (preload < 0) & (high != 0), "needs a stop that holds it at rest, high = 0"),
    ]
    for name, faulty, requirement in faults:
        if faulty.any():
            index, joint = first_fault(faulty)
            number = f"{joint}" if name in table else ""
            raise ValueError(
                f"{name}{number} {requirement}, got {parameters[name][index, joint - 1]:g}"
            )
    at_rest_on_stop = (low == 0) | (high == 0)
    if (at_rest_on_stop.sum(axis=-1) > (free := low.shape[1] - 2)).any():
        raise ValueError(
            f"low, high: at most {free} of the joints of {free + 2} segments can rest on a stop: "
            f"they lock the chain"
        )
    for name in ("preload", "low", "high"):
        if (table[name][:, 0] != NUMBERED_DEFAULTS[name]).any():
            raise ValueError(f"{name}1: joint 1 can have no stop; its deflection is the moment")


def check_reach(b: Balancer) -> None:
    """Raise ValueError for the first lengths that cannot reach the tip."""
    if np.isnan(b.rest).any():
        index, _ = first_fault(np.isnan(b.rest))
        lengths = ", ".join(f"{length:g}" for length in b.length[index])
        raise ValueError(
            f"length: segments of {lengths} m cannot reach the tip of a pendulum of "
            f"{b.pendulum[index]:g} m from rest_angle = {b.rest[index, 0]:g} rad"
        )


def check_release(b: Balancer) -> None:
    """Raise ValueError for the first preload or stop of joint 3 that can never be released."""
    for index in np.flatnonzero(is_locked(b)):
        near, far, sign = (
            ("low", "high", "negative") if b.loose[index] < 0 else ("high", "low", "positive")
        )
        raise ValueError(
            f"preload3 can never release: segment 1 lies along the pendulum at rest, so that joint "
            f"3 turns the same way whichever way the chain moves, and {near}3 = 0 stops that; got "
            f"{b.preload[index, 2]:g} N m with rest_angle = {b.rest[index, 0]:g} rad; give another "
            f"rest_angle, or {far}3 = 0 with a {sign} preload3"
        )


def check_preload(b: Balancer) -> None:
    """Raise ValueError for the first preload that its spring cannot carry."""
    if np.isnan(b.stiffness).any():
        index, joint = first_fault(np.isnan(b.stiffness))
        raise ValueError(
            f"preload{joint} is more than its spring can carry, got "
            f"{b.preload[index, joint - 1]:g} N m; at most -stiffness{joint}^2/"
            f"(4 quadratic{joint})"
        )


class ChainParameters(Reference):
    """Parameters of a chain of torsion springs, which all references of balancers have."""

    length1: Length
    length2: Length
    length3: Length
    length4: Length
    stiffness1: AngularStiffness
    stiffness2: AngularStiffness
    stiffness3: AngularStiffness
    stiffness4: AngularStiffness
    quadratic1: Annotated[float, Quantity("N m/rad^2")]
    quadratic2: Annotated[float, Quantity("N m/rad^2")]
    quadratic3: Annotated[float, Quantity("N m/rad^2")]
    quadratic4: Annotated[float, Quantity("N m/rad^2")]
    preload2: Moment
    preload3: Moment
    preload4: Moment
    pendulum: Length
    rest_angle: Angle
    rest_angle2: Angle
    weight: Force
    mode: Mode
