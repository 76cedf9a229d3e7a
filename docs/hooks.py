"""What ``mkdocs build`` does to the pages.

It gives the theme's script for dark pages the two style sheets that it looks for, which the theme
has only with a highlighter from the network; without them every page would throw an error.

It finds where public names of proofmass are defined: ``::: proofmass.solve`` would be the module of
that name; the function is what users import.  And it runs the notebooks, which have only pictures
of their sliders in the repository, and makes a page of each; sliders stand there as they are first.
"""

import re
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

import proofmass

PUBLIC = re.compile(r"^::: proofmass\.(\w+)$", re.MULTILINE)
NOTEBOOKS = Path(__file__).parent.parent / "teaching"
SECONDS = 300  # a cell may take on a busy machine
LINK = re.compile(r"\((\w+)\.ipynb\)")
"""A link from a notebook to another one, which has a page beside it."""
WHERE = "*This page is `teaching/{}.ipynb`, run when the documentation was made.*"


NO_HIGHLIGHTER = '<style id="hljs-light"></style><style id="hljs-dark"></style>'
"""Empty style sheets that the script ``darkmode.js`` of the theme switches."""


def on_post_page(output: str, **_: object) -> str:
    """Add the style sheets that the theme's script looks for."""
    return output.replace("</head>", f"{NO_HIGHLIGHTER}</head>", 1)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Write the full path of each public name that a page documents."""
    return PUBLIC.sub(lambda found: f"::: {path(found[1])}", markdown)


def path(name: str) -> str:
    """Module and name of what ``from proofmass import name`` gives."""
    there = getattr(proofmass, name)
    return f"{there.__module__}.{there.__qualname__}"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook."""
    notebooks = sorted(NOTEBOOKS.glob("*.ipynb"))
    with ThreadPoolExecutor(2) as pool:
        pages = pool.map(page, [file.read_text(encoding="utf-8") for file in notebooks])
        for file, text in zip(notebooks, pages, strict=True):
            where = WHERE.format(file.stem)
            head, _, rest = text.partition("\n\n")
            files.append(
                File.generated(
                    config, f"notebooks/{file.stem}.md", content=f"{head}\n\n{where}\n\n{rest}"
                )
            )
    return files


@cache  # `mkdocs serve` builds again after each change of any page
def page(text: str) -> str:
    """A notebook's text, run, as Markdown."""
    notebook = nbformat.reads(text, as_version=4)
    NotebookClient(
        notebook,
        timeout=SECONDS,
        resources={"metadata": {"path": str(NOTEBOOKS)}},
        extra_arguments=["--IPKernelApp.log_level=40"],
    ).execute()
    found, _ = MarkdownExporter().from_notebook_node(notebook)
    return LINK.sub(r"(\1.md)", str(found)).strip()
