"""Residuals of measured curves: whether what is left of a curve is noise of a stated size.

A measured curve has noise of standard deviation sigma, independent from row to row, and may begin
late and have a zero of its own::

    y_i = f(x_i + lag) + zero + e_i          e_i normal with mean 0 and standard deviation sigma

The curve f is without noise: that of an engine, or of a reference.  `lag` and `zero` are fitted
only where a sidecar asks for it.  The residual r of the m rows is noise if none of these is larger
than chance makes it in a share of all measurements:

    =========== ============================ ==========================================
    largest     max |r| / sigma              the largest of m normal numbers
    mean        sum r / (sigma sqrt m)       normal
    rms         sqrt(sum r^2 / m) / sigma    chi-squared of m, less the fitted numbers
    neighbours  sum_k w_k sum_i r_i r_{i+k}  normal, for many rows
    numbers     s r / (sigma |s|)            the largest of correlated normal numbers
    =========== ============================ ==========================================

The weights of rows that are k apart are ``w_k = 1 - k / (K + 1)``, up to K = `NEIGHBOURS`: the sum
is by how much the mean of K + 1 successive rows varies more than that of independent ones, and sees
errors that are slow.  It is divided by its standard error.

The last test is for each number of the model, or of the reference, by which f changes with the
slope s: ``s r / |s|^2`` is the change of the number that fits the residual, and ``sigma / |s|``
its standard error.

The size of the noise can be estimated from the residual: by its second differences, to which a
curve that is smooth from row to row adds next to nothing::

    sigma^2 = sum (r_{i-1} - 2 r_i + r_{i+1})^2 / (6 (m - 2))

Sums of products of rows are quadratic forms, whose chances are those of normal numbers with a
correction for their skewness (Cornish and Fisher, Rev. Inst. Int. Stat. 5, 1938).
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.case.case import Fitted

FALSE_REFUSALS = 0.01
"""Share of measurements of an exact model that a run with all its channels may refuse by chance."""
TEST_SHARE = 0.075
"""Share of the false refusals that each of the first four tests may cause."""
NUMBERS_SHARE, ZEROS_SHARE = 0.6, 0.1
"""Shares of the false refusals that the tests of numbers may cause: they find the smallest errors.
Numbers that are 0 are less often wrong than lengths, and there are many of them."""
MIN_MEASURED_ROWS = 30
"""Least number of rows: the correlation of neighbours is normal for many rows alone, and with 30
the false refusals are still those that are stated."""
MIN_ESTIMATED_ROWS = 400
"""Least number of rows for an estimate of sigma, whose own error is then 5 %: with 30 rows 5 % of
exact models would be refused."""
NEIGHBOURS = 8
"""Distance of rows up to which their correlation is tested: an error that stays for more rows adds
up, and one of few rows is still seen by the large weights of these."""
DIFFERENCE_WEIGHTS = 1.0, -2.0, 1.0
"""Weights of three neighbouring rows in a second difference, whose squares have the sum 6."""
DEGREES_SHARE = 18.0 / 35.0
"""Degrees of freedom of an estimated sigma^2 over the number of rows; its variance is 35 / (9 m)
times sigma^4."""
ANGLES = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
"""Angles at which symbols are averaged: exact for sums of up to 63 cosines, such as their cubes."""
LAG_STEPS = 8
"""Most Gauss-Newton steps by which a lag is fitted; each but the first doubles its digits."""
LAG_DIGITS = 1e-10
"""Change of a lag, as a share of the spacing of rows, at which its fit ends."""
MAX_LAG_SHARE = 0.1
"""Largest lag that is fitted, as a share of the length of the run: with more, too few rows are left
that both curves have."""
MAX_SHARE_ERROR = 0.1
"""Standard error of the share by which a number changes, up to which it is tested: curves that do
not tell it to 10 % hardly depend on it."""
COLLINEAR = 1e-9
"""Share of a slope that is left without what `lag` and `zero` fit, up to which these fit it."""
JOINT_NODES = 64
"""Nodes of the quadrature of the probability that two correlated numbers are both large: its error
is below 1e-10 of it."""
MAX_LIMIT = 12.0
"""Largest number of standard deviations that is looked for as a limit; its chance is 4e-33."""


TEST_PHRASES = {
    "largest": "a largest residual",
    "mean": "a mean",
    "neighbours": "a correlation of neighbours",
    "rms": "a root mean square",
}
"""The tests of a residual by itself, in words."""


class TooFewRows(Exception):
    """A measured curve has too few rows to tell noise from an error."""


@dataclass(frozen=True)
class MeasuredCurve:
    """A measured curve and a curve without noise.

    Attributes
    ----------
    x, measured : ndarray (m,)
        The rows, rising, and the measured curve there [SI].
    samples, smooth : ndarray (n,)
        The samples, rising, and the curve without noise there [SI].
    """

    x: Array
    measured: Array
    samples: Array
    smooth: Array

    def at_rows(self, curve: Array, lag: float = 0.0, derivative: int = 0) -> Array:
        """A curve at the samples, or a derivative of it, at the rows; a lag later."""
        if self.x is self.samples and not lag and not derivative:
            return curve
        from scipy.interpolate import CubicSpline  # slow to load

        return np.asarray(CubicSpline(self.samples, curve)(self.x + lag, derivative))


@dataclass(frozen=True)
class FittedNumber:
    """A fitted number and its standard error."""

    value: float
    error: float

    def over(self, factor: float) -> "FittedNumber":
        """The number in another unit, which is `factor` times that of this one."""
        return FittedNumber(self.value / factor, self.error / factor)

    @property
    def ratio(self) -> float:
        """The number in its standard errors."""
        return self.value / self.error


@dataclass(frozen=True)
class NoiseTest:
    """A test of a residual: its value, and the largest magnitude that noise has."""

    name: str
    value: float
    limit: float
    unit: str

    @property
    def passes(self) -> bool:
        """Whether the value is no larger than that of noise."""
        return abs(self.value) <= self.limit

    @property
    def words(self) -> str:
        """The test as a phrase.

        >>> NoiseTest("largest", 3.2, 4.4, "sigma").words
        'a largest residual of 3.2 sigma (up to 4.4)'
        """
        size = f"{number(self.value, 2)} {self.unit} (up to {number(self.limit, 2)})"
        return f"{TEST_PHRASES[self.name]} of {size}"


@dataclass(frozen=True)
class Residual:
    """What is left of a measured curve, after a fit of what the sidecar asks for.

    Attributes
    ----------
    curve : MeasuredCurve
    values : ndarray (m,)
        Measured curve less that without noise [SI].
    sigma : float
        Standard deviation of the noise [SI].
    estimated : bool
        Whether `sigma` is that of the second differences.
    fits : dict of str to FittedNumber
        The fitted numbers.
    basis : ndarray (m, fits)
        Orthonormal columns: changes of the curve that the fits can make [1].
    """

    curve: MeasuredCurve
    values: Array
    sigma: float
    estimated: bool
    fits: dict[Fitted, FittedNumber]
    basis: Array

    @property
    def count(self) -> int:
        """The number of rows."""
        return self.values.size

    @cached_property
    def rms(self) -> float:
        """Root mean square over sigma, with the fitted numbers taken off the rows [1]."""
        return float(np.sqrt(self.values @ self.values / (self.count - len(self.fits)))) / (
            self.sigma
        )

    def without_fits(self, curve: Array) -> Array:
        """What is left of a curve at the rows if the fits are made to it."""
        return np.asarray(curve - self.basis @ (self.basis.T @ curve))

    def with_values(self, values: Array) -> "Residual":
        """The residual with other values, which need not be at the same rows (k,)."""
        x, zeros = np.linspace(0.0, 1.0, values.size), np.zeros(values.size)
        if values.size == self.count:
            values, basis = self.without_fits(values), self.basis
        else:  # of a lag nothing is known there
            mean = float(values.mean()) if "zero" in self.fits else 0.0
            values, basis = np.asarray(values - mean), np.asarray(zeros[:, None])
        return replace(self, curve=MeasuredCurve(x, values, x, zeros), values=values, basis=basis)

    def is_noise(self, level: float) -> bool:
        """Whether it passes all tests by itself."""
        return all(one.passes for one in self.tests(level))

    def tests(self, level: float) -> tuple[NoiseTest, ...]:
        """The tests of the residual by itself, each with a share of the chance `level`."""
        from scipy.special import chdtri, ndtri  # slow to load

        chance, free = TEST_SHARE * level, self.count - len(self.fits)
        normal = float(-ndtri(chance / 2.0))
        beside = form_limit(neighbour_spectrum(), self.count, chance / 2.0)
        found = [
            NoiseTest("largest", self.largest, self.of_noise(largest_limit(free, chance)), "sigma"),
            NoiseTest("neighbours", self.neighbours, beside, "standard errors"),
        ]
        if "zero" not in self.fits:
            mean = self.mean.ratio, self.of_noise(normal), "standard errors"
            found.insert(1, NoiseTest("mean", *mean))
        most = float(chdtri(free, chance)) / free
        if self.estimated:
            spread = np.sqrt(2.0 * np.mean(difference_spectrum() ** 2) / self.count)
            most = 1.0 / (1.0 - spread * form_limit(difference_spectrum(), self.count, chance))
        return *found, NoiseTest("rms", self.rms, float(np.sqrt(most)), "sigma")

    def of_noise(self, limit: float) -> float:
        """A limit of normal numbers, wider if sigma is estimated: that of Student's numbers."""
        from scipy.special import ndtr, stdtrit  # slow to load

        if not self.estimated:
            return limit
        return float(-stdtrit(DEGREES_SHARE * self.count, ndtr(-limit)))

    @property
    def largest(self) -> float:
        """The largest magnitude over sigma [1]."""
        return float(np.abs(self.values).max()) / self.sigma

    @property
    def mean(self) -> FittedNumber:
        """The mean and its standard error."""
        one = np.ones(self.count)
        free = self.without_fits(one)
        size = float(one @ free)
        return FittedNumber(float(free @ self.values) / size, self.sigma / float(np.sqrt(size)))

    @property
    def neighbours(self) -> float:
        """Correlation of neighbouring rows, in its standard errors, see above."""
        square = float(self.values @ self.values)
        apart = np.arange(1, NEIGHBOURS + 1)
        weights = 1.0 - apart / (NEIGHBOURS + 1.0)
        products = [self.values[k:] @ self.values[:-k] for k in apart.tolist()]
        error = float(np.sqrt(np.sum(weights**2 * (self.count - apart)))) / self.count
        return float(weights @ products) / square / error if square else 0.0


def fit_residual(
    curve: MeasuredCurve, sigma: float | None, fits: Collection[Fitted] = ()
) -> Residual:
    """The residual of a measured curve.

    Parameters
    ----------
    curve : MeasuredCurve
    sigma : float or None
        Standard deviation of the noise [SI]; None: it is estimated.
    fits : collection of {"zero", "lag"}
        What is fitted.

    Raises
    ------
    TooFewRows

    Examples
    --------
    >>> x = np.linspace(0.0, 6.0, 601)
    >>> noise = 0.01 * np.random.default_rng(1).standard_normal(601)
    >>> curve = MeasuredCurve(x, np.sin(x + 0.02) + 0.3 + noise, x, np.sin(x))
    >>> found = fit_residual(curve, 0.01, ("zero", "lag"))
    >>> [(round(one.value, 3), round(one.error, 4)) for one in found.fits.values()]
    [(0.3, 0.0004), (0.02, 0.0006)]
    >>> all(test.passes for test in found.tests(0.01))
    True
    """
    least, what = MIN_MEASURED_ROWS, "tell noise from an error"
    if sigma is None:
        least, what = MIN_ESTIMATED_ROWS, "estimate the noise"
    if curve.x.size < least:
        raise TooFewRows(f"{curve.x.size} rows are too few to {what}; {least} are needed")
    lag = 0.0
    columns: Array = np.zeros((curve.x.size, 0))
    values = curve.measured - curve.at_rows(curve.smooth)
    step: Array = np.zeros(0)
    most = MAX_LAG_SHARE * float(np.ptp(curve.x))
    for _ in range(LAG_STEPS if fits else 0):
        columns = np.stack([change_by(one, curve, lag) for one in fits], axis=1)
        left = curve.measured - curve.at_rows(curve.smooth, lag)
        step = np.asarray(np.linalg.lstsq(columns, left, rcond=None)[0])
        values = np.asarray(left - columns @ step)
        moved = float(step[list(fits).index("lag")]) if "lag" in fits else 0.0
        lag = float(np.clip(lag + moved, -most, most))
        if abs(moved) <= LAG_DIGITS * float(np.ptp(curve.x)) / curve.x.size:
            break
    size = estimate_sigma(values) if sigma is None else sigma
    covariance = np.linalg.pinv(columns.T @ columns) if fits else np.zeros((0, 0))
    known = {
        name: FittedNumber(lag if name == "lag" else float(value), size * float(np.sqrt(square)))
        for name, value, square in zip(fits, step, np.diag(covariance), strict=True)
    }
    basis = np.linalg.qr(columns)[0] if fits else columns
    return Residual(curve, values, size, sigma is None, known, basis)


def change_by(name: Fitted, curve: MeasuredCurve, lag: float) -> Array:
    """The change of the curve without noise at the rows by a unit of what is fitted."""
    if name == "zero":
        return np.ones(curve.x.size)
    return curve.at_rows(curve.smooth, lag, derivative=1)


def form_limit(spectrum: Array, count: int, chance: float) -> float:
    """Standard deviations that a quadratic form of normal numbers passes by chance.

    Parameters
    ----------
    spectrum : ndarray (k,)
        Values of its symbol at even angles [1]: the form is a sum over pairs of rows whose weights
        depend on their distance.
    count : int
        Number of rows.
    chance : float
        That noise passes the limit [1].
    """
    from scipy.special import ndtri  # slow to load

    normal = float(-ndtri(chance))
    skewness = 8.0 * np.mean(spectrum**3) / np.sqrt(count * (2.0 * np.mean(spectrum**2)) ** 3)
    return float(normal + skewness * (normal**2 - 1.0) / 6.0)


def neighbour_spectrum() -> Array:
    """The symbol of the correlation of neighbours: the sum of its weights times cosines."""
    apart = np.arange(1, NEIGHBOURS + 1)
    return np.asarray(np.cos(ANGLES[:, None] * apart) @ (1.0 - apart / (NEIGHBOURS + 1.0)))


def difference_spectrum() -> Array:
    """The symbol of the mean square of rows less its estimate from second differences.

    >>> round(float(2.0 * np.mean(difference_spectrum() ** 2)), 6)  # 17 / 9
    1.888889
    """
    return 1.0 - np.square(2.0 - 2.0 * np.cos(ANGLES)) / 6.0


def estimate_sigma(values: Array) -> float:
    """Standard deviation of noise by the second differences of a residual.

    >>> x = np.linspace(0.0, 1.0, 2001)
    >>> noise = 0.1 * np.random.default_rng(0).standard_normal(2001)
    >>> bool(abs(estimate_sigma(np.sin(6.0 * x) + noise) - 0.1) < 0.005)
    True
    """
    second = np.convolve(values, DIFFERENCE_WEIGHTS, "valid")
    return float(np.sqrt(np.mean(second**2) / np.square(DIFFERENCE_WEIGHTS).sum()))


def largest_limit(count: int, chance: float) -> float:
    """Standard deviations that the largest of some independent normal numbers passes by chance.

    >>> round(largest_limit(1, 0.05), 2), round(largest_limit(401, 0.001), 2)
    (1.96, 4.71)
    """
    from scipy.special import ndtri  # slow to load

    return float(-ndtri(-np.expm1(np.log1p(-chance) / count) / 2.0))


def correlated_limit(correlation: Array, chance: float) -> float:
    """Standard deviations that the largest of some correlated normal numbers passes by chance.

    It is an upper bound (Hunter, J. Appl. Prob. 13, 1976; Worsley, Biometrika 69, 1982): the sum of
    the chances of all numbers, less those of the pairs on a tree that are both large.

    Parameters
    ----------
    correlation : ndarray (k, k)
        Of the numbers [1].
    chance : float
        That the largest passes the limit [1].

    Examples
    --------
    >>> correlated_limit(np.eye(2), 0.01) < correlated_limit(np.eye(3), 0.01)
    True
    >>> round(correlated_limit(np.ones((3, 3)), 0.01), 3)  # one number, three times
    2.576
    """
    from scipy.optimize import brentq  # slow to load
    from scipy.sparse.csgraph import minimum_spanning_tree

    size = np.abs(np.clip(correlation, -1.0, 1.0))
    tree = minimum_spanning_tree(np.triu(2.0 - size, 1)).tocoo()
    pairs = size[tree.row, tree.col]

    def excess(limit: float) -> float:
        single = normal_tail(limit)
        return len(size) * single - float(both_large(pairs, limit).sum()) - chance

    return float(brentq(excess, 0.0, MAX_LIMIT))


def normal_tail(limit: float) -> float:
    """The chance that a normal number is larger than a limit in magnitude."""
    from scipy.special import ndtr  # slow to load

    return float(2.0 * ndtr(-limit))


def both_large(correlations: Array, limit: float) -> Array:
    """The chance (k,) that both of two normal numbers are larger than a limit in magnitude.

    >>> both_large(np.array([0.0, 1.0]), 2.0) / normal_tail(2.0)
    array([0.04550026, 1.        ])
    """
    from scipy.special import ndtr, ndtri  # slow to load

    nodes, weights = np.polynomial.legendre.leggauss(JOINT_NODES)
    tail = float(ndtr(-limit))
    first = -ndtri(tail * (nodes + 1.0) / 2.0)  # equally likely, beyond the limit
    spread = np.sqrt(np.maximum(1.0 - correlations**2, 0.0))[:, None]
    means = correlations[:, None] * first
    with np.errstate(divide="ignore", invalid="ignore"):
        above = ndtr(np.where(spread > 0, (means - limit) / spread, np.inf))
        below = ndtr(np.where(spread > 0, (-means - limit) / spread, -np.inf))
    return np.asarray(2.0 * tail * (above + below) @ weights / 2.0)


@dataclass(frozen=True)
class NumberFit:
    """Changes of numbers, each of which fits the residuals of some channels by itself.

    Attributes
    ----------
    changes : dict of str to FittedNumber
        By the names of those that the residuals depend on, in the unit of the slopes' numbers.
    correlation : ndarray (k, k)
        Of the changes, in the order of their names [1].
    chance : float
        That the largest change passes the limit, with noise alone [1].
    of_noise : callable
        `Residual.of_noise` of a channel.
    """

    changes: dict[str, FittedNumber]
    correlation: Array
    chance: float
    of_noise: Callable[[float], float]

    @cached_property
    def limit(self) -> float:
        """Standard errors that the largest change passes by chance."""
        return self.of_noise(correlated_limit(self.correlation, self.chance))

    @property
    def largest(self) -> str:
        """Name of the change that is largest in its standard errors; empty if there is none."""
        return max(self.changes, key=lambda name: abs(self.changes[name].ratio), default="")

    @property
    def passes(self) -> bool:
        """Whether no change is larger than that of noise."""
        return not self.changes or abs(self.changes[self.largest].ratio) <= self.limit


def fit_numbers(
    residuals: Sequence[Residual], slopes: Mapping[str, Sequence[Array]], chance: float
) -> NumberFit:
    """Fit each of some numbers to the residuals of all channels.

    Parameters
    ----------
    residuals : sequence of Residual
        Of the channels.
    slopes : mapping of str to sequence of ndarray (m,)
        For each number the slope of the curve without noise of each channel, at its rows, by a
        share of the number [SI]; one that the residuals tell to no `MAX_SHARE_ERROR` is left
        out.
    chance : float
        That noise alone makes a change larger than the limit [1].

    Examples
    --------
    >>> x = np.linspace(0.0, 6.0, 401)
    >>> noise = 0.01 * np.random.default_rng(3).standard_normal(401)
    >>> curve = MeasuredCurve(x, 1.005 * np.sin(x) + noise, x, np.sin(x))
    >>> found = fit_numbers([fit_residual(curve, 0.01)], {"length": [np.sin(x)]}, 0.01)
    >>> one = found.changes["length"]
    >>> (round(one.value, 4), round(one.error, 4)), found.passes
    ((0.0051, 0.0007), False)
    """
    columns = dict[str, Array]()
    for name, parts in slopes.items():
        pairs = list(zip(residuals, parts, strict=True))
        left = np.concatenate([one.without_fits(part) / one.sigma for one, part in pairs])
        whole = np.concatenate([part / one.sigma for one, part in pairs])
        size = np.linalg.norm(left)
        if size > COLLINEAR * np.linalg.norm(whole) and size * MAX_SHARE_ERROR > 1.0:
            columns[name] = left
    sizes = np.array([np.linalg.norm(one) for one in columns.values()])
    values = np.concatenate([one.values / one.sigma for one in residuals])
    scaled = np.reshape(list(columns.values()), (len(columns), values.size)) / sizes[:, None]
    ratios = scaled @ values
    changes = {
        name: FittedNumber(float(z / size), float(1.0 / size))
        for name, z, size in zip(columns, ratios, sizes, strict=True)
    }
    return NumberFit(changes, scaled @ scaled.T, chance, residuals[0].of_noise)
