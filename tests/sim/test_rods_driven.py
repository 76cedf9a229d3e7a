"""Tests of rods that motors bend, of dead loads on rods and on rigid links, and of bad input."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from proofmass.batch.check import check
from proofmass.commands.cli import app
from proofmass.sim.protocol.failures import BadRod, Unsupported
from proofmass.sim.protocol.run import Drive, Rod, Run
from tests.sim.rod_models import (
    CLAMP_ANGLES,
    ENGINES,
    FIGURES,
    PAIR_MODEL,
    dead_load,
    equilibrium_curves,
    fixed_motors,
    rod_pair,
    write_model,
)
from tests.verdicts import all_comparisons

EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
ARM_BODY = (
    '<body name="arm"><joint name="arm"/><inertial pos="1 0 0" mass="2" '
    'diaginertia="0.1 0.1 0.1"/><site name="end" pos="1 0 0"/></body>'
)


@pytest.fixture
def unloaded(tmp_path: Path) -> Path:
    """The model of the pair without its load."""
    file = tmp_path / "unloaded.xml"
    file.write_text(PAIR_MODEL.read_text().replace('ctrl="0 0 1"', 'ctrl="0 0 0"'))
    return file


def swept_curves(engine: str, file: Path, segments: int, x: list[float], turn_per_x: float = 1.0):
    """Curves of a sweep from S2 at x = -1 to the beginning of the reference path at x = 0.

    Beyond it motor 1 turns by `turn_per_x` times x.
    """
    begin = np.radians(FIGURES["pair"]["line"]["motors"])

    def profile_of(k):
        def angle(x):
            motor_angle = begin[k] + np.minimum(x, 0.0) * (begin[k] - CLAMP_ANGLES[k])
            return motor_angle + turn_per_x * np.maximum(x, 0.0) * (k == 0), 0 * x, 0 * x

        return angle

    drives = tuple(Drive(f"motor{k + 1}", profile_of(k)) for k in (0, 1))
    run = Run(
        "sweep",
        np.array([-1.0, 0.0, *x]),
        ("pin.x", "pin.y", "moment1"),
        drives,
        rods=rod_pair("S2", segments),
    )
    return ENGINES[engine](file, run)


def test_a_turning_motor_leads_the_pin_along_the_reference_path(unloaded):
    """In the limit of many links, the pin follows the reference path while motor 1 turns."""
    line = FIGURES["pair"]["line"]
    coarse, fine = (swept_curves("mujoco", unloaded, n, line["turn"]).channels for n in (20, 40))
    for k, name in enumerate(("pin.x", "pin.y")):
        limit = (4 * fine[name] - coarse[name])[2:] / 3
        # the reference has a precision of 1e-6; terms in h^4 remain
        np.testing.assert_allclose(limit, np.array(line["pin"])[:, k], atol=5e-6)


def test_both_engines_have_the_same_poses_of_a_driven_pair():
    """The same chains of ten links a rod have the same poses and moments in both engines."""
    drives = Drive("motor1", lambda x: (CLAMP_ANGLES[0] + x, 1 + 0 * x, 0 * x)), fixed_motors()[1]
    run = Run(
        "sweep",
        np.linspace(0, 0.3, 4),
        ("pin.x", "pin.y", "moment1"),
        drives,
        rods=rod_pair("S4", 10),
    )
    one, two = (simulate(PAIR_MODEL, run).channels for simulate in ENGINES.values())
    for name, curve in one.items():
        np.testing.assert_allclose(two[name], curve, atol=1e-11, rtol=0)  # rest to 1e-12, softness


@pytest.mark.slow
def test_a_sweep_ends_at_the_fold_of_the_pair(unloaded):
    """A sweep ends where the equilibrium becomes unstable.

    The error of this motor angle falls with the square of the links.
    """
    fold, ends = FIGURES["pair"]["fold"]["turn"], []
    for n in (20, 40):
        found = swept_curves("mujoco", unloaded, n, [0.3, 0.5], turn_per_x=-1.0)
        assert "becomes unstable beyond motor1 = " in found.stopped
        ends.append(float(found.stopped.split("motor1 = ")[1].split(",")[0]))
    begin = np.radians(FIGURES["pair"]["line"]["motors"])[0]
    # the message has 6 digits and the reference 5; terms in h^4 remain
    assert (4 * ends[1] - ends[0]) / 3 - begin == pytest.approx(fold, abs=2e-5)


@EACH_ENGINE
def test_a_dead_load_on_a_link_keeps_its_direction(engine, tmp_path):
    """The holding moment of an arm is minus the moment of the force F and minus the moment M."""
    hold = '<motor name="hold" joint="arm"/>'
    file = write_model(
        tmp_path,
        ARM_BODY,
        hold + dead_load("end", 3, -4, 0, 0, 0, 0.5),
        '<actuatorfrc name="hold" actuator="hold"/><actuatorfrc name="pull" actuator="pull"/>',
        ctrl="0 2",
    )
    x = np.linspace(-1.0, 2.0, 7)
    run = Run("sweep", x, ("hold", "pull"), (Drive("arm", lambda x: (x, 1 + 0 * x, 0 * x)),))
    found = ENGINES[engine](file, run).channels
    np.testing.assert_allclose(
        found["hold"], -2 * (0.5 - 4 * np.cos(x) - 3 * np.sin(x)), atol=1e-12, rtol=0
    )  # rounding; pymunk rests to 1e-12 of the model
    np.testing.assert_allclose(found["pull"], 2.0)


@EACH_ENGINE
def test_a_dead_load_moves_an_arm_as_its_equation(engine, tmp_path):
    """A dead load moves an arm as the integrated equation of motion says."""
    file = write_model(
        tmp_path,
        ARM_BODY,
        dead_load("end", 3, -4, 0, 0, 0, 0.5),
        '<jointpos name="angle" joint="arm"/>',
        ctrl="1",
    )
    t = np.linspace(0.0, 2.0, 21)
    found = ENGINES[engine](file, Run("dynamics", t, ("angle",), settings={"timestep": 1e-3}))

    def motion(_, z):
        return [z[1], (0.5 - 4 * np.cos(z[0]) - 3 * np.sin(z[0])) / 2.1]

    truth = solve_ivp(motion, (0, 2), [0, 0], t_eval=t, rtol=1e-11, atol=1e-11).y[0]
    # with steps of 1 ms, MuJoCo's Euler is of first order and pymunk of second
    np.testing.assert_allclose(
        found.channels["angle"], truth, atol={"mujoco": 3e-3, "pymunk": 1e-6}[engine]
    )


def test_pymunk_refuses_loads_out_of_the_plane(tmp_path):
    """Pymunk refuses a load out of the plane; MuJoCo covers it."""
    file = write_model(tmp_path, ARM_BODY, dead_load("end", 0, 0, 1), ctrl="1")
    run = Run("dynamics", np.linspace(0, 1, 3), ())
    with pytest.raises(Unsupported, match="actuator 'pull' leaves the plane"):
        ENGINES["pymunk"](file, run)


def test_a_load_on_the_ground_does_nothing(tmp_path):
    """A dead load whose site is on the ground moves no link."""
    file = write_model(
        tmp_path, ARM_BODY, dead_load("ground", 1), '<jointpos name="angle" joint="arm"/>', ctrl="1"
    )
    found = ENGINES["pymunk"](file, Run("dynamics", np.linspace(0, 1, 3), ("angle",)))
    assert not found.channels["angle"].any()


BAD_RODS = {
    "stiffness": ({"stiffness": -1.0}, "stiffness", "-1 must be positive"),
    "length": ({"length": 0.0}, "length", "0 must be positive"),
    "segments": ({"segments": 1}, "segments", "two or more"),
    "scheme": ({"scheme": "mid"}, "scheme", "half, double, naive"),
    "too short": ({"length": 0.5}, "length", "supports are 0.806226 m apart"),
    "no site": ({"start": "grond"}, "from", "no site 'grond'; there are: ground, pin"),
    "no far site": ({"end": "pni"}, "to", "no site 'pni'"),
    "later rod": ({"end": "q.tip"}, "to", "rod 'q' must be defined before it"),
    "clamped scheme": ({"ends": ("clamped", "clamped"), "scheme": "naive"}, "scheme", "use half"),
}


@pytest.mark.parametrize(("change", "key", "words"), BAD_RODS.values(), ids=BAD_RODS)
def test_bad_rods_are_refused_with_their_key(change, key, words, tmp_path):
    """The error names the rod and the key, and states what would be right."""
    good = {
        "name": "r",
        "start": "ground",
        "end": "pin",
        "length": 1.0,
        "stiffness": 1.0,
        "segments": 5,
        "ends": ("clamped", "pinned"),
    }
    file = write_model(tmp_path, '<site name="pin" pos="0.8 0.1 0"/>')
    other = Rod("q", "ground", None, 1.0, 1.0, 5, ("clamped", "free"))
    with pytest.raises(BadRod, match=words) as raised:
        equilibrium_curves("mujoco", file, (Rod(**good | change), other), ())
    assert raised.value.args[:2] == ("r", key)
    assert str(raised.value).startswith(f"rod 'r': {key}: ")


BAD_SIDECARS = {
    "stiffness": (
        r"stiffness = 0.16\d*\nsegments",
        "stiffness = -1.0\nsegments",
        ["rod.rod.stiffness", "greater than 0"],
    ),
    "segments": ("segments = 40", "segments = 1", ["rod.rod.segments", "greater than or equal"]),
    "scheme": ("segments = 40", 'scheme = "mid"', ["rod.rod.scheme", "'half'"]),
    "unknown key": ("segments = 40", "links = 40", ["rod.rod", "'links'", "segments"]),
    "too short": (
        r"length = 1.0\nstiffness = 0.16\d*\nsegments",
        "length = 0.8\nstiffness = 0.1\nsegments",
        ["rod.rod.length", "0.806226 m"],
    ),
    "unknown site": (
        'from = "clamp"',
        'from = "clamps"',
        ["rod.rod.from", "'clamps'", "pin, clamp"],
    ),
    "no far site": ('to = "pin"\n', 'ends = ["clamped", "pinned"]\n', ["rod.rod", "give to"]),
    "free but held": ('to = "pin"', 'to = "pin"\nends = ["clamped", "free"]', ["leave out to"]),
    "beyond its end": ("n = 21", "n = 21\nuntil = 1.5", ["until", "shortest rod, 1 m"]),
    "unknown part": (r'"rod.x" =', '"rod.phi" =', ["channels.rod.phi", "rod.x, .y, .z, .angle"]),
    "no rod": (r"(?s)\[rod.rod\].*?\n\n", "", ["run.equilibrium", "[rod.NAME]"]),
}


@pytest.mark.parametrize(("old", "new", "words"), BAD_SIDECARS.values(), ids=BAD_SIDECARS)
def test_bad_rods_in_sidecars_are_refused_with_their_key(old, new, words, edit):
    """The only error names file and key, and the exit code is 2."""
    file = edit("rod_pinned.toml", old, new, count=1)
    result = check([file])
    assert result.exit_code == 2
    assert len(result.errors) == 1
    for word in ("rod_pinned.", *words):
        assert word in str(result.errors[0])


def test_the_command_line_reports_a_bad_rod_without_traceback(edit):
    """The exit code is 2, the key is named, and there is no traceback."""
    file = edit("rod_pinned.toml", "length = 1.0\nstiffness", "length = 0.8\nstiffness", count=2)
    result = CliRunner().invoke(app, ["check", str(file)])
    assert result.exit_code == 2
    assert "rod.rod.length" in result.output
    assert "Traceback" not in result.output


def test_gravity_requires_a_mass_of_rods(tmp_path):
    """A default mass would be a load that the user did not state."""
    file = write_model(tmp_path, gravity="0 -9.81 0")
    with pytest.raises(BadRod, match="mass: missing"):
        equilibrium_curves(
            "mujoco", file, (Rod("r", "ground", None, 1.0, 1.0, 5, ("clamped", "free")),), ()
        )


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"length = 1.0\nstiffness = 1.0\nsegments", "length = 1.0\nstiffness = 1.02\nsegments"),
        (r"length = 1.0\nstiffness = 1.0\nsegments", "length = 1.01\nstiffness = 1.0\nsegments"),
        ("segments = 40", 'segments = 40\nscheme = "naive"'),
    ],
)
def test_a_wrong_rod_differs_in_both_engines(old, new, edit):
    """A stiffer or longer rod, or one with a soft clamp, differs in both engines."""
    file = edit("rod_cantilever.toml", old, new)
    edit("rod_cantilever.toml", "n = 41", "n = 41\nuntil = 1.0")
    assert {c.solver for c in all_comparisons(file) if c.outcome == "differs"} == set(ENGINES)
