"""The pages in docs/ document every key, setting, reference and public name.

Tables of keys are compared with the classes that read the keys, including defaults.  A test fails
if a key is added, renamed or given another default and its page is not changed.
"""

import importlib
import inspect
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

import proofmass
from docs.make.references import page_with_references
from proofmass import Case, check, load_case
from proofmass.base.recorded import RecordedColumn
from proofmass.case.case import PathTable, ProfileTable
from proofmass.run.sidecar import Accuracy
from proofmass.sim.mujoco.engine import MujocoSettings
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.failures import BadSetting
from proofmass.sim.pymunk.engine import PymunkSettings
from proofmass.sim.recorded.engine import RecordedSettings
from proofmass.verdict.outcome import GOOD_OUTCOMES

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


def page_text(name: str) -> str:
    """The text of a page."""
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def section(text: str, heading: str) -> str:
    """The text between a heading and the next heading."""
    head = re.search(rf"^#+ {re.escape(heading)}$", text, re.MULTILINE)
    assert head, f"no heading {heading!r}"
    return re.split(r"^#+ ", text[head.end() :], maxsplit=1, flags=re.MULTILINE)[0]


def table_rows(text: str) -> dict[str, list[str]]:
    """The cells of the rows of all tables, by the word in backticks in the first cell."""
    cells = [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        for line in text.splitlines()
        if re.match(r"\| \**`", line)
    ]
    return {row[0].strip("*`"): row[1:] for row in cells}


def tables_of(model: type[BaseModel]) -> dict[str, type[BaseModel]]:
    """The classes of the tables that a table of a sidecar contains, by key."""
    found = {}
    for name, field in model.model_fields.items():
        for part in re.findall(r"proofmass[\w.]*\.(\w+)", str(field.annotation)):
            where = re.search(rf"(proofmass[\w.]*)\.{part}\b", str(field.annotation))
            assert where
            kind = getattr(importlib.import_module(where[1]), part)
            if inspect.isclass(kind) and issubclass(kind, BaseModel):
                found[field.alias or name] = kind
    return found


HEADINGS = {
    "recording": "`[recording]`",
    "drive": "`[drive]`",
    "load": "`[load]`",
    "rod": "`[rod.NAME]`",
    "run": "`[run.KIND]`",
    "channels": "`[channels]`",
    "tolerance": "`[[tolerance]]`",
    "view": "`[[view]]`",
    "chart": "`[[chart]]`",
    "compare_with": "`[compare_with.NAME]`",
    "refine": "`[refine]`",
}
ACCURACY = "`accuracy.ENGINE`"
FILLED_IN_DEFAULTS = {
    "run": {"solvers": "all engines", "n": 361},
    "channels": {"equals": "by name", "unit": "SI"},
}
INTERNAL_FIELDS = ("file", "unmatched", "called", "reads_model", "asked")


def compare_keys(text: str, model: type[BaseModel], filled: dict[str, Any]) -> None:
    """Assert that a table of keys has the fields and defaults of the class that reads it."""
    there = {key: row for key, row in table_rows(text).items() if len(row) == 4}
    fields = {
        field.alias or name: field
        for name, field in model.model_fields.items()
        if model is not Case or name not in INTERNAL_FIELDS
    }
    assert list(there) == list(fields)
    for key, field in fields.items():
        *_, default, meaning = there[key]
        own = filled.get(key, field.default)
        if own is PydanticUndefined:
            own = field.default_factory and field.default_factory()
        if field.is_required() and key not in filled:
            assert default == "required", key
        elif own is None:
            assert default == "none", key
        else:
            told = tomllib.loads(f"value = {default.strip('`')}")["value"]
            assert told == (list(own) if isinstance(own, tuple) else own), key
        assert meaning or key in ("title", "length"), key


def test_every_table_of_a_sidecar_has_a_section() -> None:
    assert tables_of(Case).keys() == HEADINGS.keys()


def test_top_level_keys_are_documented() -> None:
    text = section(page_text("sidecar"), "Top level")
    assert "| `accuracy` |" in text  # no field of `Case`, which has the tolerances instead
    compare_keys(
        re.sub(r"^\| `accuracy` .*\n", "", text, flags=re.MULTILINE),
        Case,
        {"model": "NAME.xml", "run": "filled in", "channels": "filled in"},
    )


def test_keys_of_accuracy_are_documented() -> None:
    compare_keys(section(page_text("sidecar"), ACCURACY), Accuracy, {})


@pytest.mark.parametrize("key", HEADINGS)
def test_keys_of_each_table_are_documented(key: str) -> None:
    compare_keys(
        section(page_text("sidecar"), HEADINGS[key]),
        tables_of(Case)[key],
        FILLED_IN_DEFAULTS.get(key, {}),
    )


@pytest.mark.parametrize(
    ("engine", "model"), [("MuJoCo", MujocoSettings), ("pymunk", PymunkSettings)]
)
def test_settings_of_engines_are_documented(engine: str, model: type[BaseModel]) -> None:
    compare_keys(section(page_text("engines"), f"Settings of {engine}"), model, {})


@pytest.mark.parametrize(
    ("name", "heading", "model"),
    [
        ("recorded", "Keys", RecordedSettings),
        ("sidecar", "Sampled profiles", ProfileTable),
        ("sidecar", "Paths", PathTable),
        ("sidecar", "Columns", RecordedColumn),
    ],
)
def test_keys_of_recorded_curves_are_documented(
    name: str, heading: str, model: type[BaseModel]
) -> None:
    compare_keys(section(page_text(name), heading), model, {})


def test_references_on_the_page_are_those_of_the_classes() -> None:
    text = page_text("sidecar")
    assert text == page_with_references(text), "python -m docs.make.references writes the tables"
    there = table_rows(section(text, "References").split("Further functions")[0])
    assert there["fourbar"][1].startswith("**`crank`** [m], **`coupler`** [m], ")
    assert "`motor`" in table_rows(section(text, "Functions of references"))["hacksaw"][0]


def test_the_engine_on_the_page_has_the_protocol_of_engines() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", page_text("engines"), re.MULTILINE | re.DOTALL)
    script, with_part = blocks
    there: dict[str, Any] = {}
    exec(compile(script, "docs/engines.md", "exec"), there)
    assert isinstance(there["ENGINE"], Engine)
    exec(compile(with_part, "docs/engines.md", "exec"), there)
    with pytest.raises(ValueError, match=r"my_package\.tuning:MyTuning, cannot be loaded"):
        _ = there["Mine"]().tuning
    assert there["ENGINE"].settings().timestep == 0.001
    with pytest.raises(BadSetting, match="iterations"):
        there["ENGINE"].check_settings({"iterations": 0.5})


def test_the_script_on_the_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (script,) = re.findall(r"^```python\n(.*?)^```", page_text("python"), re.MULTILINE | re.DOTALL)
    exec(compile(script, "docs/python.md", "exec"), {})
    error, violation, _, *channels = capsys.readouterr().out.split(maxsplit=3)
    assert float(error) < 1e-5
    assert float(violation) < 1e-6
    assert "theta3 agrees" in channels[0]


def test_names_in_the_architecture_are_those_of_the_files() -> None:
    found = re.findall(r"`(\w+)` (?:of|in) `(proofmass/[\w/]+\.py)`", page_text("architecture"))
    assert len(found) > 5
    for name, file in found:
        assert re.search(
            rf"^ *(?:(?:def|class) )?{name}\b", (ROOT / file).read_text(), re.MULTILINE
        ), f"{file} has no {name}"


@pytest.mark.parametrize(
    "page", ["CONTRIBUTING.md", *(f"docs/{name}.md" for name in ("architecture", "testing"))]
)
def test_files_that_a_page_for_contributors_names_exist(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8").replace("/ENGINE/", "/mujoco/")
    named = re.findall(r"`((?:\w+/)+\w+\.(?:py|js|html|md|toml))`", text)
    assert named
    folders = ROOT, ROOT / "proofmass", ROOT / "proofmass" / "report"
    assert [one for one in named if not any((at / one).exists() for at in folders)] == []


def test_public_names_are_on_the_page() -> None:
    told = re.findall(r"^::: proofmass\.(\w+)$", page_text("python"), re.MULTILINE)
    assert sorted(told) == sorted(proofmass.__all__)


def test_the_glossary_has_35_words_in_order() -> None:
    words = [
        line.split("|")[1].strip()
        for line in page_text("glossary").splitlines()
        if line.startswith("| ")
    ][1:]
    assert words == sorted(words)
    assert len(words) == 35


def test_readme_is_short_and_its_sidecar_agrees(tmp_path: Path) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    (sidecar,) = re.findall(r"^```toml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert len(sidecar.splitlines()) <= 15
    shutil.copy(ROOT / "models" / "linkages" / "fourbar.xml", tmp_path / "mine.xml")
    (tmp_path / "mine.toml").write_text(sidecar, encoding="utf-8")
    result = check([tmp_path / "mine.toml"], detectable=False, causes=False)
    assert not result.errors
    outcomes = [c.outcome for c in result.comparisons]
    assert set(outcomes) <= set(GOOD_OUTCOMES), result.comparisons
    assert outcomes.count("agrees") > 60  # all sensors in both runs and engines
    assert result.exit_code == 0


def test_the_first_sidecar_of_the_page_loads(tmp_path: Path) -> None:
    sidecar = re.findall(r"^```toml\n(.*?)^```$", page_text("sidecar"), re.MULTILINE | re.DOTALL)[0]
    shutil.copy(ROOT / "models" / "linkages" / "fourbar.xml", tmp_path / "mine.xml")
    (tmp_path / "mine.toml").write_text(sidecar, encoding="utf-8")
    assert load_case(tmp_path / "mine.toml").reference == "fourbar"


def test_links_lead_to_existing_files_and_headings() -> None:
    """Pages outside docs/; ``mkdocs build --strict`` checks links within docs/."""
    for file in (
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "examples" / "README.md",
        ROOT / "examples" / "chosen" / "README.md",
    ):
        for target, anchor in re.findall(
            r"\]\(([^)#]+)(?:#([^)]+))?\)", file.read_text(encoding="utf-8")
        ):
            assert (file.parent / target).exists(), f"{file}: {target}"
            if anchor:
                page = (file.parent / target).read_text(encoding="utf-8")
                headings = re.findall(r"^#+ (.*)$", page, re.MULTILINE)
                slugs = {re.sub(r"[^\w\- ]", "", h).lower().replace(" ", "-") for h in headings}
                assert anchor in slugs, f"{file}: {target}#{anchor}"


def test_contributing_begins_with_three_commands() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (commands,) = re.findall(r"\A# Contributing\n\n```\n(.*?)```", text, re.DOTALL)
    assert len(commands.splitlines()) == 3
    assert len(text.splitlines()) <= 80
