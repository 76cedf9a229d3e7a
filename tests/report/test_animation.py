"""Animations: drawings compared with closed forms, files that play, and reports of bad input."""

import io
from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from proofmass import Case, InputError, animate, compare, evaluate, load_case
from proofmass.analytic.linkages import fourbar
from proofmass.batch.check import Result, collect_outcomes, run_solver
from proofmass.commands.cli import app
from proofmass.reference.samples import run_samples
from proofmass.report.animation import AnimationFigure, is_closed, with_samples
from proofmass.report.case_figures import compute_motion, measured_curves
from proofmass.report.data import PlottedRun, plotted_run
from proofmass.run.solve import plan_run
from tests.shipped import shipped

POSE_COUNT = 13
LENGTHS = {"crank": 1.0, "coupler": 2.0, "ground": 3.0}


CRANK_ANGLES = np.linspace(0, 2 * np.pi, POSE_COUNT)


def run_animate(*args: object):
    """The result of ``proofmass animate`` with these arguments."""
    return CliRunner().invoke(app, ["animate", *map(str, args)])


def animation_figure(case: Case, magnify: float = 1.0, poses: int = POSE_COUNT) -> AnimationFigure:
    """The figure of the animation of a case's first run, in MuJoCo, at `poses` poses."""
    kind, solver = next(iter(case.run)), "mujoco"
    table = case.run[kind].model_copy(update={"solvers": (solver,), "n": poses})
    case = case.model_copy(update={"run": {kind: table}})
    result = Result(cases=[case])
    ran = run_solver(case, kind, solver, partial(compare, detectable=False))
    collect_outcomes([(case, kind, solver)], {0: ran}, result)
    view = plotted_run(result, case, kind)
    return AnimationFigure(
        case, [solver], compute_motion(case, kind, measured_curves(view), poses), {}, magnify
    )


@cache
def fourbar_figure() -> AnimationFigure:
    return animation_figure(load_case(shipped("fourbar.toml")))


@cache
def fourbar_animation() -> object:
    return animate(load_case(shipped("fourbar.toml")), solvers=["pymunk"], frames=6, seconds=0.6)


def outline_ends(figure: AnimationFigure, body: str) -> np.ndarray:
    """Both ends of a body's first outline, as drawn for the reference (poses, 2, 2) [m]."""
    drawn_bodies = [b.name for b in figure.motion.bodies for _ in b.outlines]
    return figure.strokes(figure.motion.places)[drawn_bodies.index(body)][:, :2]


def rocker_angle(rocker: float) -> np.ndarray:
    """The angle of the rocker by the closed form, at the crank angles of the poses [rad]."""
    found = fourbar.solve(
        CRANK_ANGLES, 0 * CRANK_ANGLES, 0 * CRANK_ANGLES, rocker=rocker, **LENGTHS
    )
    return np.asarray(found["rocker_angle"])


def test_bars_are_where_the_closed_form_has_them() -> None:
    figure = fourbar_figure()
    expected = {
        "crank": (0.0, np.exp(1j * CRANK_ANGLES)),
        "rocker": (3.0, 3.0 + 2.5 * np.exp(1j * rocker_angle(2.5))),
    }
    for body, (start, end) in expected.items():
        drawn_ends = outline_ends(figure, body)
        far = np.abs(drawn_ends[:, :, 0] + 1j * drawn_ends[:, :, 1] - start).argmax(axis=1)
        drawn_ends = np.where(far[:, None, None] == 1, drawn_ends, drawn_ends[:, ::-1])
        assert drawn_ends[:, 0] == pytest.approx(np.tile([start, 0.0], (POSE_COUNT, 1)), abs=1e-12)
        assert drawn_ends[:, 1] == pytest.approx(np.stack([end.real, end.imag], 1), abs=1e-12)


@pytest.mark.parametrize("magnify", [1.0, 10.0])
def test_differences_are_drawn_times_the_magnification(
    edit: Callable[..., Path], magnify: float
) -> None:
    """Differences to the reference are drawn times the magnification.

    The model has a rocker that is 1 % too long, which changes its angle by up to 8 mrad.  The angle
    is a channel of the case, so the drawing gets the difference from the measured curve.
    """
    edit("fourbar.xml", 'name="rocker_end" pos="2.5 0 0"', 'name="rocker_end" pos="2.525 0 0"')
    case = load_case(shipped("fourbar.toml"))
    figure = animation_figure(
        case.model_copy(update={"file": edit("fourbar.toml", "title", "title")}), magnify=magnify
    )
    reference, measured = (
        figure.places_of(party, np.arange(POSE_COUNT))[:, 2, 2] for party in ("", "mujoco")
    )
    expected = rocker_angle(2.525) - rocker_angle(2.5)
    assert np.abs(expected).max() > 7e-3
    assert measured - reference == pytest.approx(magnify * expected, abs=1e-6 * magnify)
    assert reference - reference[0] == pytest.approx(
        rocker_angle(2.5) - rocker_angle(2.5)[0], abs=1e-9
    )


def test_springs_wind_with_their_joints() -> None:
    """The ends of a spiral turn relative to each other by the deflection of the closed form."""
    figure = animation_figure(load_case(shipped("balancer_sine.toml")))
    case = figure.case
    run = plan_run(case, "sweep", "mujoco")
    reference = evaluate(case, "sweep", run.x, run.motion(run.x)).channels
    places = figure.motion.places
    springs, spots = figure.springs(), figure.spots(places)
    assert [figure.motion.spots[i].name for i in springs] == ["joint1", "joint2", "joint3"]
    for number, i in enumerate(springs, 1):
        at = spots[i][:, 0]
        coils = np.array([figure.coil(i, places[k], at[k]) for k in range(POSE_COUNT)])
        turned = np.unwrap(np.angle((coils - at[:, None]) @ [1, 1j]), axis=1)
        wound = turned[:, 0] - turned[:, -1]  # turn of the inner end; the model counts clockwise
        deflection = -reference[f"deflection{number}"]
        assert np.abs(deflection).max() > 0.3
        assert wound - wound[0] == pytest.approx(deflection, abs=1e-9)


def test_rods_bend_and_keep_their_length(edit: Callable[..., Path]) -> None:
    """The line of a rod keeps its length while the distance of its ends changes.

    The links of the chain are rigid.  Of each rod of 1 m with 4 links half a link, 1/8 m, belongs
    to the clamp, so the line has 7/8 m.
    """
    file = edit("rfr2_load_path.toml", r"segments = \d+", "segments = 4")
    figure = animation_figure(load_case(file), poses=3)
    lines = figure.strokes(figure.motion.places)[-2:]
    end_distances = []
    for line in lines:
        steps = np.linalg.norm(np.diff(line, axis=1), axis=2)
        assert steps.sum(axis=1) == pytest.approx(np.full(len(line), 1 - 1 / 8), rel=1e-9)
        end_distances.append(np.linalg.norm(line[:, -1] - line[:, 0], axis=1))
    assert np.ptp(end_distances, axis=1).min() > 1e-3  # the curvature changes along the motion


@pytest.mark.parametrize(
    ("ending", "form", "away"),
    # of 255: a GIF keeps the main colours of the drawing, and WebP blurs its lines
    [(".webp", "WEBP", 1.5), (".GIF", "GIF", 0.3)],
)
def test_a_saved_file_has_all_pictures_and_repeats(
    tmp_path: Path, ending: str, form: str, away: float
) -> None:
    """A saved file has all pictures and repeats without end.

    All six pictures of a turn differ, since the end of the turn, which equals its start, is left
    out.  They are in order: each one is nearest to the frame that was drawn for it.
    """
    animation, file = fourbar_animation(), tmp_path / f"mine{ending}"
    animation.save(file)
    with Image.open(file) as image:
        assert image.format == form
        assert image.n_frames == len(animation.frames) == 6
        assert image.info["loop"] == 0
        pictures = []
        for k in range(image.n_frames):
            image.seek(k)
            image.load()
            assert image.info["duration"] == 100  # 0.6 s in six pictures
            pictures.append(np.asarray(image.convert("RGB"), int))
        assert all(np.abs(a - b).max() > 100 for a, b in pairwise(pictures))
        for k, decoded in enumerate(pictures):
            distances = [np.abs(drawn - decoded).mean() for drawn in animation.frames]
            assert distances[k] < away
            assert min(distances[:k] + distances[k + 1 :]) > 2 * distances[k]


def test_a_notebook_shows_the_animation() -> None:
    html = fourbar_animation()._repr_html_()
    assert html.startswith('<div><img src="data:image/webp;base64,')
    assert 'alt="fourbar, sweep: reference and pymunk"' in html
    # independent of time and machine
    assert fourbar_animation().encoded() == fourbar_animation().encoded()
    with Image.open(io.BytesIO(fourbar_animation().encoded())) as image:
        assert image.size == fourbar_animation().frames.shape[2:0:-1]


@pytest.mark.parametrize(
    ("name", "last", "closed"),
    [
        ("fourbar.toml", 2 * np.pi, True),
        ("fourbar.toml", 3.0, False),
        ("balancer_sine.toml", None, True),  # the drive goes up and comes back
        ("threeprr.toml", None, False),
    ],
)
def test_closed_motions_are_recognized(name: str, last: float | None, closed: bool) -> None:
    case = load_case(shipped(name))
    if last is not None:
        drive = case.drive[0].model_copy(update={"to": last})
        case = case.model_copy(update={"drive": (drive,)})
    x = run_samples(case, "sweep")
    run = plan_run(case, "sweep", "mujoco")
    reference = evaluate(case, "sweep", x, run.motion(x))
    view = PlottedRun(case, "sweep", [], {"mujoco": reference}, {"mujoco": reference})
    assert is_closed(view) == closed


def test_invalid_animation_options_are_refused() -> None:
    case = load_case(shipped("fourbar.toml"))
    for options, wrong in (
        ({"frames": 1}, "frames = 1: a motion has 2 to 600 pictures"),
        ({"frames": 601}, "2 to 600"),
        ({"seconds": 0.0}, "seconds = 0: give a time above 0"),
        ({"magnify": float("nan")}, "magnify = nan"),
        ({"samples": 1}, "samples = 1: a motion has 2 at least"),
    ):
        with pytest.raises(ValueError, match=wrong):
            animate(case, **options)
    with pytest.raises(InputError, match=r"run.equilibrium: nothing moves in it"):
        animate(case, "equilibrium")
    with pytest.raises(InputError, match=r"mine.png: ends in '.png'; .*known: .gif, .webp"):
        fourbar_animation().save("mine.png")


def test_the_number_of_samples_can_be_changed() -> None:
    """`samples` sets the number of samples of the run.

    Pictures between samples are interpolated, so that with 3 samples the crank is drawn too short
    between them, and the pictures differ from those with 361 samples.
    """
    case = load_case(shipped("fourbar.toml"))

    def pictures(samples: int | None) -> np.ndarray:
        return animate(case, solvers=["mujoco"], frames=4, samples=samples).frames

    own = pictures(None)
    assert np.array_equal(pictures(361), own)
    assert not np.array_equal(pictures(3), own)
    assert with_samples(case, "dynamics", 9) == case.run["dynamics"].model_copy(update={"n": 9})
    recorded = load_case(shipped("hacksaw_recorded.toml"))
    with pytest.raises(InputError, match=r"\.n: is given by the recorded curve"):
        animate(recorded, samples=9)


@pytest.mark.parametrize(
    ("args", "wrong"),
    [
        (("rod_cantilever.toml",), "run: nothing moves: it has run.equilibrium alone"),
        (("fourbar.toml", "-o", "mine.mp4"), "mine.mp4: ends in '.mp4'; known: .gif, .webp"),
        (("fourbar.toml", "-o", "mine"), "mine: has no ending; known: .gif, .webp"),
        (("fourbar.toml", "-o", "no/mine.gif"), "there is no folder 'no' to write it to"),
        (("fourbar.toml", "--frames", "1"), "Invalid value for '--frames'"),
        (("pendulum.toml", "--run", "sweep"), "run.sweep: no such run; there are: dynamics"),
        (("fourbar.toml", "--solver", "mujco"), "no simulator 'mujco'; did you mean 'mujoco'?"),
        ((".",), "give the sidecar of one case"),
    ],
)
def test_bad_input_is_reported_without_a_traceback(
    models: Path, monkeypatch: pytest.MonkeyPatch, args: tuple[str, ...], wrong: str
) -> None:
    monkeypatch.chdir(models)
    answer = run_animate(*args)
    assert answer.exit_code == 2
    assert wrong in answer.output
    assert "Traceback" not in answer.output
    assert not list(models.glob("mine*"))


def test_a_file_that_cannot_be_written_is_reported(
    models: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(models)
    (models / "mine.gif").mkdir()
    answer = run_animate("fourbar.toml", "--solver", "mujoco", "--frames", "2", "-o", "mine.gif")
    assert answer.exit_code == 2
    assert "error: mine.gif: a folder; give the name of a file" in answer.output


def test_a_failed_solver_is_reported_and_the_model_is_drawn(
    edit: Callable[..., Path], tmp_path: Path
) -> None:
    file = edit("pendulum.toml", "n = 1001", "n = 1001\ntimeout = 1e-3")
    answer = run_animate(file, "--solver", "mujoco", "--frames", "3", "-o", tmp_path / "mine.webp")
    assert answer.exit_code == 1
    assert "mujoco timed out: " in answer.output
    with Image.open(tmp_path / "mine.webp") as image:
        assert image.n_frames == 3


def test_a_motion_that_ends_early_is_reported(models: Path, tmp_path: Path) -> None:
    """The planar reference follows the triple rocker's crank only as far as the loop closes."""
    drive = load_case(models / "triple_rocker.toml").drive[0]
    (models / "mine.xml").write_text((models / "triple_rocker.xml").read_text())
    (models / "mine.toml").write_text(
        f'''title = "too far"
source = "the test"
reference = "planar"

[drive]
joint = "{drive.joint}"
from = {drive.start}
to = {drive.start + 6.0}
rate = 1.0

[run.sweep]
n = 31
'''
    )
    file = tmp_path / "mine.gif"
    answer = run_animate(models / "mine.toml", "--solver", "mujoco", "--frames", "3", "-o", file)
    assert answer.exit_code == 1
    assert "the motion ends early: cannot be assembled at" in answer.output
    assert file.exists()
