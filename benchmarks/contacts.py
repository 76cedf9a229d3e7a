"""Contacts and friction against closed forms: which errors fall with the step, in each engine.

    python -m benchmarks.contacts [--quick]

Runs the cases of models/contacts that have a closed form at the step of their models and at 1/2,
1/4, ... of it, and five touching balls in bare MuJoCo with finer steps and stiffer contacts.
Writes docs/contacts.md.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from benchmarks import ROOT, command, folders
from proofmass import load_case
from proofmass.case import Case
from proofmass.compare import compare
from proofmass.sim.protocol import Diverged
from proofmass.solve import plan, simulate
from proofmass.wording import number

HALVINGS = 5
TEXT = ""
SHOWN = {
    "block_slides": ("position", "velocity"),
    "block_sticks": ("position", "velocity"),
    "block_stops": ("position",),
    "ball_rolls": ("position", "velocity", "spin"),
    "ball_bounces": ("height", "velocity"),
    "block_rocks": ("angle", "rate"),
    "balls_in_row": ("v1", "v5"),
}
"""Channels in the table, by case."""
PLACES = ("m", "rad")
"""Units of places, whose largest errors are told; of velocities, which jump, the root mean square."""
LEAST = 1e-12
"""Errors below this share of a reference's range are rounding, and no order is told of them."""


def main() -> None:
    quick = command(__doc__).parse_args().quick
    with folders(quick, Path("reports")) as (_, docs):
        names = list(SHOWN)[:1] if quick else list(SHOWN)
        halvings = 2 if quick else HALVINGS
        series = "\n".join(line for name in names for line in rows(name, halvings))
        steps = (5e-5,) if quick else (1e-4, 5e-5, 2e-5, 1e-5, 5e-6)
        hard = (1e6,) if quick else (1e6, 1e7, 1e8)
        page = TEXT.replace("<!-- series -->\n", f"{HEAD}\n{series}\n")
        page = page.replace("<!-- touching -->\n", "\n".join(touching(steps, hard)) + "\n")
        (docs / "contacts.md").write_text(page, encoding="utf-8")
        print(page)


HEAD = (
    "| case | channel | engine | step [ms] | error of the largest value, halving the step |"
    " falls with the step |\n|---|---|---|---|---|---|"
)


def rows(name: str, halvings: int) -> Iterator[str]:
    """The errors of a case, a row for each engine and channel."""
    (file,) = (ROOT / "models").rglob(f"{name}.toml")
    case = load_case(file)
    for engine in ("mujoco", "pymunk"):
        if engine not in case.run["dynamics"].solvers:
            continue
        found = [errors(case, engine, k) for k in range(halvings)]
        step = 1e3 * own_step(case)
        for channel in SHOWN[name]:
            curve = np.array([one[channel] for one in found])
            values = ", ".join(number(value, 2) for value in curve)
            yield (
                f"| {name} | {channel} | {engine} | {number(step, 3)} | {values} | "
                f"{verdict(curve)} |"
            )


def own_step(case: Case) -> float:
    """The time step of a case's model [s]."""
    return float(mujoco.MjModel.from_xml_path(str(case.model_path)).opt.timestep)


def errors(case: Case, engine: str, halved: int) -> dict[str, float]:
    """Largest errors [SI] by channel, with a step that is halved so often."""
    run = plan(case, "dynamics", engine)
    settings = {**run.settings, "timestep": own_step(case) / 2**halved}
    try:
        curves = simulate(engine, case.model_path, replace(run, settings=settings))
    except Diverged:
        return dict.fromkeys(case.channels, np.nan)
    compared = compare(case, "dynamics", engine, curves, detectable=False)
    return {c.channel: c.error_max if c.unit in PLACES else c.error_rms for c in compared}


def verdict(curve: Sequence[float]) -> str:
    """Whether errors fall with the step, by their fit over all of it.

    >>> verdict([8.0, 4.0, 2.0, 1.0]), verdict([1.0, 0.9, 1.1, 1.0])
    ('yes, order 1.0', 'no')
    """
    values = np.asarray(curve, float)
    if not np.isfinite(values).all():
        return "lost"
    if values.max() < LEAST:
        return "exact"
    order = -np.polyfit(np.arange(len(values)), np.log2(np.maximum(values, 1e-300)), 1)[0]
    if order < 0.4:
        return "no"
    scatter = (np.diff(values) > 0).any()
    return f"yes, {'unevenly, about ' if scatter else ''}order {order:.1f}"


def touching(steps: Sequence[float], stiffnesses: Sequence[float]) -> Iterator[str]:
    """Velocities of five touching balls after the impact, by step and stiffness, and theories."""
    yield "| | step [ms] | stiffness [1/s²] | v1 | v2 | v3 | v4 | v5 | energy |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for stiffness in stiffnesses:
        for step in steps:
            if step * stiffness**0.5 < 0.2:  # 15 steps a contact or more
                yield line("MuJoCo", struck(step, stiffness), step, stiffness)
    yield line("springs that act alike", springs())
    yield line("one after the other, the reference", [0.0, 0.0, 0.0, 0.0, 1.0])
    yield line("the first one hits one body of four", [-0.6, 0.4, 0.4, 0.4, 0.4])


def line(
    words: str, speeds: Sequence[float], step: float | None = None, stiffness: float | None = None
) -> str:
    """A row of the table of touching balls."""
    told = ["" if step is None else number(1e3 * step, 2)]
    told += ["" if stiffness is None else f"{stiffness:.0e}".replace("e+0", "e")]
    told += [f"{v:.3f}" for v in speeds]
    return f"| {words} | {' | '.join(told)} | {sum(v * v for v in speeds):.3f} |"


def struck(step: float, stiffness: float) -> list[float]:
    """Velocities [m/s] of the balls of `balls_touching` when all have parted, in bare MuJoCo."""
    file = ROOT / "models" / "contacts" / "balls_touching.xml"
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_EULER
    model.geom_solref[:] = -stiffness, 0.0
    model.opt.tolerance = 1e-12
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, int(30.0 / stiffness**0.5 / step))
    return data.qvel.tolist()


def springs() -> list[float]:
    """Velocities [m/s] of a row of masses with springs between them that only push."""
    from scipy.integrate import solve_ivp

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        press = np.maximum(-np.diff(y[:5]), 0.0)
        return np.concatenate([y[5:], np.append(0.0, press) - np.append(press, 0.0)])

    start = [*([0.0] * 5), 1.0, *([0.0] * 4)]
    done = solve_ivp(rates, (0.0, 60.0), start, "DOP853", rtol=1e-10, atol=1e-12, max_step=0.02)
    return done.y[5:, -1].tolist()


if __name__ == "__main__":
    main()
