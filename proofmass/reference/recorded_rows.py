"""Rows of a recorded reference against the run that a sidecar states: their ends and columns."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.errors import suggest_names
from proofmass.base.recording import LOST_ROW, SAME_PLACE, PlacedRows, Recorded, SteadyDrive
from proofmass.base.strict import Kind
from proofmass.base.units import same_quantity
from proofmass.case.case import Case
from proofmass.reference.find import load_reference
from proofmass.reference.samples import reference_rows, run_samples, steady_drive
from proofmass.sim.protocol.curves import rows_until

END_SHARE = 0.01
"""Share of a record by which its last row may miss the stated end of a run, if rows are few."""


def check_reference_rows(case: Case, kind: Kind, x: Array) -> None:
    """Raise InputError if the rows of a recorded reference contradict a run of the sidecar.

    Parameters
    ----------
    case, kind
        The run.
    x : ndarray (n,)
        Its samples [s, rad or m].
    """
    reference, placed = load_reference(case), reference_rows(case, kind)
    assert isinstance(reference, Recorded)
    for end in stated_ends(case, kind):
        end.check(case, placed)
    if not placed.have(x):
        placed.require(x, kind)
        reference.recording.check_gaps(reference.gap)


def stated_ends(case: Case, kind: Kind) -> Iterator["StatedEnd"]:
    """The ends of a run that the sidecar states."""
    leader, table, steady = case.leader, case.run[kind], steady_drive(case)
    if kind == "equilibrium":
        steady = None
    if leader and steady:
        law = steady if kind == "dynamics" else None
        yield StatedEnd(0, case.drive_key(0, "from"), leader.start, steady.unit, LOST_ROW, law)
        yield StatedEnd(
            -1, case.drive_key(0, "to"), leader.start + leader.way, steady.unit, law=law
        )
        return
    unit = "m" if kind == "equilibrium" else "s"
    by_rows = leader and isinstance(leader.profile, tuple)
    if not (by_rows or case.sampled_profiles or kind == "equilibrium"):
        yield StatedEnd(0, f"run.{kind}", 0.0, unit, LOST_ROW if leader else SAME_PLACE)
    if table.until is not None:
        yield StatedEnd(-1, f"run.{kind}.until", table.until, unit)
    elif leader and leader.until is not None:
        yield StatedEnd(-1, case.drive_key(0, "until"), leader.until, unit)


@dataclass(frozen=True)
class StatedEnd:
    """An end of a run as the sidecar states it.

    Attributes
    ----------
    row : {0, -1}
        Number of the row of a recorded reference that belongs to it.
    key : str
        The key that states it.
    place : float
        The time, the drive's value, or the arc length there [SI].
    unit : str
        Its unit.
    allowed : float
        Largest distance of the row, in multiples of the usual spacing of rows [1].
    law : SteadyDrive, optional
        The drive whose value the place is, if the x of the run is time.
    """

    row: int
    key: str
    place: float
    unit: str
    allowed: float = SAME_PLACE
    law: SteadyDrive | None = None

    def check(self, case: Case, placed: PlacedRows) -> None:
        """Raise InputError if the row is somewhere else."""
        places = self.law.value(placed.x) if self.law else placed.x
        near = self.allowed * float(np.median(np.abs(np.diff(places))))
        if self.row:
            near = min(near, END_SHARE * float(np.ptp(places)))
        at, recording = float(places[self.row]), placed.recording
        if abs(at - self.place) <= near:
            return
        name, table = recording.column.column, recording.table
        cell = table.cell(self.row, name)
        which, verb = ("last", "end") if self.row else ("first", "begin")
        found, here = f"{cell} {table.unit_of(recording.column)}", f"{at:.6g} {self.unit}"
        raise case.error(
            self.key,
            f"the run {verb}s at {self.place:.6g} {self.unit}, and the {which} row of "
            f"{table.file.name}, {table.line(self.row)}, is at {name} = {found}"
            + (f", which is {here} of the run" if here != found else "")
            + "; change the sidecar or the rows, or shift the column: [recording] "
            f'x = {{ column = "{name}", shift = .. }}',
        )


def interpolation_errors(case: Case, kind: Kind, x: Array) -> dict[str, Array]:
    """The errors that channels of a recorded reference may have between its rows [SI].

    Channels are left out if all samples x (n,) are at rows.
    """
    reference, placed = load_reference(case), reference_rows(case, kind)
    assert isinstance(reference, Recorded)
    if placed.have(x):
        return {}
    return {
        name: abs(channel.scale) * placed.at(x, reference.curve(channel.equals))[1]
        for name, channel in case.channels_of(kind).items()
        if isinstance(channel.equals, str) and channel.equals in reference.columns
    }


def rows_of_channels(case: Case, kind: Kind, x: Array) -> dict[str, tuple[Array, Array]]:
    """The rows of a recorded reference, rising, and the values of channels there [SI].

    Channels are left out if all samples x (n,) are at rows.
    """
    reference, placed = load_reference(case), reference_rows(case, kind)
    assert isinstance(reference, Recorded)
    if placed.have(x):
        return {}
    found = {}
    for name, channel in case.channels_of(kind).items():
        if isinstance(channel.equals, str) and channel.equals in reference.columns:
            values = channel.scale * reference.curve(channel.equals)
            rows = placed.rows_of(values + channel.shift * channel.factor)
            found[name] = rows_until(x, *rows)
    return found


def describe_rows(case: Case, kind: Kind) -> str:
    """A sentence on the x of a recorded reference and its interpolation; empty without either."""
    reference, placed, x = load_reference(case), reference_rows(case, kind), run_samples(case, kind)
    assert isinstance(reference, Recorded)
    words, errors = [placed.words] if placed.words else [], interpolation_errors(case, kind, x)
    if errors:
        share = max(
            float(error.max()) / (float(np.ptp(abs(c.scale) * reference.curve(c.equals))) or 1.0)
            for name, error in errors.items()
            if isinstance((c := case.channels[name]).equals, str)
        )
        words.append(
            f"its {placed.x.size} rows are at uneven times; it is interpolated at even times by a "
            f"cubic spline, which may be off by {share:.2g} of the range"
        )
    return "; ".join(words)


def recorded_column(
    case: Case, reference: Recorded, key: str, name: str, unit: str | None = None
) -> Array:
    """A column of the recorded curve; its unit is checked if `unit` is given."""
    if name not in reference.columns:
        raise case.error(
            key,
            f"no column {name!r} in {case.reference}; {suggest_names(name, reference.columns)}",
        )
    try:
        own = reference.unit(name)
    except ValueError as error:
        raise case.error(key, str(error)) from None
    if unit is not None and not same_quantity(own, unit):
        raise case.error(
            key,
            f"column {name!r} of {case.reference} is in {own} (SI), the channel in {unit}",
        )
    return reference.curve(name)
