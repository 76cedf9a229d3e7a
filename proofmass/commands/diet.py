"""``proofmass diet``: find what a model needs, and write the reduced model."""

from dataclasses import replace
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import protect, require_replaceable
from proofmass.batch.pool import pool
from proofmass.commands.command import error_console, exit_on_error
from proofmass.formats.terminal import make_console
from proofmass.sim.model_files import files_of_model
from proofmass.studies.diet.diet import DietSearch, result_parts, write_result
from proofmass.studies.diet.scene import load_scene
from proofmass.studies.store import Store
from proofmass.studies.study import Study


def run_diet(
    model: Path,
    output: Path | None,
    seconds: float,
    monitored: list[str] | None,
    error: float | None,
    keep_options: bool,
    blind: bool,
    jobs: int | None,
    dask: str | None,
) -> None:
    """Run ``proofmass diet``; `proofmass.commands.cli` describes its arguments."""
    from proofmass.studies.diet.page import write_diet  # matplotlib is slow to load

    file = output or Path("diet") / model.name
    with exit_on_error("what was tried is kept"):
        if file.suffix != ".xml":
            raise InputError(file, "", "give the name of a model, such as reduced.xml")
        protect([*files_of_model(model), *model.absolute().parent.glob("*.toml")])
        for place in (file, file.with_suffix(".csv")):
            require_replaceable(place)  # before the trials, which take minutes
        study = Study(Store(file.parent / "runs"))
        scene = load_scene(model, seconds, tuple(dict.fromkeys(monitored or ())), error)
        with (
            pool(jobs, dask) as workers,
            error_console.status("starting") as status,
        ):
            found = DietSearch(
                scene,
                replace(
                    study, workers=workers, progress=lambda label, *_: status.update(label[:70])
                ),
                blind,
                tune=not keep_options,
            ).run()
        write_result(scene, study, found, file)
        page = write_diet(file.parent, file.parent).first
    for part in result_parts(found.table):
        make_console().print(part, markup=False)
    print()
    for path in (file, file.with_suffix(".csv"), page):
        print(path)
