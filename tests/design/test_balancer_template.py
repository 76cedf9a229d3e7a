"""The balancers in `models/` are output of the template, and a wrong model differs."""

import re
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.batch.check import check
from proofmass.design.template import write_case
from proofmass.run.sidecar import load_case
from proofmass.run.validate import validate_case
from proofmass.verdict.outcome import GOOD_OUTCOMES
from tests.analytic.balancer.balancer_cases import DESIGNS
from tests.analytic.balancer.balancer_table import parameters, rows
from tests.shipped import shipped, shipped_files
from tests.verdicts import all_comparisons

ROW_1743, FREE_ANGLE, PRELOADED, CONTACT, QUADRATIC, FOUR_SEGMENTS = (
    parameters(rows()[line]) for line in ("1743", "1766", "1768", "1860", "1753", "1747")
)
THIRD_PRELOAD = ROW_1743 | {"rest_angle": 0.5, "preload3": 0.2, "low3": 0.0}
NEGATIVE_THIRD_PRELOAD = ROW_1743 | {"preload3": -0.3, "high3": 0.0}
NUMBER_PATTERN = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


@pytest.mark.parametrize("name", DESIGNS)
def test_shipped_files_are_those_of_the_template(name, tmp_path):
    DESIGNS[name].write(tmp_path, name)
    for ending in (".xml", ".toml"):
        committed = shipped(f"{name}{ending}").read_text()
        written = (tmp_path / name).with_suffix(ending).read_text()
        assert NUMBER_PATTERN.split(written) == NUMBER_PATTERN.split(committed)
        # sines depend on the processor: rounding of the start pose, of sums of up to four links
        assert list(map(float, NUMBER_PATTERN.findall(written))) == pytest.approx(
            list(map(float, NUMBER_PATTERN.findall(committed))), rel=1e-14, abs=1e-15
        )


def test_every_shipped_balancer_is_in_the_table_of_designs():
    """The exception is a sidecar that compares an export with engines, for a model of the table."""
    own = {
        file.stem for file in shipped_files("balancer*.toml") if file.with_suffix(".xml").exists()
    }
    assert own == {*DESIGNS, "balancer4_sam_prescribed"}  # see `test_balancer_posture`


@pytest.mark.parametrize("name", DESIGNS)
def test_the_start_pose_is_closed_and_at_rest(name):
    model, data = at_start(shipped(f"{name}.xml"))
    violation = data.site("tip").xpos - data.site("pendulum_tip").xpos
    # sums of four coordinates below 1 m; arc cosines lose digits where an elbow is nearly straight
    assert np.abs(violation).max() <= (5e-15 if name == "balancer_extending" else 5e-16)
    # springs act against their stops only, and segments have no weight: rounding of 1 N m
    driven = np.array([model.joint(j).name == "extension" for j in range(model.njnt)])
    free = (model.jnt_limited == 0) & ~driven
    assert np.abs((data.qfrc_passive - data.qfrc_bias)[free]).max() <= 1e-15


@pytest.mark.parametrize(
    "chain", [FREE_ANGLE, FOUR_SEGMENTS], ids=["three segments", "four segments"]
)
def test_only_the_tip_has_weight(chain, tmp_path):
    file = write_case(tmp_path, "heavy", title="", source="", parameters=chain | {"weight": 2.5})
    model, data = at_start(file.with_suffix(".xml"))
    model.jnt_stiffness[:] = 0.0
    data.qpos[:] = np.random.default_rng(1).uniform(-np.pi, np.pi, model.nq)
    mujoco.mj_forward(model, data)
    pull = 2.5 * np.sin(data.qpos[0])  # clockwise, so the bias, which resists it, is its negative
    # 1e-15: rounding of moments of about 0.1 N m, and of 2.5 N m
    assert np.abs(data.qfrc_bias[1:]).max() <= 1e-15
    assert abs(data.qfrc_bias[0] + pull) <= 1e-15
    assert abs(data.sensor("energy").data[0] - 2.5 * np.cos(data.qpos[0])) <= 2e-15


def test_springs_are_those_of_the_parameters(tmp_path):
    """A preloaded quadratic spring has its preload as moment, and the integral as energy."""
    k, a, preload = 1.1, -0.3, 0.4
    found = write_case(
        tmp_path,
        "springs",
        title="",
        source="",
        parameters=FREE_ANGLE
        | {"stiffness2": k, "quadratic2": a, "preload2": preload, "low2": 0.0},
    )
    _, data = at_start(found.with_suffix(".xml"))
    assert data.qfrc_passive[2] == pytest.approx(-preload, abs=1e-15)  # rounding
    wound = min(x for x in np.roots([a, k, -preload]) if x > 0)
    x = np.linspace(0.0, wound, 1001)
    # 1e-7: trapezoidal rule with steps of 4e-4 rad
    assert data.sensor("energy").data[0] == pytest.approx(
        np.trapezoid(k * x + a * x**2, x), abs=1e-7
    )


def at_start(file: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model in its start pose."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


NEARLY_STRAIGHT = {
    **{f"stiffness{k}": 2.0128 for k in (1, 2, 3, 4)},
    **{f"quadratic{k}": -0.9464 for k in (1, 2, 3, 4)},
    **dict.fromkeys(("length1", "length4"), 0.25),
    **dict.fromkeys(("length2", "length3"), 0.2505),
    "preload2": 0.6541,
    "low2": 0.0,
    "preload3": 1.0,
    "low3": 0.0,
}
"""A chain whose segments are 0.1 % longer in sum than the pendulum at rest."""


def test_forces_of_a_nearly_straight_chain_have_the_rounding_of_its_pose(tmp_path):
    """Their slope is some 1e4 N/m, so that a rounding of 1e-15 m is more than 1e-12 N.

    An error of 1e-13 m in one of the segments of the model is still found.
    """
    file = write_case(tmp_path, "steep", title="", source="", parameters=NEARLY_STRAIGHT)
    allowed = {t.abs for t in load_case(file).tolerance if t.unit == ("N",)}
    assert len(allowed) == 1
    assert 1e-11 < allowed.pop() < 1e-9
    with_fewer_samples(file)

    def outcomes() -> set[str]:
        return {c.outcome for c in check([file], detectable=False, causes=False).comparisons}

    assert outcomes() <= {*GOOD_OUTCOMES}
    model = file.with_suffix(".xml")
    text = model.read_text(encoding="utf-8")
    wrong = text.replace('pos="0.0 0.2505 0"', 'pos="0.0 0.2505000000001 0"')
    assert wrong != text
    model.write_text(wrong, encoding="utf-8")
    assert "differs" in outcomes()
    plain = write_case(tmp_path, "plain", title="", source="", parameters=FOUR_SEGMENTS)
    assert "nearly straight" not in plain.read_text(encoding="utf-8")


# A sidecar of one balancer with the model of another one; with its own model it agrees.
WRONG_PARAMETERS = {
    "a length": (PRELOADED, {"length2": PRELOADED["length2"] * (1 + 1e-9)}),
    "the pendulum": (PRELOADED, {"pendulum": 1 + 1e-9}),
    "a missing preload": (PRELOADED, {"preload2": 0.0}),
    "springs changed about": (
        PRELOADED,
        {"stiffness2": PRELOADED["stiffness3"], "stiffness3": PRELOADED["stiffness2"]},
    ),
    "elbow down": (PRELOADED, {"mode": -1}),
    "the rest angle": (PRELOADED, {"rest_angle": -PRELOADED["rest_angle"]}),
    "a missing stop": (CONTACT, {"high2": np.inf}),
    "a stop elsewhere": (CONTACT, {"high2": CONTACT["high2"] + 1e-9}),
    "the sign of a quadratic spring": (QUADRATIC, {"quadratic3": -QUADRATIC["quadratic3"]}),
    "a missing weight": (FREE_ANGLE | {"weight": 1.0}, {"weight": 0.0}),
    "the preload of another joint": (
        THIRD_PRELOAD,
        {"preload3": 0.0, "low3": -np.inf, "preload2": 0.2, "low2": 0.0},
    ),
    "another preload of spring 3": (THIRD_PRELOAD, {"preload3": 0.2 * (1 + 1e-9)}),
    "a missing preload that holds at no moment": (
        NEGATIVE_THIRD_PRELOAD,
        {"preload3": 0.0, "high3": np.inf},
    ),
    "preloads changed about": (
        FOUR_SEGMENTS,
        {"preload2": FOUR_SEGMENTS["preload3"], "preload3": FOUR_SEGMENTS["preload2"]},
    ),
}
WRONG_TEXTS = {  # changes of a model that no parameter makes
    "the sign of a stiffness": (PRELOADED, 'stiffness="2.4054"', 'stiffness="-2.4054"'),
    "a preload without its stop": (PRELOADED, ' range="0.0 10.0"', ""),
    "the sign of a preload": (PRELOADED, 'springref="-', 'springref="'),
    "the sense of a hinge": (PRELOADED, 'name="joint2"', 'name="joint2" axis="0 0 1"'),
    "a segment that weighs": (
        FREE_ANGLE | {"weight": 1.0},
        '"0.0 0.0 0" mass="0.001"',
        '"0.1 0.0 0" mass="0.001"',
    ),
}
EACH_SOLVER = pytest.mark.parametrize(
    "solver", ["mujoco", pytest.param("pymunk", marks=pytest.mark.slow)]
)


def write_short_case(folder: Path, chain: dict, solver: str) -> Path:
    """Write a case of a balancer that states ``mode = 1``, with few samples."""
    return with_fewer_samples(
        write_case(
            folder, "case", title="t", source="s", parameters={"mode": 1} | chain, solvers=[solver]
        )
    )


def with_fewer_samples(file: Path) -> Path:
    """Keep a twentieth of the samples of a sweep, whose equilibria do not depend on each other."""
    text, hits = re.subn(r"(?m)^n = 181\b", "n = 9", file.read_text())
    assert hits == 1
    file.write_text(text)
    return file


def differs_or_is_refused(file: Path) -> bool:
    """Whether a channel does not agree, or the model is refused for its start pose."""
    try:
        return any(c.outcome not in GOOD_OUTCOMES for c in all_comparisons(file))
    except InputError:
        return True


@EACH_SOLVER
@pytest.mark.parametrize("what", WRONG_PARAMETERS)
def test_the_model_of_another_balancer_differs(what, solver, tmp_path):
    chain, change = WRONG_PARAMETERS[what]
    file = write_short_case(tmp_path, chain, solver)
    validate_case(load_case(file))  # otherwise the difference could be due to bad input
    shutil.copy(
        write_short_case(tmp_path / "wrong", chain | change, solver).with_suffix(".xml"), tmp_path
    )
    assert differs_or_is_refused(file)


@EACH_SOLVER
@pytest.mark.parametrize("what", WRONG_TEXTS)
def test_a_wrong_model_differs(what, solver, tmp_path):
    chain, old, new = WRONG_TEXTS[what]
    file = write_short_case(tmp_path, chain, solver)
    validate_case(load_case(file))
    model = file.with_suffix(".xml")
    assert old in model.read_text()
    model.write_text(model.read_text().replace(old, new))
    assert differs_or_is_refused(file)


def test_the_other_assembly_mode_is_named(tmp_path):
    file = write_short_case(tmp_path, FREE_ANGLE, "mujoco")
    shutil.copy(
        write_short_case(tmp_path / "down", FREE_ANGLE | {"mode": -1}, "mujoco").with_suffix(
            ".xml"
        ),
        tmp_path,
    )
    assert "assembles the model in mode -1" in str(check([file]).errors[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length1": 0.01, "length2": 0.1}, "cannot reach the tip"),
        ({"preload2": 0.3}, "needs a stop that holds it"),
        ({"stiffness": 1.0}, "unknown parameter 'stiffness'"),
        ({"length1": -1.0}, "length1 must be positive"),
    ],
)
def test_impossible_parameters_are_refused(change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        write_case(tmp_path, "bad", title="", source="", parameters=FREE_ANGLE | change)
    assert not list(tmp_path.iterdir())


def test_a_spring_without_stiffness_is_a_constant_moment(tmp_path):
    file = write_case(
        tmp_path,
        "constant",
        title="",
        source="",
        solvers=["mujoco", "pymunk"],
        parameters=parameters(rows()["2157"]),
    )
    _, data = at_start(file.with_suffix(".xml"))
    assert data.qfrc_actuator.tolist() == [0.0, 0.0, -0.369, 0.0]
    assert "energy" not in load_case(file).channels  # a constant moment has no energy channel
    assert check([with_fewer_samples(file)], detectable=False, causes=False).exit_code == 0


def test_quoted_words_and_compared_balancers_are_kept(tmp_path):
    case = load_case(
        write_case(
            tmp_path,
            "words",
            title='A "sine"',
            source="a\\b é",
            parameters=FREE_ANGLE,
            target="sine",
            beside={"row 1743": ROW_1743},
        )
    )
    assert (case.title, case.source) == ('A "sine"', "a\\b é")
    assert case.compare_with["row 1743"].parameters == ROW_1743
    assert case.parameters == FREE_ANGLE | {"target": "sine", "target_moment": 1.0}
