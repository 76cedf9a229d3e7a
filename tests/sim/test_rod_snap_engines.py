"""Tests of a rod that snaps, in both engines: folds of chains, and shapes on both sides."""

from functools import cache, partial

import numpy as np
import pytest

from proofmass.analytic.rods.rod_snap import events, solve
from proofmass.analytic.rods.shooting import integrate
from proofmass.batch.check import check
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.run import Drive, Rod, Run
from tests.independent.rods import chain_rod
from tests.independent.rods.chain import chain
from tests.shipped import shipped
from tests.sim.rod_models import ENGINES, STEEL_STIFFNESS

MODEL = shipped("rod_snap.xml")
CHANNELS = "tip.angle", "holding_moment", "energy"


@cache
def fold_angle():
    """The motor angle at the rod's fold [rad]."""
    return events(distance=0.8)["snaps to the left"]


def piecewise_linear(angles, x):
    """A profile that is linear between angles of the motor, one at each integer x."""
    return np.interp(x, np.arange(len(angles)), angles), 0.0 * x, 0.0 * x


def swept_curves(file, engine, degrees, segments, **settings):
    """Curves of an engine in a sweep through angles of the motor, which begins at 80 degrees."""
    angles = np.radians([80.0, *degrees])
    rods = (
        Rod(
            "rod", "clamp", "pin", 1.0, STEEL_STIFFNESS, segments, ("clamped", "pinned"), turn=-2.1
        ),
    )
    run = Run(
        "sweep",
        np.arange(float(angles.size)),
        CHANNELS,
        (Drive("motor", partial(piecewise_linear, angles)),),
        rods=rods,
        settings=settings,
    )
    return ENGINES[engine](file, run)


def chain_moments_and_energies(degrees, segments):
    """Holding moments and energies of chains in equilibrium, seeded with the rod's directions."""
    truth, c = reference_curves(degrees), chain(segments, stiffness=STEEL_STIFFNESS)
    rod = integrate(
        truth["force_x"],
        truth["force_y"],
        -truth["holding_moment"],
        theta0=np.radians(degrees),
        stiffness=STEEL_STIFFNESS,
        nodes=81,
    )
    seeds = np.array([np.interp(c.station, rod.s, theta) for theta in rod.theta.T])
    clamps = np.stack([0.0 * truth["side"], 0.0 * truth["side"], np.radians(degrees)], axis=-1)
    rest = chain_rod.pinned(c, clamps, (0.8, 0.0), seed=seeds)
    assert (rest.curvatures[:, 0] > 0.0).all()
    return -rest.root_moment, rest.energy


def reference_curves(degrees):
    """Curves of the reference at angles of the motor."""
    return solve(np.radians(degrees), distance=0.8, stiffness=STEEL_STIFFNESS)


def test_a_sweep_without_time_ends_at_the_fold():
    """A sweep of MuJoCo without time steps stops at the fold of its chain.

    The motor angle there converges to that of the rod with the square of the number of links.
    """
    ends = []
    for n in (10, 20, 40):
        found = swept_curves(MODEL, "mujoco", [40.0, 0.0, -40.0, -80.0], n)
        assert found.x.size == 4
        assert found.stopped.startswith("the equilibrium becomes unstable beyond motor = ")
        ends.append(float(found.stopped.rpartition(" = ")[2]))
    errors = np.array(ends) + fold_angle()
    # both tolerances: terms in h^4, and angles that are printed with six digits
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.05)
    assert (4.0 * ends[2] - ends[1]) / 3.0 == pytest.approx(-fold_angle(), abs=3e-6)


@pytest.mark.parametrize(
    ("engine", "settings", "atol"),
    [
        ("pymunk", {}, 1e-11),  # equilibrium to 1e-12 of the model, magnified by its softness
        ("mujoco", {"settled": True}, 1e-5),  # soft loops
    ],
)
def test_engines_snap_where_their_chain_does(engine, settings, atol):
    """While the motor turns down and up again, every pose is an equilibrium of the chain."""
    degrees = [80.0, 30.0, -20.0, -45.0, -62.0, -80.0, -30.0, 20.0, 45.0, 62.0]
    found = swept_curves(MODEL, engine, degrees[1:], 10, **settings).channels
    assert (np.sign(found["tip.angle"]) == [-1, -1, -1, -1, 1, 1, 1, 1, 1, -1]).all()
    moment, energy = chain_moments_and_energies(degrees, 10)
    np.testing.assert_allclose(found["holding_moment"], moment, atol=atol, rtol=0)
    np.testing.assert_allclose(found["energy"], energy, atol=atol, rtol=0)


@pytest.mark.slow
def test_shapes_converge_on_both_sides_of_a_snap():
    """Errors of direction, moment and energy in pymunk fall with the square of the links."""
    degrees = [80.0, 20.0, -30.0, -70.0, -20.0, 30.0]
    truth = reference_curves(degrees)
    found = [swept_curves(MODEL, "pymunk", degrees[1:], n).channels for n in (8, 16)]
    for channel, name in zip(CHANNELS, ("tip_angle", "holding_moment", "energy"), strict=True):
        coarse, fine = (np.abs(curves[channel] - truth[name]) for curves in found)
        np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.1)  # h^4 with eight links


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("segments = 40", 'segments = 40\nscheme = "naive"'),
        ("distance = 0.8 ", "distance = 0.79 "),
        ("turn = -2.1", "turn = 2.1"),  # wound into a loop
    ],
)
@pytest.mark.slow
def test_a_wrong_rod_or_equilibrium_differs(old, new, edit):
    """A soft clamp, another distance of the pin, and another equilibrium differ in pymunk."""
    edit("rod_snap.toml", '"mujoco:settled", "pymunk"', '"pymunk"')
    edit("rod_snap.toml", r'\[settings."mujoco:settled"\]\nsettled = true\n', "")
    edit("rod_snap.toml", "n = 43 ", "n = 9 ")
    file = edit("rod_snap.toml", old, new)
    assert [c.outcome for c in check([file], detectable=False, causes=False).comparisons].count(
        "differs"
    ) > 0


def test_no_sample_falls_between_the_folds_of_rod_and_chain():
    """A sample there would be on one side in the engines and on the other in the reference."""
    case = load_case(shipped("rod_snap.toml"))
    drive, n = case.drive[0], case.run["sweep"].n
    angle = np.abs(drive.start * np.cos(2.0 * np.pi * np.arange(n) / (n - 1)))
    assert drive.to == -drive.start
    assert np.degrees(np.abs(angle - fold_angle())).min() > 4.0
