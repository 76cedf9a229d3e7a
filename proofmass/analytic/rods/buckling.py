"""Charts of buckling: stable and unstable equilibria of a column, straight and bent, by load."""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.analytic.numerics import check_number, check_positive
from proofmass.analytic.rods.column import complete_integrals, critical
from proofmass.analytic.rods.elastica import check_stiffness, rods_of_chart, tip
from proofmass.analytic.rods.rod_snap import sample_shapes
from proofmass.analytic.rods.shooting import stability
from proofmass.base.arrays import Array

MAX_LOAD_RATIO = 55.0  # [pi^2 EI/4 L^2], beyond the third critical load of both columns
MAX_IMPERFECT_LOAD_RATIO = 2.5  # largest load [pi^2 EI/4 L^2] of imperfect columns
MAX_Q_FREE = 12.0  # artanh k of a free column under the largest load
MAX_Q_PINNED = 1.2  # artanh k of a pinned column, with the pin at a third of the length
MAX_Q_IMPERFECT = 2.0  # artanh k of an imperfect column
STRAIGHT_POINTS = 2001  # points of the straight column's line: critical loads lie in narrow gaps
BUCKLING_NEWTON_STEPS = 30  # steps of Newton's method, each no longer than `MAX_ALPHA_STEP`
MAX_ALPHA_STEP = 0.1  # longest step of alpha


def buckling(*, length: float = 1.0, stiffness: float = 1.0) -> Chart:
    r"""Deflections and dead loads P along a column: clamped and free, clamped and pinned.

    ::

          |=========o <-- P         straight: unstable beyond the first critical load
          |
          |   ,-''-.                free: deflection of the tip, modes from pi^2/4, 9 pi^2/4 and
          |=-'      `-o <-- P             25 pi^2/4 EI/L^2
                                    pinned: deflection of the middle, modes from z^2 EI/L^2,
                                            tan z = z; the pin may slide along P

    Parameters
    ----------
    length, stiffness : L [m], EI [N m^2]

    Returns
    -------
    Chart
        A line for each mode and side, divided where its equilibria become unstable: there
        V = U - P (L - x) gets directions in which it falls.

    Notes
    -----
    The free column's modes are `proofmass.analytic.rods.tip` at psi = pi.  Those of the pinned one
    are rods of `proofmass.analytic.rods.elastica` whose tip is on the clamp's tangent.  Under a
    dead load the pinned column's first mode is unstable beyond the deflection where P is largest,
    at 1.14 critical loads.

    Examples
    --------
    >>> {line.label for line in buckling().panels[0].lines} == {
    ...     "straight", "mode 1", "mode 2", "mode 3"}
    True
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    free = [*straight_column_lines([critical() * (2 * j - 1) ** 2 for j in (1, 2, 3)])]
    pinned = [*straight_column_lines([z**2 for z in pinned_waves()])]
    for mode in (1, 2, 3):
        free += [*mirrored_lines(*free_column(mode), f"mode {mode}")]
        pinned += [*mirrored_lines(*pinned_column(mode), f"mode {mode}")]
    return Chart(
        ("deflection", "m"),
        ("load over π² EI/4 L²", ""),
        tuple(
            Panel(tuple(scale_line(line, length) for line in lines), title=title)
            for lines, title in (
                (free, "clamped and free: its tip"),
                (pinned, "clamped and pinned: its middle"),
            )
        ),
        "Bold lines are stable under a dead load. In the free column's first mode the load rises "
        "the further the column bends; in the pinned column's it has a maximum, beyond which the "
        "column snaps. Higher modes are unstable from the load on at which they begin.",
    )


def imperfect(*, length: float = 1.0, stiffness: float = 1.0, share: float = 0.02) -> Chart:
    """A clamped and free column under an inclined dead load: its pitchfork splits into two curves.

    Parameters
    ----------
    length, stiffness : L [m], EI [N m^2]
    share : load across over load along the column [1]

    Raises
    ------
    ValueError
        A length or stiffness that is not positive, or a share that is not within (0, 1).

    Examples
    --------
    >>> [line.label for line in imperfect(share=0.1).lines][-1]
    'with 0.1 across'
    """
    check_positive(length=length)
    check_stiffness(stiffness)
    check_number(share=share)
    if not 0.0 < share < 1.0:
        raise ValueError(f"share must be within (0, 1), got {share}")
    found = [
        *straight_column_lines([critical()], MAX_IMPERFECT_LOAD_RATIO),
        *mirrored_lines(*free_column(1), "along", MAX_IMPERFECT_LOAD_RATIO),
    ]
    for side in (1.0, -1.0):
        found += [
            *stability_lines(
                *free_column(1, side, share), f"with {share:.3g} across", MAX_IMPERFECT_LOAD_RATIO
            )
        ]
    return Chart(
        ("deflection of the tip", "m"),
        ("load over π² EI/4 L²", ""),
        (Panel(tuple(scale_line(line, length) for line in found)),),
        "A column that is pushed a little to one side bends to that side under any load and has no "
        "critical load. Equilibria on the other side are a separate curve, which begins in a fold "
        "above the critical load.",
    )


@lru_cache(16)
def free_column(mode: int, side: float = 0.0, share: float = 0.0) -> tuple[Array, Array, Array]:
    """Tip's deflection, load and number of negative directions of a clamped and free unit column.

    The load is the component along the column.  The component across it is `share` times that, to
    a side, 1 or -1; side 0 is a load along the column.
    """
    if side:
        k = side * np.tanh(np.geomspace(1e-9, MAX_Q_IMPERFECT, 401))
    else:
        k = np.tanh(np.linspace(1e-3, MAX_Q_FREE, 601))
    rod = tip(np.pi - np.arctan(share), k, mode)
    along, across = rod["R"] / np.hypot(1.0, share) * np.array([[-1.0], [share]])
    return rod["y"], -along, stability(along, across, rod["theta"]).free


@lru_cache(16)
def pinned_column(mode: int) -> tuple[Array, Array, Array]:
    """Middle's deflection, load and negative directions of a clamped and pinned unit column."""
    alpha, q = pinned_column_chart(mode)
    rod = rods_of_chart(alpha, q)
    place, turn, _ = sample_shapes(alpha, q, rod.tip.real, np.array([0.0, 0.5, 1.0]))
    state = stability(rod.force.real, rod.force.imag, turn[2] - turn[0])
    negative = state.free - (state.compliance[1, 1] < 0.0)  # the pin may slide along the load
    return place[1].imag, -rod.force.real, negative


def pinned_column_chart(mode: int) -> tuple[Array, Array]:
    """alpha and q of rods whose tips are on the clamp's tangent, from the straight rod on."""
    q = np.linspace(1e-3, MAX_Q_PINNED, 161)
    alpha = pinned_waves()[mode - 1] * complete_integrals(1.0 / np.cosh(q))[0] * 2.0 / np.pi
    for _ in range(BUCKLING_NEWTON_STEPS):
        rod = rods_of_chart(alpha, q)
        alpha = alpha - np.clip(
            rod.tip.imag / rod.tip_slope[0].imag, -MAX_ALPHA_STEP, MAX_ALPHA_STEP
        )
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


def straight_column_lines(
    loads: list[float], max_ratio: float = MAX_LOAD_RATIO
) -> Iterator[ChartLine]:
    """Chart lines of the straight column; each critical load adds an unstable direction."""
    load = np.linspace(0.0, max_ratio, STRAIGHT_POINTS) * critical()
    return stability_lines(
        0.0 * load, load, (load[:, None] > loads).sum(axis=1), "straight", max_ratio
    )


def mirrored_lines(
    deflection: Array, load: Array, negative: Array, label: str, max_ratio: float = MAX_LOAD_RATIO
) -> Iterator[ChartLine]:
    """Lines of a mode and of its mirror image."""
    for side in (1, -1):
        yield from stability_lines(side * deflection, load, negative, label, max_ratio)


def stability_lines(
    deflection: Array, load: Array, negative: Array, label: str, max_ratio: float = MAX_LOAD_RATIO
) -> Iterator[ChartLine]:
    """Lines of the stable and of the unstable parts of a branch, up to the largest load."""
    ratio, is_unstable = load / critical(), negative > 0
    near_unstable = is_unstable.copy()  # with neighbours, so that no gap is left
    near_unstable[1:] |= is_unstable[:-1]
    near_unstable[:-1] |= is_unstable[1:]
    for stable, part in ((True, ~is_unstable), (False, near_unstable)):
        shown = part & (ratio <= max_ratio)
        if shown.any():
            x, y = np.where(shown, [deflection, ratio], np.nan)
            yield ChartLine(x, y, label, stable=stable)


def scale_line(line: ChartLine, length: float) -> ChartLine:
    """The line of a unit column for one of that length [m]."""
    return ChartLine(length * line.x, line.y, line.label, stable=line.stable)
