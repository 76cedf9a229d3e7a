"""What a planar mechanism looks like at some poses of a run: lines, polygons and joints."""

from dataclasses import dataclass, replace

from proofmass.analytic.numerics import Array


@dataclass(frozen=True)
class Link:
    """A rigid body; `outlines` are lines and closed polygons (poses, points, 2) [m]."""

    name: str
    outlines: tuple[Array, ...]


@dataclass(frozen=True)
class Mark:
    """A joint or a loop: `kind` is hinge, slide, pin or clamp; `at` is where, (poses, 2) [m].

    A slide also has its guide's ends, (poses, 2, 2): as far as it is travelled during the run; a
    clamp has itself and a point ahead on the rod.
    """

    name: str
    kind: str
    at: Array
    driven: bool = False
    ground: bool = False
    guide: Array | None = None


@dataclass(frozen=True)
class Picture:
    """A mechanism at some poses.

    Attributes
    ----------
    axes : tuple of str
        The two world axes that span the drawing; empty names when the plane is inclined.
    x, inputs : ndarray (poses,), (drives, poses)
        The run's parameter and the drives.
    ground, links, marks
        What there is to draw; everything has `poses` along its first axis.
    tracks : tuple of str
        Sensors that record a place in the world, whose paths may be drawn beside it.
    stopped : str
        Why there are no poses beyond the last.
    """

    axes: tuple[str, str]
    x: Array
    inputs: Array
    ground: Link
    links: tuple[Link, ...]
    marks: tuple[Mark, ...]
    tracks: tuple[str, ...] = ()
    stopped: str = ""

    def at(self, poses: list[int]) -> "Picture":
        """The same with these poses only."""
        def cut(link: Link) -> Link:
            return replace(link, outlines=tuple(o[poses] for o in link.outlines))
        marks = tuple(replace(m, at=m.at[poses], guide=None if m.guide is None else m.guide[poses])
                      for m in self.marks)
        return replace(self, x=self.x[poses], inputs=self.inputs[:, poses], marks=marks,
                       ground=cut(self.ground), links=tuple(map(cut, self.links)))
