"""`choose --creep`: the creep rate of a body that friction keeps at rest, and slower settings."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.commands.cli import app
from proofmass.run.sidecar import load_case
from proofmass.sim.engines import engine_of
from proofmass.studies.trade.creep import RATE_MARGIN, find_slow_setting
from tests.programs import run_standalone
from tests.shipped import shipped

STICKING_BLOCK = shipped("block_sticks.toml")
SLOPE_ANGLE = 0.5


def run_choose(*args: object):
    """The result of the command `choose` with these arguments."""
    return CliRunner().invoke(app, ["choose", *map(str, args)])


@pytest.fixture
def short_case(edit: Callable[..., Path]) -> Path:
    """A copy of the case that ends after 0.5 s; the block is at rest after 0.28 s."""
    return edit("block_sticks.toml", r"until = 1\.0", "until = 0.5")


def expected_creep_rate(impratio: float) -> float:
    """The creep rate of the case by its closed form [m/s].

    The block is 0.2 m by 0.1 m.  Its upper two corners bear less weight than the lower two, since
    friction acts below the centre of mass.  The upper ones are at their largest friction force, and
    the lower ones bear the remainder.
    """
    pull, weight = 9.81 * np.sin(SLOPE_ANGLE), 9.81 * np.cos(SLOPE_ANGLE)  # forces on 1 kg
    upper = weight / 4 - pull * 0.05 / (4 * 0.1)
    lower = pull / 2 - 0.7 * upper  # friction of each of the two
    model = mujoco.MjModel.from_xml_path(str(shipped("block_sticks.xml")))
    body = model.body("block").id
    # A contact has (1 - d) / d A f / impratio = b v in the direction of its friction force f, with
    # b = 2 / (d time constant) and A, which MuJoCo sets to the inverse weight of the body
    d, time_constant = 0.9, 0.005  # solimp and solref of the model
    softness = (1 - d) / d * float(model.body_invweight0[body, 0]) / impratio
    return softness * lower * d * time_constant / 2


def test_the_creep_rate_is_that_of_the_closed_form_and_slow_enough(short_case):
    model, chosen = find_slow_setting(load_case(short_case), "mujoco", 1e-6, 30.0)
    assert chosen.rate <= 1e-6 < model.rate
    assert model.rate == pytest.approx(expected_creep_rate(1.0), rel=1e-4)
    ratio = chosen.setting.parameters["impratio"]
    assert ratio == pytest.approx(RATE_MARGIN * model.rate / 1e-6, rel=0.05)  # it has two digits
    assert chosen.rate == pytest.approx(expected_creep_rate(ratio), rel=1e-3)


def test_the_written_program_creeps_at_the_printed_rate(tmp_path):
    program = tmp_path / "run.py"
    answer = run_choose(STICKING_BLOCK, "--creep", 1e-6, "-o", program)
    assert answer.exit_code == 0
    assert run_standalone(program).returncode == 0
    rows = np.genfromtxt(tmp_path / "curves.csv", delimiter=",", names=True)
    late = rows[rows[rows.dtype.names[0]] >= 0.9 - 1e-9]
    rate = abs(late["position"][-1] - late["position"][0]) / 0.1
    assert 0.9e-6 < rate <= 1e-6
    assert f"position creeps {rate:.3g} m/s".replace("e-0", "e-") in answer.output


def test_an_unreachable_rate_is_reported_with_the_tried_settings(short_case):
    answer = run_choose(short_case, "--creep", 1e-13)
    assert answer.exit_code == 1
    assert answer.output.count("MuJoCo impratio") == 4
    assert "MuJoCo as in the model: position creeps 2.09e-4 m/s" in answer.output


def test_a_proposed_setting_that_creeps_too_fast_is_rejected(short_case, monkeypatch):
    monkeypatch.setattr(
        type(engine_of("mujoco").tuning),
        "holding",
        lambda self, model, given, slower: {"impratio": 2.0},
    )
    assert run_choose(short_case, "--creep", 1e-6).exit_code == 1


def test_an_engine_that_does_not_creep_keeps_its_settings():
    answer = run_choose(STICKING_BLOCK, "--creep", 1e-9, "--solver", "pymunk")
    assert answer.exit_code == 0
    assert "pymunk as in the model: position creeps 0 m/s" in answer.output


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ((shipped("pendulum.toml"), "--creep", 1e-6), "no place is at rest in the last tenth"),
        ((shipped("fourbar.toml"), "--creep", 1e-6), "no free motion in time"),
        ((STICKING_BLOCK, "--creep", 0), "give a speed in m/s or rad/s, such as 1e-6"),
        ((STICKING_BLOCK, "--creep", "nan"), "give a speed in m/s or rad/s, such as 1e-6"),
        (
            (STICKING_BLOCK, "--creep", 1e-6, "--solver", "bullet"),
            "block_sticks runs in mujoco, pymunk",
        ),
        ((STICKING_BLOCK, "--creep", 1e-6, "-o", "run.txt"), "give the name of a Python program"),
        ((STICKING_BLOCK,), "give one of the two: --error, such as 1e-5, or --creep"),
        ((STICKING_BLOCK, "--creep", 1e-6, "--error", 1e-5), "give one of the two"),
    ],
)
def test_bad_input_gives_a_message_of_one_line(args, words):
    answer = run_choose(*args)
    assert answer.exit_code == 2
    assert words in " ".join(answer.output.split())
    assert len(answer.output.strip().splitlines()) == 1
