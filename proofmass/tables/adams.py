"""Results of Adams and of SolidWorks Motion, ``.res``: XML with a map of columns and with steps."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.parsers import expat

from proofmass.base.errors import InputError
from proofmass.tables.cells import is_plain
from proofmass.tables.decisions import Decisions, ImportQuestion
from proofmass.tables.foreign import Correction, ForeignColumn, ForeignTable, ImportRule
from proofmass.tables.headers import unique
from proofmass.tables.unit_words import NO_UNIT, read_unit

STEPS_IN_TIME = ("dynamic", "kinematic", "static", "quasiStatic", "transient")
"""Kinds of steps that are rows of the motion; others are the model before it is assembled."""
START_STEPS = ("initialConditions",)
"""Kinds of steps that are the first row, if no other step is at its time."""


class ResultsReader:
    """Reads the elements of a file of results.

    Attributes
    ----------
    file : Path
    root : str
        Name of the first element.
    analyses : list of str
        Names of the analyses.
    components : dict of int to tuple of str
        Name and unit by the number of each column, for each analysis.
    steps : list of tuple
        Number of the analysis, kind, line and numbers of each step.
    """

    def __init__(self, file: Path) -> None:
        self.file, self.root = file, ""
        self.analyses: list[str] = []
        self.components: list[dict[int, tuple[str, str]]] = []
        self.steps: list[tuple[int, str, int, list[str]]] = []
        self.entity, self.text, self.kind, self.line = "", list[str](), "", 0
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.characters
        self.parser.StartDoctypeDeclHandler = self.refuse

    def read(self, data: bytes) -> None:
        """Read a file.

        Raises
        ------
        InputError
            It is no XML, or it declares entities.
        """
        try:
            self.parser.Parse(data, True)
        except expat.ExpatError as error:
            raise InputError(
                self.file, f"line {error.lineno}", f"no XML: {expat.ErrorString(error.code)}"
            ) from None

    def refuse(self, *_: object) -> None:
        """Refuse a file that declares entities, which may grow without limit."""
        raise InputError(self.file, "", "a DOCTYPE, which no program writes into results")

    def start(self, tag: str, found: Mapping[str, str]) -> None:
        """Take what an element says at its beginning."""
        self.root = self.root or tag
        if tag == "Analysis":
            self.analyses.append(found.get("name", str(len(self.analyses) + 1)))
            self.components.append({})
        elif tag == "Entity":
            self.entity = found.get("name", "")
        elif tag == "Component" and self.components and found.get("id", "").isdigit():
            name = found.get("name", "")
            full = name if self.entity.lower() == name.lower() else f"{self.entity}.{name}"
            self.components[-1][int(found["id"])] = (full, found.get("unitsValue", ""))
        elif tag == "Step":
            self.kind, self.line, self.text = (
                found.get("type", ""),
                self.parser.CurrentLineNumber,
                [],
            )

    def end(self, tag: str) -> None:
        """Take the numbers of a step at its end."""
        if tag == "Step" and self.analyses:
            numbers = "".join(self.text).split()
            self.steps.append((len(self.analyses) - 1, self.kind, self.line, numbers))
        self.text = []

    def characters(self, text: str) -> None:
        """Take a piece of the text of an element."""
        self.text.append(text)


def read_results(file: Path, data: bytes, decisions: Decisions) -> ForeignTable:
    """Read the results of an analysis.

    Raises
    ------
    InputError
        It is another kind of XML; there are no steps, or steps of other lengths than the map.
    """
    reader = ResultsReader(file)
    reader.read(data)
    if reader.root != "Results":
        raise InputError(
            file, "", f"XML with the root <{reader.root}>; results of Adams have <Results>"
        )
    which = choose_analysis(reader, decisions)
    columns = sorted(reader.components[which].items()) if reader.components else []
    own = [step[1:] for step in reader.steps if step[0] == which]
    steps = [step for step in own if step[0] in STEPS_IN_TIME]
    first = [step for step in own if step[0] in START_STEPS]
    if first and steps and first[-1][2][:1] != steps[0][2][:1] and steps[0][0] != "static":
        steps.insert(0, first[-1])
    if not columns or not steps:
        kinds = ", ".join(sorted({step[0] for step in own})) or "none"
        raise InputError(file, "", f"no steps of a simulation in time; steps in the file: {kinds}")
    check_steps(file, steps, len(columns))
    told = [
        Correction(ImportRule.CONTAINER, f"results of Adams, analysis {reader.analyses[which]}")
    ]
    if len(own) > len(steps):
        kinds = " and ".join(sorted({s[0] for s in own if s not in steps}))
        told.append(Correction(ImportRule.PREAMBLE, f"steps of kind {kinds} are left out"))
    names = unique([name for _, (name, _) in columns])
    found = tuple(
        ForeignColumn(
            name,
            tuple(step[2][k] for step in steps),
            "1" if unit.lower() in NO_UNIT else read_unit(unit) or "",
            unit,
        )
        for k, (name, (_, (_, unit))) in enumerate(zip(names, columns, strict=True))
    )
    return ForeignTable(
        file, found, tuple(step[1] for step in steps), decimal=".", corrections=tuple(told)
    )


def choose_analysis(reader: ResultsReader, decisions: Decisions) -> int:
    """The number of the analysis that is read.

    Raises
    ------
    InputError
        There are several, and none is asked for.
    """
    names = reader.analyses
    if not names:
        raise InputError(reader.file, "", "no <Analysis> in the results")
    name = decisions.sheet
    if not name and len(names) > 1:
        question = ImportQuestion(
            "", f"{len(names)} analyses in the file", "--sheet {}", tuple(names), "{} is read"
        )
        name = decisions.decide(reader.file, question)
    if name and name not in names:
        raise InputError(reader.file, "--sheet", f"no analysis {name!r}; {', '.join(names)}")
    return names.index(name) if name else 0


def check_steps(file: Path, steps: list[Any], width: int) -> None:
    """Raise InputError unless all steps have as many numbers as the map has columns."""
    for _, line, numbers in steps:
        if len(numbers) != width:
            raise InputError(
                file, f"line {line}", f"a step of {len(numbers)} numbers, the map has {width}"
            )
        if wrong := next((one for one in numbers if not is_plain(one)), None):
            raise InputError(file, f"line {line}", f"{wrong!r} is no number")
