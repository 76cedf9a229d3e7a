"""Parts that the commands of all studies share: load the given cases, check given times."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import inf
from pathlib import Path

from proofmass.case import Case
from proofmass.check import called, collect, load, tell_apart
from proofmass.command import errors
from proofmass.errors import InputError
from proofmass.solve import with_computing_solvers


def named(paths: list[Path]) -> list[Case]:
    """Load all cases below the paths; raise the first error of any of them.

    Paths are made absolute, since workers of a cluster run in other folders.  Models without a
    sidecar are passed over with a message; if there are no others, the first of them is the error.
    """
    wrong: list[InputError] = []
    files = collect(paths, wrong)
    sidecars = [file.absolute() for file in files if file.suffix == ".toml"]
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # each is checked in a worker
        cases = list(threads.map(partial(load, strict=True), sidecars))
    names = tell_apart(sidecars)
    cases = [called(case, names[file]) for file, case in zip(sidecars, cases, strict=True)]
    lone = [
        InputError(
            file,
            "",
            "no sidecar says what is right, which a study needs; `proofmass new NAME --from "
            f"{file.name}` writes one",
        )
        for file in files
        if file.suffix != ".toml"
    ]
    if wrong or not cases:
        raise (wrong or lone)[0]
    for one in lone:
        errors.print(f"passed over: {one}", markup=False)
    return [computing(case) for case in cases]


def computing(case: Case) -> Case:
    """The case without solvers whose curves are recorded; a message names each that is left out.

    Raises
    ------
    InputError
        All its solvers have recorded curves.
    """
    case_left, others = with_computing_solvers(case)
    if others and not case_left.run:
        raise InputError(
            case.file,
            "run",
            f"{', '.join(others)}: curves that are recorded have no settings to study; a study "
            "needs an engine that computes",
        )
    for solver in others:
        errors.print(
            f"{case.name}: {solver} is left out: its curves are recorded, so it has no settings",
            markup=False,
        )
    return case_left


def seconds(option: str, value: float) -> float:
    """The value of an option in seconds; raise ValueError unless it is positive and finite."""
    if not 0 < value < inf:
        raise ValueError(f"{option} {value:g}: give a number of seconds above 0, such as 30")
    return value
