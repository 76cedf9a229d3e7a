"""Charts of two rods on one pin (2RFR): all equilibria at given motor angles and load."""

from itertools import count

import numpy as np
from numpy.typing import NDArray

from proofmass.analytic.chart import MOST, Chart, Line, Panel
from proofmass.analytic.rods.pair import pair
from proofmass.analytic.rods.solutions import Solutions, solutions

POINTS = 61  # of a rod
MANY = 9  # directions to fall in: those with as many or more share a panel


def equilibria(
    *, distance: float, theta1: float, theta2: float, force_x: float, force_y: float,
    length: float = 1.0, stiffness: float = 1.0, modes: int = 3,
) -> Chart:
    r"""All equilibria, the stable ones by their energy, the others by the ways in which they fall.

    ::

               P --> F        V = U_1 + U_2 - F.P, over all shapes of two rods whose tips meet;
             .' `.            stable: a valley of V;  unstable: V falls in 1, 2 .. directions,
           _/     \           those with one are passes between valleys
         --@---d---@--

    Parameters
    ----------
    distance : d, between the clamps at (-d/2, 0) and (d/2, 0) [m]
    theta1, theta2 : tangents at the clamps [rad]
    force_x, force_y : F, dead load on the pin [N]
    length, stiffness : L [m], EI [N m^2], of each rod
    modes : largest number of inflections of a rod, its tip included

    Returns
    -------
    Chart
        A line for each equilibrium, from one clamp over the pin to the other.

    Raises
    ------
    ValueError
        As in `proofmass.analytic.rods.solutions`, which also says how complete they are; no
        equilibrium.

    Notes
    -----
    Source: Pérez Gámiz 2018, Table 7, which lists two of these, with modes 1 and 1, and neither
    energy nor stability.

    Examples
    --------
    >>> chart = equilibria(distance=0.6, theta1=np.radians(40), theta2=np.radians(60), force_x=0.3,
    ...     force_y=-0.1, stiffness=0.0521860264, modes=1)
    >>> chart.caption.partition(", V")[0]
    '3 equilibria whose rods have up to 1 inflection, the tip included: 3 stable'
    >>> [line.label for line in chart.lines][:2]
    ['stable at 0.2416 J, modes 1 and 1', 'stable at 0.78 J, modes 1 and 1']
    """
    found = solutions(pair(distance, length, stiffness), inputs=[theta1, theta2],
                      load=[force_x, force_y], modes=modes)
    if not len(found):
        raise ValueError(f"no equilibrium with modes up to {modes}")
    panels = tuple(panel(found, which) for which in sharing(found.negative))
    return Chart(("x", "m"), ("y", "m"), panels, caption(found, int(modes)), alike=True)


def sharing(negative: NDArray[np.int_]) -> list[NDArray[np.intp]]:
    """Which equilibria share a panel: few, and of one number of directions to fall in.

    >>> [which.tolist() for which in sharing(np.array([0, 1, 1, 0, 1, 1, 1]))]
    [[0, 3], [1, 2, 4], [5, 6]]
    """
    families = [np.flatnonzero(np.minimum(negative, MANY) == k) for k in range(MANY + 1)]
    for few in count(4):
        panels = [part for family in families if family.size
                  for part in np.array_split(family, -(-family.size // few))]
        if len(panels) <= MOST:
            return panels
    raise AssertionError("unreachable: a panel may hold all")


def panel(found: Solutions, which: NDArray[np.intp]) -> Panel:
    """Equilibria that fall in as many directions, with their pins and clamps."""
    pose, clamp = found.state.pose[which], found.state.assembly.clamp
    ways = min(int(found.negative[which[0]]), MANY)
    lines = [posture(found, int(i), rank) for rank, i in enumerate(which, 1)]
    lines.append(Line(pose[:, 0], pose[:, 1], "pin", ways == 0, points=True))
    lines.append(Line(clamp.real, clamp.imag, "clamps", points=True))
    if not ways:
        return Panel(tuple(lines), title="Stable")
    ends = dict.fromkeys(f"{V:.3g}" for V in found.potential[which[[0, -1]]])
    return Panel(tuple(lines), title=f"Falls in {directions(ways)}: {' to '.join(ends)} J")


def posture(found: Solutions, i: int, rank: int) -> Line:
    """Both rods of one equilibrium, out to the pin and back."""
    x, y = (np.append(one[0], one[1, -2::-1]) for one in found.state[i].shape(
        np.linspace(0.0, 1.0, POINTS))[:2])
    if found.negative[i]:
        return Line(x, y, f"unstable, no. {rank} in its panel", stable=False)
    modes = " and ".join(map(str, found.modes[i]))
    return Line(x, y, f"stable at {found.potential[i]:.4g} J, modes {modes}")


def directions(ways: int) -> str:
    """How many, in words.

    >>> directions(1), directions(2), directions(MANY)
    ('1 direction', '2 directions', '9 or more directions')
    """
    return f"{ways}{' or more' * (ways == MANY)} direction{'s' * (ways > 1)}"


def caption(found: Solutions, modes: int) -> str:
    """How many there are, and their energies V."""
    stable = found.potential[found.negative == 0]
    words = [f"{len(found)} equilibria whose rods have up to {modes} inflection"
             f"{'s' * (modes > 1)}, the tip included: {stable.size} stable"]
    if stable.size:
        words.append(f", V = {', '.join(f'{V:.4g}' for V in stable)} J")
    ways = np.minimum(found.negative, MANY)
    for k in np.unique(ways[ways > 0]).tolist():
        fallen = found.potential[ways == k]
        words.append(f"; {fallen.size} that fall in {directions(k)}, the lowest at "
                     f"{fallen[0]:.4g} J")
    limit = (f"No rod of any other carries more than R = {found.bound:.3g}² EI/L², by proof; up to "
             "there all were searched for" if found.bounded else
             f"Searched up to R = {found.up_to:.3g}² EI/L² on each rod")
    return f"{''.join(words)}. V is the energy of bending less F·P. {limit}."
