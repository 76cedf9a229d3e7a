"""Cases and stubs of references for the tests of `proofmass.reference`."""

from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.protocol import Mode, Position, Reference
from proofmass.base.errors import InputError
from proofmass.base.recorded import RecordedTable, RecordingTable
from proofmass.base.recording import Recorded
from proofmass.case.case import DriveTable
from proofmass.reference import evaluate as evaluation
from proofmass.reference import profiles, recorded_rows, samples
from proofmass.run.sidecar import load_case
from tests.shipped import shipped

PENDULUM, FOURBAR, FIVEBAR, RECORDED, ROD = (
    load_case(shipped(f"{name}.toml"))
    for name in ("pendulum", "fourbar", "fivebar", "hacksaw_recorded", "rod_cantilever")
)
X = np.array([0.0, 0.25, 1.0])


def with_tables(case, **changed):
    """The case with some of its tables replaced."""
    return case.model_copy(update=changed)


def with_run_table(case, kind, **table):
    """The case with one run alone, some keys of which are replaced."""
    return with_tables(case, run={kind: case.run[kind].model_copy(update=table)})


def with_drives(*tables, case=FOURBAR):
    """The case with these drives, whose joints have the numbers of the drives as names."""
    return with_tables(
        case,
        drive=tuple(
            DriveTable(joint=str(k), **{"from": 0.0, **table}) for k, table in enumerate(tables)
        ),
    )


def error_of(function, *args, **named):
    """The file, the key and the message of the error that a call raises."""
    with pytest.raises(InputError) as error:
        function(*args, **named)
    return error.value.file, error.value.key, error.value.wrong


def make_reference(solve=None, **attributes) -> type[Reference]:
    """A reference with parameters `length` and `mode`, whose method calls a function."""

    def call(self, motion, ask):
        return solve(motion, ask, **self.values)

    fields = {"__annotations__": {"length": Position, "mode": Mode}, "length": 1.0, "mode": 1}
    module = {"__module__": Reference.__module__}  # as one of proofmass
    return type("Made", (Reference,), {**module, **fields, "solve": call, **attributes})


def use_reference(monkeypatch, **attributes):
    """Let all cases have a reference with these attributes of its class."""
    made = make_reference(**attributes)
    find_instead(monkeypatch, made)


def find_instead(monkeypatch, found: type[Reference] | Recorded):
    """Let all cases have this reference."""
    for module in samples, recorded_rows, profiles, evaluation:
        monkeypatch.setattr(module, "load_reference", lambda case: found)
    as_class = None if isinstance(found, Recorded) else found
    monkeypatch.setattr(evaluation, "reference_class", lambda case: as_class)


def use_recorded_curve(monkeypatch, **columns) -> Recorded:
    """Replace the reference of all cases by a recorded curve of three rows at `X`.

    Each column is given as its unit and its values.
    """
    units = {"t": "s"} | {name: unit for name, (unit, *_) in columns.items()}
    cells = zip(X, *(values for _, *values in columns.values()), strict=True)
    rows = tuple((k, [repr(float(cell)) for cell in row]) for k, row in enumerate(cells, 2))
    curve = Recorded(
        RecordedTable(Path(RECORDED.reference), units, rows), RecordingTable.model_validate({})
    )
    find_instead(monkeypatch, curve)
    return curve
