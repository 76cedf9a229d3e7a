"""Newton-Raphson iteration with a log of every step, and charts of the log."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.base.arrays import Array

System = Callable[[Array], tuple[Array, Array]]
"""Function of the unknowns (unknowns,) that returns F (equations,) and its Jacobian."""
# Smallest step or residual that a chart shows; smaller ones are rounding errors
SMALLEST_DRAWN = 1e-17


@dataclass(frozen=True)
class NewtonLog:
    """Log of a Newton-Raphson iteration: row i has iterate i, and F and its Jacobian there.

    Attributes
    ----------
    iterates : ndarray (iterations + 1, unknowns)
        The first guess, then the iterate after each step [SI].
    values : ndarray (iterations, equations)
        F at each iterate before its step [SI].
    jacobians : ndarray (iterations, equations, unknowns)
        Jacobian of F at each iterate before its step [SI].
    names : tuple of str
        Names of the unknowns, for charts; may be empty.
    """

    iterates: Array
    values: Array
    jacobians: Array
    names: tuple[str, ...] = ()

    @property
    def root(self) -> Array:
        """Last iterate (unknowns,) [SI]."""
        return np.asarray(self.iterates[-1])

    @property
    def iterations(self) -> int:
        """Number of steps."""
        return len(self.values)

    @property
    def steps(self) -> Array:
        """Norm of each step (iterations,) [SI], which the documents call error; units are mixed."""
        return np.asarray(np.linalg.norm(np.diff(self.iterates, axis=0), axis=1))

    @property
    def residuals(self) -> Array:
        """Norm of F before each step (iterations,) [SI]."""
        return np.asarray(np.linalg.norm(self.values, axis=1))


class NotConverged(ValueError):
    """No root was found within the allowed iterations; `log` has the iterations that were made."""

    def __init__(self, message: str, log: NewtonLog) -> None:
        super().__init__(message)
        self.log = log


class SingularJacobian(NotConverged):
    """The Jacobian at an iterate has no inverse or is not finite."""


def newton_raphson(
    system: System,
    start: ArrayLike,
    *,
    tolerance: float = 1e-10,
    max_iterations: int = 101,
    names: tuple[str, ...] = (),
) -> NewtonLog:
    r"""Root of F(x) = 0 by x <- x + dx with J(x) dx = -F(x), until |dx| <= tolerance.

    Parameters
    ----------
    system : function
        x (unknowns,) -> F (equations,), J (equations, unknowns). With more equations than unknowns
        the step is that of least squares (Gauss-Newton).
    start : array_like (unknowns,)
        First iterate [SI].
    tolerance : float
        Largest norm of the last step [SI], in the mixed units of x.
    max_iterations : int
        Number of iterations allowed.
    names : tuple of str
        Names of the unknowns, for charts.

    Returns
    -------
    NewtonLog
        The root, whose error is about tolerance^2 where J is regular, and every step.

    Raises
    ------
    NotConverged
        There is no root after `max_iterations` iterations, or an iterate is not finite.
    SingularJacobian
        A square Jacobian has no inverse, or a Jacobian is not finite.

    Notes
    -----
    The iteration stops by the size of the step, not of the residual, as in the two documents that
    use it: B. Díaz Lozano, TFG, Universidad de Almería 2019, text lines 1417-1469 (1e-10, 101
    iterations) and the power hacksaw report, Universidad Nacional de Colombia, text lines 196, 345
    (1e-6). The first guess decides which root is found: the caller checks the branch.

    Examples
    --------
    >>> log = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5], tolerance=1e-3)
    >>> log.root.round(8).tolist(), [f"{step:.0e}" for step in log.steps]
    ([1.41421356], ['8e-02', '2e-03', '2e-06'])
    """
    iterates = [np.array(start, float)]
    values: list[Array] = []
    jacobians: list[Array] = []

    def log() -> NewtonLog:
        if not values:
            none = np.empty((0, 0, iterates[0].size))
            return NewtonLog(np.array(iterates), none[:, :, 0], none, names)
        return NewtonLog(np.array(iterates), np.array(values), np.array(jacobians), names)

    size = np.inf
    for _ in range(max_iterations):
        residual, jacobian = system(iterates[-1])
        try:
            if not np.isfinite(jacobian).all():
                raise np.linalg.LinAlgError
            step = solve_linear(jacobian, -residual)
        except np.linalg.LinAlgError:
            raise SingularJacobian(
                f"singular Jacobian at iteration {len(values) + 1}", log()
            ) from None
        values.append(residual)
        jacobians.append(jacobian)
        iterates.append(iterates[-1] + step)
        size = float(np.linalg.norm(step))
        if size <= tolerance:
            return log()
        if not np.isfinite(size):
            break
    raise NotConverged(f"no root in {len(values)} iterations: the last step is {size:.3g}", log())


def solve_linear(jacobian: Array, right: Array) -> Array:
    """Solution x of J x = right, by least squares where J is not square."""
    square = jacobian.shape[0] == jacobian.shape[1]
    step = np.linalg.solve(jacobian, right) if square else np.linalg.lstsq(jacobian, right)[0]
    return np.asarray(step, float)


def convergence_chart(logs: Mapping[str, NewtonLog], caption: str) -> Chart:
    """Steps of each unknown, norm of the whole step and residual, over the iterations.

    Parameters
    ----------
    logs : dict of NewtonLog
        Logs by the titles of their panels.
    caption : str
        Caption of the chart.

    Returns
    -------
    Chart
        Lines over the number of the iteration; sizes of at most `SMALLEST_DRAWN` are left out.
    """

    def lines(log: NewtonLog) -> tuple[ChartLine, ...]:
        count = np.arange(1.0, log.iterations + 1)
        each = np.abs(np.diff(log.iterates, axis=0)).T
        named = [*zip(log.names, each, strict=True)] if log.names else []
        rows = [*named, ("error: norm of the step", log.steps), ("residual", log.residuals)]
        return tuple(
            ChartLine(
                count,
                np.where(size > SMALLEST_DRAWN, size, np.nan),
                label,
                points=label == "residual",
            )
            for label, size in rows
        )

    return Chart(
        ("iteration", ""),
        ("size, SI units", ""),
        tuple(Panel(lines(log), title=title) for title, log in logs.items()),
        caption,
        logarithmic=True,
    )


def course_chart(logs: Mapping[str, NewtonLog], caption: str) -> Chart:
    """Values of the unknowns over the iterations, from the first guess to the root.

    Parameters
    ----------
    logs : dict of NewtonLog
        Logs by the titles of their panels; a log needs the names of its unknowns.
    caption : str
        Caption of the chart.

    Returns
    -------
    Chart
    """
    return Chart(
        ("iteration", ""),
        ("value, SI units", ""),
        tuple(
            Panel(
                tuple(
                    ChartLine(np.arange(log.iterations + 1.0), values, name)
                    for name, values in zip(log.names, log.iterates.T, strict=True)
                ),
                title=title,
            )
            for title, log in logs.items()
        ),
        caption,
    )
