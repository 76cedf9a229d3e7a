"""Which poses of a run are drawn, and which of them bears the names."""

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.picture import Picture

SAME = 0.03  # of the mechanism's size: poses nearer to each other than that look the same


def distinct(picture: Picture, count: int = 6) -> Picture:
    """Up to `count` poses, evenly over that part of the run that does not repeat itself.

    A swing is drawn on its way there, a full turn without its last pose, which is the first.
    """
    n = len(picture.x)
    if n > 2 and np.allclose(picture.inputs, picture.inputs[:, ::-1]) and picture.inputs.size:
        n = n // 2 + 1
    places = np.concatenate([m.at[:n, None] for m in picture.marks]
                            + [o[:n] for k in picture.links for o in k.outlines], axis=1)
    size = float(np.ptp(places, axis=(0, 1)).max()) or 1.0
    apart = np.abs(places[:, None] - places[None]).max(axis=(2, 3)) / size
    last = max(k for k in range(n) if not repeats(apart[: k + 1, k]))
    after = apart[last + 1 : last + 1 + n // 10, 0]  # back at the first pose soon after the last?
    closed = bool(after.size and after.min() <= SAME)
    end = last + 1 + int(after.argmin()) if closed else last
    way = np.cumsum(np.abs(np.diff(picture.inputs, prepend=picture.inputs[:, :1])).sum(axis=0))
    way = way if way[end] else np.arange(len(picture.x))  # a free motion: evenly in time
    wanted = np.linspace(0, way[end], count + closed)[:count]
    spread = np.abs(way[: end + 1, None] - wanted).argmin(axis=0)
    chosen: list[int] = []
    for k in spread.tolist():
        if all(apart[k, j] > SAME for j in chosen):
            chosen.append(k)
    return picture.at(chosen)


def repeats(apart: Array) -> bool:
    """Whether a pose was there before, and left since; `apart` is its distance to all until it."""
    left_since = np.maximum.accumulate(apart[::-1])[::-1]
    return bool(((apart <= SAME) & (left_since > 2 * SAME)).any())


def clearest(picture: Picture) -> int:
    """The pose that bears the names: its joints are far from each other and not in one line."""
    if not picture.marks:
        return len(picture.x) - 1
    at = np.stack([m.at for m in picture.marks], axis=1)
    apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)
    always = apart.max(axis=0) < 1e-6 * (np.ptp(at) or 1.0)
    nearest = np.where(always, np.inf, apart).min(axis=(1, 2))
    across = np.linalg.svd(at - at.mean(axis=1, keepdims=True), compute_uv=False)[:, -1]
    return int((np.minimum(nearest, np.ptp(at)) * across).argmax())
