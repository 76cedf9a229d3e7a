"""The command line: check, report, animate, list, show, explain, design and the studies.

Each command imports its modules when it is called, so that help and errors of options appear
without delay.
"""

import shlex
import sys
from collections.abc import Callable, Iterable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn, cast

import typer
from rich.text import Text

from proofmass.base.errors import BAD_INPUT, INTERRUPTED, InputError, suggest_names
from proofmass.commands.command import (
    Dask,
    Engines,
    ForceOption,
    Jobs,
    error_console,
    exit_on_error,
    find_sidecar,
    print_errors,
    progress_bar,
    provide_engines,
)
from proofmass.studies import DEFAULT_LONGEST_RUN, DEFAULT_SEARCH_BUDGET

if TYPE_CHECKING:
    from proofmass.base.strict import Kind
    from proofmass.batch.check import CaseConsumer, Result
    from proofmass.case.case import Case
    from proofmass.report.pages import ReportWriter
    from proofmass.verdict.comparison import Comparison

app = typer.Typer(
    help="Compare multibody simulators with analytic references.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
design = typer.Typer(
    help="Find a mechanism, write it as a case, and check the case.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
app.add_typer(design, name="design")
Paths = Annotated[
    list[Path] | None, typer.Argument(help="Sidecars, models or folders.", show_default="models/")
]
RunTimeout = Annotated[
    float, typer.Option(help="Processor time after which a run is given up.", metavar="SECONDS")
]
Tolerances = Annotated[
    list[str] | None,
    typer.Option(
        help="Largest deviation of parts: length=0.1mm, stiffness=5%, preload=5%, angle=0.5deg are "
        "the defaults; can be given several times, with =0 for exact parts.",
    ),
]
SampleCount = Annotated[
    int, typer.Option(min=0, help="Number of balancers within the tolerances; 0 for no check.")
]
Runs = StrEnum("Runs", ["dynamics", "equilibrium", "sweep"])
Errors = StrEnum("Errors", ["position", "velocity", "acceleration", "force", "energy"])
TableRoles = StrEnum("TableRoles", ["truth", "party", "profile", "path"])
DecimalSigns = StrEnum("DecimalSigns", {"point": ".", "comma": ","})
EventRows = StrEnum("EventRows", ["after", "before"])
EmptyRows = StrEnum("EmptyRows", ["keep", "drop"])
FORMER_ERRORS = {"rate": "velocity", "effort": "force"}


def parse_error_kind(word: str) -> Errors:
    """Return the kind of error that has a name.

    Raises
    ------
    typer.BadParameter
        No kind has this name; the message suggests a similar one, or replaces a former name.
    """
    try:
        return Errors(word)
    except ValueError:
        raise typer.BadParameter(
            suggest_names(word, [one.value for one in Errors], renamed=FORMER_ERRORS)
        ) from None


ERROR_METAVAR = f"<{'|'.join(Errors)}>"


def check_with_progress(
    paths: list[Path] | None,
    jobs: int | None,
    detectable: bool = True,
    dask: str | None = None,
    consumer: "CaseConsumer | None" = None,
    engines: tuple[str, ...] = (),
) -> "Result":
    """Check cases with a progress bar, and print errors of the input; both on standard error.

    `detectable` is true where detectable changes are needed; printed tables do not show them.  A
    consumer takes the cases one by one.  `engines` replace the solvers of the sidecars.
    """
    from proofmass.base.files import protect
    from proofmass.batch.check import check, collect_inputs
    from proofmass.batch.pool import ClusterError
    from proofmass.case.inputs import named_files
    from proofmass.sim.model_files import files_of_model

    found = paths or [Path("models")]
    named = [one for file in collect_inputs(found, []) for one in named_files(file)]
    protect(part for file in named for part in (file, *files_of_model(file)))
    try:
        with progress_bar() as advance:
            result = check(
                found,
                jobs,
                advance,
                causes=not engines,
                detectable=detectable,
                dask=dask,
                consumer=consumer,
                engines=engines,
            )
    except ClusterError as error:
        error_console.print(f"error: {error}", style="bold red")
        raise typer.Exit(BAD_INPUT) from None
    protect_inputs(result.cases, result.paths)
    print_errors(result.errors)
    print_files_of_others(result.of_others)
    return result


def protect_inputs(cases: Iterable["Case"], paths: Iterable[Path] = ()) -> None:
    """Let no output of this command replace a file of its cases, or a given file."""
    from proofmass.base.files import protect
    from proofmass.run.case_files import input_files

    protect([*paths, *(file for case in cases for file in input_files(case))])


NAMED_FILES = 3  # files that are named in a message; of more, their number is given


def print_files_of_others(files: list[Path]) -> None:
    """Say on standard error which files of folders were left alone, if any were."""
    if files:
        more = f" and {len(files) - NAMED_FILES} more" if len(files) > NAMED_FILES else ""
        named = ", ".join(map(str, files[:NAMED_FILES]))
        error_console.print(
            Text(f"left alone, neither a sidecar nor a model: {named}{more}"), soft_wrap=True
        )


def print_result(
    result: "Result",
    every_channel: bool = False,
    link: "Callable[[Comparison], str] | None" = None,
) -> None:
    """Print the table of results, the failures, and the number of results with each outcome.

    `link` gives the address of a comparison in a report, which is printed with a failure.
    """
    from proofmass.formats.terminal import failure_lines, hang, make_console, summary_tables

    out = make_console()
    for table in summary_tables(result, every_channel, out.width):
        out.print(table)
    for line in failure_lines(result, link):
        if out.is_terminal:
            out.print(hang(line, out))
        else:
            out.print(line, soft_wrap=True)


def export_result(file: Path, form: str, result: "Result") -> None:
    """Write a result to a file that other tools read: ``junit``, ``sarif`` or ``markdown``."""
    from proofmass.base.files import write_output
    from proofmass.formats.junit import as_junit
    from proofmass.formats.markdown import as_markdown
    from proofmass.formats.sarif import as_sarif

    with exit_on_error(f"{file} is not written"):
        if form == "junit":
            write_output(file, as_junit(result))
        else:
            write_output(file, as_sarif(result) if form == "sarif" else as_markdown(result))


@app.command("check")
def check_command(
    paths: Paths = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON: comparisons, errors and exit code.")
    ] = False,
    jobs: Jobs = None,
    dask: Dask = None,
    engine: Engines = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Show every channel.")] = False,
    junit: Annotated[
        Path | None,
        typer.Option("--junit", help="JUnit XML to write, one test per channel.", metavar="FILE"),
    ] = None,
    sarif: Annotated[
        Path | None,
        typer.Option("--sarif", help="SARIF 2.1.0 to write, one result per fault.", metavar="FILE"),
    ] = None,
    markdown: Annotated[
        Path | None,
        typer.Option(
            "--markdown",
            help="Markdown to write, such as for a comment on a pull request.",
            metavar="FILE",
        ),
    ] = None,
    fail_on: Annotated[
        str,
        typer.Option(
            help="Kinds of findings of a first screen that give exit code 1, such as "
            "stable-step,open-loop.",
            metavar="KINDS",
        ),
    ] = "",
    leave_others: Annotated[
        bool,
        typer.Option(
            "--leave-others",
            help="Leave given files alone that are neither sidecars nor models, as in folders.",
        ),
    ] = False,
    force: ForceOption = False,
) -> None:
    """Run every case and compare it with its reference.

    Exit code 0: all agree; 1: something differs, diverged or crashed, nothing of a case is checked,
    or a model has a finding of --fail-on; 2: bad input, or a file that cannot be written.
    """
    from proofmass.base.files import protect, require_replaceable
    from proofmass.batch.check import Result
    from proofmass.case.inputs import is_of_others
    from proofmass.formats.terminal import as_json

    with exit_on_error("nothing is written"):
        protect(paths or [])
        for given in filter(None, (junit, sarif, markdown)):
            require_replaceable(given)
        failing = finding_kinds(fail_on)
        engines = provide_engines(engine)
    left = [path for path in paths or [] if leave_others and is_of_others(path)]
    print_files_of_others(left)
    if left and left == paths:
        result = Result(of_others=left)
    else:
        ours = None if paths is None else [path for path in paths if path not in left]
        result = check_with_progress(ours, jobs, detectable=json, dask=dask, engines=engines)
    if json:
        print(as_json(result))
    else:
        print_result(result, verbose)
    for file, form in ((junit, "junit"), (sarif, "sarif"), (markdown, "markdown")):
        if file is not None:  # after the verdicts, which are printed even if the disk is full
            export_result(file, form, result)
    raise typer.Exit(max(result.exit_code, int(result.has_finding(failing))))


def finding_kinds(words: str) -> set[str]:
    """The kinds of findings that words with commas between them name.

    Raises
    ------
    ValueError
        A word is no kind.
    """
    from proofmass.screen.finding import FindingKind

    kinds = {word.strip() for word in words.split(",") if word.strip()}
    if unknown := sorted(kinds - set(FindingKind)):
        raise ValueError(
            f"--fail-on: no kind of finding {', '.join(unknown)}; there are: "
            f"{', '.join(FindingKind)}"
        )
    return kinds


@app.command("report")
def report_command(
    paths: Paths = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path(
        "reports"
    ),
    jobs: Jobs = None,
    dask: Dask = None,
    engine: Engines = None,
    study: Annotated[
        list[Path] | None,
        typer.Option(
            help="Folder of proofmass trade, stress or diet: its pages become part of the report."
        ),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option("--figures", help="Write figures as PNG too, and those of all curves; slow."),
    ] = False,
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the report that this one is compared with.",
            show_default="the one that is in the output folder",
        ),
    ] = None,
    data: Annotated[
        bool, typer.Option("--data", help="Write the curves as CSV, and as Parquet with pyarrow.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Check every case and write HTML pages with its curves and its mechanism in motion.

    Prints what changed since the last report.  Exit codes as for check.
    """
    from proofmass.base.files import make_folder, require_replaceable
    from proofmass.report.changes import find_changes, format_changes
    from proofmass.report.overview import link
    from proofmass.report.pages import ReportWriter  # matplotlib is slow to load
    from proofmass.report.record import make_record, read_baseline, read_last, record_start
    from proofmass.studies.pages import write_study_pages

    with exit_on_error("nothing is written"):
        engines = provide_engines(engine)
    with exit_on_error(f"{output} is not complete"), error_console.status("drawing studies"):
        make_folder(output)
        require_replaceable(output / "index.html")
        studies = write_study_pages(study or [], output)
        last = read_last(output) if baseline is None else read_baseline(baseline)
    made = record_start(["proofmass", *sys.argv[1:]], next(iter(paths or []), None))
    writer = ReportWriter(output, made, last, studies, figures, data)
    try:
        result = check_with_progress(paths, jobs, dask=dask, consumer=writer, engines=engines)
    except KeyboardInterrupt:
        stop_report(writer)
    print_result(result, link=partial(link, output))
    record = make_record(result, made)
    if last.wrong:
        error_console.print(last.wrong)
    if last.record is not None:
        print(format_changes(last.record, find_changes(last.record, record)))
    with exit_on_error(f"{output} is not complete"), error_console.status("drawing"):
        index = writer.finish(result, record)
    print(index)
    raise typer.Exit(result.exit_code)


def stop_report(writer: "ReportWriter") -> NoReturn:
    """Write the index of an interrupted report, say what is in it, and exit."""
    with exit_on_error(f"{writer.folder} is not complete"):
        writer.write_unfinished()
    count = len(writer.taken)
    pages = f"the page{'s' * (count > 1)} of {count} case{'s' * (count > 1)}"
    error_console.print(
        f"stopped; {writer.folder} has {pages}, and its index names the cases that are missing; "
        "the same command makes the whole report"
        if count
        else "stopped before the first case had ended"
    )
    raise typer.Exit(INTERRUPTED)


@app.command("animate")
def animate_command(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Sidecar, or its model.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File to write, .webp or .gif.",
            show_default="NAME.webp",
            metavar="FILE",
        ),
    ] = None,
    run: Annotated[
        Runs | None,
        typer.Option(help="Run of the case.", show_default="the first that is no equilibrium"),
    ] = None,
    solver: Annotated[
        list[str] | None,
        typer.Option(
            help="Engine or engine:variant to draw; can be given several times.",
            show_default="the first of each engine",
        ),
    ] = None,
    frames: Annotated[int, typer.Option(min=2, max=600, help="Number of pictures.")] = 60,
    seconds: Annotated[float, typer.Option(min=0.1, max=600.0, help="Playing time [s].")] = 4.0,
    magnify: Annotated[
        float,
        typer.Option(
            min=0.0, help="Factor by which differences to the reference are drawn larger."
        ),
    ] = 1.0,
    samples: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Number of samples of the run; pictures between them are interpolated.",
            show_default="those of the sidecar",
        ),
    ] = None,
    force: ForceOption = False,
) -> None:
    """Write an animation of the mechanism: the reference is pale, the engines are lines.

    Exit code 0: written; 1: written, but a solver failed or the motion ends early; 2: bad input,
    or a file that cannot be written.
    """
    from proofmass.batch.check import load_validated
    from proofmass.report.animation import animate, require_writable

    with exit_on_error("nothing is kept"):
        case = load_validated(find_sidecar(path))
        protect_inputs([case])
        file = output or Path(f"{case.name}.webp")
        require_writable(file)
        with error_console.status("running and drawing"):
            found = animate(
                case,
                cast("Kind | None", run and run.value),
                solver or None,
                frames=frames,
                seconds=seconds,
                magnify=magnify,
                samples=samples,
            )
            found.save(file)
    for name, why in found.failed.items():
        error_console.print(f"{name} {why}", style="bold red")
    if found.stopped:
        error_console.print(f"the motion ends early: {found.stopped}")
    print(file)
    raise typer.Exit(1 if found.failed or found.stopped else 0)


@app.command("new")
def new_command(
    name: Annotated[str, typer.Argument(help="Name of the case, such as arm.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder to write to.", metavar="DIR", show_default="."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--from", help="A model, MJCF or URDF, to write a sidecar for.", metavar="MODEL"
        ),
    ] = None,
) -> None:
    """Write a model with a sidecar, a case that agrees, or a sidecar for a given model."""
    messages: list[str] = []
    with exit_on_error("nothing is written"):
        if model is None:
            from proofmass.commands.new import write_new

            files = write_new(name, output or Path())
        elif output is not None:
            raise ValueError(
                "--output does not go with --from: the sidecar is written into the model's folder"
            )
        else:
            from proofmass.commands.new_from_urdf import write_from_file

            files, messages = write_from_file(name, model)
    for file in files:
        print(file)
    for line in messages:
        error_console.print(line)
    sidecar = next(file for file in files if file.suffix == ".toml")
    error_console.print(f"next: proofmass check {shlex.quote(str(sidecar))}")


@app.command("import")
def import_command(
    file: Annotated[
        Path, typer.Argument(help="A table that another program wrote.", metavar="FILE")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="CSV to write.",
            show_default="NAME.csv, or NAME_clean.csv of a CSV",
            metavar="FILE",
        ),
    ] = None,
    role: Annotated[
        TableRoles, typer.Option("--as", help="What the table is in the sidecar.")
    ] = TableRoles.truth,
    time: Annotated[
        str, typer.Option(help="Column of the x.", show_default="found", metavar="COLUMN")
    ] = "",
    unit: Annotated[
        list[str] | None,
        typer.Option(
            help="Unit of a column, such as theta=deg; can be given several times.",
            metavar="COLUMN=UNIT",
        ),
    ] = None,
    decimal: Annotated[
        DecimalSigns | None, typer.Option(help="Decimal sign.", show_default="found")
    ] = None,
    fps: Annotated[
        str | None,
        typer.Option(help="Rows or frames per second of a table without times.", metavar="NUMBER"),
    ] = None,
    clockwise: Annotated[
        list[str] | None,
        typer.Option(
            help="Column whose angle counts clockwise, or none; can be given several times.",
            show_default="by its name",
            metavar="COLUMN",
        ),
    ] = None,
    event: Annotated[
        EventRows, typer.Option(help="Row that is kept of two at the same time.")
    ] = EventRows.after,
    empty: Annotated[
        EmptyRows | None,
        typer.Option(
            help="What becomes of rows with an empty cell.",
            show_default="dropped between values, kept at the ends of a column",
        ),
    ] = None,
    sheet: Annotated[
        str,
        typer.Option(
            help="Sheet of a workbook, variable of a .mat, analysis of a .res.", metavar="NAME"
        ),
    ] = "",
    table: Annotated[
        int, typer.Option(min=0, help="Number of the table of a text.", show_default="the only one")
    ] = 0,
    encoding: Annotated[
        str, typer.Option(help="Encoding of a text.", show_default="found", metavar="NAME")
    ] = "",
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Take defaults where a person would be asked.")
    ] = False,
    force: ForceOption = False,
) -> None:
    """Write a clean CSV of a table of another program, and the sidecar's lines that use it.

    CSV and other text, .xlsx, .lvm, .res of Adams and SolidWorks, .mat, Parquet. What was changed
    is printed, one sentence each. What the file leaves open is asked once on a terminal; without
    one, the option that decides it is named. Exit code 0: written; 2: bad input, or undecided.
    """
    from proofmass.commands.import_table import parse_rate, parse_units, run_import
    from proofmass.tables.decisions import Decisions
    from proofmass.tables.sidecar_lines import TableRole

    with exit_on_error("nothing is written"):
        decisions = Decisions(
            decimal=decimal.value if decimal else "",
            time=time,
            units=parse_units(unit),
            fps=parse_rate(fps),
            clockwise=tuple(clockwise) if clockwise else None,
            sheet=sheet,
            encoding=encoding,
            table=table,
            event=event.value,
            empty=empty.value if empty else "",
            yes=yes,
        )
    run_import(file, output, TableRole(role.value), decisions)


@app.command("schema")
def schema_command(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File to write.", metavar="FILE")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Print the JSON Schema of a sidecar, by which editors complete and check its keys."""
    from proofmass.base.files import protect, write_output
    from proofmass.run.schema import as_json_text

    if output is None:
        print(as_json_text(), end="")
        return
    with exit_on_error(f"{output} is not written"):
        protect([output] if output.suffix in (".toml", ".xml") else [])  # sidecars and models
        write_output(output, as_json_text())


@app.command("list")
def list_command(paths: Paths = None) -> None:
    """List the cases and their runs, without running them."""
    from proofmass.batch.check import (
        collect_inputs,
        is_case_file,
        read_isolated,
        rename_case,
        unique_names,
    )
    from proofmass.formats.terminal import case_table, make_console

    found: list[InputError] = []
    cases: list[Case] = []
    bare_models: list[Path] = []
    paths = paths or [Path("models")]
    for path, name in unique_names(collect_inputs(paths, found)).items():
        try:
            if not is_case_file(path):
                bare_models.append(path)
            else:
                cases.append(rename_case(read_isolated(path), name))
        except InputError as error:
            found.append(error)
    out = make_console()
    out.print(case_table(cases, bare_models, paths, out.width))
    print_errors(found)
    raise typer.Exit(2 if found else 0)


@design.callback()
def design_command() -> None:
    """Find a mechanism, write it as a case, and check the case."""


@design.command("balancer")
def balancer_command(
    context: typer.Context,
    target: Annotated[
        str,
        typer.Option(
            help="Wanted moment: sine, "
            "progressive, progressive-degressive, degressive-progressive, laevo, sine180, "
            "square-root, quadratic, hardening-softening or softening-hardening."
        ),
    ] = "sine",
    table: Annotated[
        Path | None,
        typer.Option(
            help="Wanted moment over m g r, instead of --target: a CSV file with "
            "the columns 'angle \\[deg]' and 'moment [1]'."
        ),
    ] = None,
    all_kinds: Annotated[
        bool,
        typer.Option(
            "--all",
            help="Search all kinds of balancers: segments, springs, preloads, contacts, rest "
            "angles, lengths; --segments and --springs narrow them. Minutes instead of seconds.",
        ),
    ] = False,
    within: Annotated[
        float,
        typer.Option(
            min=0,
            help="With --all: rms error, as a share of the largest wanted moment, up to which the "
            "curve counts as reached; otherwise the exit code is 1.",
        ),
    ] = 0.01,
    segments: Annotated[int, typer.Option(help="Number of segments, 2 to 4.")] = 3,
    springs: Annotated[
        str,
        typer.Option(
            help="linear, nonlinear (the same k and A for all joints) or "
            "each (a k and A of its own for each joint)."
        ),
    ] = "linear",
    preload: Annotated[bool, typer.Option("--preload", help="Inner joints preloaded.")] = False,
    preload_joint: Annotated[
        list[int] | None,
        typer.Option(
            help="2 or 3: this joint is preloaded, instead of --preload; with four segments it "
            "can be given twice."
        ),
    ] = None,
    free_angle: Annotated[bool, typer.Option("--free-angle", help="Free rest angle.")] = False,
    contact: Annotated[
        bool, typer.Option("--contact", help="Joint 2 meets a joint limit.")
    ] = False,
    relaxed: Annotated[
        bool, typer.Option("--relaxed", help="Relaxed bounds of lengths, 0.1 to 0.9.")
    ] = False,
    elbow_down: Annotated[
        bool,
        typer.Option("--elbow-down", help="Elbow of the last two segments is down at rest."),
    ] = False,
    bound: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=LOW:HIGH, instead of the usual bounds of a parameter; can be given several "
            "times."
        ),
    ] = None,
    power: Annotated[
        float,
        typer.Option(
            min=1,
            max=2,
            help="Power of the error in the objective: 2 for the least error, 1 for the best work "
            "reduction.",
        ),
    ] = 2.0,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same design.")] = 1,
    effort: Annotated[
        float, typer.Option(min=0.05, max=20, help="Factor on the number of starts.")
    ] = 1.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path(
        "design"
    ),
    pareto: Annotated[
        bool,
        typer.Option(
            "--pareto", help="Find the Pareto front of error and evenly shared energy as well."
        ),
    ] = False,
    catalogue: Annotated[
        Path | None,
        typer.Option(
            help="CSV file 'spring,stiffness [N m/rad]': the design has springs of this stock, one "
            "or two at a joint. Without it, springs 907, 903, 908 are fitted to the design.",
        ),
    ] = None,
    extension: Annotated[
        str | None,
        typer.Option(
            help="E1:E2 of a pendulum with r/r0 = 1 + E1 alpha + E2 alpha^2; the target is then "
            "the moment of its weight."
        ),
    ] = None,
    strips: Annotated[
        Path | None,
        typer.Option(
            help="CSV file of the strips that a maker offers: the design has clock springs that "
            "can be made of them. docs/balancer.md describes the columns."
        ),
    ] = None,
    moment: Annotated[
        float | None,
        typer.Option(
            min=1e-9,
            help="m g r in N m that springs of the stock balance.",
            show_default="1 with --strips, free with --catalogue",
        ),
    ] = None,
    beside: Annotated[
        list[Path] | None,
        typer.Option(
            help="Sidecar of a balancer to compare with "
            "it, such as models/balancers/balancer_sine.toml; can be given several times."
        ),
    ] = None,
    tolerance: Tolerances = None,
    samples: SampleCount = 1000,
    pendulum: Annotated[
        float, typer.Option(help="Length of the real pendulum in m, for tolerances of lengths.")
    ] = 1.0,
    force: ForceOption = False,
) -> None:
    """Find the balancer that meets a moment-angle characteristic best.

    Writes the case with its report, design.json, and the state of the search. An interrupted
    search continues where it stopped when the same command is given again. With --all, one table
    and one figure show the best design of each kind against what must be built. Exit codes as for
    check; 1 also if a joint needs a clock spring that no strip gives, or if no kind reaches the
    curve.
    """
    from proofmass.commands.design import AllKinds, design_balancer

    given = {
        name
        for name in context.params
        if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE"
    }
    design_balancer(
        AllKinds(within, frozenset(given)) if all_kinds else None,
        target,
        table,
        segments,
        springs,
        tuple(preload_joint or ()) or (tuple(range(2, segments)) if preload else ()),
        free_angle,
        contact,
        relaxed,
        elbow_down,
        bound,
        power,
        seed,
        effort,
        output,
        pareto,
        catalogue,
        extension,
        strips,
        moment,
        beside,
        (tolerance, samples, pendulum),
    )


PathKinds = StrEnum("PathKinds", ["fourbar", "slider_crank", "both"])
AssemblyModes = StrEnum("AssemblyModes", ["open", "crossed", "both"])
AngleOrigins = StrEnum("AngleOrigins", ["first", "x", "ground"])


@design.command("linkage")
def linkage_command(
    points: Annotated[
        Path,
        typer.Argument(
            help="CSV file of the points, in the order in which they are passed: the columns "
            "'x \\[m]' and 'y \\[m]', and if wanted 'angle \\[deg]' of the crank and "
            "'tolerance \\[m]'."
        ),
    ],
    kind: Annotated[PathKinds, typer.Option(help="Kind of linkage.")] = PathKinds.both,
    mode: Annotated[
        AssemblyModes, typer.Option(help="Assembly mode of four-bars.")
    ] = AssemblyModes.both,
    angles_from: Annotated[
        AngleOrigins,
        typer.Option(
            help="What the crank angles of the file are measured from: the first of them, the x "
            "axis, or the direction of the ground or of the guide."
        ),
    ] = AngleOrigins.first,
    closed: Annotated[
        bool, typer.Option("--closed", help="The path leads back to its first point.")
    ] = False,
    transmission: Annotated[
        float,
        typer.Option(min=0, max=89, help="Least angle of the transmission angle from 0 and 180."),
    ] = 30.0,
    bound: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=LOW:HIGH in m, or in deg for angles, instead of the usual bounds of a "
            "parameter, such as crank=0.02:0.05; can be given several times."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same designs.")] = 1,
    effort: Annotated[
        float, typer.Option(min=0.02, max=50, help="Factor on the number of starts.")
    ] = 1.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path(
        "design"
    ),
    force: ForceOption = False,
) -> None:
    """Find four-bars and slider-cranks whose coupler point passes through given points.

    The crank turns fully and passes the points in their order. Writes the best design as a case
    with its report, and the designs as JSON, CSV and figures. An interrupted search continues
    where it stopped when the same command is given again. Exit codes as for check; 1 also if no
    linkage meets the constraints or the tolerances, with the nearest one.
    """
    from proofmass.commands.design_linkage import design_linkage

    design_linkage(
        points, kind, mode, angles_from, closed, transmission, bound, seed, effort, output
    )


@design.command("tolerances")
def tolerances_command(
    case: Annotated[Path, typer.Argument(help="Sidecar of a balancer with a target.")],
    tolerance: Tolerances = None,
    samples: SampleCount = 1000,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same balancers.")] = 1,
    pendulum: Annotated[
        float | None,
        typer.Option(help="Length of the real pendulum in m.", show_default="that of the case"),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path(
        "tolerances"
    ),
    force: ForceOption = False,
) -> None:
    """Find the band of a balancer's moment if its parts are off by up to their tolerances.

    Follows balancers whose lengths, springs, preloads and angles are off at random, and writes
    the percentiles and extremes of their moments at each angle to tolerances.json, .svg and .png.
    """
    from proofmass.commands.tolerances import check_case

    check_case(case, tolerance, samples, seed, pendulum, output)


@app.command("trade")
def trade_command(
    paths: Annotated[list[Path], typer.Argument(help="Sidecars, models or folders.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for tables and finished runs.")
    ] = Path("trade"),
    jobs: Jobs = None,
    dask: Dask = None,
    longest: RunTimeout = DEFAULT_LONGEST_RUN,
    run: Annotated[
        Runs | None,
        typer.Option(
            help="Which run of the cases.", show_default="the first of these that a case has"
        ),
    ] = None,
    error: Annotated[
        Errors,
        typer.Option(
            help="Kind of error that the table shows; the files have all.",
            parser=parse_error_kind,
            metavar=ERROR_METAVAR,
        ),
    ] = Errors.position,
    engine: Engines = None,
    force: ForceOption = False,
) -> None:
    """Measure what accuracy costs: convergence series of settings, orders, error floors, costs.

    Every finished run is stored: a stopped study continues when the command is given again.

    Exit code 0: done; 1: nothing ran; 2: bad input.
    """
    from proofmass.commands.trade import run_trade

    run_trade(
        paths,
        output,
        jobs,
        dask,
        longest,
        cast("Kind | None", run and run.value),
        error.value,
        engine or [],
    )


@app.command("diet")
def diet_command(
    model: Annotated[
        Path, typer.Argument(help="MJCF file; sidecars beside it say what it is for.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File of the reduced model; the table is written beside it.",
            show_default="diet/MODEL.xml",
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=1e-3, help="Duration of the motion of a model without a sidecar.")
    ] = 5.0,
    watch: Annotated[
        list[str] | None,
        typer.Option(
            "--watch",
            help="A joint, body, site or sensor to monitor; features that do not act on it are "
            "removed. Can be given several times. Without it all that is measured, or moves, is "
            "monitored.",
        ),
    ] = None,
    error: Annotated[
        float | None,
        typer.Option(
            "--error",
            min=0.0,
            help="For a model without a sidecar: largest distance of a channel to the fine "
            "solution, as a share of its range, that other options of the engine may cause; a "
            "tenth more than with the present options if not given.",
        ),
    ] = None,
    keep_options: Annotated[
        bool,
        typer.Option(
            "--keep-options",
            help="Keep the engine's options, and remove only what changes no run.",
        ),
    ] = False,
    blind: Annotated[
        bool, typer.Option("--blind", help="Remove geoms that are only drawn as well.")
    ] = False,
    jobs: Jobs = None,
    dask: Dask = None,
    force: ForceOption = False,
) -> None:
    """Find what a scene does not need, and write the model without it.

    Each feature is taken out by itself and every run is repeated: the runs of the sidecars must
    stay within their tolerances, the motion from the model's key must stay the same to rounding.
    Then cheaper solver tolerances, iterations, time steps, integrators and solvers are chosen where
    the error to the reference, or the distance to the fine solution, allows it. Trials are stored:
    a stopped diet continues when the command is given again. Exit code 0: done; 2: bad input.
    """
    from proofmass.commands.diet import run_diet

    run_diet(model, output, seconds, watch, error, keep_options, blind, jobs, dask)


@app.command("choose")
def choose_command(
    path: Annotated[Path, typer.Argument(help="A sidecar.", metavar="CASE")],
    error: Annotated[
        float | None,
        typer.Option(help="Largest error, as a share of the range of the reference."),
    ] = None,
    creep: Annotated[
        float | None,
        typer.Option(
            help="Instead of --error: largest speed in m/s or rad/s at which joints and bodies "
            "that friction holds may creep.",
            metavar="SPEED",
        ),
    ] = None,
    of: Annotated[
        Errors, typer.Option(help="Kind of error.", parser=parse_error_kind, metavar=ERROR_METAVAR)
    ] = Errors.position,
    solver: Annotated[
        str, typer.Option(help="The only engine to choose from.", show_default="any")
    ] = "",
    run: Annotated[
        Runs | None,
        typer.Option(help="Which run of the case.", show_default="the first of these that it has"),
    ] = None,
    drive: Annotated[
        str,
        typer.Option(
            help="How the program moves its drives: a word that the "
            "engine knows, such as servo; docs/studies.md lists them.",
            show_default="the first of these, which is ideal",
        ),
    ] = "",
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="A Python program that runs the motion with that setting, without proofmass.",
            show_default="lines to paste are printed",
        ),
    ] = None,
    store: Annotated[
        Path, typer.Option("--store", help="Folder of proofmass trade; missing runs are added.")
    ] = Path("trade"),
    jobs: Jobs = None,
    dask: Dask = None,
    longest: RunTimeout = DEFAULT_LONGEST_RUN,
    budget: Annotated[
        float,
        typer.Option(
            help="Counted processor time of all runs of the search together.", metavar="SECONDS"
        ),
    ] = DEFAULT_SEARCH_BUDGET,
    engine: Engines = None,
    force: ForceOption = False,
) -> None:
    """Find the cheapest setting whose error is no larger than the given one.

    Its measured error must be no larger than half of that.  The setting is then run as a program
    of its own, without proofmass, and from a shifted start, and neither error may be larger than
    the given one.  The program is written with -o; without -o the lines of the setting are printed.

    With --creep the friction is proposed with which joints creep no faster than the given speed
    that their dry friction would hold; the model is enough.  Of a case without such joints a motion
    that ends at rest is run as a program, and a setting is proposed with which contacts creep no
    faster.  --of, --drive, --store and --budget are not used.

    Exit code 0: found; 1: no setting is good enough; 2: bad input.
    """
    from proofmass.commands.choose import run_choose, run_creep

    with exit_on_error("nothing is kept"):
        if (error is None) == (creep is None):
            raise ValueError("give one of the two: --error, such as 1e-5, or --creep, such as 1e-6")
    if creep is not None:
        run_creep(path, creep, solver, output, longest)
        return
    assert error is not None
    run_choose(
        path,
        error,
        of.value,
        solver,
        cast("Kind | None", run and run.value),
        drive,
        output,
        store,
        jobs,
        dask,
        longest,
        budget,
        engine or [],
    )


@app.command("stress")
def stress_command(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Sidecars, models or folders.",
            show_default="small models whose limits theory knows",
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the table, the page and finished runs."),
    ] = Path("stress"),
    jobs: Jobs = None,
    dask: Dask = None,
    only: Annotated[str, typer.Option(help="Only parameters whose names contain this text.")] = "",
    engine: Engines = None,
    force: ForceOption = False,
) -> None:
    """Increase or decrease each parameter until a run fails, and bisect the boundary to 1 %.

    Of a case: time step, stable time step, drive speed, gravity, mass ratio, stiffness, size,
    segments, limit positions, bars in line, folds of rods, long runs, energy. Of a model without a
    sidecar: its stable time steps. Without a case: small models, whose
    measured limits are compared with those of theory. Every run is stored: a stopped study
    continues when the command is given again. Exit code 0: done; 2: bad input.
    """
    from proofmass.commands.stress import run_stress

    run_stress(paths, output, jobs, dask, only, engine or [])


@app.command("engines")
def engines_command(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(help="Sidecars or folders to run.", show_default="none: list the engines"),
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option(
            "--engine",
            help="Engine to run, NAME or NAME==VERSION; can be given several times.",
            show_default="all",
            metavar="NAME",
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the page, the table and finished runs."),
    ] = Path("engines"),
    run: Annotated[
        list[Runs] | None,
        typer.Option(
            "--run",
            help="Kind of run; can be given several times.",
            show_default="that in time, or else the sweep or the equilibrium",
        ),
    ] = None,
    cost: Annotated[
        bool,
        typer.Option("--cost", help="Rank the engines at equal cost: error over processor time."),
    ] = False,
    budget: Annotated[
        float,
        typer.Option(
            help="Processor time of a run after which no finer setting is tried, of --cost.",
            metavar="SECONDS",
        ),
    ] = 0.5,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    jobs: Jobs = None,
    dask: Dask = None,
    force: ForceOption = False,
) -> None:
    """List the engines, or run cases in several of them.

    The list says which engines run here, which uv has fetched, and what each can express. A table
    of cases has the error of each engine against the reference, or why it has none. With --cost
    each engine is run with many settings, and ranked by the time that it needs for an error. Every
    run is stored: the same command goes on where it was stopped. Exit code 0: done; 2: bad input,
    also if other cases were run.
    """
    from proofmass.commands.engines import run_engines

    words = paths or [], engine or [], output, jobs, dask, json, cost, budget
    kinds = cast("list[Kind]", [one.value for one in run or []])
    raise typer.Exit(run_engines(*words, kinds))


@app.command("compare")
def compare_command(
    file: Annotated[Path, typer.Argument(help="CSV of a measured loop.", metavar="FILE")],
    x: Annotated[
        str, typer.Option("--x", help="Column of the angle.", show_default="found by its unit")
    ] = "",
    y: Annotated[
        str, typer.Option("--y", help="Column of the moment.", show_default="found by its unit")
    ] = "",
    references: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            help="What it is compared with: sine or sine=SIZE, fit or fit=DEGREE, another CSV, "
            "or CASE.toml or CASE.toml:QUANTITY; can be given several times.",
            metavar="REFERENCE",
            show_default="sine, fit",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Figure to write, .svg, .png or .pdf.", show_default="none"
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, in SI units.")] = False,
    force: ForceOption = False,
) -> None:
    """Compare a measured loop of a moment over an angle with references, without a model.

    The angle goes up and down; its rows need no times. The branches are found, and their works, the
    area of the loop, and the reduction of work against each reference are printed. Exit code 0:
    done; 2: bad input.
    """
    from proofmass.commands.compare import run_compare

    run_compare(file, x, y, references or ["sine", "fit"], output, json)


@app.command("equilibria")
def equilibria_command(
    model: Annotated[
        Path,
        typer.Argument(help="Sidecar with rods, its model, or an assembly file.", metavar="MODEL"),
    ],
    inflections: Annotated[int, typer.Option(min=1, max=9, help="Most inflections of a rod.")] = 2,
    alpha: Annotated[
        float | None,
        typer.Option(
            min=1.0,
            max=20.0,
            help="Largest load on a rod's tip, as alpha of R = alpha² EI/L².",
            show_default="20 for straight rods on pins, else 10",
        ),
    ] = None,
    turns: Annotated[
        float, typer.Option(min=0.0, max=4.0, help="Most turns of rods with two clamps.")
    ] = 1.0,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for CSV, JSON and a figure.", show_default="none"
        ),
    ] = None,
    engine: Annotated[
        list[str] | None,
        typer.Option(
            "--engine",
            help="Engine that starts from each shape, and where it comes to rest; can be given "
            "several times.",
            show_default="none",
            metavar="NAME",
        ),
    ] = None,
    cases: Annotated[
        Path | None,
        typer.Option(
            help="Folder for a case of each stable equilibrium, for proofmass check.",
            show_default="none",
        ),
    ] = None,
    number: Annotated[
        list[int] | None,
        typer.Option(
            help="Equilibrium that gets a case; can be given several times.",
            show_default="all stable ones",
            metavar="NUMBER",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON, in SI units.")] = False,
    force: ForceOption = False,
) -> None:
    """Find all equilibria of rods that meet in a pin or on a platform, and which are stable.

    Exit code 0: found; 1: there is none within the limits; 2: bad input.
    """
    from proofmass.commands.equilibria import run_equilibria

    run_equilibria(
        model, inflections, alpha, turns, engine or [], output, cases, number or [], json
    )


@app.command("versions")
def versions_command(
    paths: Annotated[list[Path], typer.Argument(help="Sidecars, models or folders.")],
    engine: Engines = None,
    every: Annotated[
        bool,
        typer.Option("--all", help="All releases: find each change by bisection."),
    ] = False,
    since: Annotated[
        str,
        typer.Option(
            help="The oldest release of --all.",
            metavar="VERSION",
            show_default="the oldest that the engine's script can drive",
        ),
    ] = "",
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the page, the table and finished runs."),
    ] = Path("versions"),
    json: Annotated[bool, typer.Option("--json", help="Print JSON: changes and results.")] = False,
    jobs: Jobs = None,
    dask: Dask = None,
    force: ForceOption = False,
) -> None:
    """Run cases in several versions of an engine, and find what changed in which.

    Each version runs in an interpreter of its own, which uv makes. A case changes where the error
    of a channel is more than twice as large or as small as in the version before. A model without
    a sidecar is compared with its own motion at half the step. Every run is stored: the same
    command goes on where it was stopped. Exit code 0: nothing changed; 1: something changed;
    2: bad input.
    """
    from proofmass.commands.versions import run_versions

    code = run_versions(paths, engine or [], every, since, output, jobs, dask, json)
    raise typer.Exit(code)


@app.command("show")
def show_command(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Sidecar, or its model.")],
) -> None:
    """Print the sidecar of a case with the default values of all keys that it leaves out.

    The text is a sidecar of the same case. Nothing is run. Exit code 0, or 2: bad input.
    """
    from proofmass.batch.check import read_isolated
    from proofmass.formats.terminal import describe_unmatched
    from proofmass.run.sidecar import format_sidecar

    with exit_on_error("nothing is kept"):
        case = read_isolated(find_sidecar(path))
        print(format_sidecar(case), end="")
        if case.unmatched:
            error_console.print(describe_unmatched(case))


@app.command("explain")
def explain_command(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Sidecar, or its model.")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON: all that was found.")] = False,
    jobs: Jobs = None,
) -> None:
    """List what the runs of a case check, and which wrong numbers of its model no run notices.

    Each number of the model is changed and the runs are repeated. Results are stored: a stopped
    command continues where it stopped, and a second call answers at once. Exit code 0: done;
    2: bad input.
    """
    from proofmass.commands.explain import run_explain

    run_explain(path, json, jobs)
