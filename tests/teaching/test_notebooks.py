"""The notebooks have one form, are short, run from top to bottom, and answer their sliders quickly.

What they state is computed by their cells, and tested here with the cells in this process.

The code of all notebooks is run in this process to test the sliders, and the engines at other
lengths.  By default only two notebooks are executed as a user does, in a kernel; the others are
marked slow.  A kernel and two workers load NumPy, SciPy, Matplotlib and the engines each, which
takes 4 to 9 s of CPU time for a notebook.
"""

import ast
import gc
import io
import json
import re
import sys
from base64 import b64decode
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import proofmass
from benchmarks.notebooks import NAMES, NOTEBOOKS, answers, cells, executed, explored
from docs.make.notebook_pictures import slider_output
from proofmass import Comparison, Explorer, InputError, as_html, compare, load_case, solve
from proofmass.report.explorer import MISSING_IPYWIDGETS, worst_comparisons
from proofmass.verdict.outcome import Outcome
from tests.shipped import shipped

METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
OWN_MODULES = {file.name for file in NOTEBOOKS.glob("*.py")}  # a notebook imports them by name
FAST_NOTEBOOKS = "fourbar", "hacksaw"  # one with a Grashof class, one with a motion profile
SLIDER_SECONDS = (
    0.05  # [s] of CPU time that an answer to a slider may take: users notice longer ones
)
PRINTED_ITERATIONS = json.loads(
    (Path(__file__).parents[1] / "data" / "newton_raphson.json").read_text(encoding="utf-8")
)["linkages"]
LINKAGES_WITH_LOGS = {
    "fourbar": "four-bar",
    "fivebar": "five-bar",
    "slider_crank": "slider-crank",
    "inverted_slider_crank": "inverted slider-crank",
}


def stored(name: str) -> dict[str, Any]:
    """A notebook as it is stored."""
    found: dict[str, Any] = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))
    return found


def test_there_is_a_notebook_with_a_page_for_each_mechanism() -> None:
    others = "pendulum", "hacksaw", "threeprr", "balancer", "rods"
    assert sorted([*LINKAGES_WITH_LOGS, *others]) == NAMES
    listed = (NOTEBOOKS.parent / "docs" / "notebooks.md").read_text(encoding="utf-8")
    pages = (NOTEBOOKS.parent / "mkdocs.yml").read_text(encoding="utf-8")
    for name in NAMES:
        assert f"(notebooks/{name}.md)" in listed
        assert f": notebooks/{name}.md\n" in pages


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_in_canonical_form(name: str) -> None:
    """The file is as `json` writes it, with named cells, but without counts or own metadata.

    The only output is the picture of the sliders, for readers without a kernel.
    """
    text = (NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8")
    found = json.loads(text)
    assert json.dumps(found, indent=1, ensure_ascii=False) + "\n" == text
    assert found["metadata"] == METADATA
    assert (found["nbformat"], found["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in found["cells"]}) == len(found["cells"])
    for cell in found["cells"]:
        assert cell["metadata"] == {}
        if cell["cell_type"] == "code":
            assert cell["execution_count"] is None
            assert len(cell["outputs"]) == (cell["id"] == "sliders")
    assert found["cells"][0]["cell_type"] == "markdown"
    assert found["cells"][0]["source"][0].startswith("# ")


def test_the_notebooks_name_their_neighbours_in_the_order_of_the_page() -> None:
    page = (NOTEBOOKS.parent / "docs" / "notebooks.md").read_text(encoding="utf-8")
    order = re.findall(r"^\| \d \| \[([^]]+)\]\(notebooks/(\w+)\.md\)", page, re.MULTILINE)
    assert sorted(name for _, name in order) == NAMES
    at = range(len(order))
    for k, (_, name) in enumerate(order):
        title = " ".join("".join(stored(name)["cells"][0]["source"]).split())
        beside = [(word, j) for word, j in (("after", k - 1), ("before", k + 1)) if j in at]
        links = [f", {word} [{order[j][0]}]({order[j][1]}.ipynb)" for word, j in beside]
        assert title.endswith(f"Notebook {k + 1} of {len(order)}{''.join(links)}.")


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_short_and_imports_documented_names_only(name: str) -> None:
    code = cells(name)
    assert sum(len(text.splitlines()) for text in code.values()) <= 120
    pages = [NOTEBOOKS.parent / "docs" / f"{page}.md" for page in ("newton_raphson", "notebooks")]
    documented = re.findall(
        r"(?:proofmass\.analytic|teaching)\.([\w.]+)",
        "".join(page.read_text(encoding="utf-8") for page in pages),
    )
    for node in ast.walk(ast.parse("\n".join(code.values()))):
        module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        if module.startswith("proofmass.") or f"{module}.py" in OWN_MODULES:
            path = module.removeprefix("proofmass.analytic.")
            assert any(name.startswith(path) for name in documented)
        elif isinstance(node, ast.ImportFrom) and node.module == "proofmass":
            assert {one.name for one in node.names} <= set(proofmass.__all__)


@pytest.mark.parametrize("name", NAMES)
def test_sliders_answer_quickly_and_engines_agree_at_other_lengths(name: str) -> None:
    """An answer to a slider takes little CPU time, and the engines agree at the slider's lengths.

    The CPU time is the least of three measurements, since other processes use the processor too.
    The engines agree within the tolerances of the shipped case, so the lengths that `model` of a
    notebook writes into the model are those that the closed form gets.
    """
    explorer = explored(name)
    assert explorer.wrong == ""
    assert max(answers(explorer, rounds=3)) <= SLIDER_SECONDS
    first = explorer.panel.value
    for key, slider in explorer.sliders.items():
        if key != "mode":
            slider.value += 0.15 * (slider.max - slider.value)
    assert explorer.wrong == ""
    assert explorer.panel.value != first
    second = explorer.panel.value
    explorer.place.value += 5
    assert explorer.panel.value != second
    if name in ("fourbar", "slider_crank", "threeprr", "rods"):  # the others take long, see below
        assert engines_agree(explorer)


def engines_agree(explorer: Explorer) -> bool:
    """Whether both engines agree with the closed form in all channels that they deliver."""
    explorer.run_engines()
    assert explorer.rows, explorer.table.value
    outcomes = {row.outcome for row in explorer.rows}
    solvers = {row.solver for row in explorer.rows if row.outcome == Outcome.AGREES}
    assert "✓ agrees" in explorer.table.value
    return outcomes <= {Outcome.AGREES, Outcome.UNSUPPORTED} and solvers == {"mujoco", "pymunk"}


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_engines_agree_at_random_lengths(name: str) -> None:
    explorer, random = explored(name), np.random.default_rng(19)
    tried = 0
    while tried < 4:
        for key, slider in explorer.sliders.items():
            if key != "mode":
                slider.value = random.uniform(slider.min, slider.max)
        if not explorer.wrong:
            tried += 1
            assert engines_agree(explorer), explorer.parameters


def test_a_wrong_model_differs_and_sliders_clear_results_of_engines() -> None:
    """Moving a slider clears the results of the engines, which belong to other lengths.

    Before that, a model whose coupler is longer than that of the closed form differs.
    """
    explorer = explored("slider_crank")
    right = explorer.model
    explorer.model = lambda **p: right(**{**p, "coupler": 1.001 * p["coupler"]}).model_copy(
        update={"parameters": p}
    )
    explorer.run_engines()
    assert {row.outcome for row in explorer.rows} >= {Outcome.DIFFERS}
    assert "✗ differs" in explorer.table.value
    assert explorer.panel.value.count('stroke-dasharray="5 4"') >= 3
    explorer.sliders["crank"].value += 0.05
    assert (explorer.found, explorer.rows, explorer.table.value) == ({}, [], "")
    explorer.model = lambda **_: 1 / 0
    explorer.run_engines()
    assert "division by zero" in explorer.table.value


def test_the_panel_reports_lengths_that_cannot_be_assembled() -> None:
    explorer = explored("fourbar")
    assert "Grashof class: crank-rocker" in explorer.panel.value
    explorer.sliders["crank"].value, explorer.sliders["ground"].value = 1.4, 4.0
    explorer.sliders["coupler"].value = 1.5
    assert explorer.wrong
    assert explorer.panel.value.count("<path") == 0
    assert f">{explorer.wrong[:20]}" in explorer.panel.value
    explorer.run_engines()  # does nothing
    assert not explorer.rows


def test_the_mode_slider_mirrors_the_pose_and_the_panel_is_static_html_too() -> None:
    explorer = explored("fourbar")
    up = explorer.known["pin_y"].copy()
    explorer.sliders["mode"].value = -1
    assert explorer.known["pin_y"][0] == pytest.approx(-up[0])  # the crank is on the ground line
    bundle = explorer._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    (svg,) = re.findall('src="data:image/svg.xml;base64,([^"]+)"', bundle["text/html"])
    assert b64decode(svg).decode() == explorer.panel.value
    assert "<svg" not in bundle["text/html"]  # which GitHub would remove
    assert "crank [m] 1" in bundle["text/html"]
    assert bundle["text/plain"].startswith("fourbar: crank 60°, crank [m] 1, ")
    assert read_png(bundle["image/png"]).shape == (420, 880, 3)


def read_png(data: str) -> np.ndarray:
    """The pixels of a picture, in base64."""
    return np.asarray(Image.open(io.BytesIO(b64decode(data))).convert("RGB"), float)


@pytest.mark.parametrize("name", NAMES)
def test_the_stored_picture_is_that_of_the_sliders(name: str) -> None:
    """The maker draws the same picture again; one with other lengths differs by more.

    Other versions of Matplotlib and of its fonts shift edges by a fraction of a pixel: 1 of 255 is
    allowed on average.  A curve that moves by some pixels changes it by more, see below.
    """
    (cell,) = (cell for cell in stored(name)["cells"] if cell["id"] == "sliders")
    (output,) = cell["outputs"]
    drawn = slider_output(name)
    assert output["data"]["text/plain"] == drawn["data"]["text/plain"]
    pictures = [read_png(one["data"]["image/png"]) for one in (output, drawn)]
    assert np.abs(pictures[0] - pictures[1]).mean() < 1.0
    assert "application/vnd.jupyter.widget-view+json" not in output["data"]  # needs a kernel


def test_a_picture_of_other_lengths_is_noticed() -> None:
    explorer = explored("fourbar")
    first = read_png(explorer._repr_mimebundle_()["image/png"])
    explorer.sliders["rocker"].value = 2.6
    assert np.abs(read_png(explorer._repr_mimebundle_()["image/png"]) - first).mean() > 2.0


def test_labels_replace_the_words_of_the_panel_and_nothing_else() -> None:
    words = {"rocker": "balancín", "crank-rocker": "manivela-balancín", "pose": "posición"}
    case = load_case(shipped("fourbar.toml"))
    curves = [["rocker"], ["rocker_rate"]]
    explorer = Explorer(case, {"rocker": (1.5, 3.0)}, curves, labels=words)
    assert explorer.sliders["rocker"].description == "balancín [m]"
    assert explorer.place.description == "posición"
    assert explorer.parameters["rocker"] == 2.5
    assert ">balancín</text>" in explorer.panel.value
    assert ">rocker_rate</text>" in explorer.panel.value  # another word
    assert "Grashof class: manivela-balancín, margin 0.5 m" in explorer.panel.value
    assert "crank 60°" in explorer.panel.value


CHECKED_CELLS = {
    "pendulum": ("constraint", "multiplier", "quarter"),
    "fourbar": ("jacobian", "grashof_rule"),
    "slider_crank": ("log", "order"),
    "fivebar": ("degrees",),
    "inverted_slider_crank": ("log", "derivatives", "mirror"),
    "hacksaw": ("log", "triangle"),
    "threeprr": ("log",),
}
"""The cells that compute what the text around them states."""


def run_cells(name: str) -> tuple[dict[str, Any], dict[str, str]]:
    """The variables that these cells of a notebook leave, and what each of them prints."""
    known: dict[str, Any] = {}
    printed = {}
    for cell in ("case", *CHECKED_CELLS[name]):
        code = cells(name)[cell].replace('"../models/', f'"{NOTEBOOKS.parent.as_posix()}/models/')
        with redirect_stdout(io.StringIO()) as text:
            exec(compile(code, f"{name}:{cell}", "exec"), known)
        printed[cell] = text.getvalue()
    return known, printed


@pytest.fixture(autouse=True)
def modules_beside_the_notebooks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let cells import the modules of teaching/ by their names, as in a notebook."""
    monkeypatch.syspath_prepend(str(NOTEBOOKS))


def test_the_pendulum_keeps_its_constraint_its_period_and_its_energy() -> None:
    known, printed = run_cells("pendulum")
    assert np.abs(known["gaps"]).max() < 1e-12  # rounding of accelerations up to 20 m/s²
    assert (
        np.abs(known["errors"]).max() < 1e-5
    )  # the integrator allows 1e-9 a step, in some 600 steps
    period = known["period"]
    assert period == pytest.approx(1.674317098, abs=5e-10)  # ten digits, by AGM outside of here
    half, quarter = (known["runge_kutta"](n)[0] for n in (42, 84))
    assert half / quarter == pytest.approx(16.0, rel=0.05)  # fourth order
    assert abs(known["runge_kutta"](42)[0]) < 1e-6
    assert "1.418503" in printed["quarter"]


def test_the_rod_of_the_pendulum_pulls_inwards_unless_its_bias_has_the_wrong_sign() -> None:
    known, _ = run_cells("pendulum")
    right, state = known["rod"], known["found"].y[:, 40]
    q, v = state[:2], state[2:]
    # the integrator allows 1e-9, and has gone 1 s
    assert known["solve_pose"](q, v)[:2] @ q == pytest.approx(-v @ v, rel=1e-6)

    def wrong(q: Any, v: Any) -> tuple[float, Any, float]:
        value, jacobian, bias = right(q, v)
        return value, jacobian, -bias

    known["rod"] = wrong
    assert known["solve_pose"](q, v)[:2] @ q == pytest.approx(v @ v, rel=1e-6)


def test_the_jacobian_and_the_rule_of_grashof_hold_in_the_four_bar() -> None:
    known, printed = run_cells("fourbar")
    assert np.abs(known["jacobian"] - np.transpose(known["slopes"])).max() < 1e-8  # h² / 6
    assert "1 degree of freedom by count, 1 by rank" in printed["jacobian"]
    assert known["right"] == len(known["tried"]) == 487  # as on docs/notebooks.md
    assert "rank at the change point 3 and beside it 4" in printed["grashof_rule"]
    assert printed["grashof_rule"].count("(") == 5


def test_a_step_of_the_slider_crank_leaves_the_square_of_its_difference() -> None:
    known, printed = run_cells("slider_crank")
    left = known["log"].values[1:, 1]
    assert left[:3] == pytest.approx(known["left"][:3], rel=1e-12)
    assert np.abs(left - known["left"][:-1]).max() < 1e-14  # rounding
    falls = known["falls"]
    assert (falls[1:] / falls[:-1])[-2:] == pytest.approx([2.0, 2.0], abs=0.01)
    assert "101 steps, smallest and largest rank: 5 5" in printed["order"]


def test_count_and_rank_agree_but_for_the_redundant_crank() -> None:
    _, printed = run_cells("fivebar")
    lines = printed["degrees"].splitlines()
    pairs = [re.findall(r"\d", line) for line in lines[:4]]
    assert pairs == [[d, d] for d in ("1", "2", "1", "2")]
    assert lines[4] == "platform: 0 by count"
    assert [line[0] for line in lines[5:]] == ["1", "1", "1", "0"]
    assert max(float(line.split()[-1]) for line in lines[5:]) < 1e-10


def test_rates_of_the_inverted_slider_crank_are_those_of_differences_and_closed_form() -> None:
    known, printed = run_cells("inverted_slider_crank")
    differences = [float(x) for x in re.findall(r"differences: (\S+)", printed["derivatives"])]
    assert max(differences) < 1e-5  # h² / 12 times the fourth derivative, 1e-16 / h² of rounding
    assert known["turn"].shape == (72,)
    rates = re.findall(r"rate of the rod: (\S+) closed form: (\S+)", printed["derivatives"])
    assert float(rates[0][0]) == pytest.approx(float(rates[0][1]), rel=1e-12)
    assert printed["mirror"].splitlines() == [
        "rows: 1 mirrored cranks of 72: 36",
        "rows: 2 mirrored cranks of 72: 0",
    ]


def test_the_nine_equations_of_the_hacksaw_are_block_triangular() -> None:
    known, printed = run_cells("hacksaw")
    assert "above the diagonal: 0.0" in printed["triangle"]
    assert "difference of the diagonal: 0.0" in printed["triangle"]
    assert np.abs(known["block"][1, 0]).max() < 1e-12  # B has the rates, here 0, as factors
    assert np.abs(known["block"][2, 0]).max() > 0.1
    assert np.abs(known["apart"] - known["unknowns"]).max() < 1e-12
    assert "[4, 2, 2] steps" in printed["triangle"]


def test_the_platform_of_the_robot_stands_alone_with_held_sliders() -> None:
    _, printed = run_cells("threeprr")
    assert printed["log"] == "3 degrees of freedom, with the sliders held 0\n"


def test_links_in_the_panel_meet_and_have_their_lengths() -> None:
    """The ends that two links share coincide, and links have the lengths of the sliders."""
    explorer = explored("fourbar")
    explorer.sliders["rocker"].value = 2.3
    p = explorer.parameters
    drawn = explorer.links(explorer.known, p)
    assert drawn["coupler"][2] == pytest.approx(drawn["rocker"][1])
    assert np.abs(drawn["rocker"][1] - drawn["rocker"][0]) == pytest.approx(
        np.full(explorer.x.size, 2.3)
    )


def test_sliders_without_ipywidgets_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    case = load_case(shipped("fourbar.toml"))
    with pytest.raises(ImportError, match=re.escape(MISSING_IPYWIDGETS)):
        Explorer(case, {"crank": (0.5, 1.5)}, [["rocker"]])
    assert "proofmass[notebooks]" in MISSING_IPYWIDGETS


@pytest.mark.parametrize(
    ("name", "sliders", "curves", "wrong"),
    [
        ("fourbar", {"cranc": (0.5, 1.5)}, "rocker", r"parameters.cranc: .* did you mean 'crank'"),
        ("fourbar", {"mode": (-1, 1)}, "rocker", "parameters.mode: no slider"),
        ("fourbar", {"crank": (1.5, 0.5)}, "rocker", "bounds 1.5, 0.5 must rise"),
        ("fourbar", {"crank": (2, 3)}, "rocker", "with the case's 1 between them"),
        ("fourbar", {}, "roker", "channels.roker: did you mean 'rocker'"),
        ("fourbar", {}, "rocker pin_z", "channels.pin_z: did you mean 'pin_y'"),
        ("hacksaw_recorded", {}, "r1", "a recorded curve has nothing to slide"),
    ],
)
def test_invalid_sliders_and_curves_are_refused(
    name: str, sliders: dict[str, tuple[float, float]], curves: str, wrong: str
) -> None:
    with pytest.raises((InputError, ValueError), match=wrong):
        Explorer(load_case(shipped(f"{name}.toml")), sliders, [curves.split()])


def test_a_changed_model_has_all_digits_and_refuses_unknown_elements() -> None:
    case = load_case(shipped("fourbar.toml"))
    third = 7.0 / 3.0
    changed = case.with_model({"site coupler_end": {"pos": (third, 0, 0)}}, coupler=third)
    assert f'pos="{third!r} 0.0 0.0"' in changed.model_path.read_text(encoding="utf-8")
    assert (changed.parameters["coupler"], case.parameters["coupler"]) == (third, 2.0)
    assert case.model_path == shipped("fourbar.xml")
    bare = case.with_model({"body crank/geom": None}).model_path.read_text(encoding="utf-8")
    assert (bare.count("<geom"), changed.model_path.read_text().count("<geom")) == (5, 6)
    with pytest.raises(InputError, match=r"fourbar.xml: there is no element 'site pin'"):
        case.with_model({"site pin": {"pos": (0, 0, 0)}})


def test_cases_and_comparisons_are_shown_as_html(edit: Callable[..., Path]) -> None:
    case = load_case(edit("pendulum.toml", 'title = "', 'title = "a <b> and '))
    assert as_html(case) == case._repr_html_()
    assert "<b>pendulum</b>: a &lt;b&gt; and" in case._repr_html_()
    assert '<img src="data:image/svg+xml;base64,' in case._repr_html_()
    brief = case.run["dynamics"].model_copy(update={"until": 1.0, "n": 101})
    case = case.model_copy(update={"run": {"dynamics": brief}})
    curves = solve(case, "dynamics", "mujoco")
    rows = compare(case, "dynamics", "mujoco", curves, detectable=False)
    table = rows._repr_html_()
    assert table.count("<tr>") == 1 + len(rows)
    assert rows[0]._repr_html_().count("<tr>") == 2
    assert all(row.channel in table for row in rows)
    assert table.count("✓ agrees") == len(rows)
    for other in (3, ["rows"]):
        with pytest.raises(TypeError):
            as_html(other)


def test_a_case_that_cannot_be_drawn_is_shown_without_a_drawing() -> None:
    case = load_case(shipped("pendulum.toml"))
    failed = case.model_copy(update={"model": "no.xml"})
    assert "<img" not in failed._repr_html_()
    assert "no.xml" in failed._repr_html_()


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize(
    "name", [n if n in FAST_NOTEBOOKS else pytest.param(n, marks=pytest.mark.slow) for n in NAMES]
)
def test_a_notebook_runs(name: str) -> None:
    notebook = executed(name)
    gc.collect()  # objects left by the kernel's client warn here, and not in another test
    outputs = {c["id"]: c["outputs"] for c in notebook.cells if c["cell_type"] == "code"}
    html = {
        cell: "".join(one["data"].get("text/html", "") for one in found if "data" in one)
        for cell, found in outputs.items()
    }
    assert "<th>reference</th>" in html["case"]
    (panel,) = outputs["sliders"]
    assert "application/vnd.jupyter.widget-view+json" in panel["data"]
    assert '<img src="data:image/svg+xml;base64,' in html["sliders"]
    assert "image/png" in panel["data"]
    assert '<img src="data:image/webp;base64,' in html["animation"]
    assert html["engines"].count("✓ agrees") >= 4
    assert "✗" not in html["engines"]
    if name in LINKAGES_WITH_LOGS:
        log = outputs["log"][-1]["data"]["text/plain"]
        last = re.findall(r"= (-?[\d.]+)", log.splitlines()[-1])
        printed_position = PRINTED_ITERATIONS[LINKAGES_WITH_LOGS[name]]["position"]
        assert np.array(last, float) == pytest.approx(np.array(printed_position), abs=1e-8)
        count = re.search(r"after (\d+) iterations", log)
        assert count
        assert int(count[1]) == len(PRINTED_ITERATIONS[LINKAGES_WITH_LOGS[name]]["steps"])
    if name == "hacksaw":
        log = outputs["log"][-1]["data"]
        assert "after 5 iterations" in log["text/plain"]  # as in the report
        assert "<details><summary>" in log["text/html"]


def test_the_worst_comparison_of_a_solver_is_shown():
    """The worst one may have an error that is NaN, a tolerance of zero, or no tolerance."""

    def row(error: float, allowed: float, channel: str, outcome: str = "differs") -> Comparison:
        return Comparison(
            "a", "mujoco", "sweep", channel, "m", error, allowed=allowed, outcome=outcome
        )

    for worst in (row(9.0, 1.0, "w"), row(np.nan, 1.0, "w"), row(1.0, 0.0, "w")):
        rows = [row(2.0, 1.0, "a"), worst, row(3.0, 1.0, "b")]
        assert [found.channel for found in worst_comparisons(rows)] == ["w"]
    rows = [row(1.0, np.nan, "a", "unchecked"), row(2.0, 1.0, "b"), row(0.1, 1.0, "c", "agrees")]
    assert worst_comparisons(rows) == rows
