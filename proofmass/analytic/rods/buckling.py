"""Charts of buckling: straight and bent equilibria over the load, stable and unstable."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.analytic.numerics import Array
from proofmass.analytic.rods.column import critical, whole
from proofmass.analytic.rods.elastica import rods, stiff, tip
from proofmass.analytic.rods.rod_snap import shape
from proofmass.analytic.rods.shooting import stability

MOST = 55.0  # of pi^2 EI/4 L^2: beyond the third mode of either column
NEAR = 2.5  # the same, of imperfect columns
FURTHEST = 12.0  # artanh k, of a free column under the largest load
BENT = 1.2  # the same of a pinned one, with the pin at a third of the length
LEANT = 2.0  # the same of an imperfect one
STRAIGHT = 2001  # points, so that a critical load lies in a narrow gap
STEPS = 30  # of Newton's method, no longer than LIMIT
LIMIT = 0.1  # of alpha


def buckling(*, length: float = 1.0, stiffness: float = 1.0) -> Chart:
    r"""Deflection over a dead load P along a column: clamped and free, clamped and pinned.

    ::

          |=========o <-- P         straight: unstable beyond the first critical load
          |
          |   ,-''-.                free:   of the tip, modes at pi^2/4, 9 pi^2/4, 25 pi^2/4 EI/L^2
          |=-'      `-o <-- P       pinned: of the middle, at z^2 EI/L^2, tan z = z; the pin may
                                            slide along P

    Parameters
    ----------
    length, stiffness : L [m], EI [N m^2]

    Returns
    -------
    Chart
        A line for each mode and side, parted where V = U - P (L - x) gets directions to fall in.

    Notes
    -----
    The free column's modes are `proofmass.analytic.rods.tip` at psi = pi.  Those of the pinned one
    are rods of `proofmass.analytic.rods.elastica` whose tip is on the clamp's tangent.  Under a
    dead load its first mode is lost where P is largest, at 1.14 critical loads.

    Examples
    --------
    >>> {line.label for line in buckling().panels[0].lines} == {
    ...     "straight", "mode 1", "mode 2", "mode 3"}
    True
    """
    stiff(stiffness)
    free = [*straight([critical() * (2 * j - 1) ** 2 for j in (1, 2, 3)])]
    held = [*straight([z**2 for z in pinned_waves()])]
    for mode in (1, 2, 3):
        free += [*both_sides(*of_free(mode), f"mode {mode}")]
        held += [*both_sides(*of_pinned(mode), f"mode {mode}")]
    return Chart(
        ("deflection", "m"),
        ("load over π² EI/4 L²", ""),
        tuple(
            Panel(tuple(scaled(line, length) for line in lines), title=title)
            for lines, title in (
                (free, "clamped and free: its tip"),
                (held, "clamped and pinned: its middle"),
            )
        ),
        "Bold is stable under a dead load. The free column's first mode holds more the further it "
        "bends; the pinned one's has a largest load, beyond which it snaps. Higher modes are "
        "passes between valleys from their beginning.",
    )


def imperfect(*, length: float = 1.0, stiffness: float = 1.0, share: float = 0.02) -> Chart:
    """A clamped and free column whose dead load leans: the fork falls apart into two curves.

    Parameters
    ----------
    length, stiffness : L [m], EI [N m^2]
    share : load across over load along the column [1]

    Raises
    ------
    ValueError
        A share that is not within (0, 1).

    Examples
    --------
    >>> [line.label for line in imperfect(share=0.1).lines][-1]
    'with 0.1 across'
    """
    stiff(stiffness)
    if not 0.0 < share < 1.0:
        raise ValueError(f"share must be within (0, 1), got {share}")
    found = [*straight([critical()], NEAR), *both_sides(*of_free(1), "along", NEAR)]
    for side in (1.0, -1.0):
        found += [*parted(*of_free(1, side, share), f"with {share:.3g} across", NEAR)]
    return Chart(
        ("deflection of the tip", "m"),
        ("load over π² EI/4 L²", ""),
        (Panel(tuple(scaled(line, length) for line in found)),),
        "A column that is pushed a little to one side bends to it from the first load on, and has "
        "no critical load. The other side is left as an island, which begins in a fold above it.",
    )


@lru_cache(16)
def of_free(mode: int, side: float = 0.0, share: float = 0.0) -> tuple[Array, Array, Array]:
    """Tip's deflection, load along, and directions to fall in, of a clamped and free unit column.

    With a share of the load across, which leans to a side, 1 or -1.
    """
    if side:
        k = side * np.tanh(np.geomspace(1e-9, LEANT, 401))
    else:
        k = np.tanh(np.linspace(1e-3, FURTHEST, 601))
    rod = tip(np.pi - np.arctan(share), k, mode)
    along, across = rod["R"] / np.hypot(1.0, share) * np.array([[-1.0], [share]])
    return rod["y"], -along, stability(along, across, rod["theta"]).free


@lru_cache(16)
def of_pinned(mode: int) -> tuple[Array, Array, Array]:
    """The middle's deflection, load, and directions to fall in, of a clamped and pinned column."""
    alpha, q = on_the_line(mode)
    rod = rods(alpha, q)
    place, turn, _ = shape(alpha, q, rod.tip.real, np.array([0.0, 0.5, 1.0]))
    state = stability(rod.force.real, rod.force.imag, turn[2] - turn[0])
    held = state.free - (state.compliance[1, 1] < 0.0)  # the pin may slide along the load
    return place[1].imag, -rod.force.real, held


def on_the_line(mode: int) -> tuple[Array, Array]:
    """alpha and q of rods with the tip on the clamp's tangent, from the straight one on."""
    q = np.linspace(1e-3, BENT, 161)
    alpha = pinned_waves()[mode - 1] * whole(1.0 / np.cosh(q))[0] * 2.0 / np.pi
    for _ in range(STEPS):
        rod = rods(alpha, q)
        alpha = alpha - np.clip(rod.tip.imag / rod.tip_slope[0].imag, -LIMIT, LIMIT)
    return alpha, q


def pinned_waves() -> list[float]:
    """The first three z > 0 of tan z = z.

    >>> [round(z**2, 5) for z in pinned_waves()]
    [20.19073, 59.67952, 118.89987]
    """
    return [
        float(
            brentq(
                lambda z: np.sin(z) - z * np.cos(z),
                (j + 0.25) * np.pi,
                (j + 0.5) * np.pi,
                xtol=1e-15,
            )
        )
        for j in (1, 2, 3)
    ]


def straight(loads: list[float], most: float = MOST) -> Iterator[ChartLine]:
    """The straight column, which gets a direction to fall in at each of its critical loads."""
    load = np.linspace(0.0, most, STRAIGHT) * critical()
    return parted(0.0 * load, load, (load[:, None] > loads).sum(axis=1), "straight", most)


def both_sides(
    deflection: Array, load: Array, negative: Array, label: str, most: float = MOST
) -> Iterator[ChartLine]:
    """A mode and its mirror image."""
    for side in (1, -1):
        yield from parted(side * deflection, load, negative, label, most)


def parted(
    deflection: Array, load: Array, negative: Array, label: str, most: float = MOST
) -> Iterator[ChartLine]:
    """The stable parts of a branch and the others, up to the largest load that is drawn."""
    ratio, falls = load / critical(), negative > 0
    reach = falls.copy()  # to the stable part's end
    reach[1:] |= falls[:-1]
    reach[:-1] |= falls[1:]
    for stable, part in ((True, ~falls), (False, reach)):
        shown = part & (ratio <= most)
        if shown.any():
            x, y = np.where(shown, [deflection, ratio], np.nan)
            yield ChartLine(x, y, label, stable=stable)


def scaled(line: ChartLine, length: float) -> ChartLine:
    """The line of a unit column for one of that length [m]."""
    return ChartLine(length * line.x, line.y, line.label, stable=line.stable)
