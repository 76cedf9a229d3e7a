"""One thing that a first screen finds in a model, with what to do about it."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Severity(IntEnum):
    """How much a finding matters to whoever runs the model."""

    NOTE = 1
    """Worth knowing; the model may be meant so."""
    WARNING = 2
    """Probably not meant, or close to a limit."""
    FAULT = 3
    """The model does not do what it describes."""


class FindingKind(StrEnum):
    """What a finding is about; the names are those of `--fail-on`."""

    NOT_FINITE = "not-finite"
    STABLE_STEP = "stable-step"
    OPEN_LOOP = "open-loop"
    NO_MOBILITY = "no-mobility"
    SINGULAR_START = "singular-start"
    CHANGE_POINT = "change-point"
    PIN = "pin"
    FREE_ENDS = "free-ends"
    SOFT_LOOP = "soft-loop"
    CREEP = "creep"
    SERVO = "servo"
    STOP = "stop"
    RANGE = "range"
    CONTACT = "contact"
    MASS = "mass"
    INERTIA = "inertia"
    GIMBAL = "gimbal"
    ACTUATOR = "actuator"
    SENSOR = "sensor"
    ENERGY = "energy"
    UNSTABLE_REST = "unstable-rest"
    NOTHING_MOVES = "nothing-moves"

    @property
    def sentence(self) -> str:
        """What such a finding says."""
        return SENTENCES[self]


SENTENCES = {
    FindingKind.NOT_FINITE: "positions or accelerations of the start are not finite",
    FindingKind.STABLE_STEP: "the time step is longer than the largest stable one, or close to it",
    FindingKind.OPEN_LOOP: "a loop is open at the start",
    FindingKind.NO_MOBILITY: "the loops leave no degree of freedom",
    FindingKind.SINGULAR_START: "the loops depend on each other just in the start pose",
    FindingKind.CHANGE_POINT: "bars come in line on the way",
    FindingKind.PIN: "a pin lies outside a body that it joins",
    FindingKind.FREE_ENDS: "free ends coincide and are not joined",
    FindingKind.SOFT_LOOP: "a loop gives way under the load of the start",
    FindingKind.CREEP: "a joint creeps that its friction would hold",
    FindingKind.SERVO: "a servo rests beside its target, or the start is not held",
    FindingKind.STOP: "the target of a servo lies beyond a stop",
    FindingKind.RANGE: "a joint starts outside its range",
    FindingKind.CONTACT: "geoms begin in contact",
    FindingKind.MASS: "masses are far apart",
    FindingKind.INERTIA: "no body can have such moments of inertia",
    FindingKind.GIMBAL: "three hinges are near gimbal lock",
    FindingKind.ACTUATOR: "an actuator moves nothing",
    FindingKind.SENSOR: "a sensor does not change",
    FindingKind.ENERGY: "the integrator changes the energy of a motion that keeps it",
    FindingKind.UNSTABLE_REST: "the start is an unstable equilibrium",
    FindingKind.NOTHING_MOVES: "nothing moves from the start",
}


@dataclass(frozen=True)
class NamedElement:
    """An element of a model, such as a joint or an actuator.

    Attributes
    ----------
    kind, name : str
        Its MJCF element, such as ``joint``, and its name; its number if it has no name.  The kind
        of an equality between joints is ``equality joint``, since a joint may have the same name.
    body : str
        The body that has it, of a joint, geom or site without a name; otherwise empty.

    Examples
    --------
    >>> print(NamedElement("joint", "0", "arm"))
    joint 0 of body arm
    """

    kind: str
    name: str
    body: str = ""

    @property
    def tag(self) -> str:
        """The tag of its MJCF element.

        >>> NamedElement("equality joint", "screw").tag, NamedElement("connect", "pin").tag
        ('joint', 'connect')
        """
        return self.kind.rpartition(" ")[2]

    def __str__(self) -> str:
        return f"{self.kind} {self.name}{f' of body {self.body}' if self.body else ''}"


@dataclass(frozen=True)
class ModelFinding:
    """One thing that is noticed.

    Attributes
    ----------
    kind : FindingKind
    severity : Severity
    text, remedy : str
        What was found, in a sentence without a full stop, with the number first that matters; and
        what to do, empty if nothing is to be done.
    element : NamedElement or None
        The element that it is about.
    value : float or None
        The number of the sentence [its unit].
    """

    kind: FindingKind
    severity: Severity
    text: str
    remedy: str = ""
    element: NamedElement | None = None
    value: float | None = None

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}" if self.remedy else self.text
