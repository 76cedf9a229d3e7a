"""Which (psi, k_rel, mode) a rod has: from its load and clamp moment, or from a sampled shape."""

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.numerics import TURN, Array, positive
from proofmass.analytic.rods.elliptic import bounds, stiff
from proofmass.analytic.rods.integrals import legendre

INFLECTION = 1e-6  # how far the tip may be from one, of a half wave


def of_load(
    n_x: ArrayLike, n_y: ArrayLike, m0: ArrayLike, *,
    theta0: ArrayLike = 0.0, length: float = 1.0, stiffness: float = 1.0,
    apart: float = INFLECTION,
) -> tuple[Array, Array, Array]:
    r"""psi, k_rel and mode of a rod with moment-free tip: the inverse of `tip`.

    With R and psi the load's size and direction from the clamp's tangent::

        k^2 = cos^2(psi/2) + m0^2/(4 R EI),    sign(k) = sign(m0)
        mode = 1 + (L sqrt(R/EI) - u)/(2 K),   u from the clamp to the first inflection

    Parameters
    ----------
    n_x, n_y : force on the tip [N] (...)
    m0 : moment at the clamp [N m] (...), not zero
    theta0 : angle of the clamp's tangent [rad]
    length, stiffness : L [m], EI [N m^2]
    apart : how far the tip may be from an inflection, as a share of a half wave

    Returns
    -------
    psi, k_rel, mode : ndarray (...)

    Raises
    ------
    ValueError
        A rod without inflections (k >= 1), or one whose tip is not at an inflection.

    Notes
    -----
    Digits of k_rel are lost like m0^2/(4 R EI) over 1 - k_min.  Not in Pérez Gámiz 2018, whose eq.
    35, 36 and 88 it inverts.

    Examples
    --------
    >>> psi, k_rel, mode = of_load(-3.2308774, -1.1634081, -0.6076388, stiffness=0.16493361431)
    >>> round(float(psi), 6), round(float(k_rel), 6), float(mode)
    (3.487228, -0.322258, 2.0)
    """
    positive(length=length)
    stiff(stiffness)
    fx, fy, m, turn = np.broadcast_arrays(
        *(np.asarray(v, float) for v in (n_x, n_y, m0, theta0)))
    size, psi = np.hypot(fx, fy), (np.arctan2(fy, fx) - turn) % TURN
    least, room = bounds(psi)
    excess = m * m / (4.0 * size * stiffness)
    k = np.sqrt(least**2 + excess)
    with np.errstate(divide="ignore", invalid="ignore"):  # psi = 0: no inflection
        k_rel = np.copysign(excess / (k + least) / room, m)
    if not np.all((np.abs(k_rel) < 1.0) & (m != 0.0)):
        raise ValueError("the rod has no inflection, or no moment at its clamp")
    other = np.sqrt(room * (1.0 - np.abs(k_rel)) * (1.0 + k))
    s = np.sin(0.5 * psi)
    sine, cosine = np.copysign(1.0, m) * np.cos(0.5 * psi) / k, np.sqrt(excess) / k
    first, _, quarter, _ = legendre(cosine / s, other * sine / s, other / s, other)
    mode = 1.0 + (length * np.sqrt(size / stiffness) - first) / (2.0 * quarter)
    whole = np.maximum(np.rint(mode), 1.0)
    off = np.abs(mode - whole)
    if not np.all(off <= apart):
        raise ValueError(f"the tip carries a moment: it is {np.max(off):.3g} of a half wave away "
                         f"from an inflection")
    return psi, k_rel, whole


def of_shape(
    s: ArrayLike, x: ArrayLike, y: ArrayLike, theta: ArrayLike, *, stiffness: float = 1.0,
) -> tuple[Array, Array, Array]:
    """psi, k_rel and mode of a rod sampled from clamp to tip, arc lengths s (n,), to O(spacing^2).

    The load is fitted to m = (tip - p) x n with m = EI theta' by differences; it is a first guess
    for Newton's method, good as long as the samples resolve the half waves.

    >>> from proofmass.analytic.rods.elliptic import shape
    >>> rod = shape(2.0, 0.4, 2, np.linspace(0.0, 1.0, 201))
    >>> [round(float(v), 2) for v in of_shape(np.linspace(0, 1, 201), rod["x"], rod["y"],
    ...                                       rod["theta"])]
    [2.0, 0.4, 2.0]
    """
    arc, px, py, angle = (np.asarray(v, float) for v in (s, x, y, theta))
    m = stiffness * np.gradient(angle, arc, edge_order=2)
    arms = np.stack([py - py[-1], px[-1] - px], axis=1)
    n = np.linalg.lstsq(arms, m, rcond=None)[0]
    return of_load(n[0], n[1], arms[0] @ n, theta0=angle[0], length=float(arc[-1] - arc[0]),
                   stiffness=stiffness, apart=0.25)
