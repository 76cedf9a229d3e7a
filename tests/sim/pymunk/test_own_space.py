"""A space that a user built is run as it is, and judged by a closed form or by itself."""

from math import atan2, hypot, sqrt

import pymunk
import pytest

from proofmass import InputError, judge
from proofmass.sim.protocol.object_run import ObjectRun
from proofmass.sim.pymunk.own_space import record_space

LENGTHS = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}


def make_pendulum():
    """A point-like mass on a pivot, released from the horizontal."""
    space = pymunk.Space()
    space.gravity = 0, -9.81
    bob = pymunk.Body(1.0, 1e-9)
    bob.position = 1.0, 0
    pin = pymunk.PinJoint(space.static_body, bob, (0, 0), (0, 0))
    space.add(bob, pin)
    return space, bob


def make_fourbar(rocker=2.5):
    """A four-bar whose crank a motor turns at 1 rad/s."""
    space = pymunk.Space()
    space.iterations = 100
    x = (2.0**2 + 2.0**2 - rocker**2) / 4.0
    tip, foot, elbow = (1.0 + x, sqrt(2.0**2 - x**2)), (3.0, 0.0), (1.0, 0.0)

    def bar(p, q):
        body = pymunk.Body(1.0, 0.1)
        body.position = (p[0] + q[0]) / 2, (p[1] + q[1]) / 2
        body.angle = atan2(q[1] - p[1], q[0] - p[0])
        space.add(body)
        return body

    bars = bar((0, 0), elbow), bar(elbow, tip), bar(foot, tip)
    ground = space.static_body
    pairs = (ground, bars[0]), (bars[0], bars[1]), (bars[1], bars[2]), (ground, bars[2])
    for (a, b), place in zip(pairs, ((0, 0), elbow, tip, foot), strict=True):
        pin = pymunk.PivotJoint(a, b, place)
        pin.error_bias = 0.0
        space.add(pin)
    bars[0].angular_velocity = 1.0
    space.add(pymunk.SimpleMotor(bars[0], ground, 1.0))
    return space, bars


FOURBAR = {
    "reference": "fourbar",
    "parameters": LENGTHS,
    "drive": "crank",
    "duration": 1.0,
    "step": 2e-3,
    "every": 10,
    "tolerance": 1e-4,
    "detectable": False,
}


def fourbar_channels(bars):
    """The angles of crank, coupler and rocker."""
    names = "crank", "coupler_angle", "rocker_angle"
    return {name: (bar, "angle") for name, bar in zip(names, bars, strict=True)}


def test_a_fourbar_agrees_with_the_closed_form_and_a_wrong_one_differs():
    """The user's own space stays as it is."""
    space, bars = make_fourbar()
    before = [tuple(bar.position) for bar in bars]
    found = judge(space, channels=fourbar_channels(bars), **FOURBAR)
    assert [(c.channel, c.outcome) for c in found] == [
        ("coupler_angle", "agrees"),
        ("rocker_angle", "agrees"),
    ]
    assert (found[0].steps, found[0].violation < 1e-5) == (500, True)
    assert [tuple(bar.position) for bar in bars] == before
    space, bars = make_fourbar(rocker=2.501)
    wrong = judge(space, channels=fourbar_channels(bars), **FOURBAR)
    assert {c.outcome for c in wrong} == {"differs"}


def test_attributes_functions_and_closures_read_the_same_curves():
    """A function without arguments reads the user's own bodies, which then move; a note says so."""
    ways = []
    for read in (
        lambda bob: (bob, "position.y"),
        lambda _: lambda copied: next(iter(copied.bodies)).position.y,
        lambda bob: lambda: bob.position.y,
    ):
        space, bob = make_pendulum()
        curves = record_space(space, ObjectRun(0.5, 0.01, {"y": read(bob)}))
        ways.append(curves.channels["y"].tolist())
        if curves.notes:
            assert curves.notes == (
                "The space itself was stepped, by 0.5 s, since channel 'y' is a function without "
                "arguments.",
            )
            assert bob.position.y == ways[-1][-1]
        else:
            assert bob.position.y == 0.0
    assert ways[0] == ways[1] == ways[2]
    assert curves.notes
    assert curves.settings == {"timestep": 0.01, "iterations": 10}


def test_a_space_is_judged_by_itself():
    """Halved steps converge; what the bare engine has with an eighth of the step is the error."""
    space, bob = make_pendulum()
    run = {"channels": {"x": (bob, "position.x"), "m": (bob, "mass")}, "duration": 0.4}
    x, m = judge(space, None, **run, step=1e-3, every=10)
    assert (x.case, x.solver, x.outcome, x.at) == ("space", "pymunk", "self-consistent", 0.4)
    assert x.message.startswith("until 0.4 s, its end: steps of 1, 0.5, 0.25 and 0.125 ms converge")
    assert (m.outcome, m.message) == ("nothing moved", "it does not change")
    ends = []
    for step in (1e-3, 1e-3 / 8):
        space, bob = make_pendulum()
        for _ in range(round(0.4 / step)):
            space.step(step)
        ends.append(bob.position.x)
    assert x.error_max == pytest.approx(abs(ends[0] - ends[1]), rel=1e-6)


def test_the_opening_of_pivots_is_the_violation():
    space, bars = make_fourbar()
    bars[2].position += 0.0, 0.01
    curves = record_space(space, ObjectRun(2e-3, 2e-3, fourbar_channels(bars)))
    assert curves.violations[0] == pytest.approx(hypot(0.0, 0.01))
    assert curves.violation == curves.violations.max()


@pytest.mark.parametrize("kind", range(5))
def test_what_a_copy_would_lose_is_refused(kind):
    """pymunk copies no force of a spring, and functions may refer to the original bodies."""
    space, bob = make_pendulum()
    (pin,) = space.constraints
    spring = pymunk.DampedSpring(space.static_body, bob, (0, 0), (0, 0), 1, 1, 0)
    twist = pymunk.DampedRotarySpring(space.static_body, bob, 0, 1, 0)
    space.add(spring, twist)
    words = (
        ("body 0 has a velocity_func", lambda f: setattr(bob, "velocity_func", f)),
        ("constraint 1 has a force_func", lambda f: setattr(spring, "force_func", f)),
        ("constraint 2 has a torque_func", lambda f: setattr(twist, "torque_func", f)),
        (
            "constraint 0 has a pre_solve_func",
            lambda f: setattr(pin, "pre_solve", f),
        ),
        ("the space has a collision handler", lambda f: space.on_collision(1, 2, begin=f)),
    )[kind]
    words[1](lambda *_: None)
    with pytest.raises(InputError) as error:
        record_space(space, ObjectRun(0.1, 0.01, {"y": (bob, "position.y")}))
    assert str(error.value) == (
        f"space: {words[0]}, which may refer to what a copy does not have; give a channel as a "
        "function without arguments, such as lambda: body.angle: the space itself is then stepped"
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"step": 0.0}, "space: step: 0 < step <= duration must hold; got 0 and 0.1 s"),
        ({"step": 1.0}, "space: step: 0 < step <= duration must hold; got 1 and 0.1 s"),
        ({"duration": float("nan")}, "space: step: 0 < step <= duration must hold; got 0.01 and "),
        (
            {"step": 0.03},
            "space: duration: 0.1 s are 3.33333 times 1 steps of 0.03 s; give a ",
        ),
        ({"every": 3}, "space: duration: 0.1 s are 3.33333 times 3 steps of 0.01 s; give a "),
        ({"channels": {}}, "space: channels: give one or more, such as {'angle': (body, 'angle')}"),
        ({"channels": {"a": 3}}, "space: channels.a: give an object with an attribute, (body, "),
        (
            {"channels": {"a": (pymunk.Body(), "angle")}},
            "space: channels.a: Body is neither the space nor added to it",
        ),
        (
            {"channels": {"a": lambda space: space.angle}},
            "space: channels.a: cannot be read: AttributeError: 'Space' object has no attribute ",
        ),
        (
            {"channels": {"a": lambda space: "much"}},
            "space: channels.a: cannot be read: ValueError: could not convert string to float: ",
        ),
        ({"channels": None}, "judge: channels: missing: how to run a Space"),
        ({"duration": None}, "judge: duration: missing: how to run a Space"),
    ],
)
def test_a_wrong_run_of_a_space_is_one_line(change, words):
    space, bob = make_pendulum()
    how = {"duration": 0.1, "step": 0.01, "channels": {"angle": (bob, "angle")}, **change}
    for reference in ("pendulum", None):
        with pytest.raises(InputError) as error:
            judge(space, reference, **how)
        assert str(error.value).startswith(words)


def test_a_closure_is_refused_where_copies_are_run():
    space, bob = make_pendulum()
    with pytest.raises(InputError) as error:
        judge(space, None, channels={"y": lambda: bob.angle}, duration=0.1, step=0.01)
    assert str(error.value) == (
        "space: channels.y: a function without arguments reads the space itself, and copies of it "
        "are run; give (body, 'angle') or a function of the space"
    )
    assert bob.position.x == 1.0
