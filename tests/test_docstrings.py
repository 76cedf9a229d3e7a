"""Sections of docstrings name existing parameters and fields, and state the units of numbers.

ruff requires a docstring for everything that is public (D100 to D106).  Here griffe, which also
generates the pages of the documentation, reads the sections:

- ``Parameters`` names the parameters of its function, all of them, in their order.
- ``Attributes`` names all fields of its class, in their order, and nothing that the class lacks.
- A parameter or attribute that is annotated as a float or an array has its unit in brackets:
  ``[m]``, ``[rad/s^2]``, ``[1]`` for a number without a unit, ``[rad or m]`` if it depends on the
  joint, ``[m, rad]`` for several units in one array, ``[its unit]`` if another entry or the
  channel states it, ``[SI]`` if each entry of an array has its own unit.
- ``Returns`` of a function that returns a float or an array has a unit too.
"""

import gc
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import griffe
import pytest

from proofmass.base.units import si_unit

PACKAGE = Path(__file__).parent.parent / "proofmass"
NUMBER_TYPES = re.compile(r"\b(float|Array|ArrayLike)\b")
Annotation = str | griffe.Expr | None
OTHER_UNITS = ("its unit", "SI", "1", "px", "pt", "L", "EI/L", "GiB", "%")
"""Words in brackets that are accepted as units in addition to those that `si_unit` reads."""


def load_package() -> griffe.Module:
    """The package as griffe reads it, without an import."""
    gc.disable()  # to search the many objects of the package for garbage takes half of the time
    try:
        package = griffe.load("proofmass", search_paths=[PACKAGE.parent], allow_inspection=False)
    finally:
        gc.enable()
    assert isinstance(package, griffe.Module)
    return package


def documented_members(place: griffe.Object) -> Iterator[griffe.Function | griffe.Class]:
    """The functions, methods and classes below a module that have a docstring."""
    for member in place.members.values():
        if isinstance(member, griffe.Alias):
            continue
        if isinstance(member, griffe.Function | griffe.Class) and member.has_docstring:
            yield member
        if isinstance(member, griffe.Module | griffe.Class):
            yield from documented_members(member)


def is_unit(words: str) -> bool:
    """Whether words in brackets are units.

    >>> is_unit("rad/s or m/s"), is_unit("1, 1, m"), is_unit("0, pi")
    (True, True, False)
    """
    try:
        return all(
            word in OTHER_UNITS or bool(si_unit(word.removeprefix("per ")))
            for word in re.split(", | or |; ", words)
        )
    except ValueError:
        return False


def without_unit(text: str) -> bool:
    """Whether no brackets in a text contain a unit."""
    return not any(map(is_unit, re.findall(r"\[([^\]]+)\]", text)))


def faults_below(place: griffe.Object) -> list[str]:
    """The faults of all docstrings below a module: missing or unknown names, order, no units."""
    return [f"{one.path}: {fault}" for one in documented_members(place) for fault in faults_of(one)]


def faults_of(one: griffe.Function | griffe.Class) -> Iterator[str]:
    """The faults of one docstring."""
    assert one.docstring
    for section in one.docstring.parse("numpy", warnings=False):
        if isinstance(section, griffe.DocstringSectionParameters):
            there = {p.name: p.annotation for p in one.parameters if p.name not in ("self", "cls")}
            yield from section_faults(section, there, list(there))
        elif isinstance(section, griffe.DocstringSectionAttributes):
            own = re.findall(r"\bself\.(\w+)", one.source)
            members: dict[str, Annotation] = dict.fromkeys(own)
            members |= {name: annotation_of(member) for name, member in one.all_members.items()}
            yield from section_faults(section, members, annotated_fields(one))
        elif isinstance(section, griffe.DocstringSectionReturns) and is_number(one.annotation):
            text = " ".join(f"{e.name} {e.annotation} {e.description}" for e in section.value)
            if without_unit(text):
                yield "Returns has no unit"


def section_faults(
    section: griffe.DocstringSection, there: Mapping[str, Annotation], needed: list[str]
) -> Iterator[str]:
    """The faults of a section, compared with the existing names and those needed, in order."""
    named = [name.strip() for entry in section.value for name in entry.name.split(",")]
    named = [name.lstrip("*") for name in named]
    yield from (f"{name} is not there" for name in named if name not in there)
    yield from (f"{name} is not named" for name in needed if name not in named)
    if [n for n in named if n in needed] != [n for n in needed if n in named]:
        yield f"another order than {', '.join(needed)}"
    for entry in section.value:
        names = [name.strip().lstrip("*") for name in entry.name.split(",")]
        text = f"{entry.annotation} {entry.description}"
        if any(is_number(there.get(name)) for name in names) and without_unit(text):
            yield f"{', '.join(names)}: no unit"


def annotated_fields(one: griffe.Object) -> list[str]:
    """The annotated names in the body of a class: the fields of a dataclass or a named tuple."""
    return [
        name
        for name, member in one.members.items()
        if isinstance(member, griffe.Attribute)
        and member.annotation is not None
        and "property" not in member.labels
        and not name.startswith("_")
    ]


def annotation_of(member: griffe.Object | griffe.Alias) -> Annotation:
    """The annotation of a member of a class; None if it is not an attribute."""
    return member.annotation if isinstance(member, griffe.Attribute) else None


def is_number(annotated: Annotation) -> bool:
    """Whether an annotation is of a number or of numbers; that of a function is not."""
    return bool(NUMBER_TYPES.search(re.sub(r"Callable\[.*\]", "", str(annotated))))


def parse_module(text: str) -> griffe.Module:
    """A module as griffe reads it from a text."""
    return griffe.visit("text", Path("text.py"), text)


def faults_of_changed_fourbar(old: str, new: str) -> list[str]:
    """The faults of `proofmass.analytic.linkages.fourbar` after a change of its text."""
    text = (PACKAGE / "analytic/linkages/fourbar.py").read_text(encoding="utf-8")
    assert old in text
    return faults_below(parse_module(text.replace(old, new, 1)))


def test_docstrings_name_existing_parameters_and_units():
    assert faults_below(load_package()) == []


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("    gravity : [m/s^2]\n", "", "gravity is not named"),
        ("rocker_mass : masses", "rocker_masses : masses", "rocker_masses is not there"),
        ("angle, rate, acceleration :", "angle, acceleration, rate :", "another order than"),
        ("lengths between pins [m]", "lengths between pins", "ground: no unit"),
        (
            "masses of the bars [kg]",
            "masses of the bars [kq]",
            "coupler_mass: no unit",
        ),
    ],
)
def test_a_missing_line_and_a_missing_unit_are_found(old, new, fault):
    assert faults_of_changed_fourbar("gravity", "gravity") == []
    assert any(fault in one for one in faults_of_changed_fourbar(old, new))


CLASS_SOURCE = '''
class Spring:
    """A spring.

    Attributes
    ----------
    stiffness : float
        [N/m]
    name : str
    """

    stiffness: float
    name: str = ""

    def force(self, move: float) -> float:
        """Its force.

        Returns
        -------
        float
            The force [N].
        """
'''


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("    name : str\n", "", "text.Spring: name is not named"),
        ("    name : str\n", "    title : str\n", "text.Spring: title is not there"),
        ("[N/m]", "As measured.", "text.Spring: stiffness: no unit"),
        (" [N].", ".", "text.Spring.force: Returns has no unit"),
    ],
)
def test_faults_in_the_docstring_of_a_class_are_found(old, new, fault):
    assert faults_below(parse_module(CLASS_SOURCE)) == []
    assert fault in faults_below(parse_module(CLASS_SOURCE.replace(old, new)))
