"""The small drawing of a mechanism on the index, and the poses with which its script moves it."""

from base64 import b64encode
from dataclasses import dataclass
from html import escape

import numpy as np
from markupsafe import Markup

from proofmass.base.arrays import Array
from proofmass.report.mechanism import clearest_pose
from proofmass.sim.picture import Picture

MAX_POSES = 30
MAX_BYTES, MIN_POSES = 2400, 12
"""Size of all poses of a drawing [bytes], and the least number of poses.

A drawing with many points has fewer poses, so that it has this size at most."""
MAX_OUTLINE_POINTS = 26
"""Largest number of points of an outline; of longer ones, such as rims, some are left out."""
THUMBNAIL_WIDTH, THUMBNAIL_HEIGHT, THUMBNAIL_MARGIN = 248, 168, 16
"""Size and margin of the drawing in whole steps, which fit a byte; the page shows a third of it."""
MAX_JOINTS = 14  # largest number of joints that are drawn: the signs of more would hide the links


@dataclass(frozen=True)
class Thumbnail:
    """A mechanism at some poses, in whole steps of the drawing.

    Attributes
    ----------
    sizes : list of int
        Number of points of each outline; an outline of more than two points is closed.
    points : ndarray of bytes (poses, points, 2)
        Points of the outlines, then the joints [px].
    joints : list of tuple of str and bool
        Kind of each joint, whether it is driven, and whether it is on the ground.
    still : list of ndarray (k, 2)
        Outlines of the ground [px].
    guides : list of ndarray (2, 2)
        Guides of slides on the ground [px].
    shown : int
        Index of the pose that is drawn while the drawing does not move.
    """

    sizes: list[int]
    points: Array
    joints: list[tuple[str, bool, bool]]
    still: list[Array]
    guides: list[Array]
    shown: int

    @property
    def data(self) -> dict[str, object]:
        """The data with which the script moves the drawing; points are bytes in base64, by pose."""
        return {
            "sizes": self.sizes,
            "joints": len(self.joints),
            "poses": len(self.points),
            "shown": self.shown,
            "points": b64encode(self.points.astype(np.uint8).tobytes()).decode(),
        }

    def svg(self, name: str) -> Markup:
        """Return the drawing at the pose `shown`."""
        words = [f'<path class="ground area" d="{outline_path(o, True)}"/>' for o in self.still]
        words += [f'<path class="ground" d="{outline_path(g, False)}"/>' for g in self.guides]
        here, first = self.points[self.shown], 0
        for size in self.sizes:
            kind = "link area" if size > 2 else "link"
            path = outline_path(here[first : first + size], size > 2)
            words.append(f'<path class="{kind}" d="{path}"/>')
            first += size
        for (kind, driven, grounded), (x, y) in zip(self.joints, here[first:], strict=True):
            foot = '<path class="ground" d="M0 0l-9 15h18z"/>' if grounded else ""
            sign = (
                '<rect x="-6" y="-6" width="12" height="12"/>'
                if kind == "slide"
                else '<circle r="5.5"/>'
            )
            state = "joint driven" if driven else "joint"
            words.append(f'<g class="{state}" transform="translate({x} {y})">{foot}{sign}</g>')
        return Markup(
            f'<svg class="thumbnail" viewBox="0 0 {THUMBNAIL_WIDTH} {THUMBNAIL_HEIGHT}" '
            f'data-name="{escape(name)}" aria-hidden="true">{"".join(words)}</svg>'
        )


def outline_path(points: Array, closed: bool) -> str:
    """Return an outline as an SVG path.

    >>> outline_path(np.array([[1, 2], [3, 4], [5, 6]]), True)
    'M1 2 3 4 5 6Z'
    """
    return "M" + " ".join(str(int(v)) for v in points.ravel()) + "Z" * closed


def reduce_picture(whole: Picture) -> Thumbnail:
    """Reduce a picture to some of its poses, evenly over the run, in whole steps."""
    sizes = [thin_outline(o).shape[1] for link in whole.links for o in link.outlines]
    points = sum(sizes) + len(whole.marks)
    poses = int(np.clip(MAX_BYTES // max(2 * points, 1), MIN_POSES, MAX_POSES))
    chosen = np.unique(np.linspace(0, len(whole.x) - 1, poses).round().astype(int))
    few = whole.at(chosen.tolist())
    outlines = [thin_outline(o) for link in few.links for o in link.outlines]
    marks = [m for m in few.marks if m.kind != "clamp"]
    guides = [m.guide for m in few.marks if m.guide is not None and m.ground]
    everything = [*outlines, *(m.at[:, None] for m in marks), *guides]
    cloud = np.concatenate([points.reshape(-1, 2) for points in everything])
    low, high = np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0)
    span = np.maximum(high - low, 1e-3 * ((high - low).max() or 1.0))
    room = np.array([THUMBNAIL_WIDTH, THUMBNAIL_HEIGHT])
    scale = float(((room - 2 * THUMBNAIL_MARGIN) / span).min())
    middle = 0.5 * (low + high)

    def steps(points: Array) -> Array:
        """Convert places to whole steps of the drawing, whose y points down."""
        flipped = (points - middle) * scale * np.array([1.0, -1.0])
        found: Array = np.clip(np.nan_to_num((flipped + room / 2).round()), 0, 255).astype(np.uint8)
        return found

    shown = marks if len(marks) <= MAX_JOINTS else []
    moving = [*outlines, *(m.at[:, None] for m in shown)]
    return Thumbnail(
        sizes=[o.shape[1] for o in outlines],
        points=steps(np.concatenate(moving, axis=1)),
        joints=[(m.kind, m.driven, m.ground and m.kind != "slide") for m in shown],
        still=[steps(o[0]) for o in few.ground.outlines],
        guides=[steps(guide[0]) for guide in guides],
        shown=clearest_pose(few),
    )


def thin_outline(outline: Array) -> Array:
    """Reduce an outline (poses, points, 2) to at most `MAX_OUTLINE_POINTS` points, evenly."""
    return outline[:, :: -(-outline.shape[1] // MAX_OUTLINE_POINTS)]
