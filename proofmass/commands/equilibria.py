"""``proofmass equilibria``: all equilibria of the rods of a case or of an assembly file."""

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer

from proofmass.analytic.rods.assembly_search import (
    LARGEST_PLAIN_ALPHA,
    SearchLimits,
    find_equilibria,
)
from proofmass.base.errors import InputError
from proofmass.base.files import make_folder, protect, read_text, write_output
from proofmass.commands.command import (
    error_console,
    exit_on_error,
    find_sidecar,
    progress_bar,
    provide_engines,
)
from proofmass.formats.terminal import make_console
from proofmass.run.case_files import input_files
from proofmass.run.sidecar import load_case
from proofmass.studies.equilibria.assembly_case import read_case
from proofmass.studies.equilibria.assembly_file import read_assembly
from proofmass.studies.equilibria.engine_rests import find_engine_rests
from proofmass.studies.equilibria.output import (
    draw_equilibria,
    equilibria_csv,
    equilibrium_rows,
    equilibrium_table,
    rest_lines,
    summary_lines,
)
from proofmass.studies.equilibria.rod_input import RodInput
from proofmass.studies.equilibria.written_case import ChainsInCase, require_writable, write_cases

DEFAULT_ALPHA = 10.0
"""alpha up to which rods that are not straight and pinned are searched: a platform on three of them
takes half a minute."""
NONE_FOUND = 1  # exit code


def run_equilibria(
    model: Path,
    inflections: int,
    alpha: float | None,
    turns: float,
    engines: Sequence[str],
    output: Path | None,
    cases: Path | None,
    numbers: Sequence[int],
    as_json: bool,
) -> None:
    """Run ``proofmass equilibria``; `proofmass.commands.cli` describes its arguments."""
    with exit_on_error("nothing is written"):
        if numbers and cases is None:
            raise ValueError("--number chooses equilibria that are written: give --cases FOLDER")
        own, asked = read_rods(model), provide_engines([*engines])
        plain = own.problem.assembly.is_plain
        most = (LARGEST_PLAIN_ALPHA if plain else DEFAULT_ALPHA) if alpha is None else alpha
        with progress_bar() as advance:
            found = find_equilibria(own.problem, SearchLimits(inflections, most, turns), advance)
        if not len(found):
            error_console.print(
                f"{own.title}: no equilibrium with up to {inflections} inflections and loads up to "
                f"R = {most:g}² EI/L²; the nearest start was left with a gap or an unbalance of "
                f"{found.nearest:.2g} of the sizes of the rods"
            )
            raise typer.Exit(NONE_FOUND)
        chains, rests = ChainsInCase(own, found), {}
        if asked:
            with progress_bar() as advance:
                rests = find_engine_rests(chains, asked, advance)
        rows = equilibrium_rows(own, found, rests)
        if output is not None:
            make_folder(output)
            write_output(output / "equilibria.csv", equilibria_csv(rows))
            write_output(output / "equilibria.json", json.dumps(rows, indent=1) + "\n")
            write_output(output / "equilibria.png", draw_equilibria(own, found, rests, "png"))
        written = [] if cases is None else write_asked(chains, cases, numbers)
    if as_json:
        print(json.dumps(rows, indent=1))
        return
    make_console().print(equilibrium_table(found, rests))
    for line in [*summary_lines(own, found), *rest_lines(found, rests), *written]:
        print(line)
    if output is not None:
        error_console.print(str(output / "equilibria.png"))


def write_asked(chains: ChainsInCase, folder: Path, numbers: Sequence[int]) -> list[str]:
    """Write cases of the equilibria with these numbers, or of all stable ones, and say so."""
    which, lines = [number - 1 for number in numbers], []
    if not numbers:
        stable = np.flatnonzero(chains.found.index == 0)
        which = [int(n) for n in stable if np.isfinite(chains.chains.pose[n, 0])]
        if len(which) < stable.size:
            lines.append(
                f"{stable.size - len(which)} stable one(s) have no counterpart of chains of "
                f"{chains.links} links, and no case"
            )
    require_writable(chains, which)
    files = write_cases(chains, which, make_folder(folder))
    words = "cases" if len(files) != 1 else "case"
    return [*lines, f"{len(files)} {words} of stable equilibria: proofmass check {folder}"]


def read_rods(model: Path) -> RodInput:
    """Read the rods of a case, its model, or an assembly file.

    Raises
    ------
    InputError
        The file is none of them, or its rods are at fault.
    """
    if model.suffix == ".toml" and model.is_file() and is_assembly(model):
        protect([model])
        return read_assembly(model)
    case = load_case(find_sidecar(model))
    protect(input_files(case))
    return read_case(case)


def is_assembly(file: Path) -> bool:
    """Whether a TOML file describes rods without a model: a rod has a clamp, or there is none."""
    try:
        table = tomllib.loads(read_text(file))
    except tomllib.TOMLDecodeError as error:
        raise InputError(file, "", f"not TOML: {error}") from None
    rods = table.get("rod")
    named = isinstance(rods, dict) and any(
        isinstance(rod, dict) and "clamp" in rod for rod in rods.values()
    )
    return named or not ({"reference", "run", "model", "channels"} & table.keys())
