"""What can be turned: lines of settings of one engine, all knobs but one held, from coarse to fine.

Not the full product, but what somebody would choose between.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count, takewhile
from math import log

from proofmass.case import Case
from proofmass.reference import compiled, grid
from proofmass.sim.contents import may_touch, rubs
from proofmass.sim.pymunk.engine import CHIPMUNK_BIAS
from proofmass.strict import Kind
from proofmass.studies.record import Knob, Setting
from proofmass.wording import spoken

INTEGRATORS = ("Euler", "implicit", "implicitfast", "discrete", "RK4")
HARD = (0.9999, 0.9999, 0.001)  # solimp, as hard as MuJoCo lets it be
STEPS_OF_SOLREF = 8  # fewer cost RK4 accuracy, more are softer
WORK = 6e4  # evaluations of forces in the longest run, so that lines end in the same place anywhere
STAGES = {"RK4": 4}  # evaluations in a step, 1 for the others


def leading(knob: Knob) -> float:
    """A knob's number, the first of several."""
    return float(knob[0] if isinstance(knob, tuple) else knob)


SIZE: dict[str, Callable[[Knob], float]] = {
    "timestep": leading, "solref": leading, "solimp": lambda d: 1.0 - leading(d),
    "error_bias": lambda share: -1.0 / log(leading(share)), "segments": lambda n: 1.0 / leading(n),
    "iterations": lambda n: 1.0 / leading(n), "impratio": lambda r: 1.0 / leading(r),
    "noslip_iterations": lambda n: 1.0 / leading(n)}
"""What errors fall with along an axis: a step or time constant [s], a share, a length of a link."""


@dataclass(frozen=True)
class Line:
    """Settings of one engine that differ in one knob, from coarse to fine.

    Attributes
    ----------
    engine, name : str
        The name is unlike that of any other line of the run.
    axis : str
        The knob.
    settings : tuple of Setting
    """

    engine: str
    name: str
    axis: str
    settings: tuple[Setting, ...]

    @property
    def sizes(self) -> list[float]:
        """What its errors should fall with, setting by setting."""
        return [SIZE[self.axis](setting.knobs[self.axis]) for setting in self.settings]

    @property
    def scaled(self) -> bool:
        """Whether loops get harder with the step."""
        return self.axis == "timestep" and len({s.knobs.get("solref") for s in self.settings}) > 1


def lines(case: Case, kind: Kind) -> list[Line]:
    """What can be turned in a run of a case; nothing in a sweep of a rigid mechanism.

    Raises
    ------
    InputError
        The model is at fault.
    """
    there = {solver.partition(":")[0] for solver in case.run[kind].solvers}
    if kind == "duration":
        found = [*as_given(case, kind), *in_mujoco(case), *in_pymunk(case)]
    else:
        found = list(of_segments(case, kind))
    return [line for line in found if line.engine in there]


def as_given(case: Case, kind: Kind) -> Iterator[Line]:
    """What the model and the sidecar themselves set, one line for each solver of the run.

    It may run where no other setting does: a stiff mechanism with a tiny mass, for one.
    """
    own = float(compiled(case).opt.timestep)
    for solver in case.run[kind].solvers:
        engine, _, variant = solver.partition(":")
        if variant == "default":  # see the other lines
            continue
        given = {name: tuple(value) if isinstance(value, list) else value
                 for name, value in case.settings.get(solver, {}).items()}
        setting = Setting(engine, {"timestep": own, **given})
        place = "sidecar" if given else "model"
        yield Line(engine, f"{spoken(solver)}, as in the {place}", "timestep", (setting,))


def timesteps(case: Case, stages: int) -> list[float]:
    """Steps [s] of which odd numbers, 1, 3, 7, .., lead from sample to sample.

    With even numbers one of them would end half way, where change points may lie.
    """
    times = grid(case, "duration")
    most = max(1.0, WORK / stages / (times.size - 1))
    numbers = takewhile(lambda number: number <= most, (2**k - 1 for k in count(1)))
    return [float(times[1] - times[0]) / number for number in numbers]


def in_mujoco(case: Case) -> Iterator[Line]:
    """Lines over the step, one an integrator and a softness; and over what holds loops."""
    own = float(compiled(case).opt.timestep)

    def over(integrator: str, soft: int | None) -> Line:
        knobs = [{"timestep": h, "integrator": integrator, **(hard(soft * h) if soft else
                  {"defaults": True})} for h in timesteps(case, STAGES.get(integrator, 1))]
        held = f", solref {soft} steps" if soft else ", default softness"
        return Line("mujoco", f"MuJoCo {integrator}{held * loops}", "timestep",
                    tuple(Setting("mujoco", k) for k in knobs))

    model = compiled(case)
    loops = model.neq > 0
    yield from (over(integrator, None) for integrator in INTEGRATORS)
    at = f"MuJoCo RK4 at {1e3 * own:g} ms"
    plain = Setting("mujoco", {"timestep": own, "integrator": "RK4"})
    if may_touch(model):
        for cone in ("pyramidal", "elliptic"):
            yield turned(plain.but(cone=cone), f"{at}, {cone} cone, impratio", "impratio",
                         (1.0, 10.0, 100.0))
    if may_touch(model) or rubs(model):
        yield turned(plain, f"{at}, noslip_iterations", "noslip_iterations", (1, 3, 10, 30))
    if not loops:
        return
    yield from (over(integrator, STEPS_OF_SOLREF) for integrator in INTEGRATORS)
    yield from (over("Euler", 2), over("RK4", 4))
    base = Setting("mujoco", {"timestep": own, "integrator": "RK4",
                              **hard(STEPS_OF_SOLREF * own)})
    yield turned(base, f"{at}, solref", "solref", [(m * own, 1.0) for m in (64, 32, 16, 8, 4, 2)])
    yield turned(base.but(refsafe=False), f"{at}, refsafe off, solref", "solref",
                 [(m * own, 1.0) for m in (1.5, 1.0, 0.75)])  # with it, these would be 2 steps
    yield turned(base, f"{at}, solimp", "solimp", [(d, d, 0.001) for d in (.9, .99, .999, .9999)])
    for solver, counts in (("Newton", (1, 2, 4)), ("CG", (1, 2, 4, 8)),
                           ("PGS", (1, 2, 4, 8, 16, 32, 64))):
        yield turned(base.but(solver=solver, tolerance=0.0), f"{at}, {solver} iterations",
                     "iterations", counts)
    yield turned(base.but(solver="CG", tolerance=0.0, warmstart=False),
                 f"{at}, CG without warm start, iterations", "iterations", (1, 2, 4, 8))


def at_step(setting: Setting, step: float) -> Setting:
    """A setting with another time step [s], and a `solref` that goes with it.

    >>> at_step(Setting("mujoco", {"timestep": 1e-3, "solref": (8e-3, 1.0)}), 5e-4).knobs
    {'timestep': 0.0005, 'solref': (0.004, 1.0)}
    """
    knobs = dict(setting.knobs, timestep=step)
    if isinstance(solref := setting.knobs.get("solref"), tuple):
        knobs["solref"] = (leading(solref) * step / leading(setting.knobs["timestep"]), *solref[1:])
    return Setting(setting.engine, knobs)


def hard(solref: float) -> dict[str, Knob]:
    """Loops with a time constant [s], and as hard as can be otherwise."""
    return {"solref": (solref, 1.0), "solimp": HARD}


def in_pymunk(case: Case) -> Iterator[Line]:
    """Lines over the step, tuned and as Chipmunk comes; and over what closes loops."""
    own, steps = float(compiled(case).opt.timestep), timesteps(case, 1)
    at = f"pymunk at {1e3 * own:g} ms"
    free = Setting("pymunk", {"timestep": own, "error_bias": 0.0})
    yield turned(free, "pymunk, no bias", "timestep", steps)
    yield turned(free.but(iterations=30), "pymunk, no bias, 30 iterations", "timestep", steps)
    yield turned(Setting("pymunk", {"defaults": True}), "pymunk, defaults", "timestep", steps)
    yield turned(free, f"{at}, iterations", "iterations", (10, 30, 100, 300, 1000))
    yield turned(Setting("pymunk", {"timestep": own}), f"{at}, bias", "error_bias",
                 [CHIPMUNK_BIAS**k for k in (1, 2, 4, 8, 16, 32)])


def of_segments(case: Case, kind: Kind) -> Iterator[Line]:
    """Lines over the number of segments of all rods, as multiples that suit the samples of a rest.

    A link is straight, so what lies between its ends is off by more or less.
    """
    if not case.rod:
        return
    samples = (case.run[kind].n or 0) - 1
    first = samples // 4 if kind == "rest" and samples % 4 == 0 else 5
    numbers = list(takewhile(lambda n: n <= 160, (first * 2**k for k in range(8))))
    for engine, name in (("mujoco", "MuJoCo"), ("pymunk", "pymunk")):
        yield turned(Setting(engine), f"{name}, segments", "segments", numbers)


def turned(base: Setting, name: str, axis: str, values: Sequence[Knob]) -> Line:
    """A line over one knob of a setting."""
    return Line(base.engine, name, axis, tuple(base.but(**{axis: value}) for value in values))
