"""Tests of the drawing of a mechanism: its poses, its lines, and the index of a report."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.batch.check import Result
from proofmass.case.drive import Steady
from proofmass.reference.evaluate import evaluate
from proofmass.report import write_report
from proofmass.report.case_figures import find_motions, mechanism_poses
from proofmass.report.families import group_cards
from proofmass.report.svg import compact_svg
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.motion import motion
from proofmass.sim.picture import solid_outline
from proofmass.sim.protocol.run import Drive, Run
from tests.shipped import MODELS, shipped

MODEL_WITHOUT_GEOMS = """<mujoco>
  <worldbody>
    <body name="arm">
      <joint name="hub" axis="0 1 0"/>
      <inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="rod" pos="2 0 0">
        <joint name="knee" axis="0 1 0"/>
        <inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>
        <site name="tip" pos="1.5 0 0"/>
      </body>
    </body>
    {more}
  </worldbody>
  <sensor><framepos name="tip" objtype="site" objname="tip"/></sensor>
</mujoco>"""


def test_drawn_poses_equal_the_closed_form() -> None:
    case = load_case(shipped("fourbar.toml"))
    motions, note = find_motions(case, [])
    shape = mechanism_poses(case, motions)
    assert shape is not None
    assert note == ""
    assert np.degrees(shape.inputs[0]) == pytest.approx([0, 60, 120, 180, 240, 300])
    truth = evaluate(
        case, "sweep", shape.x, (shape.inputs, np.ones_like(shape.inputs), 0 * shape.inputs)
    )
    pin = next(m for m in shape.marks if m.kind == "pin")
    # Newton closes the loop to 1e-13 m
    assert pin.at == pytest.approx(
        np.stack([truth.channels["pin.x"], truth.channels["pin.y"]], axis=1), abs=1e-11
    )
    assert [m.name for m in shape.marks if m.driven] == ["crank"]
    assert [m.name for m in shape.marks if m.ground] == ["crank", "rocker"]


def test_an_oscillating_drive_is_drawn_over_half_a_period() -> None:
    case = load_case(shipped("triple_rocker.toml"))
    shape = mechanism_poses(case, find_motions(case, [])[0])
    assert shape is not None
    assert shape.inputs[0, [0, -1]] == pytest.approx([-2, 2])
    spacing = np.diff(shape.inputs[0])
    # evenly spaced over the drive's range, not over time, as far as the computed poses allow: there
    # are 60 for half a cosine, with a largest spacing of pi/120 of the range
    assert np.abs(spacing - spacing.mean()).max() <= np.pi / 120 * spacing.sum()


def test_bodies_without_geoms_are_lines_between_their_joints(tmp_path: Path) -> None:
    (tmp_path / "bare.xml").write_text(MODEL_WITHOUT_GEOMS.format(more=""))
    run = Run("dynamics", np.linspace(0, 0.1, 3), ())
    shape = motion(tmp_path / "bare.xml", run, {}).picture
    assert shape.axes == ("x", "z")
    assert [np.ptp(link.outlines[0][0], axis=0) for link in shape.links] == [
        pytest.approx([2.0, 0.0]),
        pytest.approx([1.5, 0.0]),
    ]


def test_a_sprung_joint_is_drawn_in_equilibrium(tmp_path: Path) -> None:
    text = MODEL_WITHOUT_GEOMS.replace('"knee"', '"knee" stiffness="2" springref="20"').format(
        more=""
    )
    (tmp_path / "bare.xml").write_text(
        text.replace("<worldbody>", '<option gravity="0 0 0"/><worldbody>')
    )
    profile = Steady(0.0, 1.0, x_is_time=False)
    run = Run("sweep", np.linspace(0, 1, 5), (), (Drive("hub", profile),))
    shape = motion(tmp_path / "bare.xml", run, {}).picture
    arm, rod = (np.diff(link.outlines[0], axis=1)[:, 0] for link in shape.links)
    bend = arm[:, 0] * rod[:, 1] - arm[:, 1] * rod[:, 0], (arm * rod).sum(axis=1)
    assert (shape.stopped, len(shape.x)) == ("", 5)
    # about +y, so clockwise in the drawing; Newton ends within 1e-8 rad of the equilibrium
    assert np.degrees(np.arctan2(*bend)) == pytest.approx(np.full(5, -20.0), abs=1e-6)


def test_moving_rods_are_drawn_bent() -> None:
    """The drawn slider is where the reference has it.

    A straight coupler would push it 6e-3 m further.
    """
    case = load_case(shipped("slider_crank_elastic.toml"))
    drawn = motion(case.model_path, plan_run(case, "dynamics", "mujoco"), {}, 13).picture
    assert not drawn.stopped
    rate = 6.0 * np.ones((1, 13))
    truth = evaluate(case, "dynamics", drawn.x, (drawn.inputs, rate, 0.0 * rate))
    pin = next(m for m in drawn.marks if m.kind == "pin")
    assert pin.at[:, 0] == pytest.approx(truth.channels["slider.x"], abs=1e-4)


def test_a_mechanism_that_leaves_the_plane_is_drawn_from_a_side(tmp_path: Path) -> None:
    (tmp_path / "bare.xml").write_text(
        MODEL_WITHOUT_GEOMS.format(
            more='<body><joint name="askew" axis="1 0 0"/><geom size="1"/></body>'
        )
    )
    (tmp_path / "bare.toml").write_text(shipped("pendulum.toml").read_text(encoding="utf-8"))
    case = load_case(tmp_path / "bare.toml")
    page = (
        write_report(Result(cases=[case]), tmp_path)
        .with_name("bare.html")
        .read_text(encoding="utf-8")
    )
    assert "The mechanism is not drawn" not in page
    drawing = (tmp_path / "figures" / "bare-mechanism.svg").read_text(encoding="utf-8")
    assert ">x [m]</text>" in drawing
    assert '"along":"' in page


def test_the_outline_of_a_cylinder_has_both_edges() -> None:
    """The outline has a straight line from rim to rim at both edges, in two directions of view."""
    size = np.array([0.3, 0.5, 0.0])
    for view in (np.array([0.0, 1.0, 0.0]), np.array([0.6, -0.8, 0.0])):
        line = solid_outline(mujoco.mjtGeom.mjGEOM_CYLINDER, size, view)
        sides = np.roll(line, -1, axis=0) - line
        along = np.isclose(np.abs(sides[:, 2]), 2 * size[1])
        assert along.sum() == 2
        across = np.cross(view, [0.0, 0.0, 1.0])
        assert np.sort(line[along] @ across) == pytest.approx([-0.3, 0.3])


def test_the_index_is_grouped_by_folder_and_reference_with_failures_first() -> None:
    names = (
        "hacksaw_recorded",
        "rfr3",
        "pendulum",
        "hacksaw",
        "fourbar",
        "fivebar",
        "balancer_sine",
    )
    cases = [load_case(shipped(f"{name}.toml")) for name in names]
    cards = [{"name": c.name, "state": "bad" if c.name == "pendulum" else "good"} for c in cases]
    found = group_cards(cases, cards, [MODELS])
    assert [(f["name"], f["state"]) for f in found] == [
        ("linkages", "bad"),
        ("balancers", "good"),
        ("rods", "good"),
    ]
    assert [p["name"] for p in found[0]["parts"]] == [
        "pendulum",
        "fivebar",
        "fourbar",
        "hacksaw",
        "recorded curves",
    ]
    assert found[0]["parts"][-1]["what"] == "Measured, or computed by another program."
    assert [c["name"] for p in found[2]["parts"] for c in p["cards"]] == ["rfr3"]


def test_compact_svg_rounds_coordinates_but_not_texts() -> None:
    text = '<svg viewBox="0 0 9 9"><text x="1.234567">0.7783 J</text></svg>'
    assert compact_svg(text) == '<svg viewBox="0 0 9 9"><text x="1.23">0.7783 J</text></svg>'


def test_compact_svg_keeps_lines_to_the_last_digit() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 500, (200, 2))
    path_text = "M" + "L".join(f" {x:.6f} {y:.6f} \n" for x, y in points)
    short = compact_svg(f'<svg viewBox="0 0 9 9"><path d="{path_text}"/></svg>')
    start, steps = re.findall(r'd="M([^l]*)l([^"]*)"', short)[0]
    moves = np.array(re.findall(r"-?[\d.]+", steps), float).reshape(-1, 2)
    found = np.cumsum(np.vstack([np.array(start.split(), float), moves]), axis=0)
    # coordinates are rounded to tenths
    assert np.abs(found - points).max() <= 0.05 + 1e-9


def test_a_floor_is_drawn_below_a_free_body_without_guides() -> None:
    """The surface of the slope passes through its position, and it extends beyond the block."""
    run = Run("dynamics", np.linspace(0, 0.5, 6), ())
    shape = motion(shipped("block_slides.xml"), run, {}).picture
    (floor,) = shape.ground.outlines
    assert shape.marks == ()
    up = np.array([-np.sin(0.5), np.cos(0.5)])
    heights = floor[0] @ up
    assert np.sort(heights)[2:] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.sort(heights)[:2].max() < -1e-3
    block = shape.links[0].outlines[0]
    assert (block @ up).min() == pytest.approx(0.0, abs=1e-3)  # the contact is soft
    along = np.array([np.cos(0.5), np.sin(0.5)])
    assert (floor[0] @ along).min() < (block @ along).min() < (floor[0] @ along).max()
