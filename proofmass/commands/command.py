"""What all commands share: options, errors as one line, exit codes, and a progress bar."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from proofmass.base.errors import BAD_INPUT, INTERRUPTED, InputError
from proofmass.base.files import output_permissions

error_console = Console(stderr=True, highlight=False, soft_wrap=True, markup=False, emoji=False)
SECONDS_BETWEEN_LINES = 10.0  # [s] after which progress without a terminal prints a line again

Jobs = Annotated[
    int | None,
    typer.Option("--jobs", "-j", min=1, help="Runs in parallel.", show_default="processors"),
]


def allow_replacing(context: typer.Context, force: bool) -> bool:
    """Let the outputs of a command replace files of others while the command runs, if forced."""
    context.with_resource(output_permissions(force))
    return force


ForceOption = Annotated[
    bool,
    typer.Option(
        "--force",
        callback=allow_replacing,
        help="Replace files that proofmass did not write; an input is never replaced.",
    ),
]
Engines = Annotated[
    list[str] | None,
    typer.Option(
        "--engine",
        help="Engine in place of those of the sidecars, NAME or NAME==VERSION, see proofmass "
        "engines; can be given several times.",
        show_default="those of the sidecars",
        metavar="NAME",
    ),
]
Dask = Annotated[str | None, typer.Option(help="Run on a Dask cluster, tcp://host:8786.")]


@contextmanager
def exit_on_error(kept: str) -> Iterator[None]:
    """Print errors of the input, or after Ctrl-C what is `kept`, as one line, and exit."""
    from proofmass.sim.protocol.failures import BadModel, Unsupported

    try:
        yield
    except (KeyboardInterrupt, InputError, BadModel, Unsupported, ValueError, OSError) as error:
        if is_interrupt(error):
            error_console.print(f"stopped; {kept}; to go on, give the same command again")
            raise typer.Exit(INTERRUPTED) from None
        error_console.print(f"error: {error_text(error)}", style="bold red")
        raise typer.Exit(BAD_INPUT) from None


def print_errors(found: list[InputError]) -> None:
    """Print each error of the input as a line on standard error."""
    for error in found:
        error_console.print(Text.assemble(("error: ", "bold red"), str(error)))


def provide_engines(names: list[str] | None) -> tuple[str, ...]:
    """The engines that a command asks for, each once, with what they need fetched.

    An engine that cannot be had is named on standard error; its runs say why.

    Raises
    ------
    NoEngine
        No engine has such a name.
    """
    from proofmass.sim.engines import engine_of

    asked = tuple(dict.fromkeys(names or ()))
    for name in asked:
        engine = engine_of(name)
        with error_console.status(f"fetching {name}"):
            why = engine.provide()
        if why:
            error_console.print(f"unavailable: {name}: {why}", style="yellow")
    return asked


def single_case_error(path: Path) -> InputError:
    """Return the error of a path that is not the sidecar of a single case."""
    return InputError(
        path, "", "give the sidecar of one case, such as models/linkages/fourbar.toml"
    )


def find_sidecar(path: Path) -> Path:
    """Return a path if it is a sidecar, or the sidecar of the model that the path names.

    Raises
    ------
    InputError
        The path is neither the sidecar of a single case nor its model.
    """
    from proofmass.batch.check import find_inputs

    if not path.exists():
        raise InputError(path, "", "no such file; give a sidecar, NAME.toml, or its model")
    (file,) = find_inputs([path]) if path.is_file() else [path]
    if file.suffix != ".toml":
        raise single_case_error(path)
    return file


def error_text(error: BaseException) -> str:
    """Return the text of an error, of an error of the system with the file first."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename or 'standard output'}: {error.strerror}"
    return str(error)


def is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused an error: it interrupts the packing of a file, which then fails too."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


@contextmanager
def progress_bar(
    total: int | None = None, max_letters: int | None = None
) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar on standard error; yields a function ``advance(label, done, total)``.

    Labels are cut to `max_letters` characters.  Where standard error is no terminal, lines
    are printed instead of the bar: one for each new first word of a label, which is a case, and
    otherwise at most one every `SECONDS_BETWEEN_LINES` seconds.
    """
    if not error_console.is_terminal:
        yield progress_lines()
        return
    columns = (
        TextColumn("{task.description:<40}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=error_console, transient=True) as bar:
        line = bar.add_task("starting", total=total)

        def advance(label: str, done: int, total: int) -> None:
            bar.update(line, description=label[:max_letters], completed=done, total=total)

        yield advance


def progress_lines() -> Callable[[str, int, int], None]:
    """Return a function ``advance(label, done, total)`` that prints lines for a log."""
    announced, last = set[str](), time.monotonic()

    def advance(label: str, done: int, total: int) -> None:
        nonlocal last
        case = label.partition(" ")[0]
        if (
            case not in announced
            or done == total
            or time.monotonic() - last > SECONDS_BETWEEN_LINES
        ):
            announced.add(case)
            last = time.monotonic()
            error_console.print(f"{done}/{total} {label}")

    return advance
