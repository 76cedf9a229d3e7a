r"""One equilibrium of any planar assembly of up to six rods, near a first guess.

::

              _ rod 2
      O2 |/_'    `.          O_i: clamps, tangents at angle_i; tips pinned or clamped at the points
                   B2__      at_i of a platform that is free, or held in x, y or phi
       O1 |/______B1 P |
             rod 1     |     u0_i natural curvatures, l_i couples and w_i dead loads per length

The equilibrium is that to which Newton's method for `assembly_newton` leads from a guess; its
curves do not depend on the guess, which only chooses among equilibria.  ``proofmass equilibria
--cases`` writes guesses beside the numbers of an assembly.
"""

from typing import Annotated, Any, ClassVar

import numpy as np

from proofmass.analytic.protocol import (
    Angle,
    Ask,
    BendingStiffness,
    Domain,
    Force,
    GuessedForce,
    GuessedMoment,
    GuessedPosition,
    InputMotion,
    Length,
    Moment,
    OneOf,
    Parameter,
    Position,
    Quantity,
    Reference,
    Value,
)
from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.assembly_newton import (
    OWN,
    RodGuess,
    RodProblem,
    newton_step,
    solve_guesses,
)
from proofmass.analytic.rods.assembly_search import (
    CLOSED_RESIDUAL,
    FINE_TOLERANCE,
    RodEquilibria,
    SearchLimits,
    describe_equilibria,
    rod_path,
    states_at_nodes,
    tip_places,
)
from proofmass.analytic.rods.elastica import arc_lengths
from proofmass.analytic.rods.tip_wrench import FINE_STEPS
from proofmass.base.arrays import Array

MAX_NUMBERED_RODS = 6
"""Rods that have parameters: a platform on six is the largest mechanism of the sources."""
ALL_EQUILIBRIA = SearchLimits(inflections=1000, alpha=1000.0, turns=1000.0)
"""Limits that exclude no equilibrium."""
GuessedAngle = Annotated[float, Quantity("rad", moves=())]
GAUSS_NODES = 24
"""Nodes of the integral of the energy along a rod: exact to 1e-10 up to alpha = 12."""
HeldPosition = Annotated[float, Quantity("m", Domain.EXTENDED)]
HeldAngle = Annotated[float, Quantity("rad", Domain.EXTENDED)]
ROD_FIELDS: dict[str, tuple[Any, Any]] = {
    "clamp_x": (Position, 0.0),
    "clamp_y": (Position, 0.0),
    "angle": (Angle, 0.0),
    "length": (Length, None),
    "stiffness": (BendingStiffness, None),
    "end": (Annotated[str, OneOf(("pinned", "clamped"))], "pinned"),
    "at_x": (Position, 0.0),
    "at_y": (Position, 0.0),
    "tip_angle": (Angle, 0.0),
    "curvature": (Annotated[float, Quantity("1/m")], 0.0),
    "couple": (Force, 0.0),
    "load_x": (Annotated[float, Quantity("N/m")], 0.0),
    "load_y": (Annotated[float, Quantity("N/m")], 0.0),
    "guess_force_x": (GuessedForce, 0.0),
    "guess_force_y": (GuessedForce, 0.0),
    "guess_moment": (GuessedMoment, 0.0),
    "guess_angle": (GuessedAngle, 0.0),
}
"""Kinds and defaults of the parameters of each rod; `end` is that of its tip."""
PLATFORM_FIELDS: dict[str, tuple[Any, Any]] = {
    "force_x": (Force, 0.0),
    "force_y": (Force, 0.0),
    "moment": (Moment, 0.0),
    "held_x": (HeldPosition, np.inf),
    "held_y": (HeldPosition, np.inf),
    "held_phi": (HeldAngle, np.inf),
    "guess_x": (GuessedPosition, 0.0),
    "guess_y": (GuessedPosition, 0.0),
    "guess_phi": (GuessedAngle, 0.0),
}
"""The same of the platform; what is held at inf is free."""


def list_parameters() -> dict[str, Parameter]:
    """All parameters: those of the platform, and those of rods 1 to `MAX_NUMBERED_RODS`."""
    fields = PLATFORM_FIELDS | {
        f"{name}{i}": field
        for i in range(1, MAX_NUMBERED_RODS + 1)
        for name, field in ROD_FIELDS.items()
    }
    return {
        name: Parameter(name, kind.__metadata__[0], own) for name, (kind, own) in fields.items()
    }


class RodAssembly(Reference):
    """Clamped rods that are pinned or clamped to one platform, in an equilibrium near a guess.

    Rod 1 has the parameters `clamp_x1` and so on; there are as many rods as lengths.  Angles are
    those of tangents [rad], at the clamp and, in the platform's frame, at a clamped tip; `at_x`,
    `at_y` is the tip's place on the platform.  `couple` is a dead moment and `load` a dead load per
    length.  `held_x` and the like fix the platform.  Of the guess, `guess_moment` is of a clamped
    tip, and `guess_angle`, the tangent in the world, of a pinned one.

    Curves along rod 1 are x1, y1 [m], t1 [rad] and m1 [N m], the bending moment; x, y [m] and phi
    [rad] are those of the platform, and energy is that of bending [J].

    Raises ValueError if the guess leads to no equilibrium.  Gaps and unbalance are below 1e-8 of
    the sizes of the rods.  Source: J. Pérez Gámiz, TFG, UPV/EHU Bilbao 2018, eqs 24-30, 77 and
    106-115, for rods of any shape.

    Examples
    --------
    Two rods of a thesis (Table 7):

    >>> rods = {"clamp_x1": -0.3, "clamp_x2": 0.3, "angle1": np.radians(40),
    ...         "angle2": np.radians(140), "length1": 1.0, "length2": 1.0, "stiffness1": 0.052186,
    ...         "stiffness2": 0.052186, "force_x": 0.3, "force_y": -0.1}
    >>> guess = {"guess_x": 0.19, "guess_y": 0.86, "guess_angle1": 1.2, "guess_angle2": 2.45,
    ...          "guess_force_x1": 0.16, "guess_force_y1": 0.51}
    >>> pair = RodAssembly(**rods, **guess)
    >>> curves = pair.solve(InputMotion(np.linspace(0.0, 1.0, 3)), Ask())
    >>> bool(np.hypot(curves["x1"][-1] - curves["x"], curves["y1"][-1] - curves["y"]).max() < 1e-8)
    True
    """

    method = "solver of rods on a platform, by Newton's method from a guess"
    parameters: ClassVar = list_parameters()

    def check(self, values: dict[str, Value]) -> None:  # type: ignore[override]
        """Raise a ValueError for a value outside its domain, or of a rod without a length."""
        super().check(values)
        for name, value in values.items():
            if not isinstance(value, str) and np.isnan(value):
                raise ValueError(f"{name} must be a number or inf, got nan")
            base, number = name.rstrip("123456"), name[-1]
            if base in ROD_FIELDS and value != self.parameters[name].default:
                for needed in (f"length{number}", f"stiffness{number}"):
                    if needed not in values:
                        raise ValueError(f"{name} is of rod {number}: give {needed} as well")

    def of_rods(self, name: str) -> list[Any]:
        """The values of one parameter of all rods."""
        numbers = [i for i in range(1, MAX_NUMBERED_RODS + 1) if f"length{i}" in self.values]
        wanted = range(1, max(numbers, default=1) + 1)
        if missing := [i for i in wanted if i not in numbers]:
            raise ValueError(f"length{missing[0]} is missing: rods are numbered from 1 on")
        return [
            self.values.get(f"{name}{i}", self.parameters[f"{name}{i}"].default) for i in numbers
        ]

    def of_platform(self, *names: str) -> Array:
        """The values of parameters of the platform."""
        return np.array([self.values.get(n, self.parameters[n].default) for n in names], float)

    def points(self, name: str) -> Array:
        """Two parameters of all rods, NAME_x and NAME_y (k, 2)."""
        return np.array([self.of_rods(f"{name}_x"), self.of_rods(f"{name}_y")], float).T

    @property
    def problem(self) -> RodProblem:
        """The assembly with its load."""
        held = self.of_platform("held_x", "held_y", "held_phi")
        built = assembly(
            self.points("clamp"),
            angle=self.of_rods("angle"),
            length=self.of_rods("length"),
            stiffness=self.of_rods("stiffness"),
            arm=self.points("at"),
            clamped=[end == "clamped" for end in self.of_rods("end")],
            tip_angle=self.of_rods("tip_angle"),
            curvature=self.of_rods("curvature"),
            couple=self.of_rods("couple"),
            weight=self.points("load"),
            held=[float(value) if np.isfinite(value) else None for value in held],
        )
        load = self.of_platform("force_x", "force_y", "moment")
        if built.dof == 2 and (load[2] or np.isfinite(held[2])):
            raise ValueError(
                "moment and held_phi are of a platform, but all rods are pinned at its origin"
            )
        return RodProblem(built, np.zeros(built.rods), load)

    def state(self) -> RodGuess:
        """The state (1,) of the equilibrium to which the guess leads."""
        problem = self.problem
        guess = first_state(
            problem,
            self.of_platform("guess_x", "guess_y", "guess_phi"),
            self.points("guess_force"),
            np.array(self.of_rods("guess_moment"), float),
            np.array(self.of_rods("guess_angle"), float),
        )
        state, converged, least = solve_guesses(problem, guess, FINE_STEPS, FINE_TOLERANCE)
        residual = newton_step(problem, state, FINE_STEPS).residual[0]
        if not (converged[0] and residual < CLOSED_RESIDUAL):
            raise ValueError(
                "Newton's method finds no equilibrium near the guess (guess_x, guess_force_x1, "
                f"...): a gap or an unbalance of {least:.2g} of the sizes of the rods is left"
            )
        return state

    def equilibrium(self) -> RodEquilibria:
        """The equilibrium to which the guess leads, with its stability."""
        return describe_equilibria(self.problem, self.state(), ALL_EQUILIBRIA, np.inf, 0.0)

    def solve(self, motion: InputMotion, ask: Ask) -> dict[str, Array]:
        """Curves along the rods at the arc lengths of the motion, (n,) each."""
        problem, state = self.problem, self.state()
        curves, energy = dict[str, Array](), 0.0
        for i in range(problem.assembly.rods):
            arc = arc_lengths(motion.x, float(problem.assembly.length[i]))
            rod = rod_curves_at(problem, state, i, arc)
            energy += float(rod.pop("energy"))
            curves |= rod
        ends = {**dict(zip(("x", "y", "phi"), state.pose[0], strict=True)), "energy": energy}
        return curves | {name: np.full(motion.x.shape, value) for name, value in ends.items()}

    def properties(self, motion: InputMotion, ask: Ask) -> dict[str, str]:
        """Stability, potential and largest load of the equilibrium, in words."""
        found = self.equilibrium()
        index = int(found.index[0])
        return {
            "stability": f"unstable in {index} direction(s)" if index else "stable",
            "potential": f"{found.potential[0]:.6g} J",
            "inflections of the rods": ", ".join(map(str, found.inflections[0])),
            "largest load on a rod": f"{found.alpha[0].max():.3g}² EI/L²",
        }


def rod_curves_at(problem: RodProblem, state: RodGuess, i: int, arc: Array) -> dict[str, Array]:
    """Curves of rod i of an equilibrium (1,) at arc lengths (n,) from its clamp [m], its energy."""
    a, size = problem.assembly, arc.size
    shares = np.append(arc.ravel() / a.length[i], 0.0)  # the path's angles count from the clamp
    gauss, weights = np.polynomial.legendre.leggauss(GAUSS_NODES)
    away, back = np.unique(np.append(1.0 - shares, (1.0 + gauss) / 2.0), return_inverse=True)
    path = rod_path(problem, state, i, away)
    place = tip_places(a, state, i) + a.length[i] * path.position[back[:size], 0]
    bend = a.stiffness[i] / a.length[i]
    moment = path.moment[back, 0]
    rows = place.real, place.imag, path.angle[back[:size], 0], bend * moment[:size]
    curves = {
        f"{name}{i + 1}": row.reshape(arc.shape) for name, row in zip("xytm", rows, strict=True)
    }
    return curves | {"energy": bend / 4.0 * (weights @ moment[size + 1 :] ** 2)}


def first_state(
    problem: RodProblem, pose: Array, force: Array, moment: Array, angle: Array
) -> RodGuess:
    """A state (1,) of Newton's method from a guess.

    Parameters
    ----------
    problem : RodProblem
    pose : of the platform, x, y [m], phi [rad] (3,)
    force, moment, angle : on the tips (k, 2) [N], on clamped tips (k,) [N m], the tangents of
        pinned tips (k,) [rad]
    """
    a = problem.assembly
    guess = RodGuess(np.zeros((1, a.rods, OWN)), np.zeros((1, 3)))
    guess.pose[0, : a.dof] = np.where(np.isfinite(a.held), a.held, pose)[: a.dof]
    for i in range(a.rods):
        unit, rods, phi = problem.units(i), problem.unit_rod(i), guess.pose[0, 2]
        scaled = np.array([complex(*force[i]) / unit[0]])
        clamped = a.clamped[i]
        tip = np.array([phi + a.tip_angle[i] if clamped else angle[i]])
        bend = np.array([moment[i] * a.length[i] / a.stiffness[i] if clamped else 0.0])
        nodes = states_at_nodes(rods, scaled, bend, tip)
        third = bend if clamped else tip
        guess.own[:, i] = np.column_stack([scaled.real, scaled.imag, third, nodes]) * unit
    return guess
