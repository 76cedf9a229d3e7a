"""The tables and lines that the terminal shows of a check, and the result as JSON."""

import json
from io import StringIO
from math import inf, nan
from pathlib import Path

import pytest
from rich.console import Console

from proofmass.base.errors import InputError
from proofmass.batch.check import Result
from proofmass.commands import cli
from proofmass.evidence.diagnosis import Diagnosis
from proofmass.formats import terminal
from proofmass.formats.terminal import (
    as_json,
    case_table,
    failure_lines,
    format_outcome,
    make_console,
    summary_tables,
    three_digits,
    worst_comparison,
)
from proofmass.run.sidecar import load_case
from proofmass.verdict.comparison import UNCHECKED_CASE, Comparison, DetectableChange
from tests.shipped import MODELS, shipped, shipped_files


def make_comparison(
    case: str = "one", solver: str = "mujoco", channel: str = "y", outcome: str = "agrees", **more
) -> Comparison:
    """A comparison of one channel in a sweep."""
    return Comparison(case, solver, "sweep", channel, "m", outcome=outcome, **more)


NEAR = make_comparison(
    error_max=9e-3, allowed=1e-2, error_rms=1e-3, nrmse=2e-3, seconds=1.234, steps=70, at=0.5
)
FAR = make_comparison(channel="x", error_max=1e-3, allowed=1e-2, seconds=1.234, steps=70)
BEYOND = make_comparison(
    "two",
    channel="x",
    outcome="differs",
    error_max=2e-2,
    allowed=1e-2,
    at=1234567.0,
    message="2 x the allowed error",
)
WORSE = make_comparison(
    "two",
    channel="y",
    outcome="differs",
    error_max=3e-2,
    allowed=1e-2,
    at=1234567.0,
    message="3 x the allowed error",
)
FAILED = make_comparison("two", "pymunk", outcome="diverged", message="the loops are open")
RESULT = Result(comparisons=[FAR, NEAR, BEYOND, WORSE, make_comparison("two", channel="z"), FAILED])


def table_cells(*args, **how) -> list[list[str]]:
    """The header and the rows of the only summary table, without colours."""
    (table,) = summary_tables(*args, **how)
    columns = [[str(column.header), *map(str, column.cells)] for column in table.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def screen_lines(*shown: object, width: int) -> list[str]:
    """The lines in which objects appear on a screen of some width, without trailing blanks."""
    screen = Console(width=width, highlight=False, markup=False, emoji=False)
    with screen.capture() as caught:
        for each in shown:
            screen.print(each)
    return [line.rstrip() for line in caught.get().splitlines()]


TABLE_HEADER = [
    "case",
    "run",
    "solver",
    "outcome",
    "channel",
    "worst error",
    "allowed",
    "of range",
    "of allowed",
    "s",
    "steps",
]


def test_a_solver_has_a_row_with_its_worst_channel():
    assert table_cells(RESULT) == [
        TABLE_HEADER,
        [
            "one",
            "sweep",
            "mujoco",
            "✓ agrees coarsely 2/2",
            "y",
            "9.00e-03 m",
            "1.00e-02",
            "1.80e-02",
            "0.90",
            "1.23",
            "70",
        ],
        [
            "two",
            "sweep",
            "mujoco",
            "✗ differs 2/3",
            "y",
            "3.00e-02 m",
            "1.00e-02",
            "–",
            "3.00",
            "–",
            "–",
        ],
        ["", "sweep", "pymunk", "✗ diverged", "y", "– m", "–", "–", "–", "–", "–"],
    ]


def test_each_channel_has_a_row_if_all_are_requested():
    rows = table_cells(RESULT, every_channel=True)
    assert [row[0] for row in rows[1:]] == ["one", "", "two", "", "", ""]
    assert [row[3:5] for row in rows[1:]] == [
        ["✓ agrees", "x"],  # it has no range
        ["✓ agrees coarsely", "y"],
        ["✗ differs", "x"],
        ["✗ differs", "y"],
        ["✓ agrees", "z"],
        ["✗ diverged", "y"],
    ]


def test_an_error_over_its_tolerance_has_two_digits():
    shares = [
        terminal.format_ratio(make_comparison(error_max=e, allowed=1e-2))
        for e in (0.0, 1e-7, 1e-3, 2.0, 3e3, nan)
    ]
    assert shares == ["0", "1.0e-05", "0.10", "200.00", "3.0e+05", "–"]
    assert terminal.format_ratio(make_comparison(error_max=1.0, allowed=0.0)) == "–"


def test_a_narrow_screen_has_fewer_columns():
    for width, head in (
        (109, TABLE_HEADER),
        (108, TABLE_HEADER[:9]),
        (96, TABLE_HEADER[:9]),
        (95, [*TABLE_HEADER[:5], *TABLE_HEADER[7:9]]),
        (73, [*TABLE_HEADER[:5], *TABLE_HEADER[7:9]]),
        (72, [*TABLE_HEADER[:4], *TABLE_HEADER[7:9]]),
    ):
        (table,) = summary_tables(RESULT, width=width)
        assert [c.header for c in table.columns] == head
        assert max(map(len, screen_lines(table, width=width))) <= width
    assert list(summary_tables(Result())) == []
    (table,) = summary_tables(RESULT)
    assert all(column.no_wrap for column in table.columns)
    assert [c.justify for c in table.columns] == ["left"] * 5 + ["right"] * 6
    assert (table.box, table.header_style, table.pad_edge) == (None, "bold", False)


LONGEST_NAMES = [
    make_comparison(
        "balancer_progressive_contact",
        solver,
        "right_coupler_acceleration.z",
        "out of memory" if solver == "pymunk" else "agrees",
        error_max=9e-3,
        allowed=1e-2,
        error_rms=1e-3,
        nrmse=2e-3,
    )
    for solver in ("mujoco:settled", "pymunk")
]


def test_no_word_is_broken_on_80_columns():
    """The longest names of the shipped cases fit, and each line has the error of the engine."""
    found = screen_lines(
        *summary_tables(Result(comparisons=[*LONGEST_NAMES, NEAR]), width=80), width=80
    )
    assert found == [
        "balancer_progressive_contact",
        "  run    solver          outcome            of range  of allowed",
        "  sweep  mujoco:settled  ✓ agrees coarsely  1.80e-02        0.90",
        "  sweep  pymunk          ✗ out of memory    1.80e-02        0.90",
        "one",
        "  sweep  mujoco          ✓ agrees coarsely  1.80e-02        0.90",
    ]
    assert screen_lines(
        *summary_tables(Result(comparisons=LONGEST_NAMES), True, width=80), width=80
    ) == [
        "balancer_progressive_contact sweep mujoco:settled",
        "  channel                       outcome            of range  of allowed",
        "  right_coupler_acceleration.z  ✓ agrees coarsely  1.80e-02        0.90",
        "balancer_progressive_contact sweep pymunk",
        "  right_coupler_acceleration.z  ✗ out of memory    1.80e-02        0.90",
    ]


def test_lines_on_failures_break_between_words(monkeypatch):
    screen = Console(width=80, file=StringIO(), force_terminal=True, color_system=None)
    monkeypatch.setattr(terminal, "make_console", lambda: screen)
    cli.print_result(RESULT)
    lines = screen.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    text = " ".join(line.strip() for line in lines)
    assert all(line.plain in text for line in failure_lines(RESULT))


def test_each_shipped_case_is_listed_on_a_line_of_80_columns():
    cases = [load_case(file) for file in shipped_files("*.toml")]
    lines = screen_lines(case_table(cases, [Path("lone/humanoid.xml")], [MODELS], 80), width=80)
    assert len(lines) == len(cases) + 2
    assert max(map(len, lines)) <= 80
    for case, line in zip(cases, lines[1:], strict=False):
        name, runs = line.split("  ")[0], ", ".join(case.run)
        assert name == case.name
        assert runs in line
        title = line.partition(f"  {runs} ")[2].strip()
        words = title.removesuffix("…").split()
        assert words == case.title.split()[: len(words)]
        assert title.endswith("…") == (len(words) < len(case.title.split()))


def test_failures_have_a_line_each_and_all_outcomes_are_counted():
    lines = [line.plain for line in failure_lines(RESULT)]
    assert lines == [
        "✗ two sweep mujoco differs: 2 of 3 curves, y by 3 x the allowed error: 0.03 m, "
        "— of its range, at 1.23e+06",
        "✗ two sweep pymunk diverged: the loops are open",
        "largest error 1.80e-02 of the range (one sweep mujoco y); nearest to its limit 3.00 of "
        "what is allowed (two sweep mujoco y)",
        "3 agrees, 2 differs, 1 diverged",
    ]
    assert list(failure_lines(RESULT))[-1].style == "bold red"
    assert [str(span.style) for line in failure_lines(RESULT) for span in line.spans] == ["red"] * 2
    how_well, good = failure_lines(Result(comparisons=[NEAR, FAR]))
    assert how_well.plain == (
        "largest error 1.80e-02 of the range (one sweep mujoco y); nearest to its limit 0.90 of "
        "what is allowed (one sweep mujoco y)"
    )
    assert (good.plain, good.style) == ("2 agrees", "bold")
    assert [line.plain for line in failure_lines(Result())] == ["nothing to check"]


@pytest.mark.parametrize("turn", [1, -1])
def test_the_curve_nearest_to_its_limit_may_be_undecided_or_not_finite(turn):
    """The order of the comparisons makes no difference; no other curve counts."""
    undecided = make_comparison(channel="z", outcome="undecided", error_max=9.5e-3, allowed=1e-2)
    unchecked = make_comparison(channel="u", outcome="unchecked", error_max=9.0)
    not_finite = make_comparison(channel="n", outcome="differs", error_max=nan, allowed=1e-2)
    for more, word in ((undecided, "0.95"), (not_finite, "–")):
        shown = Result(comparisons=[NEAR, more, unchecked, FAR][::turn])
        (line,) = (one.plain for one in failure_lines(shown) if "nearest" in one.plain)
        assert line.endswith(
            f"nearest to its limit {word} of what is allowed (one sweep mujoco {more.channel})"
        )


def test_failures_have_a_link_after_their_lines():
    pendulum, key = load_case(shipped("pendulum.toml")), ("pendulum", "sweep", "mujoco")
    rows = [
        make_comparison("pendulum", "mujoco", "angle", "differs", error_max=1.0),
        make_comparison("pendulum", "pymunk", "angle"),
        make_comparison("loose", "mujoco", "angle", "diverged"),  # a case without a page
    ]
    diagnosis = Diagnosis(*key, remarks=("it went too far",), failed=True)
    result = Result([pendulum], rows, diagnoses={key: diagnosis})
    lines = [line.plain for line in failure_lines(result, lambda c: f"there/{c.channel}")]
    assert lines[1:3] == ["  failed: it went too far", "  there/angle"]
    assert sum("there/" in line for line in lines) == 1
    assert not any("there/" in line.plain for line in failure_lines(result))


def test_a_case_without_a_check_has_a_line():
    case = load_case(shipped("pendulum.toml"))
    lines = list(
        failure_lines(
            Result(
                [case],
                [
                    make_comparison("pendulum", outcome="unchecked"),
                    make_comparison("pendulum", outcome="unsupported"),
                ],
            )
        )
    )
    assert [str(span.style) for span in lines[0].spans] == ["red"]
    assert [line.plain for line in lines] == [
        f"✗ pendulum unchecked: {UNCHECKED_CASE}",
        "1 unchecked, 1 unsupported, 1 case(s) without any check",
    ]


@pytest.mark.parametrize(
    ("outcome", "sign", "style"),
    [
        ("agrees", "✓", "green"),
        ("unchecked", "·", "dim"),
        ("unsupported", "–", "dim"),
        ("differs", "✗", "bold red"),
        ("crashed", "✗", "bold red"),
    ],
)
def test_an_outcome_has_a_sign(outcome, sign, style):
    assert (format_outcome(outcome).plain, format_outcome(outcome).style) == (
        f"{sign} {outcome}",
        style,
    )


def test_numbers_have_three_digits():
    assert [three_digits(v) for v in (123456.0, nan, inf)] == ["1.23e+05", "–", "–"]


def test_the_worst_comparison_is_nearest_to_its_tolerance():
    """Comparisons count by error over tolerance, or by `nrmse` if the tolerance is not above 0."""
    unbounded = [
        make_comparison(channel="a", outcome="unchecked", nrmse=n) for n in (0.2, 0.1, nan)
    ]
    assert worst_comparison(unbounded) is unbounded[0]
    assert worst_comparison(unbounded[::-1]) is unbounded[0]
    zero = make_comparison(error_max=5.0, allowed=0.0, nrmse=0.05, outcome="unchecked")
    assert worst_comparison([zero, unbounded[1]]) is unbounded[1]
    wide = make_comparison(error_max=3.0, allowed=9.0)
    assert worst_comparison([wide, make_comparison(error_max=1.0, allowed=2.0)]) is not wide
    tiny = make_comparison(error_max=0.0, allowed=0.5)
    assert worst_comparison([unbounded[2], tiny]) is tiny


def test_json_has_null_for_nan_and_infinity():
    notice = {"length": DetectableChange(nan), "width": DetectableChange(0.5, relative=False)}
    error = InputError(Path("a.toml"), "key", "why")
    found = json.loads(
        as_json(
            Result(
                comparisons=[make_comparison(detectable=notice, at=inf, seconds=2.0)],
                errors=[error],
            )
        )
    )
    assert list(found) == [
        "comparisons",
        "grades",
        "causes",
        "diagnoses",
        "notes",
        "versions",
        "screens",
        "errors",
        "of_others",
        "exit_code",
    ]
    assert found["errors"] == [{"file": "a.toml", "key": "key", "wrong": "why"}]
    assert found["exit_code"] == 2
    (row,) = found["comparisons"]
    assert tuple(row) == (*terminal.COMPARISON_KEYS, "grade")
    assert (
        row["case"],
        row["solver"],
        row["run"],
        row["channel"],
        row["unit"],
        row["outcome"],
        row["at"],
        row["error_max"],
        row["seconds"],
    ) == ("one", "mujoco", "sweep", "y", "m", "agrees", None, None, 2.0)
    assert row["detectable"] == {
        "length": {"size": None, "relative": True},
        "width": {"size": 0.5, "relative": False},
    }
    assert as_json(Result()).splitlines()[1] == ' "comparisons": [],'


def test_markup_in_names_is_printed_and_tables_are_not_cut(monkeypatch, capsys):
    shown = make_console()
    assert shown.width == terminal.UNLIMITED_WIDTH
    shown.print("a [bold] b :smile: 1.5")
    assert capsys.readouterr().out == "a [bold] b :smile: 1.5\n"
    monkeypatch.setattr(
        terminal, "Console", lambda **how: Console(**{"force_terminal": True, "width": 70, **how})
    )
    screen = make_console()
    assert screen.width == 70
    screen.print("a [bold] b :smile: 1.5")
    assert capsys.readouterr().out == "a [bold] b :smile: 1.5\n"  # no colour for the number


def test_cases_are_listed_with_their_runs():
    case = load_case(shipped("fourbar.toml"))
    table = case_table([case], [Path("lone/humanoid.xml")], [MODELS, Path("lone")])
    assert (table.box, table.header_style, table.pad_edge) == (None, "bold", False)
    columns = [[str(column.header), *map(str, column.cells)] for column in table.columns]
    assert [list(row) for row in zip(*columns, strict=True)] == [
        ["folder", "case", "model", "reference", "runs", "channels", "title"],
        [
            "linkages",
            "fourbar",
            "fourbar.xml",
            "fourbar",
            "sweep: mujoco, pymunk; dynamics: mujoco, mujoco:default, pymunk, pymunk:default",
            "17",
            case.title,
        ],
        ["lone", "humanoid", "humanoid.xml", "–", "own motion: mujoco", "", ""],
    ]
