"""Flexible rods in balls: a cantilever with a force across, and equilibria of two rods on a pin."""

import itertools
from collections.abc import Iterator
from math import inf

import numpy as np
from flint import acb, arb, arb_mat

from proofmass.analytic.rods.all_equilibria import solutions
from proofmass.analytic.rods.rod_pair import make_pair
from proofmass.base.arrays import Array
from tests.independent.balls.free_motions import Balls, incomplete_integral, jacobi_functions
from tests.independent.balls.loops import IMAGINARY, CaseNumbers, NotProven, column, unit_vector

BISECTIONS = 130
"""Halvings of the range of a modulus: below the precision of the balls."""
HALF_WIDTHS_OF_RODS = 1e-2, 1e-3, 1e-4, 1e-6, 1e-8
"""Half widths of the boxes of a pair of rods, tried from the first on [1]."""


def modulus_of_cantilever(b: arb, length: arb) -> arb:
    """The modulus k with K(k) - F(asin(1/(k sqrt 2)), k) = b L, which has exactly one root.

    The left side rises from 0 to infinity with k from sqrt(1/2) to 1; a change of its sign encloses
    the root.
    """

    def excess(k: arb) -> arb:
        phi = (1 / (k * arb(2).sqrt())).asin()
        return acb(k * k).elliptic_k().real - incomplete_integral("F", phi, k * k) - b * length

    low, high = (arb(0.5).sqrt() * (1 + arb(2) ** -40)).mid(), 1 - arb(2) ** -60
    if not (excess(low) < 0 < excess(high)):
        raise NotProven("the load is too small or too large for the enclosure of the modulus")
    for _ in range(BISECTIONS):
        middle = ((low + high) / 2).mid()
        value = excess(middle)
        if not (value < 0 or value > 0):
            break
        low, high = (middle, high) if value < 0 else (low, middle)
    return low.union(high)


def cantilever(p: CaseNumbers, x: Array) -> Iterator[Balls]:
    """A dead force P across a clamped rod: sin(theta) = 2 k^2 cd(v)^2 - 1, v = b (L - s).

    b^2 = P/EI.  Lengths count from the tip, where the elliptic integrals are finite.
    """
    length, stiffness, load = arb(p["length"]), arb(p["stiffness"]), arb(p["force_y"])
    b = (load / stiffness).sqrt()
    k = modulus_of_cantilever(b, length)
    m, other = k * k, (1 - k * k).sqrt()

    def wave(v: arb) -> tuple[arb, arb, arb]:
        """The functions sd and cd at v, and the elliptic integral of cd^2 but for its factor."""
        phi, sn, cn, dn = jacobi_functions(v, m)
        return sn / dn, cn / dn, incomplete_integral("E", phi, m) - m * sn * cn / dn

    clamp, _, energy = wave(b * length)
    for s in (arb(float(one)) for one in x):
        sd, cd, e = wave(b * (length - s))
        yield {
            "x": 2 * k * other * (clamp - sd) / b,
            "y": (b * s - 2 * (energy - e)) / b,
            "theta": (2 * m * cd * cd - 1).asin(),
            "m": stiffness * 2 * b * k * other * sd,
        }


def is_elliptic(p: CaseNumbers) -> bool:
    """Whether a rod has no load but one force to the left, as `cantilever` has."""
    names = "force_x", "moment", "weight_x", "weight_y", "follower_x", "follower_y", "theta0"
    p["branch"]  # chooses one of the equilibria, of which there is one here
    stiff = all(p.given.get(name, inf) == inf for name in ("axial", "shear"))
    return stiff and p.given["force_y"] > 0 and not any(p.given.get(name) for name in names)


Slopes = tuple[acb, acb]


def rod_chart(a: arb, q: arb) -> tuple[acb, acb, Slopes, Slopes]:
    """Tip and load of a rod of unit length and stiffness, and their slopes by `a` and q.

    The rod is clamped at the origin along +x and its tip is free of moment.  k = tanh(q) is the
    modulus and `a` the length in units of the load, L sqrt(P/EI); theta functions give the
    elliptic ones.
    """
    k, other = q.tanh(), 1 / q.cosh()
    quarter, conjugate = arb.pi() / (2 * arb(1).agm(other)), arb.pi() / (2 * arb(1).agm(abs(k)))
    z, tau = acb(a / (2 * quarter)), IMAGINARY * acb(conjugate / quarter)
    t1, t2, t3, t4 = (one.real for one in acb.modular_theta(z, tau))
    _, c2, c3, c4 = (one.real for one in acb.modular_theta(acb(0), tau))
    sn, cn, dn = c3 / c2 * t1 / t4, c4 / c2 * t2 / t4, c4 / c3 * t3 / t4
    slope = acb.modular_theta(z, tau, 1)[3].real
    second = (a * acb(k * k).elliptic_e().real + slope / t4 / 2) / quarter
    half = acb(k * cn / dn, other / dn)
    drift, rise = second - other * other * a, 2 * k * other * sn / dn
    turned = -2 * other * (cn + sn / dn * drift)
    along = acb(a - 2 * second + 2 * k * k * sn * cn / dn, rise)
    by_q = acb(
        2 * a * k * other * other - rise * turned / 2,
        -2 * other * (cn / (dn * dn) * drift - other * other * sn / dn),
    )
    back = acb((half * half).real, -(half * half).imag)
    tip, load = back * along / a, a * a * back
    return (
        tip,
        load,
        ((1 - tip) / a - IMAGINARY * rise * tip, back * by_q / a - IMAGINARY * turned * tip),
        (2 * load / a - IMAGINARY * rise * load, -IMAGINARY * turned * load),
    )


def pair_residuals(x: list[arb], p: CaseNumbers) -> tuple[list[arb], arb_mat]:
    """Distance of the tips and sum of the forces of two rods on a pin, and their derivatives.

    `x` has the two numbers of `rod_chart` of both rods.
    """
    (t1, f1, dt1, df1), (t2, f2, dt2, df2) = rod_chart(x[0], x[1]), rod_chart(x[2], x[3])
    one, two = ((IMAGINARY * acb(arb(p[name]))).exp() for name in ("theta1", "theta2"))
    length = arb(p["length"])
    unit = arb(p["stiffness"]) / (length * length)
    gap = one * t1 - two * t2 - arb(p["distance"]) / length
    force = one * f1 + two * f2 - p.complex("force_x", "force_y") / unit
    columns = [
        (one * dt1[0], one * df1[0]),
        (one * dt1[1], one * df1[1]),
        (-two * dt2[0], two * df2[0]),
        (-two * dt2[1], two * df2[1]),
    ]
    parts = [(j, part) for j in (0, 1) for part in ("real", "imag")]
    rows = [[getattr(two_of[j], part) for two_of in columns] for j, part in parts]
    return [gap.real, gap.imag, force.real, force.imag], arb_mat(rows)


def prove_pair(start: list[arb], p: CaseNumbers) -> tuple[list[arb], float]:
    """An equilibrium near a start, and the half width of the box in which it is the only one.

    Raises
    ------
    NotProven
        No box passes Krawczyk's test.
    """
    x, size = start, len(start)
    for _ in range(4):
        rest, slopes = pair_residuals(x, p)
        x = [(v - s).mid() for v, (s,) in zip(x, slopes.solve(column(rest)).tolist(), strict=True)]
    rest, slopes = pair_residuals(x, p)
    inverse = slopes.inv().mid()
    unit = arb_mat([unit_vector(k, size) for k in range(size)])
    for half_width in HALF_WIDTHS_OF_RODS:
        box = [one + arb(0, half_width) for one in x]
        offsets = column(a - b for a, b in zip(box, x, strict=True))
        try:
            spread = (unit - inverse * pair_residuals(box, p)[1]) * offsets
        except (ZeroDivisionError, ValueError):
            continue
        image = spread - inverse * column(rest)
        if all(
            a.contains_interior(b + c) for a, b, (c,) in zip(box, x, image.tolist(), strict=True)
        ):
            return x, half_width
    raise NotProven(f"no box about {[float(one) for one in x]} passes the test")


def prove_equilibria(parameters: dict[str, float]) -> list[tuple[list[arb], float]]:
    """The results of `prove_pair` for all equilibria that the search of the product finds.

    The signs of q, which the search does not give, are those with the smallest residual.
    """
    p = CaseNumbers(parameters)
    pair = make_pair(p["distance"], p["length"], p["stiffness"])
    angles, load = [p["theta1"], p["theta2"]], [p["force_x"], p["force_y"]]
    found = solutions(pair, inputs=angles, load=load, modes=3)
    proven = []
    for alpha, complement in zip(found.alpha, found.complement, strict=True):
        q = np.arccosh(1.0 / complement)
        starts = [
            [arb(float(one)) for one in (alpha[0], s * q[0], alpha[1], t * q[1])]
            for s, t in itertools.product((1, -1), repeat=2)
        ]
        start = min(starts, key=lambda x: max(float(abs(r).mid()) for r in pair_residuals(x, p)[0]))
        proven.append(prove_pair(start, p))
    return proven
