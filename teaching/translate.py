"""The notebooks in another language, from one file of their texts.

    python -m teaching.translate es -o FOLDER [--force]

texts/es.toml has each English text of the notebooks with its translation, and words for the labels
of the sliders and drawings.  A text is a paragraph, a heading, a list or a table of a text cell;
and in a code cell a comment, a docstring, or a text that is printed.  Formulas in fences stay as
they are.  No notebook is stored in another language.
"""

import argparse
import ast
import io
import json
import os
import re
import sys
import textwrap
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

TEACHING = Path(__file__).parent
TEXTS = TEACHING / "texts"
TEXT_WIDTH = 118  # letters in a line of a text cell
LABELLED = "Explorer", "FoldedLog"
"""Functions that take `labels`."""
FENCE = "```"
FACTS = re.compile(
    r"`[^`]+`"  # code
    r"|\]\([^)]*\)"  # the target of a link
    r"|\d+(?:\.\d+)?(?:e-?\d+)?"  # a number
    r"|[A-Za-zθβ]\d?'{1,2}(?!\w)"  # a derivative by time
    r"|[Φλθαβγφ][A-Za-z0-9]?|[Δπ√·²∂]|[=≤≈|+−←]"  # symbols
)
"""What a translation must leave as it is."""


class TextError(ValueError):
    """A text without a translation, or a language without a file of texts."""


@dataclass(frozen=True)
class Texts:
    """The texts of the notebooks in another language.

    Attributes
    ----------
    language : str
        Its code, such as "es".
    labels : dict of str to str
        Words for labels, by the English ones.
    texts : dict of str to str
        Translations by the English texts, whose white space is single blanks.
    """

    language: str
    labels: dict[str, str]
    texts: dict[str, str]

    def find(self, english: str) -> str:
        """Return the translation of a text; `TextError` if there is none."""
        found = self.texts.get(one_line(english))
        if found is None:
            raise TextError(f"texts/{self.language}.toml has no translation of {english[:60]!r}")
        return found


@cache
def read_texts(language: str) -> Texts:
    """Read texts/LANGUAGE.toml.

    Parameters
    ----------
    language : str
        Code of the language.

    Returns
    -------
    Texts

    Raises
    ------
    TextError
        There is no such file, or it has two translations of a text.
    """
    file = TEXTS / f"{language}.toml"
    if not file.is_file():
        known = ", ".join(sorted(other.stem for other in TEXTS.glob("*.toml")))
        raise TextError(f"there is no teaching/texts/{language}.toml; the languages are: {known}")
    found = tomllib.loads(file.read_text(encoding="utf-8"))
    pairs = [(one_line(text["en"]), text["to"].strip()) for text in found["text"]]
    twice = [english for english, number in Counter(en for en, _ in pairs).items() if number > 1]
    if twice:
        raise TextError(f"{file.name} translates twice: {twice[0][:60]!r}")
    return Texts(language, found["labels"], dict(pairs))


def labels(language: str) -> dict[str, str]:
    """Words for the labels of sliders, drawings and logs, by the English ones.

    >>> labels("es")["crank"]
    'manivela'
    """
    return read_texts(language).labels


def one_line(text: str) -> str:
    """Return a text with single blanks as white space.

    >>> one_line(" two\\n words ")
    'two words'
    """
    return " ".join(text.split())


def blocks(markdown: str) -> Iterator[str]:
    """Yield the paragraphs, headings, lists, tables and fences of a text cell.

    >>> list(blocks("# A\\n\\ntwo\\nlines\\n\\n```\\nx\\n\\ny\\n```"))
    ['# A', 'two\\nlines', '```\\nx\\n\\ny\\n```']
    """
    lines: list[str] = []
    fenced = False
    for line in [*markdown.split("\n"), ""]:
        fenced ^= line.startswith(FENCE)
        if line.strip() or fenced:
            lines.append(line)
        elif lines:
            yield "\n".join(lines)
            lines = []


@dataclass(frozen=True)
class CodeText:
    """A text in a code cell: where it begins and ends, and the form in which it is written."""

    start: int
    end: int
    text: str
    form: str

    def written(self, text: str) -> str:
        """Return a text in the form of this one."""
        return {
            "comment": f"# {text}",
            "docstring": f'"""{text}"""',
            "printed": json.dumps(text, ensure_ascii=False),
        }[self.form]


def code_texts(code: str) -> list[CodeText]:
    """Comments, docstrings and printed texts of a code cell, in their order.

    >>> [(one.form, one.text) for one in code_texts('print("a b", 3, "x")  # why')]
    [('printed', 'a b'), ('printed', 'x'), ('comment', 'why')]
    """
    starts = [0]
    for line in code.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(line: int, column: int) -> int:
        return starts[line - 1] + column

    def of_node(node: ast.Constant, form: str) -> CodeText:
        line, last = (code.splitlines()[k - 1] for k in (node.lineno, node.end_lineno or 0))
        first = len(line.encode()[: node.col_offset].decode())
        end = len(last.encode()[: node.end_col_offset].decode())
        where = place(node.lineno, first), place(node.end_lineno or 0, end)
        return CodeText(*where, str(node.value), form)

    found = [
        CodeText(place(*one.start), place(*one.end), one.string.lstrip("# "), "comment")
        for one in tokenize.generate_tokens(io.StringIO(code).readline)
        if one.type == tokenize.COMMENT
    ]
    found += [of_node(node, form) for node, form in text_nodes(ast.parse(code))]
    return sorted(found, key=lambda one: one.start)


def text_nodes(tree: ast.Module) -> Iterator[tuple[ast.Constant, str]]:
    """Yield the constants of a cell that are docstrings or printed texts, with their form."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and isinstance(node.body[0], ast.Expr):
            first = node.body[0].value
            if isinstance(first, ast.Constant) and isinstance(first.value, str):
                yield first, "docstring"
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print":
            for each in node.args:
                if isinstance(each, ast.Constant) and re.search("[A-Za-z]", str(each.value)):
                    yield each, "printed"


def cell_texts(cell: Mapping[str, Any]) -> list[str]:
    """Return the texts of a cell of a notebook that a translation has, each in one line."""
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return [one_line(block) for block in blocks(source) if not block.startswith(FENCE)]
    return [one_line(one.text) for one in code_texts(source)]


def translate_markdown(markdown: str, texts: Texts) -> str:
    """Translate a text cell."""
    return "\n\n".join(
        block if block.startswith(FENCE) else lay_out(texts.find(block))
        for block in blocks(markdown)
    )


def lay_out(text: str) -> str:
    """Return a paragraph in lines of one width, and headings, lists and tables as they are."""
    if text.startswith(("#", "|", "- ")):
        return text
    return textwrap.fill(one_line(text), TEXT_WIDTH, break_long_words=False, break_on_hyphens=False)


def translate_code(code: str, texts: Texts) -> str:
    """Translate a code cell, and give the labels to what it shows."""
    for one in reversed(code_texts(code)):
        text = one_line(texts.find(one.text))
        code = code[: one.start] + one.written(text) + code[one.end :]
    return with_labels(code, texts.language)


def with_labels(code: str, language: str) -> str:
    """Return the code with the argument `labels` in the calls that take it, and its import.

    >>> print(with_labels("Explorer(case)", "es"))
    from translate import labels
    <BLANKLINE>
    Explorer(case, labels=labels("es"))
    """
    calls = [
        node
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in LABELLED
    ]
    lines = code.splitlines()
    given = f'labels=labels("{language}")'
    for call in calls:
        row = (call.end_lineno or 0) - 1
        end = len(lines[row].encode()[: call.end_col_offset].decode()) - 1
        if lines[row][:end].strip():
            lines[row] = f"{lines[row][:end]}, {given}{lines[row][end:]}"
        else:
            lines.insert(row, f"    {given},")
    return "\n".join(["from translate import labels", "", *lines] if calls else lines)


def translate_notebook(notebook: Mapping[str, Any], texts: Texts, folder: Path) -> dict[str, Any]:
    """Translate a notebook of this folder, for another folder.

    Parameters
    ----------
    notebook : mapping
        The notebook, as JSON.
    texts : Texts
        The other language.
    folder : Path
        Where the notebook will be: its models and modules are found from there.

    Returns
    -------
    dict
        The notebook without outputs.

    Raises
    ------
    TextError
        A text has no translation.
    """
    cells = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            cells.append({**cell, "source": split_lines(translate_markdown(source, texts))})
            continue
        made = translate_code(source, texts).replace('"../models', f'"{models_from(folder)}')
        if cell["id"] == "case" and folder.resolve() != TEACHING.resolve():
            where = json.dumps(path_from(folder, TEACHING), ensure_ascii=False)
            made = f"import sys\n\nsys.path.insert(0, {where})\n\n{made}"
        cells.append({**cell, "outputs": [], "source": split_lines(made)})
    return {**notebook, "cells": cells}


def models_from(folder: Path) -> str:
    """The folder of the models as a notebook in this folder names it."""
    return path_from(folder, TEACHING.parent / "models")


def path_from(folder: Path, place: Path) -> str:
    """A place as a notebook in a folder names it: relative to it within the repository."""
    here, there = folder.resolve(), place.resolve()
    if here.is_relative_to(TEACHING.parent.resolve()):
        return Path(os.path.relpath(there, here)).as_posix()
    return there.as_posix()


def split_lines(text: str) -> list[str]:
    """Return a text as the lines of a cell, with their ends."""
    return text.splitlines(keepends=True)


def facts(text: str) -> Counter[str]:
    """Numbers, code, formulas and links of a text, which its translation must have as well.

    >>> sorted(facts("Two steps of 0.1 s: `sweep` gives x'' and θ.").elements())
    ['0.1', '`sweep`', "x''", 'θ']
    """
    return Counter(FACTS.findall(text))


def main(arguments: Iterable[str] | None = None) -> int:
    """Write the notebooks in another language; returns the exit code."""
    parser = argparse.ArgumentParser("python -m teaching.translate", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("language", help="es")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--force", action="store_true", help="replace notebooks of the folder")
    given = parser.parse_args(None if arguments is None else list(arguments))
    try:
        texts = read_texts(given.language)
        files = {file.name: file for file in sorted(TEACHING.glob("*.ipynb"))}
        made = {
            name: translate_notebook(json.loads(file.read_text("utf-8")), texts, given.output)
            for name, file in files.items()
        }
        require_free(given.output, made, given.force)
        given.output.mkdir(parents=True, exist_ok=True)
    except (TextError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for name, notebook in made.items():
        text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
        (given.output / name).write_text(text, encoding="utf-8")
    print(f"{given.output}: {len(made)} notebooks")
    return 0


def require_free(folder: Path, names: Iterable[str], force: bool) -> None:
    """Raise `TextError` if a notebook would be replaced, unless this is wanted and none of ours."""
    if folder.resolve() == TEACHING.resolve():
        raise TextError(f"{folder} has the notebooks that are translated: name another folder")
    there = [name for name in names if (folder / name).exists()]
    if there and not force:
        raise TextError(f"{folder / there[0]} exists already: --force replaces it")


if __name__ == "__main__":
    sys.exit(main())
