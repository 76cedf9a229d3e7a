"""Settings of MuJoCo that `trade` scans and `choose` tries; their orders are in `theory.py`."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from proofmass.sim.contents import has_dry_friction, may_touch
from proofmass.sim.mjcf import compile_model
from proofmass.sim.mujoco.settings import ENGINE_DEFAULTS, HARD_SOLIMP, STAGES, limited_joints
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

INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")
MAX_IMPEDANCE = 0.9999  # the largest impedance in solimp that MuJoCo accepts
SOLVER_TOLERANCE = 1e-15
"""Tolerance of the solver that is just above rounding; 0 enforces all iterations allowed."""
STEPS_OF_SOLREF = 8  # time constant of loops in steps: fewer cost RK4 accuracy, more are softer
SOLREF_CAUSE = "too few steps in solref"
"""Cause of an error that the step alone changes, in a scan whose `solref` goes with the step."""
SIZES: dict[str, Callable[[ParameterValue], float]] = {
    "timestep": first_number,
    "solref": first_number,
    "solimp": lambda d: 1.0 - first_number(d),
}
LABELS = {"solref": "time constant, solref [s]", "solimp": "1 − solimp"}


class MujocoTuning(Tuning):
    """Settings of MuJoCo that studies vary."""

    sizes = SIZES
    labels = LABELS

    def at_step(self, parameters: ParameterValues, step: float) -> dict[str, ParameterValue]:
        """Settings with another time step [s], and a `solref` scaled in proportion to it.

        >>> from proofmass.sim.mujoco.engine import ENGINE
        >>> ENGINE.tuning.at_step({"timestep": 1e-3, "solref": (8e-3, 1.0)}, 5e-4)
        {'timestep': 0.0005, 'solref': (0.004, 1.0)}
        """
        scaled = dict(parameters, timestep=step)
        if isinstance(solref := parameters.get("solref"), tuple):
            scaled["solref"] = (
                first_number(solref) * step / first_number(parameters["timestep"]),
                *solref[1:],
            )
        return scaled

    def scans(self, about: Studied) -> Iterator[Scan]:
        """Scans over the step by integrator and softness, and over settings of constraints."""
        model, own = about.model, about.own_step
        loops = has_soft_constraints(about)

        def over(integrator: str, soft: int | None) -> Scan:
            parameters = tuple(
                {
                    "timestep": h,
                    "integrator": integrator,
                    **(hardest_loops(soft * h) if soft else {"defaults": True}),
                }
                for h in about.timesteps(STAGES.get(integrator, 1))
            )
            held = f", solref {soft} steps" if soft else ", default softness"
            return Scan(f"MuJoCo {integrator}{held * loops}", "timestep", parameters)

        yield from (over(integrator, None) for integrator in INTEGRATORS)
        prefix = f"MuJoCo RK4 at {1e3 * own:g} ms"
        plain: dict[str, ParameterValue] = {"timestep": own, "integrator": "RK4"}
        if may_touch(model):
            for cone in ("pyramidal", "elliptic"):
                yield scan_over(
                    {**plain, "cone": cone},
                    f"{prefix}, {cone} cone, impratio",
                    "impratio",
                    (1.0, 10.0, 100.0),
                )
        if may_touch(model) or has_dry_friction(model):
            yield scan_over(
                plain, f"{prefix}, noslip_iterations", "noslip_iterations", (1, 3, 10, 30)
            )
        if not loops:
            return
        yield from (over(integrator, STEPS_OF_SOLREF) for integrator in INTEGRATORS)
        yield from (over("Euler", 2), over("RK4", 4))
        base = {**plain, **hardest_loops(STEPS_OF_SOLREF * own)}
        yield scan_over(
            base, f"{prefix}, solref", "solref", [(m * own, 1.0) for m in (64, 32, 16, 8, 4, 2)]
        )
        yield scan_over(
            {**base, "refsafe": False},
            f"{prefix}, refsafe off, solref",
            "solref",
            [(m * own, 1.0) for m in (1.5, 1.0, 0.75)],
        )  # with refsafe, all of these would be raised to 2 steps
        yield scan_over(
            base, f"{prefix}, solimp", "solimp", [(d, d, 0.001) for d in (0.9, 0.99, 0.999, 0.9999)]
        )
        step = about.quartered_step(STAGES["RK4"])
        prefix = f"MuJoCo RK4 at {1e3 * step:.3g} ms"
        base = {**plain, "timestep": step, **hardest_loops(STEPS_OF_SOLREF * step)}
        for solver, counts in (
            ("Newton", (1, 2, 4)),
            ("CG", (1, 2, 4, 8)),
            ("PGS", (1, 2, 4, 8, 16, 32, 64)),
        ):
            yield scan_over(
                {**base, "solver": solver, "tolerance": 0.0},
                f"{prefix}, {solver} iterations",
                "iterations",
                counts,
            )
        yield scan_over(
            {**base, "solver": "CG", "tolerance": 0.0, "warmstart": False},
            f"{prefix}, CG without warm start, iterations",
            "iterations",
            (1, 2, 4, 8),
        )

    def perturbations(
        self, parameters: ParameterValues, about: Studied, scaled: bool
    ) -> Iterator[Perturbation]:
        """Perturbations of the step, of the softness of loops or limits, and of the solver."""
        model = about.model
        known: dict[str, Any] = {
            **(ENGINE_DEFAULTS if parameters.get("defaults") else {}),
            **parameters,
        }

        def changed_settings(**changed: ParameterValue) -> dict[str, ParameterValue]:
            return {**parameters, **changed}

        step = known.get("timestep", model.opt.timestep)
        yield Perturbation(
            SOLREF_CAUSE if scaled else STEP_CAUSE,
            "halving the step" + ", solref as it is" * scaled,
            changed_settings(timestep=step / 2),
        )
        if not has_soft_constraints(about):
            return
        what, soft = "loops", (model.eq_solref, model.eq_solimp)
        if not model.neq:
            what, soft = (
                "limits",
                (model.jnt_solref[limited_joints(model)], model.jnt_solimp[limited_joints(model)]),
            )
        tau, ratio = known.get("solref", soft[0][0])[:2]
        can_halve_solref = tau / 2 >= 2 * step  # MuJoCo raises a shorter time constant
        yield Perturbation(
            f"softness of the {what}",
            "halving solref" if can_halve_solref else "doubling solref",
            changed_settings(solref=(tau / 2 if can_halve_solref else 2 * tau, ratio)),
            can_halve_solref,
        )
        low, high, *rest = known.get("solimp", soft[1][0])
        can_halve = 1 - (1 - high) / 2 <= MAX_IMPEDANCE
        factor = 0.5 if can_halve else 2.0
        yield Perturbation(
            f"softness of the {what}, solimp",
            f"{'halving' if can_halve else 'doubling'} 1 - solimp",
            changed_settings(solimp=(1 - factor * (1 - low), 1 - factor * (1 - high), *rest)),
            can_halve,
        )
        more = 4 * known.get("iterations", model.opt.iterations)
        within = min(known.get("tolerance", model.opt.tolerance), SOLVER_TOLERANCE)
        yield Perturbation(
            "the solver's iterations",
            "four times as many iterations",
            changed_settings(iterations=more, tolerance=within),
        )

    def recipes(self, about: Studied) -> Iterator[Recipe]:
        """Recipes for each integrator, with default softness and with time constants in steps."""
        loops = has_soft_constraints(about)

        def held(integrator: str, soft: int) -> Callable[[float], dict[str, ParameterValue]]:
            return lambda step: {
                "integrator": integrator,
                "solref": (soft * step, 1.0),
                "solimp": HARD_SOLIMP,
            }

        def by_itself(integrator: str) -> Callable[[float], dict[str, ParameterValue]]:
            return lambda step: {"integrator": integrator, "defaults": True}

        for integrator in INTEGRATORS:
            yield Recipe(
                f"MuJoCo {integrator}{', default softness' * loops}",
                by_itself(integrator),
                integrator == ENGINE_DEFAULTS["integrator"],
            )
            if loops:
                for soft in (2, 4, 8, *((32, 128) if may_rebound(about) else ())):
                    yield Recipe(
                        f"MuJoCo {integrator}, solref {soft} steps", held(integrator, soft)
                    )

    def holding(
        self, model: Path, parameters: ParameterValues, slower: float
    ) -> dict[str, ParameterValue]:
        """Settings with a larger `impratio`; see `proofmass.sim.mujoco.contacts.creep_rate`."""
        own = float(str(parameters.get("impratio", compile_model(model).opt.impratio)))
        return {**parameters, "impratio": own * slower}


def hardest_loops(solref: float) -> dict[str, ParameterValue]:
    """Settings of loops with a time constant [s] and the hardest `solimp`."""
    return {"solref": (solref, 1.0), "solimp": HARD_SOLIMP}


def has_soft_constraints(about: Studied) -> bool:
    """Whether the model has soft loops, or soft joint limits that a free motion may hit."""
    return bool(about.model.neq) or may_rebound(about)


def may_rebound(about: Studied) -> bool:
    """Whether joints may rebound from limits, in a motion without drives."""
    return not about.driven and limited_joints(about.model).size > 0


def recipes(about: Studied) -> Iterator[Recipe]:
    """Recipes for each integrator, with default softness and with time constants in steps."""
    loops = has_soft_constraints(about)

    def held(integrator: str, soft: int) -> Callable[[float], dict[str, ParameterValue]]:
        return lambda step: {
            "integrator": integrator,
            "solref": (soft * step, 1.0),
            "solimp": HARD_SOLIMP,
        }

    def by_itself(integrator: str) -> Callable[[float], dict[str, ParameterValue]]:
        return lambda step: {"integrator": integrator, "defaults": True}

    for integrator in INTEGRATORS:
        yield Recipe(
            f"MuJoCo {integrator}{', default softness' * loops}",
            by_itself(integrator),
            integrator == ENGINE_DEFAULTS["integrator"],
        )
        if loops:
            for soft in (2, 4, 8, *((32, 128) if may_rebound(about) else ())):
                yield Recipe(f"MuJoCo {integrator}, solref {soft} steps", held(integrator, soft))
