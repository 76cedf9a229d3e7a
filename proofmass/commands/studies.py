"""Parts that the commands of all studies share: load the given cases, check given times."""

import os
from concurrent.futures import ThreadPoolExecutor
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
    """Load all cases below the paths, with the solvers that a study runs.

    `engines` that a command asks for replace the solvers of the cases.

    Raises
    ------
    InputError
        The first error of any path or case.
    """
    cases, faults = read_cases(paths)
    if faults:
        raise faults[0]
    if engines:
        cases = [with_engines(case, engines) for case in cases]
    return [without_recorded_solvers(case) for case in cases]


def read_cases(paths: list[Path]) -> tuple[list[Case], list[InputError]]:
    """Load all cases below the paths, and the errors of those that are at fault.

    Paths are made absolute, since workers of a cluster run in other folders.  Models without a
    sidecar are passed over with a message.

    Raises
    ------
    InputError
        There is no case; it is the first error, or that of the first model without a sidecar.
    """
    problems: list[InputError] = []
    files = collect_inputs(paths, problems)
    sidecars = [file.absolute() for file in files if file.suffix == ".toml"]
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # each is checked in a worker
        loaded = list(threads.map(load_or_find_fault, sidecars))
    names = unique_names(sidecars)
    cases = [
        rename_case(found, names[file])
        for file, found in zip(sidecars, loaded, strict=True)
        if isinstance(found, Case)
    ]
    problems += [found for found in loaded if isinstance(found, InputError)]
    protect(file for case in cases for file in input_files(case))
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
    if not cases:
        raise (problems or without_sidecar)[0]
    for problem in without_sidecar:
        error_console.print(f"passed over: {problem}", markup=False)
    return cases, problems


def load_or_find_fault(sidecar: Path) -> Case | InputError:
    """The case of a sidecar, or what is at fault in it, its model or its reference."""
    try:
        return load_validated(sidecar, strict=True)
    except InputError as error:
        return error


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
