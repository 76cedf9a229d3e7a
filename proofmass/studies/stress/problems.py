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

from proofmass.drive import Steady
from proofmass.engines import computes, engine_names, engine_of
from proofmass.outcome import Outcome
from proofmass.sim.problem_models import key, mjcf, wheel
from proofmass.sim.protocol import Curves, Drive, LimitProblem, Rod, Run, Scheme
from proofmass.sim.stability import limit
from proofmass.solve import simulate
from proofmass.studies.measure import Measurement, measure, step_taken
from proofmass.studies.stress import theory
from proofmass.studies.stress.boundary import BoundaryKind, Failure, TrialResult, is_engine_warning
from proofmass.studies.stress.limit_search import LimitSearch, limit_kind

STEPS, EVERY = 4000, 20  # time steps of a run, and from one sample to the next
SECONDS = 120.0  # wall time of a run, at most


def chain(masses: int) -> str:
    """Unit masses in a row, on unit springs between them and to the ground at one end."""
    world = "".join(
        f"""<body pos="1 0 0">
        <joint name="j{k}" type="slide" axis="1 0 0" stiffness="1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>"""
        for k in range(masses)
    )
    return mjcf(world + "</body>" * masses, f"j{masses - 1}", key("0 " * (masses - 1) + "0.001"))


def pendulum(gravity: float) -> str:
    """A hanging point mass on a rod of unit length, at an angle of 1e-6 rad: it stays linear."""
    return mjcf(
        """<body><joint name="joint" axis="0 0 1"/>
        <inertial pos="0 -1 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body>""",
        gravity=f"0 {-gravity!r} 0",
        rest=key("1e-6"),
    )


def whirl(speed: float) -> str:
    """A unit mass on a unit spring, on a slide of a heavy rotating wheel, displaced by 1e-3 m.

    A body at a distance of 1 m gives the model a size, which constraint violations are compared
    with.
    """
    return mjcf(
        """<body><joint name="wheel" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1e9 1e9 1e9"/>
        <body><joint name="joint" type="slide" axis="1 0 0" stiffness="1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
        </body><body pos="1 0 0"><joint name="far" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>""",
        rest=key("0 0.001 0", f"{speed!r} 0 0"),
    )


def column(load: float) -> str:
    """A clamp for a rod, and a load on the rod's tip that compresses it along its axis."""
    return f"""<mujoco model="column">
  <compiler angle="radian"/>
  <option integrator="implicitfast" gravity="0 0 0" jacobian="dense">
    <flag contact="disable"/></option>
  <worldbody><site name="clamp"/></worldbody>
  <actuator><motor name="load" site="rod.tip" refsite="clamp" gear="-1 0 0 0 0 0"/></actuator>
  <keyframe><key name="start" ctrl="{load!r}"/></keyframe>
</mujoco>"""


def fourbar(crank: float, coupler: float, rocker: float, ground: float, start: float) -> str:
    """A four-bar in its open assembly mode, with its crank at an angle [rad]; lengths in [m]."""
    tip = crank * np.exp(1j * start)
    to_rocker = ground - tip
    turn = np.angle(to_rocker) + np.arccos(
        (coupler**2 + abs(to_rocker) ** 2 - rocker**2) / (2 * coupler * abs(to_rocker))
    )
    pin = tip + coupler * np.exp(1j * turn)
    pose = f"{start!r} {float(turn - start)!r} {float(np.angle(pin - ground))!r}"
    inertia = 'mass="1" diaginertia="1 1 1"'
    return mjcf(
        f"""<body><joint name="crank" axis="0 0 1"/><inertial pos="0 0 0" {inertia}/>
        <body pos="{crank} 0 0"><joint name="coupler" axis="0 0 1"/>
        <inertial pos="0 0 0" {inertia}/><site name="a" pos="{coupler} 0 0"/></body></body>
        <body pos="{ground} 0 0"><joint name="rocker" axis="0 0 1"/>
        <inertial pos="0 0 0" {inertia}/><site name="b" pos="{rocker} 0 0"/></body>""",
        "rocker",
        '<equality><connect name="pin" site1="a" site2="b"/></equality>' + key(pose),
    )


def run_model(engine: str, text: str, run: Run) -> Curves | Measurement:
    """Run a model, given as MJCF text, in a process of its own; its outcome if the run fails."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "problem.xml"
        file.write_text(text, encoding="utf-8")
        return measure(simulate, engine, file, run, timeout=SECONDS)


def failed(found: Measurement) -> TrialResult:
    """The result of a trial whose run failed."""
    unseen = found.outcome == Outcome.DIVERGED and not is_engine_warning(found.message)
    return TrialResult(Failure(found.message, limit_kind(found), silent=unseen))


def stepping(
    engine: str,
    text: str,
    step: float,
    settings: dict[str, Any],
    channel: str = "place",
    bound: float = 1.0,
    steps: int = STEPS,
    kind: BoundaryKind = BoundaryKind.UNSTABLE,
) -> TrialResult:
    """Step a model; it fails if the run fails, or if a channel is beyond a bound at its end.

    The last quarter of the samples counts as the end.
    """
    x = step * EVERY * np.arange(steps // EVERY + 1.0)
    settings = {"timestep": step, **settings}
    curves = run_model(engine, text, Run("dynamics", x, (channel,), settings=settings))
    if isinstance(curves, Measurement):
        return failed(curves)
    last = float(np.abs(curves.channels[channel])[-curves.x.size // 4 :].max())
    grew = Failure(f"grew to {last:.2g}", kind, silent=True)
    return TrialResult(None if last < bound else grew, step_taken("dynamics", curves))


def list_problems() -> Iterator[LimitSearch]:
    """The searches of all test problems, for all engines."""
    yield from springs()
    yield from chains()
    yield from pendulums()
    yield from own_ones()
    yield from whirls()
    yield from columns()
    yield from folds()
    yield from long_runs()


def schemes(problem: str) -> Iterator[tuple[str, Scheme, float]]:
    """Each engine with each of its schemes that is tried with a problem, and the problem's number.

    `proofmass.sim.protocol.Scheme` describes the numbers.
    """
    for engine in engine_names():
        for scheme in engine_of(engine).schemes:
            for number in scheme.tried.get(problem, ()):
                yield engine, scheme, number


def springs() -> Iterator[LimitSearch]:
    """Increase the time step of a wheel, and of a slide, on a spring and a damper."""
    for problem, kind in (("spring", "hinge"), ("slide", "slide")):
        for engine, scheme, zeta in schemes(problem):
            text = wheel(1.0, 2.0 * zeta, kind)
            yield LimitSearch(
                f"spring on a {kind}, ζ = {zeta:g}",
                engine,
                scheme.name,
                "dt ω",
                "1",
                0.1,
                100.0,
                partial(row, engine, text, scheme.settings, STEPS),
                limit(scheme.step, zeta),
                scheme.law,
            )


def chains() -> Iterator[LimitSearch]:
    """Increase the time step of masses in a row, whose highest frequency gives the limit.

    All modes are excited in a run, so it need not be as long as the slowest mode.
    """
    for engine, scheme, masses in schemes("chain"):
        masses = round(masses)
        yield LimitSearch(
            f"{masses} masses in a row on springs",
            engine,
            scheme.name,
            "dt √(k/m)",
            "1",
            0.1,
            10.0,
            partial(row, engine, chain(masses), scheme.settings, 1000),
            limit(scheme.step) / theory.chain_frequency(masses),
            "limit of one spring / (2 sin((2n − 1)π / (4n + 2)))",
        )


def row(engine: str, text: str, settings: dict[str, Any], steps: int, step: float) -> TrialResult:
    """Try a time step of a model."""
    return stepping(engine, text, step, settings, steps=steps)


def pendulums() -> Iterator[LimitSearch]:
    """Increase the gravity of a hanging pendulum."""
    for engine, scheme, _ in schemes("pendulum"):
        yield LimitSearch(
            "hung pendulum",
            engine,
            scheme.name,
            "gravity dt²/L",
            "1",
            0.01,
            100.0,
            partial(hung, engine, scheme.settings),
            limit(scheme.step) ** 2,
            "square of the limit of dt ω",
        )


def hung(engine: str, settings: dict[str, Any], gravity: float) -> TrialResult:
    """Try a gravity in steps of 1 s; it fails if the amplitude grows by a factor of 1000.

    The amplitude is still small then, so the pendulum is still linear.
    """
    return stepping(engine, pendulum(gravity), 1.0, settings, bound=1e-3)


def own_ones() -> Iterator[LimitSearch]:
    """The searches of the problems that an engine itself provides."""
    for engine in engine_names():
        for one in engine_of(engine).limit_problems():
            known = limit(one.step, one.zeta) if one.step else one.theory
            yield LimitSearch(
                one.what,
                engine,
                one.setting,
                one.parameter,
                "1",
                one.start,
                one.reach,
                partial(stepped, engine, one),
                known,
                one.law,
            )


def stepped(engine: str, problem: LimitProblem, value: float) -> TrialResult:
    """Try a value of a problem that an engine itself provides."""
    text, step, settings, channel = problem.stepped(value)
    bound, kind = 1.0, BoundaryKind.UNSTABLE
    if problem.bound is not None:
        bound, kind = problem.bound, BoundaryKind.INACCURATE
    return stepping(engine, text, step, dict(settings), channel, bound, kind=kind)


def whirls() -> Iterator[LimitSearch]:
    """Increase the speed of a wheel until a slider on a spring moves outwards without limit.

    The limit is reached when the wheel rotates as fast as the slider swings on the wheel at rest.
    """
    for engine, scheme, _ in schemes("whirl"):
        yield LimitSearch(
            "sprung slider on a turning wheel",
            engine,
            scheme.name,
            "speed/√(k/m)",
            "1",
            0.5,
            2.0,
            partial(turn_wheel, engine, scheme.settings),
            1.0,
            "Ω² = k/m",
        )


def turn_wheel(engine: str, settings: dict[str, Any], speed: float) -> TrialResult:
    """Try a speed of the wheel, in a run that is long enough for a slow outward motion."""
    return stepping(engine, whirl(speed), 0.05, settings, steps=6000)


def columns() -> Iterator[LimitSearch]:
    """Increase the load of Euler's column, which is a chain of rigid segments."""
    for engine in filter(computes, engine_names()):
        for segments in (4, 12):
            yield LimitSearch(
                f"column of {segments} segments",
                engine,
                "at rest",
                "load L²/EI",
                "1",
                0.5,
                10.0,
                partial(pushed, engine, segments),
                theory.hencky(segments),
                "Hencky: 4 n² sin²(π/4n)",
            )


def pushed(engine: str, segments: int, load: float) -> TrialResult:
    """Try a load [EI/L^2] on a slightly bent column; it fails if the column comes to rest bent."""
    rod = Rod("rod", "clamp", None, 1.0, 1.0, segments, ("clamped", "free"), turn=0.5)
    run = Run("equilibrium", np.linspace(0.0, 1.0, 3), ("rod.angle",), rods=(rod,))
    curves = run_model(engine, column(load), run)
    if isinstance(curves, Measurement):
        # such as an unstable equilibrium
        unstable = curves.outcome in (Outcome.NO_START, Outcome.DIVERGED)
        limit = BoundaryKind.UNSTABLE if unstable else BoundaryKind.OURS
        return TrialResult(Failure(curves.message, limit))
    bent = float(abs(curves.channels["rod.angle"][-1]))
    # a load that is 1e-6 above the critical one rotates the tip by sqrt(8e-6) rad
    return TrialResult(
        None if bent <= 3e-3 else Failure(f"bent by {bent:.2g} rad", BoundaryKind.UNSTABLE)
    )


def folds() -> Iterator[LimitSearch]:
    """Increase the crank angle of a four-bar to its limit position, coupler and rocker in line."""
    bars = 2.0, 2.0, 2.5, 3.0
    crank, coupler, rocker, ground = bars
    reach = np.arccos((crank**2 + ground**2 - (coupler + rocker) ** 2) / (2 * crank * ground))
    for engine in filter(computes, engine_names()):
        yield LimitSearch(
            "four-bar 2, 2, 2.5, 3 to its limit position",
            engine,
            "sweep",
            "crank",
            "rad",
            0.6,
            3.1,
            partial(swept, engine, fourbar(*bars, 0.5)),
            float(reach),
            "law of cosines",
        )


def swept(engine: str, text: str, end: float) -> TrialResult:
    """Try a crank angle [rad]: sweep the crank from 0.5 rad to it."""
    law = Steady(0.0, 1.0, x_is_time=False)
    run = Run("sweep", np.linspace(0.5, end, 40), ("place",), (Drive("crank", law),))
    curves = run_model(engine, text, run)
    if isinstance(curves, Measurement):
        return failed(curves)
    stopped = curves.stopped
    return TrialResult(Failure(stopped, BoundaryKind.UNSTABLE) if stopped else None)


def long_runs() -> Iterator[LimitSearch]:
    """Increase the duration of an undamped oscillation until its phase or its energy is off."""
    for engine, scheme, z in schemes("swing"):
        yield LimitSearch(
            f"undamped spring, dt ω = {z:g}, off by 10 %",
            engine,
            scheme.name,
            "periods",
            "1",
            10.0,
            2e4,
            partial(swinging, engine, scheme.settings, z, "place"),
            theory.off_after(scheme, z),
            "powers of the step's matrix",
        )
    for engine, scheme, z in schemes("fade"):
        yield LimitSearch(
            f"undamped spring, dt ω = {z:g}, energy down to 0.9",
            engine,
            scheme.name,
            "steps",
            "1",
            1e3,
            1e6,
            partial(fading, engine, scheme.settings, z),
            theory.faded_after(scheme, z),
            "eigenvalues of the step's matrix",
        )


def fading(engine: str, settings: dict[str, Any], z: float, steps: float) -> TrialResult:
    """Try a number of steps; it fails if the oscillation has lost a tenth of its energy."""
    return swinging(engine, settings, z, "energy", steps * z / (2 * np.pi))


def swinging(
    engine: str, settings: dict[str, Any], z: float, what: str, periods: float
) -> TrialResult:
    """Try a number of periods; it fails if the place or the energy is off by more than a tenth.

    The error of the place is its largest one in the run, over the range; that of the energy is the
    share that is lost at the end.
    """
    steps = int(np.ceil(periods * 2 * np.pi / z))
    per = max(1, steps // 2000)
    x = z * per * np.arange(steps // per + 1.0)
    run = Run(
        "dynamics", x, ("place", "kinetic", "potential"), settings={"timestep": z, **settings}
    )
    curves = run_model(engine, wheel(1.0), run)
    if isinstance(curves, Measurement):
        return failed(curves)
    found = curves.channels
    place, reference = found["place"] / 1e-3, np.cos(x)
    energy = (found["kinetic"] + found["potential"]) / (0.5 * 1e-6)
    off = np.abs(place - reference).max() / 2 if what == "place" else 1 - energy[-1]
    inaccurate = Failure(f"off by {off:.2g}", BoundaryKind.INACCURATE, silent=True)
    return TrialResult(inaccurate if off > 0.1 else None, step_taken("dynamics", curves))
