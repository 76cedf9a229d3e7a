"""Verdicts on measured curves with noise: agreement, refusal, the number that is named, bad input.

The measured curves are those of the closed form of the four-bar with noise of given seeds.
"""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from proofmass.analytic.linkages.fourbar import solve as solve_fourbar
from proofmass.base.arrays import Array
from proofmass.base.errors import InputError
from proofmass.batch.work import compare_and_share
from proofmass.case.case import Case
from proofmass.commands.cli import app
from proofmass.evidence.diagnosis import Diagnosis, find_causes
from proofmass.evidence.diagnosis.fault import FaultValue
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve_here
from proofmass.run.validate import validate_case
from proofmass.verdict.compare import compare
from proofmass.verdict.comparison import Comparison, NoiseResult

MODEL = Path(__file__).parents[2] / "models" / "linkages" / "fourbar.xml"
LENGTHS = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0}
RATE, ROWS, SIGMA = 2.0 * math.pi, 401, 0.05
"""Rate of the crank [rad/s], rows, and noise of the angle [deg]."""
RIG = "recorded:rig"
EVEN = np.linspace(0.0, 2.0, ROWS)
"""Times of the rows [s]: two turns."""
DRIVE = f"""
[drive]
joint = "crank"
from = 0.0
to = {4.0 * math.pi!r}
rate = {RATE!r}
"""
SIDECAR = """title = "A four-bar on a rig"
source = "closed form with noise"
model = "{model}"
reference = "rig.csv"
{drive}
[run.dynamics]
solvers = ["mujoco"]

[channels]
rocker = {{ equals = "phi", unit = "deg" }}

[[tolerance]]
{tolerance}
why = "encoder"
"""
PARTY = """title = "A rig as a party"
source = "closed form with noise"
model = "{model}"
reference = "fourbar"
{drive}
[parameters]
crank = {crank}
coupler = {coupler}
rocker = {rocker}
ground = {ground}
mode = 1

[run.dynamics]
n = 201
solvers = ["recorded:rig"]

[settings."recorded:rig"]
file = "rig.csv"
channels = {{ rocker = {{ column = "phi" }} }}

[channels]
rocker = {{ equals = "rocker_angle", unit = "deg" }}

[[tolerance]]
{tolerance}
why = "encoder"
"""


def angle(times: Array, zero: float = 0.0, lag: float = 0.0) -> Array:
    """The angle of the rocker [deg], with a wrong zero [deg] and a clock that is late [s]."""
    found = solve_fourbar(RATE * (times + lag), RATE, 0.0, **LENGTHS, mode=1)
    return np.degrees(found["rocker_angle"]) + zero


def write_rig(folder: Path, values: Array, times: Array = EVEN, seed: int = 3) -> None:
    """Write a measured angle with noise."""
    noisy = values + SIGMA * np.random.default_rng(seed).standard_normal(times.size)
    rows = [f"{t:.6f},{phi:.6f}" for t, phi in zip(times, noisy, strict=True)]
    (folder / "rig.csv").write_text("\n".join(["t [s],phi [deg]", *rows]), encoding="utf-8")


def write_case(
    folder: Path,
    values: Array,
    tolerance: str = f"sigma = {SIGMA}",
    change: tuple[str, str] = ("", ""),
) -> Case:
    """Write a case with a measured reference, and a model in which a text is changed."""
    write_rig(folder, values)
    text = MODEL.read_text(encoding="utf-8")
    assert change[0] in text
    (folder / "fourbar.xml").write_text(text.replace(*change), encoding="utf-8")
    file = folder / "rig.toml"
    words = SIDECAR.format(model="fourbar.xml", drive=DRIVE, tolerance=tolerance)
    file.write_text(words, encoding="utf-8")
    return load_case(file)


def judge(case: Case, solver: str = RIG) -> Comparison:
    """The comparison of the angle."""
    curves = solve_here(case, "dynamics", solver)
    (found,) = compare_and_share(case, "dynamics", solver, curves)
    return found


def explain(case: Case, solver: str = RIG) -> Diagnosis:
    """The causes that are found."""
    return find_causes(case, "dynamics", solver, solve_here(case, "dynamics", solver))


def noise_of(found: Comparison) -> NoiseResult:
    """What an agreeing comparison says of its noise."""
    assert found.outcome == "agrees"
    assert found.noise is not None
    return found.noise


def fault_of(found: Diagnosis) -> tuple[str, FaultValue, float, float]:
    """Name and wrong value of the best cause, the right value and its standard error."""
    assert found.best is not None
    assert found.best.fault is not None
    fault = found.best.fault
    assert isinstance(fault.right, float)
    return fault.name, fault.wrong, fault.right, fault.error


COUPLER = 'name="coupler_end" pos="2 0 0"', 'name="coupler_end" pos="2.002 0 0"'


def party(
    folder: Path,
    values: Array | None = None,
    tolerance: str = f"sigma = {SIGMA}",
    times: Array = EVEN,
    **lengths: float,
) -> Case:
    """A measured curve as a party beside the closed form, whose slopes cost no run of an engine."""
    shutil.copy(MODEL, folder / "fourbar.xml")
    write_rig(folder, angle(times) if values is None else values, times)
    file, words = folder / "party.toml", {**LENGTHS, **lengths}
    text = PARTY.format(model="fourbar.xml", drive=DRIVE, tolerance=tolerance, **words)
    file.write_text(text, encoding="utf-8")
    return load_case(file)


def test_an_exact_model_agrees_with_its_noise(tmp_path: Path) -> None:
    found = judge(write_case(tmp_path, angle(EVEN)), "mujoco")
    assert noise_of(found).rows == ROWS
    assert found.error_max > 3.0 * SIGMA  # which a tolerance of three sigma would refuse
    assert "noise of 0.05 deg, as stated, in 401 rows" in found.message
    assert "no number of the model is off by more than" in found.message


def test_a_length_that_is_a_thousandth_too_long_is_named_with_its_error(tmp_path: Path) -> None:
    case = write_case(tmp_path, angle(EVEN), change=COUPLER)
    curves = solve_here(case, "dynamics", "mujoco")
    (found,) = compare(case, "dynamics", "mujoco", curves)
    assert found.outcome == "differs"
    assert found.error_max < found.allowed  # no row shows it by itself
    diagnosis = find_causes(case, "dynamics", "mujoco", curves)
    name, wrong, right, error = fault_of(diagnosis)
    assert (name, wrong) == ("coupler_end x", 2.002)
    assert abs(right - 2.0) < 3.0 * error
    assert error == pytest.approx(1e-4, rel=0.1)  # sigma over the norm of the slope
    assert diagnosis.text.startswith("cause: fourbar.xml, line 25: coupler_end x is 2.002 m; with")
    assert "±" in diagnosis.text


@pytest.mark.parametrize(
    ("fit", "zero", "lag"), [("zero", 0.2, 0.0), ("lag", 0.0, 2e-3), ("zero, lag", 0.2, 2e-3)]
)
def test_a_zero_and_a_lag_are_fitted_if_asked_for(
    fit: str, zero: float, lag: float, tmp_path: Path
) -> None:
    values, names = angle(EVEN, zero, lag), [f'"{name}"' for name in fit.split(", ")]
    refused = party(tmp_path, values)
    assert judge(refused).outcome == "differs"
    if len(names) == 1:
        text = explain(refused).text
        assert f"fit = ['{fit}'] would find" in text
        assert f" {'deg' if zero else 's'} in the recording of rocker" in text
    tolerance = f"sigma = {SIGMA}\nfit = [{', '.join(names)}]"
    found = judge(party(tmp_path, values, tolerance))
    for name, true in (("zero", zero), ("lag", lag)):
        if name in fit:
            value, error = noise_of(found).fits[name]
            assert abs(value - true) < 3.0 * error
            assert f"{name} {value:.3f}"[:-1] in found.message


def test_a_wrong_length_is_not_taken_for_a_zero(tmp_path: Path) -> None:
    """The crank changes the swing of the rocker, which no zero does."""
    case = party(tmp_path, tolerance=f'sigma = {SIGMA}\nfit = ["zero"]', crank=1.002)
    assert judge(case).outcome == "differs"
    assert fault_of(explain(case))[:2] == ("crank", 1.002)


def test_noise_can_be_estimated(tmp_path: Path) -> None:
    estimated = 'sigma = "estimated"'
    found = judge(party(tmp_path, tolerance=estimated))
    assert noise_of(found).estimated
    assert noise_of(found).sigma == pytest.approx(SIGMA, rel=0.15)  # three standard errors of 5 %
    assert "as estimated" in found.message
    case = party(tmp_path, tolerance=estimated, coupler=2.002)
    assert judge(case).outcome == "differs"
    assert fault_of(explain(case))[:2] == ("coupler", 2.002)


def test_noise_that_is_stated_too_small_is_refused(tmp_path: Path) -> None:
    found = judge(party(tmp_path, tolerance="sigma = 0.03"))
    assert found.outcome == "differs"
    assert "a root mean square of" in found.message


def test_a_tolerance_below_the_noise_is_the_cause(tmp_path: Path) -> None:
    case = party(tmp_path, tolerance="abs = 0.12")
    assert judge(case).outcome == "differs"
    text = explain(case).text
    assert text.startswith("cause: sigma = 0.0")
    assert "deg for rocker in place of the tolerance" in text


def test_a_wrong_model_is_not_taken_for_noise(tmp_path: Path) -> None:
    text = explain(party(tmp_path, tolerance="abs = 0.12", coupler=2.02)).text
    assert "in place of the tolerance" not in text


UNEVEN = np.round(2.0 * np.linspace(0.0, 1.0, ROWS) ** 1.1, 6)
"""Times whose spacing doubles [s]."""


def test_rows_at_uneven_times_are_judged_at_their_own_times(tmp_path: Path) -> None:
    """The smooth curve of the engine is interpolated, not the noisy rows."""
    case = write_case(tmp_path, angle(EVEN))
    write_rig(tmp_path, angle(UNEVEN), UNEVEN)
    (found,) = compare(case, "dynamics", "mujoco", solve_here(case, "dynamics", "mujoco"))
    assert noise_of(found).rows == ROWS
    assert found.error_rms == pytest.approx(SIGMA, rel=0.11)  # three standard errors


def test_a_noisy_party_is_judged_at_its_own_rows(tmp_path: Path) -> None:
    assert noise_of(judge(party(tmp_path, times=UNEVEN))).rows == ROWS
    case = party(tmp_path, times=UNEVEN, coupler=2.002)
    assert judge(case).outcome == "differs"
    name, wrong, right, error = fault_of(explain(case))
    assert (name, wrong) == ("coupler", 2.002)
    assert abs(right - 2.0) < 3.0 * error


ROCKER = 2.5008
"""Length of the rocker that is wrong by less than single tests of the residual see [m]."""


def test_an_error_below_all_other_tests_is_seen_by_its_shape(tmp_path: Path) -> None:
    """Each of the four tests passes, and the fit of the rocker does not."""
    case = party(tmp_path, tolerance=f'sigma = {SIGMA}\nfit = ["zero"]', rocker=ROCKER)
    curves = solve_here(case, "dynamics", RIG)
    (before,) = compare(case, "dynamics", RIG, curves)
    assert before.outcome == "agrees"
    found = judge(case)
    assert found.outcome == "differs"
    assert "a residual that rocker explains, with 2." in found.message
    assert fault_of(explain(case))[:2] == ("rocker", ROCKER)


def test_a_curve_with_few_samples_between_the_rows_is_undecided(tmp_path: Path) -> None:
    found = judge(party(tmp_path, times=UNEVEN).with_run("dynamics", n=21))
    assert found.outcome == "undecided"
    assert "give the run more samples" in found.message


@pytest.mark.parametrize(
    ("tolerance", "words"),
    [
        ("sigma = 0.05\nabs = 0.1", "give one of abs (in the channel's unit), relative_to_range"),
        ("sigma = 0.0", "greater than 0"),
        ('sigma = "guessed"', "estimated"),
        ('abs = 0.1\nfit = ["zero"]', "fit goes with sigma"),
        ('sigma = 0.05\nfit = ["offset"]', "zero"),
        ('sigma = 0.05\nfit = ["zero", "zero"]', "fit has a name twice"),
    ],
)
def test_wrong_keys_are_bad_input(tolerance: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="tolerance") as error:
        write_case(tmp_path, angle(EVEN), tolerance)
    assert words in str(error.value)


def test_curves_without_noise_have_no_sigma(tmp_path: Path) -> None:
    file = party(tmp_path).file
    text = file.read_text(encoding="utf-8").replace(
        '["recorded:rig"]', '["mujoco", "recorded:rig"]'
    )
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="no curve has noise; give abs or relative_to_range"):
        validate_case(load_case(file))


def test_noise_as_large_as_the_motion_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a curve that does not move would pass"):
        judge(party(tmp_path, tolerance="sigma = 20.0"))


def test_the_command_tells_the_noise(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["check", str(party(tmp_path, coupler=2.002).file), "--json"])
    assert done.exit_code == 1
    answer = json.loads(done.stdout[done.stdout.index("{") :])
    noise = answer["comparisons"][0]["noise"]
    assert (noise["sigma"], noise["rows"]) == (SIGMA, ROWS)
    assert noise["tests"]["mean"][0] > noise["tests"]["mean"][1]
