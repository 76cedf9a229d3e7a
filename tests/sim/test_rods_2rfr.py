"""Tests of two rods on one pin, in both engines: equilibria, paths of the motors, folds."""

from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.rods.all_equilibria import solutions
from proofmass.analytic.rods.continuation import follow
from proofmass.analytic.rods.equilibrium import RodState
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Drive, Run
from proofmass.verdict.compare import compare
from tests.analytic.rods.rod_assembly_cases import DATA, EI, table_7_state
from tests.analytic.rods.rod_chain_cases import STABLE_ROWS, pair_of_table_7, tangent_angle
from tests.independent.rods.chain_assembly import AssemblyEquilibria, settle
from tests.shipped import shipped
from tests.sim.rod_models import (
    CLAMP_ANGLES,
    ENGINES,
    PAIR_MODEL,
    constant_profile,
    equilibrium_curves,
    fixed_motors,
)
from tests.sim.rod_models import rod_pair as rods
from tests.verdicts import all_comparisons

EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
SLOW_TEST = pytest.mark.slow
PIN_CHANNELS = "pin.x", "pin.y"
CHANNELS = *PIN_CHANNELS, "moment1", "moment2", "energy"
PATHS = DATA["trajectories"]
# motor angles at which the paths of Pérez Gámiz 2018 begin
START_ANGLES = np.radians([-32.2157989, 20.9113672])


@pytest.fixture(scope="module")
def unloaded(tmp_path_factory) -> Path:
    """The model of the pair without its load."""
    file = tmp_path_factory.mktemp("pair") / "unloaded.xml"
    file.write_text(PAIR_MODEL.read_text().replace('ctrl="0 0 1"', 'ctrl="0 0 0"'))
    return file


def swept_curves(engine, file, name, segments, angles) -> Curves:
    """Curves of a sweep from an equilibrium of Table 7, along lines between motor angles (n, 2)."""
    motor_angles = np.vstack([CLAMP_ANGLES, angles])

    def profile_of(k):
        return lambda x: (
            np.interp(x, np.arange(len(motor_angles)), motor_angles[:, k]),
            0 * x,
            0 * x,
        )

    drives = tuple(Drive(f"motor{k + 1}", profile_of(k)) for k in (0, 1))
    run = Run(
        "sweep",
        np.arange(len(motor_angles), dtype=float),
        CHANNELS,
        drives,
        rods=rods(name, segments),
    )
    return ENGINES[engine](file, run)


def channel_values(curves: Curves) -> np.ndarray:
    """Position of the pin, moments and energy (samples, 5)."""
    return np.stack([curves.channels[name] for name in CHANNELS], axis=1)


@cache
def unloaded_s2() -> RodState:
    """S2 without load, at the motor angles `START_ANGLES`, which keep the pin at the same place."""
    s = table_7_state("S2")
    return follow(s, pose=s.pose[None], load=[[0.0, 0.0]]).last


def turned_state(turn: float) -> RodState:
    """The state of `unloaded_s2` with motor 1 turned further, or the fold before that angle."""
    return follow(unloaded_s2(), inputs=unloaded_s2().inputs + np.array([[turn, 0.0]])).last


def chain_equilibrium(segments: int, near: RodState) -> AssemblyEquilibria:
    """The equilibrium of chains near one of rods."""
    angles = near.inputs
    shapes = [
        tangent_angle(angle, force, moment, EI)
        for angle, force, moment in zip(angles, near.force, near.moment, strict=True)
    ]
    return settle(
        pair_of_table_7(), angles - CLAMP_ANGLES, seed=shapes, segments=segments, force=near.load
    )


def values_of_chain(found: AssemblyEquilibria) -> list[float]:
    """The values of `channel_values` for chains in equilibrium; the motors balance the rods."""
    return [*found.pose, *-found.root_moment, found.energy]


@EACH_ENGINE
@pytest.mark.parametrize("name", STABLE_ROWS)
def test_four_equilibria_with_ten_links_a_rod(engine, name):
    """Poses and energies equal recomputed ones of the same chains; the errors are of order 2.

    Chains of twenty links are tested in `test_rods`.
    """
    found = equilibrium_curves(
        engine, PAIR_MODEL, rods(name, 10), CHANNELS, fixed_motors()
    ).channels
    row = STABLE_ROWS[name]
    pin = [found[name][0] for name in PIN_CHANNELS]
    # both tolerances: digits of the recomputed numbers
    np.testing.assert_allclose(pin, row["half"]["10"], rtol=0, atol=5.1e-9)
    assert found["energy"][0] == pytest.approx(row["half_energy"]["10"], rel=1e-7)
    far = np.hypot(*(np.array(pin) - row["pose"]))
    near = np.hypot(*(np.array(row["half"]["20"]) - row["pose"]))
    assert np.log2(far / near) == pytest.approx(2.0, abs=0.05)  # the term in h^4


@EACH_ENGINE
def test_poses_along_a_path_of_both_motors_are_chain_equilibria(engine):
    """Along a line of motor angles, from S1 towards S2, poses equal the chains' equilibria."""
    offsets = np.outer([0.2, 0.4, 0.6], [1.0, -1.0])
    found = channel_values(swept_curves(engine, PAIR_MODEL, "S1", 10, CLAMP_ANGLES + offsets))
    states = follow(table_7_state("S1"), inputs=CLAMP_ANGLES + offsets).states
    for k in range(3):
        truth = chain_equilibrium(10, states[k])
        assert truth.curvatures[0] > 0
        # both engines end within 1e-12 of the equilibrium, magnified by the softness of the pair
        np.testing.assert_allclose(found[k + 1], values_of_chain(truth), rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["ring", pytest.param("line", marks=SLOW_TEST)])
def test_motors_lead_the_pin_along_the_published_paths(name, unloaded):
    """With the motor angles that solve the inverse problem for rods, the pin follows the path.

    This holds in the limit of many links.
    """
    rows = PATHS[name]
    angles = np.vstack([START_ANGLES, np.radians([row["inputs_deg"] for row in rows])])
    coarse, fine = (
        channel_values(swept_curves("mujoco", unloaded, "S2", n, angles))[2:, :2] for n in (20, 40)
    )
    if name == "ring":
        turn = np.radians([row["angle_deg"] for row in rows])
        path = 0.1 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    else:
        path = np.outer([row["dx"] for row in rows], [1.0, 0.0])
    truth = STABLE_ROWS["S2"]["pose"] + path
    assert np.abs(fine - truth).max() > 1e-4  # the chains' error in h^2
    # terms in h^4, which are largest where the ring comes near to a fold
    np.testing.assert_allclose((4 * fine - coarse) / 3, truth, rtol=0, atol=8e-5)


def chain_fold(n: int) -> float:
    """Turn of motor 1 from `START_ANGLES` at which chains of n links become unstable [rad]."""
    turn, step = -0.3, -0.02
    here = chain_equilibrium(n, turned_state(turn))
    while step < -1e-7:
        there = settle(
            pair_of_table_7(),
            START_ANGLES - CLAMP_ANGLES + [turn + step, 0.0],
            seed=here.angle,
            segments=n,
        )
        near = np.abs(there.angle - here.angle).max() < 0.3
        if near and there.curvatures[0] > 0:
            here, turn = there, turn + step
        else:
            step /= 2
    return turn


@pytest.mark.slow
def test_the_fold_of_chains_converges_with_order_2():
    """The fold of chains converges to that of rods with order 2.

    A continuation finds the fold of rods; a recomputation has it to 5e-6 rad.
    """
    exact = turned_state(-0.5).inputs[0] - START_ANGLES[0]
    assert exact == pytest.approx(PATHS["fold"]["turn"], abs=6e-6)
    errors = np.array([chain_fold(n) for n in (10, 20, 40)]) - exact
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, [2.0, 2.0], atol=0.12)  # the term in h^4 with ten links


@pytest.mark.parametrize("n", [10, pytest.param(20, marks=SLOW_TEST)])
def test_a_sweep_ends_at_the_fold_of_its_chains(n, unloaded):
    """The result states the reason and keeps the samples before the fold."""
    truth = chain_fold(n)
    turns = np.array([0.0, 0.2, 0.3, 0.36, 0.4, 0.5])
    found = swept_curves("mujoco", unloaded, "S2", n, START_ANGLES - np.outer(turns, [1.0, 0.0]))
    assert "the equilibrium becomes unstable beyond motor1 = " in found.stopped
    assert found.x.size == len(found.channels["pin.x"]) == 5  # Table 7's angles, and four turns
    end = float(found.stopped.split("motor1 = ")[1].split(",")[0])
    assert end - START_ANGLES[0] == pytest.approx(truth, abs=1e-6)  # printed with six digits


def test_beyond_its_fold_the_pair_snaps_to_another_equilibrium(unloaded):
    """Beyond the fold pymunk comes to one of the stable equilibria that a search finds there.

    MuJoCo, started near S4, comes to rest in the same equilibrium.
    """
    angles = START_ANGLES - np.outer([0.0, 0.3, 0.4], [1.0, 0.0])
    found = swept_curves("pymunk", unloaded, "S2", 10, angles)
    assert not found.stopped
    pin = channel_values(found)[:, :2]
    there = solutions(unloaded_s2().assembly, inputs=angles[-1], modes=2)
    stable = there.state.pose[there.negative == 0]
    drives = tuple(Drive(f"motor{k + 1}", partial(constant_profile, angles[-1, k])) for k in (0, 1))
    placed = equilibrium_curves("mujoco", unloaded, rods("S4", 10), PIN_CHANNELS, drives).channels
    assert np.linalg.norm(stable - pin[-1], axis=1).min() < 1e-2  # error in h^2 with ten links
    # equilibrium to 1e-12 of the model, magnified by the softness of the pair
    np.testing.assert_allclose(
        [placed[name][0] for name in PIN_CHANNELS], pin[-1], rtol=0, atol=1e-10
    )
    last = turned_state(-0.4).pose
    assert np.hypot(*(pin[-2] - last)) < 0.2 < np.hypot(*(pin[-1] - last))


@pytest.mark.parametrize(("name", "seconds"), [("rfr2_circles", 8.0), ("rfr2_rectangles", 12.0)])
def test_the_pin_follows_the_published_circles_and_rectangles(name, seconds):
    """The first, third and fifth positions agree in MuJoCo, with the tolerances of the cases.

    Rates and moments are left out: at these three samples they are too small for their tolerances.
    """
    case = load_case(shipped(f"{name}.toml"))
    places = {
        one: channel for one, channel in case.channels.items() if channel.unit in ("m", "rad")
    }
    case = case.model_copy(update={"channels": places, "view": ()})
    drives = tuple(drive.model_copy(update={"until": seconds}) for drive in case.drive)
    runs = {"sweep": case.run["sweep"].model_copy(update={"n": 3})}
    case = case.model_copy(update={"drive": drives, "run": runs})
    found = compare(case, "sweep", "mujoco", solve_here(case, "sweep", "mujoco"), detectable=False)
    assert {c.outcome for c in found} == {"agrees"}


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        pytest.param(
            "rfr2_driven.toml", "segments = 16", 'segments = 16\nscheme = "naive"', marks=SLOW_TEST
        ),
        pytest.param(
            "rfr2_driven.toml",
            r"length = 1.0\n(stiffness = .*\nsegments)",
            r"length = 1.01\n\1",
            marks=SLOW_TEST,
        ),
        ("rfr2_natural.xml", "gear=.0.3 -0.1", 'gear="0.32 -0.1'),
    ],
)
def test_a_wrong_pair_of_rods_differs(file, old, new, edit):
    """Soft clamps, longer rods and another load exceed the tolerance for the number of links."""
    edit("rfr2_driven.toml", r'"mujoco", "pymunk"', '"mujoco"')
    edit("rfr2_driven.toml", "n = 37", "n = 19")
    edit(file, old, new)
    found = all_comparisons(edit("rfr2_driven.toml", "title", "title"))
    assert "differs" in {c.outcome for c in found}
