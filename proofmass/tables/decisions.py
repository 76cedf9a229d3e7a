"""What an import cannot find out by itself, and who decides it: an option, a person, a default."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.tables.foreign import Correction, ImportRule

SHOWN_ANSWERS = 4  # options that a message shows of many possible answers


@dataclass(frozen=True)
class ImportQuestion:
    """A question that the file leaves open.

    Attributes
    ----------
    about : str
        The line or column that it is about; empty for the whole file.
    text : str
        What is not known, and why.
    option : str
        The option that answers it, with ``{}`` for the answer, such as ``--decimal {}``.
    answers : tuple of str
        Possible answers, the default first; empty if the file allows any answer and has no default.
    taken : str
        What is done with an answer, with ``{}`` for it, such as ``{} is the decimal sign``.
    """

    about: str
    text: str
    option: str
    answers: tuple[str, ...]
    taken: str

    def as_option(self, answer: str) -> str:
        """The option that gives an answer, as a shell takes it.

        >>> ImportQuestion("", "", "--unit phi={}", (), "").as_option("deg")
        '--unit phi=deg'
        >>> ImportQuestion("", "", "--time {}", (), "").as_option("Elapsed time")
        "--time 'Elapsed time'"
        """
        word, _, rest = self.option.partition(" ")
        value = rest.format(answer)
        return f"{word} {value}" if value.replace("=", "").isalnum() else f"{word} {quoted(value)}"


def quoted(value: str) -> str:
    """A value as a shell takes it."""
    import shlex

    return shlex.quote(value)


@dataclass
class Decisions:
    """The options of an import, and who answers what they leave open.

    Attributes
    ----------
    decimal : str
        Decimal sign, ``.`` or ``,``; empty if it is to be found out.
    time : str
        Name of the column that is the x of the rows.
    units : mapping of str to str
        Units of columns, by name.
    fps : Decimal, optional
        Rows or frames per second.
    clockwise : tuple of str, optional
        Columns that count clockwise; None if names and lines of the file tell.
    sheet, encoding : str
        Sheet of a workbook, or variable of a file of MATLAB; encoding of a text.
    table : int
        Number of the table in the file, from 1 on; 0 if there should be one only.
    event : str
        Which row is kept of two at one time, ``before`` or ``after``.
    empty : str
        What becomes of rows with an empty cell, ``keep`` or ``drop``; empty if it depends.
    yes : bool
        Whether defaults are taken where nothing else decides.
    ask : callable, optional
        Asks a person; None in a script.
    answers : list of Correction
        What was decided so far, in sentences.
    """

    decimal: str = ""
    time: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    fps: Decimal | None = None
    clockwise: tuple[str, ...] | None = None
    sheet: str = ""
    encoding: str = ""
    table: int = 0
    event: str = ""
    empty: str = ""
    yes: bool = False
    ask: Callable[[ImportQuestion], str] | None = None
    answers: list[Correction] = field(default_factory=list)

    def decide(self, file: Path, question: ImportQuestion) -> str:
        """Answer a question.

        Raises
        ------
        InputError
            Nobody is there to be asked, and defaults are not taken: the message names the options.
        """
        if self.ask is not None:
            answer, who = self.ask(question), "as answered"
        elif self.yes and question.answers:
            answer, who = question.answers[0], "the default, by --yes"
        else:
            raise InputError(file, question.about, f"{question.text}; {ways(question)}")
        words = question.taken.format(answer)
        self.answers.append(Correction(ImportRule.ANSWER, f"{words}: {who}"))
        return answer


def ways(question: ImportQuestion) -> str:
    """The options that answer a question, in words."""
    if not question.answers:
        return f"give {question.option.format('..')}"
    options = [question.as_option(answer) for answer in question.answers[:SHOWN_ANSWERS]]
    more = ", .." if len(question.answers) > SHOWN_ANSWERS else ""
    return f"give {' or '.join(options)}{more}; --yes takes the first"
