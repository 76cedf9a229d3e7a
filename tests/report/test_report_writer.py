"""A report that is written while its cases are checked: its memory, and after an interrupt."""

import gc
import re
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from proofmass.base.errors import INTERRUPTED
from proofmass.batch.check import Result, check
from proofmass.commands import cli
from proofmass.report.pages import ReportWriter
from proofmass.report.record import RECORD_NAME, record_start
from tests.commands.test_output import invoke_command
from tests.shipped import shipped

COUNT = 4
PENDULUM = shipped("pendulum.toml")


@pytest.fixture
def copies(tmp_path: Path) -> Path:
    """A folder with four pendulums, each with a short run in two solvers."""
    folder = tmp_path / "pendulums"
    folder.mkdir()
    text = PENDULUM.read_text()
    text = text.replace("until = 10.0 ", "until = 0.1 ").replace("n = 1001", "n = 11")
    text = text.rpartition("[[tolerance]]")[0]  # that of pymunk
    text = re.sub(r"solvers = .*", 'solvers = ["mujoco", "mujoco:default"]', text)
    for k in range(COUNT):
        (folder / f"p{k}.toml").write_text(text.replace("pendulum.xml", f"p{k}.xml"))
        (folder / f"p{k}.xml").write_bytes(PENDULUM.with_suffix(".xml").read_bytes())
    return folder


class Recorder:
    """A consumer that records what happens, and whether curves of earlier cases are alive."""

    def __init__(self) -> None:
        self.events, self.curves, self.alive = list[str](), list[weakref.ref](), list[int]()

    def begin(self, result: Result) -> None:
        self.events.append(f"begin with {len(result.cases)}")

    def take(self, part: Result) -> None:
        gc.collect()
        self.alive.append(sum(ref() is not None for ref in self.curves))
        assert {c.case for c in part.comparisons} == {case.name for case in part.cases}
        self.curves += map(weakref.ref, part.curves.values())
        self.events.append(f"take {part.cases[0].name} with {len(part.curves)}")


def test_a_case_is_taken_when_its_last_run_has_ended_and_its_curves_are_dropped(copies: Path):
    recorder = Recorder()
    result = check(
        [copies],
        jobs=1,
        progress=lambda label, *_: recorder.events.append(label),
        consumer=recorder,
    )
    expected = ["begin with 4"]
    for k in range(COUNT):
        expected += [f"p{k} dynamics mujoco", f"p{k} dynamics mujoco:default", f"take p{k} with 2"]
    assert recorder.events == expected
    assert recorder.alive == [0] * COUNT  # of the cases before, whatever their number
    assert result.curves == {}
    whole = check([copies])
    assert len(whole.curves) == 2 * COUNT

    def told(one: Result) -> list[tuple]:
        return [(c.case, c.run, c.solver, c.channel, c.error_max) for c in one.comparisons]

    assert told(result) == told(whole)


def interrupt_at(case: str) -> Callable[[], object]:
    """A progress bar that raises what Ctrl-C raises when a run of a case has ended."""

    @contextmanager
    def bar() -> Iterator[Callable[[str, int, int], None]]:
        def advance(label: str, done: int, total: int) -> None:
            if label.startswith(case):
                raise KeyboardInterrupt

        yield advance

    return bar


def test_an_interrupted_report_keeps_its_pages_and_names_the_missing_cases(
    copies: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "pages"
    command = ["report", copies, "-o", out, "--jobs", "1"]
    with monkeypatch.context() as patch:
        patch.setattr(cli, "progress_bar", interrupt_at("p2"))
        answer = invoke_command(*command)
    assert answer.exit_code == INTERRUPTED
    assert "has the pages of 2 cases" in answer.output
    assert [(out / f"p{k}.html").exists() for k in range(COUNT)] == [True, True, False, False]
    index = (out / "index.html").read_text(encoding="utf-8")
    assert "the results of 2 of 4 cases are missing." in index
    assert "Missing: p2, p3." in index
    assert re.findall(r'<tr data-name="(\w+)"', index) == ["p0", "p1"]
    assert not (out / RECORD_NAME).exists()  # the next report is not compared with half a report
    assert invoke_command(*command).exit_code == 0
    index = (out / "index.html").read_text(encoding="utf-8")
    assert "missing" not in index
    assert set(re.findall(r'<tr data-name="(\w+)"', index)) == {f"p{k}" for k in range(COUNT)}
    record = (out / RECORD_NAME).read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(cli, "progress_bar", interrupt_at("p0"))
        answer = invoke_command(*command)
    assert "stopped before the first case had ended" in answer.output
    assert (out / "index.html").read_text(encoding="utf-8") == index  # the last report stays
    assert (out / RECORD_NAME).read_bytes() == record


def test_the_index_of_a_process_that_was_killed_names_the_missing_cases(
    copies: Path, tmp_path: Path
):
    """The index is written after 1, 2, 4 and so on cases: at least half of them are in it."""
    written = []

    class Writer(ReportWriter):
        def write_unfinished(self) -> None:
            super().write_unfinished()
            index = (self.folder / "index.html").read_text(encoding="utf-8")
            written.append(re.findall(r'<tr data-name="(\w+)"', index))

    writer = Writer(tmp_path / "pages", record_start())
    result = check([copies], jobs=1, consumer=writer)
    assert written == [["p0"], ["p0", "p1"]]
    assert "missing" not in writer.finish(result).read_text(encoding="utf-8")


def test_an_error_of_one_page_is_raised_after_the_results_are_known(
    copies: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    writer = ReportWriter(tmp_path / "pages", record_start())
    page = ReportWriter.write_page
    tried = []

    def full(self: ReportWriter, part: Result) -> None:
        tried.append(part.cases[0].name)
        if part.cases[0].name == "p1":
            raise OSError(28, "No space left on device")
        page(self, part)

    monkeypatch.setattr(ReportWriter, "write_page", full)
    result = check([copies], jobs=1, consumer=writer)
    assert {c.case for c in result.comparisons} == {f"p{k}" for k in range(COUNT)}
    with pytest.raises(OSError, match="No space left"):
        writer.finish(result)
    assert tried == ["p0", "p1"]  # no further page fills the disk
