"""What the search for equilibria begins with: an assembly of rods with names, from any file."""

from dataclasses import dataclass
from pathlib import Path

from proofmass.analytic.rods.assembly_newton import RodProblem


@dataclass(frozen=True)
class RodInput:
    """An assembly that a user gave.

    Attributes
    ----------
    file : Path
    title : str
    names : tuple of str
        Of the rods.
    problem : RodProblem
    """

    file: Path
    title: str
    names: tuple[str, ...]
    problem: RodProblem
