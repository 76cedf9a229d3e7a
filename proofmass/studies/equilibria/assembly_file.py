"""An assembly of rods as data: a TOML file of its own, without a model."""

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError

from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.assembly_newton import RodProblem
from proofmass.base.errors import InputError
from proofmass.base.files import read_text
from proofmass.base.strict import Strict, StrictNumber
from proofmass.run.sidecar import describe_invalid, key_of_error
from proofmass.studies.equilibria.rod_input import RodInput

PlanePoint = tuple[StrictNumber, StrictNumber]


class AssemblyRod(Strict):
    """``[rod.NAME]``: a rod, its clamp, and where it is attached to the platform.

    The tangent at `clamp` [m] has the angle `angle` [rad]; with `guide` [rad] the clamp lies
    `position` [m] further along that direction, and `turned` [rad] is the angle that a motor adds.
    The tip is `pinned` at the point `at` of the platform [m], or `clamped` there at `tip_angle`
    [rad], in the platform's frame.  `curvature` is natural [1/m], `couple` a dead moment per length
    [N], and `load` a dead load per length [N/m].
    """

    clamp: PlanePoint
    angle: StrictNumber = 0.0
    turned: StrictNumber = 0.0
    guide: StrictNumber | None = None
    position: StrictNumber = 0.0
    length: Annotated[StrictNumber, Field(gt=0)]
    stiffness: Annotated[StrictNumber, Field(gt=0)]
    end: Literal["pinned", "clamped"] = "pinned"
    at: PlanePoint = (0.0, 0.0)
    tip_angle: StrictNumber = 0.0
    curvature: StrictNumber = 0.0
    couple: StrictNumber = 0.0
    load: PlanePoint = (0.0, 0.0)


class AssemblyPlatform(Strict):
    """``[platform]``: the dead load on it, and what holds it.

    `force` [N] acts at its origin, `moment` is in N m.  Coordinates that are given in `held` do not
    move: x, y [m], phi [rad].
    """

    force: PlanePoint = (0.0, 0.0)
    moment: StrictNumber = 0.0
    held: dict[Literal["x", "y", "phi"], StrictNumber] = Field({})


class AssemblyTable(Strict):
    """A file: a title, the rods and the platform."""

    title: str = ""
    rod: Annotated[dict[str, AssemblyRod], Field(min_length=1)]
    platform: AssemblyPlatform = Field(default_factory=lambda: AssemblyPlatform(held={}))


def read_assembly(file: Path) -> RodInput:
    """Read an assembly from its own TOML file.

    Raises
    ------
    InputError
        A key is unknown or missing, a number is out of its domain, or the rods cannot meet.
    """
    try:
        given = tomllib.loads(read_text(file))
        table = AssemblyTable(**given)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(file, key_of_error(first, given), describe_invalid(first)) from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(file, "", f"not TOML: {error}") from None
    rods, platform = list(table.rod.values()), table.platform
    for name, rod in table.rod.items():
        if rod.end == "pinned" and rod.tip_angle:
            raise InputError(
                file, f"rod.{name}.tip_angle", 'of a clamped tip; give end = "clamped" as well'
            )
        if rod.guide is None and rod.position:
            raise InputError(file, f"rod.{name}.position", "is along a guide; give guide as well")
    along = [(r.position * np.exp(1j * r.guide) if r.guide is not None else 0j) for r in rods]
    try:
        built = assembly(
            [(r.clamp[0] + w.real, r.clamp[1] + w.imag) for r, w in zip(rods, along, strict=True)],
            length=[r.length for r in rods],
            stiffness=[r.stiffness for r in rods],
            arm=[r.at for r in rods],
            angle=[r.angle for r in rods],
            clamped=[r.end == "clamped" for r in rods],
            tip_angle=[r.tip_angle for r in rods],
            curvature=[r.curvature for r in rods],
            couple=[r.couple for r in rods],
            weight=[r.load for r in rods],
            held=[platform.held.get(name) for name in ("x", "y", "phi")],
        )
    except ValueError as error:
        raise InputError(file, "rod", str(error)) from None
    if built.dof == 2 and (platform.moment or "phi" in platform.held):
        raise InputError(
            file,
            "platform",
            "moment and held.phi are of a platform, but all rods are pinned at its origin, "
            'which is a pin; clamp a rod to it, end = "clamped", or give points, at',
        )
    problem = RodProblem(
        built,
        np.array([r.turned for r in rods]),
        np.array([*platform.force, platform.moment]),
    )
    return RodInput(file, table.title or file.stem, tuple(table.rod), problem)
