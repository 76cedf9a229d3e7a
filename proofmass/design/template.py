"""Write a balancer as a case: its MJCF and sidecar, from its flat parameters."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jinja2 import Environment

from proofmass.analytic.balancer import Balancer, solve
from proofmass.analytic.balancer.measures import chain_of
from proofmass.analytic.balancer.model import preload_spring
from proofmass.base.files import write_output
from proofmass.base.templates import template_environment
from proofmass.sim.engines import default_engines

GRAVITY = 9.81  # [m/s^2] to compute the mass at the tip from its weight; statics needs no mass
SEGMENT_LINE_MASS = 1e-3
"""Mass of the last segment over the pendulum's length [kg/m]; it has no effect in statics."""
SINGULAR_START = 0.017453292519943295
"""Start of the drive if the rest pose is singular [rad]: one degree."""
POSE_ROUNDING = 1e-14
"""Rounding of a pose with a pendulum of 1 m [m]; forces of nearly straight chains magnify it."""
MISSING_STOP = 10.0
"""Second stop of a joint with only one, beyond all deflections [rad]: MJCF needs two."""
FORCE_TOLERANCE = 1e-12  # of forces, as a share of the target moment over 1 m
LENGTH_SLOPE_STEP = (
    1e-7  # relative change of a length for a slope, which needs no more than one digit
)
SOLVERS = default_engines()


@dataclass(frozen=True)
class Segment:
    """A segment in the rest posture, and the joint that connects it to the segment before.

    Attributes
    ----------
    number : int
        Number of the segment, from 1.
    place : tuple of float
        Position of its joint on the segment before [m].
    angle, length : float
        Angle clockwise from the upright [rad], and length [m].
    mass : float
        Mass [kg].
    carries : bool
        Whether another segment is attached to it.
    spring : tuple of float
        Coefficients k, A of the slack spring [N m/rad, N m/rad^2], without zeros at the end.
    wound, load : float
        Winding of the spring at rest [rad]; constant moment of a spring without stiffness [N m].
    stops : tuple of float
        Lower and upper joint limit [rad]; empty without limits.
    friction : float
        Dry friction of the joint [N m].
    """

    number: int
    place: tuple[float, float]
    angle: float
    length: float
    mass: float
    carries: bool
    spring: tuple[float, ...]
    wound: float
    load: float
    stops: tuple[float, ...]
    friction: float

    @property
    def along(self) -> tuple[float, float]:
        """Unit vector along the segment [1]."""
        return float(np.sin(self.angle)), float(np.cos(self.angle))

    @property
    def across(self) -> tuple[float, float]:
        """Unit vector across the segment, a quarter turn counter-clockwise from `along` [1]."""
        return -self.along[1], self.along[0]

    @property
    def end(self) -> tuple[float, float]:
        """Far end of the segment, from its joint [m]."""
        return self.length * self.along[0], self.length * self.along[1]

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of mass from the joint [m], which balances all segments after this one."""
        return (-self.end[0], -self.end[1]) if self.carries else (0.0, 0.0)

    @property
    def inertia(self) -> float:
        """Moment of inertia about each axis through the centre of mass [kg m^2]."""
        return float(f"{self.mass * self.length**2:.3g}")

    @property
    def shift(self) -> float:
        """Shift [rad] from `angle` to the angle of an x axis along the segment.

        The latter is measured clockwise from the world's x axis, and lies within half a turn in the
        start pose.
        """
        return -np.pi / 2 - 2 * np.pi * round((self.angle - np.pi / 2) / (2 * np.pi))


def write_case(
    folder: Path | str,
    name: str,
    *,
    title: str,
    source: str,
    parameters: Mapping[str, float],
    target: str | None = None,
    target_moment: float = 1.0,
    solvers: Sequence[str] = SOLVERS,
    beside: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> Path:
    """Write ``NAME.xml`` and ``NAME.toml`` of a balancer.

    ::

        joint values = deflections     all bodies have the rotation zero in the rest posture
        key "start"  = zeros           the start pose is closed to rounding

    The weights of the segments have no effect: the centre of mass of each segment balances those
    after it, so that the chain is statically balanced and only the weight at the tip acts.

    Parameters
    ----------
    folder : path
        Folder of the files, created if it does not exist; files of the same name are replaced.
    name : str
        Name of both files.
    title, source : str
        Title of the case, and source of its numbers.
    parameters : mapping
        Parameters of `proofmass.analytic.balancer.solve` [SI].
    target, target_moment : str, float
        Wanted moment-angle characteristic, drawn together with the moment, and its scale [N m].
    solvers : sequence of str
        Solvers of the sweep.
    beside : mapping
        Parameters [SI] of other balancers by name, which are drawn for comparison.

    Returns
    -------
    Path
        The sidecar.

    Raises
    ------
    ValueError
        A parameter is unknown, missing or out of its domain, or the chain cannot reach the tip.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> chain = {"length1": 0.3394, "length2": 0.4573, "length3": 0.4752, "rest_angle": 0.6641,
    ...          "stiffness1": 1.2701, "stiffness2": 0.8473, "stiffness3": 4.1078}
    >>> with TemporaryDirectory() as folder:
    ...     write_case(folder, "mine", title="Mine", source="ours", parameters=chain).name
    'mine.toml'
    """
    design = chain_of(dict(parameters))
    friction = any(value for key, value in parameters.items() if "friction" in key)
    drawn = ["target"]
    drawn += ["expected_moment"] * ("expected" in parameters)
    drawn += ["frictionless_moment"] * friction
    drawn += ["expected_measurement"] * ("expected" in parameters)
    chain = make_segments(design, parameters)
    first = SINGULAR_START if (design.loose * design.preload[:, -1]).any() else 0.0
    extends = bool(design.extension1.any() or design.extension2.any())
    weighs = bool(design.weight.any())
    rounding = 0.0 if extends or weighs else POSE_ROUNDING * force_slope(parameters, first)
    words = {
        "name": name,
        "title": title,
        "source": source,
        "segments": chain,
        "parameters": dict(parameters),
        "target": target,
        "target_moment": target_moment,
        "friction": friction,
        "dashed": drawn if len(drawn) > 1 else "target",
        "solvers": list(solvers),
        "compare_with": beside,
        "pendulum": float(design.pendulum[0]),
        "mass": float(design.weight[0]) / GRAVITY,
        "gravity": GRAVITY,
        "extends": extends,
        "energy": not any(s.load for s in chain),
        "first": first,
        "steep_forces": float(f"{rounding:.1e}") * (rounding > FORCE_TOLERANCE * target_moment),
    }
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for ending in ("xml", "toml"):
        text = design_templates().get_template(f"balancer.{ending}.jinja").render(words)
        write_output(folder / f"{name}.{ending}", text)
    return folder / f"{name}.toml"


def force_slope(parameters: Mapping[str, float], first: float) -> float:
    """The largest change of a node's force with the length of the first segment [N/m].

    `parameters` are those of `proofmass.analytic.balancer.solve`; the pendulum turns from `first`
    to a right angle.  The slope is 0 if the path ends before, as the reference will say.
    """
    angle = np.linspace(first, np.pi / 2, 91)
    given: dict[str, Any] = dict(parameters)
    change = LENGTH_SLOPE_STEP * given["length1"]
    try:
        one = solve(angle, **given)
        other = solve(angle, **{**given, "length1": given["length1"] + change})
    except ValueError:
        return 0.0
    forces = [name for name in one if "_force_" in name]
    return max(float(np.abs(other[name] - one[name]).max()) for name in forces) / change


def make_segments(design: Balancer, parameters: Mapping[str, float]) -> list[Segment]:
    """The segments of a single design, from O outwards.

    Each segment has the mass of all segments that it carries together, so that its centre of mass
    is as far behind its joint as the next joint is in front of it.
    """
    found: list[Segment] = []
    for i in range(design.segments):
        preload, k, a = (
            float(design.preload[0, i]),
            *(float(parameters.get(f"{name}{i + 1}", 0.0)) for name in ("stiffness", "quadratic")),
        )
        wound = float(preload_spring(np.array(k), np.array(a), np.array(preload))[1])
        has_constant_moment = np.isinf(wound)
        low, high = float(design.low[0, i]), float(design.high[0, i])
        found.append(
            Segment(
                i + 1,
                found[-1].end if found else (0.0, 0.0),
                float(design.rest[0, i]),
                float(design.length[0, i]),
                SEGMENT_LINE_MASS
                * float(design.pendulum[0])
                * 2.0 ** max(design.segments - 2 - i, 0),
                i < design.segments - 1,
                (k, a) if a else (k,) if k else (),
                0.0 if has_constant_moment else wound,
                preload if has_constant_moment else 0.0,
                ()
                if np.isinf([low, high]).all()
                else (max(low, -MISSING_STOP), min(high, MISSING_STOP)),
                float(parameters.get(f"friction{i + 1}", 0.0)),
            )
        )
    return found


def format_numbers(numbers: Iterable[float]) -> str:
    """Numbers as MJCF has them: with all their digits, separated by blanks."""
    return " ".join(repr(float(x) + 0.0) for x in numbers)  # no -0.0


@cache
def design_templates() -> Environment:
    """The templates of designs, with their filters."""
    found = template_environment("proofmass.design")
    found.filters["digits"] = format_numbers
    found.filters["toml"] = partial(json.dumps, ensure_ascii=False)
    return found
