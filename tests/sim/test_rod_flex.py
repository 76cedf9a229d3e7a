"""Tests of rods as one-dimensional flexes of MuJoCo, against the elastica and the flex's energy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from proofmass.run.sidecar import load_case
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.mujoco.flex import arc_lengths, cut_into_links
from proofmass.sim.protocol.failures import BadRod, Unsupported
from proofmass.sim.protocol.run import Rod, Run
from proofmass.verdict.compare import compare
from tests.shipped import shipped
from tests.sim.rod_models import (
    FIGURES,
    PAIR_MODEL,
    STEEL_STIFFNESS,
    dead_load,
    fixed_motors,
    write_model,
)

SHAPE_CHANNELS = "r.x", "r.y", "r.angle", "r.moment"
PIN_SITE = '<site name="pin" pos="0.8 0.1 0"/>'
CLAMP_SITES = (
    '<site name="c1" pos="-0.3 0 0" euler="0 0 0.6981317007977318"/>'
    '<site name="c2" pos="0.3 0 0" euler="0 0 1.0471975511965976"/>'
)
PIN_SENSOR = '<framepos name="pin" objtype="site" objname="left.tip"/>'


def cantilever(n: int, **change) -> Rod:
    """A rod with L = 1 m and EI = 1 N m^2, clamped at the ground."""
    return replace(Rod("r", "ground", None, 1.0, 1.0, n, ("clamped", "free")), **change)


def flex_curves(
    file, *rods, channels=SHAPE_CHANNELS, samples=2, kind="equilibrium", drives=(), step=None
):
    """Curves of a run with flexes, at `samples` evenly spaced places along the first rod."""
    s = np.linspace(0.0, rods[0].length, samples)
    settings = {"flex": True} | ({"timestep": step} if step else {})
    return simulate(file, Run(kind, s, channels, drives, settings=settings, rods=rods))


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, id=str(row["alpha"]), marks=pytest.mark.slow if row["alpha"] != 2 else ())
        for row in FIGURES["cantilever"]["rows"]
    ],
)
def test_a_flex_cantilever_converges_with_order_2(row, tmp_path):
    """Errors of the tip with 12, 20 and 28 edges are of order 2.

    The limit extrapolated from the last two is the elastica's tip.
    """
    truth = np.array([1.0 - row["u"], row["w"]])
    file = write_model(tmp_path, actuators=dead_load("r.tip", 0, row["alpha"]), ctrl="1")
    rods = [cantilever(n) for n in (12, 20, 28)]
    ends = [flex_curves(file, rod).channels for rod in rods]
    tips = np.array([[found[c][-1] for c in SHAPE_CHANNELS[:2]] for found in ends])
    h = np.array([cut_into_links(rod).lengths[-1] for rod in rods])
    errors = np.linalg.norm(tips - truth, axis=1)
    orders = np.log(errors[:-1] / errors[1:]) / np.log(h[:-1] / h[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)  # terms in h^4, and soft edges
    limit = (tips[2] * h[1] ** 2 - tips[1] * h[2] ** 2) / (h[1] ** 2 - h[2] ** 2)
    np.testing.assert_allclose(limit, truth, atol=2e-5)  # terms in h^4, and soft edges


@pytest.mark.parametrize("weight", [0.0, 3.0])
def test_a_flex_minimizes_its_documented_energy(weight, tmp_path):
    """The angles of a flex are those of the least energy, which is found without the engine.

    The energy is that of bending as the flex has it, of the load and of the weight.
    """
    n, load = 7, np.array([-2.0, 3.0])
    rod = cantilever(n, mass=weight or None)
    one = cut_into_links(rod)
    h, spring, share = one.lengths[-1], one.springs[-1], weight * one.lengths[-1]

    def potential(turns):
        angles = np.append(0.0, turns)
        places = np.cumsum(one.lengths * [np.cos(angles), np.sin(angles)], axis=1)[:, 1:]
        bending = spring / 2 * (4 * np.tan(np.diff(angles) / 2) ** 2).sum()
        return bending - load @ places[:, -1] + 9.81 * share * places[1].sum()

    file = write_model(
        tmp_path,
        actuators=dead_load("r.tip", *load),
        ctrl="1",
        gravity="0 -9.81 0" if weight else "0 0 0",
    )
    stretch = flex_curves(file, rod, samples=1 + 2 * n + 1).settings["stretch"]
    s = Run("equilibrium", one.nodes, SHAPE_CHANNELS, settings={"flex": True}, rods=(rod,))
    angles = simulate(file, s).channels["r.angle"]
    truth = minimize(potential, np.zeros(n), method="BFGS", options={"gtol": 1e-9}).x
    # BFGS with forward differences ends 1e-6 from its minimum; the stretch of the edges changes the
    # angles by its own size
    np.testing.assert_allclose(angles, np.append(0.0, truth), atol=1e-5 + 10 * stretch)
    assert h == pytest.approx(1.0 / (n + 0.5), rel=1e-15, abs=0)


def test_the_stretch_of_a_flex_falls_with_the_square_of_the_step(tmp_path):
    """The stretch that the settings of a result state falls with the square of the time step."""
    file = write_model(tmp_path, actuators=dead_load("r.tip", 5.0), ctrl="1")
    found = [
        flex_curves(file, cantilever(10), step=step).settings["stretch"] for step in (6e-4, 12e-4)
    ]
    assert found[1] / found[0] == pytest.approx(4.0, rel=0.1)  # there is a part of first order
    assert found[0] < 1e-5


@pytest.mark.parametrize("turn", [1.25, -1.04])
def test_a_pinned_rod_rests_on_the_side_of_its_arc(turn, tmp_path):
    """Both stable shapes of Pérez Gámiz 2018, annex II; the reference numbers are recomputed."""
    rods = [
        Rod("r", "ground", "pin", 1.0, 0.16493361431346418, n, ("clamped", "pinned"), turn=turn)
        for n in (10, 20)
    ]
    found = [flex_curves(write_model(tmp_path, PIN_SITE), rod) for rod in rods]
    one, two = (cut_into_links(rod).lengths[-1] ** 2 for rod in rods)
    last = np.array([[c.channels["r.moment"][0], c.channels["r.angle"][-1]] for c in found])
    limit = (last[1] * one - last[0] * two) / (one - two)
    truth = {1.25: (-0.6076388, 71.85836), -1.04: (0.7206177, -59.83792)}[turn]
    # moment and angle are extrapolated linearly to the ends, which leaves terms in h^2 and, with
    # ten elements, in h^3
    np.testing.assert_allclose(limit, [truth[0], np.radians(truth[1])], atol=3e-3)
    assert found[1].violation < 1e-6  # soft loops, with a step of 3e-3 of the rod's time


@pytest.mark.parametrize(
    "name", ["S4", *(pytest.param(s, marks=pytest.mark.slow) for s in ("S1", "S2", "S3"))]
)
def test_all_stable_equilibria_of_a_pair(name, tmp_path):
    """The equilibria of Pérez Gámiz 2018, Table 7, and the two that it lacks.

    The clamps are on the ground.
    """
    file = write_model(tmp_path, CLAMP_SITES, dead_load("left.tip", 0.3, -0.1), PIN_SENSOR, "1")
    turns, pins, squares = np.radians(FIGURES["pair"][name]["turns"]), [], []
    for n in (16, 24):
        left = Rod("left", "c1", None, 1.0, STEEL_STIFFNESS, n, ("clamped", "free"), turn=turns[0])
        right = Rod(
            "right", "c2", "left.tip", 1.0, STEEL_STIFFNESS, n, ("clamped", "pinned"), turn=turns[1]
        )
        found = flex_curves(file, left, right, channels=("pin.x", "pin.y"))
        pins.append([found.channels["pin.x"][0], found.channels["pin.y"][0]])
        squares.append(cut_into_links(left).lengths[-1] ** 2)
        assert found.violation < 3e-6  # soft loops
    (one, two), (far, near) = squares, np.array(pins)
    limit = (near * one - far * two) / (one - two)
    # terms in h^4; the pin of S2 moves by half a metre per newton
    np.testing.assert_allclose(limit, FIGURES["pair"][name]["pin"], atol=3e-3)


def test_a_rod_pinned_at_both_ends_is_an_arch(tmp_path):
    """The arch is symmetric and lies on the side of its initial arc."""
    file = write_model(tmp_path, '<site name="pin" pos="0.9 0 0"/>')
    rod = cantilever(10, end="pin", ends=("pinned", "pinned"), turn=-1.5)
    found = flex_curves(file, rod, samples=11).channels
    assert found["r.y"][5] > 0.1
    # 1e-6: constraint violation of the loop; 1e-5: the same, divided by h
    np.testing.assert_allclose(found["r.y"], found["r.y"][::-1], atol=1e-6)
    np.testing.assert_allclose(found["r.angle"], -found["r.angle"][::-1], atol=1e-5)


def test_channels_that_a_flex_lacks_are_missing(tmp_path):
    sensors = (
        '<framexaxis name="axis" objtype="site" objname="r.tip"/>'
        '<framelinvel name="rate" objtype="site" objname="r.tip"/>'
        '<e_potential name="energy"/>'
    )
    file = write_model(tmp_path, actuators=dead_load("r.tip", 0, 1), sensors=sensors, ctrl="1")
    found = flex_curves(
        file, cantilever(5), channels=("r.x", "axis.angle", "axis.x", "energy", "rate.x")
    )
    assert set(found.channels) == {"r.x"}
    assert set(found.missing) == {"axis.angle", "axis.x", "energy", "rate.x"}
    assert "no energy" in found.missing["energy"]


@pytest.mark.parametrize(
    ("change", "load", "words"),
    [
        ({"start": "moving"}, (0, 1), "'b' moves"),
        (
            {"end": "ground2", "ends": ("clamped", "clamped")},
            (0, 1),
            "clamped where it begins only",
        ),
        ({}, (0, 1, 0, 0, 0, 1), "moment on a point of a flex"),
    ],
)
def test_rods_that_a_flex_cannot_represent_are_refused(change, load, words, tmp_path):
    body = (
        '<site name="ground2" pos="0.5 0 0"/><body name="b"><joint name="b"/><geom size="0.1"/>'
        '<site name="moving"/></body>'
    )
    file = write_model(tmp_path, body, dead_load("r.tip", *load), ctrl="1")
    with pytest.raises(Unsupported, match=words):
        flex_curves(file, cantilever(5, **change))


def test_flexes_refuse_dynamics_drives_and_single_links(tmp_path):
    file = write_model(tmp_path, actuators=dead_load("r.tip", 0, 1), ctrl="1")
    with pytest.raises(Unsupported, match="only in an equilibrium run"):
        flex_curves(file, cantilever(5), kind="dynamics")
    with pytest.raises(Unsupported, match="'motor1' is driven"):
        flex_curves(PAIR_MODEL, cantilever(5), drives=fixed_motors())
    with pytest.raises(BadRod, match="two or more"):
        flex_curves(file, cantilever(1))


def test_rods_with_dry_friction_are_refused_by_name(tmp_path):
    file = write_model(
        tmp_path,
        '<body name="b"><joint name="b" frictionloss="1"/><geom size="0.1"/></body>',
        dead_load("r.tip", 0, 1),
        ctrl="1",
    )
    with pytest.raises(Unsupported, match="frictionloss of joint 'b' in equilibrium"):
        flex_curves(file, cantilever(5))
    with pytest.raises(Unsupported, match="frictionloss of joint 'b' in equilibrium"):
        simulate(
            file, Run("equilibrium", np.array([0.0, 1.0]), SHAPE_CHANNELS, rods=(cantilever(5),))
        )


def test_nodes_of_a_flex_begin_half_an_element_before_the_clamp():
    assert arc_lengths(cut_into_links(cantilever(2))).tolist() == pytest.approx(
        [-0.2, 0.2, 0.6, 1.0]
    )
    pinned = cut_into_links(cantilever(2, ends=("pinned", "free")))
    assert arc_lengths(pinned).tolist() == pytest.approx([0.0, 0.5, 1.0])


def test_a_flex_that_is_stiffer_or_longer_differs():
    """A rod that is stiffer or longer than the case's parameters say changes an outcome."""
    case, outcomes = load_case(shipped("rod_flex.toml")), []
    for change in ({}, {"stiffness": 1.02}, {"length": 1.01}):
        rods = tuple(replace(rod, **change) for rod in case.rods)
        run = Run(
            "equilibrium",
            np.linspace(0.0, 1.0, 41),
            tuple(case.channels_of("equilibrium")),
            settings={"flex": True},
            rods=rods,
        )
        found = compare(
            case, "equilibrium", "mujoco:flex", simulate(case.model_path, run), detectable=False
        )
        outcomes.append({c.outcome for c in found})
    assert outcomes[0] == {"agrees"}
    assert "differs" in outcomes[1]
    assert "differs" in outcomes[2]
