r"""Settings of MuJoCo worth scanning, how errors should fall with them, and what changes an error.

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

A recorded reference is not asked at the state that the drives really had: it sees what the
integrator does without a loop as well.

A jolt is a start under load or in motion, from loops that are neither strained nor moving.
"""

from collections.abc import Callable, Iterator
from typing import Any

from proofmass.sim.contents import may_touch, rubs
from proofmass.sim.mujoco.settings import ENGINE_DEFAULTS, limited
from proofmass.sim.protocol import (
    STEP,
    ParameterValue,
    ParameterValues,
    Perturbation,
    Recipe,
    Scan,
    Studied,
    leading,
    scan_over,
)

INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")
HARD = (0.9999, 0.9999, 0.001)  # solimp, as hard as MuJoCo lets it be
CAP = 0.9999  # MuJoCo takes no harder solimp
EXACT = 1e-15
"""Tolerance of the solver that rounding still meets; 0 makes every iteration that is allowed."""
STEPS_OF_SOLREF = 8  # fewer cost RK4 accuracy, more are softer
STAGES = {"RK4": 4}  # evaluations in a step, 1 for the others
IN_SOLREF = "too few steps in solref"
"""What the step alone moves on a scan whose loops get harder with it."""
SIZES: dict[str, Callable[[ParameterValue], float]] = {
    "timestep": leading,
    "solref": leading,
    "solimp": lambda d: 1.0 - leading(d),
}
LABELS = {"solref": "time constant, solref [s]", "solimp": "1 − solimp"}


def hard(solref: float) -> dict[str, ParameterValue]:
    """Loops with a time constant [s], and as hard as can be otherwise."""
    return {"solref": (solref, 1.0), "solimp": HARD}


def at_step(parameters: ParameterValues, step: float) -> dict[str, ParameterValue]:
    """Settings with another time step [s], and a `solref` that goes with it.

    >>> at_step({"timestep": 1e-3, "solref": (8e-3, 1.0)}, 5e-4)
    {'timestep': 0.0005, 'solref': (0.004, 1.0)}
    """
    scaled = dict(parameters, timestep=step)
    if isinstance(solref := parameters.get("solref"), tuple):
        scaled["solref"] = (leading(solref) * step / leading(parameters["timestep"]), *solref[1:])
    return scaled


def scans(title: str, about: Studied) -> Iterator[Scan]:
    """Over the step, one an integrator and a softness; and over what holds loops."""
    model, own = about.model, about.own_step
    loops = is_soft(about)

    def over(integrator: str, soft: int | None) -> Scan:
        parameters = tuple(
            {
                "timestep": h,
                "integrator": integrator,
                **(hard(soft * h) if soft else {"defaults": True}),
            }
            for h in about.timesteps(STAGES.get(integrator, 1))
        )
        held = f", solref {soft} steps" if soft else ", default softness"
        return Scan(f"{title} {integrator}{held * loops}", "timestep", parameters)

    yield from (over(integrator, None) for integrator in INTEGRATORS)
    at = f"{title} RK4 at {1e3 * own:g} ms"
    plain: dict[str, ParameterValue] = {"timestep": own, "integrator": "RK4"}
    if may_touch(model):
        for cone in ("pyramidal", "elliptic"):
            yield scan_over(
                {**plain, "cone": cone},
                f"{at}, {cone} cone, impratio",
                "impratio",
                (1.0, 10.0, 100.0),
            )
    if may_touch(model) or rubs(model):
        yield scan_over(plain, f"{at}, noslip_iterations", "noslip_iterations", (1, 3, 10, 30))
    if not loops:
        return
    yield from (over(integrator, STEPS_OF_SOLREF) for integrator in INTEGRATORS)
    yield from (over("Euler", 2), over("RK4", 4))
    base = {**plain, **hard(STEPS_OF_SOLREF * own)}
    yield scan_over(
        base, f"{at}, solref", "solref", [(m * own, 1.0) for m in (64, 32, 16, 8, 4, 2)]
    )
    yield scan_over(
        {**base, "refsafe": False},
        f"{at}, refsafe off, solref",
        "solref",
        [(m * own, 1.0) for m in (1.5, 1.0, 0.75)],
    )  # with it, these would be 2 steps
    yield scan_over(
        base, f"{at}, solimp", "solimp", [(d, d, 0.001) for d in (0.9, 0.99, 0.999, 0.9999)]
    )
    step = about.quartered_step(STAGES["RK4"])
    at = f"{title} RK4 at {1e3 * step:.3g} ms"
    base = {**plain, "timestep": step, **hard(STEPS_OF_SOLREF * step)}
    for solver, counts in (
        ("Newton", (1, 2, 4)),
        ("CG", (1, 2, 4, 8)),
        ("PGS", (1, 2, 4, 8, 16, 32, 64)),
    ):
        yield scan_over(
            {**base, "solver": solver, "tolerance": 0.0},
            f"{at}, {solver} iterations",
            "iterations",
            counts,
        )
    yield scan_over(
        {**base, "solver": "CG", "tolerance": 0.0, "warmstart": False},
        f"{at}, CG without warm start, iterations",
        "iterations",
        (1, 2, 4, 8),
    )


def orders(scan: Scan, j: int, about: Studied) -> tuple[float, ...]:
    """Orders that a scan may show in the derivative j."""
    first = scan.settings[0]
    if scan.varied == "solimp":
        return (1.0,)
    if scan.varied == "solref":  # below two steps the spring itself is not resolved
        return () if first.get("refsafe") is False else softness(about, j)
    return of_step(scan, j, about) if scan.varied == "timestep" else ()


def of_step(scan: Scan, j: int, about: Studied) -> tuple[float, ...]:
    """Of the step."""
    fourth = scan.settings[0]["integrator"] == "RK4"
    own = (1.0, 2.0) if j == 1 and not about.held_to_drive else (1.0,)
    if fourth:  # a control is held over all stages of a step
        own = (2.0, 4.0) if about.controlled else (4.0,)
    scaled = len({each.get("solref") for each in scan.settings}) > 1
    if not (is_soft(about) and scaled):
        return own
    if fourth:
        return tuple(dict.fromkeys((2.0 - j, 2.0)))
    held = {0: (2.0,), 1: (1.0,), 2: (1.0, 2.0, *([0.0] * about.jolted()))}[j]
    return held if about.held_to_drive else (*own, *softness(about, j))


def is_soft(about: Studied) -> bool:
    """Whether loops or, of a motion that is let go, the limits of joints are soft."""
    return bool(about.model.neq) or rebounds(about)


def rebounds(about: Studied) -> bool:
    """Whether joints may be thrown back by limits, as exactly as steps resolve an impact."""
    return not about.driven and limited(about.model).size > 0


def softness(about: Studied, j: int) -> tuple[float, ...]:
    """Of the time constant of loops, and of limits: an impact takes a time in proportion to it."""
    if rebounds(about):
        return (1.0, 2.0)
    return tuple(dict.fromkeys((2.0 - j, 2.0))) if about.jolted() else (2.0,)


def perturbations(
    parameters: ParameterValues, about: Studied, scaled: bool
) -> Iterator[Perturbation]:
    """Step, softness of loops, solver."""
    model = about.model
    known: dict[str, Any] = {
        **(ENGINE_DEFAULTS if parameters.get("defaults") else {}),
        **parameters,
    }

    def but(**changed: ParameterValue) -> dict[str, ParameterValue]:
        return {**parameters, **changed}

    step = known.get("timestep", model.opt.timestep)
    yield Perturbation(
        IN_SOLREF if scaled else STEP,
        "halving the step" + ", solref as it is" * scaled,
        but(timestep=step / 2),
    )
    if not is_soft(about):
        return
    what, soft = "loops", (model.eq_solref, model.eq_solimp)
    if not model.neq:
        what, soft = "limits", (model.jnt_solref[limited(model)], model.jnt_solimp[limited(model)])
    tau, ratio = known.get("solref", soft[0][0])[:2]
    safe = tau / 2 >= 2 * step  # MuJoCo itself takes no less
    yield Perturbation(
        f"softness of the {what}",
        "halving solref" if safe else "doubling solref",
        but(solref=(tau / 2 if safe else 2 * tau, ratio)),
        safe,
    )
    low, high, *rest = known.get("solimp", soft[1][0])
    room = 1 - (1 - high) / 2 <= CAP
    factor = 0.5 if room else 2.0
    yield Perturbation(
        f"softness of the {what}, solimp",
        f"{'halving' if room else 'doubling'} 1 - solimp",
        but(solimp=(1 - factor * (1 - low), 1 - factor * (1 - high), *rest)),
        room,
    )
    more = 4 * known.get("iterations", model.opt.iterations)
    within = min(known.get("tolerance", model.opt.tolerance), EXACT)
    yield Perturbation(
        "the solver's iterations",
        "four times as many iterations",
        but(iterations=more, tolerance=within),
    )


def recipes(title: str, about: Studied) -> Iterator[Recipe]:
    """Integrators, and time constants of loops in steps."""
    loops = is_soft(about)

    def held(integrator: str, soft: int) -> Callable[[float], dict[str, ParameterValue]]:
        return lambda step: {"integrator": integrator, "solref": (soft * step, 1.0), "solimp": HARD}

    def by_itself(integrator: str) -> Callable[[float], dict[str, ParameterValue]]:
        return lambda step: {"integrator": integrator, "defaults": True}

    for integrator in INTEGRATORS:
        yield Recipe(
            f"{title} {integrator}{', default softness' * loops}",
            by_itself(integrator),
            integrator == ENGINE_DEFAULTS["integrator"],
        )
        if loops:
            for soft in (2, 4, 8, *((32, 128) if rebounds(about) else ())):
                yield Recipe(f"{title} {integrator}, solref {soft} steps", held(integrator, soft))
