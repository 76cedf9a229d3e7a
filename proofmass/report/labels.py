"""Where the names in a drawing go: beside what they name, and not on each other."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from proofmass.analytic.numerics import Array

ASIDE = np.exp(1j * np.pi * np.array([0.25, 0.75, -0.25, -0.75, 0, 1, 0.5, -0.5]))
SIDES = np.stack([ASIDE.real, ASIDE.imag], axis=1)


@dataclass(frozen=True)
class Label:
    """A text that may stand near any of `spots` (k, 2), best first; all lengths in points."""

    text: str
    spots: Array
    size: float = 8.0
    kind: str = "joint"

    @property
    def half(self) -> Array:
        """Half of the text's width and height, by the width of a usual letter."""
        lines = self.text.split("\n")
        return 0.5 * self.size * np.array([0.62 * max(map(len, lines)) + 0.3, 1.2 * len(lines)])

    def centres(self) -> Array:
        """Where the middle of the text may be (k, 2): around each spot, near before far."""
        rings = [self.spots[:, None] + SIDES * (self.half + gap) for gap in (5.0, 11.0, 19.0)]
        return np.concatenate([ring.reshape(-1, 2) for ring in rings])


def place(labels: Iterable[Label], points: Array, weights: Array, box: Array) -> list[Array]:
    """Choose a place for each label, one after the other.

    Parameters
    ----------
    labels : iterable of Label
    points, weights : ndarray (n, 2), (n,)
        What should stay in sight, and how much.
    box : ndarray (2, 2)
        Lower left and upper right corner of the drawing.

    Returns
    -------
    list of ndarray (2,)
        The middle of each text.

    Examples
    --------
    >>> spot = np.array([[50.0, 50.0]])
    >>> paper = np.array([[0.0, 0.0], [99.0, 99.0]])
    >>> a, b = place([Label("a", spot), Label("b", spot)], spot, np.ones(1), paper)
    >>> bool(np.abs(a - b).max() > 8)
    True
    """
    taken: list[tuple[Array, Array]] = []
    for label in labels:
        centres, half = label.centres(), label.half
        costs = 0.05 * np.arange(len(centres), dtype=float)
        inside = (np.abs(points - centres[:, None]) < half + 1).all(axis=2)
        costs += inside @ weights
        outside = np.maximum(box[0] - (centres - half), 0) + np.maximum(centres + half - box[1], 0)
        costs += 5 * outside.sum(axis=1)
        for middle, size in taken:
            shared = np.maximum(half + size - np.abs(centres - middle), 0)
            costs += np.where(shared.min(axis=1) > 0, 100 + shared.prod(axis=1), 0)
        taken.append((centres[int(costs.argmin())], half))
    return [middle for middle, _ in taken]
