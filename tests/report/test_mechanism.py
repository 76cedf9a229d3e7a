"""The figure of a mechanism at several poses: its legend has room, and no more than it needs."""

import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg

from proofmass.report.case_figures import find_motions, mechanism_poses
from proofmass.report.mechanism import mechanism_figure
from proofmass.report.style import RC
from proofmass.run.sidecar import load_case
from tests.shipped import shipped


@pytest.mark.parametrize("name", ["stewart", "fourbar", "balancer4_sine"])
def test_the_legend_fits_and_little_is_left_below_the_figure(name: str) -> None:
    """The legend of the Stewart platform has four lines for each pose."""
    case = load_case(shipped(f"{name}.toml"))
    motions, _ = find_motions(case, [])
    shape = mechanism_poses(case, motions)
    assert shape is not None
    with rc_context(RC):
        figure = mechanism_figure(case, shape, {})
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        legend = figure.legends[0].get_window_extent(canvas.get_renderer())
        axes = figure.axes[0].get_tightbbox(canvas.get_renderer())
    assert axes is not None
    assert legend.y0 >= 0.0
    assert axes.y0 >= 0.0
    # The labels of the axis take about 0.5 inch, for which 0.8 inch are kept.
    assert min(legend.y0, axes.y0) <= 0.5 * figure.dpi
