"""Settings of pymunk that `trade` scans and `choose` tries, with their orders and stability limits.

The errors fall with the step h as follows:

    no bias                         h^2: positions advance with the old velocity, as in a leapfrog
    a bias of time constant T       h T.  Constraint violations are corrected with a delay of T,
                                    which damps a free motion: energy falls by h T^2 t.
                                    Accelerations are differences of rates; few iterations leave an
                                    error of h in rates, and may leave h^0 in accelerations
    contacts                        h at an impact, which is a step late; h^2 while a contact lasts
    dampers, servos with a rate     h: they use the rate before the step

Chipmunk's step of a spring and a damper is stable for z^2 up to 2 (1 + exp(2 zeta z)), with
z = h omega and the damping ratio zeta.
"""

from collections.abc import Callable, Iterator
from math import log
from typing import Any

import numpy as np
from mujoco import MjModel

from proofmass.base.arrays import Array
from proofmass.sim.contents import is_linear_in_joint, may_touch
from proofmass.sim.protocol.settings import ParameterValue, ParameterValues, first_number
from proofmass.sim.protocol.theory import Scheme
from proofmass.sim.protocol.tuning import STEP_CAUSE, Perturbation, Recipe, Scan, Studied, scan_over
from proofmass.sim.pymunk.dynamics import MAX_ITERATIONS
from proofmass.sim.pymunk.settings import CHIPMUNK_BIAS

CORRECTED_SHARES = (0.003, 0.01, 0.03)
"""Shares of a constraint violation that a step corrects: with larger shares, 3 to 10 iterations
diverge in many loops."""
SIZES: dict[str, Callable[[ParameterValue], float]] = {
    "timestep": first_number,
    "error_bias": lambda share: -1.0 / log(first_number(share)),
}
LABELS = {"error_bias": "time constant of the bias [s]"}


def scans(title: str, about: Studied) -> Iterator[Scan]:
    """Scans over the step, with proofmass's settings and Chipmunk's, over iterations and bias."""
    own, steps = about.own_step, about.timesteps()
    prefix = f"{title} at {1e3 * own:g} ms"
    free: dict[str, ParameterValue] = {"timestep": own, "error_bias": 0.0}
    yield scan_over(free, f"{title}, no bias", "timestep", steps)
    yield scan_over(
        {**free, "iterations": 30}, f"{title}, no bias, 30 iterations", "timestep", steps
    )
    yield scan_over({"defaults": True}, f"{title}, defaults", "timestep", steps)
    yield scan_over(free, f"{prefix}, iterations", "iterations", (10, 30, 100, 300, 1000))
    yield scan_over(
        {"timestep": own},
        f"{prefix}, bias",
        "error_bias",
        [CHIPMUNK_BIAS**k for k in (1, 2, 4, 8, 16, 32)],
    )


def orders(scan: Scan, derivative: int, about: Studied) -> tuple[float, ...]:
    """Orders that the errors of a scan may show; j as `derivative` in `Engine.orders`."""
    if scan.varied == "error_bias":
        braked = () if about.driven else (2.0,)
        return (1.0, *braked) if derivative < 2 else (1.0, *braked, 0.0)
    if scan.varied != "timestep":
        return ()
    if may_touch(about.model) or is_damped(about.model):
        return (1.0, 2.0)
    if not scan.settings[0].get("defaults"):
        return (2.0,)
    return (1.0,) if derivative < 2 else (1.0, 0.0)


def is_damped(model: MjModel) -> bool:
    """Whether dampers or servos depend on rates, for which Chipmunk is of first order."""
    servos = (a for a in range(model.nactuator) if is_linear_in_joint(model, a))
    return bool(
        model.dof_damping.any()
        or model.tendon_damping.any()
        or any(model.actuator_biasprm[a, 2] for a in servos)
    )


def perturbations(parameters: ParameterValues, about: Studied) -> Iterator[Perturbation]:
    """Settings with a change of the step, the bias or the iterations, one at a time."""
    known: dict[str, Any] = dict(parameters)
    step = known.get("timestep", about.model.opt.timestep)
    yield Perturbation(STEP_CAUSE, "halving the step", {**parameters, "timestep": step / 2})
    own = known.get("defaults")
    if bias := known.get("error_bias", CHIPMUNK_BIAS if own else 0.0):
        yield Perturbation(
            "bias of the loops", "halving its time constant", {**parameters, "error_bias": bias**2}
        )
        kept = {k: v for k, v in known.items() if k not in ("defaults", "iterations")}
        yield Perturbation(
            "bias of the loops",
            "taking it away, with iterations enough for that",
            {**kept, "error_bias": 0.0},
            whole=True,
        )
    more = 4 * known.get("iterations", 10 if own else MAX_ITERATIONS // 4)
    yield Perturbation(
        "the solver's iterations", f"{more} iterations", {**parameters, "iterations": more}
    )


def recipes(title: str) -> Iterator[Recipe]:
    """Chipmunk's defaults, no bias, and a bias that corrects a share of a violation in each step.

    With few iterations a run may diverge if a step corrects the whole constraint violation.
    Chipmunk's `error_bias` is the share that is left after a second.  With a fixed share for each
    step, shorter steps correct the violation faster, and the error falls by more than in proportion
    to the step.
    """
    yield Recipe(f"{title}, defaults", lambda step: {"defaults": True}, True)
    yield Recipe(f"{title}, no bias", lambda step: {"error_bias": 0.0})
    for iterations in (1, 3, 10, 30, 100, 300):

        def parameters(step: float, iterations: int = iterations) -> dict[str, ParameterValue]:
            return {"error_bias": 0.0, "iterations": iterations}

        yield Recipe(f"{title}, no bias, {iterations} iterations", parameters)
    for iterations in (3, 10):
        for share in CORRECTED_SHARES:

            def biased(
                step: float, iterations: int = iterations, share: float = share
            ) -> dict[str, ParameterValue]:
                return {"error_bias": bias_of_share(share, step), "iterations": iterations}

            yield Recipe(f"{title}, bias {share:g} a step, {iterations} iterations", biased)


def bias_of_share(share: float, step: float) -> float:
    """The `error_bias` with which a step [s] corrects a share of a constraint violation.

    Chipmunk's `error_bias` is the share of a violation that is left after 1 s.  The value is at
    least the smallest normal floating-point number.

    >>> bias_of_share(0.01, 1e-3), bias_of_share(0.01, 1e-6)
    (4.317124741065786e-05, 2.2250738585072014e-308)
    """
    return float(max((1.0 - share) ** (1.0 / step), np.finfo(float).tiny))


def chipmunk_step(z: float, zeta: float) -> Array:
    """Matrix of a step of Chipmunk for a spring and a damper, a `StepMap`.

    The position moves with the old velocity.  Then the spring acts with its force at the new
    position, and the damper with its exact solution.
    """
    damped_share = np.exp(-2.0 * zeta * z)
    return np.array([[1.0, 1.0], [-damped_share * z**2, damped_share * (1.0 - z**2)]])


ANY_VALUE = (0.0,)
SCHEMES = (
    Scheme(
        "pymunk",
        chipmunk_step,
        "z² = 2 (1 + exp 2ζz)",
        half_kick=True,
        tried={
            "spring": (0.0, 0.1, 0.3),
            "slide": ANY_VALUE,
            "chain": (5,),
            "pendulum": ANY_VALUE,
            "whirl": ANY_VALUE,
            "swing": (0.05,),
            "fade": (0.05,),
        },
    ),
)
