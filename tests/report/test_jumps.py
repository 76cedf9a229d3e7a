"""Jumps of curves, which are distinguished from steep curves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.numerics import TURN
from proofmass.case.case import Case
from proofmass.report import data
from proofmass.report.data import Jumps, plotted_run, reference_jumps, solver_jumps
from proofmass.report.figures import draw_curve, thin_path
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.curves import Curves
from tests.report.whole import result_from_references
from tests.shipped import shipped

SAMPLES = np.linspace(0.0, 1.0, 41)
JUMP_SAMPLE = 20.3  # number of the sample at which curves jump: between samples 20 and 21


@pytest.fixture(scope="module")
def fourbar() -> Case:
    return load_case(shipped("fourbar.toml"))


CURVE_SHAPES = {
    "step": lambda s: np.where(s < JUMP_SAMPLE, 0.1 * s, 10.0 + 0.1 * s),
    "steep": lambda s: 0.1 * s + 5.0 * np.tanh((s - JUMP_SAMPLE) / 0.2),
    "fold": lambda s: (
        0.1 * s - 5.0 * np.sqrt(np.maximum(JUMP_SAMPLE + 0.6 - s, 0.0)) * (s < JUMP_SAMPLE + 0.6)
    ),
    "turn": lambda s: (0.02 * (s - JUMP_SAMPLE) + np.pi) % TURN - np.pi + TURN * (s > JUMP_SAMPLE),
}


def find_reference_jumps(
    monkeypatch: pytest.MonkeyPatch, case: Case, channel: str, law: str, kind: str = "sweep"
) -> Jumps:
    """Find the jumps of a reference with one channel, a curve of `CURVE_SHAPES`.

    The curves of `CURVE_SHAPES` are functions of the sample's number.
    """

    def curves(x: np.ndarray) -> Curves:
        return Curves(x, {channel: np.asarray(CURVE_SHAPES[law](x * 40.0))})

    monkeypatch.setattr(data, "evaluate", lambda case, kind, x, state: curves(x))
    return reference_jumps(case, kind, curves(SAMPLES), curves(SAMPLES))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("law", "channel", "found"),
    [
        ("step", "pin.x", Jumps((20,))),  # a position: the mechanism jumps, and all curves with it
        ("step", "pin_velocity.x", Jumps((), {"pin_velocity.x": (20,)})),
        ("steep", "pin.x", Jumps()),
        ("fold", "pin.x", Jumps()),
        ("turn", "rocker", Jumps((), {"rocker": (20,)})),  # a whole turn leads to the same pose
    ],
)
def test_only_a_jump_remains_one_step_at_finer_samples(
    law: str, channel: str, found: Jumps, fourbar: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    curve = CURVE_SHAPES[law](np.arange(41.0))
    assert data.suspected_jumps(curve, float(np.ptp(curve)) or 1.0) == [20]
    assert find_reference_jumps(monkeypatch, fourbar, channel, law) == found


def test_in_dynamics_a_position_jumps_without_other_curves(
    fourbar: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = find_reference_jumps(monkeypatch, fourbar, "pin.x", "step", "dynamics")
    assert found == Jumps((), {"pin.x": (20,)})
    assert found.of("pin.x") == [20]
    assert found.of("pin.y") == []


def test_a_solver_jumps_with_its_reference_or_where_that_has_no_step(fourbar: Case) -> None:
    def sampled(law: str, later: float = 0.0) -> Curves:
        return Curves(SAMPLES, {"pin.x": np.asarray(CURVE_SHAPES[law](np.arange(41.0) - later))})

    step, steep = sampled("step"), sampled("steep")
    known = Jumps((20,))
    assert solver_jumps(fourbar, "sweep", step, step, known) == known
    for later in (1, 3):
        late = sampled("step", later)
        assert solver_jumps(fourbar, "sweep", late, step, known) == Jumps((20 + later,))
    assert solver_jumps(fourbar, "sweep", steep, steep, Jumps()) == Jumps()
    smooth = replace(step, channels={"pin.x": 0.1 * np.arange(41.0)})
    assert solver_jumps(fourbar, "sweep", smooth, step, known) == Jumps()


def test_a_snap_is_found_and_smooth_curves_have_no_jumps(fourbar: Case) -> None:
    snap = load_case(shipped("rod_snap.toml"))
    run = plotted_run(result_from_references(snap, off=1e-4), snap, "sweep")
    assert run.jumps == Jumps((15, 36))
    assert run.jumps_of == {"mujoco:settled": Jumps((15, 36)), "pymunk": Jumps((15, 36))}
    result = result_from_references(fourbar)
    for kind in fourbar.run:
        run = plotted_run(result, fourbar, kind)
        assert not any(one.every() for one in (run.jumps, *run.jumps_of.values()))


def test_rounding_errors_of_a_zero_channel_are_no_jumps() -> None:
    """Rounding errors of a channel that is zero are not taken for jumps.

    A channel of this balancer is zero, and its rounding errors have 26 steps.
    """
    case = load_case(shipped("balancer_progressive_locked.toml"))
    run = plotted_run(result_from_references(case), case, "sweep")
    assert not run.jumps.every()


def test_figures_interrupt_a_curve_at_a_jump(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from proofmass.report.style import solver_looks

    ax = Figure().subplots()
    x, y = np.arange(10.0), np.where(np.arange(10) < 5, 0.0, 1.0)
    draw_curve(ax, x, y, solver_looks(["pymunk"])["pymunk"], jumps=[4])
    assert [line.get_xdata().tolist() for line in ax.lines] == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]
    path = thin_path(np.column_stack([x, y]), 99, [4])
    assert np.isnan(path[5]).all()
    assert path[[4, 6]].tolist() == [[4, 0], [5, 1]]
