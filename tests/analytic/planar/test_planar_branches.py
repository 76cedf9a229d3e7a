"""Branches of the general planar solver: limit positions, change points, and refused models."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from proofmass.analytic import planar
from proofmass.analytic.linkages import fourbar
from proofmass.analytic.planar import (
    Branch,
    CannotAssemble,
    Mirrored,
    Overconstrained,
    SingularHere,
    read,
    solve,
)
from proofmass.analytic.planar.kinematics import largest_violation, lipschitz, scaled_jacobian
from proofmass.analytic.planar.mechanism import Mechanism
from tests.analytic.linkages.random_linkages import bar, compile_model, four_bars

RELAXED = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def four_bar(
    crank: float,
    coupler: float,
    rocker: float,
    ground: float,
    first: float = 0.0,
    mode: int = 1,
    off: float = 0.0,
) -> mujoco.MjModel:
    """A four-bar whose start pose is at a crank angle, with an error of the rocker angle [rad]."""
    start = fourbar.solve(
        first, crank=crank, coupler=coupler, rocker=rocker, ground=ground, mode=mode
    )
    bodies = bar("crank", crank, inside=bar("coupler", coupler, f"{crank} 0 0"))
    bodies += bar("rocker", rocker, f"{ground} 0 0")
    key = [first, float(start["coupler_angle"]) - first, float(start["rocker_angle"]) + off]
    return compile_model(
        bodies, [("coupler_end", "rocker_end")], ("crank",), {"pin": "rocker_end"}, ("rocker",), key
    )


def branch_of(model: mujoco.MjModel, *joints: str) -> Branch:
    return Branch(read(model, "start")[0], joints or ("crank",))


def test_a_path_stops_at_the_limit_position():
    """The four-bar 2, 2, 2.5, 3 is stretched at cos(crank) = (2^2 + 3^2 - 4.5^2) / 12."""
    limit = np.arccos((4 + 9 - 4.5**2) / 12)
    for sign in (1, -1):
        inputs = sign * np.linspace(0, 3, 301)[:, None]
        q, failure = branch_of(four_bar(2, 2, 2.5, 3)).follow(inputs)
        assert isinstance(failure, SingularHere)
        assert len(q) == np.searchsorted(np.linspace(0, 3, 301), limit)
        stopped = float(str(failure).split("crank = ")[1].split(":")[0])
        assert stopped == pytest.approx(sign * limit, abs=1e-8)  # nine digits are printed
        with pytest.raises(SingularHere, match="limit position at crank = "):
            solve(inputs.T, model=four_bar(2, 2, 2.5, 3), joints=("crank",))


@pytest.mark.parametrize(
    "samples",
    [360, 47, *(pytest.param(samples, marks=pytest.mark.slow) for samples in (359, 1000))],
)
@pytest.mark.parametrize("mode", [1, -1])
def test_a_change_point_is_passed_on_the_smooth_branch(samples, mode):
    """The four-bar 1, 2, 2, 3 is flat at pi; the closed form passes it with cos(angle / 2)."""
    x = np.linspace(0, 4 * np.pi, samples)  # none of these falls on pi
    truth = fourbar.solve(x, crank=1, coupler=2, rocker=2, ground=3, mode=mode)
    found = solve(x, model=four_bar(1, 2, 2, 3, mode=mode), joints=("crank",))
    # rounding times 1 / distance to the change point, to the first, second and third power
    near = np.abs(np.cos(x / 2)).min()
    for name, truth_name, power in (
        ("rocker", "rocker_angle", 1),
        ("rocker_rate",) * 2 + (2,),
        ("rocker_acceleration",) * 2 + (3,),
    ):
        assert np.abs(found[name] - truth[truth_name]).max() < 1e-14 / near**power


def test_a_change_point_with_a_kink_of_a_rate_is_not_passed(monkeypatch):
    """If no kink is allowed, not even rounding, the change point counts as a limit position."""
    x = np.linspace(3.0, 3.3, 4)[:, None]
    assert branch_of(four_bar(1, 2, 2, 3, first=2.9)).follow(x)[1] is None
    monkeypatch.setattr(planar.branch, "MAX_KINK", 0.0)
    q, failure = branch_of(four_bar(1, 2, 2, 3, first=2.9)).follow(x)
    assert len(q) == 2  # at 3.0 and 3.1, before pi
    assert isinstance(failure, SingularHere)


def test_condition_grows_like_the_inverse_distance_from_a_change_point():
    near = np.array([1e-2, 1e-3, 1e-4])
    found = solve(np.pi - near, model=four_bar(1, 2, 2, 3), joints=("crank",))["condition"]
    assert (found[1:] / found[:-1]) == pytest.approx([10.0, 10.0], rel=1e-3)  # next term: distance
    assert solve([np.pi / 2], model=four_bar(1, 2, 2.5, 3), joints=("crank",))["condition"][0] < 10


def test_a_start_near_a_change_point_is_refused():
    """Rounding would choose the branch of a parallelogram 1e-6 rad from its flat pose."""
    lengths = {"crank": 1.0, "coupler": 2.0, "rocker": 1.0, "ground": 2.0}
    for first in (1e-6, np.pi - 1e-6):
        with pytest.raises(SingularHere, match="is singular and chooses no branch"):
            branch_of(four_bar(**lengths, first=first))
    assert branch_of(four_bar(**lengths, first=0.1)).knot.radius > 1e-3


def test_a_sample_on_the_change_point_is_singular():
    with pytest.raises(SingularHere, match=r"crank = 3\.1415"):
        solve(np.array([0.0, np.pi, 4.0]), model=four_bar(1, 2, 2, 3), joints=("crank",))


@pytest.mark.parametrize("mechanisms", [6, pytest.param(12, marks=pytest.mark.slow)])
def test_poses_are_on_the_branch_and_failures_at_limit_positions(mechanisms):
    """In a turn that may have limits, found poses are the closed form; it has none beyond them."""

    @settings(RELAXED, max_examples=mechanisms)
    @given(four_bars(min_sine=0.0, turn=6.0))
    def run(linkage):
        try:
            follower = branch_of(linkage.model)
        except SingularHere:
            assert np.sin(linkage.solve(linkage.way[0, 0])["transmission_angle"]) < 1e-3
            return
        q, failure = follower.follow(linkage.way)
        x = linkage.way[:, 0]
        truth = linkage.solve(x[: len(q)])  # raises where there is no pose
        loose = 1e-13 / np.maximum(np.sin(truth["transmission_angle"]), 1e-7)
        wrong = np.abs(np.exp(1j * q[:, 2]) - np.exp(1j * truth["rocker_angle"]))
        assert (wrong < np.maximum(loose, 1e-12)).all()
        if failure is not None:
            gap = np.linspace(x[len(q) - 1] if len(q) else x[0], x[len(q)], 10_001)
            try:
                sine = np.sin(linkage.solve(gap)["transmission_angle"])
            except ValueError as error:
                if "loop cannot close" not in str(error):  # the limit is within the gap
                    raise
            else:
                assert sine.min() < 1e-4

    run()


def test_one_long_stride_keeps_the_branch():
    """Two samples are two turns apart, and the path between them is followed."""
    model = four_bar(1, 2, 2.5, 3, mode=-1)
    found = solve(np.array([0.0, 4 * np.pi - 0.1]), model=model, joints=("crank",))
    truth = fourbar.solve(-0.1, crank=1, coupler=2, rocker=2.5, ground=3, mode=-1)
    assert found["pin.y"][1] == pytest.approx(truth["pin_y"], abs=1e-14)


@pytest.mark.parametrize("off", [1e-9, 1e-3])
def test_a_motion_near_a_solved_one_takes_no_steps(off, monkeypatch):
    """It agrees with the closed form over two turns with a small oscillation, from before 0."""
    x = np.linspace(-1.0, 4 * np.pi, 361)
    beside = x + off * np.sin(7 * x)
    model = four_bar(1, 2, 2.5, 3, mode=-1)
    solve(x, model=model, joints=("crank",))
    monkeypatch.setattr(Branch, "step", lambda *_: pytest.fail("a step"))
    found = solve(beside, model=model, joints=("crank",))
    truth = fourbar.solve(beside, crank=1, coupler=2, rocker=2.5, ground=3, mode=-1)
    assert np.abs(found["pin.x"] - truth["pin_x"]).max() < 1e-13
    assert np.abs(found["pin.y"] - truth["pin_y"]).max() < 1e-13


def test_a_motion_has_the_same_bits_whatever_was_solved_before():
    """Workers solve other cases before it, in an order that depends on the number of workers."""
    x = np.linspace(0.0, 7.0, 101)
    first = solve(x, model=four_bar(1, 2, 2.5, 3), joints=("crank",))
    model = four_bar(1, 2, 2.5, 3)  # read again
    for off in (-0.3, 1e-3):
        solve(x + off, model=model, joints=("crank",))
    again = solve(x, model=model, joints=("crank",))
    assert all((first[name] == again[name]).all() for name in first)


def test_lengths_that_cannot_close_are_refused():
    model = four_bar(1, 2, 2.5, 3)
    model.body("rocker").pos[0] = 50.0
    with pytest.raises(CannotAssemble, match=r"loop 'coupler_end' stays open by 44\.5 m at best"):
        branch_of(model)


@pytest.mark.parametrize(("joint", "unit"), [("hinge", "rad"), ("slide", "m")])
def test_the_violation_of_a_coupling_has_the_unit_of_its_joint(joint, unit):
    body = (
        '<body name="{0}" pos="0 {1} 0"><joint name="{0}" {2}/>'
        '<inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/></body>'
    )
    axis = 'axis="0 0 1"' if joint == "hinge" else 'type="slide" axis="1 0 0"'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody>{body.format("a", 0, axis)}{body.format("b", 9, axis)}</worldbody>
        <equality><joint name="gear" joint1="b" joint2="a"/></equality></mujoco>"""
    )
    mechanism = read(model, "")[0]
    violation, words = largest_violation(mechanism, np.array([0.25, 0.5]))
    assert violation == pytest.approx(0.25, abs=1e-15)
    assert words == f"loop 'gear' stays open by 0.25 {unit}"


def geared_four_bar(size: float) -> mujoco.MjModel:
    """A four-bar of a size [m] in gravity, whose rocker turns a wheel by a parabola."""

    def body(name: str, place: float, end: float, inside: str = "") -> str:
        moments = " ".join([str(size**2)] * 3)
        return f"""<body name="{name}" pos="{place * size} 0 0"><joint name="{name}" axis="0 0 1"/>
          <inertial pos="{end * size / 2} 0 0" mass="1" diaginertia="{moments}"/>
          <site name="{name}" pos="{end * size} 0 0"/>{inside}</body>"""

    start = fourbar.solve(1.0, crank=1, coupler=2, rocker=2.5, ground=3)
    rocker = float(start["rocker_angle"])
    key = [1.0, float(start["coupler_angle"]) - 1.0, rocker, gear_angle(rocker)]
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler boundmass="0" boundinertia="0"/>
      <option gravity="0 -10 0"><flag contact="disable"/></option><worldbody>
      {body("crank", 0, 1, body("coupler", 1, 2))}{body("rocker", 3, 2.5)}{body("wheel", 0, 0)}
      </worldbody><equality><connect site1="coupler" site2="rocker"/>
      <joint name="gear" joint1="wheel" joint2="rocker" polycoef="0.1 -1.7 0.3 0 0"/></equality>
      <sensor><jointpos name="rocker" joint="rocker"/>
      <jointpos name="wheel" joint="wheel"/></sensor>
      <keyframe><key name="start" qpos="{" ".join(map(repr, key))}"/></keyframe></mujoco>""")


def gear_angle(rocker):
    return 0.1 - 1.7 * rocker + 0.3 * rocker**2


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_the_size_of_a_linkage_does_not_limit_the_angles_of_its_gears(size):
    """The equation of a gear is in radians, whatever the size is."""
    x = np.linspace(1.0, 8.0, 8)
    truth = fourbar.solve(x, crank=1, coupler=2, rocker=2.5, ground=3)["rocker_angle"]
    found = solve(x, model=geared_four_bar(size), joints=("crank",))
    # rounding of angles of about 2 rad and of the gear's sum, times a condition of 5
    assert np.abs(found["rocker"] - truth).max() < 1e-14
    assert np.abs(found["wheel"] - gear_angle(truth)).max() < 3e-14


@pytest.mark.parametrize("size", [1e-6, 1e6])
def test_a_free_motion_scales_with_the_size_of_a_geared_linkage(size):
    """At n times the size a motion in gravity takes sqrt(n) times as long."""
    t = np.array([0.0, 0.3])
    truth = solve(t, model=geared_four_bar(1.0))
    found = solve(t * np.sqrt(size), model=geared_four_bar(size))
    assert np.ptp(truth["wheel"]) > 1e-3
    for name in ("rocker", "wheel"):  # the steps differ; 3e-14 in each, times their growth
        assert np.abs(found[name] - truth[name]).max() < 1e-11


@pytest.mark.parametrize(
    ("joints", "value", "message"),
    [
        (("crank",), [1.0, np.nan], r"value must be finite, got nan"),
        (("crank",), np.inf, "value must be finite, got inf"),
        (("crank",), np.ones((2, 3)), r"shape \(n,\) .* with 1 drive\(s\), got \(2, 3\)"),
        ((), [0.0, np.inf], r"value must be finite, got inf"),
        ((), [0.2, 0.1], r"times that do not fall, got \[0.2 0.1\]"),
        ((), [], r"one or more times that do not fall, got \[\]"),
        ((), np.ones((1, 3)), r"must have shape \(n,\), got \(1, 3\)"),
    ],
)
def test_samples_that_are_no_motion_are_refused(joints, value, message):
    with pytest.raises(ValueError, match=message):
        solve(value, model=four_bar(1, 2, 2.5, 3), joints=joints)


@pytest.mark.parametrize("key", ["controls", "control_rates"])
def test_controls_that_are_not_finite_are_refused(key):
    with pytest.raises(ValueError, match=r"motor must be finite, got nan"):
        solve(
            [1.0, 2.0],
            model=geared_four_bar(1.0),
            joints=("crank",),
            **{key: {"motor": [0.0, np.nan]}},
        )


def test_a_single_time_gives_the_start_pose():
    assert solve(0.0, model=geared_four_bar(1.0))["wheel"].shape == (1,)


def test_a_rough_start_pose_is_closed():
    found = solve([0.0], model=four_bar(1, 2, 2.5, 3, off=0.05), joints=("crank",))
    assert found["pin.x"][0] == pytest.approx(23 / 16, abs=1e-14)
    assert found["pin.y"][0] == pytest.approx(np.sqrt(975) / 16, abs=1e-14)


def test_a_third_crank_on_a_parallelogram_is_over_constrained():
    end = '<site name="mid" pos="0.5 0 0"/>'
    bodies = bar("crank", 1.0, inside=bar("coupler", 2.0, "1 0 0", inside=end))
    bodies += bar("rocker", 1.0, "2 0 0") + bar("third", 1.0, "0.5 0 0")
    model = compile_model(
        bodies,
        [("coupler_end", "rocker_end"), ("mid", "third_end")],
        ("crank",),
        {"pin": "rocker_end"},
        ("rocker",),
        [1.0, -1.0, 1.0, 1.0],
    )
    with pytest.raises(Overconstrained, match=r"4 equations, of which only 3 are independent"):
        branch_of(model)


@pytest.mark.parametrize(("joints", "free"), [((), 1), (("crank", "rocker"), 1)])
def test_drives_must_be_as_many_as_degrees_of_freedom(joints, free):
    with pytest.raises(
        SingularHere, match=rf"has {free} degree\(s\) of freedom, and {len(joints)} driven"
    ):
        Branch(read(four_bar(1, 2, 2.5, 3), "start")[0], joints)


def test_an_unknown_joint_is_refused():
    with pytest.raises(ValueError, match="no joint 'krank'; there are: crank, coupler, rocker"):
        branch_of(four_bar(1, 2, 2.5, 3), "krank")


def test_a_step_to_the_mirrored_pose_is_refused():
    """Only a prediction beyond the proven radius leads there, so that a wrong one is given."""
    follower = branch_of(four_bar(1, 2, 2.5, 3))
    other = branch_of(four_bar(1, 2, 2.5, 3, mode=-1)).knot
    follower.predict = lambda inputs: np.repeat(other.q[None], len(inputs), axis=0)
    with pytest.raises(Mirrored, match="another assembly mode at crank = 0"):
        follower.step(np.array([0.0]))
    away = replace(other[None], q=other.q[None] + [0.0, 0.3, 0.3], radius=np.full(1, 0.1))
    with pytest.raises(Mirrored, match="another assembly mode at crank = 0"):
        follower.close(np.zeros((1, 1)), away)


def test_a_guess_of_the_mirrored_branch_is_not_used(monkeypatch):
    """From a crank angle of 2 rad on the guesses are closed poses of the other branch."""
    x = np.linspace(0.0, 2 * np.pi, 91)
    truth = fourbar.solve(x, crank=1, coupler=2, rocker=2.5, ground=3)
    guess = Branch.guess

    def wrong_guess(self, way):
        at, q = guess(self, way)
        _, other = guess(branch_of(four_bar(1, 2, 2.5, 3, mode=-1)), way)
        return at, np.where(at[:, None] > 2.0, other, q)

    monkeypatch.setattr(Branch, "guess", wrong_guess)
    found, failure = branch_of(four_bar(1, 2, 2.5, 3)).follow(x[:, None])
    assert failure is None
    assert np.abs(found[:, 2] - truth["rocker_angle"]).max() < 1e-13


def test_poses_without_guesses_are_found_step_by_step(monkeypatch):
    """Without knots that are found at once the poses of the path are the same to rounding."""
    x = np.linspace(0.0, 6.0, 61)[:, None]
    q, _ = branch_of(four_bar(1, 2, 2.5, 3)).follow(x)
    monkeypatch.setattr(Branch, "find_knots", Branch.reached)
    steps, failure = branch_of(four_bar(1, 2, 2.5, 3)).follow(x)
    assert failure is None
    assert np.abs(steps - q).max() < 1e-14


@settings(RELAXED, max_examples=10)
@given(st.floats(0.2, 3.0), st.floats(-1, 1))
def test_geared_cranks_follow_their_polynomial(ratio, bend):
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/><worldbody>
      <body><joint name="a"/><geom size="0.1"/></body>
      <body><joint name="b"/><geom size="0.1"/></body></worldbody>
      <equality><joint joint1="b" joint2="a" polycoef="0.1 {ratio!r} {bend!r} 0 0"/>
      </equality><sensor><jointpos name="b" joint="b"/><jointvel name="w" joint="b"/>
      <user name="dw" objtype="joint" objname="b" dim="1" needstage="acc"/></sensor></mujoco>""")
    x = np.linspace(0, 2, 21)
    found = solve(x, 2.0, 3.0, model=model, joints=("a",))
    np.testing.assert_allclose(found["b"], 0.1 + ratio * x + bend * x**2, atol=1e-14, rtol=0)
    np.testing.assert_allclose(found["w"], 2 * (ratio + 2 * bend * x), atol=1e-14, rtol=0)
    np.testing.assert_allclose(
        found["dw"], 3 * (ratio + 2 * bend * x) + 8 * bend, atol=1e-13, rtol=0
    )


LOOP_EQUALITY = '<connect site1="one" site2="two"/>'
GEAR_EQUALITY = '<joint joint1="c" joint2="a" polycoef="0 1 2 0 0"/>'


@pytest.mark.parametrize(
    "equalities",
    [LOOP_EQUALITY, GEAR_EQUALITY, LOOP_EQUALITY + GEAR_EQUALITY],
    ids=["loop", "gear", "both"],
)
def test_constraint_rows_change_no_faster_than_their_bound(equalities):
    """The bound proves steps; for a loop through a slide, and a gear of changing ratio."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle="radian"/><worldbody>
      <body><joint name="a"/><geom size="0.1"/><body pos="1 0 0"><joint name="b"/>
        <joint name="s" type="slide" axis="1 0 0"/><geom size="0.1"/><site name="one" pos="1 1 0"/>
      </body></body><body pos="2 1 0"><joint name="c"/><geom size="0.1"/>
        <site name="two" pos="0 0 0"/></body></worldbody><equality>{equalities}</equality>
      <sensor><jointpos name="b" joint="b"/></sensor></mujoco>""")
    m, generator = read(model, "start")[0], np.random.default_rng(4)
    q, steps = np.zeros((1, 4)), generator.normal(0.0, 0.1, (40, 4))
    if equalities == GEAR_EQUALITY:  # only its own joints move
        steps[:, 1:3] = 0.0
    bound, worst = float(lipschitz(m, q)[0]), 0.0
    for step in steps:
        change = scaled_jacobian(m, q + step * m.scale)[0] - scaled_jacobian(m, q)[0]
        worst = max(worst, float(np.linalg.norm(change, 2) / np.linalg.norm(step)))
    assert 0.2 * bound < worst < bound


@pytest.mark.parametrize(
    ("xml", "words"),
    [
        ('<body><freejoint/><geom size="0.1"/></body>', "free joint"),
        (
            '<body><joint name="a" axis="0 0 1"/><geom size="0.1"/>'
            '<body><joint name="b" axis="0 1 0"/><geom size="0.1"/></body></body>',
            "joint 'b' leaves the plane",
        ),
        (
            '<body><joint name="a" type="slide"/><geom size="0.1"/>'
            '<body><joint name="b" type="slide" axis="1 0 0"/><geom size="0.1"/>'
            '<body><joint name="c" type="slide" axis="0 1 0"/><geom size="0.1"/></body></body>'
            "</body>",
            "joint 'c' leaves the plane",
        ),
        ('<geom size="0.1"/>', "a mechanism without joints"),
    ],
)
def test_models_that_are_no_planar_linkages_are_refused(xml, words):
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
    with pytest.raises(ValueError, match=words):
        read(model, "")


def test_poses_are_those_of_mujocos_kinematics():
    """The tree has tilted frames, and its joint values are random."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><compiler angle="radian"/><worldbody>
      <body pos="1 2 3" euler="0.3 -0.2 0.5"><body quat="1 1 0 0" pos="0 0 1">
        <joint name="a" axis="0 1 0" pos="0.1 0 0.2" ref="0.3"/><geom size="0.1"/>
        <joint name="s" type="slide" axis="1 0 0.5" ref="0.1"/>
        <body pos="0.4 0.1 -0.2" euler="0 0.7 0"><joint name="b" axis="0 -1 0" pos="0 0 0.3"/>
          <geom size="0.1"/><site name="end" pos="0.5 0.2 0.1"/></body></body></body>
      </worldbody><sensor><framepos name="end" objtype="site" objname="end"/>
      <framexaxis name="axis" objtype="site" objname="end"/></sensor></mujoco>""")
    data = mujoco.MjData(model)
    mechanism, _ = read(model, "")
    assert isinstance(mechanism, Mechanism)
    for values in np.random.default_rng(1).uniform(-2, 2, (5, 3)):
        data.qpos[:] = values
        mujoco.mj_forward(model, data)
        found = solve(values[:, None], model=model, joints=("a", "s", "b"))
        for k, channel in enumerate(("end.x", "end.y", "end.z", "axis.x", "axis.y", "axis.z")):
            assert found[channel][0] == pytest.approx(data.sensordata[k], abs=1e-14)
