"""Test problems whose stability limits are known by theory: small MJCF models, and their trials.

A model whose stability is tried begins with an amplitude of a thousandth or less, in a shape that
contains all its modes.  After a number of time steps the trial fails if the amplitude is large.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from proofmass.case.drive import Steady
from proofmass.run.solve import call_engine
from proofmass.sim.engines import computes_curves, engine_names, engine_of
from proofmass.sim.problem_models import problem_mjcf, start_key, wheel_model
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Drive, Rod, Run
from proofmass.sim.protocol.theory import LimitProblem, Scheme
from proofmass.sim.stability import stability_limit
from proofmass.studies.measure import Measurement, measure, step_taken
from proofmass.studies.stress import theory
from proofmass.studies.stress.boundary import BoundaryKind, Failure, TrialResult, is_engine_warning
from proofmass.studies.stress.limit_search import LimitSearch, kind_of_limit
from proofmass.verdict.outcome import Outcome

DEFAULT_STEPS, STEPS_PER_SAMPLE = 4000, 20  # time steps of a run, and from one sample to the next
RUN_TIMEOUT = 120.0  # processor time of a run, at most


def chain_model(masses: int) -> str:
    """Unit masses in a row, on unit springs between them and to the ground at one end."""
    world = "".join(
        f"""<body pos="1 0 0">
        <joint name="j{k}" type="slide" axis="1 0 0" stiffness="1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>"""
        for k in range(masses)
    )
    return problem_mjcf(
        world + "</body>" * masses, f"j{masses - 1}", start_key("0 " * (masses - 1) + "0.001")
    )


def pendulum_model(gravity: float) -> str:
    """A hanging point mass on a rod of unit length, at an angle of 1e-6 rad: it stays linear."""
    return problem_mjcf(
        """<body><joint name="joint" axis="0 0 1"/>
        <inertial pos="0 -1 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body>""",
        gravity=f"0 {-gravity!r} 0",
        rest=start_key("1e-6"),
    )


def whirl_model(speed: float) -> str:
    """A unit mass on a unit spring, on a slide of a heavy rotating wheel, displaced by 1e-3 m.

    A body at a distance of 1 m gives the model a size, which constraint violations are compared
    with.
    """
    return problem_mjcf(
        """<body><joint name="wheel" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1e9 1e9 1e9"/>
        <body><joint name="joint" type="slide" axis="1 0 0" stiffness="1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
        </body><body pos="1 0 0"><joint name="far" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>""",
        rest=start_key("0 0.001 0", f"{speed!r} 0 0"),
    )


def column_model(load: float) -> str:
    """A clamp for a rod, and a load on the rod's tip that compresses it along its axis."""
    return f"""<mujoco model="column">
  <compiler angle="radian"/>
  <option integrator="implicitfast" gravity="0 0 0" jacobian="dense">
    <flag contact="disable"/></option>
  <worldbody><site name="clamp"/></worldbody>
  <actuator><motor name="load" site="rod.tip" refsite="clamp" gear="-1 0 0 0 0 0"/></actuator>
  <keyframe><key name="start" ctrl="{load!r}"/></keyframe>
</mujoco>"""


def fourbar_model(crank: float, coupler: float, rocker: float, ground: float, start: float) -> str:
    """A four-bar in its open assembly mode, with its crank at an angle [rad]; lengths in [m]."""
    tip = crank * np.exp(1j * start)
    to_rocker = ground - tip
    turn = np.angle(to_rocker) + np.arccos(
        (coupler**2 + abs(to_rocker) ** 2 - rocker**2) / (2 * coupler * abs(to_rocker))
    )
    pin = tip + coupler * np.exp(1j * turn)
    pose = f"{start!r} {float(turn - start)!r} {float(np.angle(pin - ground))!r}"
    inertia = 'mass="1" diaginertia="1 1 1"'
    return problem_mjcf(
        f"""<body><joint name="crank" axis="0 0 1"/><inertial pos="0 0 0" {inertia}/>
        <body pos="{crank} 0 0"><joint name="coupler" axis="0 0 1"/>
        <inertial pos="0 0 0" {inertia}/><site name="a" pos="{coupler} 0 0"/></body></body>
        <body pos="{ground} 0 0"><joint name="rocker" axis="0 0 1"/>
        <inertial pos="0 0 0" {inertia}/><site name="b" pos="{rocker} 0 0"/></body>""",
        "rocker",
        '<equality><connect name="pin" site1="a" site2="b"/></equality>' + start_key(pose),
    )


def run_problem(engine: str, text: str, run: Run) -> Curves | Measurement:
    """Run a model, given as MJCF text, in a process of its own; its outcome if the run fails."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "problem.xml"
        file.write_text(text, encoding="utf-8")
        return measure(call_engine, engine, file, run, timeout=RUN_TIMEOUT)


def failed_trial(found: Measurement) -> TrialResult:
    """The result of a trial whose run failed."""
    unseen = found.outcome == Outcome.DIVERGED and not is_engine_warning(found.message)
    return TrialResult(Failure(found.message, kind_of_limit(found), silent=unseen))


def step_model(
    engine: str,
    text: str,
    step: float,
    settings: dict[str, Any],
    channel: str = "place",
    bound: float = 1.0,
    steps: int = DEFAULT_STEPS,
    kind: BoundaryKind = BoundaryKind.UNSTABLE,
) -> TrialResult:
    """Step a model; it fails if the run fails, or if a channel is beyond a bound at its end.

    The last quarter of the samples counts as the end.
    """
    x = step * STEPS_PER_SAMPLE * np.arange(steps // STEPS_PER_SAMPLE + 1.0)
    settings = {"timestep": step, **settings}
    curves = run_problem(engine, text, Run("dynamics", x, (channel,), settings=settings))
    if isinstance(curves, Measurement):
        return failed_trial(curves)
    last = float(np.abs(curves.channels[channel])[-curves.x.size // 4 :].max())
    growth = Failure(f"grew to {last:.2g}", kind, silent=True)
    return TrialResult(None if last < bound else growth, step_taken("dynamics", curves))


def list_problems() -> Iterator[LimitSearch]:
    """The searches of all test problems, for all engines."""
    yield from search_springs()
    yield from search_chains()
    yield from search_pendulum()
    yield from search_engine_problems()
    yield from search_whirl()
    yield from search_columns()
    yield from search_fourbar_limit()
    yield from search_long_runs()


def problem_schemes(problem: str) -> Iterator[tuple[str, Scheme, float]]:
    """Each engine with each of its schemes that is tried with a problem, and the problem's number.

    `proofmass.sim.protocol.theory.Scheme` describes the numbers.
    """
    for engine in engine_names():
        for scheme in engine_of(engine).theory.schemes:
            for number in scheme.tried.get(problem, ()):
                yield engine, scheme, number


def search_springs() -> Iterator[LimitSearch]:
    """Increase the time step of a wheel, and of a slide, on a spring and a damper."""
    for problem, kind in (("spring", "hinge"), ("slide", "slide")):
        for engine, scheme, zeta in problem_schemes(problem):
            text = wheel_model(1.0, 2.0 * zeta, kind)
            yield LimitSearch(
                f"spring on a {kind}, ζ = {zeta:g}",
                engine,
                scheme.name,
                "dt ω",
                "1",
                0.1,
                100.0,
                partial(try_step, engine, text, scheme.settings, DEFAULT_STEPS),
                stability_limit(scheme.step, zeta),
                scheme.law,
            )


def search_chains() -> Iterator[LimitSearch]:
    """Increase the time step of masses in a row, whose highest frequency gives the limit.

    All modes are excited in a run, so it need not be as long as the slowest mode.
    """
    for engine, scheme, masses in problem_schemes("chain"):
        masses = round(masses)
        yield LimitSearch(
            f"{masses} masses in a row on springs",
            engine,
            scheme.name,
            "dt √(k/m)",
            "1",
            0.1,
            10.0,
            partial(try_step, engine, chain_model(masses), scheme.settings, 1000),
            stability_limit(scheme.step) / theory.chain_frequency(masses),
            "limit of one spring / (2 sin((2n − 1)π / (4n + 2)))",
        )


def try_step(
    engine: str, text: str, settings: dict[str, Any], steps: int, step: float
) -> TrialResult:
    """Try a time step of a model."""
    return step_model(engine, text, step, settings, steps=steps)


def search_pendulum() -> Iterator[LimitSearch]:
    """Increase the gravity of a hanging pendulum."""
    for engine, scheme, _ in problem_schemes("pendulum"):
        yield LimitSearch(
            "hung pendulum",
            engine,
            scheme.name,
            "gravity dt²/L",
            "1",
            0.01,
            100.0,
            partial(try_gravity, engine, scheme.settings),
            stability_limit(scheme.step) ** 2,
            "square of the limit of dt ω",
        )


def try_gravity(engine: str, settings: dict[str, Any], gravity: float) -> TrialResult:
    """Try a gravity in steps of 1 s; it fails if the amplitude grows by a factor of 1000.

    The amplitude is still small then, so the pendulum is still linear.
    """
    return step_model(engine, pendulum_model(gravity), 1.0, settings, bound=1e-3)


def search_engine_problems() -> Iterator[LimitSearch]:
    """The searches of the problems that an engine itself provides."""
    for engine in engine_names():
        for one in engine_of(engine).theory.limit_problems():
            known = stability_limit(one.step, one.zeta) if one.step else one.theory
            yield LimitSearch(
                one.what,
                engine,
                one.setting,
                one.parameter,
                "1",
                one.start,
                one.reach,
                partial(try_engine_problem, engine, one),
                known,
                one.law,
            )


def try_engine_problem(engine: str, problem: LimitProblem, value: float) -> TrialResult:
    """Try a value of a problem that an engine itself provides."""
    text, step, settings, channel = problem.stepped(value)
    bound, kind = 1.0, BoundaryKind.UNSTABLE
    if problem.bound is not None:
        bound, kind = problem.bound, BoundaryKind.INACCURATE
    return step_model(engine, text, step, dict(settings), channel, bound, kind=kind)


def search_whirl() -> Iterator[LimitSearch]:
    """Increase the speed of a wheel until a slider on a spring moves outwards without limit.

    The limit is reached when the wheel rotates as fast as the slider swings on the wheel at rest.
    """
    for engine, scheme, _ in problem_schemes("whirl"):
        yield LimitSearch(
            "sprung slider on a turning wheel",
            engine,
            scheme.name,
            "speed/√(k/m)",
            "1",
            0.5,
            2.0,
            partial(try_wheel_speed, engine, scheme.settings),
            1.0,
            "Ω² = k/m",
        )


def try_wheel_speed(engine: str, settings: dict[str, Any], speed: float) -> TrialResult:
    """Try a speed of the wheel, in a run that is long enough for a slow outward motion."""
    return step_model(engine, whirl_model(speed), 0.05, settings, steps=6000)


def search_columns() -> Iterator[LimitSearch]:
    """Increase the load of Euler's column, which is a chain of rigid segments."""
    for engine in filter(computes_curves, engine_names()):
        for segments in (4, 12):
            yield LimitSearch(
                f"column of {segments} segments",
                engine,
                "at rest",
                "load L²/EI",
                "1",
                0.5,
                10.0,
                partial(try_column_load, engine, segments),
                theory.hencky_load(segments),
                "Hencky: 4 n² sin²(π/4n)",
            )


def try_column_load(engine: str, segments: int, load: float) -> TrialResult:
    """Try a load [EI/L^2] on a slightly bent column; it fails if the column comes to rest bent."""
    rod = Rod("rod", "clamp", None, 1.0, 1.0, segments, ("clamped", "free"), turn=0.5)
    run = Run("equilibrium", np.linspace(0.0, 1.0, 3), ("rod.angle",), rods=(rod,))
    curves = run_problem(engine, column_model(load), run)
    if isinstance(curves, Measurement):
        # such as an unstable equilibrium
        unstable = curves.outcome in (Outcome.NO_START, Outcome.DIVERGED)
        limit = BoundaryKind.UNSTABLE if unstable else BoundaryKind.OURS
        return TrialResult(Failure(curves.message, limit))
    tip_angle = float(abs(curves.channels["rod.angle"][-1]))
    # a load that is 1e-6 above the critical one rotates the tip by sqrt(8e-6) rad
    return TrialResult(
        None
        if tip_angle <= 3e-3
        else Failure(f"bent by {tip_angle:.2g} rad", BoundaryKind.UNSTABLE)
    )


def search_fourbar_limit() -> Iterator[LimitSearch]:
    """Increase the crank angle of a four-bar to its limit position, coupler and rocker in line."""
    bars = 2.0, 2.0, 2.5, 3.0
    crank, coupler, rocker, ground = bars
    limit_angle = np.arccos((crank**2 + ground**2 - (coupler + rocker) ** 2) / (2 * crank * ground))
    for engine in filter(computes_curves, engine_names()):
        yield LimitSearch(
            "four-bar 2, 2, 2.5, 3 to its limit position",
            engine,
            "sweep",
            "crank",
            "rad",
            0.6,
            3.1,
            partial(try_crank_angle, engine, fourbar_model(*bars, 0.5)),
            float(limit_angle),
            "law of cosines",
        )


def try_crank_angle(engine: str, text: str, end: float) -> TrialResult:
    """Try a crank angle [rad]: sweep the crank from 0.5 rad to it."""
    profile = Steady(0.0, 1.0, x_is_time=False)
    run = Run("sweep", np.linspace(0.5, end, 40), ("place",), (Drive("crank", profile),))
    curves = run_problem(engine, text, run)
    if isinstance(curves, Measurement):
        return failed_trial(curves)
    stopped = curves.stopped
    return TrialResult(Failure(stopped, BoundaryKind.UNSTABLE) if stopped else None)


def search_long_runs() -> Iterator[LimitSearch]:
    """Increase the duration of an undamped oscillation until its phase or its energy is off."""
    for engine, scheme, z in problem_schemes("swing"):
        yield LimitSearch(
            f"undamped spring, dt ω = {z:g}, off by 10 %",
            engine,
            scheme.name,
            "periods",
            "1",
            10.0,
            2e4,
            partial(try_periods, engine, scheme.settings, z, "place"),
            theory.periods_until_error(scheme, z),
            "powers of the step's matrix",
        )
    for engine, scheme, z in problem_schemes("fade"):
        yield LimitSearch(
            f"undamped spring, dt ω = {z:g}, energy down to 0.9",
            engine,
            scheme.name,
            "steps",
            "1",
            1e3,
            1e6,
            partial(try_energy_loss, engine, scheme.settings, z),
            theory.steps_until_energy_share(scheme, z),
            "eigenvalues of the step's matrix",
        )


def try_energy_loss(engine: str, settings: dict[str, Any], z: float, steps: float) -> TrialResult:
    """Try a number of steps; it fails if the oscillation has lost a tenth of its energy."""
    return try_periods(engine, settings, z, "energy", steps * z / (2 * np.pi))


def try_periods(
    engine: str, settings: dict[str, Any], z: float, quantity: str, periods: float
) -> TrialResult:
    """Try a number of periods; it fails if the place or the energy is off by more than a tenth.

    The error of the place is its largest one in the run, over the range; that of the energy is the
    share that is lost at the end.
    """
    steps = int(np.ceil(periods * 2 * np.pi / z))
    steps_per_sample = max(1, steps // 2000)
    x = z * steps_per_sample * np.arange(steps // steps_per_sample + 1.0)
    run = Run(
        "dynamics", x, ("place", "kinetic", "potential"), settings={"timestep": z, **settings}
    )
    curves = run_problem(engine, wheel_model(1.0), run)
    if isinstance(curves, Measurement):
        return failed_trial(curves)
    found = curves.channels
    place, reference = found["place"] / 1e-3, np.cos(x)
    energy = (found["kinetic"] + found["potential"]) / (0.5 * 1e-6)
    error = np.abs(place - reference).max() / 2 if quantity == "place" else 1 - energy[-1]
    inaccurate = Failure(f"off by {error:.2g}", BoundaryKind.INACCURATE, silent=True)
    return TrialResult(inaccurate if error > 0.1 else None, step_taken("dynamics", curves))
