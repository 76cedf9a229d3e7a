"""The work-precision diagram and its page, drawn from made-up tables."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from proofmass.base.errors import InputError
from proofmass.report.style import FIXED_LOOKS, RC
from proofmass.studies.record import StudyRow
from proofmass.studies.trade.figure import (
    FRONT_STYLE,
    other_parameters_figure,
    planned_steps,
    series_looks,
    spread_texts,
    trade_figure,
)
from proofmass.studies.trade.page import write_trade
from proofmass.studies.trade.trade import Trade, write_study
from proofmass.studies.trade.verdict import Verdict, pareto_front
from tests.studies.trade.trade_rows import example_study, series_rows, series_verdicts

NAN = float("nan")


def draw_diagram(rows: list[StudyRow], verdicts: list[Verdict]) -> Figure:
    """The work-precision diagram, drawn so that its texts have their sizes."""
    with rc_context(RC):
        figure = trade_figure(rows, verdicts, series_looks(rows))
    figure.draw_without_rendering()
    return figure


def annotation_texts(ax) -> list[str]:
    """The texts of the annotations of a panel."""
    return [t.get_text() for t in ax.texts if isinstance(t, Annotation)]


@pytest.fixture(scope="module")
def figure() -> Figure:
    return draw_diagram(*example_study())


def test_each_kind_of_quantity_has_a_row_of_panels(figure: Figure) -> None:
    assert [ax.get_title("left") for ax in figure.axes] == [
        "position",
        "",
        "velocity",
        "",
        "acceleration",
        "",
    ]
    assert figure.axes[-2].get_xlabel() == "processor time of the run [s]"
    assert all("share of the range" in ax.get_ylabel() for ax in figure.axes[::2])
    assert (
        {ax.get_xscale() for ax in figure.axes}
        == {ax.get_yscale() for ax in figure.axes}
        == {"log"}
    )


def test_rods_are_drawn_over_their_segments() -> None:
    rows = [
        StudyRow(
            "trade",
            "rod",
            "equilibrium",
            "mujoco",
            "MuJoCo, segments",
            "segments",
            n,
            {"segments": n},
            {"position": 1.0 / n**2},
            seconds=1e-3 * n,
            steps=1,
        )
        for n in (10, 20, 40)
    ]
    verdicts = [
        replace(v, case="rod", series="MuJoCo, segments") for v in series_verdicts("", 2.0)[:1]
    ]
    left, right = draw_diagram(rows, verdicts).axes
    assert list(right.lines[0].get_xdata()) == [10, 20, 40]
    assert right.get_xlabel() == "segments"
    foot, _, far = np.array(right.patches[0].get_xy())[:3]
    assert far[0] / foot[0] == 2.0
    assert left.get_xlabel() == "processor time of the run [s]"


def test_no_two_lines_look_the_same() -> None:
    looks = series_looks(example_study()[0])
    assert len({(look.marker, look.dash) for look in looks.values()}) == len(looks) == 12
    for (engine, name), look in looks.items():
        assert look.colour == FIXED_LOOKS[engine + ":default" * ("defaults" in name)].colour
    euler = {look.marker for (_, name), look in looks.items() if " Euler" in name}
    assert len(euler) == 1


def test_the_legend_covers_no_panel_and_no_text_is_cut_off(figure: Figure) -> None:
    """The legend is above the panels, and all texts are inside the figure."""
    legend = figure.legends[0].get_window_extent()
    whole = figure.bbox
    assert legend.x1 <= whole.x1
    for ax in figure.axes:
        assert ax.get_tightbbox().y1 <= legend.y0
        for text in ax.texts:
            box = text.get_window_extent()
            assert whole.x0 <= box.x0
            assert box.x1 <= whole.x1


def test_texts_of_causes_do_not_overlap(figure: Figure) -> None:
    for ax in figure.axes[1::2]:
        boxes = sorted(
            (t.get_window_extent() for t in ax.texts if t.get_window_extent().x0 > ax.bbox.x1),
            key=lambda box: box.y0,
        )
        assert len(boxes) >= 3
        assert all(one.y1 <= two.y0 for one, two in pairwise(boxes))


def test_the_front_has_the_settings_that_no_other_setting_beats(figure: Figure) -> None:
    """The Pareto front has the settings that no other one beats in both time and error.

    All pairs of settings are compared.  The front's line has a corner for each of these settings,
    and their markers are filled.
    """
    rows = [row for row in example_study()[0] if row.outcome == "ran"]
    best = pareto_front(rows, "position")
    for row in rows:
        beaten = any(
            o.seconds <= row.seconds
            and o.errors["position"] <= row.errors["position"]
            and o is not row
            for o in rows
        )
        assert (row in best) == (not beaten)
    stairs = next(one for one in figure.axes[0].lines if one.get_color() == FRONT_STYLE["color"])
    assert len(stairs.get_xdata()) == len(best)
    filled = sum(
        len(one.get_xdata())
        for one in figure.axes[0].lines
        if one.get_linestyle() == "None" and one.get_marker() not in ("x", "_")
    )
    assert filled == len(best)


def test_slope_triangles_have_the_expected_orders(figure: Figure) -> None:
    slopes = []
    for patch in figure.axes[1].patches:
        (x, top), (_, foot), (far, _) = patch.get_path().vertices[:3]
        slopes.append(np.log(top / foot) / np.log(far / x))
    assert sorted(slopes) == pytest.approx([1.0, 2.0, 4.0])


def test_an_order_that_no_line_shows_has_no_slope_triangle() -> None:
    figure = draw_diagram(
        series_rows("flat", order=1.0, scale=1e-6, floor=1e-3), series_verdicts("flat", 4.0)
    )
    assert not figure.axes[1].patches


def test_error_floors_are_ticks_with_their_causes(figure: Figure) -> None:
    ticks = [float(one.get_ydata()[0]) for one in figure.axes[0].lines if one.get_marker() == "_"]
    assert sorted(ticks) == pytest.approx([2e-9, 3e-8, *(2e-4 * (1 + k / 10) for k in range(5))])
    causes = " ".join(annotation_texts(figure.axes[1])).replace("\n", " ")
    assert "softness of the loop (a c e g i)" in causes
    assert "3e-8 cap of solimp (h)" in causes


def test_failures_are_crosses_at_the_upper_edge(figure: Figure) -> None:
    """A failed run is a cross over the number of steps that it should have made.

    The run diverged and has no steps; its motion takes 6.28 s and its time step is 16 ms.  Its wall
    time is not known, so that it is not drawn over the processor time.
    """
    left, right = ([one for one in ax.lines if one.get_marker() == "x"] for ax in figure.axes[:2])
    assert not left
    assert [one.get_xdata()[0] for one in right] == pytest.approx([6.28 / 0.016], abs=1)
    failed = StudyRow("", "", "", "", "", "", 0.0, {"timestep": 0.1}, outcome="diverged")
    assert planned_steps(failed, [failed]) == 0.0


def test_a_study_with_failed_runs_only_can_be_drawn() -> None:
    rows = [
        replace(row, outcome="crashed", errors={}, seconds=NAN, steps=0)
        for row in series_rows("failed")
    ]
    assert len(draw_diagram(rows, []).axes) == 2


def test_other_parameters_are_drawn_from_coarse_to_fine() -> None:
    rows = [
        StudyRow(
            "",
            "",
            "",
            "mujoco",
            "solref",
            "solref",
            v,
            errors={"velocity": v},
            steps=9,
            seconds=1.0,
        )
        for v in (0.04, 0.02, 0.01)
    ]
    with rc_context(RC):
        (ax,) = other_parameters_figure(rows, series_looks(rows)).axes
    assert ax.xaxis_inverted()
    assert ax.get_xlabel() == "time constant, solref [s]"
    assert list(ax.lines[0].get_xdata()) == [0.04, 0.02, 0.01]


def test_spread_texts_keep_their_distances() -> None:
    moved = spread_texts([0.0, 0.0, 0.0, 0.9], [0.1, 0.2, 0.1, 0.1])
    assert np.diff(moved) == pytest.approx([0.15, 0.15, 0.6])


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rows, verdicts = example_study()
    other = [replace(row, case="watt") for row in series_rows("Euler")]
    also = [replace(v, case="watt") for v in series_verdicts("Euler", 1.0)]
    folder = tmp_path_factory.mktemp("study")
    write_study(Trade([*rows, *other], rows[:1], [*verdicts, *also]), folder)
    return write_trade(folder, folder / "page").first


def test_pages_and_files_of_a_trade_study_are_written(page: Path) -> None:
    names = {file.name for file in page.parent.iterdir()}
    assert {
        "index.html",
        "fourbar-dynamics-trade.html",
        "watt-dynamics-trade.html",
        "trade.csv",
        "floors.csv",
        "verdicts.json",
        "figures",
    } <= names
    for stem in ("fourbar-dynamics-trade", "watt-dynamics-trade"):
        for ending in (".svg", ".png"):
            assert (page.parent / "figures" / (stem + ending)).stat().st_size > 1000
    assert "http" not in page.read_text().replace("http://www.w3.org", "")


def test_the_page_of_a_case_recommends_settings(page: Path) -> None:
    text = (page.parent / "fourbar-dynamics-trade.html").read_text()
    assert "Position within 1e-5 of its range" in text
    assert "MuJoCo RK4, solref 8 dt, timestep" in text
    assert "defaults never get there" in text
    assert "keeps series a, c, e, g, i at 2e-4 to 2.8e-4 of the range" in text
    assert "the loops are open by 0.3 m" in text  # message of the run that failed
    assert "halving solref divides the error by 4.0" in text
    assert "least of up to 5 in rounds" in text


def test_a_folder_without_a_trade_study_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="proofmass trade CASE writes it"):
        write_trade(tmp_path, tmp_path)
