"""Three clamped rods with their tips on one rigid platform (3RFR), at rest under a dead load."""

from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.numerics import (
    check_count,
    check_not_negative,
    check_number,
    check_positive,
)
from proofmass.analytic.protocol import (
    Angle,
    BendingStiffness,
    ClosedForm,
    Domain,
    Force,
    Length,
    Moment,
    Natural,
    OneOf,
    Quantity,
)
from proofmass.analytic.remember import reuse_nearby
from proofmass.analytic.rods.all_equilibria import solutions
from proofmass.analytic.rods.assembly import Assembly, assembly, triangle
from proofmass.analytic.rods.elastica import arc_lengths
from proofmass.analytic.rods.equilibrium import RodState, derivatives, solve_direct
from proofmass.base.arrays import Array

MODES = tuple(range(1, 10))
MAX_ALPHA = 20.0  # alpha = L sqrt(R/EI); errors of larger loads, e^alpha, forbid continuation
MAX_EXTENSION_STEP = 0.02  # growth of rigid ends from one equilibrium to the next, over the length
COMPLIANCE_ROUNDING = 1e-9  # of the platform's compliance, over its largest eigenvalue
ThreeNumbers = tuple[float, float, float]


def solve(
    s: ArrayLike,
    *,
    side: float,
    theta1: float,
    theta2: float,
    theta3: float,
    radius: float = 1.0,
    force_x: float = 0.0,
    force_y: float = 0.0,
    moment: float = 0.0,
    mode: int = 1,
    inflections: int = 1,
    length: float = 1.0,
    stiffness: float = 1.0,
    rigid_extension: float = 0.0,
) -> dict[str, Array]:
    r"""Shapes of the three rods at arc lengths `s` from their clamps.

    ::

                   O3
                   |                 O1, O2, O3 at -150, -30 and 90 degrees on a circle about
                    \                the origin, the clamps' tangents at theta1, theta2, theta3
                    B3
                 side/ \             B1 B2 B3 equilateral, centre P at (x, y),
                   B1---B2           phi = angle of B1-B2
                  /       `-._
             O1 -'            `O2    n_1 + n_2 + n_3 = F,  sum (B_i - P) x n_i = M

    Parameters
    ----------
    s : [m], in [0, length]  (...)
    side : a, of the platform [m]
    theta1, theta2, theta3 : tangents at the clamps [rad]
    radius : of the circle of the clamps [m]
    force_x, force_y : dead load F on the platform at P [N]
    moment : dead load M on the platform [N m]
    mode : 1 for the stable equilibrium of least potential, 2 for the next, ...
    inflections : most that a rod may have, its pinned tip included
    length, stiffness : L [m], EI [N m^2], of each rod
    rigid_extension : rigid straight end of each rod [m], pinned at its far end

    Returns
    -------
    dict of (...) arrays: x1, y1 [m], t1 [rad], m1 [N m] along the first rod, x2, ... along the
    others; and, the same at all arc lengths, x, y [m], phi [rad] of the platform, hold1, hold2,
    hold3, the moments [N m] on the clamps that keep them at rest, and energy of bending [J].

    Raises
    ------
    ValueError
        A parameter out of its domain, clamps out of reach, or a mode that does not exist: the
        message lists those that do.

    Notes
    -----
    The equilibrium is selected by a mode and not by a first guess, since the forces of a mechanism
    that is yet to be built are unknown, while it comes to rest in a stable equilibrium.
    `proofmass.analytic.rods.all_equilibria` searches for all of them in about a second; problems
    that are equal in five digits share the search, and each is solved from its result by Newton's
    method.  Modes count the equilibria whose rods carry R = 20^2 EI/L^2 at most, including those
    with looped rods; there are more beyond.  With rigid ends, the equilibrium is counted without
    them and followed while they grow from zero.

    Equilibria are closed and balanced within 1e-10 of the sizes EI/L^2, EI/L and L.  Source: Pérez
    Gámiz 2018, eqs 106-115 and Table 8, with 180 degrees for theta2, printed 0, and the side of
    0.2 m, which is not printed.  Its first solution is mode 2 here, its second mode 1; three more
    stable ones up to that load, each with a looped rod, are not in it.

    Examples
    --------
    >>> three = solve([0.0, 1.0], side=0.2, theta1=np.pi/4, theta2=np.pi, theta3=-np.pi/3,
    ...               force_y=0.5, stiffness=0.0521860264)
    >>> [round(float(three[name][0]), 6) for name in ("x", "y", "phi", "hold2")]
    [0.006759, 0.011078, -1.394088, 0.075531]
    """
    check_count(inflections=inflections)
    check_not_negative("m", rigid_extension=rigid_extension)
    check_number(theta1=theta1, theta2=theta2, theta3=theta3, moment=moment)
    check_number(force_x=force_x, force_y=force_y)
    found = equilibrium_of_mode(
        PlatformProblem(
            side,
            radius,
            length,
            stiffness,
            (theta1, theta2, theta3),
            None,
            (0.0, 0.0, 0.0),
            (force_x, force_y, moment),
            inflections,
        ),
        mode,
        rigid_extension,
    )
    arc, known = arc_lengths(s, length), dict[str, Array]()
    for name, rods in zip("xytm", found.shape(arc.ravel() / length), strict=True):
        known |= {f"{name}{k}": rod.reshape(arc.shape) for k, rod in enumerate(rods, 1)}
    ends = dict(zip(("x", "y", "phi"), found.pose, strict=True))
    ends |= {f"hold{k}": -moment for k, moment in enumerate(found.moment, 1)}
    ends["energy"] = found.energy.sum()
    return known | {name: np.full(arc.shape, value) for name, value in ends.items()}


class PlatformProblem(NamedTuple):
    """Three equal rods on an equilateral platform, with their clamps or guides on a circle.

    Without `guide` the inputs turn the clamps; angles [rad], load (F_x, F_y [N], M [N m]).
    """

    side: float
    radius: float
    length: float
    stiffness: float
    theta: ThreeNumbers
    guide: ThreeNumbers | None
    inputs: ThreeNumbers
    load: ThreeNumbers
    inflections: int

    @property
    def assembly(self) -> Assembly:
        """The rods and the platform."""
        check_positive(radius=self.radius)
        return assembly(
            triangle(np.sqrt(3.0) * self.radius),
            length=self.length,
            stiffness=self.stiffness,
            arm=triangle(self.side),
            angle=self.theta,
            guide=self.guide,
        )


def equilibrium_of_mode(
    problem: PlatformProblem, mode: int, rigid_extension: float = 0.0
) -> RodState:
    """The stable equilibrium of that mode, with rigid ends if they have a length."""
    there = stable_equilibria(problem)
    if mode not in range(1, 1 + len(there.vector)):
        raise ValueError(
            f"mode {mode} is not there; there are: {format_modes(there)}, with loads up to "
            f"R = {MAX_ALPHA:g}² EI/L²"
        )
    near = RodState(problem.assembly, there[int(mode) - 1].vector)
    return grow_rigid_ends(
        solve_direct(near.with_parts(inputs=problem.inputs, load=problem.load)), rigid_extension
    )


@reuse_nearby
def stable_equilibria(problem: PlatformProblem) -> RodState:
    """Stable equilibria (n,) with loads up to alpha = `MAX_ALPHA`, the lowest potential first."""
    found = solutions(
        problem.assembly,
        inputs=problem.inputs,
        load=problem.load,
        modes=problem.inflections,
        most_load=MAX_ALPHA,
    )
    return found.state[found.negative == 0]


def format_modes(found: RodState) -> str:
    """Text with the modes and their poses, for messages."""
    poses = (
        f"{k} at ({x:.3g}, {y:.3g}) m, {np.degrees(phi):.4g} degrees"
        for k, (x, y, phi) in enumerate(found.pose, 1)
    )
    return "; ".join(poses) or "none"


def grow_rigid_ends(found: RodState, rigid_extension: float) -> RodState:
    """The equilibrium after its rigid ends have grown from zero; ValueError if it is not stable."""
    steps = int(np.ceil(rigid_extension / (MAX_EXTENSION_STEP * found.assembly.length[0])))
    for rigid in np.linspace(0.0, rigid_extension, steps + 1)[1:]:
        robot = replace(found.assembly, rigid_extension=np.full(3, rigid))
        found = solve_direct(RodState(robot, found.vector))
        if not platform_is_stable(found):
            raise ValueError(
                f"rigid_extension must be less than {rigid:.3g} m, where this "
                f"equilibrium becomes unstable, got {rigid_extension}"
            )
    return found


def platform_is_stable(s: RodState) -> NDArray[np.bool_]:
    """Whether no eigenvalue of the platform's compliance is negative (...).

    A path from a stable equilibrium reaches no rod that is unstable with its pin fixed before a
    platform that is not stable.  A straight rod has an eigenvalue of zero.
    """
    length = s.assembly.scale[0]
    size = np.array([length, length, 1.0])
    eigenvalues = np.linalg.eigvalsh(derivatives(s).compliance / np.outer(size, size))
    largest = np.abs(eigenvalues).max(axis=-1)
    return np.asarray(eigenvalues[..., 0] >= -COMPLIANCE_ROUNDING * largest)


class RodPlatform(ClosedForm, function=solve):
    """Three clamped rods with their tips on one platform (3RFR), at rest under a dead load."""

    method = "solver of three rods on a platform"
    side: Length
    theta1: Angle
    theta2: Angle
    theta3: Angle
    radius: Length
    force_x: Force
    force_y: Force
    moment: Moment
    mode: Annotated[int, OneOf(MODES)]
    inflections: Natural
    length: Length
    stiffness: BendingStiffness
    rigid_extension: Annotated[float, Quantity("m", Domain.NOT_NEGATIVE)]
