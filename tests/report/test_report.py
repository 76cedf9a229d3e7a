"""The report: its headline for each case, and its pages."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.reference.evaluate import evaluate, reference_for
from proofmass.reference.find import parameter_unit
from proofmass.report import headline, write_report
from proofmass.report.case_figures import RUN_FIGURES, find_motions, measured_paths, mechanism_poses
from proofmass.report.data import drive_curves, drive_rows, plotted_run, thin_curve
from proofmass.report.figures import channel_tolerances
from proofmass.report.mechanism import path_names, point_path
from proofmass.report.style import solver_looks
from proofmass.report.svg import inline_svg
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run
from proofmass.sim.protocol.curves import Curves
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison
from tests.report.whole import without_figures
from tests.shipped import shipped, shipped_files

DATA = re.compile(r'<script type="application/json" id="data">(.*?)</script>', re.DOTALL)
HTML_TITLE = '<script>alert("x")</script> & crank'


def case_with_samples(name: str, n: int = 37, **changed: object) -> Case:
    """A shipped case whose runs have `n` samples, with other fields changed."""
    case = load_case(shipped(f"{name}.toml"))
    runs = {k: r.model_copy(update={"n": n}) for k, r in case.run.items()}
    return case.model_copy(update={"run": runs, **changed})


def curves_with_error(case: Case, kind: str, off: float) -> Curves:
    """The curves of a solver whose errors are sines of `off` times each curve's range."""
    run = plan_run(case, kind, "mujoco")
    x, state = run.x, run.motion(run.x) if run.drives else None
    reference = evaluate(case, kind, x, state)
    channels = {
        n: v + off * (np.ptp(v) or 1.0) * np.sin(9 * x)
        for n, v in reference.channels.items()
        if case.channels[n].only in (None, kind)
    }
    return Curves(
        x,
        channels,
        drive=state,
        seconds=0.1,
        steps=len(x),
        violation=1e-9,
        settings={"timestep": 1e-3},
    )


def result_with_errors(case: Case, **off: float) -> Result:
    """The result of MuJoCo runs whose errors are the given shares of the range, by kind of run."""
    result = Result(cases=[case])
    for kind, share in off.items():
        curves = curves_with_error(case, kind, share)
        result.curves[case.name, kind, "mujoco"] = curves
        result.comparisons.extend(compare(case, kind, "mujoco", curves))
    return result


def failed_comparisons(case: Case, kind: str, solver: str, outcome: str) -> list[Comparison]:
    """Comparisons of all channels of a run that failed with this outcome."""
    return [
        Comparison(case.name, solver, kind, name, c.unit, outcome=outcome, message="why not")
        for name, c in case.channels.items()
        if c.only in (None, kind)
    ]


@pytest.fixture(scope="module")
def fourbar() -> Case:
    case = case_with_samples("fourbar")
    few = ["coupler.angle", "rocker", "pin.x", "pin.y", "rocker_rate", "holding_moment"]
    return case.model_copy(update={"channels": {n: case.channels[n] for n in few}})


@pytest.fixture(scope="module")
def report(fourbar: Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a report on the four-bar with channels of six outcomes.

    It also has a NaN curve, a missing channel, a title with HTML, a model without a sidecar and an
    input with an error.
    """
    folder = tmp_path_factory.mktemp("report")
    case = fourbar.model_copy(update={"title": HTML_TITLE})
    result = result_with_errors(case, sweep=0.0, dynamics=1e-3)
    curves = curves_with_error(case, "dynamics", 0.0)
    broken = dict(curves.channels, rocker=curves.channels["rocker"] * np.nan)
    del broken["pin.x"]
    curves = replace(curves, channels=broken, missing={"pin.x": "no such sensor here"})
    result.curves[case.name, "dynamics", "mujoco:default"] = curves
    result.comparisons.extend(compare(case, "dynamics", "mujoco:default", curves))
    for kind, outcome in ("dynamics", "diverged"), ("sweep", "timed out"):
        result.comparisons.extend(failed_comparisons(case, kind, "pymunk", outcome))
    result.comparisons.append(
        Comparison("loose", "mujoco", "dynamics", "", "", message="no sidecar; it loads and steps")
    )
    result.errors.append(InputError(Path("/home/me/bad.toml"), "drive.joint", "no joint <q>"))
    return write_report(result, folder, figures=True).parent


def test_the_headline_says_that_all_channels_agree(fourbar: Case) -> None:
    result = result_with_errors(fourbar, sweep=0.0, dynamics=0.0)
    assert headline(fourbar, result.comparisons, {"mujoco": 0.00097}) == (
        f"The model matches the reference: all {len(fourbar.channels)} channels of the sweep "
        "agree in MuJoCo. "
        "MuJoCo agrees at dt = 0.97 ms."
    )


def test_the_headline_gives_the_errors_of_unchecked_settings(fourbar: Case) -> None:
    result = result_with_errors(fourbar, sweep=0.0)
    curves = curves_with_error(fourbar, "dynamics", 3e-2)
    rows = compare(fourbar, "dynamics", "mujoco:default", curves)
    assert (
        "unchecked: MuJoCo default (off by 3 % of the range in position, 3 % in velocity and "
        "3 % in force or energy)"
    ) in headline(fourbar, [*result.comparisons, *rows])


def test_the_headline_separates_errors_at_the_start_from_later_ones() -> None:
    """The headline gives the error of each kind of quantity, and separates the start of a run.

    The acceleration has an error of 50 % of its range in the first sample, and of 0.2 % later.
    """
    case = case_with_samples("fourbar")
    curves = curves_with_error(case, "dynamics", 0.0)
    reference = reference_for(case, "sweep", curves).channels
    shares = {"rocker": 1e-4, "rocker_rate": 1e-3, "rocker_acceleration.z": 2e-3}
    channels = {
        name: reference[name] + share * np.ptp(reference[name]) for name, share in shares.items()
    }
    channels["rocker_acceleration.z"][0] += 0.5 * np.ptp(reference["rocker_acceleration.z"])
    rows = compare(case, "dynamics", "mujoco:default", replace(curves, channels=channels))
    (c,) = (c for c in rows if c.channel == "rocker_acceleration.z")
    span = np.ptp(reference["rocker_acceleration.z"])
    assert (c.at, c.error_max) == (0.0, pytest.approx(0.502 * span, rel=1e-9))
    assert c.error_later == pytest.approx(2e-3 * span, rel=1e-9)
    assert (
        "MuJoCo default (off by 1e-4 of the range in position, 0.1 % in velocity and 50 % in "
        "acceleration at the start, 0.2 % after a tenth of the run)"
    ) in headline(case, rows)


def test_the_headline_says_that_the_sweep_differs(fourbar: Case) -> None:
    text = headline(fourbar, result_with_errors(fourbar, sweep=1e-3, dynamics=0.0).comparisons)
    assert text.startswith(
        "The model does not match the reference: MuJoCo differs in the sweep on "
    )
    assert text.endswith("do not look at integrators before this is mended.")


def test_the_headline_names_the_only_solver_that_differs(fourbar: Case) -> None:
    good = result_with_errors(fourbar, sweep=0.0).comparisons
    bad = [
        replace(c, solver="pymunk", outcome="differs", error_max=1.0, message="9 x the allowed")
        for c in good
    ]
    text = headline(fourbar, [*good, *bad])
    assert text.startswith(
        "The model matches the reference in MuJoCo, not in every solver: pymunk diff"
    )


def test_the_headline_ranks_a_channel_with_tolerance_zero_as_worst(fourbar: Case) -> None:
    rows = [
        Comparison(fourbar.name, "mujoco", "sweep", name, "m", 3.0, allowed=a, outcome="differs")
        for name, a in (("pin.x", 1.0), ("pin.y", 0.0))
    ]
    assert "(worst pin.y: " in headline(fourbar, rows)


def test_the_headline_says_that_dynamics_differ(fourbar: Case) -> None:
    text = headline(fourbar, result_with_errors(fourbar, sweep=0.0, dynamics=1e-3).comparisons)
    assert text.startswith(f"The model matches the reference: all {len(fourbar.channels)} channels")
    assert "differs in dynamics on coupler.angle, rocker, pin.x and 3 more" in text


def test_the_headline_names_a_solver_that_diverged(fourbar: Case) -> None:
    rows = result_with_errors(fourbar, sweep=0.0).comparisons
    text = headline(
        fourbar, [*rows, *failed_comparisons(fourbar, "dynamics", "pymunk:default", "diverged")]
    )
    assert text.endswith("pymunk default diverged in dynamics.")


def test_the_headline_says_that_there_is_no_sweep_or_no_run() -> None:
    case = case_with_samples("pendulum")
    assert headline(case, result_with_errors(case, dynamics=0.0).comparisons).startswith(
        "No sweep, so model and integrator are judged together: MuJoCo agrees"
    )
    assert headline(case, []).startswith("Not judged")


def test_a_page_shows_every_channel_and_outcome(report: Path, fourbar: Case) -> None:
    page = (report / "fourbar.html").read_text(encoding="utf-8")
    for channel in fourbar.channels:
        assert f'">{channel} <span class="unit">' in page
    for outcome in (
        "✓ agrees",
        "✗ differs",
        "○ unchecked",
        "– unsupported",
        "⚠ diverged",
        "⚠ timed out",
    ):
        assert outcome in page
    assert "pymunk is not drawn: diverged. why not" in page
    assert "no such sensor here" in page
    assert all(str(escape(t.why)) in page for t in fourbar.tolerance)


def test_pages_fetch_nothing_and_name_no_folder(report: Path) -> None:
    for file in report.glob("*.html"):
        page = file.read_text(encoding="utf-8")
        assert not re.search(r"(?:src|href)\s*=\s*[\"']?\s*(?:https?:)?//", page)
        assert not re.search(r"@import|url\(\s*['\"]?http", page)
        scripts = re.findall(r"<script[^>]*>", page)
        own = re.compile(
            r'<script (src="static/\w+\.js"( defer)?'
            r'|type="application/json" id="(data|facts|poses)")>'
        )
        assert all(own.fullmatch(script) for script in scripts)
        assert "/home/" not in page
        assert str(report) not in page
        assert len(page) < 3e6


def test_ids_are_unique_and_links_lead_somewhere(report: Path) -> None:
    for file in report.glob("*.html"):
        page = file.read_text(encoding="utf-8")
        ids = re.findall(r'\sid="([^"]*)"', page)
        assert len(ids) == len(set(ids))
        for target in re.findall(r'(?:href|src)="([^"#]+)"', page):
            assert (report / target).is_file()
        inside = set(re.findall(r'(?:href="|url\()#([^")]+)', page))
        places = {place for place in inside if re.match(r"(sweep|dynamics|equilibrium)/", place)}
        assert inside - places <= set(ids)
        assert bool(places) == (file.name == "fourbar.html")  # links to curves


def test_special_characters_are_escaped(report: Path) -> None:
    for name in ("fourbar.html", "index.html"):
        page = (report / name).read_text(encoding="utf-8")
        assert "&lt;script&gt;alert(" in page
        assert "<script>alert(" not in page
    assert "no joint &lt;q&gt;" in (report / "index.html").read_text(encoding="utf-8")


def test_the_index_lists_models_without_sidecar_and_input_errors(report: Path) -> None:
    page = (report / "index.html").read_text(encoding="utf-8")
    assert "1 input at fault" in page
    assert "bad.toml: drive.joint" in page
    assert "no sidecar; it loads and steps" in page
    assert page.index("at fault</h2>") < page.index('id="cases"')
    assert page.index('id="cases"') < page.index("without a sidecar")


@pytest.mark.parametrize(
    "name",
    ["mechanism", *(f"{kind}-{what}" for kind in ("sweep", "dynamics") for what in RUN_FIGURES)],
)
def test_figures_are_written_as_svg_and_png(report: Path, name: str) -> None:
    stem = report / "figures" / f"fourbar-{name}"
    assert "<svg" in stem.with_suffix(".svg").read_text(encoding="utf-8")
    assert stem.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


def test_reports_without_curves_or_cases_are_written(tmp_path: Path) -> None:
    case = case_with_samples("pendulum")
    result = Result(
        cases=[case], comparisons=failed_comparisons(case, "dynamics", "pymunk", "crashed")
    )
    page = write_report(result, tmp_path).with_name("pendulum.html").read_text(encoding="utf-8")
    assert "pymunk is not drawn: crashed" in page
    assert page.count("<figure") == 1  # the drawing of the mechanism needs no solver
    page = write_report(Result(cases=[case]), tmp_path).read_text(encoding="utf-8")
    assert "Nothing of it was checked." in page
    assert "No case was found" in write_report(Result(), tmp_path).read_text(encoding="utf-8")


def test_a_constant_reference_gives_no_nan_on_the_page(tmp_path: Path) -> None:
    case = case_with_samples(
        "pendulum", parameters={"length": 1.0, "mass": 1.0, "gravity": 9.81, "amplitude": 0.0}
    )
    index = write_report(result_with_errors(case, dynamics=0.0), tmp_path)
    page = index.with_name("pendulum.html").read_text(encoding="utf-8")
    assert page.count("<figure") == 1  # the mechanism; the script draws the curves
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


def test_thinning_keeps_spikes_and_ends() -> None:
    x = np.linspace(0, 1, 5001)
    y = np.where(x == x[1234], 7.0, np.sin(x))
    tx, ty = thin_curve(x, y, 300)
    assert len(tx) <= 302
    assert (tx[0], tx[-1], ty.max()) == (0.0, 1.0, 7.0)


def test_solvers_differ_with_and_without_colour() -> None:
    found = solver_looks(
        ["mujoco", "mujoco:default", "mujoco:fine", "pymunk", "pymunk:default", "adams", "simpack"]
    )
    assert len({v.colour for v in found.values()}) == 7
    assert len({(v.dash, v.marker) for v in found.values()}) == 7


def test_a_solver_looks_the_same_in_every_report() -> None:
    """Of one case, of a folder and of all."""
    names = [f"engine{k}" for k in range(12)]
    together = solver_looks(names)
    assert len({(v.colour, v.dash, v.marker) for v in together.values()}) == 12
    own = {name: solver_looks([name])[name] for name in names}
    assert len(set(own.values())) > 3  # not all alike
    preferred = [name for name in names if together[name] == own[name]]
    assert preferred[0] == names[0]
    for name in preferred:
        assert solver_looks(["mujoco", "zeta", name])[name] == own[name]


def test_inline_svg_escapes_its_label() -> None:
    assert 'aria-label="a &lt;b&gt; &quot;c&quot;"' in inline_svg(
        '<svg viewBox="0 0 1 1"></svg>', "k", 'a <b> "c"'
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fivebar", ["left", "right", "left_crank", "right_coupler", "tip"]),
        (
            "hacksaw",
            ["ray_length", "slider_pin", "crank_pin", "coupler", "slide, dashed: its guide"],
        ),
    ],
)
def test_drawing_has_the_names_of_the_mjcf(name: str, words: list[str], tmp_path: Path) -> None:
    write_report(Result(cases=[case_with_samples(name)]), tmp_path)
    svg = (tmp_path / "figures" / f"{name}-mechanism.svg").read_text(encoding="utf-8")
    found = {w for text in re.findall(r">([^<>]+)</t", svg) for w in (text, text.rstrip(","))}
    assert set(words) <= found


def test_a_path_consists_of_its_two_channels() -> None:
    case = case_with_samples("fivebar")
    view = plotted_run(result_with_errors(case, sweep=0.01), case, "sweep")
    shape = mechanism_poses(case, find_motions(case, [view])[0])
    assert shape
    assert path_names(view, shape) == ["tip"]
    for curves in (view.curves["mujoco"], view.longest):
        found = point_path(curves, "tip", shape)
        assert np.array_equal(found[:, 0], curves.channels["tip.x"])
        assert np.array_equal(found[:, 1], curves.channels["tip.y"])
    assert np.array_equal(
        measured_paths([view], shape)["tip"], point_path(view.longest, "tip", shape)
    )


def test_a_page_says_where_a_sweep_stopped_early(fourbar: Case, tmp_path: Path) -> None:
    fourbar = fourbar.model_copy(update={"channels": {"rocker": fourbar.channels["rocker"]}})
    result = result_with_errors(fourbar, sweep=0.0)
    whole = result.curves[fourbar.name, "sweep", "mujoco"]
    short = replace(
        whole,
        x=whole.x[:20],
        stopped="the loop stays open",
        channels={n: c[:20] for n, c in whole.channels.items()},
        drive=tuple(part[:, :20] for part in whole.drive or ()),
    )
    result.comparisons.extend([replace(c, solver="pymunk") for c in result.comparisons])
    for order in ("mujoco", "pymunk"), ("pymunk", "mujoco"):  # in either order
        for solver, curves in zip(order, (whole, short), strict=True):
            result.curves[fourbar.name, "sweep", solver] = curves
        with without_figures():
            index = write_report(result, tmp_path)
        page = index.with_name("fourbar.html").read_text(encoding="utf-8")
        assert re.search(r" ends at 190 deg, 20 of 37 samples, .* the loop stays open\.", page)
        assert page.count(" ends at ") == 1
        assert (
            "the loop stays open"
            in json.loads(DATA.search(page)[1])["runs"]["sweep"]["solvers"][order[1]]["stopped"]
        )


def test_a_page_says_that_the_reference_reads_the_models_own_numbers(
    report: Path, tmp_path: Path
) -> None:
    """Only such a page says so: the reference of the four-bar has lengths of its own."""
    case = case_with_samples("peaucellier")
    write_report(Result(cases=[case]), tmp_path)
    page = (tmp_path / "peaucellier.html").read_text(encoding="utf-8")
    assert "it checks the engine, not the model" in page
    assert "must = 0.8625 m</span>" in page
    rows = [
        replace(c, outcome="agrees")
        for c in failed_comparisons(case, "sweep", "mujoco", "diverged")
    ]
    assert headline(case, rows).startswith("The model moves as its own numbers say: all 9 ch")
    other = (report / "fourbar.html").read_text(encoding="utf-8")
    assert "It checks the engine, not the model" not in other


def test_headline_says_why_channels_are_missing(fourbar: Case) -> None:
    rows = result_with_errors(fourbar, sweep=0.0).comparisons
    rows[0] = replace(rows[0], outcome="unsupported", message="no inverse dynamics")
    assert f"{len(rows) - 1} of {len(rows)} channels in MuJoCo (no inverse dynamics)." in headline(
        fourbar, rows
    )


def test_motions_of_several_drives_are_arranged_in_rows() -> None:
    fivebar, circle = case_with_samples("fivebar"), case_with_samples("fivebar_circle")
    for case, rows in (
        (fivebar, [["left (drive)", "right (drive)"]]),
        (
            circle,
            [
                [f"{side}{what} (drive)" for side in ("left", "right")]
                for what in ("", " rate", " acceleration")
            ],
        ),
    ):
        view = plotted_run(result_with_errors(case, sweep=0.0), case, "sweep")
        assert drive_rows(view, list(drive_curves(view))) == rows


@pytest.mark.parametrize(
    ("derivatives", "drawn"),
    [((0, 0), [""]), ((0, 1), ["", " rate"]), ((1, 2), ["", " rate", " acceleration"])],
)
def test_rates_of_a_drive_are_drawn_of_runs_that_have_them(derivatives, drawn) -> None:
    case = case_with_samples("triple_rocker")
    view = plotted_run(result_with_errors(case, sweep=0.0), case, "sweep")
    for solver, has in zip(("mujoco", "pymunk"), derivatives, strict=True):
        view.curves[solver] = replace(view.curves["mujoco"], derivatives=has)
    panels = drive_curves(view)
    assert list(panels) == [f"crank{what} (drive)" for what in drawn]
    for order, (_, moved, _) in enumerate(panels.values()):
        assert list(moved) == [s for s, c in view.curves.items() if c.derivatives >= order]


def test_equal_tolerances_share_a_name(fourbar: Case) -> None:
    view = plotted_run(result_with_errors(fourbar, sweep=0.0), fourbar, "sweep")
    view.curves["pymunk"] = view.curves["mujoco"]
    view.rows.extend([replace(c, solver="pymunk") for c in view.rows])
    assert list(channel_tolerances(view, "rocker").values()) == [["mujoco", "pymunk"]]


@pytest.mark.parametrize("file", shipped_files(), ids=lambda file: file.stem)
def test_units_of_parameters_match_the_comments_of_the_sidecar(file: Path) -> None:
    """The unit of a parameter, from the docstring of the reference, is that in the sidecar.

    The comment in the sidecar was written independently of the docstring.  Only `mode` may have no
    unit.
    """
    case, remarks = (
        load_case(file),
        dict(
            re.findall(
                r"(?m)^(\w+) = \S+ +# (m|kg m2|kg|m/s2|rad|N m2|N m|N)(?=[,: \n])", file.read_text()
            )
        ),
    )
    for name, unit in remarks.items():
        if name in case.parameters:
            assert parameter_unit(case, name).replace("^", "") == unit
    assert [
        name
        for name, value in case.parameters.items()
        if not isinstance(value, str) and not parameter_unit(case, name)
    ] in ([], ["mode"])


def test_units_of_parameters_are_read_from_the_docstring() -> None:
    units = {
        case: {
            p: parameter_unit(case_with_samples(case), p)
            for p in case_with_samples(case).parameters
        }
        for case in ("fourbar", "balancer_sine", "pendulum", "rod_cantilever")
    }
    for name, unit in (("crank", "m"), ("crank_mass", "kg"), ("gravity", "m/s^2"), ("mode", "")):
        assert units["fourbar"][name] == unit
    assert units["balancer_sine"]["length3"] == "m"  # the docstring has "length1, .."
    assert units["balancer_sine"]["target_moment"] == "N m"
    assert units["pendulum"] == {
        "length": "m",
        "mass": "kg",
        "gravity": "m/s^2",
        "amplitude": "rad",
    }
    assert units["rod_cantilever"]["force_y"] == "N"


def test_parameters_have_units_on_the_page(report: Path) -> None:
    page = (report / "fourbar.html").read_text(encoding="utf-8")
    assert "<dt>crank</dt><dd>1 m</dd>" in page
    assert "<dt>gravity</dt><dd>9.81 m/s²</dd>" in page
    assert "<dt>mode</dt><dd>1</dd>" in page
    assert "</code> 0 to 6.28 rad at 1 rad/s" in page
