"""What the drives of a run did, as a program writes it."""

from proofmass.analytic.numerics import Array
from proofmass.sim.protocol import Curves, Run, drive_columns


def driven(run: Run, curves: Curves) -> dict[str, Array]:
    """What the drives of a run did, by the columns of a program."""
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
