"""Errors of the programs that `proofmass choose` writes, and a search for cheaper settings.

    python -m benchmarks.choose [folder] [--quick]

Writes docs/choose.md.  Runs are kept in the folder (reports/choose), so that a call continues where
another was interrupted.
"""

import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from benchmarks import ROOT, command, folders
from benchmarks.rivals import Duel, duel
from examples.chosen import truths
from proofmass.base.wording import number
from proofmass.batch.pool import pool
from proofmass.case.case import Case
from proofmass.commands.choose import (
    choose_with_drive,
    program_docstring,
    search_cost_ratio,
)
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.programs import Imposed
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.choose import ERROR_MARGIN, Choice
from proofmass.studies.trade.program import (
    bare_command,
    describe_drive,
    drive_ways,
    program_text,
)
from proofmass.studies.trade.search import GIVEN_UP_RATIO, search
from proofmass.studies.trade.series import Limits
from proofmass.studies.trade.verify import verify
from proofmass.studies.trade.words import format_setting

RIVALS = 200  # random settings that are compared with each chosen one
BUDGET = 30.0  # wall time [s] of a search, and of a program
OWN = "tests/data/chosen"
HEAD = """# Programs that choose writes

`python -m benchmarks.choose` made this page. Each row is a setting that `proofmass choose CASE
--error ASKED --solver ENGINE --drive DRIVE -o run.py` found. *Printed* is the error that this
command prints. *Bare* is the error of the CSV file that the program writes when it is run by
itself. Programs do not import proofmass; tests run them where it cannot be imported. Its references
are formulas of each mechanism and scipy's DOP853 (`examples/chosen/truths.py`), which share no code
with proofmass. Both errors are shares of the range. *Ratio* is bare over printed, *seconds* the
wall time of the program's steps.

| case | engine | drive | asked | printed | bare | ratio | seconds | setting |
|---|---|---|---|---|---|---|---|---|"""
RIVALS_HEAD = """
## Is anything cheaper?

Each chosen setting is compared with {count} random settings of the same engine and drive. Half of
them are drawn from all integrators, steps, `solref`, `solimp`, solvers, iterations and tolerances
of MuJoCo, or from all steps, iterations and `error_bias` of pymunk; the other half differ from the
chosen setting in one to three of these parameters. *As good* is the number of settings whose
program has an error no larger than that of the chosen one. These are timed in turn, {rounds} times.
The four with the shortest times are then timed in {pairs} pairs with the chosen setting, each of
the two first in every other pair. *Cheapest* is the smallest of the four median ratios.

| case | engine | drive | error | settings | ran in time | as good | cheapest | its setting |
|---|---|---|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Asked:
    """The arguments of `choose`; `truth` is the name of a reference in `examples.chosen.truths`."""

    path: str
    truth: str
    engine: str
    drive: str
    of: str
    error: float
    rivals: bool = False


ASKED = (
    Asked("models/linkages/fourbar.toml", "fourbar", "mujoco", "flywheel", "position", 1e-5, True),
    Asked("models/linkages/fourbar.toml", "fourbar", "mujoco", "servo", "position", 1e-4),
    Asked("models/linkages/fourbar.toml", "fourbar", "pymunk", "gear", "position", 1e-5, True),
    Asked(
        "models/linkages/fourbar_released.toml",
        "fourbar_released",
        "mujoco",
        "",
        "position",
        1e-5,
        True,
    ),
    Asked(
        "models/linkages/fourbar_released.toml",
        "fourbar_released",
        "pymunk",
        "",
        "position",
        1e-3,
        True,
    ),
    Asked("models/linkages/pendulum.toml", "pendulum", "mujoco", "", "position", 1e-6, True),
    Asked("models/linkages/pendulum.toml", "pendulum", "pymunk", "", "position", 1e-4, True),
    Asked(
        "models/linkages/slider_crank.toml", "slider_crank", "mujoco", "equality", "position", 1e-3
    ),
    Asked("models/linkages/slider_crank.toml", "slider_crank", "pymunk", "motor", "velocity", 1e-4),
    Asked(
        "models/linkages/inverted_slider_crank_classic.toml",
        "swinging_block",
        "mujoco",
        "flywheel",
        "acceleration",
        1e-2,
    ),
    Asked(f"{OWN}/double_pendulum.toml", "double_pendulum", "mujoco", "", "position", 1e-6),
    Asked(f"{OWN}/double_pendulum.toml", "double_pendulum", "pymunk", "", "position", 1e-3),
    Asked(f"{OWN}/jansen.toml", "jansen", "mujoco", "flywheel", "position", 1e-5, True),
    Asked(f"{OWN}/jansen.toml", "jansen", "pymunk", "gear", "position", 1e-4, True),
    Asked(f"{OWN}/quick_return.toml", "quick_return", "mujoco", "flywheel", "velocity", 1e-3),
    Asked(f"{OWN}/quick_return.toml", "quick_return", "pymunk", "gear", "position", 1e-4),
    Asked(f"{OWN}/spring_slider.toml", "spring_slider", "mujoco", "", "position", 1e-5, True),
    Asked(f"{OWN}/spring_slider.toml", "spring_slider", "pymunk", "", "position", 1e-3, True),
    Asked(f"{OWN}/fivebar_swing.toml", "fivebar_swing", "mujoco", "flywheel", "position", 1e-5),
    Asked(f"{OWN}/fivebar_swing.toml", "fivebar_swing", "pymunk", "gear", "acceleration", 1e-4),
)
QUICK = (Asked("models/linkages/pendulum.toml", "pendulum", "mujoco", "", "position", 1e-4, True),)


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "reports" / "choose")
    given = parser.parse_args(argv)
    with folders(given.quick, given.folder) as (folder, docs):
        store, lines, duels = Store(folder / "runs"), [HEAD], list[str]()
        count, rounds = (4, 1) if given.quick else (RIVALS, 7)
        for asked in QUICK if given.quick else ASKED:
            case = load_case(ROOT / asked.path)
            began = time.perf_counter()
            choice = chosen(case, asked, store)
            used, drive = choice.check.used, choice.check.drive or drive_ways(case, asked.engine)[0]
            off = bare(
                program_text(case, used, drive, program_docstring(choice, case)), asked, folder
            )
            lines.append(line(case, asked, choice, drive, off))
            print(lines[-1], f"({time.perf_counter() - began:.0f} s)", flush=True)
            if asked.rivals:
                found = duel(case, asked.truth, asked.of, used, drive, count, 1, rounds)
                duels.append(rival_line(case, asked, drive, found))
                print(duels[-1], flush=True)
        lines += [RIVALS_HEAD.format(count=count, rounds=rounds, pairs=3 * rounds), *duels]
        (docs / "choose.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def chosen(case: Case, asked: Asked, store: Store) -> Choice:
    """The setting that `proofmass choose` finds."""
    with pool() as workers:
        rows = search(
            case,
            asked.of,
            asked.error / ERROR_MARGIN,
            Study(store, workers),
            asked.engine,
            limits=Limits(BUDGET),
            cost_ratio=search_cost_ratio(case, asked.drive),
        )
    study = Study(store, longest=BUDGET)
    check = partial(verify, study=study, drive=asked.drive)
    return choose_with_drive(
        case,
        "dynamics",
        rows,
        asked.error,
        asked.of,
        asked.engine,
        [],
        check,
        replace(study, longest=GIVEN_UP_RATIO * BUDGET),
        Limits(BUDGET),
    )


def bare(text: str, asked: Asked, folder: Path) -> float:
    """The error of a program in a bare interpreter, by a reference without proofmass."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "run.py").write_text(text, encoding="utf-8")
    subprocess.run(bare_command("run.py"), cwd=folder, check=True, capture_output=True)
    return truths.errors(asked.truth, str(folder / "curves.csv"))[asked.of]


def line(case: Case, asked: Asked, choice: Choice, drive: Imposed, off: float) -> str:
    """The row of a chosen setting in the first table."""
    ran, fresh = choice.check.ran, choice.check.fresh
    assert ran
    return (
        f"| {case.name} | {asked.engine} | {moved(case, drive)} | {asked.of} "
        f"{number(asked.error)} | {number(fresh, 2)} | {number(off, 2)} | {off / fresh:.3f} | "
        f"{number(ran.seconds, 2)} | {format_setting(choice.row)} |"
    )


def moved(case: Case, drive: Imposed) -> str:
    """How a case is driven, in words for a table."""
    return describe_drive(drive) if case.drive else "free"


def rival_line(case: Case, asked: Asked, drive: Imposed, found: Duel) -> str:
    """The row of a chosen setting in the table of random settings."""
    best = found.best
    ratio, setting = (number(best.ratio, 2), parameters(best.setting)) if best else ("none", "")
    return (
        f"| {case.name} | {asked.engine} | {moved(case, drive)} | {number(found.error, 2)} | "
        f"{found.tried} | {found.ran} | {found.good} | {ratio} | {setting} |"
    )


def parameters(setting: Setting) -> str:
    """A setting in words."""
    return ", ".join(f"{name} {shown(value)}" for name, value in setting.parameters.items())


def shown(value: object) -> str:
    """A parameter in words."""
    if isinstance(value, tuple):
        return " ".join(map(shown, value))
    return number(value, 4) if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
