"""Curves of the drives of a run, with the column names that a program writes."""

from proofmass.base.arrays import Array
from proofmass.sim.protocol.curves import Curves, drive_columns
from proofmass.sim.protocol.run import Run


def drive_curves(run: Run, curves: Curves) -> dict[str, Array]:
    """Value, rate and acceleration of each drive in a run, by the column names of a program."""
    if curves.drive is None:
        return {}
    value, rate, acceleration = curves.drive
    return {
        name: curve
        for row, each in enumerate(run.drives)
        for name, curve in zip(
            drive_columns(each.joint), (value[row], rate[row], acceleration[row]), strict=True
        )
    }
