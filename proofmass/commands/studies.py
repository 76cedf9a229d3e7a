"""Parts that the commands of all studies share: load the given cases, check given times."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import inf
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import protect
from proofmass.batch.check import collect_inputs, load_validated, rename_case, unique_names
from proofmass.case.case import Case
from proofmass.commands.command import error_console
from proofmass.run.asked import with_engines
from proofmass.run.case_files import input_files
from proofmass.run.solve import with_computing_solvers


def load_cases(paths: list[Path], engines: tuple[str, ...] = ()) -> list[Case]:
    """Load all cases below the paths; raise the first error of any of them.

    Paths are made absolute, since workers of a cluster run in other folders.  Models without a
    sidecar are passed over with a message; if there are no others, the first of them is the error.
    `engines` that a command asks for replace the solvers of the cases.
    """
    problems: list[InputError] = []
    files = collect_inputs(paths, problems)
    sidecars = [file.absolute() for file in files if file.suffix == ".toml"]
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # each is checked in a worker
        cases = list(threads.map(partial(load_validated, strict=True), sidecars))
    protect(file for case in cases for file in input_files(case))
    names = unique_names(sidecars)
    cases = [rename_case(case, names[file]) for file, case in zip(sidecars, cases, strict=True)]
    without_sidecar = [
        InputError(
            file,
            "",
            "no sidecar says what is right, which a study needs; `proofmass new NAME --from "
            f"{file.name}` writes one",
        )
        for file in files
        if file.suffix != ".toml"
    ]
    if problems or not cases:
        raise (problems or without_sidecar)[0]
    for problem in without_sidecar:
        error_console.print(f"passed over: {problem}", markup=False)
    if engines:
        cases = [with_engines(case, engines) for case in cases]
    return [without_recorded_solvers(case) for case in cases]


def without_recorded_solvers(case: Case) -> Case:
    """The case without solvers whose curves are recorded; a message names each that is left out.

    Raises
    ------
    InputError
        All its solvers have recorded curves.
    """
    computing, others = with_computing_solvers(case)
    if others and not computing.run:
        raise case.error(
            "run",
            f"{', '.join(others)}: curves that are recorded have no settings to study; a study "
            "needs an engine that computes",
        )
    for solver in others:
        error_console.print(
            f"{case.name}: {solver} is left out: its curves are recorded, so it has no settings",
            markup=False,
        )
    return computing


def require_seconds(option: str, value: float) -> float:
    """The value of an option in seconds; raise ValueError unless it is positive and finite."""
    if not 0 < value < inf:
        raise ValueError(f"{option} {value:g}: give a number of seconds above 0, such as 30")
    return value
