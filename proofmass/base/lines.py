"""The lines of keys in sidecars and of elements and attributes in MJCF files."""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from proofmass.base.errors import InputError
from proofmass.base.files import read_text

TABLE_PATTERN = re.compile(r"^\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(?:#.*)?$")
KEY_PATTERN = re.compile(r"^\s*((?:[\w-]+|\"[^\"]*\")(?:\s*\.\s*(?:[\w-]+|\"[^\"]*\"))*)\s*=")
COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)


class LineIndex:
    """The lines of keys and names in files; each file is read once."""

    def __init__(self) -> None:
        self.texts: dict[Path, list[str]] = {}

    def text(self, file: Path) -> list[str]:
        """The lines of a file; empty if it cannot be read."""
        if file not in self.texts:
            try:
                self.texts[file] = read_text(file).splitlines()
            except InputError:
                self.texts[file] = []
        return self.texts[file]

    def line_of_key(self, file: Path, wanted: list[str], exactly: bool = False) -> int | None:
        """The line of a key in a sidecar, or of the nearest table that contains it.

        With `exactly` only the line of the key itself is given.
        """
        best, deepest = None, 0
        table, counts = list[str](), Counter[str]()
        for number, line in enumerate(self.text(file), 1):
            if head := TABLE_PATTERN.match(line):
                here = table = key_parts(head[2])
                if head[1] == "[[":  # a list of tables, whose numbers are parts of the key
                    here = table = [*table, str(counts[head[2]])]
                    counts[head[2]] += 1
            elif given := KEY_PATTERN.match(line):
                here = [*table, *key_parts(given[1])]
            else:
                continue
            if here == wanted[: len(here)] and len(here) > deepest:
                best, deepest = number, len(here)
        return best if deepest == len(wanted) or not exactly else None

    def line_of_name(self, file: Path, channel: str) -> int | None:
        """The line of a model that names the sensor of a channel, with or without its axis."""
        names = (channel, channel.rpartition(".")[0])
        for name in filter(None, names):
            pattern = re.compile(rf"\bname\s*=\s*([\"']){re.escape(name)}\1")
            for number, line in enumerate(self.text(file), 1):
                if pattern.search(line):
                    return number
        return None

    def line_of_element(self, file: Path, tag: str, name: str) -> int | None:
        """The line of the element of a model with a name, of a tag if there is one of it."""
        text = "\n".join(self.text(file))
        named = rf"\bname\s*=\s*([\"']){re.escape(name)}\1"
        for pattern in (rf"<{tag}\b[^>]*?{named}", rf"<\w+\b[^>]*?{named}"):
            if found := re.search(pattern, text):
                return text.count("\n", 0, found.start()) + 1
        return None


def key_parts(key: str) -> list[str]:
    """The parts of a dotted key; a quoted text is one part.

    >>> key_parts('settings."mujoco:fine".timestep'), key_parts("tolerance.0.why")
    (['settings', 'mujoco:fine', 'timestep'], ['tolerance', '0', 'why'])
    """
    return [quoted or bare for quoted, bare in re.findall(r'"([^"]*)"|([\w:-]+)', key)]


@dataclass(frozen=True)
class WrittenValue:
    """A value in a file, as it is written there.

    Attributes
    ----------
    line : int
        Number of its line, from 1.
    text : str
        The whole line.
    literal : str
        The value itself; empty if the line does not have it, because it is a default.
    at : int
        Place of the literal in the line, from 0.
    """

    line: int
    text: str
    literal: str = ""
    at: int = 0

    @property
    def line_text(self) -> str:
        """The line without its indent; empty if the line has no value."""
        return self.text.strip() if self.literal else ""

    def instead(self, value: str) -> str:
        """The line with another value, without its indent; empty if the line has no value.

        >>> WrittenValue(3, "rocker = 2.525 # m", "2.525", 9).instead("2.5")
        'rocker = 2.5 # m'
        """
        if not self.literal:
            return ""
        return f"{self.text[: self.at]}{value}{self.text[self.at + len(self.literal) :]}".strip()


def key_value(index: LineIndex, file: Path, wanted: list[str]) -> WrittenValue | None:
    """The value of a key in a sidecar, also of a key in an inline table; None if it is not there.

    Of a key that is not written, but whose table is, the line of the table is given.
    """
    if (line := index.line_of_key(file, wanted)) is None:
        return None
    text = index.text(file)[line - 1]
    key = re.escape(wanted[-1])
    found = re.search(rf"(?:^|[\s{{,.])\"?{key}\"?\s*=\s*(\"[^\"]*\"|'[^']*'|[^\s,}}#\[{{]+)", text)
    if found is None:
        return WrittenValue(line, text)
    return WrittenValue(line, text, found[1], found.start(1))


def attribute_value(file: Path, element: int, attribute: str, part: int) -> WrittenValue | None:
    """A component of an attribute of an element of an MJCF file; None for no such element.

    Elements are numbered in the order of the file, comments not counted.  Of an attribute that is
    not written, the line of the element is given.
    """
    content = file.read_bytes()
    starts = element_starts(content)
    if not element < len(starts):
        return None
    begin = starts[element]
    text = content.decode("utf-8", errors="surrogateescape")
    begin = len(content[:begin].decode("utf-8", errors="surrogateescape"))
    tag = re.compile(r"<(?:\"[^\"]*\"|'[^']*'|[^>\"'])*>").match(text, begin)
    place, literal = begin, ""
    pattern = re.compile(rf"\s{re.escape(attribute)}\s*=\s*([\"'])(.*?)\1", re.DOTALL)
    if tag and (found := pattern.search(tag[0])):
        words = list(re.finditer(r"\S+", found[2]))
        place = begin + found.start(2)
        if part < len(words):
            literal, place = words[part][0], place + words[part].start()
    return written_at(text, place, literal)


def written_at(text: str, place: int, literal: str) -> WrittenValue:
    """A value at a place of a text."""
    begin = text.rfind("\n", 0, place) + 1
    end = text.find("\n", place)
    line = text[begin : end if end >= 0 else len(text)].rstrip("\r")
    return WrittenValue(text.count("\n", 0, place) + 1, line, literal, place - begin)


def element_starts(content: bytes) -> list[int]:
    """The places in an XML file at which its elements begin, in bytes; empty if it is malformed.

    >>> element_starts(b"<a>\\n<!-- -- --><b/></a>")
    [0, 15]
    """
    blank = COMMENT.sub(lambda found: b" " * len(found[0]), content)
    starts = list[int]()
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda *_: starts.append(parser.CurrentByteIndex)
    try:
        parser.Parse(blank, True)
    except expat.ExpatError:
        return []
    return starts
