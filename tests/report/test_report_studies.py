"""Studies as parts of the report: the page of diet studies, and links between all pages."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib import rc_context
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.commands.cli import app
from proofmass.report.style import RC
from proofmass.studies.diet.page import SMALLEST_CHANGE, diet_figure, write_diet
from proofmass.studies.diet.table import (
    OPTION_KIND,
    SENTENCE_KIND,
    WHOLE_KIND,
    Entry,
    read_entries,
    summary_sentences,
    write_entries,
)
from proofmass.studies.diet.trial import Cost
from proofmass.studies.pages import write_study_pages
from proofmass.studies.stress.boundary import Boundary, BoundaryKind, write_boundaries
from proofmass.studies.trade.trade import Trade, write_study
from tests.shipped import with_brief_pendulum
from tests.studies.trade.trade_rows import example_study

HEAVY_COST, LEAN_COST = Cost(2e-5, 30_720), Cost(1.5e-5, 20_480)
QUARTER_SAVED, NOTHING_SAVED = (0.2, 0.25, 0.3), (-0.02, 0.01, 0.03)
PENDULUM_RUN = "pendulum dynamics"
ENTRIES = [
    Entry(
        "light",
        "sun",
        "harmless",
        {PENDULUM_RUN: {"angle": 0.0, "rate.x": 0.0}},
        "",
        (HEAVY_COST, LEAN_COST),
        QUARTER_SAVED,
    ),
    Entry("joint", "pivot", "needed", message='no <sensor>, "angle" needs it'),
    Entry(
        "body",
        "bob",
        "matters",
        {PENDULUM_RUN: {"angle": 7e12}},
        "",
        (HEAVY_COST, LEAN_COST),
        QUARTER_SAVED,
    ),
    Entry("geom", "rod", "diverged", message="MuJoCo warning badqacc"),
    Entry(
        "drawn geom",
        "2: rod, bob",
        "drawn",
        {PENDULUM_RUN: {"angle": 2e-3}},
        "",
        (HEAVY_COST, HEAVY_COST),
        NOTHING_SAVED,
    ),
    Entry(
        WHOLE_KIND,
        "",
        "harmless",
        {PENDULUM_RUN: {"angle": 0.5, "rate.x": 0.25}},
        "",
        (HEAVY_COST, LEAN_COST),
        QUARTER_SAVED,
    ),
]


@pytest.fixture
def studies(tmp_path: Path) -> list[Path]:
    """Folders of three studies: trade, stress and diet."""
    folders = [tmp_path / name for name in ("costs", "breaks", "needs")]
    for folder in folders:
        folder.mkdir()
    rows, verdicts = example_study()
    write_study(
        Trade(
            [replace(r, case="pendulum") for r in rows],
            [],
            [replace(v, case="pendulum") for v in verdicts],
        ),
        folders[0],
    )
    write_boundaries(
        [
            Boundary(
                "pendulum",
                "pymunk",
                "as it is",
                "gravity",
                "times",
                1.0,
                1e6,
                2.0,
                2.01,
                limit=BoundaryKind.UNSTABLE,
            )
        ],
        folders[1] / "stress.csv",
    )
    write_entries(ENTRIES, folders[2] / "pendulum.csv")
    (folders[2] / "pendulum.xml").write_text("<mujoco/>")
    return folders


def test_the_table_of_a_diet_study_keeps_all_entries(tmp_path: Path) -> None:
    write_entries(ENTRIES, tmp_path / "pendulum.csv")
    assert read_entries(tmp_path / "pendulum.csv") == ENTRIES
    assert "`moved_over_allowed`" in (tmp_path / "diet.columns.md").read_text()


def test_the_summary_names_what_is_monitored_and_changed_options(tmp_path: Path) -> None:
    option = Entry(
        OPTION_KIND,
        "tolerance 0 to 1e-8",
        "harmless",
        {PENDULUM_RUN: {"angle": 0.5}},
        "",
        (HEAVY_COST, LEAN_COST),
        QUARTER_SAVED,
    )
    longer = Entry(
        OPTION_KIND, "time step 1e-3 to 2e-3 s", "matters", {PENDULUM_RUN: {"rate": 4.0}}
    )
    monitored = Entry(
        SENTENCE_KIND, "", SENTENCE_KIND, message="Monitored: joint crank, and nothing else."
    )
    entries = [monitored, option, longer, replace(ENTRIES[-1], saved=NOTHING_SAVED)]
    write_entries(entries, tmp_path / "a.csv")
    assert read_entries(tmp_path / "a.csv") == entries
    assert list(summary_sentences(entries)) == [
        "Monitored: joint crank, and nothing else.",
        "Nothing can be removed: of 0 features, each tried by itself, 0 change a channel by more "
        "than is allowed, and 0 are needed for the model to run.",
        "Options are changed: tolerance 0 to 1e-8.",
        "The largest error of a channel is 0.5 of what is allowed, of angle in pendulum dynamics.",
        "The time of a run does not change measurably (0.97 to 1.02 of it with 99 %), and 10 KB "
        "less memory.",
        "Options that are not changed, since an error would be too large: time step 1e-3 to 2e-3 s "
        "(4 of what is allowed, of rate).",
    ]


def test_another_table_is_refused_as_a_diet_study(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("kind,feature\nlight,sun\n")
    with pytest.raises(InputError, match="not the table of a diet"):
        write_diet(tmp_path, tmp_path)
    with pytest.raises(InputError, match="proofmass diet"):
        write_diet(tmp_path / "none", tmp_path)


def test_the_page_of_a_diet_study_says_what_can_be_removed_and_saved(studies: list[Path]) -> None:
    text = write_diet(studies[2], studies[2]).first.read_text(encoding="utf-8")
    assert "1 of 5 features can be removed together: light sun." in text
    assert "The largest change is 0.5 of what is allowed, of angle in pendulum dynamics." in text
    assert "A run takes 0.75 of its time (0.7 to 0.8 with 99 %), and 10 KB less memory." in text
    assert re.search(r'data-name="time saved" data-value="0.25">25 % \(20 to 30\)</td>', text)
    assert text.count(">none</td>") == 1  # an interval that contains 0: the drawn geom
    assert "Only drawn, and kept: 2: rod, bob." in text
    assert "MuJoCo warning badqacc" in text


def test_the_page_of_a_diet_study_says_that_nothing_can_be_removed(tmp_path: Path) -> None:
    write_entries([*ENTRIES[1:4], replace(ENTRIES[-1], moved={})], tmp_path / "lean.csv")
    (tmp_path / "lean.xml").write_text("<mujoco/>")
    text = write_diet(tmp_path, tmp_path).first.read_text(encoding="utf-8")
    assert (
        "Nothing can be removed: of 3 features, each tried by itself, 1 changes a channel by more "
        "than is allowed, and 2 are needed for the model to run."
    ) in text
    assert "removed together" not in text
    assert WHOLE_KIND not in text  # no features were removed together


def test_the_figure_of_a_diet_study_shows_changes_and_savings() -> None:
    runs = [e for e in ENTRIES if e.costs]
    with rc_context(RC):
        change, time, memory = diet_figure(runs).axes
    # changes of zero are at the left edge, changes beyond the axis at the right edge
    marks = [line for line in change.lines if line.get_marker() in ("o", "X")]
    assert [m.get_xdata()[0] for m in marks] == [SMALLEST_CHANGE, 1e9, 2e-3, 0.5]
    assert [m.get_marker() for m in marks] == ["o", "X", "o", "o"]
    assert [m.get_markerfacecolor() == "white" for m in marks] == [False, False, True, False]
    assert [round(p.get_width(), 6) for p in time.patches] == [25.0, 25.0, 1.0, 25.0]
    assert [line.get_xdata().tolist() for line in time.lines[1:]] == [
        pytest.approx(span) for span in ([20, 30], [20, 30], [-2, 3], [20, 30])
    ]
    assert [p.get_width() for p in memory.patches] == [10.0, 10.0, 0.0, 10.0]


@pytest.mark.usefixtures("undrawn")
def test_every_link_of_a_report_with_studies_leads_somewhere(
    studies: list[Path], models: Path, tmp_path: Path
) -> None:
    out = tmp_path / "report"
    more = [word for folder in studies for word in ("--study", str(folder))]
    answer = CliRunner().invoke(
        app, ["report", str(with_brief_pendulum(models) / "pendulum.toml"), "-o", str(out), *more]
    )
    assert answer.exit_code == 0, answer.output
    pages = sorted(out.rglob("*.html"))
    assert len(pages) == 6  # report: index, pendulum; trade: index, a case; stress; diet
    for page in pages:
        for link in re.findall(r'href="([^"#]*)(#[^"]*)?"', page.read_text(encoding="utf-8")):
            target = page if not link[0] else page.parent / link[0]
            assert target.is_file(), (page.name, link)
            if "/" in link[1]:  # a link to a curve, which the page's script opens
                channel = re.split("[/@]", link[1])[2]
                assert f'">{channel} <span class="unit">' in target.read_text(encoding="utf-8")
            elif link[1]:
                assert f'id="{link[1][1:]}"' in target.read_text(encoding="utf-8"), link
    case = (out / "pendulum.html").read_text(encoding="utf-8")
    for link in (
        "trade/pendulum-dynamics-trade.html",
        "stress/index.html#pendulum-stress",
        "diet/index.html#pendulum-diet",
    ):
        assert link in case
    for page in (out / "trade" / "index.html", out / "stress" / "index.html"):
        assert 'href="../index.html"' in page.read_text(encoding="utf-8")


def test_a_report_without_studies_does_not_mention_them(models: Path, tmp_path: Path) -> None:
    CliRunner().invoke(
        app, ["report", str(with_brief_pendulum(models) / "pendulum.toml"), "-o", str(tmp_path)]
    )
    for name in ("index", "pendulum"):
        assert "Studies" not in (tmp_path / f"{name}.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("twice", "words"), [(False, "no study is there"), (True, "a second diet study")]
)
def test_wrong_study_folders_are_refused(
    studies: list[Path], tmp_path: Path, twice: bool, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        write_study_pages([studies[2]] * 2 if twice else [tmp_path], tmp_path / "report")
    answer = CliRunner().invoke(app, ["report", "--study", str(tmp_path), "-o", str(tmp_path)])
    assert answer.exit_code == 2
    assert "no study is there" in answer.output
