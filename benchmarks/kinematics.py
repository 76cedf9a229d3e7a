"""Poses per second of position, velocity and acceleration, in one table from one run.

    uv run --group bench python -m benchmarks.kinematics [rounds] [--quick]

The table has closed forms, the general solver, the document's own scheme, pylinkage, and
quasi-static sweeps of the two simulators, with the drives of the sidecars.  Before the timing, the
results of the document's scheme and of pylinkage are compared with the closed form.  The times of
the simulators include loading the model and reading its sensors.  pylinkage is left out if it is
not installed.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from types import ModuleType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks import ROOT, command, fourbar_newton
from benchmarks.timing import SPELL, Row, measure
from proofmass.analytic.linkages import (
    fivebar,
    fourbar,
    slider_crank,
    threeprr,
)
from proofmass.analytic.planar.branch import Branch
from proofmass.analytic.planar.kinematics import joint_rates
from proofmass.analytic.planar.mechanism import read
from proofmass.analytic.remember import use_memory
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import call_reference
from proofmass.reference.find import load_reference
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run
from proofmass.sim.protocol.run import Run
from teaching import natural_coordinates

Array = NDArray[np.float64]
MODELS = ROOT / "models" / "linkages"
CLOSED = {
    "fourbar": "four-bar",
    "slider_crank": "slider-crank",
    "fivebar": "five-bar",
    "inverted_slider_crank": "inverted slider-crank",
    "hacksaw": "hacksaw",
    "inverted_slider_crank_classic": "swinging block",
    "threeprr": "3PRR",
}
GENERAL_SOLVER = {**CLOSED, "peaucellier": "Peaucellier cell", "watt": "Watt six-bar"}
MAX_POSES = {"threeprr": 100_000}  # it solves a polynomial of degree six at every pose
BARS: dict[str, Any] = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0, "mode": 1}
SLIDER: dict[str, Any] = {"crank": 1.0, "coupler": 2.0}


@dataclass(frozen=True)
class Sizes:
    """Numbers of poses of a call, and the mechanisms of the general solver and of the engines.

    Attributes
    ----------
    closed_form : int
        Poses of a closed form, in addition to the last of `samples`.
    samples : tuple of int
        Poses of the general solver; the last one also of the closed forms.
    python, few, many : int
        Poses of the document's scheme; of pylinkage in Python, and compiled.
    general, engines : tuple of str
        Mechanisms of the general solver, and of the engines.
    """

    closed_form: int = 1_000_000
    samples: tuple[int, ...] = (361, 10_000, 100_000)
    python: int = 500
    few: int = 10_000
    many: int = 100_000
    general: tuple[str, ...] = tuple(GENERAL_SOLVER)
    engines: tuple[str, ...] = ("fourbar", "slider_crank", "fivebar")


QUICK = Sizes(361, (37,), 10, 100, 1000, ("slider_crank",), ("slider_crank",))


def with_samples(name: str, n: int) -> tuple[Case, Run]:
    """A sidecar's sweep with another number of samples."""
    case = load_case(MODELS / f"{name}.toml")
    table = case.run["sweep"].model_copy(update={"n": n})
    case = case.model_copy(update={"run": {"sweep": table}})
    return case, plan_run(case, "sweep", "mujoco")


def closed_form(name: str, n: int) -> Callable[[], dict[str, Array]]:
    """A function that evaluates all curves of the closed form of a sidecar, without its cache."""
    case, run = with_samples(name, n)
    module, state = cast(ModuleType, load_reference(case)), run.motion(run.x)

    def work() -> dict[str, Array]:
        with use_memory({}, store_results=False):  # without the cached result of the last call
            return call_reference(case, "sweep", module, run.x, state, case.parameters)

    return work


def general(name: str, n: int) -> Callable[[], object]:
    """A function that solves a sidecar's model: joint values, rates, accelerations."""
    case, run = with_samples(name, n)
    value, rate, acceleration = (part.T for part in run.motion(run.x))
    mechanism, _ = read(compiled_model(case), case.start)

    def work() -> object:
        branch = Branch(mechanism, tuple(drive.joint for drive in case.drive))
        poses, failure = branch.follow(value)
        if failure is not None:
            raise failure
        return joint_rates(mechanism, poses, branch.d, rate, acceleration)

    return work


def lengths(name: str) -> dict[str, Any]:
    """The parameters of a sidecar that the inverse closed form also has."""
    other = ("mode", "gravity")
    return {
        k: v
        for k, v in load_case(MODELS / f"{name}.toml").parameters.items()
        if k not in other and not k.endswith("_mass")
    }


def positions(count: int) -> Iterator[Row]:
    """Positions of a pin and of a slider alone, as pylinkage's compiled loop computes them."""
    turn = np.linspace(0.0, 2.0 * np.pi, count)
    for name, work in (
        ("four-bar", partial(fourbar.solve, turn, **BARS, only={"pin_x", "pin_y"})),
        ("slider-crank", partial(slider_crank.solve, turn, **SLIDER, only={"slider_x"})),
    ):
        yield Row(name, "closed form, positions alone", "p", count, work)


def inverses(count: int) -> Iterator[Row]:
    """Inverse kinematics, on the path that the direct closed form gives."""
    found = closed_form("fivebar", count)()
    tip = [np.array([found[f"tip_{order}{axis}"] for axis in "xy"]) for order in ("", "v", "a")]
    yield Row(
        "five-bar",
        "closed form, inverse",
        "p v a",
        count,
        partial(fivebar.solve_inverse, *tip, **lengths("fivebar")),
    )
    found = closed_form("threeprr", count)()
    pose = [
        np.array([found[axis + order] for axis in ("x", "y", "psi")])
        for order in ("", "_rate", "_acceleration")
    ]
    yield Row(
        "3PRR",
        "closed form, inverse",
        "p v a",
        count,
        partial(threeprr.solve_inverse, *pose, **lengths("threeprr")),
    )


def document(count: int) -> Iterator[Row]:
    """The document's linkages by its scheme, and the four-bar with explicit equations."""
    turn, arc = np.linspace(0.0, 2.0 * np.pi, count), np.linspace(0.0, 0.1, count)[:, None]
    for name, (linkage, start) in natural_coordinates.EXAMPLES.items():
        first = natural_coordinates.assemble(linkage, start).root
        ones = (1.0,) * linkage.inputs
        angles = first[-linkage.inputs :] + arc
        yield Row(
            name,
            "document's scheme, Python",
            "p v a",
            count,
            partial(
                natural_coordinates.sweep, linkage, first, angles, ones, [0.0] * linkage.inputs
            ),
        )
    near, truth = np.array([1.4375, 1.95]), pin(fourbar.solve(turn, **BARS), "pin")
    error = np.abs(fourbar_newton.sweep(turn, near) - truth).max()
    assert error < 1e-12, error  # rounding through condition numbers up to 17
    yield Row(
        "four-bar",
        "the same, equations written out",
        "p v a",
        count,
        partial(fourbar_newton.sweep, turn, near),
    )


def pin(pose: dict[str, Array], name: str) -> Array:
    """Position, velocity and acceleration of a point (3, n, 2)."""
    return np.array(
        [
            np.stack([pose[f"{name}_{order}x"], pose[f"{name}_{order}y"]], axis=1)
            for order in ("", "v", "a")
        ]
    )


def pylinkage(few: int, many: int) -> Iterator[Row]:
    """The two linkages that the document and pylinkage have in common."""
    if find_spec("pylinkage") is None:
        print("pylinkage is not installed and is left out: uv run --group bench")
        return
    from benchmarks import with_pylinkage

    def bars(angle: Array) -> Array:
        return pin(fourbar.solve(angle, **BARS), "pin")

    def slider(angle: Array) -> Array:
        return pin(slider_crank.solve(angle, **SLIDER), "slider")

    for name, build, truth in (
        ("four-bar", with_pylinkage.fourbar, bars),
        ("slider-crank", with_pylinkage.slider_crank, slider),
    ):
        error = with_pylinkage.difference(build, truth, many)
        assert error < 1e-8, error  # its crank turns by adding up 100 000 steps: 2e-10 here
        yield from with_pylinkage.rows(name, build, few, many)


def simulators(names: Sequence[str]) -> Iterator[Row]:
    """Sweeps in the two engines, with the samples of the sidecar."""
    for name in names:
        case = load_case(MODELS / f"{name}.toml")
        for engine, gives in (("mujoco", "p v a h"), ("pymunk", "p v h")):
            run = plan_run(case, "sweep", engine)
            yield Row(
                CLOSED[name],
                f"{engine} sweep",
                gives,
                run.x.size,
                partial(call_engine, engine, case.model_path, run),
            )


def table(rows: list[Row]) -> None:
    """Print the rows by mechanism, the closed form first."""
    base = {row.mechanism: row.speed for row in reversed(rows) if row.method == "closed form"}
    print(
        f"{'mechanism':22}{'method':36}{'gives':9}{'poses':>9}{'wall [s]':>10}{'CPU [s]':>9}"
        f"{'poses/s':>12}{'closed form is':>16}"
    )
    for mechanism in dict.fromkeys(row.mechanism for row in rows):
        for row in (row for row in rows if row.mechanism == mechanism):
            ratio = f"{base[mechanism] / row.speed:,.1f} x" if mechanism in base else "-"
            print(
                f"{mechanism:22}{row.method:36}{row.gives:9}{row.poses:9,}{row.wall:10.4f}"
                f"{row.own:9.4f}{row.speed:12,.0f}{ratio:>16}"
            )


def main(argv: Sequence[str] | None = None) -> None:
    parser = command(__doc__)
    parser.add_argument("rounds", type=int, nargs="?", default=5)
    given = parser.parse_args(argv)
    sizes, rounds = (QUICK, 1) if given.quick else (Sizes(), given.rounds)
    last = sizes.samples[-1]
    rows = [
        Row(word, "closed form", "p v a h", n, closed_form(name, n))
        for name, word in CLOSED.items()
        for n in (last, sizes.closed_form)
        if n <= MAX_POSES.get(name, n)
    ]
    rows += [
        *positions(last),
        *inverses(last),
        *document(sizes.python),
        *pylinkage(sizes.few, sizes.many),
        *simulators(sizes.engines),
    ]
    rows += [
        Row(GENERAL_SOLVER[name], "general solver", "p v a", n, general(name, n))
        for name in sizes.general
        for n in sizes.samples
    ]
    measure(rows, rounds, 0.0 if given.quick else SPELL)
    print("least of", rounds, "interleaved rounds, one thread; poses/s and ratios by CPU time")
    table(rows)


if __name__ == "__main__":
    main()
