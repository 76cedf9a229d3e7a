"""A wrong model, a wrong curve or a NaN changes an outcome of a shipped case to "differs"."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.case.case import Case
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve
from proofmass.verdict.compare import compare
from tests.shipped import fewer_samples, shipped, shipped_case

Place = tuple[str, str, int, float]
# where a length stands in the MJCF: path of the element, attribute, index of the number, and factor
BODY, SITE = ".//body[@name='{}']", ".//site[@name='{}']"


def at(element: str, name: str, index: int = 0, sign: float = 1) -> Place:
    """The place in the MJCF of a coordinate of an element's position."""
    return element.format(name), "pos", index, sign


FOUR_BAR = {
    "crank": [at(BODY, "coupler")],
    "coupler": [at(SITE, "coupler_end")],
    "rocker": [at(SITE, "rocker_end")],
    "ground": [at(BODY, "rocker")],
}
SLIDER_CRANK = {"crank": [at(BODY, "coupler")], "coupler": [at(SITE, "coupler_end")]}
FIVE_BAR = {
    "left_crank": [at(BODY, "left_coupler")],
    "left_coupler": [at(SITE, "left_tip")],
    "right_coupler": [at(SITE, "right_tip")],
    "right_crank": [at(BODY, "right_coupler")],
    "right_x": [at(BODY, "right_crank")],
    "left_x": [at(BODY, "left_crank")],
}
PARALLEL_ROBOT = {
    "side": [at(SITE, "p2"), at(SITE, "p3", 0, 0.5), at(SITE, "p3", 1, 0.75**0.5)],
    "leg": [at(BODY, "platform"), at(SITE, "leg_2_end"), at(SITE, "leg_3_end")],
    "guide2_x": [at(BODY, "slider_2")],
    "guide3_x": [at(BODY, "slider_3")],
    "guide3_y": [at(BODY, "slider_3", 1)],
}


def balancer_lengths(name: str) -> dict[str, list[Place]]:
    """The lengths of a balancer, each in the direction of its segment in the rest posture."""
    tree = ElementTree.parse(shipped(f"{name}.xml"))
    ends = [BODY.format(body.get("name")) for body in tree.findall(".//body/body")]
    found = {"pendulum": [at(SITE, "pendulum_tip", 1)]}
    for i, path in enumerate([*ends, SITE.format("tip")], start=1):
        x, y, _ = map(float, tree.find(path).get("pos").split())
        length = abs(complex(x, y))
        found[f"length{i}"] = [(path, "pos", 0, x / length), (path, "pos", 1, y / length)]
    return found


GEOM_FRICTION = (".//default/geom", "friction", 0, 1.0)  # of all geoms
LENGTHS = {
    "fourbar": FOUR_BAR
    | {"point_along": [at(SITE, "point")], "point_across": [at(SITE, "point", 1)]},
    "double_crank": FOUR_BAR,
    "double_rocker": FOUR_BAR,
    "triple_rocker": FOUR_BAR,
    "change_point": FOUR_BAR,
    "hacksaw": {
        "crank": [at(SITE, "crank_end")],
        "coupler": [at(SITE, "coupler_end", 0, -1)],
        "offset": [at(BODY, "slider", 1)],
    },
    "hacksaw_forces": {
        "crank": [at(BODY, "coupler")],
        "coupler": [at(BODY, "pin")],
        "offset": [at(BODY, "slider", 1)],
    },
    "slider_crank": SLIDER_CRANK | {"guide_x": [at(BODY, "slider")]},
    "slider_crank_offset": SLIDER_CRANK | {"guide_y": [at(BODY, "slider", 1)]},
    "slider_crank_inclined": SLIDER_CRANK
    | {
        "guide_x": [at(BODY, "slider")],
        "guide_y": [at(BODY, "slider", 1)],
        "guide_angle": [(BODY.format("slider"), "euler", 2, 1)],
    },
    "slider_crank_friction": {
        "crank": [at(BODY, "coupler")],
        "coupler": [at(BODY, "pin")],
        "guide_x": [at(BODY, "slider")],
    },
    "shaft_pendulum": {
        "length": [
            at(".//body[@name='{}']/inertial", "pendulum", 1, -1),
            at(SITE, "bob", 1, -1),
        ]
    },
    "inverted_slider_crank": {
        "crank": [at(BODY, "rod")],
        "bar": [at(SITE, "bar_tip")],
        "rod": [at(SITE, "rod_end")],
        "ground_x": [at(BODY, "bar")],
    },
    "inverted_slider_crank_forces": {
        "crank": [at(BODY, "rod")],
        "bar": [at(SITE, "bar_tip")],
        "ground_x": [at(BODY, "bar")],
    },
    "inverted_slider_crank_classic": {
        "crank": [at(BODY, "rod")],
        "rod": [at(SITE, "rod_end")],
        "pivot_x": [at(SITE, "pivot")],
        "pivot_y": [at(SITE, "pivot", 1)],
    },
    "swinging_block_forces": {
        "crank": [at(BODY, "rod")],
        "pivot_x": [at(SITE, "pivot")],
        "pivot_y": [at(SITE, "pivot", 1)],
    },
    "fivebar": FIVE_BAR,
    "fivebar_regular": FIVE_BAR,
    "fivebar_circle": FIVE_BAR | {"left_coupler": [at(SITE, "left_tip"), at(BODY, "payload")]},
    "fivebar_path": FIVE_BAR | {"left_coupler": [at(SITE, "left_tip"), at(BODY, "payload")]},
    "fivebar_forces": FIVE_BAR | {"left_coupler": [at(BODY, "pin"), at(BODY, "payload")]},
    "threeprr": PARALLEL_ROBOT,
    "threeprr_circle": PARALLEL_ROBOT,
    "threeprr_path": PARALLEL_ROBOT,
    "threeprr_forces": PARALLEL_ROBOT | {"leg": [at(BODY, f"pin_{k}") for k in (1, 2, 3)]},
    "pendulum": {"length": [(".//inertial", "pos", 1, -1), (".//body", "pos", 1, 1)]},
    "block_slides": {"friction": [GEOM_FRICTION]},
    "block_sticks": {"speed": [(".//key", "qvel", 0, 1)], "friction": [GEOM_FRICTION]},
    "block_stops": {"friction": [GEOM_FRICTION], "speed": [(".//key", "qvel", 0, 1)]},
    "ball_rolls": {
        "spin": [(".//key", "qvel", 2, 1)],
        "speed": [(".//key", "qvel", 0, 1)],
        "friction": [GEOM_FRICTION],
    },
    "ball_bounces": {"height": [(".//key", "qpos", 0, 1)]},
    "block_rocks": {"tilt": [(".//key", "qpos", 2, 1)]},
    "balls_in_row": {
        "gap": [at(BODY, f"ball{k + 1}", 0, k) for k in range(1, 5)],
        "speed": [(".//key", "qvel", 0, 1)],
    },
    # the other balancers have the same template, as `test_balancer_template` checks
    "balancer_sine_free_preload": balancer_lengths("balancer_sine_free_preload"),
    "balancer4_sine": balancer_lengths("balancer4_sine"),
    "balancer4_sam_prescribed": balancer_lengths("balancer4_sam_prescribed"),
}
MODEL_OWNERS = {  # sidecars that share a model
    "fourbar_crossed": "fourbar",
    "hacksaw_recorded": "hacksaw",
    "hacksaw_cutting": "hacksaw",
    "hacksaw_sampled": "hacksaw",
    "hacksaw_inventor_shaped": "hacksaw",
    "double_crank_crossed": "double_crank",
    "slider_crank_mirrored": "slider_crank",
    "inverted_slider_crank_held": "inverted_slider_crank",
    "inverted_slider_crank_equal": "inverted_slider_crank",
    "inverted_slider_crank_faster": "inverted_slider_crank",
    "fivebar_down": "fivebar",
    "fivebar_equal": "fivebar",
    "fivebar_rectangle": "fivebar_circle",
    "threeprr_second": "threeprr",
}
CASE_LENGTHS = [
    (case, key)
    for case in (*LENGTHS, *MODEL_OWNERS)
    for key in LENGTHS[MODEL_OWNERS.get(case, case)]
]


def first_case_of_each_reference() -> set[str]:
    """The first case of each reference."""
    found: dict[str, str] = {}
    for case in LENGTHS:
        found.setdefault(shipped_case(shipped(f"{case}.toml")).reference, case)
    return set(found.values())


REPRESENTATIVES = first_case_of_each_reference()
FIRST_LENGTHS = {(case, next(iter(LENGTHS[case]))) for case in REPRESENTATIVES}
"""The first length of each case of `REPRESENTATIVES`.

The fast test covers all lengths of these cases in a sweep in MuJoCo, and the first length in pymunk
and in dynamics.  The slow test covers all other lengths and runs of all cases."""


def lengthen(file: Path, places: list[Place], by: float) -> None:
    """Make a length of the MJCF longer by `by` [m]."""
    tree = ElementTree.parse(file)
    for path, attribute, index, sign in places:
        element = tree.find(path)
        numbers = [float(x) for x in element.get(attribute).split()]
        numbers[index] += sign * by
        element.set(attribute, " ".join(map(repr, numbers)))
    tree.write(file)


def with_fewer_samples(case: Case, kind: str) -> Case:
    """The case with about a tenth of the samples of a sweep, each of which is solved by itself.

    The turning points of the drive, which matter for joints with dry friction, stay among the
    samples.  Detectable changes are computed from the same samples.
    """
    run = case.run[kind]
    if kind != "sweep" or not run.n:
        return case
    fewer = run.model_copy(update={"n": fewer_samples(run.n)})
    return case.model_copy(update={"run": {**case.run, kind: fewer}})


@cache
def detectable_changes(name: str, kind: str, solver: str) -> dict[str, float]:
    """The smallest detectable change of each parameter over all channels of the good model [SI]."""
    case = with_fewer_samples(load_case(shipped(f"{name}.toml")), kind)
    comparisons = compare(case, kind, solver, solve(case, kind, solver))
    outcomes = {c.outcome for c in comparisons}
    assert "agrees" in outcomes
    assert "differs" not in outcomes
    found: dict[str, float] = {}
    for c in comparisons:
        for key, change in c.detectable.items():
            size = change.size * (abs(case.parameters[key]) if change.relative else 1.0)
            found[key] = min(size, found.get(key, np.inf))
    return found


def check_wrong_length_differs(name: str, key: str, solver: str, kind: str, models: Path) -> None:
    """Check that a length wrong by three times its detectable change makes a channel differ."""
    case, owner = load_case(models / f"{name}.toml"), MODEL_OWNERS.get(name, name)
    smallest = detectable_changes(name, kind, solver)
    if key not in case.parameters:  # the reference is a recorded curve, without parameters
        smallest = detectable_changes(owner, kind, solver)
    lengthen(case.model_path, LENGTHS[owner][key], 3 * smallest[key])
    case = with_fewer_samples(case, kind)
    wrong = compare(case, kind, solver, solve(case, kind, solver), detectable=False)
    assert "differs" in {c.outcome for c in wrong}


def list_runs(quick: bool) -> list[tuple[str, str, str, str]]:
    """Case, length, solver and kind of run of the fast test, or of the slow one."""
    found = []
    for name, key in CASE_LENGTHS:
        case = shipped_case(shipped(f"{name}.toml"))
        for kind, run in case.run.items():
            for solver in ("mujoco", "pymunk"):
                if (kind, solver) == ("sweep", "mujoco"):
                    fast = name in REPRESENTATIVES
                else:
                    fast = (name, key) in FIRST_LENGTHS and (
                        (kind, solver) != ("dynamics", "pymunk") or "sweep" not in case.run
                    )
                if solver in run.solvers and fast == quick:
                    found.append((name, key, solver, kind))
    return found


@pytest.mark.parametrize(("name", "key", "solver", "kind"), list_runs(quick=True))
def test_a_length_wrong_by_three_times_its_detectable_change_differs(
    name, key, solver, kind, models
):
    check_wrong_length_differs(name, key, solver, kind, models)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "key", "solver", "kind"), list_runs(quick=False))
def test_every_wrong_length_differs_in_every_run(name, key, solver, kind, models):
    check_wrong_length_differs(name, key, solver, kind, models)


GENERAL_SOLVER_LENGTHS = {  # the reference reads the model too; the engine alone gets a wrong one
    "peaucellier": at(BODY, "lower_out"),
    "watt": at(SITE, "second_end"),
    "stephenson": at(SITE, "link_end"),
    "chebyshev_lambda": at(SITE, "tip"),
    "fourbar_released": at(SITE, "rocker_end"),
    "andrews": at(SITE, "F3"),
    "fourbar_spring": at(SITE, "coupler_end"),
}


@pytest.mark.parametrize("name", GENERAL_SOLVER_LENGTHS)
def test_an_engine_with_another_length_differs_from_the_general_solver(name, models):
    case = load_case(models / f"{name}.toml")
    kind, run = next(iter(case.run.items()))
    brief = run.model_copy(update={"until": 0.1 * run.until}) if run.until else run
    case = case.model_copy(update={"run": {**case.run, kind: brief}})
    good = shipped(case.model)
    lengthen(case.model_path, [GENERAL_SOLVER_LENGTHS[name]], 1e-4)
    curves = solve(case, kind, "mujoco")
    case.model_path.write_text(good.read_text())
    found = compare(case, kind, "mujoco", curves, detectable=False)
    assert "differs" in {c.outcome for c in found}


def test_a_peaucellier_cell_with_a_wrong_length_leaves_its_straight_line(models):
    """The tip of the Peaucellier cell leaves its straight line by a wrong length in the model.

    The engine and the general solver agree, since both read the length from the model; the channels
    whose reference is the constant of the line differ.
    """
    case = load_case(models / "peaucellier.toml")
    lengthen(case.model_path, [at(SITE, "tip")], 1e-6)
    found = compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"), detectable=False)
    assert {c.channel for c in found if c.outcome == "differs"} == {
        "tip.x",
        "tip_velocity.x",
        "tip_acceleration.x",
    }


@pytest.fixture(scope="module")
def sweep():
    case = load_case(shipped("hacksaw.toml"))
    return case, solve(case, "sweep", "mujoco")


def compare_sweep(case, curves):
    """Compare a sweep in MuJoCo with the reference."""
    return compare(case, "sweep", "mujoco", curves, detectable=False)


WRONG_CURVES = {
    "sign": lambda y: -y,
    "off by one sample": lambda y: np.roll(y, 1),
    "a NaN": lambda y: np.where(np.arange(y.size) == 500, np.nan, y),
    "an infinity": lambda y: np.where(np.arange(y.size) == 500, np.inf, y),
    "a constant added": lambda y: y + 1e-9 * np.ptp(y),
    "a scale": lambda y: y * (1 + 1e-9),
    "one whole turn": lambda y: y + 2 * np.pi,
}


@pytest.mark.parametrize("how", WRONG_CURVES)
def test_a_wrong_curve_differs_in_every_channel(how, sweep):
    case, curves = sweep
    for name in case.channels:
        changed = {**curves.channels, name: WRONG_CURVES[how](curves.channels[name])}
        found = compare_sweep(case, replace(curves, channels=changed))
        assert {c.channel for c in found if c.outcome == "differs"} == {name}


def test_wrong_signs_and_offsets_of_the_document_differ(sweep):
    """A wrong sign or offset of a curve of the document makes its channel differ, and no other.

    The mistakes are theta3 without its half turn, r1 not negated, and V_r negated.
    """
    case, curves = sweep
    for name, change in {
        "theta3": curves.channels["theta3"] - np.pi,
        "r1": -curves.channels["r1"],
        "r1_rate": -curves.channels["r1_rate"],
    }.items():
        found = compare_sweep(case, replace(curves, channels={**curves.channels, name: change}))
        assert [c.channel for c in found if c.outcome != "agrees"] == [name]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('gravity="0 -9.81 0"', 'gravity="0 9.81 0"'),
        ('pos="0.5 0 0" mass="1"', 'pos="0.5 0 0" mass="1.001"'),
        ('<joint name="rocker"/>', '<joint name="rocker" stiffness="0.01"/>'),
    ],
)
def test_a_wrong_load_changes_the_holding_moment_alone(old, new, models, edit):
    edit("fourbar.xml", old, new)
    case = load_case(models / "fourbar.toml")
    found = compare_sweep(case, solve(case, "sweep", "mujoco"))
    assert [c.channel for c in found if c.outcome != "agrees"] == ["holding_moment"]


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("fourbar", "1.30208333333333 1.30208333333333", "1.43229166666667 1.43229166666667"),
        pytest.param(
            "slider_crank",
            "0.666666666666667 0.666666666666667",
            "0.733333333333 0.733333333333",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "fivebar",
            "5.33333333333333 5.33333333333333",
            "5.86666666666667 5.86666666666667",
            marks=pytest.mark.slow,
        ),
        ("inverted_slider_crank", "2.25 2.25", "2.475 2.475"),
        pytest.param(
            "inverted_slider_crank_classic",
            "10.4166666666667 10.4166666666667",
            "11.45 11.45",
            marks=pytest.mark.slow,
        ),
        ("threeprr", "0.166666666666667", "0.183333333333333"),
        ("threeprr_forces", "0.166666666666667", "0.183333333333333"),
        ("fivebar_forces", "10.4166666666667 10.4166666666667", "11.45 11.45"),
        ("inverted_slider_crank_forces", "0.01 0.01 0.01", "0.011 0.011 0.011"),
        (
            "swinging_block_forces",
            "10.416666666666667 10.416666666666667",
            "11.45 11.45",
        ),
        (
            "fourbar_forces",
            "0.0833333333333333 0.0833333333333333",
            "0.0916666666667 0.0916666666667",
        ),
    ],
)
def test_a_wrong_inertia_changes_the_moment_of_a_drive(name, old, new, solver, models, edit):
    """An inertia that is wrong by 10 % changes moments and forces of a driven motion alone.

    The wrong inertia of `fourbar_forces` changes nothing, since it is that of a crank at a steady
    rate.
    """
    case = load_case(models / f"{name}.toml")
    edit(case.model, re.escape(old), new)
    found = compare(case, "dynamics", solver, solve(case, "dynamics", solver), detectable=False)
    differs = {c.channel for c in found if c.outcome == "differs"}
    steady = name == "fourbar_forces"  # the crank turns at 6 rad/s
    assert bool(differs) != steady
    assert all(case.channels[channel].si_unit in ("N", "N m") for channel in differs)


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('gravity="0 -9.81 0"', 'gravity="0 -9.815 0"'),
        ('pos="0.5 0 0" mass="1"', 'pos="0.5 0 0" mass="1.005"'),
        ('pos="0 -0.5 0" mass="1"', 'pos="0 -0.501 0" mass="1"'),
        ('"0.0833333333333333333 1e-6 0.0833333333333333333"', '"0.085 1e-6 0.085"'),
        ('qpos="2 -2 0 2 2"', 'qpos="2.001 -2.001 0 2.001 2.001"'),
        ('<joint name="R"/>', '<joint name="R" damping="0.01"/>'),
    ],
)
def test_a_wrong_number_changes_the_motion_of_the_parallelograms(old, new, solver, models, edit):
    """A wrong number in the model makes a channel differ within one second of motion.

    The reference is the closed form of a pendulum, which does not read the model.
    """
    edit("parallelogram_chain.xml", re.escape(old), new)
    edit("parallelogram_chain.toml", r"until = 2\.5", "until = 1.0")
    edit("parallelogram_chain.toml", "n = 251", "n = 101")
    case = load_case(models / "parallelogram_chain.toml")
    found = compare(case, "dynamics", solver, solve(case, "dynamics", solver), detectable=False)
    assert "differs" in {c.outcome for c in found}


LEFT_FORCES, RIGHT_FORCES = (
    "left_crank_force left_coupler_force",
    "right_crank_force right_coupler_force",
)
TIP_CHANNELS = f"left_moment right_moment {LEFT_FORCES} {RIGHT_FORCES} pin_force"
PLATFORM_CHANNELS = " ".join(
    f"{one}_force_{k}" for one in ("holding", "guide", "leg", "pin") for k in "123"
)
WRONG_MASSES = {  # by case: a number, a wrong one, and the channels that depend on it at rest
    "inverted_slider_crank_forces": [
        (
            'pos="1.5 0 0" mass="3"',
            'pos="1.5 0 0" mass="3.003"',
            "holding_moment holding_moment_bar crank_force rod_force guide_force pin_force "
            "bar_force",
        ),
        ('pos="0.5 0 0" mass="1"', 'pos="0.5 0 0" mass="1.001"', "holding_moment_bar bar_force"),
        ('pos="0.5 0 0" mass="1"', 'pos="0.501 0 0" mass="1"', "holding_moment_bar"),
        (
            'pos="0 0 0" mass="0.5"',
            'pos="0 0 0" mass="0.501"',
            "holding_moment_bar pin_force bar_force",
        ),
    ],
    "fivebar_forces": [
        (  # the numbers of both cranks, and of both couplers
            'pos="2 0 0" mass="4"',
            'pos="2 0 0" mass="4.004"',
            "left_moment left_crank_force right_moment right_crank_force",
        ),
        ('pos="2 0 0" mass="4"', 'pos="2.001 0 0" mass="4"', "left_moment right_moment"),
        ('pos="2.5 0 0" mass="5"', 'pos="2.5 0 0" mass="5.005"', TIP_CHANNELS),
        ('pos="2.5 0 0" mass="5"', 'pos="2.501 0 0" mass="5"', TIP_CHANNELS),
        ('pos="0 0 0" mass="2"', 'pos="0 0 0" mass="2.002"', TIP_CHANNELS),
    ],
    "threeprr_forces": [
        ('mass="2"', 'mass="2.002"', PLATFORM_CHANNELS),
        ('pos="0.5 0.28867513', 'pos="0.501 0.28867513', PLATFORM_CHANNELS),
        ('pos="0.5 0 0" mass="0.6"', 'pos="0.501 0 0" mass="0.6"', PLATFORM_CHANNELS),
        (  # of all sliders, one of which moves vertically
            'mass="0.5"',
            'mass="0.5005"',
            "holding_force_3 guide_force_1 guide_force_2 guide_force_3",
        ),
    ],
}


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
@pytest.mark.parametrize(
    ("name", "old", "new", "known"),
    [(name, *row) for name, rows in WRONG_MASSES.items() for row in rows],
)
def test_a_wrong_mass_changes_the_channels_that_depend_on_it_alone(
    name, old, new, known, solver, models, edit
):
    """A wrong mass makes all channels differ that depend on it, and no other.

    The mass is wrong by one or two thousandths, or its centre is off by 1 mm.
    """
    edit(f"{name}.xml", re.escape(old), new)
    case = with_fewer_samples(load_case(models / f"{name}.toml"), "sweep")
    found = compare(case, "sweep", solver, solve(case, "sweep", solver), detectable=False)
    differs = {c.channel.partition(".")[0] for c in found if c.outcome == "differs"}
    assert differs == set(known.split())


@pytest.mark.parametrize("solver", ["mujoco", "pymunk"])
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("slider_crank_offset", 'ctrl="0 -50"', 'ctrl="0 -50.001"'),
        ("hacksaw_cutting", 'ctrl="0 10"', 'ctrl="0 10.001"'),
    ],
)
def test_a_wrong_load_on_the_slider_changes_the_holding_moment_alone(
    name, old, new, solver, models, edit
):
    case = load_case(models / f"{name}.toml")
    edit(case.model, old, new)
    found = compare(case, "sweep", solver, solve(case, "sweep", solver), detectable=False)
    assert [c.channel for c in found if c.outcome == "differs"] == ["holding_moment"]


def test_a_start_pose_in_the_other_assembly_mode_is_refused(models, edit):
    edit("fourbar_crossed.toml", 'start = "crossed"', 'start = "start"')
    case = load_case(models / "fourbar_crossed.toml")
    with pytest.raises(InputError, match=r"assembles the model in mode \+1"):
        compare(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"))
