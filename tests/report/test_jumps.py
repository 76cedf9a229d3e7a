"""Jumps of curves, which are distinguished from steep curves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.numerics import TURN
from proofmass.case import Case
from proofmass.report import data
from proofmass.report.data import Jumps, plotted_run, reference_jumps, solver_jumps
from proofmass.report.figures import draw_curve, thin_path
from proofmass.sidecar import load_case
from proofmass.sim.protocol import Curves
from tests.report.whole import whole_result
from tests.shipped import shipped

X = np.linspace(0.0, 1.0, 41)
HERE = 20.3  # number of the sample at which curves jump: between samples 20 and 21


@pytest.fixture(scope="module")
def fourbar() -> Case:
    return load_case(shipped("fourbar.toml"))


LAWS = {
    "step": lambda s: np.where(s < HERE, 0.1 * s, 10.0 + 0.1 * s),
    "steep": lambda s: 0.1 * s + 5.0 * np.tanh((s - HERE) / 0.2),
    "fold": lambda s: 0.1 * s - 5.0 * np.sqrt(np.maximum(HERE + 0.6 - s, 0.0)) * (s < HERE + 0.6),
    "turn": lambda s: (0.02 * (s - HERE) + np.pi) % TURN - np.pi + TURN * (s > HERE),
}


def reference(
    monkeypatch: pytest.MonkeyPatch, case: Case, channel: str, law: str, kind: str = "sweep"
) -> Jumps:
    """Find the jumps of a reference with one channel, a curve of `LAWS`.

    The curves of `LAWS` are functions of the sample's number.
    """

    def curves(x: np.ndarray) -> Curves:
        return Curves(x, {channel: np.asarray(LAWS[law](x * 40.0))})

    monkeypatch.setattr(data, "evaluate", lambda case, kind, x, state: curves(x))
    return reference_jumps(case, kind, curves(X), curves(X))  # type: ignore[arg-type]


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
def test_a_jump_stays_one_between_finer_samples(
    law: str, channel: str, found: Jumps, fourbar: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    curve = LAWS[law](np.arange(41.0))
    assert data.suspected_jumps(curve, float(np.ptp(curve)) or 1.0) == [20]
    assert reference(monkeypatch, fourbar, channel, law) == found


def test_in_a_motion_a_place_jumps_alone(fourbar: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    found = reference(monkeypatch, fourbar, "pin.x", "step", "dynamics")
    assert found == Jumps((), {"pin.x": (20,)})
    assert found.of("pin.x") == [20]
    assert found.of("pin.y") == []


def test_an_engine_jumps_where_its_reference_does_or_makes_no_such_step(fourbar: Case) -> None:
    def sampled(law: str, later: float = 0.0) -> Curves:
        return Curves(X, {"pin.x": np.asarray(LAWS[law](np.arange(41.0) - later))})

    step, steep = sampled("step"), sampled("steep")
    known = Jumps((20,))
    assert solver_jumps(fourbar, "sweep", step, step, known) == known
    for later in (1, 3):
        late = sampled("step", later)
        assert solver_jumps(fourbar, "sweep", late, step, known) == Jumps((20 + later,))
    assert solver_jumps(fourbar, "sweep", steep, steep, Jumps()) == Jumps()
    smooth = replace(step, channels={"pin.x": 0.1 * np.arange(41.0)})
    assert solver_jumps(fourbar, "sweep", smooth, step, known) == Jumps()


def test_a_snap_is_found_and_smooth_curves_have_none(fourbar: Case) -> None:
    snap = load_case(shipped("rod_snap.toml"))
    run = plotted_run(whole_result(snap, off=1e-4), snap, "sweep")
    assert run.jumps == Jumps((15, 36))
    assert run.jumps_of == {"mujoco:settled": Jumps((15, 36)), "pymunk": Jumps((15, 36))}
    result = whole_result(fourbar)
    for kind in fourbar.run:
        run = plotted_run(result, fourbar, kind)
        assert not any(one.every() for one in (run.jumps, *run.jumps_of.values()))


def test_what_is_zero_to_rounding_has_no_jumps() -> None:
    """Rounding errors of a channel that is zero are not taken for jumps.

    A channel of this balancer is zero, and its rounding errors have 26 steps.
    """
    case = load_case(shipped("balancer_progressive_locked.toml"))
    run = plotted_run(whole_result(case), case, "sweep")
    assert not run.jumps.every()


def test_figures_are_open_at_a_jump(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    from proofmass.report.style import solver_looks

    ax = Figure().subplots()
    x, y = np.arange(10.0), np.where(np.arange(10) < 5, 0.0, 1.0)
    draw_curve(ax, x, y, solver_looks(["pymunk"])["pymunk"], jumps=[4])
    assert [line.get_xdata().tolist() for line in ax.lines] == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]
    path = thin_path(np.column_stack([x, y]), 99, [4])
    assert np.isnan(path[5]).all()
    assert path[[4, 6]].tolist() == [[4, 0], [5, 1]]
