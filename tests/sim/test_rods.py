"""Tests of rods as chains of links in equilibrium, in both engines.

They are compared with equilibria of chains, which are found without an engine, and of rods.
"""

import numpy as np
import pytest

from proofmass.analytic.rods.assembly import assembly
from proofmass.sim.mjcf import compile_model
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Rod
from tests.independent.rods import chain_rod
from tests.independent.rods.chain import chain, points
from tests.independent.rods.chain_assembly import settle
from tests.sim.rod_models import (
    CLAMP_ANGLES,
    ENGINES,
    FIGURES,
    PAIR_MODEL,
    STEEL_STIFFNESS,
    dead_load,
    equilibrium_curves,
    fixed_motors,
    rod_pair,
    write_model,
)

EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
CLAMPED_FREE, CLAMPED_PINNED = ("clamped", "free"), ("clamped", "pinned")
TIP_CHANNELS = "r.x", "r.y"
PIN_SITE = '<site name="pin" pos="0.8 0.1 0"/>'  # the pin of Pérez Gámiz 2018, annex II line 1640
# both engines end where nothing moves by more than 1e-12 of the model; moments have this error
# times the stiffness
TIGHT = {"x": 1e-12, "y": 1e-12, "angle": 1e-11, "moment": 1e-10}


def cantilever(n: int, scheme: str = "half") -> Rod:
    """A rod with L = 1 m and EI = 1 N m^2, clamped at the ground."""
    return Rod("r", "ground", None, 1.0, 1.0, n, CLAMPED_FREE, scheme)


def tip_position(engine, folder, alpha, n, scheme="half"):
    """Position of a cantilever's tip under a transverse load."""
    file = write_model(folder, actuators=dead_load("r.tip", 0, alpha), ctrl="1")
    found = equilibrium_curves(engine, file, (cantilever(n, scheme),), TIP_CHANNELS)
    return np.array([found.channels[name][-1] for name in TIP_CHANNELS])


@EACH_ENGINE
@pytest.mark.parametrize("scheme", ["half", "double", "naive"])
@pytest.mark.parametrize("n", [2, 7, 20])
def test_a_cantilever_rests_where_its_chain_does(engine, scheme, n, tmp_path):
    """Vertices, directions and moments of all links equal the chain's own equilibrium."""
    load = np.array([-2.0, 3.0, 0.5])
    file = write_model(
        tmp_path,
        actuators=dead_load("r.tip", *load[:2], 0, 0, 0, load[2]),
        ctrl="1",
        sensors='<framepos name="middle" objtype="site" objname="r.middle"/>',
    )
    names = (*(f"r.{part}" for part in TIGHT), "middle.x", "middle.y")
    c = chain(n, scheme=scheme)
    truth = chain_rod.free(c, force=load[:2], moment=load[2])
    ends = points(c, np.zeros(3), truth.angle)
    rod = cantilever(n, scheme)
    found = equilibrium_curves(
        engine, file, (rod,), names, samples=2 * n + 1
    ).channels  # every h / 2
    joints, links = slice(1, None, 2) if scheme == "half" else slice(0, -1, 2), slice(2, None, 2)
    if scheme != "half":
        ends, links = ends[1:], slice(1, None, 2)
    vertices = [0, *range(1, 2 * n, 2), 2 * n] if scheme == "half" else slice(0, None, 2)
    bends = np.diff(truth.angle, prepend=0.0) * c.spring
    for name, values, where in (
        ("x", ends[:, 0], vertices),
        ("y", ends[:, 1], vertices),
        ("angle", truth.angle, links),
        ("moment", bends, joints),
    ):
        np.testing.assert_allclose(found[f"r.{name}"][where], values, atol=TIGHT[name], rtol=0)
    for axis in "xy":
        np.testing.assert_allclose(
            found[f"middle.{axis}"], found[f"r.{axis}"][n], atol=TIGHT["x"], rtol=0
        )


@EACH_ENGINE
@pytest.mark.parametrize("row", FIGURES["cantilever"]["rows"], ids=lambda row: str(row["alpha"]))
def test_a_cantilever_of_links_converges_with_order_2(engine, row, tmp_path):
    """Errors of the tip with 10, 20 and 40 links are of order 2.

    The limit extrapolated from the last two is the elastica's tip.
    """
    truth = np.array([1.0 - row["u"], row["w"]])
    tips = np.array([tip_position(engine, tmp_path, row["alpha"], n) for n in (10, 20, 40)])
    errors = np.linalg.norm(tips - truth, axis=1)
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, 2.0, atol=0.1)  # terms in h^4 with ten links
    limit = tips[2] + (tips[2] - tips[1]) / 3.0
    # terms in h^4, which fall to 1/16 from 20 to 40 links
    np.testing.assert_allclose(limit, truth, atol=1e-6)


def test_a_chain_with_sparse_matrices_has_the_same_equilibrium(tmp_path):
    """From 60 degrees of freedom on MuJoCo chooses sparse matrices; the equilibrium is the same."""
    n, file = 70, write_model(tmp_path, PIN_SITE)
    rod = Rod("r", "ground", "pin", 1.0, 1.0, n, CLAMPED_PINNED, turn=2.0)
    found = equilibrium_curves("mujoco", file, (rod,), ("r.angle",), samples=n + 1).channels[
        "r.angle"
    ]
    truth = chain_rod.pinned(chain(n), (0, 0, 0), (0.8, 0.1), seed=found[1:] + 1e-3)
    np.testing.assert_allclose(found[1:], truth.angle, atol=1e-11, rtol=0)  # as TIGHT


def test_a_naive_clamp_is_of_first_order(tmp_path):
    """Negative control: in the naive scheme, half a cell at the clamp is as soft as a whole one."""
    tips = [tip_position("mujoco", tmp_path, 2.0, n, "naive") for n in (20, 40, 80)]
    row = FIGURES["cantilever"]["rows"][1]
    errors = np.linalg.norm(np.array(tips) - [1.0 - row["u"], row["w"]], axis=1)
    orders = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.1)  # terms in h^2
    assert errors[1] > 50 * np.linalg.norm(
        tip_position("mujoco", tmp_path, 2.0, 40) - [1.0 - row["u"], row["w"]]
    )


@EACH_ENGINE
@pytest.mark.parametrize("turn", [1.25, -1.04])
def test_a_pinned_rod_rests_on_the_side_of_its_arc(engine, turn, tmp_path):
    """Both stable shapes between a clamp and a pin equal the chain's equilibria on their sides."""
    rod = Rod("r", "ground", "pin", 1.0, 0.16493361431346418, 20, CLAMPED_PINNED, turn=turn)
    found = equilibrium_curves(
        engine, write_model(tmp_path, PIN_SITE), (rod,), (*TIP_CHANNELS, "r.angle"), samples=21
    ).channels
    c = chain(20, stiffness=rod.stiffness)
    truth = chain_rod.pinned(c, (0, 0, 0), (0.8, 0.1), seed=found["r.angle"][1:] + 1e-3)
    np.testing.assert_allclose(found["r.angle"][1:], truth.angle, atol=1e-11, rtol=0)  # as TIGHT
    assert truth.curvatures[0] > 0
    assert found["r.angle"][-1] == pytest.approx(turn, abs=0.01)  # the chain's error in h^2
    assert np.hypot(found["r.x"][-1] - 0.8, found["r.y"][-1] - 0.1) < 1e-14


@EACH_ENGINE
@pytest.mark.parametrize("name", ["S1", "S2", "S3", "S4"])
def test_all_stable_equilibria_of_a_pair(engine, name):
    """The equilibria of Pérez Gámiz 2018, Table 7, and the two that it lacks.

    The turns of the initial arcs choose among them.  The chain's own equilibrium is sought from the
    engine's shape.  The limit of fine links, extrapolated from two numbers of links, shows which
    equilibrium this is.  pymunk has half as many links as MuJoCo, since it takes seconds for 20.
    """
    truth, names = FIGURES["pair"][name], ("pin.x", "pin.y", "moment1", "moment2", "energy")
    shape = tuple(f"{rod}.angle" for rod in ("left", "right"))
    runs = {
        n: equilibrium_curves(
            engine, PAIR_MODEL, rod_pair(name, n), (*names, *shape), fixed_motors(), n + 1
        ).channels
        for n in ((20, 40) if engine == "mujoco" else (10, 20))
    }
    bodies = assembly([[-0.3, 0.0], [0.3, 0.0]], stiffness=STEEL_STIFFNESS)
    seed = [runs[20][angle][1:] + 1e-4 for angle in shape]
    chain_state = settle(bodies, CLAMP_ANGLES, seed=seed, segments=20, force=(0.3, -0.1))
    assert chain_state.curvatures[0] > 0
    values = [
        *chain_state.pose,
        *-chain_state.root_moment,
        chain_state.energy,
    ]  # the motors hold against the rods
    # as TIGHT, over the softness of the pair
    np.testing.assert_allclose([runs[20][n][0] for n in names], values, atol=1e-11, rtol=0)
    coarse, fine = runs
    limit = [(4 * runs[fine][n][0] - runs[coarse][n][0]) / 3 for n in names]
    exact = [*truth["pin"], *np.negative(truth["m0"]), truth["energy"]]
    # terms in h^4 of the moments, which are 16 times as large with half as many links
    np.testing.assert_allclose(limit, exact, atol=2e-5 if engine == "mujoco" else 16 * 2e-5)


@pytest.mark.parametrize("kept", ["clamped", "pinned"])
def test_static_bodies_that_carry_rods_are_not_fused(kept, tmp_path):
    """The model is the same with ``fusestatic`` false and true.

    The rod begins on a body without a joint, which is rotated and displaced; with a clamp, its
    first link is such a body too.
    """
    rod, models = Rod("r", "foot", "pin", 1.0, 1.0, 3, (kept, "pinned"), turn=1.0), []
    file = write_model(
        tmp_path,
        '<body name="b" pos="1 2 0" euler="0 0 1"><site name="foot"/></body>'
        '<site name="pin" pos="1.3 2.8 0"/>',
    )
    for word in ("false", "true"):
        file.write_text(file.read_text().replace("<compiler ", f'<compiler fusestatic="{word}" '))
        models.append(compile_model(file, [rod]))
        file.write_text(file.read_text().replace(f'fusestatic="{word}" ', ""))
    one, two = models
    assert [one.body(b).name for b in range(one.nbody)] == [
        two.body(b).name for b in range(two.nbody)
    ]
    np.testing.assert_array_equal(one.key_qpos, two.key_qpos)
    np.testing.assert_array_equal(one.body_pos, two.body_pos)


def test_keys_have_joint_values_and_arcs_of_rods(tmp_path):
    """In every key the model's own joints keep their values, and rods are arcs between supports."""
    body = (
        '<body name="b"><joint name="{0}"/><geom size="0.1"/><site name="{0}.site" '
        'pos="0.1 0 0"/></body>'
    )
    file = write_model(tmp_path, body.format("one") + body.format("two").replace('"b"', '"c"'))
    text = file.read_text().replace(
        '<key name="start" ctrl=""/>', '<key name="start" qpos="0.3 0.2"/><key name="b"/>'
    )
    file.write_text(text)
    rods = (
        Rod("r", "one.site", None, 1.0, 1.0, 4, CLAMPED_FREE, turn=1.0),
        Rod("q", "two.site", "r.tip", 1.5, 1.0, 3, CLAMPED_PINNED, "double", turn=2.0),
    )
    found = compile_model(file, rods)
    value = dict(
        zip([found.joint(j).name for j in range(found.njnt)], found.key_qpos.T, strict=True)
    )
    assert value["one"].tolist() == [0.3, 0.0]
    assert value["two"].tolist() == [0.2, 0.0]
    np.testing.assert_allclose([value[f"r.{k}"] for k in range(1, 5)], 0.25, rtol=1e-15)
    assert found.body("q.1").mass[0] == pytest.approx(0.01 / 3, rel=1e-14, abs=0)
    assert [found.joint(f"q.{k}").stiffness[0] for k in (1, 2, 3)] == [4.0, 2.0, 2.0]
    assert found.equality("q").name == "q"


@EACH_ENGINE
def test_an_s_between_clamps_is_two_rods_from_clamp_to_pin(engine, tmp_path):
    """Between two clamps a rod forms an S, each half of which is a rod from a clamp to a pin."""
    whole = Rod("r", "ground", "far", 1.0, 1.0, 20, ("clamped", "clamped"))
    half = Rod("r", "ground", "pin", 0.5, 1.0, 10, CLAMPED_PINNED, turn=0.3)
    file = write_model(
        tmp_path, '<site name="far" pos="0.9 0.4 0"/><site name="pin" pos="0.45 0.2 0"/>'
    )
    names = (*TIP_CHANNELS, "r.angle", "r.moment")
    whole_curves, half_curves = (
        equilibrium_curves(engine, file, (rod,), names, samples=rod.segments + 1).channels
        for rod in (whole, half)
    )
    for name, atol in zip(names, TIGHT.values(), strict=True):
        np.testing.assert_allclose(
            whole_curves[name][:10], half_curves[name][:10], atol=atol, rtol=0
        )
    # point symmetry about the middle
    np.testing.assert_allclose(
        whole_curves["r.angle"], whole_curves["r.angle"][::-1], atol=1e-11, rtol=0
    )  # as TIGHT
    assert whole_curves["r.angle"][-1] == pytest.approx(0.0, abs=1e-13)


@EACH_ENGINE
def test_half_of_a_rod_pinned_at_both_ends_is_a_cantilever(engine, tmp_path):
    """Half of the rod is a cantilever under an axial force.

    P L^2 / EI of the cantilever is a quarter of that of the rod.
    """
    rod = Rod("r", "ground", "far", 1.0, 1.0, 20, ("pinned", "pinned"), turn=-2.0)
    file = write_model(tmp_path, '<site name="far" pos="0.5 0 0"/>')
    found = equilibrium_curves(
        engine, file, (rod,), (*TIP_CHANNELS, "r.angle", "r.moment"), samples=21
    ).channels
    height, bend = found["r.y"][10], found["r.moment"][10]
    force = -bend / height  # the only force, along the line of the pins
    load = write_model(tmp_path, actuators=dead_load("r.tip", -force), ctrl="1")
    half = Rod("r", "ground", None, 0.5, 1.0, 10, CLAMPED_FREE, turn=1.0)
    there = equilibrium_curves(engine, load, (half,), TIP_CHANNELS).channels
    assert force > np.pi**2  # beyond Euler's load
    # a chain's middle link has the moment of its neighbours; 1e-10 is rounding, magnified by the
    # softness of the half
    assert (there["r.x"][-1], there["r.y"][-1]) == pytest.approx((0.25, height), abs=1e-10)


@EACH_ENGINE
@pytest.mark.parametrize(
    ("euler", "force"), [("1.5707963267948966 0 0", (0, 0, 3)), ("0 0 0.7", (0, 3, 0))]
)
def test_rods_bend_in_the_plane_of_their_site(engine, euler, force, tmp_path):
    """In another plane, or in another direction in the plane, the shape is the same, rotated."""
    site = f'<site name="clamp" pos="0.1 0.2 0.3" euler="{euler}"/>'
    file = write_model(tmp_path, site, dead_load("r.tip", *force), ctrl="1")
    rod = Rod("r", "clamp", None, 1.0, 1.0, 10, CLAMPED_FREE)
    names = "r.x", "r.y", "r.z", "r.angle"
    found = equilibrium_curves(engine, file, (rod,), names, samples=11).channels
    turn = 0.7 if force[1] else 0.0
    truth = chain_rod.free(chain(10), (0, 0, turn), force=(0, 3))
    x, y = (found["r.x"] - 0.1, found["r.y" if force[1] else "r.z"] - (0.2 if force[1] else 0.3))
    np.testing.assert_allclose([x[-1], y[-1]], truth.tip, atol=1e-12, rtol=0)  # as TIGHT
    np.testing.assert_allclose(found["r.angle"][1:], truth.angle, atol=1e-11, rtol=0)  # as TIGHT


@EACH_ENGINE
def test_a_rod_hangs_under_its_own_weight(engine, tmp_path):
    """Each link has its share of the mass, so that the chain is as under a distributed load."""
    file = write_model(tmp_path, gravity="0 -10 0")
    rod = Rod("r", "ground", None, 1.0, 1.0, 20, CLAMPED_FREE, mass=0.3)
    found = equilibrium_curves(engine, file, (rod,), TIP_CHANNELS).channels
    truth = chain_rod.free(chain(20), line=(0.0, -3.0)).tip
    np.testing.assert_allclose(
        [found[n][-1] for n in TIP_CHANNELS], truth, atol=1e-12, rtol=0
    )  # as TIGHT


def test_an_unstable_equilibrium_is_refused(tmp_path):
    """From a straight start, a rod between two clamps is led to an S, which is unstable here."""
    rod = Rod("r", "ground", "far", 1.0, 1.0, 20, ("clamped", "clamped"))
    file = write_model(tmp_path, '<site name="far" pos="0.8 0.2 0"/>')
    with pytest.raises(BadModel, match="unstable equilibrium"):
        equilibrium_curves("mujoco", file, (rod,), TIP_CHANNELS)
