"""Clock springs: flat strips wound to spirals, of a length and a stress that a maker accepts.

::

      b  out of the plane          k = E b t^3/(12 L)
     +--+
     |  | t  in the plane          stress = 6 M/(b t^2),  at the faces of the strip
     +--+
      L  along the strip           both for a strip that carries one moment all along, its ends held

A strip of the file `read_strips` is a section that a maker has, with the shortest and the longest
piece of it, its modulus and the stress that it stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from proofmass.errors import InputError
from proofmass.recorded import named_rows

HEADER = (
    "strip",
    "width [mm]",
    "thickness [mm]",
    "shortest [mm]",
    "longest [mm]",
    "modulus [GPa]",
    "stress [MPa]",
)
SCALES = (1e-3, 1e-3, 1e-3, 1e-3, 1e9, 1e6)  # of the columns after the name, to SI
PARALLEL = (1, 2)  # springs at a joint; the thesis's prototype has two, wound against each other


@dataclass(frozen=True)
class SpringStrip:
    """A strip that a maker has.

    Attributes
    ----------
    name : str
    width, thickness : float
        b out of the plane and t in the plane [m].
    shortest, longest : float
        Between which a piece of it is cut and wound [m].
    modulus, stress : float
        E and the largest stress in bending [Pa].
    """

    name: str
    width: float
    thickness: float
    shortest: float
    longest: float
    modulus: float
    stress: float


@dataclass(frozen=True)
class ClockSpring:
    """What is to be made for a joint.

    Attributes
    ----------
    strip : Strip
    count : int
        How many equal ones in parallel.
    length : float
        Of each strip [m].
    stress : float
        Of each at the largest moment of the joint [Pa].
    """

    strip: SpringStrip
    count: int
    length: float
    stress: float

    @property
    def volume(self) -> float:
        """Of all strips of the joint [m^3]."""
        return self.count * self.length * self.strip.width * self.strip.thickness

    @property
    def faults(self) -> list[str]:
        """What its maker would not accept; empty if it can be made."""
        s, found = self.strip, []
        if not s.shortest <= self.length <= s.longest:
            found.append(
                f"needs {1e3 * self.length:.4g} mm of {1e3 * s.shortest:g} to {1e3 * s.longest:g}"
            )
        if self.stress > s.stress:
            found.append(f"is stressed by {1e-6 * self.stress:.4g} MPa of {1e-6 * s.stress:g}")
        return found


def stiffness(strip: SpringStrip, length: float) -> float:
    """k = E b t^3/(12 L) [N m/rad] of a strip of a length [m].

    Source: van Nes 2022, eq. I.1, line 1562; the bending of a straight strip, whose windings do
    not touch.  The springs of its table J.1 are stiffer by a fifth to two fifths than the eq. gives
    with the length of their windings, 2 pi n (r_in + r_out)/2: not all of it bends.

    >>> steel = SpringStrip("907", 6e-3, 0.6e-3, 0.1, 2.0, 206e9, 1.4e9)
    >>> round(stiffness(steel, 0.597409), 6)
    0.037241
    """
    return strip.modulus * strip.width * strip.thickness**3 / (12.0 * length)


def clock_spring(k: float, moment: float, strip: SpringStrip, count: int = 1) -> ClockSpring:
    """The spring of a strip that has a stiffness, and its stress; it may not be to be made.

    Parameters
    ----------
    k : float
        Stiffness of the joint [N m/rad], positive.
    moment : float
        Largest moment of the joint's springs [N m].
    strip : Strip
    count : int
        Equal springs in parallel.
    """
    length = stiffness(strip, 1.0) * count / k
    return ClockSpring(
        strip, count, length, 6.0 * abs(moment) / count / (strip.width * strip.thickness**2)
    )


def choose(k: float, moment: float, strips: Sequence[SpringStrip]) -> ClockSpring:
    """The spring of least volume that a maker accepts, one strip or two in parallel.

    Raises
    ------
    ValueError
        None can be made: what is wrong with that of each strip.
    """
    tried = [clock_spring(k, moment, strip, n) for strip, n in product(strips, PARALLEL)]
    made = [spring for spring in tried if not spring.faults]
    if not made:
        why = "; ".join(f"{s.count} x {s.strip.name} {' and '.join(s.faults)}" for s in tried)
        raise ValueError(f"no clock spring for {k:.4g} N m/rad and {abs(moment):.4g} N m: {why}")
    return min(made, key=lambda spring: (spring.volume, spring.count))


def read_strips(file: Path) -> list[SpringStrip]:
    """The strips that a maker has, a CSV file with a row a strip.

    Raises
    ------
    InputError
        No such file, another header, a value that is not positive, a name twice, a longest piece
        that is shorter than the shortest.
    """
    found = []
    for name, cells in named_rows(file, HEADER, "strip").items():
        strip = SpringStrip(
            name, *(cell * scale for cell, scale in zip(cells, SCALES, strict=True))
        )
        if not strip.shortest < strip.longest:
            raise InputError(file, name, "the longest piece must exceed the shortest")
        found.append(strip)
    return found
