"""Tests of undriven degrees of freedom in sweeps of MuJoCo.

They are in equilibrium of springs, weights, motors and stops.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, root

from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.sim.mujoco.engine import simulate
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run

G = 10.0
DRIVE_OF_A = Drive("a", lambda x: (x, np.ones_like(x), np.zeros_like(x)))
MODEL = """<mujoco><compiler angle="radian"/><option gravity="0 {gravity} 0">
  <flag contact="disable" energy="enable"/></option><worldbody>{bodies}</worldbody>
  <equality>{equality}</equality><actuator><motor name="hold" joint="a"/>{motors}</actuator>
  <sensor><actuatorfrc name="hold" actuator="hold"/>{sensors}</sensor>
  <keyframe><key name="start" {key}/></keyframe></mujoco>"""


def joint_sensors(*names: str) -> str:
    """The MJCF of sensors of joints' values and rates."""
    return "".join(
        f'<jointpos name="{n}" joint="{n}"/><jointvel name="{n}_rate" joint="{n}"/>' for n in names
    )


def body_on_joint(
    name: str,
    inside: str = "",
    at: str = "0 0 0",
    mass: str = "1",
    centre: str = "1 0 0",
    **joint: str,
) -> str:
    """The MJCF of a link on a joint, with its mass in a point."""
    more = " ".join(f'{key}="{value}"' for key, value in joint.items())
    return (
        f'<body name="{name}" pos="{at}"><joint name="{name}" {more}/><inertial pos="{centre}" '
        f'mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/>{inside}</body>'
    )


@pytest.fixture
def sweep(tmp_path: Path):
    """``sweep(x, channels, bodies, ...)`` runs a sweep of the joint "a" of a small model."""

    def run(
        x,
        channels,
        bodies,
        equality="",
        motors="",
        sensors="",
        key="",
        gravity=-G,
        more="",
        **settings,
    ) -> Curves:
        file = tmp_path / "model.xml"
        file.write_text(
            MODEL.format(
                bodies=bodies,
                equality=equality,
                motors=motors,
                key=key,
                gravity=gravity,
                sensors=joint_sensors(*sensors.split()) + more,
            )
        )
        return simulate(
            file, Run("sweep", np.asarray(x), channels, (DRIVE_OF_A,), settings=settings)
        )

    return run


def chain_of_links(n: int, stiffness: float, length: float, mass: float, end: str = "") -> str:
    """The MJCF of links a, b1, b2 ... in a row along x, each with its mass at its far end."""
    inside = end
    for k in range(n - 1, 0, -1):
        inside = body_on_joint(
            f"b{k}", inside, f"{length} 0 0", str(mass), f"{length} 0 0", stiffness=str(stiffness)
        )
    return body_on_joint("a", inside, mass=str(mass), centre=f"{length} 0 0")


@pytest.mark.parametrize(
    ("n", "stiffness", "length", "mass"),
    [(2, 30.0, 1.0, 1.0), (3, 40.0, 0.7, 1.0), (10, 20.0, 0.1, 0.2), (30, 60.0, 1 / 30, 0.05)],
)
def test_a_sprung_chain_under_its_weight_is_in_equilibrium(n, stiffness, length, mass, sweep):
    """The angles solve dV/dq = 0 of the energy V, as solved by scipy; the first link is driven."""

    def slope(q):
        bends = G * mass * length * np.arange(n, 0, -1) * np.cos(np.cumsum(q))
        return np.cumsum(bends[::-1])[::-1] + stiffness * q * (np.arange(n) > 0)

    names = ["a", *(f"b{k}" for k in range(1, n))]
    x = np.linspace(0.0, 1.0, 6)
    curves = sweep(
        x, ("hold", *names), chain_of_links(n, stiffness, length, mass), sensors=" ".join(names)
    )
    for k, first in enumerate(x):
        found = np.array([curves.channels[name][k] for name in names])
        rest = root(lambda q, first=first: slope(np.array([first, *q]))[1:], found[1:], tol=1e-14).x
        truth = np.array([first, *rest])
        np.testing.assert_allclose(
            found, truth, atol=1e-12, rtol=0
        )  # rounding over the chain's softness
        assert curves.channels["hold"][k] == pytest.approx(slope(truth)[0], abs=1e-12)


def test_a_pinned_chain_of_ten_links_is_in_equilibrium(sweep):
    """Ten links with springs between them lead from (0, 0) to (0.8, 0); the first is driven.

    The reference is scipy's solution of the balance of moments and of the loop, with the pin's
    forces as unknowns.
    """
    n, length, stiffness, span = 10, 0.1, 2.0, 0.8
    turn = brentq(lambda b: length * np.sin(n * b / 2) / np.sin(b / 2) - span, 1e-3, 0.6)
    # an arc of a circle, which is near the equilibrium
    arc = np.array([-(n - 1) * turn / 2, *np.full(n - 1, turn)])

    def moments(first, unknown):
        """Moment on each joint, and the constraint violation of the loop."""
        angle, pin = np.cumsum([first, *unknown[:-2]]), unknown[-2:]
        east, north = length * np.cos(angle), length * np.sin(angle)
        arms = np.array([-north[::-1].cumsum()[::-1], east[::-1].cumsum()[::-1]])
        return (
            np.array([0.0, *stiffness * unknown[:-2]]) - pin @ arms,
            np.array([east.sum() - span, north.sum()]),
        )

    names = ["a", *(f"b{k}" for k in range(1, n))]
    x = arc[0] + np.linspace(0.0, 0.5, 6)
    curves = sweep(
        x,
        ("hold", *names),
        f'<site name="pin" pos="{span} 0 0"/>'
        + chain_of_links(n, stiffness, length, 0.1, '<site name="end" pos="0.1 0 0"/>'),
        '<connect site1="end" site2="pin"/>',
        sensors=" ".join(names),
        gravity=0,
        key=f'qpos="{" ".join(map(repr, arc.tolist()))}"',
    )
    for k, first in enumerate(x):
        found = [curves.channels[name][k] for name in names[1:]]
        truth = root(
            lambda u, first=first: np.concatenate([moments(first, u)[0][1:], moments(first, u)[1]]),
            [*found, 0.0, 0.0],
            tol=1e-14,
        ).x
        np.testing.assert_allclose(
            found, truth[:-2], atol=1e-12, rtol=0
        )  # rounding over the softness
        assert curves.channels["hold"][k] == pytest.approx(moments(first, truth)[0][0], abs=1e-12)


def test_rates_are_derivatives_along_the_equilibrium_path(sweep):
    """An inverted pendulum on a spring has k (t - a) = w sin t and dt/da = k / (k - w cos t)."""
    k, w = 15.0, 10.0
    curves = sweep(
        np.linspace(0.0, 2.0, 21),
        ("hold", "b", "b_rate", "a_rate"),
        body_on_joint("a", body_on_joint("b", centre="0 1 0", stiffness=str(k)), centre="0 0 0"),
        sensors="a b",
    )
    t = curves.x + curves.channels["b"]
    np.testing.assert_allclose(
        k * (t - curves.x), w * np.sin(t), atol=1e-13, rtol=0
    )  # rounding of w
    np.testing.assert_allclose(curves.channels["hold"], -w * np.sin(t), atol=1e-13, rtol=0)
    # the second difference of forces is sure to 1e-10
    np.testing.assert_allclose(
        curves.channels["b_rate"], k / (k - w * np.cos(t)) - 1, atol=1e-9, rtol=0
    )
    np.testing.assert_array_equal(curves.channels["a_rate"], 1.0)


def test_a_motor_and_a_progressive_spring_hold_a_weight_on_a_slide(sweep):
    """Motors push up with 3 + 2 * 4 = 11 N, the weight is 10 N, the spring 5 q + 7 q^2.

    The displacement q is the same at all angles of the drive.
    """
    q = (-5 + np.sqrt(25 + 4 * 7)) / 14
    curves = sweep(
        [0.0, 1.0, 2.0],
        ("hold", "b"),
        body_on_joint("a")
        + body_on_joint("b", centre="0 0 0", type="slide", axis="0 1 0", stiffness="5 7"),
        sensors="b",
        motors='<motor joint="b"/><motor joint="b" gear="2"/>',
        key='ctrl="9 3 4"',
    )
    np.testing.assert_allclose(curves.channels["b"], q, atol=1e-14, rtol=0)  # rounding
    np.testing.assert_allclose(curves.channels["hold"], G * np.cos(curves.x), atol=1e-13, rtol=0)


def test_joint_equalities_transmit_weights_to_the_free_joint(sweep):
    """With c = 0.5 b + 0.1 b^2, b minimizes V = w sin(a + b) + w sin(c) + k (b - 0.3)^2 / 2."""
    curves = sweep(
        np.linspace(0.0, 1.0, 5),
        ("hold", "b", "c"),
        body_on_joint("a", body_on_joint("b", stiffness="25", springref="0.3"), centre="0 0 0")
        + body_on_joint("c"),
        '<joint joint1="c" joint2="b" polycoef="0 0.5 0.1 0 0"/>',
        sensors="b c",
    )
    b, c = curves.channels["b"], curves.channels["c"]
    slope = G * np.cos(curves.x + b) + G * np.cos(c) * (0.5 + 0.2 * b) + 25 * (b - 0.3)
    np.testing.assert_allclose(slope, 0, atol=1e-13)  # rounding of 25
    np.testing.assert_allclose(c, 0.5 * b + 0.1 * b**2, atol=1e-15, rtol=0)


PRELOAD = 6.0
PRELOADED_ON_STOP = {"stiffness": "20", "springref": str(PRELOAD / 20), "range": "-2 0"}
"""A spring that presses a joint on its stop with 6 N m."""


def test_a_preloaded_joint_leaves_its_stop_where_the_weight_exceeds_the_preload(sweep):
    """The joint leaves its stop at w cos(a) = preload; then w cos(a + b) = preload - k b."""
    away = -np.arccos(PRELOAD / G)
    x = np.sort([*np.linspace(-np.pi / 2, 0.5, 99), away - 1e-9, away + 1e-9])
    curves = sweep(
        x,
        ("hold", "b"),
        body_on_joint("a", body_on_joint("b", **PRELOADED_ON_STOP), centre="0 0 0"),
        sensors="b",
        key=f'qpos="{x[0]} 0"',
    )
    b, on = curves.channels["b"], x < away
    np.testing.assert_allclose(b[on], 0, atol=1e-15)  # rounding of the pose
    free = [
        brentq(lambda q, a=a: G * np.cos(a + q) - PRELOAD + 20 * q, -1, 0.1, xtol=1e-15)
        for a in x[~on]
    ]
    np.testing.assert_allclose(b[~on], free, atol=1e-14, rtol=0)  # rounding of w over k
    assert -1e-9 < b[~on][0] < 0
    np.testing.assert_allclose(curves.channels["hold"], G * np.cos(x + b), atol=1e-13, rtol=0)


def test_several_stops_switch_at_once_on_both_sides(sweep):
    """Springs of 4 N m/rad connect three free wheels with ranges of their own to the driven one."""
    x = np.linspace(-1.5, 1.5, 31)
    ranges = {"b": (-1.0, 0.5), "c": (-1.0, 0.5), "d": (0.0, 2.0)}
    wheels = body_on_joint("a") + "".join(
        body_on_joint(n, centre="0 0 0", range=f"{low} {high}") for n, (low, high) in ranges.items()
    )
    springs = "".join(
        f'<fixed stiffness="4" springlength="0"><joint joint="a" coef="1"/>'
        f'<joint joint="{n}" coef="-1"/></fixed>'
        for n in ranges
    )
    curves = sweep(
        x,
        ("hold", *ranges),
        f"{wheels}</worldbody><tendon>{springs}</tendon><worldbody>",
        sensors="b c d",
        key='qpos="-1.5 -1 -1 0"',
        gravity=0,
    )
    for name, ends in ranges.items():
        np.testing.assert_allclose(curves.channels[name], np.clip(x, *ends), atol=1e-15, rtol=0)
    moment = sum(4 * (x - np.clip(x, *ends)) for ends in ranges.values())
    np.testing.assert_allclose(curves.channels["hold"], moment, atol=1e-14, rtol=0)  # rounding


def test_a_sweep_ends_at_a_fold_of_the_equilibrium_path(sweep):
    """The path k (t - a) = w sin t has a fold at cos t = k / w, where the pendulum would snap."""
    k, first = 5.0, -2.5
    fold = -np.arccos(k / G)
    last = fold - G / k * np.sin(fold)
    begin = first - G / k * np.sin(first)
    curves = sweep(
        np.linspace(begin, 2.0, 41),
        ("hold", "b"),
        body_on_joint("a", body_on_joint("b", centre="0 1 0", stiffness=str(k)), centre="0 0 0"),
        sensors="b",
        key=f'qpos="{begin} {first - begin}"',
    )
    assert curves.x.size == np.searchsorted(np.linspace(begin, 2.0, 41), last)
    assert curves.stopped == f"the equilibrium becomes unstable beyond a = {last:.6g}"
    t = curves.x + curves.channels["b"]
    np.testing.assert_allclose(k * (t - curves.x), G * np.sin(t), atol=1e-13, rtol=0)


MASS_ON_UPRIGHT_ROD = body_on_joint(
    "b",
    body_on_joint("a", type="slide", axis="0 1 0", centre="0 0 0"),
    centre="0 0 0",
    stiffness="7",
)
"""A mass that the drive lifts along a rod, which is upright on a torsion spring."""


def test_a_sweep_ends_where_a_symmetric_equilibrium_becomes_unstable(sweep):
    """The upright rod is stable until the mass is at k / (m g) = 0.7 m, where the path branches."""
    x = np.linspace(0.1, 1.0, 20)
    curves = sweep(x, ("hold", "b"), MASS_ON_UPRIGHT_ROD, sensors="b", key='qpos="0 0.1"')
    assert curves.stopped == "the equilibrium becomes unstable beyond a = 0.7"
    np.testing.assert_array_equal(curves.x, x[x < 0.7])
    np.testing.assert_allclose(curves.channels["b"], 0, atol=1e-9)
    np.testing.assert_allclose(curves.channels["hold"], G, atol=1e-13, rtol=0)


def test_with_a_small_asymmetry_the_equilibrium_path_continues(sweep):
    """With a moment of 1e-6 N m the rod leans over gradually: k b = m g s sin b + 1e-6."""
    curves = sweep(
        np.linspace(0.1, 1.0, 19),
        ("b",),
        MASS_ON_UPRIGHT_ROD,
        sensors="b",
        key='qpos="0 0.1" ctrl="0 1e-6"',
        motors='<motor joint="b"/>',
    )
    s, b = curves.x, curves.channels["b"]
    assert not curves.stopped
    assert b[-1] > 1
    np.testing.assert_allclose(7 * b - G * s * np.sin(b), 1e-6, atol=1e-13)  # rounding of 7


def test_a_sweep_ends_where_stops_block_the_drive(sweep):
    """Two sprung slides in series reach up to 0.5 m each, so that nothing moves beyond a = 1 m."""
    slide = {"type": "slide", "axis": "1 0 0", "centre": "0 0 0"}
    soft = slide | {"stiffness": "3", "range": "-1 0.5"}
    bodies = body_on_joint("a", '<site name="s"/>', **slide) + body_on_joint(
        "b", body_on_joint("c", '<site name="t"/>', **soft), **soft
    )
    curves = sweep(
        np.linspace(0, 1.4, 30),
        ("hold", "b"),
        bodies,
        '<connect site1="s" site2="t"/>',
        sensors="b",
    )
    assert curves.stopped == "the joint limits of b, c block the motion beyond a = 1"
    np.testing.assert_array_equal(curves.x, np.linspace(0, 1.4, 30)[:21])
    np.testing.assert_allclose(curves.channels["b"], curves.x / 2, atol=1e-15, rtol=0)
    np.testing.assert_allclose(curves.channels["hold"], 1.5 * curves.x, atol=1e-14, rtol=0)


def test_a_sweep_ends_where_an_arm_is_fully_stretched(sweep):
    """The end of three sprung links of 1 m is drawn away until they are in line, at 3 m."""
    first = np.array([-0.9, 1.0, 0.0])
    first[2] = np.arcsin(np.sin(0.9) - np.sin(0.1)) - 0.1  # its end lies on the x axis
    x = np.linspace(np.cos(np.cumsum(first)).sum(), 3.2, 40)
    arm = body_on_joint(
        "b",
        body_on_joint(
            "c",
            body_on_joint("d", '<site name="t" pos="1 0 0"/>', "1 0 0", stiffness="2"),
            "1 0 0",
            stiffness="3",
        ),
        stiffness="1",
        springref="-0.3",
    )
    curves = sweep(
        x,
        ("b", "c", "d"),
        arm + body_on_joint("a", '<site name="s"/>', type="slide", axis="1 0 0"),
        '<connect site1="s" site2="t"/>',
        sensors="b c d",
        gravity=0,
        key=f'qpos="{first[0]} {first[1]} {first[2]} {x[0]}"',
    )
    assert curves.stopped == "the loops cannot be closed beyond a = 3"
    np.testing.assert_array_equal(curves.x, x[x < 3])


def test_a_start_pose_out_of_equilibrium_is_corrected(sweep):
    bodies = body_on_joint("a", body_on_joint("b", centre="0 -1 0", range="-3 3"), centre="0 0 0")
    curves = sweep([0.0, 0.5], ("b",), bodies, sensors="b", key='qpos="0 0.4"')
    np.testing.assert_allclose(curves.channels["b"], [0.0, -0.5], atol=1e-14, rtol=0)  # it hangs


@pytest.mark.parametrize(
    ("bodies", "options", "error", "said"),
    [
        (
            body_on_joint("a", body_on_joint("b", centre="0 1 0", stiffness="9"), centre="0 0 0"),
            {},
            BadModel,
            "the start pose is an unstable equilibrium when a = 0",
        ),
        (
            body_on_joint("a") + body_on_joint("b"),
            {"gravity": 0},
            Unsupported,
            "1 degree(s) of freedom left when a = 0 is held, and nothing brings them to rest",
        ),
        (
            body_on_joint("a") + body_on_joint("b"),
            {},
            Unsupported,
            "1 degree(s) of freedom left when a = 0 is held, and the start pose is not near rest: "
            "joint 'b' moves by more than 0.5 (rad, or extents)",
        ),
        (
            body_on_joint("a") + body_on_joint("b", type="slide"),
            {"gravity": 0, "motors": '<motor joint="b"/>', "key": 'ctrl="0 1"'},
            Unsupported,
            "not near rest",
        ),
    ],
)
def test_starts_without_stable_equilibrium_are_refused(bodies, options, error, said, sweep):
    with pytest.raises(error) as caught:
        sweep([0.0, 0.1, 0.2], ("hold",), bodies, **options)
    assert said in str(caught.value)


TENDON_WITH_FRICTION = (
    "</worldbody><tendon><fixed name='rope' frictionloss='2'><joint joint='a' coef='1'"
    "/></fixed></tendon><worldbody>"
)


@pytest.mark.parametrize(
    ("bodies", "named", "settled"),
    [
        (body_on_joint("a", frictionloss="50"), "joint 'a'", True),
        (
            body_on_joint("a") + body_on_joint("b", frictionloss="1", stiffness="9"),
            "joint 'b'",
            True,
        ),
        (body_on_joint("a") + TENDON_WITH_FRICTION, "tendon 'rope'", False),
        (body_on_joint("a") + TENDON_WITH_FRICTION, "tendon 'rope'", True),
    ],
)
def test_friction_is_refused_by_name_where_it_is_not_determined(bodies, named, settled, sweep):
    kind = "settled sweep" if settled else "sweep"
    with pytest.raises(Unsupported, match=f"frictionloss of {named} in a {kind}"):
        sweep([0.0, 0.1], ("hold",), bodies, settled=settled)


def test_a_sweep_stops_where_a_joint_that_the_drive_moves_leaves_its_range(sweep):
    follower = '<joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/>'
    curves = sweep(
        [0.0, 0.1, 0.2, 0.3, 0.4],
        ("hold", "b"),
        body_on_joint("a") + body_on_joint("b", range="-1 .4"),
        follower,
        sensors="b",
    )
    assert curves.x.tolist() == [0.0, 0.1, 0.2]  # b is at the end of its range at 0.2
    assert curves.stopped == "joint 'b' is beyond its range at a = 0.3"


def test_an_equilibrium_beyond_a_range_is_an_error(tmp_path):
    """The drive's first value moves a joint beyond its range, which the drive alone determines."""
    file = tmp_path / "model.xml"
    file.write_text(
        MODEL.format(
            bodies=body_on_joint("a") + body_on_joint("b", range="-1 .4"),
            equality='<joint joint1="b" joint2="a" polycoef="0 2 0 0 0"/>',
            motors="",
            key="",
            gravity=-G,
            sensors="",
        )
    )
    run = Run("equilibrium", np.array([0.3, 0.4]), ("hold",), (DRIVE_OF_A,))
    with pytest.raises(BadModel, match="joint 'b' is beyond its range"):
        simulate(file, run)


def test_the_rate_of_a_free_joint_is_that_of_its_changing_load(tmp_path):
    """A spring of 5 N m/rad under a moment that grows by 2 N m/s turns by 0.4 rad/s."""
    file = tmp_path / "model.xml"
    file.write_text(
        MODEL.format(
            bodies=body_on_joint("a", centre="0 0 0")
            + body_on_joint("b", centre="0 0 0", stiffness="5"),
            equality="",
            motors='<motor name="push" joint="b"/>',
            key="",
            gravity=0,
            sensors=joint_sensors("b"),
        )
    )
    load = ChangingLoad("push", lambda x: (1 + 2 * x, 2 + 0 * x, 0 * x))
    run = Run("sweep", np.linspace(0, 1, 5), ("b", "b_rate"), (DRIVE_OF_A,), loads=(load,))
    found = simulate(file, run).channels
    np.testing.assert_allclose(found["b"], 0.2 + 0.4 * run.x, rtol=1e-12)
    np.testing.assert_allclose(found["b_rate"], 0.4, rtol=1e-12)


def test_an_equilibrium_has_no_rates(models):
    case = load_case(models / "rod_pinned.toml")
    text = case.model_path.read_text()
    joint = '<jointvel name="speed" joint="rod.1"/>'
    case.model_path.write_text(text.replace("</sensor>", joint + "</sensor>", 1))
    speed = case.channels["rod.angle"].model_copy(update={"unit": "rad/s"})
    changed = case.model_copy(update={"channels": {**case.channels, "speed": speed}})
    curves = solve_here(changed, "equilibrium", "mujoco")
    assert curves.missing["speed"].startswith("nothing moves in an equilibrium run")


@pytest.mark.parametrize("stage", ['needstage="acc"', 'needstage="pos"'])
def test_an_equilibrium_path_has_no_accelerations(stage, sweep):
    user = f'<user name="u" objtype="joint" objname="b" datatype="real" {stage} dim="1"/>'
    bodies = body_on_joint("a", body_on_joint("b", centre="0 -1 0"), centre="0 0 0")
    curves = sweep([0.0, 0.1], ("hold", "u", "b_rate"), bodies, sensors="b", more=user)
    assert set(curves.channels) == {"hold", "b_rate"}
    assert "no accelerations" in curves.missing["u"]
    assert curves.derivatives == 1
    assert sweep([0.0, 0.1], ("hold",), body_on_joint("a")).derivatives == 2


def test_contacts_are_refused_where_the_drive_determines_the_pose(edit):
    """Contact forces would be missing in the holding moment."""
    file = edit("fourbar.xml", r'<flag contact="disable"/>', "")
    drive = Drive("crank", lambda x: (x, 1 + 0 * x, 0 * x))
    with pytest.raises(Unsupported, match=r"contact\(s\) in a sweep, at crank = "):
        simulate(file, Run("sweep", np.linspace(0, 6.2, 20), ("rocker",), (drive,)))
