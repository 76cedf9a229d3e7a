"""The balancer that was built: its springs as designed, as ordered and as measured."""

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import precision_points, work_reduction

Array = NDArray[np.float64]
Springs = Literal["design", "catalogue", "measured"]

PENDULUM = 0.5  # [m]
WEIGHT = 4.0 * 0.029321787763455  # m g [N], of the pendulum that it would balance
LENGTHS = (0.169688515618415, 0.228633988560994, 0.237607657307662)  # [m]
REST_ANGLE = 0.664071011410003  # [rad]
DESIGN_RATIOS = (1.498937760758821, 4.847839773931474)  # k_1/k_2 and k_3/k_2 of the optimum
# Flat spiral springs by part number [N m/rad]: Table J.1 prints 0.037, 0.025 and 0.082. These are
# what the measured values and the deviations of Table J.2 go back to, and give its ratios.
CATALOGUE_STIFFNESS = {"907": 0.037241, "903": 0.024637, "908": 0.081929}
# Springs of each axis, in pairs wound against each other: part, problem, stiffness [N m/rad].
MOUNTED_SPRINGS = (
    (("907", "iv", 0.03732627), ("907", "v", 0.03755394)),
    (("903", "ii", 0.0217042), ("903", "iii", 0.021610197)),
    (
        ("907", "iii", 0.035792513),
        ("907", "vi", 0.03678242),
        ("908", "ii", 0.071335373),
        ("908", "iii", 0.068828657),
    ),
)
# Degree 5 in degrees, highest first [N m]; the print has 4.4283e-10 for the first.
EXPECTED_COEFFICIENTS = (4.4283e-11, -8.2536e-09, 4.8168e-07, -1.4378e-05, 0.0011225, -0.00029428)


class Reduction(NamedTuple):
    """A work reduction [%] with the balancer's curve and the reference that it belongs to."""

    percent: float
    curve: str
    reference: str


# Printed by the thesis. Its abstract compares the two, but their references differ.
PRINTED_REDUCTIONS = (
    Reduction(99.33, "design", "sine"),  # Table M.2, line 1766, by search on a grid
    Reduction(93.47, "ten measured runs", "expected"),  # lines 2283-2331
)


def stiffnesses(springs: Springs = "measured") -> tuple[float, float, float]:
    """Stiffness [N m/rad] on axes 1 to 3: the sum of the springs mounted on each.

    "design" has the ratios of the optimum and the sum ordered for axis 1; "catalogue" has the
    springs as ordered, "measured" as delivered: k_1/k_2 = 1.73 for 1.50. Table I prints 0.037,
    0.025 and 0.12 for the prototype: **half** of what is mounted, one spring of each pair.

    Source: van Nes 2022, lines 881-913, 2202-2281, 2369-2373; Tables I, J.1 and J.2.

    >>> [round(k, 4) for k in stiffnesses()]
    [0.0749, 0.0433, 0.2127]
    """
    if springs == "design":
        first, (r1, r2) = (
            sum(CATALOGUE_STIFFNESS[part] for part, _, _ in MOUNTED_SPRINGS[0]),
            DESIGN_RATIOS,
        )
        return first, first / r1, first / r1 * r2
    if springs not in ("catalogue", "measured"):
        raise ValueError(f"springs must be design, catalogue or measured, got {springs!r}")
    one, two, three = (
        sum(
            CATALOGUE_STIFFNESS[part] if springs == "catalogue" else found
            for part, _, found in axis
        )
        for axis in MOUNTED_SPRINGS
    )
    return one, two, three


def parameters(springs: Springs = "measured") -> dict[str, Any]:
    """Parameters of the prototype for `proofmass.analytic.balancer.solve`; no weight: it lay flat.

    The elbow is up, the pendulum `PENDULUM` long. The sine of its design is a moment of `WEIGHT`
    times `PENDULUM` times sin(angle), 0.0586 N m at the end. Its lengths are half those of the
    optimum of line 1766. Van Nes 2022, listing N.3, lines 2369-2387.

    >>> parameters()["length1"] / PENDULUM
    0.33937703123683
    """
    found = {"pendulum": PENDULUM, "rest_angle": REST_ANGLE}
    for i, (length, stiffness) in enumerate(zip(LENGTHS, stiffnesses(springs), strict=True), 1):
        found |= {f"length{i}": length, f"stiffness{i}": stiffness}
    return found


def expected_moment(angle: ArrayLike) -> Array:
    r"""Polynomial [N m] that the thesis compared its measurement with: a fit of its model.

    ::

        4.4283e-11 x^5 - 8.2536e-9 x^4 + 4.8168e-7 x^3 - 1.4378e-5 x^2 + 1.1225e-3 x - 2.9428e-4

    `angle` [rad] (...), 0 to pi/2; x is the angle in degrees. Within 2e-4 N m of the model with the
    measured springs, and **not** the sine. Source: van Nes 2022, lines 2298-2303, whose first
    coefficient, 4.4283e-10, is ten times too large: 2.41 N m at 90 degrees.

    >>> round(float(expected_moment(np.pi / 2)), 4)
    0.0554
    """
    return np.asarray(np.polyval(EXPECTED_COEFFICIENTS, np.degrees(angle)))


def reductions() -> tuple[Reduction, ...]:
    """Work reductions of the models of the prototype, each with its reference.

    Against the sine they are 99.30 % as designed, 99.14 % with catalogue springs and 92.33 % with
    the measured springs. The printed 93.47 % of the experiment is against `expected_moment`, a fit
    of the last of these models, so it does not measure how well a sine is balanced: by the triangle
    inequality the same measurement is between 86.3 and 98.3 % against the sine.

    At 90 precision points. Van Nes 2022, eq. 34, lines 2283-2331 and abstract.

    >>> [(round(each.percent, 2), each.curve, each.reference) for each in reductions()][2:4]
    [(92.33, 'measured', 'sine'), (92.31, 'expected', 'sine')]
    """
    angle = precision_points(90)
    sine, expected = WEIGHT * PENDULUM * np.sin(angle), expected_moment(angle)
    models = {
        springs: solve(angle, **parameters(springs))["balancing_moment"]
        for springs in ("design", "catalogue", "measured")
    }
    curves = [(name, moment, "sine", sine) for name, moment in models.items()]
    curves += [
        ("expected", expected, "sine", sine),
        ("measured", models["measured"], "expected", expected),
    ]
    return tuple(
        Reduction(float(work_reduction(moment, reference, angle)), name, against)
        for name, moment, against, reference in curves
    )
