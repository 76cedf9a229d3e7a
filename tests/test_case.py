"""A sidecar by itself: which key is at fault, which channels and tolerances a run has."""

import re

import pytest

from proofmass.case import View
from proofmass.errors import InputError
from proofmass.sidecar import load_case
from tests.shipped import shipped


@pytest.mark.parametrize(
    ("name", "old", "new", "key", "wrong"),
    [
        ("pendulum", "title = .*", "", "title", "missing; it is required"),
        (
            "pendulum",
            "n = 1001",
            "n = 1",
            "run.dynamics.n",
            "Input should be greater than or equal to 2",
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
        ),  # a unit is no pattern
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
def test_a_fault_is_said_at_its_key(name, old, new, key, wrong, models, edit):
    file = edit(f"{name}.toml", old, new, count=1)
    with pytest.raises(InputError) as error:
        load_case(file)
    assert (error.value.file, error.value.key) == (file, key)
    assert re.fullmatch(wrong, error.value.wrong)


def test_a_rest_may_end_where_its_shortest_rod_does(models, edit):
    case = load_case(shipped("rod_cantilever.toml"))
    length = min(rod.length for rod in case.rods)
    file = edit(
        "rod_cantilever.toml", r"\[run.equilibrium\]", f"[run.equilibrium]\nuntil = {length!r}"
    )
    assert load_case(str(file)).run["equilibrium"].until == length


def test_channels_and_tolerances_of_a_run():
    case = load_case(shipped("fourbar.toml"))
    assert set(case.channels) - set(case.channels_of("dynamics")) == {"holding_moment"}
    assert list(case.channels_of("sweep")) == list(case.channels)
    assert case.tolerance_for("dynamics", "mujoco", "rocker_rate").relative_to_range == 2e-6
    assert case.tolerance_for("dynamics", "mujoco:default", "rocker") is None


def test_a_key_of_a_drive_has_a_number_where_there_are_several():
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
