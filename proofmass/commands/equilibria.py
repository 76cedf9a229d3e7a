"""``proofmass equilibria``: all equilibria of the rods of a case or of an assembly file."""

import json
import tomllib
from pathlib import Path

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
)
from proofmass.formats.terminal import make_console
from proofmass.run.case_files import input_files
from proofmass.run.sidecar import load_case
from proofmass.studies.equilibria.assembly_case import read_case
from proofmass.studies.equilibria.assembly_file import read_assembly
from proofmass.studies.equilibria.output import (
    draw_equilibria,
    equilibria_csv,
    equilibrium_rows,
    equilibrium_table,
    summary_lines,
)
from proofmass.studies.equilibria.rod_input import RodInput

DEFAULT_ALPHA = 10.0
"""alpha up to which rods that are not straight and pinned are searched: a platform on three of them
takes half a minute."""
NONE_FOUND = 1  # exit code


def run_equilibria(
    model: Path,
    inflections: int,
    alpha: float | None,
    turns: float,
    output: Path | None,
    as_json: bool,
) -> None:
    """Run ``proofmass equilibria``; `proofmass.commands.cli` describes its arguments."""
    with exit_on_error("nothing is written"):
        own = read_rods(model)
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
        rows = equilibrium_rows(own, found)
        if output is not None:
            make_folder(output)
            write_output(output / "equilibria.csv", equilibria_csv(rows))
            write_output(output / "equilibria.json", json.dumps(rows, indent=1) + "\n")
            write_output(output / "equilibria.png", draw_equilibria(own, found, "png"))
    if as_json:
        print(json.dumps(rows, indent=1))
        return
    make_console().print(equilibrium_table(found))
    for line in summary_lines(own, found):
        print(line)
    if output is not None:
        error_console.print(str(output / "equilibria.png"))


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
