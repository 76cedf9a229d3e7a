r"""The order that theory expects of a line: how errors fall with what is turned along it.

With the step h, a loop held by a spring and damper of time constant tau (`solref`), the share 1 - d
of the open loop's acceleration that it lets through (`solimp`), and the derivative j of the place:
0 of positions, 1 of rates, 2 of accelerations:

    integrator, no loop             RK4 h^4; MuJoCo's others are semi-implicit, h.  From rest those
                                    are a leapfrog that is half a step early: rates h^2
    softness of a loop              (1 - d) tau^2; after a jolt (1 - d) tau^(2-j) as well
    semi-implicit in a loop         with kappa = J' v in q'' = - b q' - k q - kappa, b = 2/tau and
                                    k = 1/tau^2, it settles h tau kappa off, its rate h kappa / 2;
                                    accelerations h, h tau; after a jolt h tau^(1-j) as well, until
                                    it has died away, as exp(-t / tau)
    RK4 in a loop                   (h / tau)^4 tau^(2-j), beside its softness
    Chipmunk without bias           h^2: positions advance with the old velocity, a leapfrog
    with a bias of time constant T  h T; accelerations, differences of rates of which few iterations
                                    leave an error of h, may keep an error of h^0.  The gap is late
                                    by T, which brakes what is let go: energy falls by h T^2 t
    rod as a chain of n segments    n^-2; n^-1 with the naive springs

A recorded reference is not asked at the state that the drives really had: it sees what the
integrator does without a loop as well.

A jolt is a start under load or in motion, from loops that are neither strained nor moving.
"""

from proofmass.case import Case
from proofmass.recorded import Recorded
from proofmass.reference import compiled, grid, laws, module_of
from proofmass.strict import Kind
from proofmass.studies.trade.axes import Line

DERIVATIVE = {"position": 0, "energy": 1, "rate": 1, "acceleration": 2, "effort": 2}
WITHIN = 0.2
"""What an observed order may be off by: the next term of an expansion, a tenth of the error, turns
second order into 1.9 to 2.1 and fourth order into 3.8 to 4.2."""


def expected(case: Case, run: Kind, line: Line, kind: str) -> tuple[float, ...]:
    """Orders that a line may show in one kind of error, any of its terms being the largest.

    Nothing where theory promises none; 0 is a floor from the start on.
    """
    j, axis = DERIVATIVE[kind], line.axis
    if len(line.settings) < 2:  # one setting shows no order
        return ()
    if axis == "segments":
        return (1.0,) if any(rod.scheme == "naive" for rod in case.rod.values()) else (2.0,)
    if axis == "solimp":
        return (1.0,)
    if axis == "error_bias":
        braked = () if case.drive else (2.0,)
        return (1.0, *braked) if j < 2 else (1.0, *braked, 0.0)
    if axis == "solref":  # below two steps the spring itself is not resolved
        return () if line.settings[0].knobs.get("refsafe") is False else softness(case, j)
    if axis == "timestep":
        return in_pymunk(line, j) if line.engine == "pymunk" else in_mujoco(case, line, j)
    return ()


def in_pymunk(line: Line, j: int) -> tuple[float, ...]:
    """Of the step in Chipmunk."""
    if not line.settings[0].knobs.get("defaults"):
        return (2.0,)
    return (1.0,) if j < 2 else (1.0, 0.0)


def in_mujoco(case: Case, line: Line, j: int) -> tuple[float, ...]:
    """Of the step in MuJoCo."""
    fourth = line.settings[0].knobs["integrator"] == "RK4"
    held_to_drive = bool(case.drive) and not isinstance(module_of(case), Recorded)
    own = (4.0,) if fourth else (1.0, 2.0) if j == 1 and not held_to_drive else (1.0,)
    if not (compiled(case).neq and line.scaled):
        return own
    if fourth:
        return tuple(dict.fromkeys((2.0 - j, 2.0)))
    held = {0: (2.0,), 1: (1.0,), 2: (1.0, 2.0, 0.0) if jolted(case) else (1.0, 2.0)}[j]
    return held if held_to_drive else (*own, *softness(case, j))


def softness(case: Case, j: int) -> tuple[float, ...]:
    """Of the time constant of loops."""
    return tuple(dict.fromkeys((2.0 - j, 2.0))) if jolted(case) else (2.0,)


def jolted(case: Case) -> bool:
    """Whether a duration starts under gravity or in motion."""
    start = grid(case, "duration")[:1]
    moving = any(abs(part).max() > 0 for law in laws(case, "duration") for part in law(start)[1:])
    return moving or bool(compiled(case).opt.gravity.any())


def nearest(orders: tuple[float, ...], observed: float) -> float:
    """The expected order that is nearest to the observed one, the first if none was; NaN if none.

    >>> nearest((2.0, 1.0), 1.1), nearest((2.0, 1.0), float("nan"))
    (1.0, 2.0)
    """
    if observed != observed:
        return orders[0] if orders else float("nan")
    return min(orders, key=lambda order: abs(order - observed), default=float("nan"))


def off(observed: float, wanted: float) -> bool:
    """Whether a line shows another order than theory expects.

    >>> off(1.9, 2.0), off(1.5, 2.0), off(float("nan"), 2.0)
    (False, True, False)
    """
    return abs(observed - wanted) > WITHIN
