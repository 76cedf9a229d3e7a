"""The files of `models/` by their names, which are unique: a test need not know their folders."""

from pathlib import Path

MODELS = Path(__file__).parent.parent / "models"


def shipped(name: str) -> Path:
    """The file of that name below `models/`."""
    file, = MODELS.rglob(name)
    return file


def models_like(pattern: str = "*.toml") -> list[Path]:
    """The files below `models/` whose names match, sorted by name."""
    return sorted(MODELS.rglob(pattern), key=lambda file: file.name)
