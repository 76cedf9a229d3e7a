"""Views: curves over another x, stacked energies, and curves of other parameter sets."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context

from proofmass.analytic.linkages.fourbar import solve
from proofmass.base.errors import InputError
from proofmass.case.case import Case, View
from proofmass.reference.plot_data import PlotData, plot_data
from proofmass.report import write_report
from proofmass.report.data import monotonic_stretches, plotted_run
from proofmass.report.mechanism import joints_with_springs
from proofmass.report.style import RC, solver_looks
from proofmass.report.views import (
    Viewed,
    apply_view,
    apply_views,
    format_spread,
    group_marks,
    view_caption,
    view_figure,
)
from proofmass.run.sidecar import load_case
from proofmass.run.validate import validate_case
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison
from tests.report.test_report import case_with_samples, curves_with_error, result_with_errors
from tests.report.whole import result_from_references
from tests.shipped import shipped

OTHER_LENGTHS = {"crank": 0.8, "coupler": 2.0, "rocker": 2.5, "ground": 3.0, "mode": 1}
LOOP_VIEW = View(title="Loop", x="rocker", y=("coupler.angle", "holding_moment"))
STUB_REFERENCE = '''"""A crank with a spring in it."""

import numpy as np

from proofmass.analytic.protocol import AngularStiffness, Force, Reference, Word


def contacts(*, stiffness, **_):
    return {"spring on its stop": 3.0 / stiffness}


class Crank(Reference):
    """A crank with a spring in it."""

    marks = (contacts,)
    stiffness: AngularStiffness
    target: Word = "sine"
    weight: Force = 0.0

    def solve(self, motion, ask):
        angle, stiffness = motion.drive[0], self.stiffness
        wanted = {"sine": np.sin, "cosine": np.cos}[self.target](angle)
        return {"moment": stiffness * angle, "target": wanted,
                "lifted": self.weight * np.cos(angle), "stored": stiffness * angle**2 / 2}

    def properties(self, motion, ask):
        load = {"load": f"{self.weight:g} N"} if self.weight else {}
        return {"softness": f"{1 / self.stiffness:g} rad/Nm"} | load
'''


VIEW_TABLES = """
[[view]]
title = "Moment over angle"
x = "crank"
y = "holding_moment"
dashed = "target"
marks = "contacts"

[[view]]
title = "Energies"
x = "crank"
stack = ["stored", "lifted"]
unit = "J"

[compare_with."stiff & heavy"]
parameters = { stiffness = 4.0, target = "cosine", weight = 2.0 }
"""


@pytest.fixture
def stub(write_stub_sidecar) -> Path:
    """A sidecar whose reference has a parameter that is a word, marks and properties."""
    return write_stub_sidecar(
        "sprung_crank", STUB_REFERENCE, 'stiffness = 2.0\ntarget = "sine"', VIEW_TABLES
    )


def perfect_comparisons(sidecar: Path) -> list[Comparison]:
    """Comparisons of curves that are exactly those of the reference."""
    case = load_case(sidecar)
    return compare(case, "sweep", "mujoco", curves_with_error(case, "sweep", 0.0))


def fourbar_with_views(*views: View, **parameter_sets: dict) -> Case:
    """The four-bar with views, and with other parameter sets to compare with."""
    table = case_with_samples("fourbar").model_dump(by_alias=True)
    table |= {
        "view": views,
        "compare_with": {k: {"parameters": p} for k, p in parameter_sets.items()},
    }
    return Case(**table)


def apply_first_view(case: Case, off: float = 0.0, kind: str = "sweep") -> Viewed:
    """The first view of a case, applied to curves with errors of `off` times their range."""
    return apply_view(
        plotted_run(result_with_errors(case, **{kind: off}), case, kind), case.view[0]
    )


def test_a_swing_is_split_into_monotonic_stretches() -> None:
    x = -np.cos(np.linspace(0, 4 * np.pi, 41))
    assert monotonic_stretches(x) == [(slice(10 * k, 10 * k + 11), k % 2 == 0) for k in range(4)]


def test_rest_and_rounding_do_not_split_a_stretch() -> None:
    x = np.array([0.0, 1.0, 1.0 + 1e-15, 1.0, 2.0, 2.0])
    assert monotonic_stretches(x) == [(slice(0, 6), True)]
    assert len(monotonic_stretches(np.ones(4))) == 1


def test_a_channel_as_x_has_values_of_the_solver_and_of_the_reference() -> None:
    case = fourbar_with_views(LOOP_VIEW)
    view, crank = apply_first_view(case, off=0.01), np.linspace(0, 2 * np.pi, 37)
    expected = solve(crank, **case.parameters)["rocker_angle"]
    assert np.array_equal(view.over.reference["mujoco"].x, expected)
    # the error is a sine of a hundredth of the range
    assert (
        np.abs(
            view.over.curves["mujoco"].x - expected - 0.01 * np.ptp(expected) * np.sin(9 * crank)
        ).max()
        < 1e-15
    )
    assert view.loop
    assert (view.over.x_name, view.over.x_unit) == ("rocker", "deg")


def test_a_driven_joint_or_a_quantity_can_be_x() -> None:
    by_joint = apply_first_view(fourbar_with_views(LOOP_VIEW.model_copy(update={"x": "crank"})))
    assert by_joint.x == pytest.approx(np.arange(0, 361, 10))
    assert by_joint.over.x_name == "crank angle"
    by_name = apply_first_view(
        fourbar_with_views(View(title="t", x="rocker_angle", y="coupler_angle"))
    )
    assert np.array_equal(by_name.x, apply_first_view(fourbar_with_views(LOOP_VIEW)).x)
    assert by_name.own.units == {"rocker_angle": "rad", "coupler_angle": "rad"}


def test_a_view_shows_the_first_run_that_records_its_curves() -> None:
    case = fourbar_with_views(
        LOOP_VIEW, LOOP_VIEW.model_copy(update={"y": ("rocker",), "run": "dynamics"})
    )
    runs = [
        plotted_run(result_with_errors(case, sweep=0.0, dynamics=0.0), case, k) for k in case.run
    ]
    assert [v.over.kind for v in apply_views(case, runs)] == ["sweep", "dynamics"]


def test_panels_show_the_curves_and_their_differences() -> None:
    case = fourbar_with_views(LOOP_VIEW, other=OTHER_LENGTHS)
    view = apply_first_view(case, off=0.01)
    with rc_context(RC):
        coupler, below, moment, _ = view_figure(view, solver_looks(["mujoco"])).axes
    reference, out, *_, thin = coupler.lines
    crank = np.linspace(0, 2 * np.pi, 37)
    expected = solve(crank, **case.parameters)
    assert np.array_equal(reference.get_xdata(), np.degrees(expected["rocker_angle"]))
    assert np.array_equal(reference.get_ydata(), np.degrees(expected["coupler_angle"]))
    other_curves = solve(crank, **OTHER_LENGTHS)
    assert np.array_equal(thin.get_xdata(), np.degrees(expected["rocker_angle"]))
    assert np.array_equal(thin.get_ydata(), np.degrees(other_curves["coupler_angle"]))
    assert max(line.get_ydata().max() for line in below.lines[:2]) == pytest.approx(
        0.01 * np.ptp(expected["coupler_angle"]), rel=0.02
    )  # the maximum of the sine is between samples
    assert [line.get_markerfacecolor() for line in coupler.lines[1:3]] == ["#0072B2", "white"]
    assert np.all(np.diff(out.get_xdata()) < 0)
    assert moment.get_ylabel() == "[N·m]"


def stacked_view(**parts: np.ndarray) -> Viewed:
    """A stack of these parts over an angle that goes from 0 to 90 degrees and back."""
    values = {"x": 0.25 * np.pi * (1 - np.cos(np.linspace(0, 2 * np.pi, 61))), **parts}
    view = View(title="t", x="x", stack=tuple(parts), unit="J", x_unit="rad")
    over = apply_first_view(fourbar_with_views(LOOP_VIEW)).over
    seen = PlotData(values, {"x": "rad"} | dict.fromkeys(parts, "J"), {})
    return Viewed(
        view,
        seen,
        {},
        over.__class__(over.case, over.kind, [], x_name="x", x_unit="deg", x_scale=180 / np.pi),
    )


def test_a_constant_sum_is_described_and_drawn_as_constant() -> None:
    angle = 0.25 * np.pi * (1 - np.cos(np.linspace(0, 2 * np.pi, 61)))
    view = stacked_view(spring=2 * (1 - np.cos(angle)), weight=2 * np.cos(angle))
    assert format_spread(view).startswith("2 to 2 J, a spread of ")
    with rc_context(RC):
        pile, below = view_figure(view, {}).axes
    first, second = (c.get_paths()[0].vertices for c in pile.collections)
    assert first[:, 1].max() == pytest.approx(2.0)  # 2 (1 - cos 90°)
    assert second[:, 1].max() == pytest.approx(2.0)  # on top of the first, up to the sum
    assert first[:, 0].max() == pytest.approx(90.0)
    assert np.abs(below.lines[0].get_ydata()).max() < 1e-15


def test_negative_parts_of_a_stack_are_drawn_downwards() -> None:
    one, angle = np.ones(61), np.linspace(0, 1, 61)
    view = stacked_view(up=2 * one, down=-one, both=angle - 0.5)
    assert format_spread(view) == "0.5 to 1.5 J, a spread of 1 J, 100 % of its mean"
    with rc_context(RC):
        up, down, both = (
            c.get_paths()[0].vertices[:, 1] for c in view_figure(view, {}).axes[0].collections
        )
    assert (up.min(), up.max(), down.min(), down.max()) == (0, 2, -1, 0)
    assert both.min() == pytest.approx(-1.5)  # stacked below the other negative part


def test_marks_that_are_near_each_other_share_a_text() -> None:
    view = apply_first_view(
        fourbar_with_views(
            View(
                title="t",
                x="crank",
                y="rocker",
                marks={"c": 2.0, "a": 1.0, "b": 1.0 + 0.02 * np.pi},
            )
        )
    )
    assert [list(group) for group in group_marks(view)] == [["a", "b"], ["c"]]
    assert group_marks(view)[1]["c"] == pytest.approx(np.degrees(2.0))


def test_word_parameters_marks_and_properties_come_from_the_reference(
    stub: Path, tmp_path: Path
) -> None:
    # a parameter that is a word has no relative change
    assert set(perfect_comparisons(stub)[0].detectable) == {"stiffness"}
    result = result_with_errors(load_case(stub), sweep=0.0)
    page = write_report(result, tmp_path / "r").with_name("fourbar.html").read_text("utf-8")
    text = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    assert "<dt>target</dt><dd>sine</dd>" in text
    assert re.search(r'"row">softness</th><td[^>]*>0.5 rad/Nm</td><td[^>]*>0.25 rad/Nm<', text)
    assert re.search(r'"row">load</th><td[^>]*>—</td><td[^>]*>2 N<', text)
    assert re.search(r'"row">target</th><td[^>]*>sine</td><td[^>]*>cosine<', text)
    assert "dashed: target; thin: stiff &amp; heavy; below" in text
    # 2 (2 pi)^2 / 2 = 39.478, printed with four digits
    assert "0 to 39.48 J" in text
    assert "spring on its stop 85.94°" in page  # 3 / 2 rad = 85.94 deg
    ids = re.findall(r'\sid="([^"]*)"', page)
    assert len(ids) == len(set(ids))
    assert (tmp_path / "r" / "figures" / "fourbar-view-2.svg").is_file()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'x = "crank"',
            'x = "cranck"',
            ["view.0.x", "'cranck'", "crank", "holding_moment", "stored"],
        ),
        ('y = "holding_moment"', 'y = "moments"', ["view.0.y", "'moments'", "moment, target"]),
        ('"stored", "lifted"', '"stored", "lift"', ["view.1.stack", "'lift'", "lifted"]),
        ('dashed = "target"', 'dashed = "targets"', ["view.0.dashed", "'targets'", "target"]),
        ('"contacts"', '"contact"', ["view.0.marks", "sprung_crank", "no function 'contact'"]),
        ('x = "crank"', 'x = "target"\nx_unit = "1"', ["view.0.marks", "first drive", "'target'"]),
        ('unit = "J"', "", ["view.1.unit", "'stored'", "must be given"]),
        ('"stored", "lifted"', '"stored", "moment"', ["view.1.stack", "units J, N m"]),
        (
            "stiffness = 4.0",
            "stifness = 4.0",
            ["compare_with.'stiff & heavy'.parameters.stifness", "stiffness, target, weight"],
        ),
        ("stiffness = 4.0", "weigth = 4.0", ["compare_with.'stiff & heavy'.parameters.weigth"]),
        ('"sine"', '["sine"]', ["parameters.target: ", "valid number"]),
        ('y = "holding_moment"', "", ["view.0", "either y or stack"]),
        ('y = "holding_moment"', 'y = ["holding_moment", "moment"]', ["view.0", "one y"]),
        (
            'title = "Energies"',
            'titel = "Energies"',
            ["view.1", "unknown key 'titel'", "title, x, y"],
        ),
        (r"\[\[view\]\].*(?=\[compare_with)", "", ["compare_with", "give a [[view]]"]),
        (
            'x = "crank"',
            'x = "crank"\nrun = "dynamics"',
            ["no run.dynamics records", "holding_moment"],
        ),
    ],
)
def test_errors_of_a_view_name_the_key_and_the_known_values(stub, old, new, words) -> None:
    text, hits = re.subn(old, new, stub.read_text(), count=1, flags=re.DOTALL)
    assert hits
    if "run.dynamics" in words[0]:
        text = text.replace('unit = "N m" }', 'unit = "N m", only = "sweep" }')
    stub.write_text(text)
    with pytest.raises(InputError) as caught:
        validate_case(load_case(stub))
    assert all(word in str(caught.value) for word in ["fourbar.toml", *words]), str(caught.value)


def test_compared_lengths_that_cannot_close_are_named() -> None:
    case = fourbar_with_views(LOOP_VIEW, short=OTHER_LENGTHS | {"coupler": 0.1})
    with pytest.raises(InputError, match=r"compare_with\.'short'\.parameters"):
        validate_case(case)


def test_a_recorded_curve_has_views_but_no_other_parameter_sets() -> None:
    case = load_case(shipped("hacksaw_recorded.toml"))
    name, unit = next((c.equals, c.unit) for c in case.channels.values())
    view = View(title="t", x=case.drive[0].joint, y=name)
    case = case.model_copy(update={"view": (view,)})
    found = apply_first_view(case)
    assert found.own.units[name] == unit
    table = case.model_dump(by_alias=True) | {"compare_with": {"a": {"parameters": {"crank": 1.0}}}}
    with pytest.raises(InputError, match="a recorded curve, which has none"):
        apply_first_view(Case(**table))


def test_solvers_without_the_channel_of_x_are_not_drawn() -> None:
    case = fourbar_with_views(LOOP_VIEW)
    result = result_with_errors(case, sweep=0.0)
    del result.curves[case.name, "sweep", "mujoco"].channels["rocker"]
    view = apply_view(plotted_run(result, case, "sweep"), case.view[0])
    assert not view.over.curves
    assert "markers open" in view_caption(view)
    assert len(view_figure(view, solver_looks(["mujoco"])).axes) == 4


@pytest.mark.parametrize("stiffness", ["3", "0 2"])
def test_springs_are_drawn_as_spirals(models, edit, tmp_path, stiffness) -> None:
    case = load_case(models / "fourbar.toml")
    assert joints_with_springs(case) == set()
    edit("fourbar.xml", '<joint name="rocker"/>', f'<joint name="rocker" stiffness="{stiffness}"/>')
    case = load_case(models / "fourbar.toml")
    assert joints_with_springs(case) == {"rocker"}
    write_report(result_with_errors(case), tmp_path)
    drawing = (tmp_path / "figures" / "fourbar-mechanism.svg").read_text(encoding="utf-8")
    assert "spiral: torsion spring" in drawing


def test_a_view_of_channels_does_not_evaluate_the_reference_again(monkeypatch):
    case = load_case(shipped("rod_snap.toml"))
    run = plotted_run(result_from_references(case), case, "sweep")
    before = apply_views(case, [run])
    assert before

    def fail(*_):
        pytest.fail("the reference was evaluated again")

    monkeypatch.setattr("proofmass.reference.plot_data.all_quantities", fail)
    for view, known in zip(apply_views(case, [run]), before, strict=True):
        assert view.own.values.keys() == known.own.values.keys()
        for name, values in view.own.values.items():
            assert np.array_equal(values, known.own.values[name])
        for solver, truth in view.over.reference.items():
            assert np.array_equal(truth.x, known.over.reference[solver].x)
    curves = next(iter(run.curves.values()))
    with pytest.raises(pytest.fail.Exception):
        plot_data(case, case.view[0], curves)  # without known channels the reference is evaluated
