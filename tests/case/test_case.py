"""Faults of sidecars and their keys; channels and tolerances of runs; drives, rods and views."""

import re

import pytest

from proofmass.base.errors import InputError
from proofmass.case.case import DriveTable, Refine, RodTable, RunTable, Tolerance, View
from proofmass.run.sidecar import load_case
from proofmass.sim.protocol.run import Rod
from tests.shipped import shipped

ADDITIONAL_TOLERANCE = """
[[tolerance]]
{}
solver = "mujoco"
channels = "rocker"
relative_to_range = 1e-3
why = "one more"
"""


@pytest.mark.parametrize(
    ("name", "old", "new", "key", "wrong"),
    [
        ("pendulum", "title = .*", "", "title", "missing; it is required"),
        (
            "pendulum",
            "n = 1001",
            "n = 1",
            "run.dynamics.n",
            "Input should be greater than or equal to 2, not 1",
        ),
        ("pendulum", "title = ", "title = = ", "", "not TOML: .*"),
        (
            "pendulum",
            "title = ",
            "deep = " + "[" * 9999 + "\ntitle = ",
            "",
            "its tables or arrays are nested too deeply",
        ),
        (
            "pendulum",
            "title = ",
            'model = "none.xml"\ntitle = ',
            "model",
            "no file 'none.xml' beside the sidecar",
        ),
        (
            "pendulum",
            r'solver = "mujoco"',
            'solver = "mujco"',
            "",
            "tolerance.0.solver: 'mujco' matches nothing; did you mean 'mujoco'.*",
        ),
        (
            "fourbar",
            r'unit = \["rad", "m"\]',
            'unit = ["rad", "r*"]',
            "",
            r"tolerance.1.unit: 'r\*' matches nothing; .*",
        ),  # unlike names, units are not patterns
        (
            "pendulum",
            r'solver = "mujoco"',
            'solver = "mujoco"\nchannels = ["rat*", "x*"]',
            "",
            r"tolerance.0.channels: 'x\*' matches nothing; .*",
        ),
        (
            "pendulum",
            r'solver = "mujoco"',
            'solver = "mujoco"\nchannels = "rate"\nunit = "rad"',
            "",
            "tolerance.0: it covers nothing: no channel of its run and its solvers has both one of "
            "its names and one of its units",
        ),
        (
            "pendulum",
            r'solver = "pymunk"',
            'solver = "*"\n',
            "",
            "2 tolerances cover channel 'angle' of mujoco in dynamics; exactly one may",
        ),
        (
            "pendulum",
            r'solver = "mujoco"',
            'solver = "mujoco"\nrun = "sweep"',
            "",
            "tolerance.0.run: there is no run.sweep; there are: dynamics",
        ),
        (
            "fourbar",
            r"\Z",
            ADDITIONAL_TOLERANCE.format('run = "dynamics"'),
            "",
            "2 tolerances cover channel 'rocker' of mujoco in dynamics; exactly one may",
        ),
        (
            "fourbar",
            r"\Z",
            ADDITIONAL_TOLERANCE.format('unit = "rad"'),
            "",
            "2 tolerances cover channel 'rocker' of mujoco in sweep; exactly one may",
        ),
        (
            "fourbar",
            r"\Z",
            ADDITIONAL_TOLERANCE.format('run = "equilibrium"'),
            "",
            "tolerance.10.run: there is no run.equilibrium; there are: sweep, dynamics",
        ),
        (
            "rod_cantilever",
            r"\[run.equilibrium\]",
            "[run.equilibrium]\nuntil = 99.0",
            "",
            r"run.equilibrium.until goes beyond the shortest rod, \S+ m",
        ),
        (
            "rod_cantilever",
            r"(?s)\[rod\.rod\].*?\n\n",
            "",
            "",
            r"run.equilibrium needs a \[rod.NAME\]: it is sampled along its length",
        ),
    ],
)
def test_a_fault_is_reported_with_its_key(name, old, new, key, wrong, models, edit):
    file = edit(f"{name}.toml", old, new, count=1)
    with pytest.raises(InputError) as error:
        load_case(file)
    assert (error.value.file, error.value.key) == (file, key)
    assert re.fullmatch(wrong, error.value.wrong)


def test_an_equilibrium_may_be_sampled_to_the_end_of_the_shortest_rod(models, edit):
    case = load_case(shipped("rod_cantilever.toml"))
    length = min(rod.length for rod in case.rods)
    file = edit(
        "rod_cantilever.toml", r"\[run.equilibrium\]", f"[run.equilibrium]\nuntil = {length!r}"
    )
    assert load_case(str(file)).run["equilibrium"].until == length


def test_each_run_has_its_channels_and_tolerances():
    case = load_case(shipped("fourbar.toml"))
    assert list(case.channels_of("dynamics")) == list(case.channels)
    sweep_only = case.channels["holding_moment"].model_copy(update={"only": "sweep"})
    case = case.model_copy(update={"channels": {**case.channels, "holding_moment": sweep_only}})
    assert set(case.channels) - set(case.channels_of("dynamics")) == {"holding_moment"}
    assert list(case.channels_of("sweep")) == list(case.channels)
    assert case.tolerance_for("dynamics", "mujoco", "rocker_rate").relative_to_range == 2e-6
    assert case.tolerance_for("dynamics", "mujoco:default", "rocker") is None


def test_a_tolerance_may_cover_one_channel_of_one_run(edit):
    file = edit(
        "fourbar.toml",
        'run = "sweep"\nsolver = "mujoco"',
        'run = "sweep"\nsolver = "mujoco"\nchannels = "holding_moment"',
        count=1,
    )
    case = load_case(file)
    assert case.tolerance_for("sweep", "mujoco", "holding_moment").relative_to_range == 1e-12
    assert case.tolerance_for("sweep", "mujoco", "rocker") is None


def test_a_tolerance_is_a_number_or_a_share_of_the_range():
    assert Tolerance(abs=0.25, why="x").allowed(8.0) == 0.25
    assert Tolerance(relative_to_range=0.25, why="x").allowed(8.0) == 2.0


def drive(**keys) -> DriveTable:
    """A drive from 0.5, unless `keys` has another start."""
    return DriveTable(joint="crank", **{"from": 0.5, **keys})


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({}, "give either from, to and rate, or from, to and period, or profile"),
        (
            {"to": 1.0, "profile": "swing", "until": 1.0},
            "give either from, to and rate, or from, to and period, or profile",
        ),
        ({"to": 1.0, "period": 2.0, "rate": 1.0}, "rate goes with from and to alone"),
        ({"profile": "swing", "until": 2.0, "rate": 1.0}, "rate goes with from and to alone"),
        ({"profile": "swing"}, "a profile needs until = the last time [s]"),
        ({"to": 0.5, "rate": 1.0}, "to must differ from 'from'"),
        ({"to": 0.5, "period": 1.0}, "to must differ from 'from'"),
        ({"to": 1.0, "rate": 0.0}, "rate must be non-zero and lead from 'from' to 'to'"),
        ({"to": 1.0, "rate": -1.0}, "rate must be non-zero and lead from 'from' to 'to'"),
        ({"to": 0.0, "rate": 1.0}, "rate must be non-zero and lead from 'from' to 'to'"),
        ({"to": 0.0}, "rate must be non-zero and lead from 'from' to 'to'"),
    ],
)
def test_a_leading_drive_without_a_valid_motion_is_refused(keys, wrong):
    with pytest.raises(ValueError, match=f"^{re.escape(wrong)}$"):
        drive(**keys).check_leader()


@pytest.mark.parametrize(
    "keys",
    [
        {"to": 1.0},
        {"to": 1.0, "rate": 2.0},
        {"to": 0.0, "rate": -2.0},
        {"to": -1.0, "rate": -1e-9},
        {"to": 0.0, "period": 2.0},
        {"profile": "swing", "until": 1.0},
        {"profile": ("q", "w", "a")},
    ],
)
def test_a_leading_drive_may_have_a_rate_a_period_or_a_profile(keys):
    """A drive to a smaller value has a negative rate; a recorded profile needs no ``until``.

    The check raises no error.
    """
    drive(**keys).check_leader()


@pytest.mark.parametrize("key", ["rate", "period", "until"])
def test_a_following_drive_with_rate_period_or_until_is_refused(key):
    drive(to=1.0).check_follower()
    with pytest.raises(ValueError, match=f"^{key} belongs to the first drive, which leads$"):
        drive(to=1.0, **{key: 2.0}).check_follower()


def test_a_rod_is_built_as_its_table_says():
    keys = {
        "length": 2.0,
        "stiffness": 3.0,
        "segments": 4,
        "ends": ("pinned", "pinned"),
        "scheme": "double",
        "mass": 5.0,
        "turn": 6.0,
    }
    assert RodTable(**{"from": "here"}, to="there", **keys).built("one") == Rod(
        "one", "here", "there", **keys
    )


def refine(**keys) -> Refine:
    """A refinement with rods in 10, 15 and 20 segments."""
    return Refine(segments=(10, 15, 20), order=2.0, within=0.1, why="x", **keys)


def test_a_refinement_covers_the_channels_that_it_names():
    asked = refine(channels=("tip.*", "middle.x"))
    assert [asked.covers(name) for name in ("tip.x", "middle.x", "middle.y", "a.tip.x")] == [
        True,
        True,
        False,
        False,
    ]
    assert refine().covers("tip.x")


def test_a_refined_equilibrium_is_sampled_at_joints_of_all_refinements():
    """The joints that 10, 15 and 20 segments share are the fifths of the whole rod: 6 samples.

    The samples of a sweep stay as they are.
    """
    run = RunTable(n=361, until=0.5, solvers=("mujoco",))
    assert refine().sampled(run) == run.model_copy(update={"n": 6, "until": None})
    assert refine(run="sweep").sampled(run) is run


def test_keys_of_drives_have_an_index_if_there_are_several_drives():
    assert load_case(shipped("fourbar.toml")).drive_key(0, "profile") == "drive.profile"
    threeprr = load_case(shipped("threeprr.toml"))
    assert threeprr.drive_key(2, "profile") == "drive.2.profile"
    two = threeprr.model_copy(update={"drive": threeprr.drive[:2]})
    assert two.drive_key(0, "profile") == "drive.0.profile"


def test_a_view_shows_the_first_run_that_has_its_channels():
    case = load_case(shipped("fourbar.toml"))
    channels = {
        **case.channels,
        "rocker": case.channels["rocker"].model_copy(update={"only": "dynamics"}),
        "holding_moment": case.channels["holding_moment"].model_copy(update={"only": "sweep"}),
    }
    case = case.model_copy(update={"channels": channels})

    def shown(**view):
        return case.run_of(View(title="one", **view))

    assert shown(x="crank", y="pin.x") == "sweep"
    assert shown(x="crank", y="rocker") == "dynamics"
    assert shown(x="crank", y="holding_moment") == "sweep"
    assert shown(x="crank", y="pin.x", run="dynamics") == "dynamics"
    for view, words in (
        (
            {"x": "rocker", "y": "holding_moment"},
            "no run.* records its channels rocker, holding_moment",
        ),
        (
            {"x": "crank", "y": "pin.x", "run": "equilibrium"},
            "no run.equilibrium records its channels pin.x",
        ),
        (
            {"x": "crank", "y": "other", "run": "equilibrium"},
            "no run.equilibrium records its channels (it names none)",
        ),
    ):
        with pytest.raises(ValueError, match="view 'one': ") as error:
            shown(**view)
        assert str(error.value) == f"view 'one': {words}"
