"""``proofmass choose``: print or write the cheapest setting with a small enough error."""

from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from textwrap import fill

import typer

from proofmass.case import Case
from proofmass.check import collect
from proofmass.command import answering, counting, errors, not_one_case
from proofmass.engines import engine_of
from proofmass.errors import InputError
from proofmass.files import write_whole
from proofmass.strict import Kind
from proofmass.studies.command import named, seconds
from proofmass.studies.record import StudyRow
from proofmass.studies.run import pool
from proofmass.studies.run import run as run_tasks
from proofmass.studies.store import Store, versions
from proofmass.studies.trade.choose import MARGIN, Cannot, Choice, Verify, choose, printed, words
from proofmass.studies.trade.creep import Creep, hold
from proofmass.studies.trade.disturbed import motions_of, within
from proofmass.studies.trade.program import imposed, program
from proofmass.studies.trade.search import SLACK, YIELDING, finer_for_drives, search
from proofmass.studies.trade.series import Limits, list_cached_settings
from proofmass.studies.trade.trade import chosen
from proofmass.studies.trade.trade_command import has_series, measured
from proofmass.studies.trade.verdict import Verdict
from proofmass.studies.trade.verify import Check, verify


def run_choose(
    path: Path,
    error: float,
    of: str,
    solver: str,
    kind: Kind | None,
    drive: str,
    output: Path | None,
    store: Path,
    jobs: int | None,
    dask: str | None,
    longest: float,
    budget: float,
) -> None:
    """Run the command ``proofmass choose``; `proofmass.cli` describes its options."""
    with answering(f"{store} keeps the runs"):
        case = only_case(path)
        kind = chosen(case, kind)
        require_error(error)
        require_solver(case, kind, solver)
        solver = solver_for(case, kind, drive, solver)
        writable(case, kind, output)
        limits = Limits(seconds("--longest", longest), seconds("--budget", budget))
        if not has_series(case, kind):
            raise typer.Exit(1)
        runs, verdicts, sensitivity = Store(store / "runs"), list[Verdict](), ""
        if kind == "dynamics":
            with pool(jobs, dask) as workers, counting(letters=40) as advance:
                (motion,) = motions_of([case], [kind], runs, workers, longest)
                case = within(case, kind, motion)  # up to the horizon of a chaotic motion
                sensitivity = motion.words if motion else ""
                rows = search(
                    case,
                    of,
                    error / MARGIN,
                    runs,
                    workers,
                    solver,
                    limits=limits,
                    slack=slack_for(case, drive),
                    progress=advance,
                )
            more = list(list_cached_settings(case, kind, rows, runs, solver))
            limits.known, rows = len(more), rows + more
            errors.print(limits.words, markup=False, highlight=False)
        else:
            study = measured([case], store, jobs, dask, kind, longest)
            rows, verdicts = study.rows, study.verdicts
        there(rows, of)
        check = partial(verify, store=runs, longest=longest, drive=drive, compare=True)
        try:
            choice = choose_with_drive(
                case, kind, rows, error, of, solver, verdicts, check, runs, limits
            )
            choice = replace(choice, motion=sensitivity)
        except Cannot as why:
            errors.print(
                f"{case.name}: {'; '.join(filter(None, (str(why), sensitivity)))}", markup=False
            )
            raise typer.Exit(1) from None
        if output is None:
            print(printed(choice, case))
            return
        found = choice.check
        if found.ran is None:
            raise InputError(path, "", f"no program can be written: {found.reason}")
        drive_of = found.drive or imposed(case, choice.row.engine)[0]
        write_whole(output, program(case, found.used, drive_of, head(choice, case, output.name)))
        print(output)
        errors.print("\n".join(words(choice, case)), markup=False)


def only_case(path: Path) -> Case:
    """Load the only case of a path; raise InputError if the path has several."""
    if sum(file.suffix == ".toml" for file in collect([path], [])) > 1:
        raise not_one_case(path)
    (case,) = named([path])
    return case


def run_creep(path: Path, wanted: float, solver: str, output: Path | None, longest: float) -> None:
    """Run the command ``proofmass choose --creep``; see `proofmass.studies.trade.creep`."""
    with answering("nothing is kept"):
        case = only_case(path)
        if not 0 < wanted < inf:
            raise ValueError(f"--creep {wanted:g}: give a speed in m/s, such as 1e-6")
        if "dynamics" not in case.run or case.drive:
            raise ValueError(
                f"--creep: {case.name} has no free motion in time, which could come to rest"
            )
        require_solver(case, "dynamics", solver)
        writable(case, "dynamics", output)
        solver = solver or case.run["dynamics"].solvers[0].partition(":")[0]
        with errors.status("running programs"):
            model, *tried = hold(case, solver, wanted, seconds("--longest", longest))
        best = min((model, *tried), key=lambda one: one.rate if one.rate == one.rate else inf)
        lines = [
            f"{case.name}, dynamics: places at rest are to creep with {wanted:g} m/s at most",
            *(f"{format_setting(case, one)}: {one.words}" for one in (*tried[::-1], model)),
        ]
        if not best.rate <= wanted:
            errors.print("\n".join(lines), markup=False, highlight=False)
            raise typer.Exit(1)
        if output is None:
            comment = "\n".join(fill(line, 92, subsequent_indent="  ") for line in lines)
            engine = engine_of(solver)
            print(engine.comment(comment.replace("--", "-")))
            print(engine.snippet(best.setting.parameters, best.steps, case.model_path))
            return
        text = "\n".join(fill(line, 92) for line in lines)
        made = f"{text}\n\nMade by proofmass choose with {made_with(solver)}."
        write_whole(output, program(case, best.setting, imposed(case, solver)[0], made))
        print(output)
        errors.print(text, markup=False, highlight=False)


def format_setting(case: Case, one: Creep) -> str:
    """Describe a setting: its engine, and the parameters that differ from the sidecar."""
    own = case.settings.get(one.setting.engine, {})
    more = {k: v for k, v in one.setting.parameters.items() if own.get(k) != v}
    chosen = engine_of(one.setting.engine).chooses
    text = ", ".join(f"{k} {v:g}" for k, v in more.items() if k not in chosen)
    return f"{engine_of(one.setting.engine).title} {text or 'as in the model'}"


def choose_with_drive(
    case: Case,
    kind: Kind,
    rows: list[StudyRow],
    error: float,
    of: str,
    solver: str,
    verdicts: list[Verdict],
    check: Verify,
    store: Store,
    limits: Limits,
) -> Choice:
    """Choose a setting; if the drives of its program are not accurate enough, try finer steps."""
    tried = list[tuple[StudyRow, float]]()

    def noted(case: Case, kind: Kind, row: StudyRow, of: str, wanted: float) -> Check:
        found = check(case, kind, row, of, wanted)
        tried.append((row, found.fresh))
        return found

    for last in (False,) * ROUNDS + (True,):
        with errors.status("running the programs of settings"):
            try:
                return choose(case, kind, rows, error, of, solver, verdicts, noted, limits)
            except Cannot:
                tasks = finer_for_drives(case, tried, error) if case.drive else []
                if last or not tasks:
                    raise
            refused = [row for row, _ in tried]
            rows = [row for row in rows if row not in refused]
            rows += run_tasks(tasks, store, timeout=limits.longest)
            tried.clear()
    raise AssertionError("the last round returns or raises")


def head(choice: Choice, case: Case, name: str = "run.py") -> str:
    """Text of the docstring of a written program."""
    lines = [fill(line, 92) for line in words(choice, case)]
    return (
        f"{lines[0]}.\n\n" + "\n".join(lines[1:]) + f"\n\nMade by proofmass choose with "
        f"{made_with(choice.row.engine)}.  It writes the "
        f"curves of all channels, in SI units:\n\n    python {name} [curves.csv]"
    )


def made_with(engine: str) -> str:
    """The distributions that compute an engine's results, with their versions."""
    packages = engine_of(engine).packages
    return ", ".join(f"{name} {versions(engine)[name]}" for name in packages) or engine


def writable(case: Case, kind: Kind, output: Path | None) -> None:
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


def solver_for(case: Case, kind: Kind, drive: str, solver: str) -> str:
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
    names = dict.fromkeys(name.partition(":")[0] for name in case.run[kind].solvers)
    ways = {
        name: dict.fromkeys(one.kind for one in imposed(case, name))
        for name in ([solver] if solver else names)
    }
    if fit := [name for name, kinds in ways.items() if drive in kinds]:
        return fit[0] if len(fit) == 1 else solver
    known = "; ".join(f"{name} has {', '.join(kinds)}" for name, kinds in ways.items())
    raise ValueError(f"--drive {drive}: {known}")


def slack_for(case: Case, drive: str) -> float:
    """The cost ratio with which `search` follows families, larger for drives that yield."""
    names = dict.fromkeys(name.partition(":")[0] for name in case.run["dynamics"].solvers)
    yields = any(one.kind == drive and one.gain for name in names for one in imposed(case, name))
    return YIELDING if yields else SLACK


ROUNDS = 4
"""Number of times that steps are made finer because drives of programs are not accurate enough."""


def require_error(error: float) -> None:
    """Raise ValueError unless an error is a share between 0 and 1."""
    if not 0 < error < 1:
        raise ValueError(
            f"--error {error:g}: give a share of the range between 0 and 1, such as 1e-5"
        )


def require_solver(case: Case, kind: Kind, solver: str) -> None:
    """Raise ValueError if an engine is named in which the case does not run."""
    known = dict.fromkeys(name.partition(":")[0] for name in case.run[kind].solvers)
    if solver and solver not in known:
        raise ValueError(f"--solver {solver}: {case.name} runs in {', '.join(known)}")


def there(rows: list[StudyRow], of: str) -> None:
    """Raise ValueError if no run has an error of that kind, while some have other errors."""
    kinds = dict.fromkeys(kind for row in rows for kind in row.errors)
    if kinds and of not in kinds:
        raise ValueError(f"--of {of}: no channel is of that kind; there are: {', '.join(kinds)}")
