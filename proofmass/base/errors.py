"""The error of bad input, and suggestions of what would have been right."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path

BAD_INPUT, INTERRUPTED = 2, 130  # exit codes of commands; the second is a shell's own for Ctrl-C


class InputError(Exception):
    """A file of the user is wrong; the message says where, what is wrong and what would be right.

    Parameters
    ----------
    file : Path
        The file at fault.
    key : str
        Key or element inside it; empty for the file as a whole.
    wrong : str
        What is wrong, and what would have been right.
    """

    def __init__(self, file: Path, key: str, wrong: str):
        super().__init__(file, key, wrong)
        self.file, self.key, self.wrong = Path(file), key, wrong

    def __str__(self) -> str:
        return f"{self.file}: {self.key + ': ' if self.key else ''}{self.wrong}"


def model_error(file: Path, error: Exception) -> InputError:
    """Make bad input of an engine's error, whose text may begin with the file's name.

    >>> str(model_error(Path("models/a.xml"), ValueError("a.xml: no joint 'b'")))
    "models/a.xml: no joint 'b'"
    """
    return InputError(file, "", str(error).removeprefix(f"{file.name}: "))


RENAMED = {
    "duration": "dynamics",
    "rest": "equilibrium",
    "law": "profile",
    "of_range": "relative_to_range",
    "beside": "compare_with",
    "wall": "error_floor",
    "prolongation": "rigid_extension",
    "marks": "events",
    **{f"winding{k}{of}": f"deflection{k}{of}" for k in range(1, 5) for of in ("", "_rate")},
}
"""Present names of keys of sidecars, parameters and quantities of references by former names."""


def suggest_names(
    name: str,
    known_names: Iterable[str],
    known: str = "there are",
    renamed: Mapping[str, str] = RENAMED,
) -> str:
    """Say what would have been right instead of a word: the nearest name, then all names.

    >>> suggest_names("mujco", ["mujoco", "pymunk"])
    "did you mean 'mujoco'? there are: mujoco, pymunk"
    >>> suggest_names("rest", ["sweep", "equilibrium"])
    "'rest' is called 'equilibrium' now; there are: sweep, equilibrium"
    """
    known_names = list(dict.fromkeys(known_names))
    if (now := renamed.get(name)) in known_names:
        return f"{name!r} is called {now!r} now; {known}: {', '.join(known_names)}"
    near = get_close_matches(name, known_names, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{hint}{known}: {', '.join(known_names) or 'none'}"
