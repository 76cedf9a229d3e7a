"""Cases beside engines, and versions of MuJoCo: tables of docs/other_engines.md, and its picture.

    python -m docs.make.engines [--quick] [--store FOLDER]

Runs ``proofmass engines models/`` with all engines but those that compile for minutes, and
``proofmass versions`` with all releases of MuJoCo from 3.1.0 on; FOLDER keeps the finished runs.
Engines that cannot be had here are left out of the tables.  With --quick two cases run in the
engines of this interpreter, and nothing is written.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from benchmarks import ROOT, command
from docs.make.marks import write_between
from docs.make.pictures import CHROMIUM, chromium, few_colours, open_page, picture
from proofmass.base.wording import number
from proofmass.commands.engines import named_engines
from proofmass.run.sidecar import load_case
from proofmass.sim.engines import format_solver
from proofmass.studies.cells import CellResult, format_motion_errors, format_one_digit
from proofmass.studies.engines.page import ENGINES_TABLE, MARKS, SILENT_MARK, read_engines
from proofmass.studies.engines.summary import summarize_engine
from proofmass.studies.versions.page import VERSIONS_TABLE, read_comparison
from proofmass.studies.versions.table import change_cells, date_lines
from proofmass.verdict.outcome import Outcome

PAGE = ROOT / "docs" / "other_engines.md"
PICTURE = ROOT / "docs" / "engines.png"
VERSION_CASES = (
    *("linkages/fourbar", "linkages/fourbar_released", "linkages/threeprr", "linkages/andrews"),
    *("linkages/slider_crank", "linkages/stephenson", "linkages/peaucellier", "linkages/hacksaw"),
    *("linkages/inverted_slider_crank", "linkages/pendulum", "linkages/driven_cart"),
    *("linkages/gear_pair", "linkages/double_rocker", "linkages/watt", "linkages/triple_rocker"),
    *("spatial/bricard", "spatial/delta", "spatial/stewart", "spatial/euler_top"),
    "spatial/heavy_top",
)
"""The cases whose versions are compared: those of the first comparison by hand, and two more."""
WITNESSES, WITNESSED = ("pinocchio", "simbody"), 1e-8
"""Engines with exact constraints, and the error of positions over the range within which they
confirm a reference."""
SLOW = ("mjx", "mujoco_warp", "newton")
"""Engines that compile for minutes, and are left out: a case takes 12 to 33 s of wall time in MJX,
and 40 to 230 s in Warp, which has no GPU here.  A four-bar with its 6480 steps takes 11 minutes of
processor time in Newton."""
FAST_AT_REST = ("mujoco", "pymunk", "exudyn", "dart")
"""Engines whose rods come to rest in the table of sweeps and equilibria; the others need minutes
for many of these chains."""
RODS = "rods"
"""Folder of the cases with rods."""
LONG = ("rod_snap", "rod_taut", "rod_wind")
"""Cases left out of that table, which were not run in all of these engines: the first two need more
than two minutes of processor time in one of them."""
REST_KINDS = "position", "force"
MARKED = {
    "rests": "python -m docs.make.engines writes the rests from here to the next mark",
    "rods": "python -m docs.make.engines writes the rods from here to the next mark",
    "witnesses": "python -m docs.make.engines writes the witnesses from here to the next mark",
    "engines": "python -m docs.make.engines writes the engines from here to the next mark",
    "versions": "python -m docs.make.engines writes the versions from here to the next mark",
}


def main() -> None:
    """Measure and write, or measure two cases and write nothing."""
    parser = command(__doc__)
    parser.add_argument("--store", help="folder of finished runs", type=Path)
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        store = words.store or Path(temporary)
        if words.quick:
            cases = ["models/linkages/pendulum.toml", "models/linkages/fourbar.toml"]
            run("engines", *cases, "--engine", "mujoco", "--engine", "pymunk", "-o", store / "e")
            print("\n".join(engine_lines(read_engines(store / "e" / ENGINES_TABLE)["results"])))
            return
        asked = [name for name in named_engines([]) if name not in SLOW]
        flags = [word for name in asked for word in ("--engine", name)]
        run("engines", "models/", *flags, "--run", "dynamics", "-o", store / "engines")
        cases = cases_at_rest()
        rods = [case for case in cases if case.parent.name == RODS]
        run("engines", *(case for case in cases if case not in rods), *flags, "-o", store / "rests")
        flags = [word for name in FAST_AT_REST for word in ("--engine", name)]
        run("engines", *rods, *flags, "-o", store / RODS)
        cases = [f"models/{case}.toml" for case in VERSION_CASES]
        run("versions", *cases, "--engine", "mujoco", "--all", "-o", store / "versions")
        write_page(store)


def run(*words: object) -> None:
    """Run a command of proofmass; a comparison of versions that found a change ends with 1."""
    command_line = [sys.executable, "-m", "proofmass", *map(str, words)]
    made = subprocess.run(command_line, cwd=ROOT, check=False)
    if made.returncode not in (0, 1):
        raise SystemExit(made.returncode)


def cases_at_rest() -> list[Path]:
    """The shipped cases that have a sweep or an equilibrium, and no run in time, but for `LONG`."""
    files = sorted((ROOT / "models").rglob("*.toml"))
    files = [file for file in files if file.stem not in LONG]
    return [file for file in files if "dynamics" not in load_case(file).run]


def write_page(store: Path) -> None:
    """Write the tables of the page and its picture from the folders of all studies."""
    results, rests, rods = (
        read_engines(store / name / ENGINES_TABLE)["results"] for name in ("engines", "rests", RODS)
    )
    write_tables(
        engines=engine_lines(results),
        rests=rest_lines(rests),
        rods=rest_lines(rods),
        witnesses=witness_lines(results),
        versions=version_lines(read_comparison(store / "versions" / VERSIONS_TABLE)),
    )
    if CHROMIUM:
        with chromium() as browser:
            tab = open_page(browser, store / "engines" / "index.html")
            tab.evaluate("location.hash = 'off=rods'")
            tab.reload()
            tab.wait_for_load_state()
            few_colours(picture(tab)).save(PICTURE, optimize=True)


def write_tables(**tables: Iterator[str]) -> None:
    """Write tables of the page between their marks."""
    text = PAGE.read_text(encoding="utf-8")
    for name, lines in tables.items():
        begin, end = f"<!-- {MARKED[name]} -->", f"<!-- to here: {name} -->"
        text = write_between(text, begin, end, "\n".join(lines))
    PAGE.write_text(text, encoding="utf-8")


def engine_lines(results: Sequence[CellResult]) -> Iterator[str]:
    """The table of cases with a run in time beside engines, and the sentences on each engine."""
    return case_lines(results, "with a run in time", format_motion_errors)


def rest_lines(results: Sequence[CellResult]) -> Iterator[str]:
    """The same for sweeps and equilibria, with errors of positions and forces."""
    return case_lines(results, "without a run in time", format_rest_errors)


def format_rest_errors(result: CellResult) -> str:
    """The largest errors of positions and of forces."""
    found = [worst.share for kind in REST_KINDS if (worst := result.worst(kind))]
    return " / ".join(map(format_one_digit, found))


def case_lines(
    results: Sequence[CellResult], which: str, format_errors: Callable[[CellResult], str]
) -> Iterator[str]:
    """A table of cases, `which` in words, beside engines, and the sentences on each engine."""
    solvers = [
        solver
        for solver in dict.fromkeys(one.solver for one in results)
        if any(one.solver == solver and one.outcome != Outcome.UNAVAILABLE for one in results)
    ]
    cases = list(dict.fromkeys((one.case, one.run) for one in results))
    places = {(one.case, one.solver): one for one in results}
    filled = sum(one.is_filled for one in results if one.solver in solvers)
    yield (
        f"{filled} of {len(cases) * len(solvers)} runs have errors: {len(cases)} cases {which}, "
        f"{len(solvers)} engines."
    )
    yield ""
    yield f"| case | {' | '.join(format_solver(solver) for solver in solvers)} |"
    yield f"|---|{'---|' * len(solvers)}"
    for case, kind in cases:
        cells = (result_words(places.get((case, solver)), format_errors) for solver in solvers)
        label = case if kind == "dynamics" else f"{case}, {kind}"
        yield f"| {label} | {' | '.join(cells)} |"
    for solver in solvers:
        found = summarize_engine(solver, results)
        yield ""
        median = (
            f", median error {number(found.middle)}, median time {number(found.seconds)} s"
            if found.filled
            else ""
        )
        solves = f" {found.solves[:1].upper()}{found.solves[1:]}." if found.solves else ""
        licence = f" Licence: {found.licence}." if found.licence else ""
        by = f" Computed by {found.versions}." if found.versions else ""
        yield f"**{found.title}**: {found.filled} of {found.of} runs{median}.{solves}{licence}{by}"
        yield ""
        own = [one for one in found.sentences if not one.startswith("Refused: ")]
        yield from (f"- {sentence}" for sentence in own)
        if refused := [one.removeprefix("Refused: ") for one in found.sentences if one not in own]:
            yield f"- Refused: {'; '.join(refused)}."


def witness_lines(results: Sequence[CellResult]) -> Iterator[str]:
    """Which references the engines with exact constraints confirm, and which not."""
    for solver in WITNESSES:
        own = [one for one in results if one.solver == solver and one.is_filled]
        if not own:
            continue
        close = [one for one in own if one.position <= WITNESSED]
        others = ", ".join(
            f"{one.case} {number(one.position)}" for one in own if one.position > WITNESSED
        )
        yield (
            f"**{format_solver(solver)}** confirms {len(close)} of the {len(own)} references that "
            f"it can run within {number(WITNESSED)} of the range in position: "
            f"{', '.join(one.case for one in close)}. Not: {others or 'none'}."
        )
        yield ""


def result_words(result: CellResult | None, format_errors: Callable[[CellResult], str]) -> str:
    """The errors of a result, or a mark with its word."""
    if result is None:
        return ""
    if not result.is_filled:
        mark, words = MARKS.get(result.outcome, ("✕", str(result.outcome)))
        return words if mark == "–" else f"{mark} {words}"
    words = format_errors(result)
    return f"{SILENT_MARK} {words}" if result.is_silently_wrong else words


def version_lines(comparison: dict) -> Iterator[str]:
    """What changed in which version, and the table of changes."""
    changes = comparison["changes"]
    cases = list(dict.fromkeys(one.case for one in comparison["results"]))
    yield (
        f"{len({one.case for one in changes})} of {len(cases)} cases changed between MuJoCo "
        f"{comparison['versions'][0]} and {comparison['versions'][-1]}, "
        f"{len(comparison['versions'])} releases; {len(comparison['results'])} runs found where."
    )
    yield ""
    yield from (f"- {line}" for line in date_lines(changes))
    yield ""
    yield "| case | changed in | after | channel | before | now | factor | moved |"
    yield "|---|---|---|---|---|---|---|---|"
    for one in changes:
        yield f"| {' | '.join(change_cells(one))} |"


if __name__ == "__main__":
    main()
