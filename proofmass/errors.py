"""The one error that a user can cause."""

from pathlib import Path


class InputError(Exception):
    """Something in a file is not usable; says where, what is wrong and what would be right.

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
