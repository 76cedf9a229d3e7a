"""The command line: check, report, list, design, trade, choose, stress, diet."""

from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from proofmass.case import Case
from proofmass.check import Result, check, collect, read, require_different_names
from proofmass.command import Jobs, answering, counting, errors
from proofmass.design.command import app as design
from proofmass.errors import InputError
from proofmass.studies.command import trade_command
from proofmass.studies.diet.diet_command import diet_command
from proofmass.studies.stress.stress_command import stress_command
from proofmass.studies.trade.choose_command import choose_command
from proofmass.terminal import as_json, case_table, console, failures, summary

app = typer.Typer(help="Hold multibody simulators against mathematics.",
                  no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
app.add_typer(design, name="design")
app.command("trade")(trade_command)
app.command("diet")(diet_command)
app.command("choose")(choose_command)
app.command("stress")(stress_command)
Paths = Annotated[list[Path] | None, typer.Argument(
    help="Sidecars, models or folders.", show_default="models/")]


def examine(paths: list[Path] | None, jobs: int | None) -> Result:
    """`check` with a progress bar on standard error."""
    with counting() as advance:
        result = check(paths or [Path("models")], jobs, advance)
    complain(result.errors)
    return result


def complain(found: list[InputError]) -> None:
    """Bad input, a line each, on standard error."""
    for error in found:
        errors.print(Text.assemble(("error: ", "bold red"), str(error)))


def show(result: Result, every_channel: bool = False) -> None:
    """Print the table, the failures, and the count."""
    out = console()
    for table in summary(result, every_channel, out.width):
        out.print(table)
    for line in failures(result):
        out.print(line, soft_wrap=True)


@app.command("check")
def check_command(
    paths: Paths = None,
    json: Annotated[bool, typer.Option("--json", help="One object: comparisons, "
                                       "errors, exit code.")] = False,
    jobs: Jobs = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Every channel.")] = False,
) -> None:
    """Run every case and hold it against its reference.

    Exit code 0: all agree; 1: something differs, diverged or crashed, or nothing of a case is
    checked; 2: bad input.
    """
    result = examine(paths, jobs)
    if json:
        print(as_json(result))
    else:
        show(result, verbose)
    raise typer.Exit(result.exit_code)


@app.command("report")
def report_command(
    paths: Paths = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")]
    = Path("reports"),
    jobs: Jobs = None,
    study: Annotated[list[Path] | None, typer.Option(help="Folder of proofmass trade, stress or "
                     "diet: its pages become part of the report.")] = None,
) -> None:
    """Check every case and write HTML pages with overlay plots.

    Exit codes as for check.
    """
    from proofmass.report import write_report, written  # matplotlib is slow to load

    with answering(f"{output} is not complete"), errors.status("drawing studies"):
        output.mkdir(parents=True, exist_ok=True)
        studies = written(study or [], output)
    result = examine(paths, jobs)
    show(result)  # before anything is written: what was found out is not lost with a full disk
    with answering(f"{output} is not complete"), errors.status("drawing"):
        index = write_report(result, output, studies=studies)
    print(index)
    raise typer.Exit(result.exit_code)


@app.command("list")
def list_command(paths: Paths = None) -> None:
    """List the cases and their runs; nothing is run."""
    found: list[InputError] = []
    cases: list[Case] = []
    lone: list[Path] = []
    paths = paths or [Path("models")]
    for path in collect(paths, found):
        try:
            if path.suffix == ".xml":
                lone.append(path)
            else:
                case = read(path)
                require_different_names([*cases, case])
                cases.append(case)
        except InputError as error:
            found.append(error)
    console().print(case_table(cases, lone, paths))
    complain(found)
    raise typer.Exit(2 if found else 0)
