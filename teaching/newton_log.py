"""The printed log of a Newton-Raphson iteration, as B. Díaz Lozano's notebooks show it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise, zip_longest

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.newton_raphson import NewtonLog
from proofmass.base.arrays import Array

RANK_MARGIN = 1e-5  # smaller singular values count as zero, as in the document


def format_log(log: NewtonLog) -> str:
    """Text of a log: q, Phi, J, rank and error of each iteration.

    Parameters
    ----------
    log : NewtonLog
        The iterations.

    Returns
    -------
    str
        A block for each iteration, and a last line with the root.

    Examples
    --------
    >>> from proofmass.analytic.newton_raphson import newton_raphson
    >>> log = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5], tolerance=1e-3)
    >>> print(format_log(log))
    iteration 1: |Phi| = 2.500e-01, rank 1, error |dq| = 8.333e-02
                     q         Phi   J
      q1    1.50000000   2.500e-01          3
    iteration 2: |Phi| = 6.944e-03, rank 1, error |dq| = 2.451e-03
                     q         Phi   J
      q1    1.41666667   6.944e-03      2.833
    iteration 3: |Phi| = 6.007e-06, rank 1, error |dq| = 2.124e-06
                     q         Phi   J
      q1    1.41421569   6.007e-06      2.828
    after 3 iterations: q1 = 1.41421356
    """
    names = log.names or tuple(f"q{k + 1}" for k in range(log.root.size))
    name_width = max(map(len, names), default=0)
    lines = []
    for k, rank in enumerate(jacobian_ranks(log)):
        lines.append(
            f"iteration {k + 1}: |Phi| = {log.residuals[k]:.3e}, rank {rank}, "
            f"error |dq| = {log.steps[k]:.3e}"
        )
        lines.append(f"  {'':{name_width}} {'q':>13} {'Phi':>11}   J")
        unknowns = [
            f"{name:{name_width}} {q:13.8f}" for name, q in zip(names, log.iterates[k], strict=True)
        ]
        equations = [
            f" {value:11.3e}" + "".join(f"{entry:11.4g}" for entry in row)
            for value, row in zip(log.values[k], log.jacobians[k], strict=True)
        ]
        none = " " * (name_width + 14)  # more equations than unknowns
        lines += [
            f"  {q or none}{equation}"
            for q, equation in zip_longest(unknowns, equations, fillvalue="")
        ]
    root = "  ".join(f"{name} = {value:.8f}" for name, value in zip(names, log.root, strict=True))
    return "\n".join([*lines, f"after {log.iterations} iterations: {root}"])


@dataclass(frozen=True)
class FoldedLog:
    """A log that a notebook shows as a table of its steps, with the matrices folded below it.

    Attributes
    ----------
    log : NewtonLog
        The iterations.
    labels : mapping of str to str
        Words in place of those of the table, such as ``{"iteration": "iteración"}``.

    Examples
    --------
    >>> from proofmass.analytic.newton_raphson import newton_raphson
    >>> log = newton_raphson(lambda x: (x**2 - 2.0, np.diag(2.0 * x)), [1.5], tolerance=1e-3)
    >>> FoldedLog(log)._repr_html_().count("<tr>"), repr(FoldedLog(log)) == format_log(log)
    (4, True)
    """

    log: NewtonLog
    labels: Mapping[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return the log as text, for where there is no HTML."""
        return format_log(self.log)

    def _repr_html_(self) -> str:
        number, before = (self.labels.get(word, word) for word in ("iteration", "before"))
        head = (number, "|Phi|", "|dq|", f"|dq| / |dq {before}|²")
        rows = [
            f"<td>{k + 1}</td><td>{residual:.3e}</td><td>{step:.3e}</td><td>{share}</td>"
            for k, (residual, step, share) in enumerate(
                zip(self.log.residuals, self.log.steps, step_shares(self.log), strict=True)
            )
        ]
        table = "".join(f"<tr>{row}</tr>" for row in ("".join(map(cell, head)), *rows))
        fold = self.labels.get("matrices of each iteration", "matrices of each iteration")
        return (
            f"<div><table>{table}</table><details><summary>q, Phi, J: {escape(fold)}</summary>"
            f"<pre>{escape(format_log(self.log))}</pre></details></div>"
        )


def cell(text: str) -> str:
    """Text as a cell in the head of a table of HTML."""
    return f"<th>{escape(text)}</th>"


def step_shares(log: NewtonLog) -> list[str]:
    """Each step over the square of the step before it; empty for the first and below rounding."""
    steps, rounding = log.steps, 1e-15 * np.abs(log.root).max()
    return [""] * min(1, steps.size) + [
        f"{step / before**2:.3g}" if step > rounding else "" for before, step in pairwise(steps)
    ]


def jacobian_ranks(log: NewtonLog) -> NDArray[np.intp]:
    """Rank of each Jacobian (iterations,): number of singular values above `RANK_MARGIN`."""
    return np.asarray(np.sum(singular_values(log) > RANK_MARGIN, axis=1))


def condition_numbers(log: NewtonLog) -> Array:
    """Condition number of each Jacobian (iterations,) [1]."""
    values = singular_values(log)
    with np.errstate(divide="ignore"):
        return np.asarray(values[:, 0] / values[:, -1])


def singular_values(log: NewtonLog) -> Array:
    """Singular values of each Jacobian (iterations, unknowns), the largest first [SI]."""
    return np.asarray(np.linalg.svd(log.jacobians, compute_uv=False))
