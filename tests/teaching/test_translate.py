"""The notebooks in Spanish: no text is missing or stale, facts and code are those of the English.

The made notebooks have the syntax trees of the stored ones but for texts and labels, so that they
run where those run; their cells but animations and engines are run here in this process.
"""

import ast
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.notebooks import NAMES, NOTEBOOKS, explored
from proofmass import Explorer
from teaching import translate
from teaching.translate import TextError, Texts, cell_texts, facts, read_texts

SPANISH = read_texts("es")
ENGINE_CELLS = "animation", "engines"  # they start processes
ELEMENT = re.compile(r"/?(body|site|joint|key) ")
"""How a string of a code cell begins that names an element of an MJCF."""
SAME_IN_BOTH = {"deg", "rad", "error", "general", "Grashof"}


def stored(name: str) -> dict[str, Any]:
    """A notebook as it is stored."""
    found: dict[str, Any] = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))
    return found


def english_texts() -> set[str]:
    """All texts of all notebooks."""
    return {text for name in NAMES for cell in stored(name)["cells"] for text in cell_texts(cell)}


def made(name: str, folder: Path, texts: Texts = SPANISH) -> dict[str, Any]:
    """A notebook in Spanish, for a folder."""
    return translate.translate_notebook(stored(name), texts, folder)


def code_of(notebook: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """The names and the code of the code cells of a notebook."""
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            yield cell["id"], "".join(cell["source"])


def test_every_text_has_a_translation_and_every_translation_a_text() -> None:
    assert english_texts() == set(SPANISH.texts)


def test_a_changed_sentence_and_a_missing_one_are_noticed(tmp_path: Path) -> None:
    notebook = stored("pendulum")
    notebook["cells"][0]["source"][2] = notebook["cells"][0]["source"][2].replace(
        "point mass", "disc"
    )
    with pytest.raises(TextError, match=r"es.toml has no translation of 'A disc on a massless rod"):
        translate.translate_notebook(notebook, SPANISH, tmp_path)
    changed = {text for cell in notebook["cells"] for text in cell_texts(cell)}
    assert len(changed - set(SPANISH.texts)) == 1
    comment = stored("pendulum")
    (cell,) = (one for one in comment["cells"] if one["id"] == "constraint")
    cell["source"] = [line.replace("1 m from", "2 m from") for line in cell["source"]]
    with pytest.raises(TextError, match="place of the mass, 2 m from the pin"):
        translate.translate_notebook(comment, SPANISH, tmp_path)


@pytest.mark.parametrize("english", SPANISH.texts)
def test_a_translation_has_the_numbers_code_formulas_and_links_of_its_text(english: str) -> None:
    spanish = SPANISH.texts[english]
    assert facts(spanish) == facts(english)
    assert not re.search(r"\b(the|and|of|with|from|which)\b", spanish)
    assert spanish.count("*") - spanish.count("(*") * 2 == english.count("*")


@pytest.mark.parametrize(
    ("english", "spanish"),
    [
        ("0.5 m long", "mide 0.6 m"),
        ("at 1e-10", "en 1e-9"),
        ("see [a](fourbar.ipynb)", "véase [a](fivebar.ipynb)"),
        ("`sweep` of q''", "`sweep` de q'"),
        ("θ'' = −(g/L) sin θ", "θ'' = (g/L) sin θ"),
        ("the row Φ4", "la fila Φ3"),
        ("s + l is at most p + q", "s + l no supera p"),
    ],
)
def test_a_translation_with_another_number_or_formula_is_noticed(
    english: str, spanish: str
) -> None:
    assert facts(english) != facts(spanish)


def without_texts(code: str) -> str:
    """The syntax tree of a cell without texts, labels and what lets it run elsewhere."""
    tree = ast.parse(code)
    for node, _ in translate.text_nodes(tree):
        node.value = ""
    tree.body = [
        one
        for one in tree.body
        if not (isinstance(one, ast.ImportFrom) and one.module == "translate")
        and ast.unparse(one) != "import sys"
        and not ast.unparse(one).startswith("sys.path")
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            node.keywords = [one for one in node.keywords if one.arg != "labels"]
    return re.sub(r"'[^']*/models/", "'../models/", ast.unparse(tree))


@pytest.mark.parametrize("name", NAMES)
def test_the_code_is_that_of_the_stored_notebook(name: str, tmp_path: Path) -> None:
    english, spanish = dict(code_of(stored(name))), dict(code_of(made(name, tmp_path)))
    assert list(english) == list(spanish)
    for cell, code in english.items():
        assert without_texts(spanish[cell]) == without_texts(code)
    assert 'labels=labels("es"),' in spanish["sliders"]
    fences = [
        block
        for notebook in (stored(name), made(name, tmp_path))
        for cell in notebook["cells"]
        if cell["cell_type"] == "markdown"
        for block in translate.blocks("".join(cell["source"]))
        if block.startswith("```")
    ]
    assert fences[: len(fences) // 2] == fences[len(fences) // 2 :]


@pytest.mark.parametrize("name", NAMES)
def test_no_sentence_of_the_code_is_left_out(name: str) -> None:
    """A string with a blank is a text that is printed, a docstring, or the name of an element."""
    for _, code in code_of(stored(name)):
        texts = {one.text for one in translate.code_texts(code)}
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = node.value
                assert " " not in text or text in texts or is_name(text), text


def is_name(text: str) -> bool:
    """Whether a text with blanks is the name of something, which stays as it is."""
    linkages = "inverted slider-crank", "double crank", "double rocker", "triple rocker"
    return (
        bool(ELEMENT.match(text))
        or text in (*linkages, "left crank", "left coupler")
        or (text in ("right crank", "right coupler", "leg "))
    )


def run_panel(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The variables after the cells of a Spanish notebook, without those that start processes."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    known: dict[str, Any] = {}
    for cell, code in code_of(made(name, folder)):
        if cell not in ENGINE_CELLS:
            exec(compile(code, f"{name}:{cell}", "exec"), known)
    return known


def panel_texts(explorer: Explorer) -> str:
    """All words of the panel and of its sliders."""
    texts = re.findall(r">([^<>]+)</text>", explorer.panel.value)
    sliders = [slider.description for slider in explorer.sliders.values()]
    return "\n".join(
        [*texts, *sliders, explorer.place.description, explorer.button.description]
    ).replace("&#x27;", "'")


def words(text: str) -> set[str]:
    """The words of three letters and more."""
    return set(re.findall(r"[^\W\d_]{3,}", text))


@pytest.mark.parametrize("name", NAMES)
def test_the_made_notebook_runs_and_its_panel_has_no_english_word(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spanish: Explorer = run_panel(name, tmp_path, monkeypatch)["explorer"]
    english = explored(name)
    assert words(panel_texts(spanish)) & words(panel_texts(english)) <= SAME_IN_BOTH
    assert spanish.parameters == english.parameters
    assert "posición" in panel_texts(spanish)
    assert not words(capsys.readouterr().out) & {"the", "errors", "largest", "count"}


def test_every_label_is_used() -> None:
    """By a slider, a curve or another text of a panel in English, by the log, or while it runs."""
    seen = "\n".join(panel_texts(explored(name)) for name in NAMES)
    code = "\n".join(code for name in NAMES for _, code in code_of(stored(name)))
    log = (NOTEBOOKS / "newton_log.py").read_text(encoding="utf-8")
    panel = (NOTEBOOKS.parent / "proofmass" / "report" / "explorer.py").read_text(encoding="utf-8")
    fourbar = NOTEBOOKS.parent / "proofmass" / "analytic" / "linkages" / "fourbar.py"
    places = [seen, code, log, panel, fourbar.read_text(encoding="utf-8")]
    for label in SPANISH.labels:
        pattern = r"(?<![\w.])" + r"\s".join(map(re.escape, label.split())) + r"(?![\w.])"
        assert any(re.search(pattern, place) for place in places), label


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_the_made_notebook_runs_in_a_kernel(name: str, tmp_path: Path) -> None:
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.reads(json.dumps(made(name, tmp_path)), as_version=4)
    found = NotebookClient(
        notebook,
        timeout=300,
        resources={"metadata": {"path": str(tmp_path)}},
        extra_arguments=["--IPKernelApp.log_level=40"],
    ).execute()
    html = "".join(
        output["data"].get("text/html", "")
        for cell in found.cells
        for output in cell.get("outputs", [])
        if "data" in output
    )
    assert html.count("✓ agrees") >= 4
    assert "✗" not in html


def test_the_command_writes_the_notebooks_and_replaces_none_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "es"
    assert translate.main(["es", "-o", str(folder)]) == 0
    assert sorted(file.stem for file in folder.glob("*.ipynb")) == NAMES
    first = (folder / "fourbar.ipynb").read_text(encoding="utf-8")
    assert json.loads(first)["cells"][0]["source"][0] == "# Cuadrilátero articulado\n"
    (folder / "fourbar.ipynb").write_text("mine", encoding="utf-8")
    assert translate.main(["es", "-o", str(folder)]) == 2
    assert "balancer.ipynb exists already: --force replaces it" in capsys.readouterr().err
    assert (folder / "fourbar.ipynb").read_text(encoding="utf-8") == "mine"
    assert translate.main(["es", "-o", str(folder), "--force"]) == 0
    assert (folder / "fourbar.ipynb").read_text(encoding="utf-8") == first


@pytest.mark.parametrize(
    ("language", "folder", "wrong"),
    [
        ("fr", "fr", r"there is no teaching/texts/fr.toml; the languages are: es"),
        ("es", "", r"has the notebooks that are translated: name another folder"),
        ("es", "newton_log.py", r"newton_log.py"),
    ],
)
def test_bad_arguments_end_in_one_line(
    language: str, folder: str, wrong: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {file.name: file.stat().st_mtime_ns for file in NOTEBOOKS.iterdir()}
    assert translate.main([language, "-o", str(NOTEBOOKS / folder), "--force"]) == 2
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == 1
    assert re.search(wrong, printed[0])
    assert {file.name: file.stat().st_mtime_ns for file in NOTEBOOKS.iterdir()} == before


def test_two_translations_of_a_text_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = '[[text]]\nen = "One   text"\nto = "Uno"\n'
    (tmp_path / "xx.toml").write_text("[labels]\n" + text + text.replace("   ", "\\n"))
    monkeypatch.setattr(translate, "TEXTS", tmp_path)
    with pytest.raises(TextError, match="translates twice: 'One text'"):
        read_texts("xx")


def test_a_notebook_finds_models_and_modules_from_its_folder(tmp_path: Path) -> None:
    inside = NOTEBOOKS.parent / "teaching" / "es"
    code = dict(code_of(made("rods", inside)))
    assert 'load_case("../../models/rods/rod_cantilever.toml")' in code["case"]
    assert 'load_case("../../models/rods/pfr3.toml")' in code["animation"]
    assert code["case"].startswith('import sys\n\nsys.path.insert(0, "..")\n')
    outside = dict(code_of(made("rods", tmp_path)))["case"]
    assert f'load_case("{NOTEBOOKS.parent.resolve().as_posix()}/models/rods' in outside
