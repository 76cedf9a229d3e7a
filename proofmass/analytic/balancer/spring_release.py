"""Two springs in series or in parallel, one of them prestressed on a contact that releases.

After the release the stiffness is smaller.
"""

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import check_finite, check_not_negative, check_positive
from proofmass.analytic.protocol import ClosedForm, Domain, OneOf, Quantity
from proofmass.base.arrays import Array

CONNECTIONS = "series", "parallel"


def solve(
    place: ArrayLike,
    rate: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
    *,
    stiffness1: float,
    stiffness2: float,
    preload: float,
    connection: str,
) -> dict[str, Array]:
    r"""Force on the handle of two springs, the first of which is prestressed on a contact.

    ::

        series                                   parallel
                  |contact                                 |contact
        |--k1-/\/--[]--k2-/\/--o--> F, x         |--k2-/\/--o--> F, x
                  --> gap                                  o--k1-/\/--[]| --> gap

        F = k2 x                 k2 x <= P       F = (k1 + k2) x         k1 x <= P
        F = P + k1 gap           beyond          F = P + k2 x            beyond
        dF/dx = k1 k2/(k1 + k2)                  dF/dx = k2

    In series, spring 1 pulls its end onto the contact with P, and it begins to stretch when the
    handle pulls with more than P.  In parallel, spring 1 is compressed between the contact and the
    handle with P, which spring 2 balances at x = 0; after a way P/k1 of the handle spring 1 is
    slack, and its end follows the handle.

    Parameters
    ----------
    place : displacement x of the handle from the place where no force is needed [m], (n,)
    rate : dx/dt [m/s]
    acceleration : not used, since statics does not depend on it [m/s^2]
    stiffness1 : k1 of the prestressed spring [N/m]
    stiffness2 : k2 of the other spring [N/m]
    preload : force P of spring 1 on its contact at x = 0 [N]
    connection : "series" or "parallel"

    Returns
    -------
    dict of (n,) arrays: force F [N]; gap, the distance of the end of spring 1 from its contact [m],
    and gap_rate [m/s]; contact, the force of the contact [N]; stretch1, stretch2, the stretches of
    the springs (in parallel stretch1 is a compression) [m], and stretch2_rate [m/s]; slope dF/dx
    [N/m]; energy of both springs [J].

    Raises
    ------
    ValueError
        A stiffness is not positive, the preload is negative, the connection is unknown, or a place
        or rate is not finite.

    Notes
    -----
    Accuracy: rounding.  At the release the slope is the one before it, and gap_rate is 0.  Source:
    van Nes 2022, equations 1 and 2 and figure 2 (text lines 691-700), which has no numbers.

    Examples
    --------
    >>> pulled = solve([0.01, 0.05], stiffness1=100.0, stiffness2=300.0, preload=6.0,
    ...     connection="series")
    >>> pulled["force"].round(9).tolist(), pulled["slope"].tolist()
    ([3.0, 8.25], [300.0, 75.0])
    >>> pushed = solve([0.01, 0.05], stiffness1=200.0, stiffness2=100.0, preload=8.0,
    ...     connection="parallel")
    >>> pushed["force"].round(9).tolist(), pushed["slope"].tolist()
    ([3.0, 13.0], [300.0, 100.0])
    """
    check_parameters(stiffness1, stiffness2, preload, connection)
    k1, k2 = stiffness1, stiffness2
    x, v = np.broadcast_arrays(*(np.asarray(each, float) for each in (place, rate)))
    check_finite(place=x, rate=v)
    series = connection == "series"
    excess = k2 * x - preload if series else k1 * x - preload
    gap_share = k2 / (k1 + k2) if series else 1.0  # derivative of the gap by the handle's way
    gap = np.maximum(excess, 0.0) / (k1 + k2 if series else k1)
    gap_rate = np.where(excess > 0.0, gap_share * v, 0.0)
    before, after = slopes(k1, k2, connection)
    if series:
        stretch1, stretch2 = preload / k1 + gap, x - gap
        force, stretch2_rate = k2 * stretch2, v - gap_rate
    else:
        stretch1, stretch2 = np.maximum(-excess, 0.0) / k1, preload / k2 + x
        force, stretch2_rate = k2 * stretch2 - k1 * stretch1, v
    return {
        "force": force,
        "gap": gap,
        "gap_rate": gap_rate,
        "contact": np.maximum(-excess, 0.0),
        "stretch1": stretch1,
        "stretch2": stretch2,
        "stretch2_rate": np.array(stretch2_rate),
        "slope": np.where(excess > 0.0, after, before),
        "energy": 0.5 * (k1 * stretch1**2 + k2 * stretch2**2),
    }


def check_parameters(stiffness1: float, stiffness2: float, preload: float, connection: str) -> None:
    """Raise a ValueError for the first parameter out of its domain."""
    check_positive("N/m", stiffness1=stiffness1, stiffness2=stiffness2)
    check_not_negative("N", preload=preload)
    if connection not in CONNECTIONS:
        raise ValueError(f"connection must be one of {', '.join(CONNECTIONS)}, got {connection!r}")


def slopes(k1: float, k2: float, connection: str) -> tuple[float, float]:
    """Slopes dF/dx before and after the release [N/m]."""
    if connection == "series":
        return k2, k1 * k2 / (k1 + k2)
    return k1 + k2, k2


def events(
    stiffness1: float, stiffness2: float, preload: float, connection: str
) -> dict[str, float]:
    """Place of the handle where the contact releases, P/k2 in series, P/k1 in parallel [m]."""
    check_parameters(stiffness1, stiffness2, preload, connection)
    return {"release": preload / (stiffness2 if connection == "series" else stiffness1)}


def properties(
    stiffness1: float, stiffness2: float, preload: float, connection: str
) -> dict[str, str]:
    """Describe the release and both stiffnesses for the report's page."""
    (release,) = events(stiffness1, stiffness2, preload, connection).values()
    before, after = slopes(stiffness1, stiffness2, connection)
    return {
        "release": f"at {release:.6g} m",
        "stiffness": f"{before:.6g} N/m before, {after:.6g} N/m after",
    }


class SpringRelease(ClosedForm, function=solve, properties=properties):
    """Two springs in series or in parallel, one of them prestressed on a contact that releases."""

    marks = (events,)

    stiffness1: Annotated[float, Quantity("N/m", Domain.POSITIVE)]
    stiffness2: Annotated[float, Quantity("N/m", Domain.POSITIVE)]
    preload: Annotated[float, Quantity("N", Domain.NOT_NEGATIVE)]
    connection: Annotated[str, OneOf(("series", "parallel"))]
