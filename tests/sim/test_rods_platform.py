"""Tests of three rods on a platform, in both engines: 3RFR in equilibrium, 3PFR driven, rigid ends,
wrong models."""

import json
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.rods.equilibrium import RodState, solve_direct, state
from proofmass.base.errors import InputError
from proofmass.batch.check import check
from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from proofmass.run.solve import plan_run, solve_here
from proofmass.sim.protocol.run import Drive, Rod
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison
from tests.analytic.rods.rod_assembly_cases import DATA, EI, three_rod_platform
from tests.independent.rods.chain_assembly import settle
from tests.shipped import shipped
from tests.sim.rod_models import ENGINES, constant_profile, equilibrium_curves, write_model

CHAINS = {
    row["name"]: row
    for row in json.loads((Path(__file__).parents[1] / "data" / "rod_chain.json").read_text())[
        "3RFR"
    ]["equilibria"]
}
EACH_ENGINE = pytest.mark.parametrize("engine", ENGINES)
MOTORS = tuple(np.radians(DATA["rfr3"]["inputs_deg"]).tolist())
PLATFORM_CHANNELS = "platform.x", "platform.y", "phi"
MOMENT_CHANNELS = "moment1", "moment2", "moment3"
START_POSE = "0.0165 0.0206 1.2"  # of the platform in the key, x [m], y [m], angle [rad]
START_POSES_AND_TURNS = {
    "S1": (START_POSE, (-0.53, -0.94, -1.05)),
    "S2": ("0.0068 0.0111 -1.39", (-0.2, -0.61, -0.68)),
}


def equilibrium_channels(engine: str, name: str, segments: int, folder: Path):
    """Curves of an engine in an equilibrium of Table 8 of Pérez Gámiz 2018.

    A pose of the platform and turns of the rods choose it.
    """
    case, (pose, turns) = load_case(shipped("rfr3.toml")), START_POSES_AND_TURNS[name]
    text, model = case.model_path.read_text(), folder / "rfr3.xml"
    assert START_POSE in text
    model.write_text(text.replace(START_POSE, pose))
    run = plan_run(case, "equilibrium", engine)
    rods = tuple(
        replace(rod, segments=segments, turn=turn)
        for rod, turn in zip(run.rods, turns, strict=True)
    )
    found = ENGINES[engine](model, replace(run, rods=rods, x=np.linspace(0.0, 1.0, segments + 1)))
    return found.channels


@cache
def state_of_rods(name: str) -> RodState:
    """The same equilibrium of rods, solved from the recomputed digits."""
    row = DATA["rfr3"]["recomputed"][list(START_POSES_AND_TURNS).index(name)]
    return solve_direct(
        state(
            three_rod_platform(DATA["rfr3"]["side"]),
            inputs=MOTORS,
            pose=[*row["pose"], np.radians(row["phi_deg"])],
            load=DATA["rfr3"]["load"],
            moment=row["moment"],
            force=row["force"],
        )
    )


@pytest.mark.parametrize(
    ("engine", "name", "segments"),
    [
        ("mujoco", "S1", 10),
        ("mujoco", "S1", 20),
        ("mujoco", "S2", 10),
        ("mujoco", "S2", 20),
        ("pymunk", "S1", 10),
        ("pymunk", "S2", 10),
    ],
)
def test_both_solutions_of_table_8_are_equilibria(engine, name, segments, tmp_path):
    """Both equilibria of Table 8 are those of the chains' equations, and of another computation."""
    found = equilibrium_channels(engine, name, segments, tmp_path)
    s = state_of_rods(name)
    shapes = [lambda arc, k=k: s.shape(np.atleast_1d(arc))[2][k] for k in range(3)]
    chain_state = settle(s.assembly, s.inputs, seed=shapes, segments=segments, force=[0.0, 0.5])
    values = [found[channel][0] for channel in (*PLATFORM_CHANNELS, *MOMENT_CHANNELS, "energy")]
    # both engines end within 1e-12 of the equilibrium, magnified by the platform's softness
    np.testing.assert_allclose(
        values,
        [*chain_state.pose, *-chain_state.root_moment, chain_state.energy],
        rtol=0,
        atol=1e-10,
    )
    for k, rod in enumerate(("left", "right", "top")):
        np.testing.assert_allclose(
            found[f"{rod}.angle"][1:], chain_state.angle[k], rtol=0, atol=1e-10
        )
    row = CHAINS[name]["half"][str(segments)]
    assert values[:2] == pytest.approx(row[:2], abs=5.1e-7)  # digits of that computation
    assert np.degrees(values[2]) == pytest.approx(row[2], abs=5.1e-5)


@pytest.mark.parametrize("name", START_POSES_AND_TURNS)
def test_platforms_converge_to_those_of_rods(name, tmp_path):
    coarse, fine = (equilibrium_channels("mujoco", name, n, tmp_path) for n in (20, 40))
    s = state_of_rods(name)
    limit = [
        (4 * fine[c][0] - coarse[c][0]) / 3
        for c in (*PLATFORM_CHANNELS, *MOMENT_CHANNELS, "energy")
    ]
    exact = [*s.pose, *-s.moment, s.energy.sum()]
    np.testing.assert_allclose(limit, exact, rtol=0, atol=5e-6)  # terms in h^4


@EACH_ENGINE
def test_poses_of_a_driven_platform_are_chain_equilibria(engine):
    """Samples of the case `pfr3` are equilibria of chains, followed from arcs of circles."""
    case = load_case(shipped("pfr3.toml"))
    run = plan_run(case, "sweep", engine)
    run = replace(run, x=run.x[:: 4 if engine == "pymunk" else 2])
    found = ENGINES[engine](case.model_path, run).channels
    turns, slider_places = (0.0, 2 * np.pi / 3, -2 * np.pi / 3), run.motion(run.x)[0].T
    assembly = three_rod_platform(0.5, angle=turns, guide=turns)
    seed = [
        lambda arc, turn=turn, rod=rod: turn + rod.turn * arc
        for turn, rod in zip(turns, run.rods, strict=True)
    ]
    guides = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    for k, slides in enumerate(slider_places):
        chain_state = settle(assembly, slides, seed=seed, segments=10, force=[0.3, -0.2])
        seed = chain_state.angle
        values = [
            found[channel][k]
            for channel in (*PLATFORM_CHANNELS, "force1", "force2", "force3", "energy")
        ]
        wanted = [
            *chain_state.pose,
            *-(chain_state.force * guides).sum(axis=-1),
            chain_state.energy,
        ]
        # equilibrium to 1e-12 of the model, magnified by its softness; in pymunk's forces also
        # rounding of a constraint violation, times mass over the square of a step
        np.testing.assert_allclose(values, wanted, rtol=0, atol=5e-9)


END = """<body name="end{0}" pos="{1} {2} 0"><joint name="end{0}"/><inertial pos="0 0 0" mass="0.1"
  diaginertia="1e-3 1e-3 1e-3"/><site name="end{0}" pos="-0.1 0 0"/></body>"""
SLIDER = """<body name="slider{0}" pos="{1} {2} 0" euler="0 0 {3}"><joint name="slider{0}"
  type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
  <site name="clamp{0}"/></body>"""
PLATFORM = """<body name="along"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1"/>
  <body name="across"><joint name="y" type="slide" axis="0 1 0"/><geom size="0.1"/>
  <body name="platform"><joint name="phi"/><geom size="0.1"/>{}</body></body></body>"""


def test_rods_with_rigid_ends_need_no_force_along_the_guides(tmp_path):
    """Rods are clamped into rigid ends, which are pinned to the platform.

    In the start pose of Pérez Gámiz's program no force acts along the guides.
    """
    row, turns = DATA["pfr3"]["recomputed"][0], np.radians([0.0, 120.0, -120.0])
    out = np.radians([-150.0, -30.0, 90.0])
    ends = "".join(END.format(k, 0.2 * np.cos(a), 0.2 * np.sin(a)) for k, a in enumerate(out))
    sliders = "".join(
        SLIDER.format(k, np.cos(a), np.sin(a), turn)
        for k, (a, turn) in enumerate(zip(out, turns, strict=True))
    )
    hold = "".join(f'<motor name="hold{k}" joint="slider{k}"/>' for k in range(3))
    read = "".join(f'<actuatorfrc name="hold{k}" actuator="hold{k}"/>' for k in range(3))
    file = write_model(
        tmp_path, PLATFORM.format(ends) + sliders, hold, read + '<jointpos name="phi" joint="phi"/>'
    )
    tip = np.radians(row["tip_turn_deg"])
    qpos = [0.0, 0.0, np.pi / 3, *(turns + tip - np.pi / 3), *[row["slide"]] * 3]
    text = file.read_text().replace('ctrl=""', f'qpos="{" ".join(map(str, qpos))}"')
    file.write_text(text.replace("<option ", '<option jacobian="dense" '))
    drives = tuple(Drive(f"slider{k}", partial(constant_profile, row["slide"])) for k in range(3))
    names, found = ("phi", "hold0", "hold1", "hold2"), []
    for n in (20, 40):
        rods = tuple(
            Rod(f"r{k}", f"clamp{k}", f"end{k}", 1.0, EI, n, ("clamped", "clamped"), turn=tip)
            for k in range(3)
        )
        curves = equilibrium_curves("mujoco", file, rods, names, drives).channels
        found.append(np.array([curves[name][0] for name in names]))
        assert np.ptp(found[-1][1:]) < 1e-11
    limit = (4 * found[1] - found[0]) / 3
    assert np.degrees(limit[0]) == pytest.approx(60.0, abs=1e-4)  # the slide has seven digits
    assert abs(found[0][1]) > 1e-5
    assert np.abs(limit[1:]).max() < 5e-8  # [N] digits of the slide, and terms in h^4


def with_mujoco_alone(edit, name: str) -> Path:
    """The case in MuJoCo alone; a sweep has three samples, its ends and its middle."""
    if name == "pfr3":
        edit("pfr3.toml", "n = 9", "n = 3")
    return edit(f"{name}.toml", r'solvers = \["mujoco", "pymunk"\]', 'solvers = ["mujoco"]')


def comparisons_of(sidecar: Path) -> list[Comparison]:
    """The comparisons of the only run of a case, in MuJoCo."""
    case = load_case(sidecar)
    (kind,) = case.run
    return compare(case, kind, "mujoco", solve_here(case, kind, "mujoco"), detectable=False)


WRONG_MECHANISMS = {
    "side": ("rfr3.xml", r'pos="0.1 -0.0577', 'pos="0.102 -0.0577'),
    "clamp angle": ("rfr3.xml", "3.141592653589793 -1.047", "3.16 -1.047"),
    "one rod stiffer": (
        "rfr3.toml",
        r"stiffness = 0.052186\d+\nsegments = 20\nturn = -1.05",
        "stiffness = 0.0527\nsegments = 20\nturn = -1.05",
    ),
    "load": ("rfr3.xml", 'gear="0 0.5', 'gear="0 0.505'),
    "slider's place": ("pfr3.xml", 'pos="0 1 0"', 'pos="0 0.995 0"'),
    "guide's direction": ("pfr3.xml", "0 0 -2.0943951", "0 0 -2.11"),
    "platform": ("pfr3.xml", r'name="pin2" pos="0.25', 'name="pin2" pos="0.26'),
    "slider's motion": ("pfr3.toml", "force_y = -0.2", "force_y = -0.21"),
}


FAST_MUTATION = "guide's direction"


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        pytest.param(*change, id=what, marks=[pytest.mark.slow] * (what != FAST_MUTATION))
        for what, change in WRONG_MECHANISMS.items()
    ],
)
def test_a_wrong_mechanism_differs(file, old, new, edit):
    name = file.partition(".")[0]
    sidecar = with_mujoco_alone(edit, name)
    edit(file, old, new)
    if new == "3.16 -1.047":  # the drive keeps the motor at the angle of the key
        edit(
            "rfr3.toml",
            "from = 3.141592653589793\nto = 3.141592653589793",
            "from = 3.16\nto = 3.16",
        )
    assert "differs" in {c.outcome for c in comparisons_of(sidecar)}


def with_mirrored_platform(edit, name: str, half: float) -> Path:
    """The case with the first two pins of the platform exchanged, in MuJoCo alone."""
    edit(f"{name}.xml", rf'name="pin1" pos="-{half}', f'name="pin1" pos="+{half}')
    edit(f"{name}.xml", rf'name="pin2" pos="{half}', f'name="pin2" pos="-{half}')
    return with_mujoco_alone(edit, name)


def test_a_mirrored_platform_is_refused(edit):
    """The rods of Table 8 do not reach the pins of a mirrored platform."""
    found = check([with_mirrored_platform(edit, "rfr3", 0.1)])
    assert found.exit_code == 2
    assert "its supports are 1.139" in str(found.errors[0])


def test_a_mirrored_platform_differs(edit):
    """A mirrored platform starts in a root that Pérez Gámiz's program accepts.

    There it is in another equilibrium.
    """
    row = next(np.array(row["pins"]) for row in DATA["pfr3_closures"]["pins"] if row["mirrored"])
    (x, y), side = row.mean(axis=0), row[0] - row[1]
    edit("pfr3.xml", "0.0022 -0.0016 1.744", f"{x} {y} {np.arctan2(side[1], side[0])}")
    found = comparisons_of(with_mirrored_platform(edit, "pfr3", 0.25))
    assert {c.outcome for c in found if c.channel in PLATFORM_CHANNELS} == {"differs"}


def test_the_misprinted_angle_differs(edit):
    """With theta2 = 0, as printed, the equilibrium is another one."""
    sidecar = with_mujoco_alone(edit, "rfr3")
    edit("rfr3.toml", "from = 3.141592653589793\nto = 3.141592653589793", "from = 0.0\nto = 0.0")
    assert {c.outcome for c in comparisons_of(sidecar) if c.channel == "phi"} == {"differs"}


def test_a_start_pose_of_another_mode_is_refused(edit):
    """A start pose of mode 2 is refused if the sidecar states mode 1."""
    file = edit("pfr3.xml", "0.0022 -0.0016 1.744", "0.0158 -0.0081 -1.388")
    for turn, other in ((0.41, 1.30), (0.47, 1.41), (0.42, 1.26)):
        edit("pfr3.toml", f"turn = {turn}", f"turn = {other}")
    edit("pfr3.toml", "segments = 10", "segments = 40")  # with 10 links, errors in h^2 hide it
    edit("pfr3.toml", "n = 9", "n = 3")
    case = load_case(file.with_suffix(".toml"))
    curves = solve_here(case, "sweep", "mujoco")
    with pytest.raises(InputError, match=r"assembles the model in mode \+2"):
        compare(case, "sweep", "mujoco", curves)


def test_small_changes_of_all_parameters_are_detectable():
    """Changes below 0.02 of every length, angle, stiffness and load are detectable."""
    case = load_case(shipped("rfr3.toml"))
    found = compare(case, "equilibrium", "mujoco", solve_here(case, "equilibrium", "mujoco"))
    least: dict[str, float] = {}
    for c in found:
        for key, change in c.detectable.items():
            least[key] = min(change.size, least.get(key, np.inf))
    assert set(least) >= {
        "side",
        "radius",
        "theta1",
        "theta2",
        "theta3",
        "length",
        "stiffness",
        "force_y",
    }
    assert max(least.values()) < 0.02
    assert evaluate(case, "equilibrium", np.array([0.0, 1.0]), None).channels["phi"][0] > 1.0
