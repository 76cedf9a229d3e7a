"""Tolerances of manufacture: the band of a balancer's moment if its parts are not exact.

Each length, spring, preload and angle is off by up to its tolerance, uniformly and independently::

    parameter = nominal + tolerance u,       u between -1 and 1,  standard deviation 1/sqrt(3)

A batch of such balancers gives the moment of each (Monte Carlo).  The springs are set in the
assembled chain at rest; the angle at which a spring is set is off by up to the tolerance of angles,
as are the rest angle of segment 1 and the angles of stops.  A spring with a preload is set by it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from proofmass.analytic.balancer.model import Balancer, balancers
from proofmass.analytic.balancer.path import along, balancing_moment, follow
from proofmass.analytic.balancer.synthesis import LAST_PATH_ANGLE
from proofmass.base.arrays import Array

DEFAULT_TOLERANCES = {"length": 1e-4, "stiffness": 0.05, "preload": 0.05, "angle": np.radians(0.5)}
"""Usual tolerances: of lengths [m], of stiffnesses and preloads as a share of them [1], of angles
[rad].  Springs within 5 % and angles within half a degree are usual in catalogues and workshops;
milled lengths are within a tenth of a millimetre."""
BAND_SAMPLES = 1000
"""Number of balancers of a check: percentiles of 2.5 % then rest on 25 balancers."""
SAMPLES_AT_ONCE = 500
"""Number of balancers that are followed together."""
BAND_PERCENTILES = (2.5, 97.5)
"""Percentiles of the band [%]."""


@dataclass(frozen=True)
class Deviation:
    """A number of a balancer that may be off.

    Attributes
    ----------
    name : str
        A parameter of `proofmass.analytic.balancer.solve`; ``spring1`` .. for the strength of a
        spring, by which its stiffness and its nonlinear term are off together; ``set1`` .. for the
        angle at which a spring is set.
    group : str
        Key of the tolerances: ``length``, ``stiffness``, ``preload`` or ``angle``.
    size : float
        Largest deviation [SI]; of springs and preloads the share [1].
    """

    name: str
    group: str
    size: float


def list_deviations(
    parameters: Mapping[str, float], tolerances: Mapping[str, float], pendulum: float = 1.0
) -> list[Deviation]:
    """The numbers of a balancer that may be off.

    Parameters
    ----------
    parameters : mapping
        Parameters of `proofmass.analytic.balancer.solve` [SI].
    tolerances : mapping
        Tolerances by group [SI]; a missing or zero one leaves its group exact.
    pendulum : float
        Length of the real pendulum [m], which scales the tolerance of lengths to the design.

    Examples
    --------
    >>> chain = {"length1": 0.6, "length2": 0.6, "stiffness1": 1.0, "stiffness2": 0.0}
    >>> [one.name for one in list_deviations(chain, {"stiffness": 0.1, "angle": 0.01})]
    ['spring1', 'set1']
    """
    n = next(count for count in (4, 3, 2) if f"length{count}" in parameters)
    joints = range(1, n + 1)
    own = float(parameters.get("pendulum", 1.0))
    length = tolerances.get("length", 0.0) * own / pendulum
    sprung = [
        i for i in joints if parameters[f"stiffness{i}"] or parameters.get(f"quadratic{i}", 0.0)
    ]
    preloaded = [i for i in joints if parameters.get(f"preload{i}", 0.0)]
    stops = [
        f"{side}{i}"
        for i in joints
        for side in ("low", "high")
        if parameters.get(f"{side}{i}", 0.0) and np.isfinite(parameters[f"{side}{i}"])
    ]
    angles = [*(f"set{i}" for i in sprung if i not in preloaded), *stops]
    angles += ["rest_angle"] * (n > 2)
    names = {
        "length": [*(f"length{i}" for i in joints), "pendulum"],
        "stiffness": [f"spring{i}" for i in sprung],
        "preload": [f"preload{i}" for i in preloaded],
        "angle": angles,
    }
    sizes = {group: tolerances.get(group, 0.0) for group in names} | {"length": length}
    found = [Deviation(name, group, sizes[group]) for group in names for name in names[group]]
    return [one for one in found if one.size > 0.0]


def deviate(
    parameters: Mapping[str, float], deviations: list[Deviation], shares: Array
) -> tuple[dict[str, Array], Array]:
    """Parameters (S,) of balancers that are off by shares (S, q) of the deviations.

    The second array (S, n) has the angles by which the springs are set wrongly [rad].
    """
    n = next(count for count in (4, 3, 2) if f"length{count}" in parameters)
    given = {"pendulum": 1.0, "rest_angle": 0.0} | dict(parameters)
    found = {name: np.full(len(shares), float(value)) for name, value in given.items()}
    if n == 2:
        del found["rest_angle"]
    shift = np.zeros((len(shares), n))
    for one, share in zip(deviations, shares.T, strict=True):
        move, joint = one.size * share, one.name[-1]
        if one.name.startswith("set"):
            shift[:, int(joint) - 1] = move
        elif one.name.startswith("spring"):
            for name in (f"stiffness{joint}", f"quadratic{joint}"):
                if name in found:
                    found[name] = found[name] * (1.0 + move)
        elif one.group == "preload":
            found[one.name] = found[one.name] * (1.0 + move)
        else:
            found[one.name] = found[one.name] + move
    return found, shift


def set_wrongly(b: Balancer, shift: Array) -> Balancer:
    """The balancers (B,) with springs that are wound by angles (B, n) [rad] in the rest posture.

    ::

        M = k (e + d) + A (e + d)^2 = (k d + A d^2) + (k + 2 A d) e + A e^2
    """
    k, a = b.stiffness, b.quadratic
    return replace(
        b,
        preload=b.preload + shift * (k + a * shift),
        stiffness=k + 2.0 * a * shift,
        stored=b.stored + shift**2 * (k / 2.0 + a * shift / 3.0),
    )


def deviated_moments(
    parameters: Mapping[str, float], deviations: list[Deviation], shares: Array, angle: Array
) -> Array:
    """Balancing moments (S, A) [N m] at angles [rad]; NaN beyond the end of a path."""
    found = []
    for part in np.array_split(shares, max(1, len(shares) // SAMPLES_AT_ONCE)):
        off, shift = deviate(parameters, deviations, part)
        chains = set_wrongly(balancers(**off), shift)
        with np.errstate(all="ignore"):  # beyond the end of a path all values are NaN
            path = along(chains, follow(chains, LAST_PATH_ANGLE), angle)
            found.append(balancing_moment(chains, path))
    return np.concatenate(found)


@dataclass(frozen=True)
class ToleranceBand:
    """The moments of balancers whose parts are off.

    Attributes
    ----------
    angle, nominal : ndarray (A,)
        Pendulum angles [rad], and the moment of the exact balancer [N m].
    moments : ndarray (S, A)
        Moments of the samples that can be followed to the last angle [N m].
    failed : int
        Number of samples that cannot.
    linear : ndarray (A,)
        Standard deviation of the moment by linear propagation [N m].
    shares : dict of str to float
        Share of each group in the mean variance by linear propagation [1].
    """

    angle: Array
    nominal: Array
    moments: Array
    failed: int
    linear: Array
    shares: dict[str, float]

    @property
    def low(self) -> Array:
        """Lower percentile [N m]."""
        return np.asarray(np.percentile(self.moments, BAND_PERCENTILES[0], axis=0))

    @property
    def high(self) -> Array:
        """Upper percentile [N m]."""
        return np.asarray(np.percentile(self.moments, BAND_PERCENTILES[1], axis=0))

    @property
    def least(self) -> Array:
        """Smallest moments [N m]."""
        return np.asarray(self.moments.min(axis=0))

    @property
    def most(self) -> Array:
        """Largest moments [N m]."""
        return np.asarray(self.moments.max(axis=0))

    def over(self, scale: float) -> "ToleranceBand":
        """The band with moments over a scale [N m]."""
        return replace(
            self,
            nominal=self.nominal / scale,
            moments=self.moments / scale,
            linear=self.linear / scale,
        )

    def errors(self, wanted: Array) -> Array:
        """Root mean square errors (S,) of the samples against wanted moments (A,) [N m]."""
        return np.asarray(np.sqrt(np.mean((self.moments - wanted) ** 2, axis=-1)))


def find_band(
    parameters: Mapping[str, float],
    deviations: list[Deviation],
    angle: Array,
    samples: int = BAND_SAMPLES,
    seed: int = 1,
) -> ToleranceBand:
    """Sample balancers whose parts are off, and follow each of them.

    Raises
    ------
    ValueError
        No sample can be followed to the last angle.
    """
    shares = draw_shares(len(deviations), samples, seed)
    moments = deviated_moments(parameters, deviations, shares, angle)
    good = np.isfinite(moments).all(axis=-1)
    if not good.any():
        raise ValueError(
            f"none of {samples} balancers within these tolerances reaches "
            f"{np.degrees(angle[-1]):g} degrees"
        )
    variance = one_at_a_time(parameters, deviations, angle) ** 2 / 3.0
    variance = np.where(np.isfinite(variance), variance, 0.0)
    whole = variance.sum() or 1.0
    groups = np.array([one.group for one in deviations])
    return ToleranceBand(
        angle,
        deviated_moments(parameters, [], np.zeros((1, 0)), angle)[0],
        moments[good],
        int((~good).sum()),
        np.sqrt(variance.sum(axis=0)),
        {g: float(variance[groups == g].sum() / whole) for g in dict.fromkeys(groups.tolist())},
    )


def draw_shares(count: int, samples: int, seed: int) -> Array:
    """Shares (S, q) of the deviations, uniform between -1 and 1."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, count))


def one_at_a_time(
    parameters: Mapping[str, float], deviations: list[Deviation], angle: Array
) -> Array:
    """Change of the moment (q, A) by each deviation alone, half that between its two ends [N m]."""
    count = len(deviations)
    both = np.concatenate([np.eye(count), -np.eye(count)])
    moments = deviated_moments(parameters, deviations, both, angle)
    return np.asarray(0.5 * (moments[:count] - moments[count:]))
