"""What changed between versions: the search, its words, its page and its command."""

import json
from dataclasses import dataclass
from functools import partial
from math import inf, isnan
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.base.errors import InputError
from proofmass.commands import versions as commands
from proofmass.commands.cli import app
from proofmass.commands.versions import asked_versions
from proofmass.sim.engines import NoEngine, engine_of
from proofmass.sim.hosts import releases
from proofmass.sim.protocol.failures import Unavailable
from proofmass.studies.cells import Cell, CellResult, ChannelError, channel_kind
from proofmass.studies.store import Store, digest
from proofmass.studies.study import Study
from proofmass.studies.versions.bisect import VersionSeries, measure_versions
from proofmass.studies.versions.changes import factor, find_change
from proofmass.studies.versions.page import write_versions
from proofmass.studies.versions.table import as_data, date_lines, format_factor, result_cell
from tests.shipped import shipped, shipped_case

VERSIONS = tuple(f"1.{k}.0" for k in range(16))


@dataclass(frozen=True)
class FakeCell:
    """A case whose error depends on the version as given; each call is counted."""

    name: str
    version: int
    errors: tuple[float, ...]
    calls: list[int]

    @property
    def key(self) -> str:
        """A key of its own."""
        return digest(f"{self.name} {self.version}".encode())

    def measure(self) -> tuple[CellResult, dict[str, np.ndarray]]:
        """The error of the version; a negative one stands for a refusal."""
        self.calls.append(self.version)
        error, solver = self.errors[self.version], f"fake=={VERSIONS[self.version]}"
        if error < 0:
            return CellResult(self.name, "dynamics", solver, "unsupported", "cannot read it"), {}
        found = ChannelError("angle", "rad", "position", error, error)
        x = np.linspace(0.0, 1.0, 5)
        return CellResult(self.name, "dynamics", solver, errors=(found,)), {
            "x": x,
            "angle": x * (1 + error),
        }


def series_of(errors: tuple[float, ...], name: str = "case") -> tuple[VersionSeries, list[int]]:
    """A series of a fake case, and the versions that were measured."""
    calls = list[int]()

    def cell(version: str) -> FakeCell:
        return FakeCell(name, VERSIONS.index(version), errors, calls)

    return VersionSeries(name, cell, VERSIONS), calls


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """A study that measures here."""
    return Study(Store(tmp_path / "runs"))


def test_two_dates_are_found_with_few_runs(study: Study) -> None:
    """A refusal until 1.3 and a correction in 1.11 are found by bisection."""
    series, calls = series_of((-1.0,) * 4 + (1e-3,) * 7 + (1e-7,) * 5)
    measure_versions([series], study)
    changes = series.changes(study.store)
    assert [(one.before, one.after, one.adjacent) for one in changes] == [
        ("1.3.0", "1.4.0", True),
        ("1.10.0", "1.11.0", True),
    ]
    assert len(calls) <= 10
    assert changes[0].outcome_before == "unsupported"
    assert changes[1].ratio == pytest.approx(1e-4)
    assert not changes[0].is_worse
    assert list(date_lines(changes)) == [
        "changed in 1.4.0: 1 case refused, now ran",
        "changed in 1.11.0: errors of 1 case smaller, 1e+04 x",
    ]


def test_nothing_changed_costs_two_runs(study: Study) -> None:
    """Equal ends are not searched; a factor of 1.9 is no change."""
    series, calls = series_of((1e-3,) * 15 + (1.9e-3,))
    measure_versions([series], study)
    assert series.changes(study.store) == []
    assert sorted(calls) == [0, 15]


def test_every_version_is_measured_if_asked_for(study: Study) -> None:
    """Then a change that is taken back is found too."""
    series, calls = series_of((1e-3,) * 5 + (1e-1,) + (1e-3,) * 10)
    measure_versions([series], study, every=True)
    assert len(calls) == 16
    assert [one.after for one in series.changes(study.store)] == ["1.5.0", "1.6.0"]
    assert [one.is_worse for one in series.changes(study.store)] == [True, False]


def test_stored_runs_are_not_made_again(study: Study) -> None:
    """A second search reads the results of the first, with their numbers."""
    errors = (1e-3,) * 8 + (1e-6,) * 8
    first, calls = series_of(errors)
    measure_versions([first], study)
    again, more = series_of(errors)
    measure_versions([again], study)
    assert calls
    assert more == []
    assert again.results == first.results
    assert again.changes(study.store) == first.changes(study.store)


def test_errors_below_rounding_are_the_same() -> None:
    """1e-13 and 1e-12 are both rounding; a curve that did not move did not change either."""
    assert factor(1e-13, 1e-12) == 1.0
    assert factor(float("nan"), 1.0) == inf
    one, two = (
        CellResult("a", "dynamics", f"e=={k}", errors=(ChannelError("x", "m", "position", e, e),))
        for k, e in ((1, 1e-3), (2, 1e-2))
    )
    curve = {"x": np.arange(3.0)}
    assert find_change(one, two, curve, {"x": curve["x"] + 1e-12}) is None
    moved = find_change(one, two, curve, {"x": curve["x"] + 0.01})
    assert moved is not None
    assert moved.moved == pytest.approx(0.005)


def test_another_motion_with_the_same_errors_is_a_change() -> None:
    """A model without a reference is known as closely as its step solves it."""
    one, two = (
        CellResult("a", "passive", f"e=={k}", errors=(ChannelError("x", "m", "position", 0, 1e-6),))
        for k in (1, 2)
    )
    curve = {"x": np.arange(3.0)}
    assert find_change(one, two, curve, {"x": curve["x"] * (1 + 1e-6)}) is None
    other = find_change(one, two, curve, {"x": curve["x"] * 1.01})
    assert other is not None
    assert other.is_other
    assert list(date_lines([other])) == [
        "changed in 2: motions of 1 model moved, by 9.9e-3 of the range at most"
    ]


def test_page_and_json_state_the_changes(study: Study, tmp_path: Path) -> None:
    """The page shows stages of each case; a file of others is refused."""
    found = [series_of((1e-3,) * 8 + (1e-6,) * 8, "linkage")[0], series_of((1e-5,) * 16, "arm")[0]]
    measure_versions(found, study)
    changes = [one for each in found for one in each.changes(study.store)]
    data = as_data(found, changes, "fake")
    (tmp_path / "versions.json").write_text(json.dumps(data, allow_nan=False))
    pages = write_versions(tmp_path, tmp_path)
    text = pages.first.read_text(encoding="utf-8")
    assert "1 case of 2 changed between fake 1.0.0 and 1.15.0" in text
    assert "1.0.0 to 1.7.0" in text
    assert "▼ 1e-6" in text
    assert pages.parts == {"linkage": "index.html#linkage", "arm": "index.html#arm"}
    (tmp_path / "versions.json").write_text("{}")
    with pytest.raises(InputError, match="not what proofmass versions wrote"):
        write_versions(tmp_path, tmp_path)
    with pytest.raises(InputError, match="proofmass versions writes it"):
        write_versions(tmp_path / "none", tmp_path)


def test_words() -> None:
    """Factors, kinds and cells of tables."""
    assert format_factor(inf) == ""
    assert format_factor(2e-4) == "5000 x smaller"
    assert channel_kind("rad/s^2") == "acceleration"
    assert result_cell(None) == ""
    assert result_cell(CellResult("a", "dynamics", "b", "crashed", "why")) == "crashed"
    assert isnan(CellResult("a", "dynamics", "b").position)


def test_a_run_off_by_more_than_a_tenth_is_silently_wrong() -> None:
    """A run that ends without a word, with positions that are wrong."""
    wrong, right = (
        CellResult("a", "dynamics", "b", errors=(ChannelError("x", "m", "position", e, e),))
        for e in (0.2, 0.05)
    )
    assert wrong.is_silently_wrong
    assert not right.is_silently_wrong
    assert not CellResult("a", "dynamics", "b", "crashed").is_silently_wrong


def test_cell_of_a_case_measures_its_run(study: Study) -> None:
    """The error is that of a check; what fails has its outcome and its words."""
    case = shipped_case(shipped("pendulum.toml"))
    found, curves = Cell(case, "dynamics", "mujoco").measure()
    assert found.is_filled
    assert found.position < 1e-9
    assert set(curves) == {"x", *case.channels}
    assert CellResult.read(json.loads(json.dumps(found.record()))) == found
    failed, none = Cell(shipped_case(shipped("euler_top.toml")), "dynamics", "pymunk").measure()
    assert (failed.outcome, none) == ("unsupported", {})
    assert "free joint" in failed.message
    assert Cell(case, "dynamics", "mujoco").key != Cell(case, "dynamics", "mujoco==3.6.0").key


def test_asked_versions() -> None:
    """Versions of one engine are compared, two at least."""
    with pytest.raises(NoEngine, match="versions of one engine"):
        asked_versions(["mujoco==3.3.7", "pymunk==7.0.0"], every=False, since="")
    with pytest.raises(NoEngine, match="two versions"):
        asked_versions(["mujoco==3.3.7"], every=False, since="")
    with pytest.raises(NoEngine, match="only in the version"):
        asked_versions(["recorded"], every=True, since="")


def test_all_releases_begin_with_the_oldest_that_the_engine_states(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Unless `since` or a version is given; of an engine that states none with any release."""
    monkeypatch.setattr(commands, "list_releases", lambda package, oldest, *_: [package, oldest])
    pairs = ("pymunk", ""), ("drake", ""), ("pymunk", "7.0"), ("pymunk==6.9.0", "")
    found = [asked_versions([name], every=True, since=since)[1] for name, since in pairs]
    first = engine_of("pymunk==7.0.0").oldest  # type: ignore[attr-defined]
    assert first.startswith("6.")
    assert found == [("pymunk", first), ("drake", "0"), ("pymunk", "7.0"), ("pymunk", "6.9.0")]


def test_releases_are_asked_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """The newest first, until there is none; without an answer it is said why."""
    there, asked = ["1.2", "1.1", "1.0"], list[str]()

    def newest(requirement: str, must: bool = False) -> str | None:
        asked.append(requirement)
        return there[len(asked) - 1] if len(asked) <= len(there) else None

    monkeypatch.setattr(releases, "newest_release", newest)
    assert releases.list_releases("x", "1.0") == ["1.0", "1.1", "1.2"]
    assert asked == ["x>=1.0", "x>=1.0,<1.2", "x>=1.0,<1.1", "x>=1.0,<1.0"]
    monkeypatch.undo()
    monkeypatch.setattr(releases, "find_uv", partial(raise_unavailable))
    with pytest.raises(Unavailable, match="no uv"):
        releases.list_releases("x", "1.0")


def raise_unavailable() -> str:
    """A machine without uv."""
    raise Unavailable("no uv")


def test_command_without_versions_is_bad_input(tmp_path: Path) -> None:
    """The error says what would have been right."""
    words = ["versions", str(shipped("pendulum.toml")), "--engine", "mujoco==3.3.7"]
    made = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "out")])
    assert made.exit_code == 2
    assert "give two versions of mujoco or more" in made.stderr
