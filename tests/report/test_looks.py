"""Twelve solvers in a figure differ in colour, and in dash pattern and marker without colour."""

from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.markers import MarkerStyle

from proofmass.report.figures import (
    draw_curve,
    draw_legend_above,
    legend_height,
    marker_start,
    solver_handles,
)
from proofmass.report.style import PALETTE, RC, contrast, engine_hatches, solver_looks
from proofmass.report.svg_markers import LINE_CONTRAST, MARKER_PATHS, page_tones
from proofmass.sim.engines import hosted_names
from proofmass.studies.trade.figure import coloured_solver, series_looks
from tests.studies.trade.trade_rows import series_rows

UNKNOWN = [f"engine{k}" for k in range(12)]
HOSTED = ["mujoco", "pymunk", "recorded", *hosted_names()][:12]
MIXED = ["mujoco", "mujoco:default", "pymunk", "pymunk:default", *UNKNOWN[:8]]
TWELVE = pytest.mark.parametrize("names", [UNKNOWN, HOSTED, MIXED], ids=["twins", "own", "mixed"])
MIN_DISTANCE = 20.0
"""Least distance of two colours in CIE Lab; about 2 is just noticed of areas that touch."""
DICHROMACY = {
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
}
"""Linear RGB without red or green cones (Machado, Oliveira and Fernandes 2009)."""


def lab(colour: str, seen: list[list[float]] | None = None) -> np.ndarray:
    """CIE Lab of a colour of sRGB for the white D65, as seen through a matrix on linear RGB."""
    parts = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    if seen:
        linear = np.clip(np.array(seen) @ linear, 0.0, 1.0)
    matrix = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    share = np.array(matrix) @ linear / [0.9505, 1.0, 1.0888]
    root = np.where(share > (6 / 29) ** 3, np.cbrt(share), share / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * root[1] - 16, 500 * (root[0] - root[1]), 200 * (root[1] - root[2])])


def least_distance(colours: list[str], seen: list[list[float]] | None = None) -> float:
    """The least distance of any two of some colours in CIE Lab."""
    places = [lab(colour, seen) for colour in colours]
    return min(float(np.linalg.norm(one - other)) for one, other in combinations(places, 2))


def test_the_distance_of_colours_is_that_of_cie_lab() -> None:
    assert lab("#ffffff") == pytest.approx([100.0, 0.0, 0.0], abs=0.05)
    assert lab("#ff0000") == pytest.approx([53.2, 80.1, 67.2], abs=0.1)  # of any table of sRGB
    assert least_distance(["#000000", "#ffffff", "#ffffff"]) == 0.0


@TWELVE
def test_twelve_solvers_differ_in_colour_in_dash_pattern_and_in_marker(names: list[str]) -> None:
    looks = solver_looks(names).values()
    assert len(looks) == 12
    for part in ("colour", "dash", "marker", "number"):
        assert len({getattr(look, part) for look in looks}) == 12, part
    assert least_distance([look.colour for look in looks]) >= MIN_DISTANCE
    assert len({MARKER_PATHS[look.marker] for look in looks}) == 12  # on pages


def test_lines_stand_out_from_white_paper() -> None:
    for name, look in PALETTE.items():
        assert contrast(look.colour, "#ffffff") >= LINE_CONTRAST, name


def test_colours_of_pages_differ_on_light_and_on_dark_paper() -> None:
    tones = page_tones(look.colour for look in PALETTE.values()).values()
    assert least_distance([tone.light for tone in tones]) >= MIN_DISTANCE
    assert least_distance([tone.dark for tone in tones]) >= 15.0


@pytest.mark.parametrize("kind", DICHROMACY)
def test_spare_colours_differ_from_all_for_colour_blind_readers(kind: str) -> None:
    """Vermilion and the darker orange, of pymunk and its defaults, are nearer: 6 is noticed."""
    seen = DICHROMACY[kind]
    colours = [look.colour for look in PALETTE.values()]
    spare = [look.colour for name, look in PALETTE.items() if name.startswith("spare")]
    pairs = [(a, b) for a, b in product(spare, colours) if a != b]
    assert len(pairs) == 55
    assert min(least_distance([*pair], seen) for pair in pairs) >= 12.0
    assert least_distance(colours, seen) >= 6.0


def test_the_engines_of_proofmass_keep_their_colours() -> None:
    looks = solver_looks([*HOSTED, *UNKNOWN])
    assert (looks["mujoco"].colour, looks["pymunk"].colour) == ("#0072B2", "#D55E00")
    hosted = hosted_names()[: len(PALETTE) - 2]  # as many as there are colours beside these two
    alone = [solver_looks(["mujoco", "pymunk", name])[name] for name in hosted]
    assert alone == [solver_looks(["mujoco", "pymunk", *hosted])[name] for name in hosted]


def test_more_than_twelve_solvers_differ_in_colour_and_marks_together() -> None:
    names = [*UNKNOWN, *HOSTED, *(f"{name}:default" for name in UNKNOWN)]
    looks = solver_looks(names)
    assert len(looks) == len(names) == 36
    assert len({(look.colour, look.dash, look.marker) for look in looks.values()}) == 36
    assert {look.colour for look in looks.values()} == {one.colour for one in PALETTE.values()}


@TWELVE
def test_engines_have_hatches_of_their_own(names: list[str]) -> None:
    engines = [name for name in names if ":" not in name]
    hatches = engine_hatches(engines)
    assert sorted(hatches) == sorted(engines)
    assert len(set(hatches.values())) == len(engines)
    assert engine_hatches(["pymunk", *UNKNOWN])["pymunk"] == "////"


def test_series_of_twelve_engines_differ_in_colour_and_in_marker() -> None:
    rows = [
        replace(row, engine=name, parameters={**row.parameters, "defaults": defaults})
        for name in HOSTED
        for defaults in (False, True)
        for row in series_rows(f"{name} {defaults}")
        if name not in ("mujoco", "pymunk") or not defaults
    ]
    looks = series_looks(rows)
    assert {coloured_solver(row) for row in rows} == {*HOSTED}
    by_engine: dict[str, set[tuple[str, str]]] = {}
    for (engine, _), look in looks.items():
        by_engine.setdefault(engine, set()).add((look.colour, look.marker))
    assert [len(own) for own in by_engine.values()] == [1] * 12
    colours, markers = zip(*(next(iter(own)) for own in by_engine.values()), strict=True)
    assert len(set(colours)) == len(set(markers)) == 12
    assert len({(look.dash, look.marker) for look in looks.values()}) == len(looks) == 22


def test_coincident_curves_of_twelve_solvers_have_their_markers_at_different_points() -> None:
    every = 42  # points between two markers of a curve of 300
    starts = [marker_start(look, every) % every for look in PALETTE.values()]
    assert len(set(starts)) == 12
    assert np.diff(sorted(starts)).min() >= 3


def test_a_figure_of_twelve_has_lines_with_all_looks() -> None:
    ax, x = Figure().subplots(), np.linspace(0.0, 1.0, 301)
    for look in solver_looks(HOSTED).values():
        draw_curve(ax, x, np.sin(x), look)
    assert len(ax.lines) == 12
    shapes = [MarkerStyle(line.get_marker()) for line in ax.lines]
    outlines = {
        shape.get_path().transformed(shape.get_transform()).vertices.tobytes() for shape in shapes
    }
    assert len(outlines) == len({line.get_color() for line in ax.lines}) == 12
    patterns = {str(line._unscaled_dash_pattern) for line in ax.lines}
    assert len(patterns) == 12


def test_the_legend_of_twelve_solvers_is_in_lines_inside_the_figure() -> None:
    """Figures make room for its lines; a legend that fits is one line, as before."""
    labels = ["reference", *HOSTED]
    width, more = 6.46, legend_height(labels, 6.46)
    assert (legend_height(labels[:4], width), more) == (0.0, pytest.approx(3 * 0.17))
    with rc_context(RC):
        figure = Figure(figsize=(width, 4.0))
        draw_legend_above(figure, solver_handles(HOSTED, solver_looks(HOSTED)), 4.0)
        box = figure.legends[0].get_window_extent().transformed(figure.dpi_scale_trans.inverted())
    assert len(figure.legends[0].get_texts()) == 12
    assert box.x1 <= width
    assert box.y0 >= 4.0 - 0.3 - more
