"""Equilibria of an assembly whose rods are chains of rigid links, as engines have them.

A step of `tip_wrench` over half a link, a hinge with a spring and half a link makes a rod a chain,
without an engine and without an approximation.  So Newton's method leads from each equilibrium of
the rods to that of chains of n links, if they have one.  Its distance is the error of chains, of
second order in the length of a link; and the shape of a chain that an engine leaves at rest tells
in which of the equilibria it is.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from proofmass.analytic.numerics import TURN
from proofmass.analytic.rods.assembly_newton import (
    SEGMENTS,
    RodGuess,
    RodProblem,
    solve_guesses,
)
from proofmass.analytic.rods.assembly_search import FINE_TOLERANCE, RodEquilibria, tip_places
from proofmass.analytic.rods.tip_wrench import LinkRule, TipMarch
from proofmass.base.arrays import Array, Complex

MAX_CHAIN_DISTANCE = 0.1
"""Difference of the places of a rod and of its chain, over the length of the rod, beyond which the
chain's equilibrium is another one."""


@dataclass(frozen=True)
class ChainShapes:
    """Chains (n,) of one member of an assembly, from the clamp to the tip.

    Attributes
    ----------
    hinges : ndarray (links + 2,)
        Arc lengths of the clamp, the hinges and the tip [m].
    place : ndarray of complex (links + 2, n)
        Where they are, x + iy [m].
    moment : ndarray (links, n)
        Moments of the springs [N m].
    nodes : ndarray (links + 1,)
        Arc lengths of the middles of the links, and of both ends [m].
    angle : ndarray (links + 1, n)
        Directions of the links [rad].
    """

    hinges: Array
    place: Complex
    moment: Array
    nodes: Array
    angle: Array

    def at(self, arc: Array) -> dict[str, Array]:
        """Curves x, y [m], t [rad] and m [N m] (arc lengths, n), as engines give them."""
        place = along(self.hinges, self.place, arc)
        return {
            "x": place.real,
            "y": place.imag,
            "t": along(self.nodes, self.angle, arc),
            "m": along(self.hinges[1:-1], self.moment, arc),
        }


def along(nodes: Array, values: Any, arc: Array) -> Any:
    """Values (nodes, n) at arc lengths by lines between nodes, which are drawn on to the ends.

    >>> along(np.array([1.0, 2.0]), np.array([[1.0], [3.0]]), np.array([0.0, 1.5])).ravel().tolist()
    [-1.0, 2.0]
    """
    k = np.clip(np.searchsorted(nodes, arc) - 1, 0, nodes.size - 2)
    share = ((arc - nodes[k]) / (nodes[k + 1] - nodes[k]))[:, None]
    return (1.0 - share) * values[k] + share * values[k + 1]


def chain_equilibria(found: RodEquilibria, links: int) -> RodGuess:
    """The equilibria of chains of `links` springs near those of the rods; NaN where there is none.

    `links` is a multiple of `SEGMENTS`.
    """
    check_links(links)
    problem, rule = found.problem, LinkRule(links)
    state, converged, _ = solve_guesses(problem, found.state, rule, FINE_TOLERANCE)
    state.own[~converged], state.pose[~converged] = np.nan, np.nan
    length = problem.assembly.length.min()
    apart = np.abs(state.pose - found.state.pose) / [length, length, 1.0]
    far = ~(apart.max(axis=1) < MAX_CHAIN_DISTANCE)
    state.own[far], state.pose[far] = np.nan, np.nan
    return state


def check_links(links: int) -> None:
    """ValueError if a chain of this many springs cannot be cut into `SEGMENTS` equal parts."""
    if links < SEGMENTS or links % SEGMENTS:
        raise ValueError(f"links must be a multiple of {SEGMENTS}, got {links}")


def chain_shapes(problem: RodProblem, state: RodGuess, i: int, links: int) -> ChainShapes:
    """The chains of member i in equilibria (n,) of `chain_equilibria`."""
    a, own = problem.assembly, state.own[:, i, :3] / problem.units(i)[:3]
    clamped, size = a.clamped[i], 1.0 / links
    angle = state.pose[:, 2] + a.tip_angle[i] if clamped else own[:, 2]
    moment = own[:, 2] if clamped else np.zeros(len(state))
    march = TipMarch(problem.unit_rod(i), own[:, 0] + 1j * own[:, 1], moment, angle, False)
    places, moments, angles = [march.position.copy()], [], [march.angle.copy()]
    for k in range(links):
        march.go(size / 2.0, size / 4.0 if k == 0 else 0.0)
        places.append(march.position.copy())
        moments.append(march.moment + march.rods.slope * (march.way + size / 2.0))
        march.turn(size)
        march.go(size / 2.0)
        angles.append(march.angle.copy())
    places.append(march.position.copy())
    back = slice(None, None, -1)
    place = tip_places(a, state, i) + a.length[i] * np.array(places[back])
    angle = np.array(angles[back])
    with np.errstate(invalid="ignore"):
        angle -= TURN * np.round((angle[0] - problem.angle[i]) / TURN)
    nodes = np.linspace(0.0, a.length[i], links + 1)
    hinges = np.array([0.0, *(nodes[1:] + nodes[:-1]) / 2.0, a.length[i]])
    bend = a.stiffness[i] / a.length[i]
    return ChainShapes(hinges, place, bend * np.array(moments[back]), nodes, angle)


def bending_energy(problem: RodProblem, i: int, shapes: ChainShapes) -> Array:
    """Energy (n,) of the springs of chains of member i [J]."""
    a = problem.assembly
    size = a.length[i] / (shapes.nodes.size - 1)
    return np.asarray(0.5 * (shapes.moment**2).sum(axis=0) * size / a.stiffness[i])
