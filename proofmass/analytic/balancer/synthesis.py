"""The kinds of balancers that can be designed, and the error of a batch of them against a target.

The bounds of the parameters are those of the designs of van Nes 2022.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from proofmass.analytic.balancer.measures import (
    energy_spread,
    precision_points,
    rmse,
    work_reduction,
)
from proofmass.analytic.balancer.model import balancers
from proofmass.analytic.balancer.path import along, balancing_moment, follow
from proofmass.analytic.balancer.slopes import moment_slopes
from proofmass.base.arrays import Array

SPRING_KINDS = ("linear", "nonlinear", "each")
"""Kinds of springs, see `Variant.springs`."""
LENGTH_BOUNDS = {2: (1 / 2, 3 / 4), 3: (1 / 3, 1 / 2), 4: (1 / 4, 3 / 8)}
"""Usual bounds of lengths by the number of segments n, 1/n to 3/(2 n) of a pendulum of 1 m [m]."""
TRIANGLE_LENGTH = 0.6
"""Length of both segments of two beside a pendulum of 1 m that keeps its length [m]: the moment
does not depend on it."""
PRELOADED_JOINTS = {2: ((),), 3: ((), (2,), (3,)), 4: ((), (2,), (3,), (2, 3))}
"""Joints that can be preloaded, by the number of segments."""
RELAXED_LENGTH_BOUNDS = (0.1, 0.9)
"""Bounds of relaxed lengths [m]."""
DEFAULT_BOUNDS = (4.5, 4.5)
"""Upper bounds as in `THESIS_FIGURES`, for variants without a figure."""
# figure of the thesis by target and option; upper bounds of k [N m/rad] and of |A|, |B|
# [N m/rad^2, N m/rad]
THESIS_FIGURES = {
    ("sine", "standard"): ("M.1", 1.5, 2.0),
    ("sine", "rest angle"): ("M.2", 4.5, 3.5),
    ("sine", "relaxed lengths"): ("M.3", 1.5, 2.0),
    ("progressive", "standard"): ("M.4", 1.5, 2.0),
    ("progressive", "rest angle"): ("M.5", 4.5, 2.0),
    ("progressive", "contact"): ("M.6", 1.5, 2.0),
    ("progressive", "contact and rest angle"): ("M.7", 4.5, 2.0),
    ("progressive-degressive", "standard"): ("M.8", 2.5, 2.0),
    ("progressive-degressive", "rest angle"): ("M.9", 4.5, 2.0),
    ("progressive-degressive", "contact"): ("M.10", 4.5, 2.0),
    ("progressive-degressive", "contact and rest angle"): ("M.11", 4.5, 4.5),
    ("degressive-progressive", "standard"): ("M.12", 2.5, 2.0),
    ("degressive-progressive", "rest angle"): ("M.13", 4.5, 2.0),
    ("degressive-progressive", "contact"): ("M.14", 4.5, 2.0),
    ("degressive-progressive", "contact and rest angle"): ("M.15", 4.5, 4.5),
    ("laevo", "standard"): ("M.16", 2.5, 3.0),
    ("laevo", "rest angle"): ("M.17", 3.5, 3.5),
    ("laevo", "relaxed lengths"): ("M.18", 2.5, 3.0),
    ("sine180", "standard"): ("M.19", 2.5, 3.0),
    ("sine180", "rest angle"): ("M.20", 4.5, 3.5),
}


@dataclass(frozen=True)
class Variant:
    """One kind of balancer: its free parameters, for a pendulum with r = 1 m, m g r = 1 N m.

    Attributes
    ----------
    target : str
        Name of the target: one of `proofmass.analytic.balancer.measures.TARGETS`, or another name.
    segments : int
        Number of segments, 2 to 4.
    springs : str
        ``linear``; ``nonlinear``, with the same k and A in all joints as in the thesis; or
        ``each``, with its own k and A in each joint.
    preload : tuple of int
        Joints that are preloaded against a stop: 2 or 3 of three segments, 2 and 3 of four.
    free_angle, contact, relaxed : bool
        Whether the rest angle of segment 1 is free, joint 2 has an upper stop, and lengths may be
        from 0.1 to 0.9 m.
    mode : int
        1 elbow up, as in all of the thesis's tables; -1 elbow down, as in its programs too.
    extension : tuple of float
        extension1 and extension2 of the pendulum [m/rad, m/rad^2], which are given, not free.
    narrowed : mapping of str to (float, float)
        Bounds that replace the usual ones, by parameter [SI].

    Notes
    -----
    Bounds: van Nes 2022, figures M.1 to M.20.  Where these give the stiffness of a nonlinear spring
    bounds -B and B, it is not allowed to be negative here, since such a chain is not stable at
    rest.  The thesis gives no bounds of the contact's angle; here they are 0.01 and pi.

    The sign of a preload decides on which stop its joint rests, `low` = 0 for a positive one and
    `high` = 0 for a negative one; its bounds must not pass zero.  All figures of the thesis have
    rows for a preload of spring 3 of three segments, with a dash in each.  If segment 1 is along
    the pendulum at rest, a positive preload 3 can never be released; the elbow opens, and the usual
    bounds are -1 and 0 N m.  If the rest angle is free, segment 1 may lead the pendulum; then the
    elbow closes, and the usual bounds are 0 and 1 N m.

    Examples
    --------
    >>> Variant("sine", free_angle=True).figure
    'M.2'
    >>> Variant("sine", springs="nonlinear").bounds["quadratic"]
    (-2.0, 2.0)
    """

    target: str
    segments: int = 3
    springs: str = "linear"
    preload: tuple[int, ...] = ()
    free_angle: bool = False
    contact: bool = False
    relaxed: bool = False
    mode: int = 1
    extension: tuple[float, float] = (0.0, 0.0)
    narrowed: Mapping[str, tuple[float, float]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if self.segments not in LENGTH_BOUNDS:
            raise ValueError(f"segments must be 2, 3 or 4, got {self.segments}")
        if self.segments == 2 and (self.preload or self.free_angle or self.contact):
            raise ValueError(
                "two segments and the pendulum form a triangle: there is no rest angle to choose, "
                "and a preload or a contact of joint 2 would lock it"
            )
        if self.mode not in (1, -1):
            raise ValueError(f"mode must be 1 or -1, got {self.mode}")
        if self.springs not in SPRING_KINDS:
            raise ValueError(
                f"springs must be one of {', '.join(SPRING_KINDS)}, got {self.springs!r}"
            )
        known = PRELOADED_JOINTS[self.segments]
        if self.preload not in known:
            raise ValueError(
                f"preload of {self.segments} segments must be of joints "
                f"{', '.join(' and '.join(map(str, pair)) for pair in known[1:])}, "
                f"got {' and '.join(map(str, self.preload))}"
            )
        for name, (low, high) in self.narrowed.items():
            if name not in self.usual:
                raise ValueError(
                    f"bound of {name!r}: no such parameter; there are {', '.join(self.usual)}"
                )
            if not -np.inf < low < high < np.inf:
                raise ValueError(f"bound of {name!r} must rise, got {low:g} to {high:g}")
            if name.startswith("preload") and low < 0 < high:
                raise ValueError(
                    f"bound of {name!r} must not pass 0, since its sign says at which stop the "
                    f"joint rests, got {low:g} to {high:g}"
                )
        low, high = self.bounds.get("preload3", (0.0, 0.0))
        if self.segments == 3 and not self.free_angle and self.mode * (low + high) > 0:
            raise ValueError(
                f"bound of 'preload3', {low:g} to {high:g} N m: such a preload can never release "
                f"where segment 1 begins along the pendulum; give it the other sign, or a free "
                f"rest angle"
            )
        if self.contact and self.bounds.get("preload2", (0.0, 1.0))[0] < 0:
            raise ValueError("bound of 'preload2' must be positive, to leave joint 2 its contact")

    @property
    def option(self) -> str:
        """The thesis's name for what is free in addition to springs and lengths."""
        words = [
            w
            for w, on in (
                ("contact", self.contact),
                ("rest angle", self.free_angle),
                ("relaxed lengths", self.relaxed),
            )
            if on
        ]
        return " and ".join(words) or "standard"

    @property
    def figure(self) -> str:
        """Number of the thesis's figure with this variant; "" if there is none."""
        return str(THESIS_FIGURES.get((self.target, self.option), ("",))[0])

    @property
    def is_rigid(self) -> bool:
        """Whether the chain turns with the pendulum as one body: spring 1 alone has a moment."""
        return self.segments == 2 and not any(self.extension)

    @property
    def usual(self) -> dict[str, tuple[float, float]]:
        """Usual lower and upper bounds of all free parameters."""
        joints = range(1, 2 if self.is_rigid else self.segments + 1)
        _, k, a = THESIS_FIGURES.get((self.target, self.option), ("", *DEFAULT_BOUNDS))
        found: dict[str, tuple[float, float]] = {}
        if self.springs == "nonlinear":
            found |= {"stiffness": (0.0, a), "quadratic": (-a, a)}
        else:
            found |= {f"stiffness{i}": (0.0, k) for i in joints}
        if self.springs == "each":
            found |= {f"quadratic{i}": (-a, a) for i in joints}
        for i in self.preload:
            sign = self.mode * (1 if self.free_angle else -1) if i == self.segments else 1
            found[f"preload{i}"] = (0.0, 1.0) if sign > 0 else (-1.0, 0.0)
        lengths = RELAXED_LENGTH_BOUNDS if self.relaxed else LENGTH_BOUNDS[self.segments]
        found |= {} if self.is_rigid else {f"length{i}": lengths for i in joints}
        if self.free_angle:
            found["rest_angle"] = (-np.pi, np.pi)
        if self.contact:
            found["high2"] = (0.01, np.pi)
        return found

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds of all free parameters: those of `narrowed`, otherwise those of `usual`."""
        return {name: self.narrowed.get(name, pair) for name, pair in self.usual.items()}

    def parameters(self, vectors: Array) -> dict[str, Array]:
        """Parameters (B,) of `proofmass.analytic.balancer.solve` from design vectors (B, d)."""
        found: dict[str, Array] = {}
        if self.is_rigid:
            fixed = {"length1": TRIANGLE_LENGTH, "length2": TRIANGLE_LENGTH, "stiffness2": 0.0}
            found |= {name: np.full(len(vectors), value) for name, value in fixed.items()}
        for name, values in zip(self.usual, np.asarray(vectors, float).T, strict=True):
            shared = name in ("stiffness", "quadratic")
            found |= (
                {f"{name}{i}": values for i in range(1, 2 if self.is_rigid else self.segments + 1)}
                if shared
                else {name: values}
            )
            if name.startswith("preload"):
                stop = "low" if self.bounds[name][0] >= 0 else "high"
                found[f"{stop}{name[-1]}"] = np.zeros_like(values)
        if any(self.extension):
            for i, given in enumerate(self.extension, 1):
                found[f"extension{i}"] = np.full(len(vectors), given)
        return found | ({"mode": np.full(len(vectors), -1.0)} if self.mode == -1 else {})

    def vector(self, parameters: Mapping[str, float]) -> Array:
        """Design vector (d,) of a balancer's parameters."""
        return np.array(
            [
                parameters[f"{name}1" if name in ("stiffness", "quadratic") else name]
                for name in self.usual
            ],
            float,
        )


def thesis_variants() -> list[Variant]:
    """The 112 variants that van Nes 2022 optimised, in the order of its figures.

    >>> len(thesis_variants())
    112
    """
    return [variant for target, option in THESIS_FIGURES for variant in variants_of(target, option)]


def variants_of(target: str, option: str) -> list[Variant]:
    """All variants (springs, numbers of segments, preloads) of the thesis for an option."""
    has_both_segment_numbers = option in ("standard", "relaxed lengths")
    return [
        Variant(
            target,
            segments,
            springs,
            preload,
            "rest" in option,
            "contact" in option,
            "relaxed" in option,
        )
        for segments in ((3, 4) if has_both_segment_numbers else (3,))
        for springs in ("linear", "nonlinear")
        for preload in ((), tuple(range(2, segments)))
    ]


THESIS_POINTS = {2: 90, 3: 90, 4: 15}
"""Number of points of the thesis by segments; of two, which it has not, as of three."""
COARSE_POINTS = 15
"""Largest number of points of a coarse evaluation."""
MIN_ELBOW_SINE = 0.02
"""Smallest sine of the last joint's angle: a straighter elbow can flip."""
COARSE_ELBOW_FACTOR = 1.25
"""Factor of `MIN_ELBOW_SINE` at few points: between them the elbow may be straighter."""
LAST_PATH_ANGLE = np.pi / 2 + 1e-9
"""Last angle of a path [rad]: more than pi/2, so that rounding does not end it before."""
SPREAD_PENALTY = 30.0
"""Penalty factor of the excess over a limit of the spread."""
SMALL_ERROR = 1e-4
"""Errors below this share of m g r count as squares for any power."""


@dataclass(frozen=True)
class DesignMeasures:
    """Measures of designs, each (B,): NaN for a design that cannot be built.

    Attributes
    ----------
    rmse, work_reduction, spread : ndarray (B,)
        `proofmass.analytic.balancer.measures`, at m g r = 1 N m: [1], [%], [1].
    """

    rmse: Array
    work_reduction: Array
    spread: Array


@dataclass(frozen=True)
class Synthesis:
    r"""A search for the balancer whose moment comes nearest to a target.

    ::

        minimise    mean_j |M1(alpha_j; p) - target_j|^power
        subject to  low <= p <= high,
                    spread <= limit,
                    a rest posture that is stable, a path from it to 90 degrees without a fold,
                    mode sin(theta_n - theta_(n-1)) > 0.02 all along: the elbow never straightens

    Parameters
    ----------
    variant : Variant
        The kind of balancer, with its free parameters and bounds.
    target : callable
        Target moment [N m] at pendulum angles [rad], for m g r = 1 N m.
    points : int, optional
        Number of points j 90/points degrees, j = 1, 2 ..; by default that of the thesis.
    power : float
        2 for the smallest rmse, 1 for the best work reduction, or a value between [1].
    limit : float
        Largest spread of energy between the springs, f2 [1]: a second objective as a constraint.

    Notes
    -----
    Terms are exact to rounding.  Errors below 1e-4 count as squares, so that the objective has a
    derivative at zero for a power below 2.  Beyond the limit the square of `SPREAD_PENALTY` times
    the excess is added, so that a design exceeds the limit by about its error times the derivative
    of the error by the spread, over `SPREAD_PENALTY`^2.
    """

    variant: Variant
    target: Callable[[Array], Array]
    points: int = 0
    power: float = 2.0
    limit: float = np.inf

    @property
    def low(self) -> Array:
        """Lower bounds (d,)."""
        return np.array([low for low, _ in self.variant.bounds.values()])

    @property
    def high(self) -> Array:
        """Upper bounds (d,)."""
        return np.array([high for _, high in self.variant.bounds.values()])

    @property
    def angles(self) -> Array:
        """Pendulum angles of the points [rad]."""
        return precision_points(self.points or THESIS_POINTS[self.variant.segments])

    @property
    def fingerprint(self) -> str:
        """Text that distinguishes this search from any other."""
        wanted = np.asarray(self.target(self.angles), float).tolist()
        return repr((self.variant, wanted, self.power, self.limit))

    def coarse(self, vectors: Array) -> Array:
        """Terms (B, m) at few points; their squares sum to the objective; NaN if not buildable."""
        return self.terms(
            vectors,
            precision_points(min(COARSE_POINTS, self.angles.size)),
            COARSE_ELBOW_FACTOR * MIN_ELBOW_SINE,
        )

    def residuals(self, vectors: Array) -> Array:
        """Terms (B, m) at all points."""
        return self.terms(vectors, self.angles)

    def terms(self, vectors: Array, angle: Array, min_sine: float = MIN_ELBOW_SINE) -> Array:
        """Terms (B, m) at angles (A,); NaN unless the elbow's sine is always above `min_sine`."""
        moment, energy = self.curves(vectors, angle, min_sine)
        found = moment - self.target(angle)
        if self.power != 2.0:
            found = found * (found**2 + SMALL_ERROR**2) ** (self.power / 4.0 - 0.5)
        found = found / np.sqrt(angle.size)
        if np.isfinite(self.limit):
            excess = energy_spread(*np.moveaxis(energy, -1, 0)) - self.limit
            found = np.column_stack([found, SPREAD_PENALTY * np.maximum(excess, 0.0)])
        return found

    def figures(self, vectors: Array) -> DesignMeasures:
        """Measures of designs (B, d) at all points."""
        moment, energy = self.curves(vectors, self.angles)
        wanted = self.target(self.angles)
        return DesignMeasures(
            rmse(moment, wanted),
            work_reduction(moment, wanted, self.angles),
            energy_spread(*np.moveaxis(energy, -1, 0)),
        )

    def curves(
        self, vectors: Array, angle: Array, min_sine: float = MIN_ELBOW_SINE
    ) -> tuple[Array, Array]:
        """Balancing moments (B, A) [N m] and energies (B, A, n) [J]; NaN where not buildable."""
        buildable, n = np.flatnonzero(np.isfinite(vectors).all(axis=-1)), self.variant.segments
        chains = balancers(**self.variant.parameters(vectors[buildable]))
        possible = np.isfinite(chains.rest + chains.stiffness).all(axis=-1)
        buildable, chains = buildable[possible], chains[possible]
        moment = np.full((len(vectors), angle.size), np.nan)
        energy = np.full((len(vectors), angle.size, n), np.nan)
        if buildable.size:
            with np.errstate(all="ignore"):  # beyond the end of a path all values are NaN
                path = along(chains, follow(chains, LAST_PATH_ANGLE), angle)
                last, before = path.theta[..., -1], path.theta[..., -2]
                accepted = (self.variant.mode * np.sin(last - before) > min_sine).all(axis=-1)
            moment[buildable[accepted]] = balancing_moment(chains, path)[accepted]
            energy[buildable[accepted]] = path.energy[accepted]
        return moment, energy


BATCH_STRIDE = 0.2
"""Largest stride of a path in batches of kinds [rad]: two thirds of the time of 0.1, measured for
three segments, since shorter strides are taken where the path bends."""
ChainMaker = Callable[[Array], dict[str, Array]]
"""From vectors (B, d) to parameters (B,) of `proofmass.analytic.balancer.solve`."""


def batch_moments(parameters: Mapping[str, Array], angle: Array, min_sine: float) -> Array:
    """Balancing moments (B, A) [N m] of chains of several kinds with one number of segments.

    They are NaN where a chain cannot be built, does not reach an angle [rad], or has a last joint
    whose angle's sine falls below `min_sine` [1].
    """
    chains = balancers(**parameters)
    moment = np.full((len(chains), angle.size), np.nan)
    possible = np.flatnonzero(np.isfinite(chains.rest + chains.stiffness).all(axis=-1))
    if possible.size:
        with np.errstate(all="ignore"):  # beyond the end of a path all values are NaN
            some = chains[possible]
            path = along(some, follow(some, LAST_PATH_ANGLE, BATCH_STRIDE), angle)
            good = least_bend(
                path.theta, np.broadcast_to(parameters["mode"], len(chains))[possible]
            )
            moment[possible[good > min_sine]] = balancing_moment(some, path)[good > min_sine]
    return moment


def batch_slopes(
    make: ChainMaker, vectors: Array, change: Array, angle: Array, min_sine: float
) -> tuple[Array, Array]:
    """Balancing moments (B, A) as `batch_moments`, and their derivatives (B, d, A).

    `change` (B, d) has the changes [SI] of the vectors for differences of closed formulas; the
    derivative by a coordinate that does not change is 0.
    """
    parameters = make(vectors)
    chains = balancers(**parameters)
    changed = [balancers(**make(vectors + change * unit)) for unit in np.eye(change.shape[1])]
    with np.errstate(all="ignore"):  # beyond the end of a path all values are NaN
        paths = follow(chains, LAST_PATH_ANGLE, BATCH_STRIDE)
        moment, slopes, theta = moment_slopes(chains, paths, angle, changed, change)
        good = least_bend(theta, parameters["mode"]) > min_sine
    moment[~good] = np.nan
    return moment, np.where(change[..., None] == 0.0, 0.0, slopes)


def least_bend(theta: Array, mode: Array) -> Array:
    """Smallest sine (B,) of the last joint's angle, positive while the elbow is on its side [1]."""
    least = np.asarray(mode)[:, None] * np.sin(theta[..., -1] - theta[..., -2])
    return np.asarray(least.min(axis=-1))
