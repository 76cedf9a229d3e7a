"""Charts of two rods on one pin: all equilibria and how they are drawn."""

import re

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.analytic.rods import rod_pair
from proofmass.analytic.rods.rod_pair import MAX_SHOWN_DIRECTIONS, divide_into_panels
from proofmass.base.errors import InputError
from proofmass.case.case import Case
from proofmass.reference.charts import compute_chart
from proofmass.report.charts import chart_figure
from proofmass.report.style import RC
from proofmass.run.sidecar import load_case
from tests.report.test_chart_figure import bold_lines, dashed_lines
from tests.shipped import shipped

NATURAL = shipped("rfr2_natural.toml")


@pytest.fixture(scope="module")
def natural() -> Case:
    return load_case(NATURAL)


@pytest.fixture(scope="module")
def equilibria(natural: Case) -> Chart:
    return compute_chart(natural, natural.chart[0])


@pytest.fixture(scope="module")
def figure(equilibria: Chart) -> Figure:
    with rc_context(RC):
        drawn = chart_figure("Title", equilibria)
        drawn.draw_without_rendering()
    return drawn


def posture_lines(chart: Chart) -> list[ChartLine]:
    """Lines of the chart that are rods, without those that are points."""
    return [line for line in chart.lines if not line.points]


def test_four_of_34_are_stable_and_share_a_panel(equilibria: Chart, figure: Figure) -> None:
    lines = posture_lines(equilibria)
    assert len(lines) == 34
    assert sum(line.stable for line in lines) == 4
    assert [len(bold_lines(ax)) for ax in figure.axes] == [4] + 8 * [0]
    assert sum(len(dashed_lines(ax)) for ax in figure.axes) == 30
    assert equilibria.caption.startswith("34 equilibria whose rods have up to 3 inflections, ")


def energies_of_curves(panel: Panel, stiffness: float) -> np.ndarray:
    """V of each posture: the energy from the length of its 120 chords, less the work of the load.

    A chord is shorter than its arc h of curvature kappa by h (h kappa)^2 / 24, so that all chords
    together are shorter than 2 m by U h^2 / (12 EI).
    """
    *lines, pins, _ = panel.lines
    lacking = [2.0 - np.hypot(np.diff(line.x), np.diff(line.y)).sum() for line in lines]
    return 12 * 60**2 * stiffness * np.array(lacking) - 0.3 * pins.x + 0.1 * pins.y


def test_postures_are_two_rods_from_clamp_to_clamp(equilibria: Chart) -> None:
    """Each posture leads from one clamp to its pin, its middle point, and to the other clamp."""
    for panel in equilibria.panels:
        *lines, pins, clamps = panel.lines
        assert clamps.x.tolist() == [-0.3, 0.3]
        for line, pin in zip(lines, np.stack([pins.x, pins.y], 1), strict=True):
            points = np.stack([line.x, line.y], axis=1)
            assert points[[0, -1]].tolist() == [[-0.3, 0.0], [0.3, 0.0]]
            # constraint violation of 1e-12 times e^alpha, alpha up to 20; 1e-3 would be visible
            assert np.abs(points[60] - pin).max() < 1e-6
            assert np.abs(points[59:62] - points[60]).max() < 1 / 60


def test_energies_are_those_of_the_curves(equilibria: Chart, natural: Case) -> None:
    """Energies in labels and titles of panels are those of the drawn curves, in rising order."""
    stiffness = float(natural.parameters["stiffness"])
    for panel in equilibria.panels:
        found = energies_of_curves(panel, stiffness)
        printed = [
            float(re.search(r"at (\S+) J", line.label)[1])
            for line in panel.lines
            if line.stable and not line.points
        ]
        printed = printed or [
            float(s) for s in re.search(r": (\S+) to (\S+) J", panel.title).groups()
        ]
        # next term (h kappa)^2 / 80 with kappa up to 34 /m, 0.4 %, and three digits, 0.5 %
        np.testing.assert_allclose(
            found if len(printed) == 4 else found[[0, -1]], printed, rtol=9e-3
        )
        assert np.all(np.diff(found) > 0)


def test_the_case_is_the_stable_one_of_least_energy(equilibria: Chart, natural: Case) -> None:
    """Newton's method from the sidecar's first guess finds the lowest equilibrium of the search."""
    known = rod_pair.solve(np.linspace(0.0, 1.0, 61), **natural.parameters)
    line = equilibria.panels[0].lines[0]
    np.testing.assert_allclose(line.x[:61], known["x1"], atol=1e-9, rtol=0)
    np.testing.assert_allclose(line.y[:59:-1], known["y2"], atol=1e-9, rtol=0)
    assert "modes 1 and 2" in line.label


def test_more_inflections_add_equilibria_and_keep_the_stable_ones(
    natural: Case, equilibria: Chart
) -> None:
    """The three equilibria of mode 1 are among those of modes up to 3, with the same labels."""
    few = natural.chart[0].model_copy(update={"parameters": {"modes": 1}})
    less = compute_chart(natural.model_copy(update={"chart": (few,)}), few)
    assert len(posture_lines(less)) == 3
    assert {line.label for line in posture_lines(less)} < {
        line.label for line in posture_lines(equilibria)
    }


def test_panels_have_few_equilibria_and_their_number_is_limited() -> None:
    """Panels have up to four equilibria of one number of negative directions.

    They have more if there would be more than twelve panels.
    """
    negative = np.repeat(np.arange(12), 9)
    panels = divide_into_panels(negative)
    assert len(panels) <= 12
    assert sorted(np.concatenate(panels).tolist()) == list(range(108))
    assert all(np.ptp(np.minimum(negative[which], MAX_SHOWN_DIRECTIONS)) == 0 for which in panels)
    assert [len(which) for which in divide_into_panels(np.zeros(9, int))] == [3, 3, 3]


def test_nothing_is_cut_off_and_nothing_overlaps(figure: Figure) -> None:
    low, high = np.zeros(2), figure.get_size_inches() * figure.dpi
    boxes = [ax.get_tightbbox() for ax in figure.axes]
    boxes += [figure.legends[0].get_window_extent(), figure.texts[0].get_window_extent()]
    assert all((box.min >= low).all() and (box.max <= high).all() for box in boxes)
    assert not any(one.overlaps(two) for k, one in enumerate(boxes) for two in boxes[:k])


def test_invalid_modes_in_a_sidecar_are_an_input_error(natural: Case) -> None:
    wrong = natural.chart[0].model_copy(update={"parameters": {"modes": 0}})
    with pytest.raises(InputError, match="modes must be 1, 2"):
        compute_chart(natural.model_copy(update={"chart": (wrong,)}), wrong)
