"""The command line: check, report, animate, list, show, explain, design and the studies.

Commands import what they need when they are called, so that help and errors of options come at
once.
"""

import sys
from collections.abc import Callable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer
from rich.text import Text

from proofmass.command import Dask, Jobs, answering, counting, errors, one_case
from proofmass.errors import InputError, suggest
from proofmass.studies import BUDGET, LONGEST

if TYPE_CHECKING:
    from proofmass.case import Case
    from proofmass.check import Result
    from proofmass.compare import Comparison
    from proofmass.strict import Kind

app = typer.Typer(
    help="Hold multibody simulators against mathematics.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
design = typer.Typer(
    help="Find a mechanism, write it as a case, check it.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
app.add_typer(design, name="design")
Paths = Annotated[
    list[Path] | None, typer.Argument(help="Sidecars, models or folders.", show_default="models/")
]
Longest = Annotated[
    float, typer.Option(help="Wall time after which a run is given up.", metavar="SECONDS")
]
Runs = StrEnum("Runs", ["dynamics", "equilibrium", "sweep"])
Errors = StrEnum("Errors", ["position", "velocity", "acceleration", "force", "energy"])
FORMER_ERRORS = {"rate": "velocity", "effort": "force"}


def parse_error_kind(word: str) -> Errors:
    """A kind of error by its name.

    Raises
    ------
    typer.BadParameter
        There is none; says what is meant, for a former name its present one.
    """
    try:
        return Errors(word)
    except ValueError:
        raise typer.BadParameter(
            suggest(word, [one.value for one in Errors], renamed=FORMER_ERRORS)
        ) from None


ERROR_KINDS = f"<{'|'.join(Errors)}>"


def examine(paths: list[Path] | None, jobs: int | None, detectable: bool = True) -> "Result":
    """`check` with a progress bar on standard error; tables show no detectable changes."""
    from proofmass.check import check

    with counting() as advance:
        result = check(paths or [Path("models")], jobs, advance, detectable=detectable)
    complain(result.errors)
    return result


def complain(found: list[InputError]) -> None:
    """Bad input, a line each, on standard error."""
    for error in found:
        errors.print(Text.assemble(("error: ", "bold red"), str(error)))


def show(
    result: "Result",
    every_channel: bool = False,
    link: "Callable[[Comparison], str] | None" = None,
) -> None:
    """Print the table, the failures with links if there are any, and the count."""
    from proofmass.terminal import console, failures, summary

    out = console()
    for table in summary(result, every_channel, out.width):
        out.print(table)
    for line in failures(result, link):
        out.print(line, soft_wrap=not out.is_terminal)  # a screen breaks lines between words


def export(file: Path, form: str, result: "Result") -> None:
    """Write a result in the form of another tool: junit or sarif."""
    from proofmass.files import write_whole
    from proofmass.junit import as_junit
    from proofmass.sarif import as_sarif

    with answering(f"{file} is not written"):
        write_whole(file, as_junit(result) if form == "junit" else as_sarif(result))


@app.command("check")
def check_command(
    paths: Paths = None,
    json: Annotated[
        bool, typer.Option("--json", help="One object: comparisons, errors, exit code.")
    ] = False,
    jobs: Jobs = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Every channel.")] = False,
    junit: Annotated[
        Path | None,
        typer.Option("--junit", help="JUnit XML to write: a test a channel.", metavar="FILE"),
    ] = None,
    sarif: Annotated[
        Path | None,
        typer.Option("--sarif", help="SARIF 2.1.0 to write: what is wrong.", metavar="FILE"),
    ] = None,
) -> None:
    """Run every case and hold it against its reference.

    Exit code 0: all agree; 1: something differs, diverged or crashed, or nothing of a case is
    checked; 2: bad input, or a file that cannot be written.
    """
    from proofmass.terminal import as_json

    result = examine(paths, jobs, detectable=json)
    if json:
        print(as_json(result))
    else:
        show(result, verbose)
    for file, form in ((junit, "junit"), (sarif, "sarif")):
        if file is not None:  # after the verdicts, which a full disk must not cost
            export(file, form, result)
    raise typer.Exit(result.exit_code)


@app.command("report")
def report_command(
    paths: Paths = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path(
        "reports"
    ),
    jobs: Jobs = None,
    study: Annotated[
        list[Path] | None,
        typer.Option(
            help="Folder of proofmass trade, stress or diet: its pages become part of the report."
        ),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option("--figures", help="Figures for papers as PNG, and of all curves; slow."),
    ] = False,
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="Folder of the report that this one is compared with.",
            show_default="the one that is in the output folder",
        ),
    ] = None,
    data: Annotated[
        bool, typer.Option("--data", help="Write the curves as well: CSV, and Parquet if it can.")
    ] = False,
) -> None:
    """Check every case and write HTML pages with its curves and its mechanism in motion.

    Says what changed since the last report.  Exit codes as for check.
    """
    from proofmass.report import write_report  # matplotlib is slow to load
    from proofmass.report.changes import changes, since
    from proofmass.report.overview import link
    from proofmass.report.record import read_last, record_of, require_record, started
    from proofmass.studies.pages import write_study_pages

    with answering(f"{output} is not complete"), errors.status("drawing studies"):
        output.mkdir(parents=True, exist_ok=True)
        studies = write_study_pages(study or [], output)
        if baseline is not None:
            require_record(baseline)
    last = read_last(output if baseline is None else baseline)
    made = started(["proofmass", *sys.argv[1:]], next(iter(paths or []), None))
    result = examine(paths, jobs)
    show(
        result, link=partial(link, output)
    )  # before anything is written: what was found out is not lost with a full disk
    record = record_of(result, made)
    if last.wrong:
        errors.print(last.wrong)
    if last.record is not None:
        print(since(last.record, changes(last.record, record)))
    with answering(f"{output} is not complete"), errors.status("drawing"):
        index = write_report(
            result,
            output,
            studies=studies,
            record=record,
            last=last,
            data=data,
            figures=figures,
        )
    print(index)
    raise typer.Exit(result.exit_code)


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
        typer.Option(help="Which run of the case.", show_default="the first that is not at rest"),
    ] = None,
    solver: Annotated[
        list[str] | None,
        typer.Option(
            help="Engine or engine:variant to draw; several times.",
            show_default="the first of each engine",
        ),
    ] = None,
    frames: Annotated[int, typer.Option(min=2, max=600, help="Pictures.")] = 60,
    seconds: Annotated[float, typer.Option(min=0.1, max=600.0, help="How long it plays.")] = 4.0,
    magnify: Annotated[
        float,
        typer.Option(
            min=0.0, help="Differences to the reference are drawn so many times as large."
        ),
    ] = 1.0,
    samples: Annotated[
        int | None,
        typer.Option(
            min=2,
            help="Of the run; pictures between them are interpolated.",
            show_default="those of the sidecar",
        ),
    ] = None,
) -> None:
    """Write the mechanism in motion as a picture: pale the reference, lines what engines found.

    Exit code 0: written; 1: written, but a solver failed or the motion ends early; 2: bad input,
    or a file that cannot be written.
    """
    from proofmass.check import load
    from proofmass.report.animation import animate, require_writable

    with answering("nothing is kept"):
        case = load(one_case(path))
        file = output or Path(f"{case.name}.webp")
        require_writable(file)
        with errors.status("running and drawing"):
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
        errors.print(f"{name} {why}", style="bold red")
    if found.stopped:
        errors.print(f"the motion ends early: {found.stopped}")
    print(file)
    raise typer.Exit(1 if found.failed or found.stopped else 0)


@app.command("new")
def new_command(
    name: Annotated[str, typer.Argument(help="Of the case, such as arm.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder.", metavar="DIR", show_default="."),
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option("--from", help="A model to write a sidecar for.", metavar="MODEL.xml"),
    ] = None,
) -> None:
    """Write a model and its sidecar that pass at once, or the sidecar of a model that has none."""
    messages: list[str] = []
    with answering("nothing is written"):
        if model is None:
            from proofmass.new import write_new

            files = write_new(name, output or Path())
        elif output is not None:
            raise ValueError("--output does not go with --from: a sidecar stands beside its model")
        else:
            from proofmass.new_from_model import write_proposal

            files, messages = write_proposal(name, model)
    for file in files:
        print(file)
    for line in messages:
        errors.print(line)
    errors.print(f"next: proofmass check {next(f for f in files if f.suffix == '.toml')}")


@app.command("schema")
def schema_command(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="File.", metavar="FILE")
    ] = None,
) -> None:
    """Print the JSON Schema of a sidecar, with which editors complete and check its keys."""
    from proofmass.files import write_whole
    from proofmass.schema import as_json_text

    if output is None:
        print(as_json_text(), end="")
        return
    with answering(f"{output} is not written"):
        write_whole(output, as_json_text())


@app.command("list")
def list_command(paths: Paths = None) -> None:
    """List the cases and their runs; nothing is run."""
    from proofmass.check import called, collect, read, tell_apart
    from proofmass.terminal import case_table, console

    found: list[InputError] = []
    cases: list[Case] = []
    lone: list[Path] = []
    paths = paths or [Path("models")]
    for path, name in tell_apart(collect(paths, found)).items():
        try:
            if path.suffix == ".xml":
                lone.append(path)
            else:
                cases.append(called(read(path), name))
        except InputError as error:
            found.append(error)
    out = console()
    out.print(case_table(cases, lone, paths, out.width))
    complain(found)
    raise typer.Exit(2 if found else 0)


@design.callback()
def design_command() -> None:
    """Find a mechanism, write it as a case, check it."""


@design.command("balancer")
def balancer_command(
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
            help="Wanted moment over m g r as a CSV file, with "
            "the columns 'angle \\[deg]' and 'moment [1]', instead."
        ),
    ] = None,
    segments: Annotated[int, typer.Option(help="3 or 4.")] = 3,
    springs: Annotated[
        str,
        typer.Option(
            help="linear, nonlinear (one k and A for all joints) or "
            "each (a k and A of its own for each joint)."
        ),
    ] = "linear",
    preload: Annotated[bool, typer.Option("--preload", help="Inner joints preloaded.")] = False,
    preload_joint: Annotated[
        list[int] | None,
        typer.Option(help="2 or 3: preloaded instead; twice for both of four segments."),
    ] = None,
    free_angle: Annotated[bool, typer.Option("--free-angle", help="Free rest angle.")] = False,
    contact: Annotated[bool, typer.Option("--contact", help="Joint 2 meets a stop.")] = False,
    relaxed: Annotated[bool, typer.Option("--relaxed", help="Lengths from 0.1 to 0.9.")] = False,
    elbow_down: Annotated[
        bool, typer.Option("--elbow-down", help="Of the last two segments at rest.")
    ] = False,
    bound: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=LOW:HIGH, instead of the usual bounds of a parameter; several times."
        ),
    ] = None,
    power: Annotated[
        float,
        typer.Option(
            min=1,
            max=2,
            help="Of the error in the aim: 2 for the least error, 1 for the best work reduction.",
        ),
    ] = 2.0,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same design.")] = 1,
    effort: Annotated[float, typer.Option(min=0.05, max=20, help="Times as many starts.")] = 1.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder.")] = Path("design"),
    pareto: Annotated[
        bool, typer.Option("--pareto", help="Trade error for evenly shared energy as well.")
    ] = False,
    catalogue: Annotated[
        Path | None,
        typer.Option(
            help="CSV file 'spring,stiffness [N m/rad]' to choose the springs from.",
            show_default="907, 903, 908",
        ),
    ] = None,
    extension: Annotated[
        str | None,
        typer.Option(
            help="E1:E2, of a pendulum with r/r0 = 1 + E1 alpha + E2 alpha^2; the target is the "
            "weight on it."
        ),
    ] = None,
    strips: Annotated[
        Path | None,
        typer.Option(
            help="CSV file of the strips that a maker has, to make a clock spring for each joint; "
            "docs/balancer.md has its columns."
        ),
    ] = None,
    moment: Annotated[
        float, typer.Option(min=1e-9, help="m g r in N m that the clock springs balance.")
    ] = 1.0,
    beside: Annotated[
        list[Path] | None,
        typer.Option(
            help="Sidecar of a balancer to draw beside "
            "it, such as models/balancers/balancer_sine.toml; several times."
        ),
    ] = None,
) -> None:
    """Find the balancer that meets a moment-angle characteristic best.

    Writes the case with its report, design.json, and the state of the search: a search that was
    interrupted goes on where it stopped when it is called again in the same way. Exit codes as for
    check.
    """
    from proofmass.design.command import design_balancer

    design_balancer(
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
    )


@app.command("trade")
def trade_command(
    paths: Annotated[list[Path], typer.Argument(help="Sidecars, models or folders.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder for tables and finished runs.")
    ] = Path("trade"),
    jobs: Jobs = None,
    dask: Dask = None,
    longest: Longest = LONGEST,
    run: Annotated[
        Runs | None,
        typer.Option(
            help="Which run of the cases.", show_default="the first of these that a case has"
        ),
    ] = None,
    error: Annotated[
        Errors,
        typer.Option(
            help="Which errors the table shows; the files have all.",
            parser=parse_error_kind,
            metavar=ERROR_KINDS,
        ),
    ] = Errors.position,
) -> None:
    """Measure what accuracy costs: settings from coarse to fine, orders, error floors, prices.

    Every finished run is kept: a study that was stopped goes on when the command is given again.

    Exit code 0: done; 1: nothing ran; 2: bad input.
    """
    from proofmass.studies.trade.trade_command import run_trade

    run_trade(
        paths, output, jobs, dask, longest, cast("Kind | None", run and run.value), error.value
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
            help="The reduced model; the table stands beside it.",
            show_default="diet/MODEL.xml",
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=1e-3, help="To follow a model without a sidecar, from its key.")
    ] = 5.0,
    watch: Annotated[
        list[str] | None,
        typer.Option(
            "--watch",
            help="A joint, body, site or sensor "
            "that matters; what does not act on it goes. Can be given again. Without it "
            "all that is measured, or moves, is monitored.",
        ),
    ] = None,
    error: Annotated[
        float | None,
        typer.Option(
            "--error",
            min=0.0,
            help="How far other options of "
            "the engine may take a channel from the fine solution, as a share of its "
            "range. Without a sidecar; a tenth more than now if not given.",
        ),
    ] = None,
    keep_options: Annotated[
        bool,
        typer.Option(
            "--keep-options",
            help="The engine's options stay as they are; nothing goes but what changes no run.",
        ),
    ] = False,
    blind: Annotated[
        bool, typer.Option("--blind", help="Geoms that are only drawn go as well.")
    ] = False,
    jobs: Jobs = None,
    dask: Dask = None,
) -> None:
    """Find what a scene does not need, and write the model without it.

    Each feature is taken out by itself and every run is done again: those of the sidecars, within
    their tolerances, or the motion from the model's key, to rounding. Then solver tolerance,
    iterations, time step, integrator and solver are made cheaper where the error of the reference,
    or the distance to the fine solution, allows it. What was tried is kept: a diet that was stopped
    goes on when the command is given again. Exit code 0: done; 2: bad input.
    """
    from proofmass.studies.diet.diet import run_diet

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
            help="Instead: largest speed in m/s at which what friction holds may creep.",
            metavar="SPEED",
        ),
    ] = None,
    of: Annotated[
        Errors, typer.Option(help="Of what.", parser=parse_error_kind, metavar=ERROR_KINDS)
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
            help="How the program moves its drives, a word of the "
            "engine's such as servo; docs/studies.md has them.",
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
        Path, typer.Option("--store", help="Folder of proofmass trade; what it lacks is run.")
    ] = Path("trade"),
    jobs: Jobs = None,
    dask: Dask = None,
    longest: Longest = LONGEST,
    budget: Annotated[
        float, typer.Option(help="Wall time of all runs of the search together.", metavar="SECONDS")
    ] = BUDGET,
) -> None:
    """Find the cheapest setting whose error is as small as is asked for.

    Its measured error must be half of that.  Then it is run as a program of its own, without
    proofmass, and from a shifted start, and both errors must be as small as is asked for.  The
    program is written with -o; without it the lines of the setting are printed, to paste.

    With --creep a motion that ends at rest is run as a program, and a setting is proposed with
    which contacts hold as still as is asked for.  --of, --drive, --store and --budget are not used.

    Exit code 0: found; 1: no setting is good enough; 2: bad input.
    """
    from proofmass.studies.trade.choose_command import run_choose, run_creep

    with answering("nothing is kept"):
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
    )


@app.command("stress")
def stress_command(
    paths: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Sidecars or folders.", show_default="small models whose limits theory knows"
        ),
    ] = None,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="Folder for the table, the page and finished runs."),
    ] = Path("stress"),
    jobs: Jobs = None,
    dask: Dask = None,
    only: Annotated[str, typer.Option(help="Only parameters whose names have this in them.")] = "",
) -> None:
    """Turn everything to its extreme until a run fails, and bisect each boundary to 1 %.

    Of a case: time step, drive speed, gravity, mass ratio, stiffness, size, segments, limit
    positions, bars in line, folds of rods, long runs, energy. Without a case: small models, with
    the limits that theory knows beside the measured ones. Every run is kept: a study that was
    stopped goes on when the command is given again. Exit code 0: done; 2: bad input.
    """
    from proofmass.studies.stress.stress import run_stress

    run_stress(paths, output, jobs, dask, only)


@app.command("show")
def show_command(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Sidecar, or its model.")],
) -> None:
    """Print the sidecar of a case with all that it leaves to defaults.

    The text is a sidecar of the same case. Nothing is run. Exit code 0, or 2: bad input.
    """
    from proofmass.check import read
    from proofmass.sidecar import as_toml
    from proofmass.terminal import not_checked

    with answering("nothing is kept"):
        case = read(one_case(path))
        print(as_toml(case), end="")
        if case.unmatched:
            errors.print(not_checked(case))


@app.command("explain")
def explain_command(
    path: Annotated[Path, typer.Argument(metavar="CASE", help="Sidecar, or its model.")],
    json: Annotated[bool, typer.Option("--json", help="One object: all that was found.")] = False,
    jobs: Jobs = None,
) -> None:
    """Tell who checks what in a case, and which wrong numbers of its model nobody would notice.

    Each number of the model is changed and the runs are done again. What was found is kept: the
    command goes on where it was stopped, and answers at once the second time. Exit code 0: done;
    2: bad input.
    """
    from proofmass.explain import run_explain

    run_explain(path, json, jobs)
