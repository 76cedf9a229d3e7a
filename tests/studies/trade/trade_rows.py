"""A made-up trade study whose errors and processor times are formulas."""

from dataclasses import replace

from proofmass.studies.record import StudyRow
from proofmass.studies.trade.verdict import Verdict

SPAN = 6.28  # s of motion
STEPS = tuple(0.016 / 2**k for k in range(9))  # s


def series_rows(
    name: str,
    engine: str = "mujoco",
    order: float = 2.0,
    scale: float = 100.0,
    floor: float = 0.0,
    cost: float = 1e-5,
    **parameters: object,
) -> list[StudyRow]:
    """Rows of a series with position errors scale * step^order + floor.

    Velocity errors are 10 times, acceleration errors 100 times as large.  A step takes `cost` [s].
    """
    rows = []
    for dt in STEPS:
        error, steps = scale * dt**order + floor, round(SPAN / dt)
        rows.append(
            StudyRow(
                "trade",
                "fourbar",
                "dynamics",
                engine,
                name,
                "timestep",
                dt,
                {"timestep": dt, **parameters},
                {"position": error, "velocity": 10 * error, "acceleration": 100 * error},
                {"violation": 1e-3 * error},
                steps * cost,
                steps,
                (steps * cost,) * 5,
                True,
                0.0,
            )
        )
    return rows


def series_verdicts(
    name: str, expected: float, floor: float = float("nan"), cause: str = "", engine: str = "mujoco"
) -> list[Verdict]:
    """Verdicts of a series for all kinds of errors.

    `floor` is that of positions [share of range], 10 times as large for velocities and 100 times
    for accelerations.
    """
    return [
        Verdict(
            "fourbar",
            "dynamics",
            engine,
            name,
            kind,
            expected + 0.01,
            expected,
            factor * floor,
            cause,
            "halving solref divides the error by 4.0, the step by 1.0" if cause else "",
        )
        for kind, factor in (("position", 1), ("velocity", 10), ("acceleration", 100))
    ]


def example_study() -> tuple[list[StudyRow], list[Verdict]]:
    """Rows and verdicts of twelve series; in one of them the coarsest setting diverges."""
    rows, verdicts = [], []
    for k, name in enumerate(("Euler", "implicit", "implicitfast", "RK4", "discrete")):
        order, scale, cost = (4.0, 3e3, 4e-5) if name == "RK4" else (1.0, 0.2, 1e-5 * (1 + k / 20))
        soft = 2e-4 * (1 + k / 10)
        rows += series_rows(
            f"MuJoCo {name}, defaults",
            "mujoco",
            order,
            scale,
            soft,
            cost,
            integrator=name,
            defaults=True,
        )
        verdicts += series_verdicts(f"MuJoCo {name}, defaults", order, soft, "softness of the loop")
        own = series_rows(
            f"MuJoCo {name}, solref 8 dt", "mujoco", order, 1.5 * scale, 3e-8, cost, integrator=name
        )
        if name == "RK4":
            own[0] = replace(
                own[0],
                errors={},
                outcome="diverged",
                steps=0,
                seconds=float("nan"),
                repeats=(),
                message="the loops are open by 0.3 m",
            )
            verdicts += series_verdicts(f"MuJoCo {name}, solref 8 dt", order, 3e-8, "cap of solimp")
        else:
            verdicts += series_verdicts(f"MuJoCo {name}, solref 8 dt", order)
        rows += own
    rows += series_rows("pymunk, no bias", "pymunk", 2.0, 1.0, 2e-9, 4e-5)
    verdicts += series_verdicts("pymunk, no bias", 2.0, 2e-9, "rounding", "pymunk")
    rows += series_rows("pymunk, defaults", "pymunk", 1.0, 0.1, 0.0, 2e-5, defaults=True)
    verdicts += series_verdicts("pymunk, defaults", 1.0, engine="pymunk")
    return rows, verdicts
