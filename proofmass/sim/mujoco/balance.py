"""Linear statics about a pose: joints that are held by rows, and rest between forces otherwise."""

import numpy as np

from proofmass.analytic.numerics import Array

DEPENDENT = 1e-10  # of the largest singular value: rows that say nothing new, to rounding
FLAT = 1e-9  # of the largest stiffness: less cannot be told from none by differences


class Balance:
    """Ways x with ``rows x = -gap`` and, along the null space N of the rows, ``N' (f + K x) = 0``.

    Parameters
    ----------
    rows, gap : ndarray (rows, nv), (rows,)
        What holds the joints, and how far it is open; rows may depend on each other.
    force, stiffness : ndarray (nv,), (nv, nv)
        f and K: what must act on the joints to keep them at rest, and how it changes with them.

    Attributes
    ----------
    inverse, null : ndarray (nv, rows), (nv, freedoms)
        Pseudo-inverse of the rows, and N.
    hessian : ndarray (freedoms, freedoms)
        N' K N: what the freedoms' rest is stable by, when it is positive definite.
    """

    def __init__(self, rows: Array, gap: Array, force: Array, stiffness: Array):
        self.rows, self.gap, self.force, self.stiffness = rows, gap, force, stiffness
        left, values, right = np.linalg.svd(rows)
        rank = int((values > DEPENDENT * values.max(initial=0.0)).sum())
        self.inverse = (right[:rank].T / values[:rank]) @ left[:, :rank].T
        self.null = right[rank:].T
        self.hessian = self.null.T @ stiffness @ self.null

    def step(self, descend: bool = False) -> Array:
        """The joints' way x; to `descend` it turns back where the stiffness is negative."""
        close = -self.inverse @ self.gap
        return close - self.yielding(self.force + self.stiffness @ close, descend)

    def yielding(self, force: Array, descend: bool = False) -> Array:
        """How the freedoms yield to forces on the joints."""
        push = self.null.T @ force
        if not descend:
            return np.asarray(self.null @ np.linalg.lstsq(self.hessian, push)[0])
        values, vectors = np.linalg.eigh((self.hessian + self.hessian.T) / 2)
        floor = FLAT * np.abs(self.stiffness).max() or FLAT
        away = vectors.T @ push / np.maximum(np.abs(values), floor)
        return np.asarray(self.null @ vectors @ away)

    def pushes(self, move: Array) -> Array:
        """What the rows push with after a step."""
        return self.inverse.T @ (self.force + self.stiffness @ move)

    def left_open(self) -> float:
        """How far a step leaves the rows open: rows that contradict each other."""
        return float(np.abs(self.gap - self.rows @ self.inverse @ self.gap).max())

    def least(self) -> float:
        """The least stiffness of the freedoms, as a share of the joints' largest."""
        values = np.linalg.eigvalsh((self.hessian + self.hessian.T) / 2)
        return float(values.min(initial=np.inf) / (np.abs(self.stiffness).max() or 1.0))

    def tangent(self, columns: slice) -> Array:
        """How the rest moves when the rows of those numbers do (nv, columns)."""
        motions = self.inverse[:, columns]
        return motions - self.yielding(self.stiffness @ motions)
