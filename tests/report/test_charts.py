"""Charts: their tables in a sidecar, their functions, and their place on the page."""

import re
from pathlib import Path

import pytest

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.case.case import ChartTable
from proofmass.reference.charts import check_charts, compute_chart
from proofmass.report import write_report
from proofmass.run.sidecar import load_case
from proofmass.run.validate import validate_case
from tests.report.test_report import case_with_samples, result_with_errors
from tests.shipped import shipped

STUB_REFERENCE = '''"""A crank that knows two charts."""

import numpy as np

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.analytic.protocol import AngularStiffness, Reference


def energies(*, stiffness: float, turns: int = 1) -> Chart:
    if turns > 9:
        raise ValueError(f"turns must be 9 at most, got {turns}")
    angle = np.linspace(0.0, 6.0 * turns, 7)
    line = ChartLine(angle, stiffness * angle**2 / 2, "stored <&>")
    return Chart(("angle", "rad"), ("energy", "J"), (Panel((line,)),), f"Up to {turns} & more.")


def broken(*, stiffness: float, weight: float = 1.0) -> Chart:
    raise IndexError("nothing there")


class Crank(Reference):
    """A crank that knows two charts."""

    charts = (broken, energies)
    stiffness: AngularStiffness

    def solve(self, motion, ask):
        return {"moment": self.stiffness * motion.drive[0]}
'''


CHART_TABLES = """
[[chart]]
title = "Energy"
draw = "energies"
parameters = { turns = 2 }

[[chart]]
title = "Failed"
draw = "broken"
"""


@pytest.fixture
def stub(write_stub_sidecar) -> Path:
    """A sidecar with two charts, the second of a function that fails."""
    return write_stub_sidecar("charted_crank", STUB_REFERENCE, "stiffness = 2.0", CHART_TABLES)


def test_a_chart_function_gets_the_parameters_that_it_takes(stub: Path) -> None:
    case = load_case(stub)
    (line,) = compute_chart(case, case.chart[0]).lines
    assert line.y[-1] == 2.0 * 12.0**2 / 2  # stiffness of the case, turns of the chart
    stiffer = case.chart[0].model_copy(update={"parameters": {"stiffness": 3.0}})
    case = case.model_copy(update={"chart": (stiffer,)})
    (line,) = compute_chart(case, stiffer).lines
    assert line.y[-1] == 3.0 * 6.0**2 / 2  # stiffness of the chart instead of the case


def test_chart_parameters_keep_their_types() -> None:
    table = ChartTable(title="t", draw="d", parameters={"n": 3, "x": 3.0, "s": "a", "ends": [0, 1]})
    assert [type(value) for value in table.parameters.values()] == [int, float, str, tuple]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('draw = "energies"', 'draw = "energy"', ["chart.0.draw", "'energy'", "broken, energies"]),
        ('draw = "broken"', 'draw = "solve"', ["chart.1.draw", "no chart 'solve'"]),
        ("turns = 2", "turn = 2", ["chart.0.parameters.turn", "known: stiffness, turns"]),
        ("stiffness = 2.0", "", ["energies() also needs stiffness"]),
        ("turns = 2", "turns = nan", ["chart.0.parameters.turns: ", "finite"]),
        ("turns = 2", "turns = {}", ["chart.0.parameters.turns: ", "valid"]),
        (
            'title = "Failed"',
            'titel = "Failed"',
            ["chart.1", "unknown key 'titel'", "title, draw, param"],
        ),
        ('title = "Failed"', 'title = ""', ["chart.1.title", "at least 1"]),
    ],
)
def test_errors_of_a_chart_name_the_key_and_the_known_values(
    stub: Path, old: str, new: str, words: list[str]
) -> None:
    text = stub.read_text()
    assert old in text
    stub.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        check_charts(load_case(stub))
    assert all(word in str(caught.value) for word in ["fourbar.toml", *words]), str(caught.value)


def test_a_wrong_chart_is_found_before_anything_runs(stub: Path) -> None:
    validate_case(load_case(stub))
    stub.write_text(stub.read_text().replace('draw = "broken"', 'draw = "solve"', 1))
    with pytest.raises(InputError, match=r"chart\.1\.draw: .* has no chart 'solve'"):
        validate_case(load_case(stub))


@pytest.mark.parametrize("heading", ["[[chart]]", "[chart]"])
def test_the_only_chart_of_a_sidecar_has_no_number_in_errors(stub: Path, heading: str) -> None:
    only = stub.read_text().rpartition("[[chart]]")[0].replace("[[chart]]", heading)
    stub.write_text(only.replace("turns = 2", "turn = 2"))
    with pytest.raises(InputError) as caught:
        check_charts(load_case(stub))
    assert caught.value.key == "chart.parameters.turn"
    stub.write_text(only.replace("turns = 2", "turns = {}"))
    with pytest.raises(InputError) as caught:
        load_case(stub)
    assert caught.value.key.startswith("chart.parameters.turns")


def test_a_check_looks_for_chart_functions_but_does_not_call_them(stub: Path) -> None:
    case = load_case(stub)  # the function of its second chart fails when it is called
    validate_case(case)
    stub.write_text(stub.read_text().replace('"broken"', '"burst"'))
    case = load_case(stub)
    with pytest.raises(InputError, match=r"chart\.1\.draw"):
        validate_case(case)


def test_an_error_of_a_chart_function_names_the_key_of_the_sidecar(stub: Path) -> None:
    stub.write_text(stub.read_text().replace("turns = 2", "turns = 10"))
    case = load_case(stub)
    with pytest.raises(InputError, match=r"chart\.0\.parameters: turns must be 9 at most, got 10"):
        compute_chart(case, case.chart[0])


def test_a_recorded_curve_has_no_charts() -> None:
    table = ChartTable(title="t", draw="equilibria")
    case = load_case(shipped("hacksaw_recorded.toml"))
    with pytest.raises(InputError, match="has no chart 'equilibria'; there are: none"):
        check_charts(case.model_copy(update={"chart": (table,)}))


def test_a_page_has_the_chart_and_names_the_one_that_failed(stub: Path, tmp_path: Path) -> None:
    case = load_case(stub)
    page = write_report(result_with_errors(case, sweep=0.0), tmp_path / "r").with_name(
        "fourbar.html"
    )
    text = page.read_text("utf-8")
    assert 'aria-label="fourbar, Energy, energy over angle: Up to 2 &amp; more."' in text
    plain = re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)
    assert "<figcaption>Up to 2 &amp; more." in plain
    assert "“Failed” is not drawn: IndexError: nothing there</p>" in plain
    assert "stored &lt;&amp;&gt;" in text
    assert plain.count("<figure>") == 2  # the mechanism and the chart that was drawn
    assert plain.index("Charts: ") < plain.index("Sweep: ")
    figures = page.parent / "figures"
    assert not (figures / "fourbar-chart-1.png").exists()  # on demand only, see `test_command_line`
    assert (figures / "fourbar-chart-1.svg").is_file()
    assert not (figures / "fourbar-chart-2.svg").exists()


def test_a_page_reports_a_wrong_chart_parameter_without_folders(stub: Path, tmp_path: Path) -> None:
    stub.write_text(stub.read_text().replace("turns = 2", "turns = 10"))
    case = load_case(stub)
    page = write_report(Result(cases=[case]), tmp_path / "r").with_name("fourbar.html")
    assert "“Energy” is not drawn: fourbar.toml: chart.0.parameters: turns must" in page.read_text(
        "utf-8"
    )


def test_a_case_without_charts_has_no_section_for_them(tmp_path: Path) -> None:
    page = write_report(Result(cases=[case_with_samples("pendulum")]), tmp_path).with_name(
        "pendulum.html"
    )
    assert "Charts: " not in page.read_text("utf-8")


def test_a_chart_function_that_a_reference_imports_is_not_its_own() -> None:
    table = ChartTable(title="t", draw="course")
    case = load_case(shipped("hacksaw.toml"))
    with pytest.raises(InputError, match="has no chart 'course'; there are: newton_convergence, "):
        check_charts(case.model_copy(update={"chart": (table,)}))
