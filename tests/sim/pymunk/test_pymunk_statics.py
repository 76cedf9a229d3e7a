"""Tests of undriven joints in sweeps of pymunk: nonlinear springs, stops that are left or met."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk.engine import simulate
from proofmass.sim.pymunk.links import LinkJoint
from proofmass.sim.pymunk.quasi_static import lagrange_weights, ratio_of_ways, rests_on_way
from tests.shipped import shipped

NO_GRAVITY = '<option gravity="0 0 0"><flag contact="disable"/></option>'
WITH_GRAVITY = '<option gravity="0 -9.81 0"><flag contact="disable"/></option>'
MOMENT_SENSOR = '<jointactuatorfrc name="moment" joint="crank"/>'


def swept_curves(folder: Path, text: str, x, channels, joint: str, profile=lambda x: x):
    file = folder / "model.xml"
    file.write_text(f'<mujoco><compiler angle="radian"/>{text}</mujoco>')
    drive = Drive(joint, lambda x: (profile(x), 0 * x, 0 * x))
    return simulate(file, Run("sweep", np.asarray(x), channels, (drive,)))


def arm_model(joint: str, gravity: str = WITH_GRAVITY) -> str:
    """The MJCF of an arm of 2 kg and 0.8 m on the pin of a crank of 1 m.

    The crank's centre of mass is on its axis.
    """
    return (
        f'{gravity}<worldbody><body><joint name="crank"/><inertial pos="0 0 0" mass="1" '
        f'diaginertia="1 1 1"/><body pos="1 0 0"><joint name="arm" {joint}/>'
        '<inertial pos=".4 0 0" mass="2" diaginertia=".01 .2 .2"/></body></body></worldbody>'
        '<sensor><jointpos name="arm" joint="arm"/><e_potential name="energy"/>'
        f"{MOMENT_SENSOR}</sensor>"
    )


@pytest.mark.parametrize("joint", ["crank", "coupler", "rocker"])
def test_a_damper_changes_no_curve_of_a_sweep(joint, tmp_path):
    """A damper changes no curve of a sweep.

    In the space of a sweep it would hinder the solver, with moments of ten times their range.
    """
    text = shipped("fourbar.xml").read_text()
    drive = Drive("crank", lambda x: (x, 1.0 + 0 * x, 0 * x))
    channels = ("rocker", "rocker_rate", "holding_moment")
    run = Run("sweep", np.linspace(0.0, 1.0, 4), channels, (drive,))
    own = simulate(shipped("fourbar.xml"), run).channels
    damped = tmp_path / "damped.xml"
    damped.write_text(
        text.replace(f'<joint name="{joint}"/>', f'<joint name="{joint}" damping="5"/>')
    )
    assert damped.read_text() != text
    got = simulate(damped, run).channels
    for name in channels:
        np.testing.assert_array_equal(got[name], own[name])


@pytest.mark.parametrize(
    "stiffness", [(9.0, -4.0, 0.0), (25.0, 5.0, 0.0), (3.0, 0.0, 8.0), (6.0, -7.0, 3.0)]
)
def test_a_polynomial_spring_balances_a_weight(stiffness, tmp_path):
    """The arm rests where k e + a e^2 + b e^3 = -m g s cos(crank + arm).

    e is the arm's angle minus the rest angle of the spring.
    """
    k, a, b = stiffness
    x, ref = np.linspace(0.3, 1.2, 7), 0.2
    got = swept_curves(
        tmp_path,
        arm_model(f'stiffness="{k} {a} {b}" springref="{ref}"'),
        x,
        ("arm", "moment", "energy"),
        "crank",
    ).channels

    def lacking(e, crank):
        return e * (k + e * (a + e * b)) + 2 * 9.81 * 0.4 * np.cos(crank + ref + e)

    e = np.array([brentq(lacking, -1.2, 0.0, args=(crank,), xtol=1e-15) for crank in x])
    np.testing.assert_allclose(
        got["arm"], ref + e, atol=1e-11, rtol=0
    )  # rest: moves below 1e-12 a step
    wanted_moment = 2 * 9.81 * (np.cos(x) + 0.4 * np.cos(x + ref + e))
    np.testing.assert_allclose(
        got["moment"], wanted_moment, atol=1e-9, rtol=0
    )  # that times stiffness over step^2
    height = np.sin(x) + 0.4 * np.sin(x + ref + e)
    energy = k * e**2 / 2 + a * e**3 / 3 + b * e**4 / 4 + 2 * 9.81 * height
    np.testing.assert_allclose(got["energy"], energy, atol=1e-9, rtol=0)


def test_a_polynomial_spring_of_a_slide_balances_a_block(tmp_path):
    """A block hangs in a guide that the crank tilts, with 40 e - 30 e^2 = m g sin(crank)."""
    text = (
        f'{WITH_GRAVITY}<worldbody><body><joint name="crank"/><inertial pos="0 0 0" mass="1" '
        'diaginertia="1 1 1"/><body><joint name="block" type="slide" axis="-1 0 0" '
        'stiffness="40 -30"/><inertial pos="-.3 .1 0" mass=".8" diaginertia=".1 .1 .1"/>'
        f'</body></body></worldbody><sensor><jointpos name="block" joint="block"/>{MOMENT_SENSOR}'
        "</sensor>"
    )
    x = np.linspace(0.1, 1.3, 7)
    curves = swept_curves(tmp_path, text, x, ("block", "moment"), "crank")
    got = curves.channels
    assert curves.derivatives == 0
    e = (20 - np.sqrt(400 - 30 * 0.8 * 9.81 * np.sin(x))) / 30
    np.testing.assert_allclose(
        got["block"], e, atol=1e-11, rtol=0
    )  # rest: moves below 1e-12 a step
    wanted_moment = -0.8 * 9.81 * ((0.3 + e) * np.cos(x) + 0.1 * np.sin(x))
    np.testing.assert_allclose(got["moment"], wanted_moment, atol=1e-9, rtol=0)


@pytest.mark.parametrize("law", [lambda x: x, lambda x: 1.5 - x])
def test_a_preloaded_hinge_leaves_its_stop(law, tmp_path):
    """A hinge rests on its stop until the moment of the weight is larger than the preload k 0.6."""
    x, k = np.linspace(0.0, 1.5, 31), 8.0
    got = swept_curves(
        tmp_path,
        arm_model(f'stiffness="{k}" springref="0.6" range="-2 0"'),
        x,
        ("arm", "moment"),
        "crank",
        law,
    ).channels

    def lacking(q, crank):
        return k * (q - 0.6) + 2 * 9.81 * 0.4 * np.cos(crank + q)

    angle = np.array(
        [
            brentq(lacking, -2, 0, args=(c,), xtol=1e-15) if lacking(0, c) > 0 else 0.0
            for c in law(x)
        ]
    )
    assert 5 < (angle == 0).sum() < 25
    # a joint is left within 1e-12 rad of its stop
    np.testing.assert_allclose(got["arm"], angle, atol=1e-11, rtol=0)
    wanted_moment = 2 * 9.81 * (np.cos(law(x)) + 0.4 * np.cos(law(x) + angle))
    np.testing.assert_allclose(got["moment"], wanted_moment, atol=1e-9, rtol=0)


def test_a_joint_with_a_polynomial_spring_keeps_its_energy(tmp_path):
    """A joint released at 0.8 rad turns back where the energy of the spring is the same."""
    body = (
        '<worldbody><body><joint name="arm" stiffness="5 2 -1"/><inertial pos="0 0 0" mass="1" '
        'diaginertia=".1 .1 .1"/></body></worldbody><sensor><jointpos name="arm" joint="arm"/>'
        '<e_potential name="v"/><e_kinetic name="t"/></sensor><keyframe><key name="start" '
        'qpos=".8"/></keyframe>'
    )
    file = tmp_path / "model.xml"
    file.write_text(f"<mujoco>{NO_GRAVITY}{body}</mujoco>")
    got = [
        simulate(
            file,
            Run("dynamics", np.linspace(0, 3, 301), ("arm", "v", "t"), settings={"timestep": dt}),
        ).channels
        for dt in (2e-3, 1e-3)
    ]
    start = 0.8**2 * (5 / 2 + 0.8 * (2 / 3 - 0.8 / 4))
    coarse, fine = (np.abs(c["v"] + c["t"] - start).max() for c in got)
    assert 3.7 < coarse / fine < 4.3  # second order: 4 in theory
    turn = brentq(lambda q: q**2 * (5 / 2 + q * (2 / 3 - q / 4)) - start, -1.2, -0.1)
    # it may turn back between two samples: 16 rad/s^2 (5 ms)^2 / 2
    assert abs(got[1]["arm"].min() - turn) < 2e-4


def start_angles(lengths, angles):
    """Angles of segments from the upright, clockwise; the last two reach (0, 1), elbow up."""
    tip = 1j - sum(
        length * 1j * np.exp(-1j * angle) for length, angle in zip(lengths, angles, strict=False)
    )
    reach, (a, b) = abs(tip), lengths[-2:]
    base = np.angle(1j / tip)
    first = base - np.arccos((reach**2 + a**2 - b**2) / (2 * reach * a))
    second = base + np.arccos((reach**2 + b**2 - a**2) / (2 * reach * b))
    return [*angles, float(first), float(second)]


def balancer_model(lengths, springs, angles=(0.0,), stops=("", "", "", "")) -> str:
    """The MJCF of a balancer in its start pose: a chain of uniform segments of 1 kg/m.

    The chain leads from O to the tip of a pendulum of 1 m.
    """
    bodies, place = "", "0 0 0"
    for k, (length, spring, angle, stop) in enumerate(
        zip(lengths, springs, start_angles(lengths, angles), stops, strict=False), 1
    ):
        x, y, turn = length * np.sin(angle), length * np.cos(angle), length**3 / 12
        bodies += (
            f'<body pos="{place}"><joint name="deflection{k}" axis="0 0 -1" '
            f'stiffness="{spring}" {stop}/><inertial pos="{x / 2:.17g} {y / 2:.17g} 0" '
            f'mass="{length}" diaginertia="{turn} {turn} {turn}"/>'
            f'<site name="end{k}" pos="{x:.17g} {y:.17g} 0"/>'
        )
        place = f"{x:.17g} {y:.17g} 0"
    sensors = "".join(
        f'<jointpos name="deflection{k + 1}" joint="deflection{k + 1}"/>'
        for k in range(len(lengths))
    )
    return (
        f'{NO_GRAVITY}<worldbody>{bodies}{"</body>" * len(lengths)}<body><joint name="pendulum" '
        'axis="0 0 -1"/><inertial pos="0 .5 0" mass="1" diaginertia=".1 .1 .1"/>'
        '<site name="tip" pos="0 1 0"/></body></worldbody><equality>'
        f'<connect name="pin" site1="end{len(lengths)}" site2="tip"/></equality>'
        '<actuator><motor name="hold" joint="pendulum"/></actuator><sensor>'
        '<actuatorfrc name="hold" actuator="hold"/><e_potential name="energy"/>'
        f"{sensors}</sensor>"
    )


def preloaded_stop(moment: float, stiffness: float) -> str:
    return f'springref="{-moment / stiffness!r}" range="0 4"'


# S. van Nes, The use of a rigid linkage balancer with torsion springs to realize nonlinear
# moment-angle characteristics, MSc thesis TU Delft 2022.074 (van Nes 2022): lengths and springs of
# Figs. M.1, M.2 and M.6, lines 1766, 1745, 1753, 1860 and 1747; the moments [N m], at even parts of
# 90 degrees, are the equilibria of its eq. 4-17 by a root finder on the angle of segment 1 (and 2),
# to six digits, those of the last to five.
BALANCERS = {
    "plain": (
        balancer_model((0.3394, 0.4573, 0.4752), (1.2701, 0.8473, 4.1078), (0.6641,)),
        (0.172048, 0.337469, 0.494344, 0.639681, 0.768529, 0.872421, 0.939433, 0.974829, 1.027206),
    ),
    "released": (
        balancer_model(
            (0.4764, 0.4975, 0.4986),
            (0.9341, 0.1211, 0.0927),
            stops=("", preloaded_stop(0.3983, 0.1211), ""),
        ),
        (0.163031, 0.326062, 0.489094, 0.652125, 0.786675, 0.860044, 0.924901, 0.980266, 1.028843),
    ),
    "nonlinear": (
        balancer_model((0.3334, 0.4987, 0.482), ("1.5601 -0.6047",) * 3),
        (0.182371, 0.351288, 0.505149, 0.642404, 0.761397, 0.860177, 0.936272, 0.986410, 1.006150),
    ),
    "contact": (
        balancer_model(
            (0.4029, 0.4568, 0.4343), (0.8971, 0.089, 0.3411), stops=("", 'range="-4 0.8693"', "")
        ),
        (0.037889, 0.084999, 0.142124, 0.209025, 0.353097, 0.509670, 0.666243, 0.822817, 0.979390),
    ),
    "four": (
        balancer_model(
            (0.3252, 0.2926, 0.357, 0.3558),
            (0.9512, 0.2082, 0.1392, 0.0614),
            (0.0, 0.0),
            ("", preloaded_stop(0.6055, 0.2082), preloaded_stop(0.2502, 0.1392), ""),
        ),
        (
            0.09961,
            0.19922,
            0.29883,
            0.39844,
            0.49805,
            0.59766,
            0.68141,
            0.74312,
            0.80315,
            0.86103,
            0.91647,
            0.94406,
            0.96846,
            0.99192,
            1.01564,
        ),
    ),
}


def balancer_curves(folder: Path, name: str, degrees, profile=lambda x: x):
    deflections = [f"deflection{k}" for k in range(1, 5 if name == "four" else 4)]
    return swept_curves(
        folder,
        BALANCERS[name][0],
        np.radians(degrees),
        ("hold", "energy", *deflections),
        "pendulum",
        profile,
    )


@pytest.mark.parametrize("name", BALANCERS)
def test_balancers_have_the_moments_of_their_equilibria(name, tmp_path):
    moments = BALANCERS[name][1]
    got = balancer_curves(tmp_path, name, np.linspace(0, 90, len(moments) + 1)).channels["hold"]
    # half a unit of the last digit
    np.testing.assert_allclose(got[1:], moments, atol=5.01e-6 if name == "four" else 5.01e-7)


@pytest.mark.parametrize("name", BALANCERS)
def test_the_moment_is_that_of_spring_1_and_the_derivative_of_the_energy(name, tmp_path):
    """The holding moment is M = M1 = dV/dalpha.

    A rotation of all links about O changes spring 1 only, and an equilibrium minimizes V.
    """
    h = 0.02
    x = np.add.outer(np.arange(1.0, 90.0, 8.0), (-h, 0.0, h)).ravel()
    got = balancer_curves(tmp_path, name, x).channels
    k, a = (
        (1.5601, -0.6047)
        if name == "nonlinear"
        else ({"plain": 1.2701, "released": 0.9341, "contact": 0.8971, "four": 0.9512}[name], 0.0)
    )
    spring1 = got["deflection1"] * (k + a * got["deflection1"])
    np.testing.assert_allclose(
        got["hold"], spring1, atol=1e-10, rtol=0
    )  # rest, and a stop, to 1e-12 rad
    before, _, after = got["energy"].reshape(-1, 3).T
    slope = (after - before) / np.radians(2 * h)
    # rounding of the energy, 1e-15 J over 7e-4 rad, and h^2 / 6 of the moment's second derivative
    np.testing.assert_allclose(got["hold"][1::3], slope, atol=1e-6)


def test_a_preload_is_released_at_the_angle_of_the_closed_form(tmp_path):
    """Up to preload / (k1 (1 - l1/r)), 46.6595 degrees, the chain turns as a whole."""
    release = np.degrees(0.3983 / 0.9341 / (1 - 0.4764))
    got = balancer_curves(
        tmp_path, "released", (0, 20, 40, release - 0.01, release + 0.01)
    ).channels
    np.testing.assert_allclose(got["deflection2"][:4], 0, atol=1e-11)  # ends within 1e-12 rad
    assert got["deflection2"][4] > 1e-5
    np.testing.assert_allclose(
        got["hold"][:4], 0.9341 * np.radians((0, 20, 40, release - 0.01)), atol=1e-11, rtol=0
    )


def test_a_joint_meets_its_upper_stop(tmp_path):
    """From 41.4841 degrees on joint 2 is on its stop, and the moment rises with k1 only."""
    got = balancer_curves(tmp_path, "contact", (41.47, 41.50, 50, 60, 70, 80, 90)).channels
    assert got["deflection2"][0] < 0.8693 - 1e-4
    np.testing.assert_allclose(
        got["deflection2"][1:], 0.8693, atol=1e-11, rtol=0
    )  # left within 1e-12 rad
    slope = np.diff(got["hold"][1:]) / np.diff(np.radians((41.50, 50, 60, 70, 80, 90)))
    np.testing.assert_allclose(slope, 0.8971, atol=1e-10, rtol=0)


@pytest.mark.parametrize("name", ["released", "contact", "four"])
def test_a_sweep_has_the_same_curves_upwards_and_downwards(name, tmp_path):
    """Without friction, stops are met and left at the same angles upwards and downwards."""
    top = np.pi / 2
    got = balancer_curves(tmp_path, name, np.linspace(0, 180, 41), lambda x: top - np.abs(x - top))
    for curve in got.channels.values():
        np.testing.assert_allclose(curve, curve[::-1], atol=1e-11, rtol=0)  # rest: 1e-12 rad


def test_a_sweep_may_begin_far_from_the_start_key(tmp_path):
    """The undriven joints follow the drive from the start key to the first sample."""
    got = balancer_curves(tmp_path, "four", (90, 96)).channels["hold"]
    assert abs(got[0] - 1.01564) < 5.01e-6  # half a unit of the last digit


def test_a_wrong_energy_changes_no_moment(monkeypatch, tmp_path):
    """With a wrong energy the moments are the same: it only paces the steps, which become more."""
    energy = LinkJoint.spring_energy
    monkeypatch.setattr(
        LinkJoint,
        "spring_energy",
        lambda self, value: energy(self, value) * (1.01 if self.name == "deflection2" else 1.0),
    )
    moments = BALANCERS["plain"][1]
    got = balancer_curves(tmp_path, "plain", np.linspace(0, 90, 10)).channels["hold"]
    np.testing.assert_allclose(got[1:], moments, atol=5.01e-7)  # half a unit of the last digit


def chain_model(links: int, stiffness: float) -> str:
    """The MJCF of uniform links with equal springs on a crank; together they have 1 m and 1 kg."""
    size = 1 / links
    link = (
        f'<joint name="j{{}}" stiffness="{stiffness}"/><inertial pos="{size / 2} 0 0" '
        f'mass="{size}" diaginertia="1 1 {size**3 / 12}"/>'
    )
    bodies = "".join(f'<body pos="{size if k else 1} 0 0">{link.format(k)}' for k in range(links))
    sensors = "".join(f'<jointpos name="j{k}" joint="j{k}"/>' for k in range(links))
    return (
        f'{WITH_GRAVITY}<worldbody><body><joint name="crank"/><inertial pos="0 0 0" mass="1" '
        f'diaginertia="1 1 1"/>{bodies}{"</body>" * links}</body></worldbody>'
        f"<sensor>{sensors}{MOMENT_SENSOR}</sensor>"
    )


@pytest.mark.parametrize(("links", "stiffness"), [(3, 1.0), (6, 20.0)])
def test_a_hanging_chain_is_in_equilibrium(links, stiffness, tmp_path):
    """In every joint the spring balances the weight of all links beyond it."""
    x, names = np.array([0.0, 0.1, 0.2]), [f"j{k}" for k in range(links)]
    got = swept_curves(
        tmp_path, chain_model(links, stiffness), x, (*names, "moment"), "crank"
    ).channels
    bend = np.array([got[name] for name in names])
    ends = np.cumsum(np.cos(x + np.cumsum(bend, axis=0)), axis=0) / links
    start = np.vstack([np.zeros_like(x), ends[:-1]])
    middle, weight = (start + ends) / 2, 9.81 / links
    for k in range(links):
        carried = weight * (middle[k:] - start[k]).sum(axis=0)
        np.testing.assert_allclose(
            stiffness * bend[k], -carried, atol=1e-9, rtol=0
        )  # k, 1e-12 rad a step
    wanted_moment = weight * (np.cos(x) + middle).sum(axis=0)
    np.testing.assert_allclose(got["moment"], wanted_moment, atol=1e-9, rtol=0)


def test_a_sweep_ends_where_an_undriven_joint_meets_its_stop(edit):
    """The rocker turns from 2.246 rad to its stop at 2.4 rad.

    The crank's angle there follows from the law of cosines in both triangles.
    """
    file = edit("fourbar.xml", '<joint name="rocker"/>', '<joint name="rocker" range="1.5 2.4"/>')
    drive = Drive("crank", lambda x: (x, 1 + 0 * x, 0 * x))
    got = simulate(file, Run("sweep", np.linspace(0, 3, 61), ("rocker",), (drive,)))
    pin = 3 + 2.5 * np.exp(2.4j)
    last = np.angle(pin) + np.arccos((1 + abs(pin) ** 2 - 4) / (2 * abs(pin)))
    assert got.x[-1] < last < got.x[-1] + 0.05
    assert "joint 'rocker' is on its stop before crank = " in got.stopped


def test_a_sweep_ends_where_stops_lock_a_balancer(tmp_path):
    """With joints 1 and 2 on their stops the pendulum cannot turn further."""
    text = balancer_model(
        (0.45, 0.5, 0.4), (1.0, 1.0, 1.0), stops=('range="-1 0.6"', 'range="-1 0.3"', "")
    )
    got = swept_curves(
        tmp_path, text, np.linspace(0, 1.5, 31), ("deflection1", "deflection2"), "pendulum"
    )
    assert 3 < len(got.x) < 31
    assert "joint 'deflection1', 'deflection2' is on its stop before pendulum = " in got.stopped


def test_an_equilibrium_is_guessed_by_a_polynomial_of_earlier_ones():
    """The polynomial is of third degree through four equilibria.

    Equilibria before a change of the drives' direction are left out.
    """
    places, _ = rests_on_way([([0.0], 0), ([1.0], 1), ([2.0], 8), ([3.0], 27)], [4.0])
    assert places == [-1.0, -2.0, -3.0, -4.0]
    for past, degree in ((1, 1), (2, 2), (3, 3)):
        parts = lagrange_weights(1.5, places[:past])
        here = 1.0 - sum(parts)
        for power in range(degree + 1):
            values = [(4.0 + place) ** power for place in places[:past]]
            found = here * 4.0**power + sum(a * b for a, b in zip(parts, values, strict=True))
            assert found == pytest.approx(5.5**power, rel=1e-12)
    assert rests_on_way([([5.0], 0), ([3.0], 1)], [4.0])[0] == [-1.0]
    assert rests_on_way([([0.0, 0.0], 0), ([0.5, 1.0], 1), ([1.0, 1.0], 2)], [2.0, 1.0])[0] == [
        -1.0,
        -1.5,
    ]
    assert np.isnan(ratio_of_ways([1.0, 0.0], [1.0, 1.0]))
    assert ratio_of_ways([0.0], [1.0]) == 0.0
    assert ratio_of_ways([], []) == 0.0


def test_moments_have_the_right_sign_next_to_their_zero(tmp_path):
    """The moment of a driven bar has the right sign just before and just behind its top.

    Chipmunk gives only the size of a moment.  Within 1e-7 rad of the top the moment is less than
    `FORCE_REDUCTION` of the largest, so that the drive's force is reduced to zero to find its sign.
    """
    x = np.pi / 2 + np.array([-1.0, -1e-3, -1e-9, -1e-12, 1e-12, 1e-9, 1e-3, 1.0])
    bar = (
        f'{WITH_GRAVITY}<worldbody><body><joint name="crank"/><inertial pos=".4 0 0" mass="2" '
        f'diaginertia=".01 .2 .2"/></body></worldbody><sensor>{MOMENT_SENSOR}</sensor>'
    )
    got = swept_curves(tmp_path, bar, x, ("moment",), "crank").channels["moment"]
    np.testing.assert_allclose(got, 2 * 9.81 * 0.4 * np.cos(x), rtol=1e-6, atol=1e-13)


def test_moments_are_the_same_with_and_without_rates():
    """Moments are the same with and without rates.

    The impulses by which rates are found are no guess for those of the next equilibrium.
    """
    drive = Drive("crank", lambda x: (x, 1.0 + 0 * x, 0 * x))
    x = np.linspace(0.0, 1.0, 8)
    both, alone = (
        simulate(shipped("slider_crank.xml"), Run("sweep", x, names, (drive,)))
        for names in (("holding_moment", "slide_rate"), ("holding_moment",))
    )
    np.testing.assert_array_equal(both.channels["holding_moment"], alone.channels["holding_moment"])
