"""The files that a case is read from: its sidecar, its model, and what these name."""

from pathlib import Path

from proofmass.case.case import Case
from proofmass.sim.engines import computes_curves, engine_of
from proofmass.sim.model_files import files_of_model
from proofmass.sim.protocol.settings import FILE_MARK


def input_files(case: Case) -> list[Path]:
    """All files that a case is read from."""
    return [case.file, *files_of_model(case.model_path), *recorded_files(case)]


def recorded_files(case: Case) -> list[Path]:
    """The recorded files or the program of the reference, and files of profiles and engines."""
    files = [case.file.parent / case.reference] if case.recorded or case.program else []
    files += case.profile_files
    for solver, settings in case.settings.items():
        names = engine_of(solver).settings.marked(FILE_MARK) if not computes_curves(solver) else []
        files += [case.file.parent / str(settings[name]) for name in names if name in settings]
    return files
