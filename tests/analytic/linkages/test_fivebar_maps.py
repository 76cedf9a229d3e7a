"""Workspace of five-bar linkages: areas in two ways, singular curves as zeros with a new sign."""

from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

from proofmass.analytic.chart import Chart
from proofmass.analytic.linkages import fivebar
from proofmass.analytic.linkages.fivebar.maps import WORKING_MODE_PAIRS, reach_border
from proofmass.analytic.linkages.regions import PlaneRegion, join_regions
from tests.independent.linkages.reach import fivebar_margin

LINKS = {
    "thesis": fivebar.FivebarLengths(2.0, 3.5, 4.0, 1.0, 0.0, 2.0),
    "symmetric": fivebar.FivebarLengths(4.0, 5.0, 5.0, 4.0, -3.0, 3.0),
    "regular": fivebar.FivebarLengths(1.2, 2.6, 2.4, 1.0, -1.25, 1.25),
    "long cranks": fivebar.FivebarLengths(3.0, 2.0, 2.5, 1.5, 0.0, 2.2),
    "no inner circle": fivebar.FivebarLengths(2.0, 2.0, 3.0, 1.0, -1.0, 1.5),
}
EACH = pytest.mark.parametrize("link", LINKS.values(), ids=LINKS)
COUNTS = pytest.mark.parametrize("count", [24, pytest.param(60, marks=pytest.mark.slow)])


def random_links(count: int) -> list[fivebar.FivebarLengths]:
    """Random lengths with a workspace of more than 0.1 m^2."""
    rng = np.random.default_rng(12)
    found = []
    while len(found) < count:
        bars = rng.uniform(0.5, 3.0, 4)
        link = fivebar.FivebarLengths(*bars.tolist(), 0.3, 0.3 + float(rng.uniform(0.3, 4.0)))
        if fivebar.reach_area(link) > 0.1:
            found.append(link)
    return found


singular_curves = cache(fivebar.type_2)


def coupler_sine(
    link: fivebar.FivebarLengths, tip: np.ndarray, mode: tuple[int, int]
) -> np.ndarray:
    """Sine of the angle between the couplers by the inverse problem; NaN out of reach."""
    found = np.full(tip.shape, np.nan)
    inside = fivebar_margin([tip.real, tip.imag], **asdict(link)) > 0.0
    where = tip[inside]
    found[inside] = fivebar.solve_inverse(
        [where.real, where.imag], **asdict(link), left_mode=mode[0], right_mode=mode[1]
    )["assembly"]
    return found


def reach(link: fivebar.FivebarLengths) -> list[PlaneRegion]:
    """Regions within the border of the reach."""
    return join_regions((piece for piece, _ in reach_border(link)), link.size)


def cell_centres(link: fivebar.FivebarLengths, n: int = 420) -> tuple[np.ndarray, float]:
    """Centres of cells that cover all reachable points, and the area of a cell."""
    x, y = (np.linspace(-1.0, 1.0, n + 1) for _ in range(2))
    half = link.size
    x, y = half * 0.5 * (x[1:] + x[:-1]), half * 0.5 * (y[1:] + y[:-1])
    keep = np.abs(x) < link.size
    z = (x[keep, None] + 0.5 * (link.left_x + link.right_x) + 1j * y).ravel()
    return z, (x[1] - x[0]) * (y[1] - y[0])


@EACH
def test_the_reach_is_the_overlap_of_two_rings(link: fivebar.FivebarLengths) -> None:
    area = sum(one.area for one in reach(link))
    assert area == pytest.approx(fivebar.reach_area(link), rel=1e-10)  # angles of corners: 1e-11
    tip, cell = cell_centres(link)
    counted = cell * np.sum(fivebar_margin([tip.real, tip.imag], **asdict(link)) > 0.0)
    assert area == pytest.approx(counted, rel=6e-3)  # cells of 1/420 along a border


@COUNTS
def test_aspects_of_random_linkages_add_up_to_the_reach(count: int) -> None:
    for link in random_links(count):
        whole = fivebar.reach_area(link)
        assert sum(one.area for one in reach(link)) == pytest.approx(whole, rel=1e-9)
        singular = singular_curves(link)
        for mode in WORKING_MODE_PAIRS:
            found = fivebar.aspects(link, mode, singular)
            assert sum(one.area for some in found.values() for one in some) == pytest.approx(
                whole, rel=1e-8
            )


@EACH
@pytest.mark.parametrize("mode", WORKING_MODE_PAIRS)
def test_aspects_have_the_sign_of_the_inverse_problem(
    link: fivebar.FivebarLengths, mode: tuple[int, int]
) -> None:
    tip, cell = cell_centres(link)
    sine = coupler_sine(link, tip, mode)
    found = fivebar.aspects(link, mode, singular_curves(link))
    for sign in (1, -1):
        counted = cell * np.sum(sign * sine > 0.0)
        # along borders of about six radii the errors of the cut cells average to less than this
        assert sum(one.area for one in found[sign]) == pytest.approx(
            counted, abs=3e-3 * fivebar.reach_area(link)
        )


def test_a_wrong_length_changes_areas_by_more_than_the_tolerance() -> None:
    link = LINKS["thesis"]
    tip, cell = cell_centres(link)
    counted = cell * np.sum(coupler_sine(link, tip, (1, 1)) > 0.0)
    for name in ("left_crank", "left_coupler", "right_coupler", "right_crank", "right_x"):
        wrong = replace(link, **{name: 1.03 * asdict(link)[name]})
        area = sum(one.area for one in fivebar.aspects(wrong, (1, 1))[1])
        assert abs(area - counted) > 3e-3 * fivebar.reach_area(link), name


@EACH
def test_coupler_sine_changes_sign_across_type_2_curves_of_its_mode(
    link: fivebar.FivebarLengths,
) -> None:
    pieces = singular_curves(link)
    assert bool(pieces) is (link is not LINKS["regular"])  # its couplers are never in line
    for one in pieces:
        tip = one.curve.points
        a, b = tip - one.left, tip - one.right
        sine = np.imag(np.conj(a) * b) / (link.left_coupler * link.right_coupler)
        assert np.abs(sine).max() < 1e-12
        for pin, x, crank, arm, coupler in (
            (one.left, link.left_x, link.left_crank, a, link.left_coupler),
            (one.right, link.right_x, link.right_crank, b, link.right_coupler),
        ):
            # at the ends of the angles a right one of arccos near +-1 has half the digits
            assert np.abs(np.abs(pin - x) - crank).max() < 1e-12 * link.size
            assert np.abs(np.abs(arm) - coupler).max() < 1e-12 * link.size
        tangent = np.gradient(tip)
        middle = slice(tip.size // 3, -(tip.size // 3))
        across = 1e-4 * link.size * 1j * (tangent / np.abs(tangent))[middle]
        length = np.abs(np.diff(tip)).sum()
        if length < 0.05 * link.size:  # at a border the other sign is narrower than 1e-4
            continue
        left, right = (
            coupler_sine(link, tip[middle] + step, one.mode) for step in (across, -across)
        )
        reachable = np.isfinite(left) & np.isfinite(right)
        assert reachable.mean() > 0.8
        assert (left[reachable] > 0.0).all()
        assert (right[reachable] < 0.0).all()


@COUNTS
def test_coupler_sine_is_positive_left_of_random_type_2_curves(count: int) -> None:
    seen = 0
    for link in random_links(count):
        for one in singular_curves(link):
            k = one.curve.points.size // 2
            tip, tangent = one.curve.points[k], one.curve.points[k + 1] - one.curve.points[k - 1]
            across = 1e-6j * link.size * tangent / abs(tangent)
            sines = coupler_sine(link, np.array([tip + across, tip - across]), one.mode)
            if np.isfinite(sines).all():  # both within the reach
                assert sines[0] > 0.0 > sines[1]
                seen += 1
    assert seen > 5 * count


@EACH
def test_margin_changes_sign_across_type_1_curves(link: fivebar.FivebarLengths) -> None:
    for piece, _ in reach_border(link):
        tip = piece.points
        inside = fivebar_margin([tip.real, tip.imag], **asdict(link))
        assert np.abs(inside).max() < 1e-12 * link.size
        tangent = np.gradient(tip)
        across = 1e-3 * 1j * (tangent / np.abs(tangent))
        middle = slice(tip.size // 4, -(tip.size // 4))
        for step, sign in ((across, 1.0), (-across, -1.0)):
            z = (tip + step)[middle]
            assert (sign * fivebar_margin([z.real, z.imag], **asdict(link)) > 0.0).all()


def bar_lengths(chart: Chart, label: str, panel: int) -> np.ndarray:
    """Lengths of the bars of a label in a panel."""
    (line,) = [one for one in chart.panels[panel].lines if one.label == label]
    z = line.x + 1j * line.y
    lengths = np.abs(np.diff(z))
    return lengths[np.isfinite(lengths)]


@pytest.mark.parametrize(
    ("name", "x", "y"), [("thesis", 1.0, 4.0), ("symmetric", 0.5, 7.5), ("long cranks", 1.0, 2.2)]
)
def test_eight_poses_of_a_tip_close_their_loops(name: str, x: float, y: float) -> None:
    link = LINKS[name]
    chart = fivebar.working_modes(**asdict(link), tip_x=x, tip_y=y)
    assert len(chart.panels) == 4
    cranks = [link.left_crank, link.right_crank]
    couplers = [link.left_coupler, link.right_coupler]
    others = set()
    for k in range(4):
        assert np.abs(bar_lengths(chart, "cranks", k) - cranks).max() < 1e-12
        assert np.abs(bar_lengths(chart, "couplers", k) - couplers).max() < 1e-12
        assert np.abs(bar_lengths(chart, "other assembly", k) - couplers).max() < 1e-12
        (other_couplers,) = [one for one in chart.panels[k].lines if one.label == "other assembly"]
        others.add((round(other_couplers.x[1], 6), round(other_couplers.y[1], 6)))
    assert len(others) == 4  # each has another position of the tip in the other assembly
    assert len({panel.title for panel in chart.panels}) == 4


@EACH
def test_singular_pairs_of_angles_are_singular_in_the_direct_problem(
    link: fivebar.FivebarLengths,
) -> None:
    chart = fivebar.crank_angles(**asdict(link))
    for mode, panel in zip((1, -1), chart.panels, strict=True):
        for line in panel.lines:
            angle = np.array([line.x, line.y])[:, np.isfinite(line.x)]
            pins = np.array([[link.left_x], [link.right_x]]) + np.array(
                [[link.left_crank], [link.right_crank]]
            ) * np.exp(1j * angle)
            apart = np.abs(pins[1] - pins[0])
            c, r = link.left_coupler, link.right_coupler
            if line.label.startswith("type 2"):
                bound = c + r if "stretched" in line.label else abs(c - r)
                assert np.abs(apart - bound).max() < 1e-11 * link.size
                continue
            inside = (apart < (c + r) * (1 - 1e-6)) & (apart > abs(c - r) + 1e-6)
            pose = fivebar.solve(angle[:, inside], **asdict(link), mode=mode)
            side = "left" if "left" in line.label else "right"
            assert np.abs(pose[f"{side}_working"]).max() < 1e-5  # root of rounding, 1e-8; c/C


@pytest.mark.parametrize(("name", "kinds"), [("thesis", 5), ("symmetric", 6), ("long cranks", 6)])
def test_singular_poses_have_their_bars_in_line(name: str, kinds: int) -> None:
    link = LINKS[name]
    chart = fivebar.singular_poses(**asdict(link))
    assert len(chart.panels) == kinds  # the left side of the thesis' linkage never folds
    for k, panel in enumerate(chart.panels):
        lines = {line.label: line.x + 1j * line.y for line in panel.lines}
        assert (
            np.abs(bar_lengths(chart, "cranks", k) - [link.left_crank, link.right_crank]).max()
            < 1e-12
        )
        left, tip, right = lines["couplers"]
        triples = {
            "type 1: left": (link.left_x, left, tip),
            "type 1: right": (link.right_x, right, tip),
            "type 2: couplers": (left, tip, right),
        }
        (at,) = [z for name, z in triples.items() if panel.title.startswith(name)]
        turned = np.imag(np.conj(at[1] - at[0]) * (at[2] - at[1]))
        assert abs(turned) < 1e-6 * link.size**2  # square root of rounding


def test_areas_on_the_chart_are_those_of_the_aspects() -> None:
    link = LINKS["symmetric"]
    chart = fivebar.workspace(**asdict(link), path=(0.0, 5.0, 1.0, 5.0, 1.0, 6.0))
    for mode, panel in zip(WORKING_MODE_PAIRS, chart.panels, strict=True):
        areas = [one.area for some in fivebar.aspects(link, mode).values() for one in some]
        assert sorted(region.area for region in panel.regions) == pytest.approx(sorted(areas))
        path = next(line for line in panel.lines if line.label == "path of the tip")
        assert (path.x[-1], path.y[-1]) == (0.0, 5.0)
    assert "142.221 m²" in chart.caption
    with pytest.raises(ValueError, match="pairs x, y, got 3 numbers"):
        fivebar.workspace(**asdict(link), path=(0.0, 5.0, 1.0))
    with pytest.raises(ValueError, match="x, y and radius, got 2 numbers"):
        fivebar.workspace(**asdict(link), circle=(0.0, 5.0))
    circle_lines = fivebar.workspace(**asdict(link), circle=(0.5, 6.0, 1.5)).panels[0].lines
    path = next(line for line in circle_lines if line.label == "path of the tip")
    assert np.hypot(path.x - 0.5, path.y - 6.0) == pytest.approx(1.5)
