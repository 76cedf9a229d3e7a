"""What all commands share: options, errors as one line, exit codes, and a progress bar."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from proofmass.errors import InputError

errors = Console(stderr=True, highlight=False, soft_wrap=True, markup=False, emoji=False)
PAUSE = 10.0  # [s] after which progress without a terminal prints a line again
BAD_INPUT, INTERRUPTED = 2, 130  # exit codes; the second is a shell's own for Ctrl-C

Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", min=1, help="Runs in parallel.", show_default="processors"),
]
Dask = Annotated[str | None, typer.Option(help="Run on a Dask cluster, tcp://host:8786.")]


@contextmanager
def answering(kept: str) -> Iterator[None]:
    """Print errors of the input, or after Ctrl-C what is `kept`, as one line, and exit."""
    from proofmass.sim.protocol import BadModel  # numpy and pydantic are slow to load

    try:
        yield
    except (KeyboardInterrupt, InputError, BadModel, ValueError, OSError) as error:
        if interrupted(error):
            errors.print(f"stopped; {kept}; to go on, give the same command again")
            raise typer.Exit(INTERRUPTED) from None
        errors.print(f"error: {in_words(error)}", style="bold red")
        raise typer.Exit(BAD_INPUT) from None


def not_one_case(path: Path) -> InputError:
    """Return the error of a path that is not the sidecar of a single case."""
    return InputError(
        path, "", "give the sidecar of one case, such as models/linkages/fourbar.toml"
    )


def one_case(path: Path) -> Path:
    """Return a path if it is a sidecar, or the sidecar of the model that the path names.

    Raises
    ------
    InputError
        The path is neither the sidecar of a single case nor its model.
    """
    from proofmass.check import find

    (file,) = find([path]) if path.is_file() else [path]
    if file.suffix != ".toml":
        raise not_one_case(path)
    return file


def in_words(error: BaseException) -> str:
    """Return the text of an error, of an error of the system with the file first."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'a file'}: {error.strerror}"
    return str(error)


def interrupted(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused an error: it interrupts the packing of a file, which then fails too."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


@contextmanager
def counting(
    total: int | None = None, letters: int | None = None
) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar on standard error; yields a function ``advance(label, done, total)``.

    Labels are cut to `letters` characters.  Where standard error is no terminal, lines
    are printed instead of the bar: one for each new first word of a label, which is a case, and
    otherwise at most one every `PAUSE` seconds.
    """
    if not errors.is_terminal:
        yield lines()
        return
    columns = (
        TextColumn("{task.description:<40}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=errors, transient=True) as bar:
        line = bar.add_task("starting", total=total)

        def advance(label: str, done: int, total: int) -> None:
            bar.update(line, description=label[:letters], completed=done, total=total)

        yield advance


def lines() -> Callable[[str, int, int], None]:
    """Return a function ``advance(label, done, total)`` that prints lines for a log."""
    announced, last = set[str](), time.monotonic()

    def advance(label: str, done: int, total: int) -> None:
        nonlocal last
        case = label.partition(" ")[0]
        if case not in announced or done == total or time.monotonic() - last > PAUSE:
            announced.add(case)
            last = time.monotonic()
            errors.print(f"{done}/{total} {label}")

    return advance
