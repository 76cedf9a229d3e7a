"""``proofmass choose``: print or write the cheapest setting with a small enough error."""

from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from textwrap import fill

import typer

from proofmass.base.errors import InputError
from proofmass.base.files import OUTPUT_MARK, require_replaceable, write_output
from proofmass.base.strict import Kind
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.batch.check import collect_inputs
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.commands.command import (
    error_console,
    exit_on_error,
    progress_bar,
    provide_engines,
    single_case_error,
)
from proofmass.commands.studies import load_cases, require_seconds
from proofmass.commands.trade import has_series, measure_cases
from proofmass.sim.engines import NATIVE_ENGINE, engine_of
from proofmass.sim.model_source import ModelSource
from proofmass.sim.protocol.programs import Imposed
from proofmass.studies.record import Setting, StudyRow
from proofmass.studies.store import Store, package_versions
from proofmass.studies.study import Study
from proofmass.studies.trade.choose import (
    ERROR_MARGIN,
    Choice,
    NoGoodSetting,
    VerifySetting,
    choose,
    describe_choice,
    format_snippet,
)
from proofmass.studies.trade.creep import Creep, find_slow_setting
from proofmass.studies.trade.disturbed import disturb_motions, end_at_horizon
from proofmass.studies.trade.joint_creep import find_in_model
from proofmass.studies.trade.program import drive_ways, program_text, snippet
from proofmass.studies.trade.search import (
    COST_RATIO,
    GIVEN_UP_RATIO,
    YIELDING_COST_RATIO,
    refine_for_drives,
    search,
)
from proofmass.studies.trade.series import Limits, list_cached_settings
from proofmass.studies.trade.trade import kind_to_study
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.verify import Check, verify


def run_choose(
    path: Path,
    error: float,
    error_kind: str,
    solver: str,
    kind: Kind | None,
    drive: str,
    output: Path | None,
    store: Path,
    jobs: int | None,
    dask: str | None,
    longest: float,
    budget: float,
    engines: list[str],
) -> None:
    """Run the command ``proofmass choose``; `proofmass.commands.cli` describes its options."""
    with exit_on_error(f"{store} keeps the runs"):
        case = load_only_case(path, provide_engines(engines))
        kind = kind_to_study(case, kind)
        require_error(error)
        require_solver(case, kind, solver)
        solver = find_solver(case, kind, drive, solver)
        require_writable(case, kind, output)
        limits = Limits(require_seconds("--longest", longest), require_seconds("--budget", budget))
        if not has_series(case, kind):
            raise typer.Exit(1)
        study = Study(Store(store / "runs"), longest=GIVEN_UP_RATIO * longest)
        verdicts, sensitivity = list[Verdict](), ""
        if kind == "dynamics":
            with (
                pool(jobs, dask) as workers,
                progress_bar(max_letters=40) as advance,
            ):
                working = replace(study, workers=workers, progress=advance)
                (motion,) = disturb_motions([case], [kind], working)
                case = end_at_horizon(case, kind, motion)  # up to the horizon of a chaotic motion
                sensitivity = motion.words if motion else ""
                rows = search(
                    case,
                    error_kind,
                    error / ERROR_MARGIN,
                    working,
                    solver,
                    limits=limits,
                    cost_ratio=search_cost_ratio(case, drive),
                )
            more = list(list_cached_settings(case, kind, rows, study.store, solver))
            limits.known, rows = len(more), rows + more
            error_console.print(limits.words, markup=False, highlight=False)
        else:
            measured = measure_cases([case], store, jobs, dask, kind, longest)
            rows, verdicts = measured.rows, measured.verdicts
        require_error_kind(rows, error_kind)
        check = partial(verify, study=study, drive=drive, compare=True)
        try:
            choice = choose_with_drive(
                case, kind, rows, error, error_kind, solver, verdicts, check, study, limits
            )
            choice = replace(choice, motion=sensitivity)
        except NoGoodSetting as why:
            error_console.print(
                f"{case.name}: {'; '.join(filter(None, (str(why), sensitivity)))}", markup=False
            )
            raise typer.Exit(1) from None
        if output is None:
            print(format_snippet(choice, case))
            return
        found = choice.check
        if found.ran is None:
            raise InputError(path, "", f"no program can be written: {found.reason}")
        drive_of = found.drive or drive_ways(case, choice.row.engine)[0]
        write_output(
            output,
            own_program(case, found.used, drive_of, program_docstring(choice, case, output.name)),
        )
        print(output)
        error_console.print("\n".join(describe_choice(choice, case)), markup=False)


def load_only_case(path: Path, engines: tuple[str, ...] = ()) -> Case:
    """Load the only case of a path; raise InputError if the path has several."""
    if sum(file.suffix == ".toml" for file in collect_inputs([path], [])) > 1:
        raise single_case_error(path)
    (case,) = load_cases([path], engines)
    return case


def run_creep(path: Path, wanted: float, solver: str, output: Path | None, longest: float) -> None:
    """Run the command ``proofmass choose --creep``.

    Joints that dry friction should hold come first, see `proofmass.studies.trade.joint_creep`; of a
    case without such joints the bodies on contacts, see `proofmass.studies.trade.creep`.
    """
    with exit_on_error("nothing is kept"):
        if not 0 < wanted < inf:
            raise ValueError(f"--creep {wanted:g}: give a speed in m/s or rad/s, such as 1e-6")
        seconds = require_seconds("--longest", longest)
        if bare := find_bare_model(path):
            if not choose_joint_friction(bare, "start", wanted, output, seconds):
                raise InputError(
                    bare.file,
                    "",
                    "no joint creeps that its dry friction (frictionloss) would hold; for bodies "
                    "on contacts give a case",
                )
            return
        case = load_only_case(path)
        joints = not case.drive and not case.rod and solver in ("", NATIVE_ENGINE)
        own = ModelSource(case.model_path)
        if joints and choose_joint_friction(own, case.start, wanted, output, seconds):
            return
        if "dynamics" not in case.run or case.drive:
            raise ValueError(
                f"--creep: {case.name} has no free motion in time, which could come to rest"
            )
        require_solver(case, "dynamics", solver)
        require_writable(case, "dynamics", output)
        solver = solver or case.run["dynamics"].engines[0]
        with error_console.status("running programs"):
            model, *tried = find_slow_setting(case, solver, wanted, seconds)
        best = min((model, *tried), key=lambda one: one.rate if one.rate == one.rate else inf)
        lines = [
            f"{case.name}, dynamics: places at rest are to creep with {wanted:g} m/s at most",
            *(f"{format_setting(case, one)}: {one.words}" for one in (*tried[::-1], model)),
        ]
        if not best.rate <= wanted:
            error_console.print("\n".join(lines), markup=False, highlight=False)
            raise typer.Exit(1)
        if output is None:
            print_comment(solver, lines)
            print(snippet(best.setting, best.steps, case.model_path))
            return
        text = "\n".join(fill(line, 92) for line in lines)
        docstring = f"{text}\n\nMade by proofmass choose with {format_packages(solver)}."
        write_output(
            output, own_program(case, best.setting, drive_ways(case, solver)[0], docstring)
        )
        print(output)
        error_console.print(text, markup=False, highlight=False)


def find_bare_model(path: Path) -> ModelSource | None:
    """The model that a path names, if it has no sidecar; None for a sidecar or a folder."""
    files = collect_inputs([path], []) if path.is_file() else []
    return ModelSource(files[0]) if [file.suffix == ".toml" for file in files] == [False] else None


def choose_joint_friction(
    source: ModelSource, start: str, wanted: float, output: Path | None, seconds: float
) -> bool:
    """Print the friction with which joints creep slowly enough; False if none creeps.

    Raises
    ------
    InputError
        The runs of the model end.
    ValueError
        A program is to be written.
    """
    with error_console.status("running the model"):
        try:
            own, tried = call_isolated(find_in_model, source, start, wanted, timeout=seconds)
        except (Crashed, OutOfMemory, TimedOut) as error:
            raise InputError(source.file, "", f"its runs: {error}") from None
    if not own.joints:
        return False
    if output:
        raise ValueError(f"-o {output}: joints creep, and their lines are printed; leave it out")
    good = [one for one in tried if one.fastest <= wanted]
    lines = [
        f"{source.file.name}: joints that friction holds are to creep with {wanted:g} rad/s or m/s "
        "at most",
        *(f"{one.setting.words}: {one.words}" for one in (own, *tried)),
    ]
    if own.fastest > wanted and not good:
        error_console.print("\n".join(lines), markup=False, highlight=False)
        raise typer.Exit(1)
    lines += ["attributes for the elements of these names, in the model:"]
    print_comment(NATIVE_ENGINE, lines)
    for one in good:
        if one is not good[0]:
            print("<!-- or -->")
        print(*one.setting.lines(one.joints), sep="\n")
    return True


def print_comment(solver: str, lines: list[str]) -> None:
    """Print lines as a comment of what an engine reads."""
    comment = "\n".join(fill(line, 92, subsequent_indent="  ") for line in lines)
    print(engine_of(solver).programs.write_comment(comment.replace("--", "-")))


def own_program(case: Case, setting: Setting, drive: Imposed, docstring: str) -> str:
    """The text of a program, with the mark by which a later call knows that it may replace it."""
    return f"# {OUTPUT_MARK}\n{program_text(case, setting, drive, docstring)}"


def format_setting(case: Case, one: Creep) -> str:
    """Describe a setting: its engine, and the parameters that differ from the sidecar."""
    own = case.settings.get(one.setting.engine, {})
    changed = {k: v for k, v in one.setting.parameters.items() if own.get(k) != v}
    chosen = engine_of(one.setting.engine).chooses
    text = ", ".join(f"{k} {v:g}" for k, v in changed.items() if k not in chosen)
    return f"{engine_of(one.setting.engine).title} {text or 'as in the model'}"


def choose_with_drive(
    case: Case,
    kind: Kind,
    rows: list[StudyRow],
    error: float,
    error_kind: str,
    solver: str,
    verdicts: list[Verdict],
    check: VerifySetting,
    study: Study,
    limits: Limits,
) -> Choice:
    """Choose a setting; if the drives of its program are not accurate enough, try finer steps."""
    tried = list[tuple[StudyRow, float]]()

    def noted(case: Case, kind: Kind, row: StudyRow, of: str, wanted: float) -> Check:
        found = check(case, kind, row, of, wanted)
        tried.append((row, found.fresh))
        return found

    for last in (False,) * MAX_REFINEMENT_ROUNDS + (True,):
        with error_console.status("running the programs of settings"):
            try:
                return choose(case, kind, rows, error, error_kind, solver, verdicts, noted, limits)
            except NoGoodSetting:
                tasks = refine_for_drives(case, tried, error) if case.drive else []
                if last or not tasks:
                    raise
            refused = [row for row, _ in tried]
            rows = [row for row in rows if row not in refused]
            rows += study.run(tasks)
            tried.clear()
    raise AssertionError("the last round returns or raises")


def program_docstring(choice: Choice, case: Case, name: str = "run.py") -> str:
    """Text of the docstring of a written program."""
    lines = [fill(line, 92) for line in describe_choice(choice, case)]
    return (
        f"{lines[0]}.\n\n" + "\n".join(lines[1:]) + f"\n\nMade by proofmass choose with "
        f"{format_packages(choice.row.engine)}.  It writes the "
        f"curves of all channels, in SI units:\n\n    python {name} [curves.csv]"
    )


def format_packages(engine: str) -> str:
    """The distributions that compute an engine's results, with their versions."""
    packages = engine_of(engine).packages
    return ", ".join(f"{name} {package_versions(engine)[name]}" for name in packages) or engine


def require_writable(case: Case, kind: Kind, output: Path | None) -> None:
    """Raise ValueError if no program can be written: no dynamics, or an unusable file name."""
    if output is None:
        return
    if kind != "dynamics":
        raise ValueError(
            f"-o {output}: a program steps through time, and the {kind} of "
            f"{case.name} has no time; without -o the setting is printed"
        )
    if output.suffix != ".py":
        raise ValueError(f"-o {output}: give the name of a Python program, such as run.py")
    if output.is_dir():
        raise ValueError(f"-o {output}: a folder; give the name of a Python program in it")
    if not output.parent.is_dir():
        raise ValueError(f"-o {output}: there is no folder {output.parent}")
    require_replaceable(output)  # before the runs, which take minutes


def find_solver(case: Case, kind: Kind, drive: str, solver: str) -> str:
    """The only engine whose programs can move drives in the way `drive`; else `solver` as given.

    Raises
    ------
    ValueError
        No engine of the case can, or no drive of the run moves in time.
    """
    if not drive:
        return solver
    if kind != "dynamics" or not case.drive:
        raise ValueError(
            f"--drive {drive}: in the {kind} of {case.name} no drive moves in time; leave it out"
        )
    ways = {
        name: dict.fromkeys(one.kind for one in drive_ways(case, name))
        for name in ([solver] if solver else case.run[kind].engines)
    }
    if fitting := [name for name, kinds in ways.items() if drive in kinds]:
        return fitting[0] if len(fitting) == 1 else solver
    known = "; ".join(f"{name} has {', '.join(kinds)}" for name, kinds in ways.items())
    raise ValueError(f"--drive {drive}: {known}")


def search_cost_ratio(case: Case, drive: str) -> float:
    """The cost ratio with which `search` follows families, larger for drives that yield."""
    yields = any(
        one.kind == drive and one.gain
        for name in case.run["dynamics"].engines
        for one in drive_ways(case, name)
    )
    return YIELDING_COST_RATIO if yields else COST_RATIO


MAX_REFINEMENT_ROUNDS = 4
"""Number of times that steps are made finer because drives of programs are not accurate enough."""


def require_error(error: float) -> None:
    """Raise ValueError unless an error is a share between 0 and 1."""
    if not 0 < error < 1:
        raise ValueError(
            f"--error {error:g}: give a share of the range between 0 and 1, such as 1e-5"
        )


def require_solver(case: Case, kind: Kind, solver: str) -> None:
    """Raise ValueError if an engine is named in which the case does not run."""
    known = case.run[kind].engines
    if solver and solver not in known:
        raise ValueError(f"--solver {solver}: {case.name} runs in {', '.join(known)}")


def require_error_kind(rows: list[StudyRow], error_kind: str) -> None:
    """Raise ValueError if no run has an error of that kind, while some have other errors."""
    kinds = dict.fromkeys(kind for row in rows for kind in row.errors)
    if kinds and error_kind not in kinds:
        raise ValueError(
            f"--of {error_kind}: no channel is of that kind; there are: {', '.join(kinds)}"
        )
