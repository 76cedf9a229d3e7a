"""What runs in the interpreter of an engine; a script imports it as ``proofmass_host``.

It needs Python 3.9 and NumPy, and imports nothing of proofmass.  A script of an engine has::

    from proofmass_host import Mechanism, Refused, States, record

    VERSIONS = {"engine": "1.2.3"}          # what computes, by the names of the packages

    def simulate(mechanism: Mechanism, settings: dict) -> States: ...
"""

from .mechanism import (
    Drive,
    Gear,
    Joint,
    Link,
    Load,
    Mechanism,
    Mjcf,
    PointLoop,
    PointSpring,
    States,
)
from .record import (
    Refused,
    Stopwatch,
    frame_of_axis,
    in_space,
    matrix_of,
    record,
    turn_about,
)

__all__ = [
    "Drive",
    "Gear",
    "Joint",
    "Link",
    "Load",
    "Mechanism",
    "Mjcf",
    "PointLoop",
    "PointSpring",
    "Refused",
    "States",
    "Stopwatch",
    "frame_of_axis",
    "in_space",
    "matrix_of",
    "record",
    "turn_about",
]
