"""Cases whose truth is read from their own MJCF, so that the MJCF may be changed."""

from proofmass.case import Case

READS = "planar"
"""The reference that knows the model's own sensors, whatever the model."""


def reread(case: Case) -> Case:
    """The case with its channels held to what the planar reference reads from the model.

    Channels that must equal a number still must.  Drives must not take their law from the
    reference that is left behind: see `movable`.
    """
    if case.reference == READS:
        return case
    channels = {name: channel if isinstance(channel.equals, float) else channel.model_copy(
        update={"equals": name, "scale": 1.0, "shift": 0.0})
        for name, channel in case.channels.items()}
    return case.model_copy(update={"reference": READS, "parameters": {}, "channels": channels})


def movable(case: Case) -> bool:
    """Whether nothing of its motion is the reference's own: no law, no recorded curve."""
    return not case.reference.endswith(".csv") and all(d.to is not None for d in case.drive)
