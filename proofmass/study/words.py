"""Rows and walls in words."""

from proofmass.study.row import Row
from proofmass.study.verdict import Verdict
from proofmass.wording import number, spoken


def told(row: Row) -> str:
    """A setting in words.

    >>> told(Row("", "", "", "pymunk", "pymunk at 1 ms, iterations", "iterations", 30))
    'pymunk at 1 ms, iterations 30'
    """
    place = turned(row)
    return f"{row.line.removesuffix(row.axis)}{place}" if row.line.endswith(row.axis) else (
        f"{row.line}, {place}")


def turned(row: Row) -> str:
    """What was turned along its line, and how far.

    >>> turned(Row("", "", "", "mujoco", "MuJoCo RK4", "timestep", 2.5e-3))
    'timestep 2.5 ms'
    """
    place = f"{number(1e3 * row.value)} ms" if row.axis == "timestep" else number(row.value)
    return f"{row.axis} {place}"


def brief(row: Row) -> str:
    """The same without the engine."""
    return told(row).removeprefix(spoken(row.engine)).lstrip(", ")


def off(row: Row, of: str) -> str:
    """How large an error is."""
    return f"{number(row.errors[of], 2)} off"


def cost(row: Row) -> str:
    """What a setting costs, and its place on its line."""
    return f"{number(row.seconds, 2)} s at {turned(row)}"


def walled(verdict: Verdict) -> str:
    """A wall in words."""
    return f"the wall is {number(verdict.wall, 2)}, {verdict.cause}"
