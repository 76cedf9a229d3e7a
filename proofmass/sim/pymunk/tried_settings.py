"""What `trade` scans and `choose` tries in pymunk, the orders and limits that theory expects.

With the step h and the derivative j of the place:

    without bias                    h^2: positions advance with the old velocity, a leapfrog
    with a bias of time constant T  h T; accelerations, differences of rates of which few iterations
                                    leave an error of h, may keep an error of h^0.  The gap is late
                                    by T, which brakes what is let go: energy falls by h T^2 t
    contacts                        h at an impact, which is a step late; h^2 while one lasts
    dampers, servos with a rate     h: they take the rate from before the step

Chipmunk steps a spring and a damper stably for z^2 up to 2 (1 + exp(2 zeta z)), with z = h omega
and the damping ratio zeta.
"""

from collections.abc import Callable, Iterator
from math import log
from typing import Any

import numpy as np
from mujoco import MjModel

from proofmass.analytic.numerics import Array
from proofmass.sim.contents import follows_joint, may_touch
from proofmass.sim.protocol import (
    STEP,
    ParameterValue,
    ParameterValues,
    Perturbation,
    Recipe,
    Scan,
    Scheme,
    Studied,
    leading,
    scan_over,
)
from proofmass.sim.pymunk.dynamics import MOST
from proofmass.sim.pymunk.settings import CHIPMUNK_BIAS

CLOSED = (0.003, 0.01, 0.03)
"""Shares of a gap that a step closes: with more, 3 to 10 iterations diverge in many loops."""
SIZES: dict[str, Callable[[ParameterValue], float]] = {
    "timestep": leading,
    "error_bias": lambda share: -1.0 / log(leading(share)),
}
LABELS = {"error_bias": "time constant of the bias [s]"}


def scans(title: str, about: Studied) -> Iterator[Scan]:
    """Over the step, tuned and as Chipmunk comes; and over what closes loops."""
    own, steps = about.own_step, about.timesteps()
    at = f"{title} at {1e3 * own:g} ms"
    free: dict[str, ParameterValue] = {"timestep": own, "error_bias": 0.0}
    yield scan_over(free, f"{title}, no bias", "timestep", steps)
    yield scan_over(
        {**free, "iterations": 30}, f"{title}, no bias, 30 iterations", "timestep", steps
    )
    yield scan_over({"defaults": True}, f"{title}, defaults", "timestep", steps)
    yield scan_over(free, f"{at}, iterations", "iterations", (10, 30, 100, 300, 1000))
    yield scan_over(
        {"timestep": own},
        f"{at}, bias",
        "error_bias",
        [CHIPMUNK_BIAS**k for k in (1, 2, 4, 8, 16, 32)],
    )


def orders(scan: Scan, j: int, about: Studied) -> tuple[float, ...]:
    """Orders that a scan may show in the derivative j."""
    if scan.varied == "error_bias":
        braked = () if about.driven else (2.0,)
        return (1.0, *braked) if j < 2 else (1.0, *braked, 0.0)
    if scan.varied != "timestep":
        return ()
    if may_touch(about.model) or is_damped(about.model):
        return (1.0, 2.0)
    if not scan.settings[0].get("defaults"):
        return (2.0,)
    return (1.0,) if j < 2 else (1.0, 0.0)


def is_damped(model: MjModel) -> bool:
    """Whether forces of dampers or servos go with rates, which Chipmunk takes at first order."""
    servos = (a for a in range(model.nactuator) if follows_joint(model, a))
    return bool(
        model.dof_damping.any()
        or model.tendon_damping.any()
        or any(model.actuator_biasprm[a, 2] for a in servos)
    )


def perturbations(parameters: ParameterValues, about: Studied) -> Iterator[Perturbation]:
    """Step, bias, iterations."""
    known: dict[str, Any] = dict(parameters)
    step = known.get("timestep", about.model.opt.timestep)
    yield Perturbation(STEP, "halving the step", {**parameters, "timestep": step / 2})
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
    more = 4 * known.get("iterations", 10 if own else MOST // 4)
    yield Perturbation(
        "the solver's iterations", f"{more} iterations", {**parameters, "iterations": more}
    )


def recipes(title: str) -> Iterator[Recipe]:
    """Chipmunk's defaults, loops without bias, and with a share of their gap closed in a step.

    Few iterations diverge where a step closes all of it.  Chipmunk's `error_bias` is a share of a
    second; with a share of a step the gap is closed faster with shorter steps, and the error falls
    by more than in proportion to them.
    """
    yield Recipe(f"{title}, defaults", lambda step: {"defaults": True}, True)
    yield Recipe(f"{title}, no bias", lambda step: {"error_bias": 0.0})
    for iterations in (1, 3, 10, 30, 100, 300):

        def parameters(step: float, iterations: int = iterations) -> dict[str, ParameterValue]:
            return {"error_bias": 0.0, "iterations": iterations}

        yield Recipe(f"{title}, no bias, {iterations} iterations", parameters)
    for iterations in (3, 10):
        for share in CLOSED:

            def biased(
                step: float, iterations: int = iterations, share: float = share
            ) -> dict[str, ParameterValue]:
                return {"error_bias": left_after(share, step), "iterations": iterations}

            yield Recipe(f"{title}, bias {share:g} a step, {iterations} iterations", biased)


def left_after(share: float, step: float) -> float:
    """Chipmunk's `error_bias`, the share of a gap left after 1 s, that closes one of it in a step.

    It is at least the least number that has all its digits.

    >>> left_after(0.01, 1e-3), left_after(0.01, 1e-6)
    (4.317124741065786e-05, 2.2250738585072014e-308)
    """
    return float(max((1.0 - share) ** (1.0 / step), np.finfo(float).tiny))


def chipmunk(z: float, zeta: float) -> Array:
    """The old velocity moves the position; then the spring acts, and the damper, exactly."""
    left = np.exp(-2.0 * zeta * z)
    return np.array([[1.0, 1.0], [-left * z**2, left * (1.0 - z**2)]])


ONE = (0.0,)
SCHEMES = (
    Scheme(
        "pymunk",
        chipmunk,
        "z² = 2 (1 + exp 2ζz)",
        half_kick=True,
        tried={
            "spring": (0.0, 0.1, 0.3),
            "slide": ONE,
            "chain": (5,),
            "pendulum": ONE,
            "whirl": ONE,
            "swing": (0.05,),
            "fade": (0.05,),
        },
    ),
)
