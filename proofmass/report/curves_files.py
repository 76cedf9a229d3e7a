"""The curves of a case as files: a CSV table a run, and all runs in Parquet where that is there.

Everything is in SI units and radians.  A column is ``NAME SOLVER [UNIT]``, as
`proofmass.recorded` reads it; the reference of a solver is taken at the drive of its own run, and
columns that are the same for all solvers stand there once, without a solver's name.

Those of the 56 cases below ``models/`` are 33 MB, so they are written where they are asked for.
"""

import io
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.case import Case
from proofmass.files import write_whole
from proofmass.report.data import Shown, drive_units
from proofmass.report.page import slug
from proofmass.sim.protocol import drive_columns
from proofmass.units import si_unit

FOLDER = "data"
Table = dict[str, Array]
PER = "", "/s", "/s^2"


def write_curves(folder: Path, case: Case, runs: list[Shown]) -> None:
    """Write the curves of a case below a report's folder; of a run without curves there are none.

    Files of runs that no longer have any are removed, or they would look like those of this report.
    """
    place = folder / FOLDER
    place.mkdir(parents=True, exist_ok=True)
    for old in named(place, case):
        old.unlink()
    tables: dict[str, Table] = {view.kind: table_of(view) for view in runs if view.curves}
    for kind, table in tables.items():
        write_whole(place / f"{slug(case.name)}-{kind}.csv", as_csv(table))
    if tables and has_parquet():
        write_whole(place / f"{slug(case.name)}.parquet", as_parquet(tables))


def note_on(data: bool) -> str:
    """How to get the files that a report does not have."""
    if not data:
        return "proofmass report --data writes the curves as tables."
    return (
        "" if has_parquet() else "With proofmass[parquet] the curves are written in Parquet, too."
    )


def files_of(folder: Path, case: Case) -> list[tuple[str, str]]:
    """Labels and paths, from the report's folder, of the files that there are of a case."""
    stem = f"{slug(case.name)}-"
    return [
        (
            "Parquet" if file.suffix == ".parquet" else f"{file.stem.removeprefix(stem)} (CSV)",
            f"{FOLDER}/{file.name}",
        )
        for file in named(folder / FOLDER, case)
    ]


def named(place: Path, case: Case) -> list[Path]:
    """The files of a case that there are, by the names that they can have."""
    stem = slug(case.name)
    names = [*(f"{stem}-{kind}.csv" for kind in case.run), f"{stem}.parquet"]
    return [place / name for name in names if (place / name).is_file()]


def table_of(view: Shown) -> Table:
    """The columns of a run; a solver that stopped early has no numbers from there on."""
    unit = "m" if view.x_unit == "m" else "s" if view.x_unit == "s" else "rad"
    table: Table = {f"{view.x_name} [{unit}]": view.grid}
    for name, symbol, each in columns(view):
        parts = each if len({part.tobytes() for part in each.values()}) > 1 else shared(each)
        for solver, values in parts.items():
            words = f"{name} {solver}".strip()
            table[f"{words} [{symbol}]"] = padded(values, view.grid.size)
    return table


def columns(view: Shown) -> Iterator[tuple[str, str, dict[str, Array]]]:
    """Name, unit and curves by solver: the drives as they moved, channels, their references."""
    if view.kind != "equilibrium":
        for row, (drive, unit) in enumerate(
            zip(view.case.drive, drive_units(view.case), strict=True)
        ):
            for order, (name, per) in enumerate(zip(drive_columns(drive.joint), PER, strict=True)):
                moved = {
                    s: c.drive[order][row]
                    for s, c in view.curves.items()
                    if c.drive and not c.by_law
                }
                if moved:
                    yield name, f"{unit}{per}", moved
    for name in view.channels:
        symbol = si_unit(view.case.channels[name].unit or "1")[0] or "1"
        for word, source in (("", view.curves), (" reference", view.truth)):
            found = {s: c.channels[name] for s, c in source.items() if name in c.channels}
            if word and found:
                yield f"{name}{word}", symbol, found
            else:
                for solver, values in found.items():
                    yield f"{name} {solver}", symbol, {"": values}


def shared(each: dict[str, Array]) -> dict[str, Array]:
    """The one column of several that are the same."""
    return {"": next(iter(each.values()))}


def padded(values: Array, length: int) -> Array:
    """A curve with what is not a number after its end."""
    return np.concatenate([values, np.full(length - len(values), np.nan)])


def as_csv(table: Table) -> str:
    """A table with commas and points; all digits of a number, and nothing where there is none."""
    lines = [",".join(f'"{name}"' if "," in name else name for name in table)]
    rows = np.stack(list(table.values()), axis=1).tolist()
    lines += [",".join("" if v != v else repr(v) for v in row) for row in rows]
    return "\n".join(lines) + "\n"


def has_parquet() -> bool:
    """Whether pyarrow is there, which writes Parquet."""
    return find_spec("pyarrow") is not None


def as_parquet(tables: dict[str, Table]) -> bytes:
    """The runs of a case below each other, with a column ``run``."""
    import pyarrow
    import pyarrow.parquet

    parts = [
        pyarrow.table({"run": [kind] * len(next(iter(table.values()))), **table})
        for kind, table in tables.items()
    ]
    whole = pyarrow.concat_tables(parts, promote_options="default")
    stream = io.BytesIO()
    pyarrow.parquet.write_table(whole, stream)
    return stream.getvalue()
