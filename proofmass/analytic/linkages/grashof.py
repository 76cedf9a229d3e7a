"""What a four-bar linkage can do: Grashof class, crank range, dead centres, transmission angles."""

import numpy as np

from proofmass.analytic.linkages.fourbar import MODES, _slack, margins
from proofmass.analytic.numerics import TURN, Array, one_of, positive

SHORTEST = {"crank": "crank-rocker", "coupler": "double rocker", "rocker": "rocker-crank",
            "ground": "double crank"}


def margin(*, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Grashof margin (p + q) - (s + l) [m]: the middle two lengths less the shortest and longest.

    Positive: the shortest bar turns fully against all others. Zero, to within 4 eps of the sum of
    the lengths: change point. Negative: no bar turns fully against another.

    ValueError if a length is not positive, or if one is longer than the other three together, so
    that the loop closes nowhere. Source: A. Avello, Teoría de máquinas, as given by B. Díaz Lozano,
    TFG, Universidad de Almería 2019, text lines 950-1008; its program does not tell equality apart.

    >>> margin(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)
    0.5
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    positive(**lengths)
    shortest, p, q, longest = sorted(lengths.values())
    if longest > shortest + p + q:
        name = max(lengths, key=lambda bar: lengths[bar])
        raise ValueError(f"{name} must not be longer than the other bars together: the loop cannot "
                         f"close, they miss by {longest - (shortest + p + q):.6g} m")
    room = (p + q) - (shortest + longest)
    return room if abs(room) > _slack(**lengths) else 0.0


def classify(*, crank: float, coupler: float, rocker: float, ground: float) -> str:
    """Grashof class by the place of the shortest bar.

    ::

        margin > 0   shortest  crank   crank-rocker   the crank turns, the rocker swings
                               rocker  rocker-crank   the rocker turns, the crank swings
                               ground  double crank   both turn
                               coupler double rocker  both swing, the coupler turns
        margin = 0   change point                     all bars come into line
        margin < 0   triple rocker                    nothing turns

    Lengths [m] and errors as in `margin`.

    >>> classify(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)
    'crank-rocker'
    >>> classify(crank=2.0, coupler=2.0, rocker=2.5, ground=3.0)
    'triple rocker'
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    room = margin(**lengths)
    if room == 0.0:
        return "change point"
    return SHORTEST[min(lengths, key=lambda bar: lengths[bar])] if room > 0.0 else "triple rocker"


def crank_range(
    *, crank: float, coupler: float, rocker: float, ground: float
) -> tuple[float, float]:
    r"""Crank angles that can be reached: low <= |angle| <= high, within [0, pi] [rad].

    ::

        sin^2(low/2) = ((c - r)^2 - (crank - ground)^2)/k^2        k^2 = 4 crank ground
        cos^2(high/2) = ((crank + ground)^2 - (c + r)^2)/k^2

    with c = coupler, r = rocker, and low = 0 or high = pi where the right side is negative. A
    crank that turns fully has (0, pi). One that has 0 < low and high < pi moves in one of two
    intervals, mirror images that need reassembly. At both limits coupler and rocker are in line.

    Lengths [m] and errors as in `margin`. Accuracy: rounding; next to 0 or pi half of the digits.

    >>> [round(limit, 6) for limit in crank_range(crank=2.0, coupler=2.0, rocker=2.5, ground=3.0)]
    [0.0, 2.219516]
    """
    margin(crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    outer, inner = margins(crank, coupler, rocker, ground)
    return _limits(-inner, -outer, 4.0 * crank * ground)


def dead_centres(
    *, crank: float, coupler: float, rocker: float, ground: float, mode: int = 1
) -> tuple[Array, Array]:
    r"""Poses in which crank and coupler are in line, so that the rocker stands still.

    ::

                 Q               Q            stretched, A-Q = crank + coupler: crank angle g
               /  \             /  \          folded, A-Q = coupler - crank > 0: crank angle g + pi,
             P     \           /    \         or A-Q = crank - coupler > 0: crank angle g
           /        \         /      \
         A --------- B       A ------ B       g = angle Q-A-B
           stretched       P  folded

    The rocker angle is pi less the angle A-B-Q; g and it change sign with the side of Q.

    Returns the crank angles in [0, 2 pi) and the rocker angles in [-pi, pi], each (2,): first
    stretched, then folded [rad]. NaN: that pose does not exist, or the rocker runs through it: Q
    lies in A, or all bars are in line (change point).

    Q lies left of A-B for mode 1 and right of it for mode -1; the other way round folded with a
    coupler shorter than the crank. With a change point `mode` is that at the dead centre. Lengths
    [m] and errors as in `margin`.

    >>> turns, ends = dead_centres(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0, mode=-1)
    >>> [[round(float(x), 4) for x in np.degrees(angles)] for angles in (turns, ends)]
    [[310.7514, 128.6822], [-114.6243, -161.8051]]
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    positive(**lengths)
    one_of(MODES, mode=mode)
    margin(**lengths)
    e = np.array([coupler + crank, abs(coupler - crank)])
    room = np.minimum(ground + rocker - e, e - abs(ground - rocker))  # of the triangle A-B-Q
    e = np.where(room > _slack(**lengths), e, np.nan)
    at_crank = np.arccos((ground**2 + e**2 - rocker**2) / (2.0 * ground * e))
    at_rocker = np.arccos((ground**2 + rocker**2 - e**2) / (2.0 * ground * rocker))
    side = mode * np.array([1.0, np.sign(coupler - crank)])
    folded = np.array([0.0, np.pi if coupler > crank else 0.0])
    return (side * at_crank + folded) % TURN, side * (np.pi - at_rocker)


def swing(*, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Angle [rad] through which the rocker of a crank-rocker swings, the same in both modes.

    Lengths [m]; ValueError for any other class, besides the errors of `margin`.

    >>> round(float(np.degrees(swing(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0))), 4)
    47.1808
    """
    _, ends = _crank_rocker(crank, coupler, rocker, ground)
    return float(abs(ends[0] - ends[1]))


def time_ratio(*, crank: float, coupler: float, rocker: float, ground: float) -> float:
    """Time of the slower swing of a crank-rocker over that of the faster one, at constant speed.

    It is the ratio of the two crank turns between the dead centres, the same in both modes.
    Lengths [m]; ValueError for any other class, besides the errors of `margin`.

    >>> round(time_ratio(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0), 6)
    1.023258
    """
    turns, _ = _crank_rocker(crank, coupler, rocker, ground)
    part = float(abs(turns[0] - turns[1]))
    return max(part, TURN - part) / min(part, TURN - part)


def transmission_range(
    *, crank: float, coupler: float, rocker: float, ground: float
) -> tuple[float, float]:
    r"""Smallest and largest angle between coupler and rocker [rad], over the reachable crank range.

    It rises with the crank angle from 0 to pi, so these are its values at the ends of
    `crank_range`::

        sin^2(smallest/2) = ((crank - ground)^2 - (c - r)^2)/(4 c r)
        cos^2(largest/2) = ((c + r)^2 - (crank + ground)^2)/(4 c r)

    with c = coupler, r = rocker, and 0 or pi where the right side is negative. Lengths [m] and
    errors as in `margin`; accuracy as in `crank_range`.

    >>> ends = transmission_range(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)
    >>> [round(float(end), 6) for end in np.degrees(ends)]
    [51.317813, 125.099632]
    """
    margin(crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    outer, inner = margins(crank, coupler, rocker, ground)
    return _limits(inner, outer, 4.0 * coupler * rocker)


def facts(*, crank: float, coupler: float, rocker: float, ground: float,
          **_: float) -> dict[str, str]:
    """What a drawing's lengths amount to, in words and degrees, for a report.

    >>> facts(crank=1.0, coupler=2.0, rocker=2.5, ground=3.0)["time ratio"]
    '1.0233'
    """
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    low, high = np.degrees(crank_range(**lengths))
    least, most = np.degrees(transmission_range(**lengths))
    found = {"Grashof class": f"{classify(**lengths)}, margin {margin(**lengths):.4g} m",
             "crank": "turns fully" if (low, high) == (0.0, 180.0) else
             f"reaches {low:.2f}° to {high:.2f}° on either side",
             "transmission angle": f"{least:.2f}° to {most:.2f}°"}
    if classify(**lengths) == "crank-rocker":
        found["rocker swings"] = f"{np.degrees(swing(**lengths)):.2f}°"
        found["time ratio"] = f"{time_ratio(**lengths):.4f}"
    return found


def _limits(sine: float, cosine: float, whole: float) -> tuple[float, float]:
    """Angles with sin^2(first/2) = sine/whole, cos^2(second/2) = cosine/whole, cut to [0, pi]."""
    first, second = np.sqrt(np.clip([sine / whole, cosine / whole], 0.0, 1.0))
    return float(2.0 * np.arcsin(first)), float(2.0 * np.arccos(second))


def _crank_rocker(
    crank: float, coupler: float, rocker: float, ground: float
) -> tuple[Array, Array]:
    """Dead centres of a crank-rocker, or ValueError for any other class."""
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker, "ground": ground}
    found = classify(**lengths)
    if found != "crank-rocker":
        raise ValueError(f"the lengths must make a crank-rocker, these make a {found}")
    return dead_centres(**lengths, mode=1)
