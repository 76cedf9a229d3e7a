"""Linkages of one degree of freedom with dry friction, in one coordinate and without proofmass.

    m(q) q'' + m'(q) q'^2 / 2 + V'(q) = -sign(q') sum of F |dj/dq|      j: joints with friction F

All joints halt together; a joint passes a dead point of its own, where dj/dq = 0, on the way.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass
class Bar:
    """Mass, inertia, and first and second derivatives of its centre and its angle by q."""

    mass: float
    inertia: float
    first: complex
    second: complex
    turn: float = 0.0
    bend: float = 0.0


@dataclass
class Linkage:
    """Bars, spring force along q and derivatives of joints, as functions of q; and frictions."""

    bars: Callable[[float], Sequence[Bar]]
    joints: Callable[[float], np.ndarray]
    friction: np.ndarray
    spring: Callable[[float], float] = lambda q: 0.0
    gravity: float = 9.81

    def terms(self, q: float) -> tuple[float, float, float]:
        """Mass m, its derivative, and the force -V'."""
        mass = slope = 0.0
        force = self.spring(q)
        for bar in self.bars(q):
            mass += bar.mass * abs(bar.first) ** 2 + bar.inertia * bar.turn**2
            slope += 2 * bar.mass * (bar.first.conjugate() * bar.second).real
            slope += 2 * bar.inertia * bar.turn * bar.bend
            force -= bar.mass * self.gravity * bar.first.imag
        return mass, slope, force

    def resistance(self, q: float) -> float:
        return float(self.friction @ np.abs(self.joints(q)))


def follow(linkage: Linkage, q: float, until: float) -> tuple[list[float], float]:
    """Times at which joints halt, and the last coordinate, of a motion from rest."""
    t, v, times = 0.0, 0.0, []
    while t < until:
        force = linkage.terms(q)[2]
        if v == 0.0 and abs(force) <= linkage.resistance(q):
            return times, q
        sense = np.sign(v) if v else np.sign(force)
        found = solve_ivp(
            slope_of(linkage, sense),
            (t, until),
            [q, v],
            "DOP853",
            rtol=1e-13,
            atol=1e-13,
            max_step=0.01,
            events=conditions(linkage, q, sense),
        )
        t, (q, v) = float(found.t[-1]), found.y[:, -1].tolist()
        if found.t_events is None or not any(map(len, found.t_events)):
            break
        times.append(t)
        if len(found.t_events[0]):
            v = 0.0
    return times, q


def slope_of(linkage: Linkage, sense: float):
    def slope(_: float, y: np.ndarray) -> list[float]:
        mass, change, force = linkage.terms(y[0])
        resisted = force - sense * linkage.resistance(y[0])
        return [y[1], (resisted - 0.5 * change * y[1] ** 2) / mass]

    return slope


def conditions(linkage: Linkage, q: float, sense: float):
    """The rate falls to zero, or a joint meets its dead point."""

    def halt(_: float, y: np.ndarray) -> float:
        return sense * y[1]

    halt.terminal, halt.direction = True, -1
    found = [halt]
    signs = np.sign(linkage.joints(q + 1e-9 * sense))  # behind a dead point, if it starts there
    for k, sign in enumerate(signs.tolist()):

        def dead(_: float, y: np.ndarray, k: int = k, sign: float = sign) -> float:
            return sign * float(linkage.joints(y[0])[k])

        dead.terminal, dead.direction = True, -1
        found.append(dead)
    return found


def slider_crank() -> Linkage:
    """Crank 0.1 m, coupler 0.3 m, slider along x with a spring of 30 N/m from x = 0.4 m."""

    def angles(q: float) -> tuple[float, float, float]:
        angle = -np.arcsin(np.sin(q) / 3)
        first = -np.cos(q) / (3 * np.cos(angle))
        return angle, first, (np.sin(q) / 3 + np.sin(angle) * first**2) / np.cos(angle)

    def slider(q: float) -> tuple[float, float, float]:
        angle, first, second = angles(q)
        along = 0.1 * np.exp(1j * q), 0.3 * np.exp(1j * angle)
        rate = (1j * along[0] + 1j * first * along[1]).real
        bend = (-along[0] + (1j * second - first**2) * along[1]).real
        return (along[0] + along[1]).real, rate, bend

    def bars(q: float) -> list[Bar]:
        angle, first, second = angles(q)
        pin, half = 0.1 * np.exp(1j * q), 0.15 * np.exp(1j * angle)
        _, rate, bend = slider(q)
        return [
            Bar(0.4, 1e-3, 0.5j * pin, -0.5 * pin, 1.0),
            Bar(
                0.6,
                4e-3,
                1j * pin + 1j * first * half,
                -pin + (1j * second - first**2) * half,
                first,
                second,
            ),
            Bar(0.8, 0.0, complex(rate), complex(bend)),
        ]

    def joints(q: float) -> np.ndarray:
        return np.array([1.0, angles(q)[1] - 1.0, slider(q)[1]])

    def spring(q: float) -> float:
        place, rate, _ = slider(q)
        return -30.0 * (place - 0.4) * rate

    return Linkage(bars, joints, np.array([0.05, 0.08, 1.0]), spring)


CRANK, COUPLER, ROCKER, GROUND = 0.1, 0.28, 0.24, 0.3


def four_bar_angles(q: float) -> tuple[float, float]:
    """Angles of coupler and rocker of the four-bar, elbow up."""
    way = GROUND - CRANK * np.exp(1j * q)
    span = abs(way)
    corner = np.arccos((COUPLER**2 + span**2 - ROCKER**2) / (2 * COUPLER * span))
    coupler = np.angle(way) + corner
    return float(coupler), float(np.angle(COUPLER * np.exp(1j * coupler) - way))


def four_bar() -> Linkage:
    """Uniform bars of 0.4, 0.7 and 0.5 kg; friction at crank and coupler, and rocker and ground."""

    def motion(q: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angles = np.array(four_bar_angles(q))
        rows = np.array([1.0, -1.0]) * np.array([COUPLER, ROCKER]) * np.exp(1j * angles)
        matrix = np.array([(1j * rows).real, (1j * rows).imag])
        crank = CRANK * np.exp(1j * q)
        first = np.linalg.solve(matrix, [(-1j * crank).real, (-1j * crank).imag])
        rest = crank + rows @ first**2
        return angles, first, np.linalg.solve(matrix, [rest.real, rest.imag])

    def bars(q: float) -> list[Bar]:
        angles, first, second = motion(q)
        crank = CRANK * np.exp(1j * q)
        coupler, rocker = 0.5 * np.array([COUPLER, ROCKER]) * np.exp(1j * angles)
        turn = [(1j * s - f**2) for f, s in zip(first, second, strict=True)]
        return [
            Bar(0.4, 0.4 * CRANK**2 / 12, 0.5j * crank, -0.5 * crank, 1.0),
            Bar(
                0.7,
                0.7 * COUPLER**2 / 12,
                1j * crank + 1j * first[0] * coupler,
                -crank + turn[0] * coupler,
                first[0],
                second[0],
            ),
            Bar(
                0.5,
                0.5 * ROCKER**2 / 12,
                1j * first[1] * rocker,
                turn[1] * rocker,
                first[1],
                second[1],
            ),
        ]

    def joints(q: float) -> np.ndarray:
        _, first, _ = motion(q)
        return np.array([first[0] - 1.0, first[1]])

    return Linkage(bars, joints, np.array([0.02, 0.03]))
