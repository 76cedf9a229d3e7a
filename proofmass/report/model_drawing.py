"""The drawing of a model without a sidecar: its start, where it is after a second, and its faults.

The drawing is made in the plane of a planar model, and otherwise in the plane of the two axes along
which the model is largest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.screen.finding import NamedElement
from proofmass.screen.pins import find_pins
from proofmass.screen.pose import RestPose
from proofmass.screen.short_run import run_from, start_key, start_of, steps_of_run
from proofmass.sim.mjcf import collected_warnings
from proofmass.sim.model_source import ModelSource
from proofmass.sim.picture import Link, Picture, PictureScene
from proofmass.sim.protocol.run import Run

PAPER_WIDTH, PAPER_HEIGHT, PAPER_MARGIN = 640.0, 420.0, 26.0
"""Size and margin of the drawing [px]."""
KEPT = ("qpos", "xpos", "xmat", "xanchor", "xaxis", "site_xpos")
FAR_FACTOR = 3.0
"""Largest distance of what is drawn from the start pose, in sizes of that: a body that falls out of
the drawing would make the model a dot."""
COVERED = 20.0
"""Distance within which two marks would cover each other [px]."""


@dataclass(frozen=True)
class ModelDrawing:
    """A drawing as SVG, with a sentence on what it shows."""

    svg: str
    words: str


@dataclass(frozen=True)
class Paper:
    """Where places of a picture lie on the drawing: scale [px/m] and middle [m]."""

    scale: float
    middle: Array

    def place(self, points: Array) -> Array:
        """Points (..., 2) [m] on the paper [px], whose y points down."""
        flipped = (points - self.middle) * self.scale * np.array([1.0, -1.0])
        return np.asarray(flipped + np.array([PAPER_WIDTH, PAPER_HEIGHT]) / 2.0)

    def path(self, points: Array) -> str:
        """A line, or a closed outline of more than two points, as an SVG path."""
        words = " ".join(f"{x:.1f} {y:.1f}" for x, y in self.place(points))
        return f"M{words}{'Z' if len(points) > 2 else ''}"


def draw_model(source: ModelSource, elements: Sequence[NamedElement | None]) -> ModelDrawing:
    """Draw a model with numbered marks at elements, where these have a place.

    Parameters
    ----------
    source : ModelSource
    elements : sequence of NamedElement or None
        The number of a mark is its place in the list, from 1.

    Raises
    ------
    BadModel
        The model cannot be compiled.
    Unsupported
        It has no joint.
    """
    model = source.read().model
    with collected_warnings():
        data = start_of(model, start_key(model))
        scene = PictureScene(model, data.qpos)
        marks = list(places_of(model, data, elements))
        poses = [{name: getattr(data, name).copy() for name in KEPT}]
        later, _ = run_from(model, data, steps_of_run(model.opt.timestep))
        if np.isfinite(later.qpos).all() and not later.warning.number.any():
            poses.append({name: getattr(later, name).copy() for name in KEPT})
    rows = {name: np.stack([pose[name] for pose in poses]) for name in KEPT}
    picture = scene.draw(rows, Run("passive", np.arange(len(poses), dtype=float), ()))
    flat = [(number, scene.flat(place)) for number, place in marks]
    svg = "".join(shapes(picture, flat, len(poses) - 1))
    axes = " and ".join(picture.axes) if all(picture.axes) else "its own plane"
    later_words = f"; pale: after {data.time:.3g} s" if len(poses) > 1 else ""
    numbers = " The numbers are those of the list." if flat else ""
    return ModelDrawing(
        f'<svg class="model" viewBox="0 0 {PAPER_WIDTH:g} {PAPER_HEIGHT:g}" role="img" '
        f'aria-label="{escape(source.file.name)} at its start">{svg}</svg>',
        f"The start, in {axes}{later_words}.{numbers}",
    )


def places_of(
    model: mujoco.MjModel, data: mujoco.MjData, elements: Sequence[NamedElement | None]
) -> Iterator[tuple[int, Array]]:
    """The numbers and places (3,) of the elements that have one [m]."""
    for number, element in enumerate(elements, 1):
        if element is not None:
            yield from ((number, place) for place in place_of(model, data, element))


def place_of(model: mujoco.MjModel, data: mujoco.MjData, element: NamedElement) -> list[Array]:
    """The places of a joint, body, geom, site, actuator of a joint, connect or weld [m]."""
    if element.kind in ("connect", "weld"):
        pose = RestPose(model, data.qpos, data.ctrl, data.act)
        wanted = number_of(model, "equality", element.name)
        return [pin.place for pin in find_pins(pose) if pin.equality == wanted][:1]
    number = number_of(model, element.kind, element.name)
    if number < 0:
        return []
    if element.kind == "actuator":
        if model.actuator_trntype[number] != mujoco.mjtTrn.mjTRN_JOINT:
            return []
        return [data.xanchor[model.actuator_trnid[number][0]].copy()]
    places = {"joint": "xanchor", "body": "xipos", "geom": "geom_xpos", "site": "site_xpos"}
    return [getattr(data, places[element.kind])[number].copy()] if element.kind in places else []


def number_of(model: mujoco.MjModel, kind: str, name: str) -> int:
    """The number of an element of a kind; -1 for none.  An element without a name has a number."""
    kind_of = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}", None)
    found = -1 if kind_of is None else mujoco.mj_name2id(model, kind_of, name)
    return int(name) if found < 0 and name.isdigit() else int(found)


def shapes(picture: Picture, marks: list[tuple[int, Array]], last: int) -> Iterator[str]:
    """The parts of the drawing: the ground, the last pose in pale, the start, joints and marks."""
    paper = fit_paper(picture, [place for _, place in marks], last)
    for outline in picture.ground.outlines:
        yield f'<path class="ground" d="{paper.path(outline[0])}"/>'
    for pose, kind in ((last, "later"), (0, "start"))[0 if last else 1 :]:
        for link in picture.links:
            yield from (f'<path class="{kind}" d="{p}"/>' for p in outline_paths(link, pose, paper))
    for mark in picture.marks:
        x, y = paper.place(mark.at[0])
        shape = (
            f'<rect class="joint" x="{x - 4:.1f}" y="{y - 4:.1f}" width="8" height="8"/>'
            if mark.kind == "slide"
            else f'<circle class="joint" cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>'
        )
        yield shape
    for numbers, (x, y) in joined_marks(paper, marks):
        half = 6.0 + 4.0 * len(numbers)
        yield (
            f'<g class="mark" transform="translate({x:.1f} {y:.1f})">'
            f'<rect x="{-half:g}" y="-10" width="{2 * half:g}" height="20" rx="10"/>'
            f'<text text-anchor="middle" dy="4">{numbers}</text></g>'
        )


def joined_marks(paper: Paper, marks: list[tuple[int, Array]]) -> Iterator[tuple[str, Array]]:
    """The numbers of marks that would cover each other as one text, and their place [px]."""
    groups: list[tuple[list[int], Array]] = []
    for number, place in marks:
        at = np.clip(
            paper.place(place),
            PAPER_MARGIN / 2,
            np.array([PAPER_WIDTH, PAPER_HEIGHT]) - PAPER_MARGIN / 2,
        )
        near = [numbers for numbers, other in groups if np.linalg.norm(other - at) < COVERED]
        if near:
            near[0].append(number)
        else:
            groups.append(([number], at))
    for numbers, at in groups:
        yield " ".join(map(str, numbers)), at


def outline_paths(link: Link, pose: int, paper: Paper) -> Iterator[str]:
    """The outlines of a body at a pose as SVG paths."""
    for outline in link.outlines:
        if np.isfinite(outline[pose]).all():
            yield paper.path(outline[pose])


def fit_paper(picture: Picture, marks: list[Array], last: int) -> Paper:
    """The scale at which the start pose, its marks, and the last pose if it is near, are drawn."""
    first = points_at(picture, 0)
    low, high = first.min(axis=0), first.max(axis=0)
    middle, size = (low + high) / 2.0, max(float((high - low).max()), 1e-9)
    others = [points_at(picture, last), *(mark[None] for mark in marks)]
    for points in others:
        if np.abs(points - middle).max() < FAR_FACTOR * size:
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    room = np.array([PAPER_WIDTH, PAPER_HEIGHT]) - 2.0 * PAPER_MARGIN
    scale = float((room / np.maximum(high - low, 1e-3 * size)).min())
    return Paper(scale, (low + high) / 2.0)


def points_at(picture: Picture, pose: int) -> Array:
    """All points (k, 2) of the bodies and joints of a picture at a pose [m]."""
    outlines = [outline[pose] for link in picture.links for outline in link.outlines]
    points = np.concatenate([*outlines, *(mark.at[pose][None] for mark in picture.marks)])
    return np.asarray(points[np.isfinite(points).all(axis=1)])
