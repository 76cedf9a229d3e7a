"""The figure of a chart: styles of lines, fields and regions, scales, axes, and the legend."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.colors import to_hex

from proofmass.analytic.chart import Chart, ChartLine, ChartRegion, Field, Panel
from proofmass.report.charts import (
    MAX_LINE_POINTS,
    MAX_PANEL_RATIO,
    MIN_PANEL_RATIO,
    chart_figure,
    label_looks,
    line_style,
    thin_line,
)
from proofmass.report.figures import save
from proofmass.report.style import FIXED_LOOKS, RC


def draw_panels(*panels: Panel, **changed: object):
    """The axes of a drawn chart with these panels, without the axes of colour bars."""
    chart = Chart(("x", "m"), ("y", "m"), panels, "Caption.")
    with rc_context(RC):
        figure = chart_figure("Title", replace(chart, **changed))
    figure.draw_without_rendering()
    return figure.axes[: len(panels)]


def bold_lines(ax) -> list:
    """The solid lines that are wider than 1.5 points."""
    return [line for line in ax.lines if line.get_linestyle() == "-" and line.get_linewidth() > 1.5]


def dashed_lines(ax) -> list:
    """The dashed lines that are narrower than 1 point."""
    return [
        line for line in ax.lines if line.get_linestyle() == "--" and line.get_linewidth() < 1.0
    ]


def legend_texts(ax) -> list[str]:
    """The texts of the figure's legend."""
    return [text.get_text() for text in ax.figure.legends[0].get_texts()]


def bump_line(x0: float = 0.0) -> ChartLine:
    """A parabola above x0."""
    x = np.linspace(0.0, 1.0, 11)
    return ChartLine(x, x0 + x * (1 - x), "a bump")


def test_stable_lines_are_bold_and_unstable_lines_are_thin_and_dashed() -> None:
    (ax,) = draw_panels(Panel((bump_line(), bump_line(1.0), replace(bump_line(2.0), stable=False))))
    assert (len(bold_lines(ax)), len(dashed_lines(ax))) == (2, 1)
    assert dashed_lines(ax)[0].get_ydata().min() == 2.0
    assert dashed_lines(ax)[0].get_zorder() < bold_lines(ax)[0].get_zorder()
    # the lines share one label, so the legend explains the styles
    assert legend_texts(ax) == ["a bump", "stable", "unstable"]
    (ax,) = draw_panels(Panel((bump_line(), replace(bump_line(2.0), stable=False, label="else"))))
    assert legend_texts(ax) == ["a bump", "else"]  # the labels distinguish stable from unstable


def test_nan_interrupts_a_line() -> None:
    x = np.array([0.0, 1.0, np.nan, 2.0, np.inf, 3.0])
    (ax,) = draw_panels(Panel((ChartLine(x, np.ones(6)),)))
    path = ax.lines[0].get_path()
    assert np.isnan(path.vertices[[2, 4]]).all()
    strokes = [len(p) for p in path.cleaned(remove_nans=True).to_polygons(closed_only=False)]
    assert strokes[0] == 2  # from 0 to 1
    assert ax.get_xlim() == pytest.approx((-0.09, 3.09))  # a range of 3, and 3 % of it at both ends


def test_long_lines_are_thinned_and_keep_the_ends_of_their_pieces() -> None:
    t = np.linspace(0.0, 1.0, 20_000)
    y = np.where((t > 0.3) & (t < 0.31), np.nan, np.sin(9 * t))
    thinned = thin_line(ChartLine(t, y))
    # the number of points is rounded up for each piece
    assert MAX_LINE_POINTS <= len(thinned) <= MAX_LINE_POINTS + 6
    finite, finite_thinned = np.isfinite(y), np.isfinite(thinned[:, 1])
    ends = t[np.flatnonzero(np.diff(finite))], thinned[np.flatnonzero(np.diff(finite_thinned)), 0]
    assert ends[0][0] == ends[1][0]  # the last point before the gap
    assert thinned[-1, 0] == 1.0
    # the error of chords of length 1/500, y'' h^2 / 8 = 81 / (8 * 500^2), is 4.1e-5
    assert (
        np.abs(
            np.interp(t[finite], thinned[finite_thinned, 0], thinned[finite_thinned, 1]) - y[finite]
        ).max()
        < 5e-5
    )
    assert len(thin_line(ChartLine(t, y, points=True))) == t.size


def test_points_are_filled_if_stable_and_hollow_if_not() -> None:
    at = np.zeros(1)
    (ax,) = draw_panels(
        Panel(
            (
                ChartLine(at, at, "fold", points=True),
                ChartLine(np.arange(9.0), np.ones(9), "saddle", stable=False, points=True),
            )
        )
    )
    fold, saddle = ax.lines
    assert len(saddle.get_xdata()) == 9
    assert fold.get_markevery() is saddle.get_markevery() is None  # every point has a marker
    assert fold.get_linestyle() == saddle.get_linestyle() == "None"
    assert to_hex(fold.get_markerfacecolor()) == to_hex(fold.get_color())
    assert to_hex(saddle.get_markerfacecolor()) == "#ffffff"
    assert fold.get_marker() != saddle.get_marker()


def test_labels_differ_with_and_without_colour_and_from_solvers() -> None:
    lines = [replace(bump_line(), label=f"{k}", stable=k % 2 > 0) for k in range(12)]
    looks = label_looks(Chart(("x", "m"), ("y", "m"), (Panel(tuple(lines)),), ""))
    assert len({(look.colour, look.dash) for look in looks.values()}) == 12
    # without colour unstable lines differ by five dash patterns, stable ones by six markers
    assert len({looks[f"{k}"].dash for k in range(0, 10, 2)}) == 5
    assert len({line_style(lines[k], looks[f"{k}"])["marker"] for k in range(1, 12, 2)}) == 6
    (ax,) = draw_panels(Panel(tuple(lines)))
    marked = [line.get_markevery()[0] for line in ax.lines if line.get_marker() != "None"]
    # lines that follow each other have their markers at different ones of the 11 points
    assert marked == [1, 0, 1, 0, 1, 0]
    assert not {look.colour for look in looks.values()} & {
        look.colour for look in FIXED_LOOKS.values()
    }


def test_angles_are_in_degrees_and_pure_numbers_without_unit() -> None:
    (ax,) = draw_panels(
        Panel((ChartLine(np.array([0.0, np.pi]), np.array([0.0, 2.0])),)),
        x=("turn", "rad"),
        y=("R / R_cr", ""),
    )
    assert ax.get_xlabel() == "turn [deg]"
    assert ax.lines[0].get_xdata()[-1] == pytest.approx(180.0)
    assert {30.0, 90.0, 180.0} <= set(ax.get_xticks().round(9))
    assert ax.get_ylabel() == "R / R_cr"


@pytest.mark.parametrize(
    ("high", "tall"), [(0.7, 0.7), (0.0, MIN_PANEL_RATIO), (50.0, MAX_PANEL_RATIO)]
)
def test_panels_with_equal_scales_are_neither_too_flat_nor_too_tall(
    high: float, tall: float
) -> None:
    line = ChartLine(np.array([0.0, 1.0]), np.array([0.0, high]))
    first, second = draw_panels(
        Panel((line,)), Panel((bump_line(),)) if high else Panel(), equal_scales=True
    )
    assert first.get_xlim() == second.get_xlim()
    assert first.get_ylim() == second.get_ylim()
    inches = first.get_position().size * first.figure.get_size_inches()
    metres = [np.ptp(first.get_xlim()), np.ptp(first.get_ylim())]
    assert inches[1] / inches[0] == pytest.approx(tall)
    assert inches[0] / metres[0] == pytest.approx(inches[1] / metres[1])
    assert first.get_ylim()[1] >= high


@pytest.mark.parametrize(
    ("count", "grid"),
    [(1, (1, 1)), (2, (1, 2)), (3, (1, 3)), (4, (2, 2)), (5, (2, 3)), (9, (3, 3)), (12, (3, 4))],
)
def test_panels_form_a_grid_with_axis_labels_at_its_edges(
    count: int, grid: tuple[int, int]
) -> None:
    axes = draw_panels(*[Panel((bump_line(),), title=f"{k}") for k in range(count)])
    assert axes[0].get_gridspec().get_geometry() == grid
    assert [ax.get_title(loc="left") for ax in axes] == [f"{k}" for k in range(count)]
    assert sum(bool(ax.get_ylabel()) for ax in axes) == grid[0]
    assert sum(bool(ax.get_xlabel()) for ax in axes) == grid[1]


def saddle_field(unit: str = "1", *, signed: bool = True, times: float = 1.0) -> Field:
    """The field x - 2 y, whose zero line is along no grid line; it is NaN where x > 0.8."""
    x, y = np.linspace(-1.0, 1.0, 41), np.linspace(-0.4, 0.4, 31)
    values = times * (x[:, None] - 2 * y)
    values[x > 0.8] = np.nan
    return Field(x, y, values, "slope", unit, signed)


def zero_contours(ax) -> list[np.ndarray]:
    """The points of the bold contours, which are those at zero."""
    return [
        path.vertices
        for c in ax.collections
        if np.max(c.get_linewidth(), initial=0) > 1.5
        for path in c.get_paths()
    ]


def test_a_signed_field_has_a_line_where_it_is_zero() -> None:
    (ax,) = draw_panels(Panel(field=saddle_field()))
    points = np.concatenate(zero_contours(ax))
    assert len(points) > 20
    assert np.abs(points[:, 0] - 2 * points[:, 1]).max() < 1e-12  # exact, since the field is linear
    assert np.ptp(points[:, 1]) == pytest.approx(0.8)
    assert points[:, 0].max() < 0.8 + 1e-9
    assert legend_texts(ax) == ["zero of slope"]
    filled = ax.collections[0]
    assert filled.levels[0] == -filled.levels[-1]
    assert filled.cmap.name == "PuOr"
    below, above = filled.cmap(filled.norm([-0.1, 0.1]))
    assert np.abs(below - above).max() > 0.02  # the colours change at zero


def test_colours_match_the_values_and_change_at_zero() -> None:
    field = saddle_field()
    (ax,) = draw_panels(Panel(field=replace(field, values=field.values + 0.5)))
    filled = ax.collections[0]
    assert filled.levels[0] == -filled.levels[-1]  # though the values are not symmetric
    paths = filled.get_paths()
    assert len(paths) == len(filled.levels)  # a band between each two levels, and one beyond them
    for low, high, path in zip(filled.levels[:-1], filled.levels[1:], paths, strict=False):
        values = path.vertices[path.codes != path.CLOSEPOLY] @ [1.0, -2.0] + 0.5
        assert np.all((low - 1e-9 <= values) & (values <= high + 1e-9))


def test_a_field_without_sign_or_without_zero_has_no_zero_line() -> None:
    assert not zero_contours(draw_panels(Panel(field=saddle_field(signed=False)))[0])
    above = saddle_field()
    assert not zero_contours(draw_panels(Panel(field=replace(above, values=above.values + 5.0)))[0])


def test_nan_values_of_a_field_stay_white() -> None:
    (ax,) = draw_panels(Panel(field=saddle_field()))
    right = max(
        path.vertices[:, 0].max() for path in ax.collections[0].get_paths() if len(path.vertices)
    )
    assert right == pytest.approx(0.8)
    assert ax.get_xlim()[1] == pytest.approx(0.8 + 0.03 * 1.8)  # NaN does not extend the axis
    hollow = replace(saddle_field(), values=np.full((41, 31), np.nan))
    assert not draw_panels(Panel(field=hollow))[0].collections


def test_fields_of_one_label_share_their_levels_and_others_do_not() -> None:
    other = replace(saddle_field(times=100.0), label="other")
    one, two, three = draw_panels(
        *[Panel(field=f) for f in (saddle_field(), saddle_field(times=3.0), other)]
    )
    levels = [ax.collections[0].levels for ax in (one, two, three)]
    assert np.array_equal(levels[0], levels[1])
    assert levels[2][-1] > 20 * levels[0][-1]


def test_an_svg_with_an_empty_line_has_no_empty_groups(tmp_path: Path) -> None:
    (ax,) = draw_panels(
        Panel((ChartLine(np.full(3, np.nan), np.ones(3)), bump_line()), saddle_field())
    )
    ax.scatter([], [])  # empty, as contours between grid points may be
    svg = save(ax.figure, tmp_path / "figure", png=False)
    groups = [e for e in ElementTree.fromstring(svg).iter() if e.tag.endswith("}g")]
    assert groups
    assert all(len(group) for group in groups)


def triangle_field() -> Field:
    """The field x - 2 y over four triangles, which form a square that stands on a corner."""
    x, y = np.array([0.0, 1.0, 0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0, 0.0, -1.0])
    fans = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
    return Field(x, y, x - 2 * y, "slope", "1", signed=True, triangles=fans)


def test_a_field_over_triangles_ends_at_their_outline_and_has_a_zero_line() -> None:
    (ax,) = draw_panels(Panel(field=triangle_field()))
    points = np.concatenate([p.vertices for p in ax.collections[0].get_paths() if len(p.vertices)])
    assert np.abs(points).sum(axis=1).max() == pytest.approx(1.0)
    line = np.concatenate(zero_contours(ax))
    assert np.abs(line[:, 0] - 2 * line[:, 1]).max() < 1e-12
    assert legend_texts(ax) == ["zero of slope"]
    hollow = replace(triangle_field(), triangles=np.empty((0, 3), int))
    assert not draw_panels(Panel(field=hollow))[0].collections


def test_points_outside_all_triangles_do_not_extend_the_axes() -> None:
    field = triangle_field()
    more = replace(
        field,
        x=np.append(field.x, 9.0),
        y=np.append(field.y, 0.0),
        values=np.append(field.values, np.nan),
    )
    assert draw_panels(Panel(field=more))[0].get_xlim()[1] < 1.2


def test_a_pole_does_not_stretch_the_colour_scale() -> None:
    field = saddle_field()
    field.values[20, 15] = 1e9
    (ax,) = draw_panels(Panel(field=field))
    assert ax.collections[0].levels[-1] < 4.0
    assert ax.collections[0].extend in ("max", "both")


def test_a_colour_bar_has_name_and_unit_with_angles_in_degrees() -> None:
    (ax,) = draw_panels(Panel(field=saddle_field("rad/m")))
    bar = ax.child_axes[0]
    assert bar.get_ylabel() == "slope [deg/m]"
    assert bar.get_ylim()[1] > 50.0  # the largest value is 1.6 rad/m, 92 deg/m


def square_region(label: str, x0: float, half: float = 1.0, area: float = 4.0) -> ChartRegion:
    """A square region with its centre at (x0, 0) and sides of `2 half`."""
    corners = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return ChartRegion((corners + np.array([x0, 0.0]),), label, area)


def test_regions_of_one_label_are_alike_and_others_differ_in_colour_and_hatch() -> None:
    one, other = draw_panels(
        Panel(regions=(square_region("a", 0.0), square_region("b", 2.0))),
        Panel(regions=(square_region("a", 0.0),)),
    )
    first, second = one.patches
    assert first.get_facecolor() == other.patches[0].get_facecolor()
    assert first.get_facecolor() != second.get_facecolor()
    assert first.get_hatch() != second.get_hatch()
    assert legend_texts(one) == ["a", "b"]
    low, high = one.get_xlim()
    assert low < -1.0
    assert high > 3.0  # regions extend the axes


def test_the_area_is_written_into_a_region_that_has_room() -> None:
    large, small, hollow = (
        square_region("a", 0.0),
        square_region("a", 1.1, 0.05, 0.01),
        square_region("a", 3.0),
    )
    (ax,) = draw_panels(
        Panel(regions=(large, small, replace(hollow, area=float("nan")))), equal_scales=True
    )
    (text,) = ax.texts
    assert text.get_text() == "4 m²"
    assert np.abs(np.array(text.get_position())).max() < 0.1  # in the middle of the large square


def test_the_area_of_a_ring_is_not_written_into_its_hole() -> None:
    ring = square_region("a", 0.0)
    inner = ring.outlines[0][::-1] * 0.5
    (ax,) = draw_panels(
        Panel(regions=(replace(ring, outlines=(*ring.outlines, inner)),)), equal_scales=True
    )
    (text,) = ax.texts
    assert np.abs(np.array(text.get_position())).max() > 0.5


def test_bars_have_a_pin_at_each_point_and_overlapping_bars_are_visible() -> None:
    x = np.array([0.0, 1.0, np.nan, 2.0, 3.0])
    cranks, couplers = (ChartLine(x, x, label, bars=True) for label in ("cranks", "couplers"))
    ghost = ChartLine(x, x, "other", stable=False, bars=True)
    (ax,) = draw_panels(Panel((cranks, couplers, ghost)))
    thick, thin, pale = ax.lines
    assert thick.get_linewidth() > thin.get_linewidth() > 1.5 > pale.get_linewidth()
    assert thick.get_zorder() == thin.get_zorder() > pale.get_zorder()
    assert pale.is_dashed()
    assert {line.get_marker() for line in ax.lines} == {"o"}
    assert {line.get_markevery() for line in ax.lines} == {None}
    assert len(thick.get_xdata()) == 5
    assert legend_texts(ax) == ["cranks", "couplers", "other"]


def test_lines_stand_out_from_a_field() -> None:
    (ax,) = draw_panels(Panel((bump_line(),), saddle_field()))
    assert ax.lines[0].get_path_effects()
    assert not draw_panels(Panel((bump_line(),)))[0].lines[0].get_path_effects()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ChartLine(np.zeros(3), np.zeros(4)), r"got \(3,\) and \(4,\)"),
        (lambda: ChartLine(np.zeros((3, 2)), np.zeros((3, 2))), r"a line needs x \(n,\)"),
        (
            lambda: Field(np.zeros(3), np.zeros(4), np.zeros((4, 3)), "a", "m"),
            r"\(4, 3\) at \(3,\)",
        ),
        (
            lambda: Field(np.zeros(3), np.zeros(4), np.zeros(3), "a", "m", triangles=np.eye(3)),
            r"over triangles needs values, x and y \(k,\), got \(3,\) at \(3,\), \(4,\)",
        ),
        (lambda: ChartRegion((np.zeros((2, 5)),), "a"), r"points \(n, 2\), got \(2, 5\)"),
        (lambda: Chart(("x", "m"), ("y", "m"), (), ""), "1 to 12 panels, got 0"),
        (lambda: Chart(("x", "m"), ("y", "m"), (Panel(),) * 13, ""), "got 13"),
    ],
)
def test_invalid_parts_of_a_chart_are_refused_when_created(make, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_a_logarithmic_axis_spans_decades_and_leaves_zeros_out() -> None:
    count = np.arange(1.0, 6.0)
    sizes = np.array([1.0, 1e-2, 1e-4, 1e-8, 0.0])
    (ax,) = draw_panels(
        Panel((ChartLine(count, sizes, "error"),)), x=("iteration", ""), logarithmic=True
    )
    assert ax.get_yscale() == "log"
    low, top = np.log10(ax.get_ylim())
    # eight decades, and 3 % of them at both ends
    assert (low, top) == pytest.approx((-8.24, 0.24), abs=1e-9)
    assert all(tick == round(tick) for tick in ax.get_xticks())  # iterations are whole numbers
    (ax,) = draw_panels(Panel((ChartLine(count, sizes, "error"),)))
    assert ax.get_yscale() == "linear"
