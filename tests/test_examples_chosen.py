"""Programs that `proofmass choose` writes need no proofmass and have the errors that they state.

Four programs are in examples/chosen/; the others are written here.

The errors are measured against the formulas in `examples/chosen/truths.py`.  These are tested here
as well: rates are derivatives of positions, energies are constant, and moments agree with the
references of proofmass.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import ROOT
from benchmarks.choose import ASKED, Asked
from examples.chosen import truths
from proofmass.commands.cli import app
from proofmass.reference.evaluate import evaluate
from proofmass.run.sidecar import load_case
from tests.programs import run_standalone
from tests.shipped import shipped

EXAMPLES = Path(__file__).parent.parent / "examples" / "chosen"
COMMANDS = dict(
    re.findall(
        r"^proofmass choose (.*) -o examples/chosen/(\w+)\.py$",
        (EXAMPLES / "README.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
)
COMMANDS = {name: asked for asked, name in COMMANDS.items()}
WRITTEN_HERE = {
    "spring_slider_mujoco": "tests/data/chosen/spring_slider.toml --error 1e-5 --solver mujoco",
    "double_pendulum_mujoco": "tests/data/chosen/double_pendulum.toml --error 1e-6 --solver mujoco",
    "fourbar_servo_mujoco": (
        "models/linkages/fourbar.toml --error 1e-4 --solver mujoco --drive servo"
    ),
    "jansen_mujoco": "tests/data/chosen/jansen.toml --error 1e-5 --solver mujoco",
    "fivebar_swing_pymunk": (
        "tests/data/chosen/fivebar_swing.toml --error 1e-5 --of velocity --solver pymunk"
    ),
}
"""Arguments of `proofmass choose` for programs that are not in examples/chosen/."""
CASE_AND_ERROR = re.compile(
    r'^"""(\w+), dynamics: (\w+) within (\S+) of its range\.$', re.MULTILINE
)
PRINTED_ERROR = re.compile(r"as a program that runs by itself.*?: (\S+) off in")
ROUNDING_FACTOR = 1.06  # factor on an error of which two digits are printed
OTHER_VERSION_FACTOR = (
    1.2  # factor for another version of an engine, which may sum in another order
)


def program(name: str) -> str:
    """The text of a program of examples/chosen/."""
    return (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")


def read_first_lines(text: str) -> tuple[str, str, float, float]:
    """Case, kind of error, error asked for and error printed in the first lines of a program."""
    head = text.split('"""')[1]
    case, of, asked = CASE_AND_ERROR.findall(f'"""{head}')[0]
    printed = PRINTED_ERROR.search(" ".join(head.split()))
    assert printed
    return case, of, float(asked), float(printed[1])


def run_program(text: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a program that writes its curves to `out.csv`."""
    (folder / "run.py").write_text(text, encoding="utf-8")
    return run_standalone(folder / "run.py", "out.csv")


def test_every_program_has_its_command_in_the_readme() -> None:
    programs = {file.stem for file in EXAMPLES.glob("*.py")} - {"truths", "__init__"}
    assert programs == set(COMMANDS)
    for name, asked in COMMANDS.items():
        case, of, error, _ = read_first_lines(program(name))
        model, *options = asked.split()
        assert Path(model).stem == case
        values = dict(zip(options[::2], options[1::2], strict=True))
        assert float(values["--error"]) == error
        assert values.get("--of", "position") == of
        assert values["--solver"] in name
        assert (EXAMPLES.parent.parent / model).is_file()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_program_is_as_accurate_as_it_says(name: str, tmp_path: Path) -> None:
    assert_states_its_error(program(name), tmp_path)


@pytest.mark.parametrize("name", WRITTEN_HERE)
def test_a_program_written_here_is_as_accurate_as_it_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    arguments = [*WRITTEN_HERE[name].split(), "-o", str(tmp_path / "chosen.py")]
    done = CliRunner().invoke(app, ["choose", *arguments, "--store", str(tmp_path / "runs")])
    assert done.exit_code == 0, done.output
    assert_states_its_error((tmp_path / "chosen.py").read_text(encoding="utf-8"), tmp_path)


def assert_states_its_error(text: str, folder: Path) -> None:
    """Assert that a program needs no proofmass, and has the error that its first lines state."""
    case, of, asked, printed = read_first_lines(text)
    assert "proofmass" not in text.split('"""', 2)[2]
    assert not re.search(r"/(tmp|home|work|root|Users)\b", text)
    done = run_program(text, folder)
    assert done.returncode == 0, done.stderr
    error = truths.errors(case, str(folder / "out.csv"))[of]
    assert error <= asked
    assert (
        printed / (ROUNDING_FACTOR * OTHER_VERSION_FACTOR)
        < error
        < printed * ROUNDING_FACTOR * OTHER_VERSION_FACTOR
    )


@pytest.mark.parametrize("name", ["pendulum_mujoco", "fourbar_released_pymunk"])
def test_a_program_with_wrong_gravity_exceeds_its_error(name: str, tmp_path: Path) -> None:
    """With gravity that is 1 % weaker, the error is larger than the one asked for."""
    text = program(name)
    case, of, asked, _ = read_first_lines(text)
    changed = text.replace('gravity="0 -9.81 0"', 'gravity="0 -9.71 0"').replace(
        "space.gravity = (0.0, -9.81)", "space.gravity = (0.0, -9.71)"
    )
    assert changed != text
    assert run_program(changed, tmp_path).returncode == 0
    assert truths.errors(case, str(tmp_path / "out.csv"))[of] > asked


@pytest.mark.parametrize("case", truths.TRUTHS)
def test_rates_of_the_formulas_are_derivatives(case: str) -> None:
    """Each rate agrees with central differences of sixth order with a step of 1 ms.

    The differences have a truncation error of h^6/140 times the seventh derivative of a coordinate.
    Motions that are integrated with a relative tolerance of 1e-12 have errors that change from
    step to step: a change of 2e-12 within one sample is one of 2e-9 in the rate.
    """
    h = 1e-3
    t = np.arange(501) * h
    curves = truths.TRUTHS[case](t)
    pairs = 0
    for name, curve in curves.items():
        rate = derivative_of(name, curves)
        if rate is None:
            continue
        difference = (
            sum(
                w * (curve[3 + k : len(t) - 3 + k] - curve[3 - k : len(t) - 3 - k])
                for k, w in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
            )
            / h
        )
        assert difference == pytest.approx(rate[3:-3], abs=5e-9 * max(1.0, abs(rate).max())), name
        pairs += 1
    assert pairs >= 2


def derivative_of(name: str, curves: truths.Curves) -> np.ndarray | None:
    """The curve that is the time derivative of a named curve, or None if there is none."""
    if name == "angle":  # the pendulum's
        return curves["rate"]
    name, dot, part = name.partition(".")
    if part == "angle":
        return curves[f"{name}_rate.z"]
    for here, then in (
        ("_velocity", "_acceleration"),
        ("_rate", "_acceleration"),
        ("rate", "acceleration"),
        ("", "_velocity"),
        ("", "_rate"),
    ):
        if name.endswith(here) and "acceleration" not in name and (here or "rate" not in name):
            found = curves.get(f"{name.removesuffix(here)}{then}{dot}{part}")
            if found is not None and (here or "velocity" not in name):
                return found
    return None


def test_energies_of_the_formulas_are_constant() -> None:
    """The energies of the single and the double pendulum are constant.

    A relative error of 1e-9 in one mass changes the energy of the double pendulum by 1e-9.
    """
    t = np.linspace(0.0, 2.0, 201)
    single = truths.pendulum(t)
    assert single["kinetic"] + single["potential"] == pytest.approx(truths.G, rel=1e-12)
    y = truths.double_pendulum(t)
    p, u = y["shoulder"], y["shoulder_rate"]
    q, v = p + y["elbow"], u + y["elbow_rate"]
    energy = (
        0.8**2 * u**2 / 6
        - truths.G * 0.4 * np.cos(p)
        + 0.7 * ((0.8 * u) ** 2 + (0.3 * v) ** 2 + 2 * 0.8 * 0.3 * u * v * np.cos(p - q)) / 2
        + 0.7 * 0.6**2 * v**2 / 24
        - 0.7 * truths.G * (0.8 * np.cos(p) + 0.3 * np.cos(q))
    )
    assert energy == pytest.approx(energy[0], abs=1e-10)


def test_an_unknown_formula_is_reported_with_the_known_ones() -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / "truths.py"), "fourbars", "x.csv"],
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 1
    assert "one of fourbar, slider_crank" in done.stderr


@pytest.mark.parametrize("asked", {one.truth: one for one in ASKED}.values(), ids=lambda a: a.truth)
def test_every_channel_of_a_case_has_a_formula(asked: Asked) -> None:
    """Otherwise a missing curve shows only when `python -m benchmarks.choose` reaches the case."""
    case = load_case(ROOT / asked.path)
    energies = {"kinetic", "potential"}
    assert (
        case.channels.keys() - energies <= truths.TRUTHS[asked.truth](np.linspace(0, 0.1, 4)).keys()
    )


@pytest.mark.parametrize("name", ["fourbar", "slider_crank", "inverted_slider_crank_classic"])
def test_moments_that_follow_from_power_are_those_of_the_references(name: str) -> None:
    """The moments of truths.py follow from power; the references share no code with them."""
    case = load_case(shipped(f"{name}.toml"))
    t = np.linspace(0.0, 6.0, 61)
    state = tuple(part[None] for part in (t, np.ones_like(t), np.zeros_like(t)))
    known = evaluate(case, "dynamics", t, state).channels["holding_moment"]
    truth = {"inverted_slider_crank_classic": "swinging_block"}.get(name, name)
    found = truths.TRUTHS[truth](t)["holding_moment"]
    assert np.allclose(found, known, rtol=0, atol=1e-12 * np.ptp(known))
    assert not np.allclose(1.0001 * found, known, rtol=0, atol=1e-12 * np.ptp(known))
