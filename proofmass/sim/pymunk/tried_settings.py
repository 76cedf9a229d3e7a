"""Settings of pymunk that `trade` scans and `choose` tries; their orders are in `theory.py`."""

from collections.abc import Callable, Iterator
from math import log
from typing import Any

import numpy as np

from proofmass.sim.protocol.settings import ParameterValue, ParameterValues, first_number
from proofmass.sim.protocol.tuning import (
    STEP_CAUSE,
    Perturbation,
    Recipe,
    Scan,
    Studied,
    Tuning,
    scan_over,
)
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


class PymunkTuning(Tuning):
    """Settings of pymunk that studies vary."""

    sizes = SIZES
    labels = LABELS

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans over the step with proofmass's settings and Chipmunk's, iterations and bias."""
        own, steps = about.own_step, about.timesteps()
        prefix = f"{self.title} at {1e3 * own:g} ms"
        free: dict[str, ParameterValue] = {"timestep": own, "error_bias": 0.0}
        yield scan_over(free, f"{self.title}, no bias", "timestep", steps)
        yield scan_over(
            {**free, "iterations": 30}, f"{self.title}, no bias, 30 iterations", "timestep", steps
        )
        yield scan_over({"defaults": True}, f"{self.title}, defaults", "timestep", steps)
        yield scan_over(free, f"{prefix}, iterations", "iterations", (10, 30, 100, 300, 1000))
        yield scan_over(
            {"timestep": own},
            f"{prefix}, bias",
            "error_bias",
            [CHIPMUNK_BIAS**k for k in (1, 2, 4, 8, 16, 32)],
        )

    def perturbations(
        self, parameters: ParameterValues, about: Studied, scaled: bool
    ) -> Iterator[Perturbation]:
        """Settings with a change of the step, the bias or the iterations, one at a time."""
        known: dict[str, Any] = dict(parameters)
        step = known.get("timestep", about.model.opt.timestep)
        yield Perturbation(STEP_CAUSE, "halving the step", {**parameters, "timestep": step / 2})
        own = known.get("defaults")
        if bias := known.get("error_bias", CHIPMUNK_BIAS if own else 0.0):
            yield Perturbation(
                "bias of the loops",
                "halving its time constant",
                {**parameters, "error_bias": bias**2},
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

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """Chipmunk's defaults, no bias, and a bias that corrects a share of a violation each step.

        With few iterations a run may diverge if a step corrects the whole constraint violation.
        Chipmunk's `error_bias` is the share that is left after a second.  With a fixed share for
        each step, shorter steps correct the violation faster, and the error falls by more than in
        proportion to the step.
        """
        yield Recipe(f"{self.title}, defaults", lambda step: {"defaults": True}, True)
        yield Recipe(f"{self.title}, no bias", lambda step: {"error_bias": 0.0})
        for iterations in (1, 3, 10, 30, 100, 300):

            def parameters(step: float, iterations: int = iterations) -> dict[str, ParameterValue]:
                return {"error_bias": 0.0, "iterations": iterations}

            yield Recipe(f"{self.title}, no bias, {iterations} iterations", parameters)
        for iterations in (3, 10):
            for share in CORRECTED_SHARES:

                def biased(
                    step: float, iterations: int = iterations, share: float = share
                ) -> dict[str, ParameterValue]:
                    return {"error_bias": bias_of_share(share, step), "iterations": iterations}

                yield Recipe(
                    f"{self.title}, bias {share:g} a step, {iterations} iterations", biased
                )


def bias_of_share(share: float, step: float) -> float:
    """The `error_bias` with which a step [s] corrects a share of a constraint violation.

    Chipmunk's `error_bias` is the share of a violation that is left after 1 s.  The value is at
    least the smallest normal floating-point number.

    >>> bias_of_share(0.01, 1e-3), bias_of_share(0.01, 1e-6)
    (4.317124741065786e-05, 2.2250738585072014e-308)
    """
    return float(max((1.0 - share) ** (1.0 / step), np.finfo(float).tiny))
