"""Diagnoses of planted faults: the first cause must be the place where a case was changed."""

import json
import re
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import mujoco
import numpy as np
import pytest

from docs.make.diagnosis import FAULTS, case_of, search, solved
from docs.make.pictures import LONGER
from proofmass import load_case, solve
from proofmass.base.strict import Kind
from proofmass.batch.check import Result, check, diagnose_run, share_causes
from proofmass.case.case import Case
from proofmass.evidence.diagnosis import (
    Diagnosis,
    Explanation,
    best_causes,
    confirm_cause,
    describe_failure,
    find_causes,
    shared_causes,
)
from proofmass.formats.sarif import as_sarif
from proofmass.formats.terminal import as_json, failure_lines
from proofmass.reference.case_model import compiled_model
from proofmass.sim.contents import highest_frequency
from proofmass.sim.protocol.failures import Diverged
from proofmass.sim.start import loop_opening
from tests.shipped import shipped

QUICK_CASES = ("fourbar", "slider_crank", "pendulum")
QUICK_FAULTS = [fault for fault in FAULTS if fault.case in QUICK_CASES and fault.solver == "mujoco"]


@pytest.mark.parametrize(
    "fault", QUICK_FAULTS, ids=lambda f: f"{f.case}-{f.kind}-{f.where}-{f.amount:.4g}"
)
def test_the_planted_fault_is_the_first_cause(fault):
    assert search(fault)[0] == 1


@pytest.mark.slow
def test_the_first_cause_is_the_planted_fault_for_90_percent_of_faults():
    assert len(FAULTS) >= 60
    assert len({fault.case for fault in FAULTS}) >= 24
    places = {fault: search(fault)[0] for fault in FAULTS}
    wrong = {fault: place for fault, place in places.items() if place > 1}
    assert len(wrong) <= 0.1 * len(FAULTS), wrong
    assert sum(place > 3 for place in wrong.values()) <= 0.02 * len(FAULTS), wrong


MUJOCO_RUNS = """
[run.sweep]
n = 13
solvers = ["mujoco"]
[run.dynamics]
n = 11
until = 0.5
solvers = ["mujoco"]
"""
"""Runs of the four-bar for a diagnosis in MuJoCo: a sweep with a sample every 30 degrees, and
dynamics with 11 samples in the first half second."""


def copy_edited_case(folder: Path, name: str, *edits: tuple[str, str], runs: str = "") -> Path:
    """Copy a shipped case, edit its model and add runs to its sidecar; return the sidecar."""
    for ending in ("xml", "toml"):
        shutil.copy(shipped(f"{name}.{ending}"), folder)
    model = folder / f"{name}.xml"
    text = model.read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    model.write_text(text, encoding="utf-8")
    sidecar = folder / f"{name}.toml"
    if runs:
        told = sidecar.read_text(encoding="utf-8")
        sidecar.write_text(re.sub(r"(?m)^accuracy\.pymunk.*\n", "", told) + runs, encoding="utf-8")
    return sidecar


def diagnose(sidecar: Path, run: Kind) -> Diagnosis:
    """Diagnose a run in MuJoCo."""
    case = load_case(sidecar)
    return find_causes(case, run, "mujoco", solve(case, run, "mujoco"))


@pytest.fixture(scope="module")
def longer_rocker(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The check of a four-bar whose rocker is 1 % longer in the model, with its diagnoses."""
    folder = tmp_path_factory.mktemp("longer")
    case = copy_edited_case(folder, "fourbar", LONGER, runs=MUJOCO_RUNS)
    return check([case], jobs=1, detectable=False)


SENTENCE = "fourbar.xml, line 33: rocker_end x is 2.525 m; with 2.5 m"


def test_a_longer_rocker_whose_centre_of_mass_stays_is_named(longer_rocker):
    result = longer_rocker
    found = result.diagnoses["fourbar", "sweep", "mujoco"]
    first, second, *_ = found.causes
    assert first.sentence == f"{SENTENCE} all 17 curves agree"
    assert len(first.explains) == len(found.differing)
    assert second.changes["rocker"] == (2.5, pytest.approx(2.525, rel=1e-12))
    assert set(found.differing) - set(second.explains) == {"holding_moment"}
    lines = [line.plain for line in failure_lines(result)]
    k = lines.index(f"✗ cause: {SENTENCE} all 34 curves of 2 runs agree")
    line = (Path(first.fault.file)).read_text().splitlines()[32]
    right = line.replace("2.525", "2.5").strip()
    assert lines[k + 1 : k + 3] == [f"    33 - {line.strip()}", f"    33 + {right}"]
    assert re.fullmatch(
        r".*largest error is 0\.\d+ of what is allowed, .*; known to ± 1e-12 m", lines[k + 3]
    )
    (of_case,) = (each for each in lines if each.startswith("  fourbar: 34 of 34 curves differ"))
    assert of_case.endswith("pin.x by 0.0314 m, 2.4 % of its range, at 0 rad")
    assert sum("rocker_end" in each for each in lines) == 3  # told once, with the line to copy
    data = json.loads(as_json(result))
    (cause,) = data["causes"]
    (fault,) = cause["faults"]
    assert cause["sentence"] == f"{SENTENCE} all 34 curves of 2 runs agree"
    assert (fault["line"], fault["wrong"], fault["right"], fault["unit"]) == (33, 2.525, 2.5, "m")
    assert fault["file"] == str(first.fault.file)
    assert [one["run"] for one in cause["runs"]] == ["sweep", "dynamics"]
    (of_json,) = (d for d in data["diagnoses"] if (d["run"], d["solver"]) == ("sweep", "mujoco"))
    assert of_json["causes"][1]["changes"]["rocker"][1] == pytest.approx(2.525)


@pytest.mark.parametrize(
    ("files", "sidecar", "old", "new", "sentence"),
    [
        pytest.param(
            ("hacksaw.xml", "hacksaw_recorded.toml", "hacksaw_recorded.csv"),
            "hacksaw_recorded",
            'name="crank_end" pos="0.075 0 0"',
            'name="crank_end" pos="0.0755 0 0"',
            "hacksaw.xml, line 20: crank_end x is 0.0755 m; with 0.075 m",
            marks=pytest.mark.slow,
        ),
        (
            ("peaucellier.xml", "peaucellier.toml"),
            "peaucellier",
            'name="P" pos="0.3 0 0"',
            'name="P" pos="0.303 0 0"',
            "peaucellier.xml, line 19: P x is 0.303 m; with 0.3 m",
        ),
    ],
    ids=["recorded", "law"],
)
def test_a_number_of_the_model_is_named_where_the_reference_has_none(
    tmp_path, files, sidecar, old, new, sentence
):
    for name in files:
        shutil.copy(shipped(name), tmp_path)
    model = tmp_path / files[0]
    text = model.read_text()
    assert old in text
    model.write_text(text.replace(old, new))
    case = load_case(tmp_path / f"{sidecar}.toml")
    found = find_causes(case, "sweep", "mujoco", solve(case, "sweep", "mujoco"))
    assert found.causes[0].sentence.startswith(sentence)
    assert len(found.causes[0].explains) == len(found.differing)


@pytest.mark.parametrize(
    ("name", "old", "new", "sentence"),
    [
        ("slider_crank", 'pos="1 0 0" mass="2"', 'pos="1 0 0" mass="2.2"',
         "slider_crank.xml, line 20: mass of coupler is 2.2 kg; with 2 kg"),
        ("balancer_sine", 'stiffness="0.4359"', 'stiffness="0.51"',
         "balancer_sine.xml, line 29: stiffness of joint2 is 0.51 N·m/rad; with 0.4359 N·m/rad"),
        ("fourbar", 'gravity="0 -9.81 0"', 'gravity="0 -9.805 0"',
         "fourbar.xml, line 6: gravity y is -9.805 m/s²; with -9.81 m/s²"),
    ],
)  # fmt: skip
def test_a_wrong_number_is_named_as_one_of_the_model(tmp_path, name, old, new, sentence):
    found = diagnose(copy_edited_case(tmp_path, name, (old, new)), "sweep")
    best = found.causes[0]
    assert best.sentence.startswith(sentence)
    assert best.complete
    assert len(best.mirrors) == 1  # the parameter of the sidecar explains as much


def test_a_time_step_that_is_too_long_is_the_cause(tmp_path):
    sidecar = copy_edited_case(tmp_path, "pendulum", ('timestep="1e-3"', 'timestep="1e-2"'))
    text = sidecar.read_text(encoding="utf-8").replace("until = 10.0", "until = 1.0")
    sidecar.write_text(text.replace("n = 1001", "n = 51"), encoding="utf-8")
    found = diagnose(sidecar, "dynamics")
    best = found.causes[0]
    assert best.kind == "finer"
    assert best.words.startswith("a time step of 5e-3 s, not 0.01 s (error of order 4)")


def test_soft_constraints_are_the_cause_where_no_step_helps(tmp_path):
    """MuJoCo leaves J-dot-v of the changing gear to its spring, whose error is (time constant)^2.

    Half of `solref` leaves a quarter of the error, to 5 %, since the time constant is finite.
    """
    sidecar = copy_edited_case(tmp_path, "changing_gear")
    text = sidecar.read_text(encoding="utf-8")
    strict = text.replace("abs = 5e-4", "abs = 1e-6").replace("abs = 1e-2", "abs = 1e-5")
    sidecar.write_text(strict, encoding="utf-8")
    case = load_case(sidecar)
    curves = solve(case, "dynamics", "mujoco")
    found = find_causes(case, "dynamics", "mujoco", curves, thorough=False)
    best = found.causes[0]
    assert best.words == "softness of the loops: halving solref"
    assert set(best.explains) == set(found.differing) == set(curves.channels) - {"tip.x"}
    assert best.left == pytest.approx(0.25, rel=0.05)
    assert "a time step of 1.25e-4 s, not 2.5e-4 s, leaves the error as it is" in found.remarks
    assert "halving solref" in found.tried


def test_too_few_iterations_are_the_cause():
    """With 30 iterations in place of the number that it chooses, pymunk leaves loops open."""
    case = load_case(shipped("fourbar.toml"))
    case = case.model_copy(update={"settings": {**case.settings, "pymunk": {"iterations": 30}}})
    curves = solve(case, "dynamics", "pymunk")
    best = find_causes(case, "dynamics", "pymunk", curves, thorough=False).causes[0]
    assert best.words == "the solver's iterations: 120 iterations"
    assert best.left < 0.05  # a step half as long leaves 0.29


@pytest.mark.parametrize("speed", [0.1, 10.0])
def test_a_slow_machine_names_the_same_causes(tmp_path, monkeypatch, speed):
    """All clocks run slow or fast; what was tried, what was found and what was said is the same."""
    sidecar = copy_edited_case(tmp_path, "fourbar", LONGER)
    case = load_case(sidecar)
    curves = solve(case, "sweep", "mujoco")
    exact = find_causes(case, "sweep", "mujoco", curves)
    for name in ("time", "monotonic", "perf_counter", "process_time", "thread_time"):
        clock = getattr(time, name)
        monkeypatch.setattr(time, name, lambda clock=clock: speed * clock())
    slow = replace(curves, seconds=speed * curves.seconds)
    found = find_causes(case, "sweep", "mujoco", slow)
    assert replace(found, seconds=exact.seconds) == exact
    assert "each parameter of the reference" in found.tried


def test_a_search_that_reaches_its_limit_says_what_it_left_out(monkeypatch):
    case, curves = solved("fourbar", "sweep", "mujoco")
    wrong = with_parameters(case, rocker=2.4)
    assert not find_causes(wrong, "sweep", "mujoco", curves, thorough=False).untried
    monkeypatch.setattr("proofmass.evidence.diagnosis.fit.MAX_EVALUATIONS", 14)
    found = find_causes(wrong, "sweep", "mujoco", curves, thorough=False)
    # the mode and the signs of ten parameters take eleven of them, a slope one
    assert "each sign of a parameter of the reference" in found.tried
    assert "3 of 10 parameters of the reference" in found.tried
    assert found.untried[0] == "7 of 10 parameters of the reference"
    monkeypatch.setattr("proofmass.evidence.diagnosis.fit.MAX_EVALUATIONS", 0)
    none = find_causes(wrong, "sweep", "mujoco", curves, thorough=False)
    assert not any("parameter" in words for words in none.tried)
    assert not none.causes or "the search reached its limit before" in " ".join(none.lines)


def with_parameters(case: Case, **changed: float) -> Case:
    """The case with other parameters."""
    return case.model_copy(update={"parameters": {**case.parameters, **changed}})


def test_one_wrong_number_is_one_cause_in_all_cases_of_its_model(tmp_path):
    for name in ("fourbar.toml", "fourbar_crossed.toml"):
        text = shipped(name).read_text(encoding="utf-8")
        text = re.sub(r"(?m)^solvers = .*", 'solvers = ["mujoco"]', text)
        (tmp_path / name).write_text(re.sub(r"(?m)^accuracy.pymunk.*\n", "", text))
    model = shipped("fourbar.xml").read_text(encoding="utf-8")
    (tmp_path / "fourbar.xml").write_text(model.replace(*LONGER), encoding="utf-8")
    result = check([tmp_path], jobs=1, detectable=False)
    (cause,) = shared_causes(result.diagnoses.values())
    assert cause.cases == ("fourbar", "fourbar_crossed")
    assert cause.sentence.startswith(f"{SENTENCE} all ")
    assert cause.sentence.endswith(" runs of fourbar and fourbar_crossed agree")
    (found,) = json.loads(as_sarif(result))["runs"][0]["results"]
    assert found["locations"][0]["physicalLocation"]["region"]["startLine"] == 33


def test_a_cause_of_one_run_is_tried_in_the_other_runs_of_its_model(tmp_path, longer_rocker):
    """The other run then has it first; a change of another line is no cause of it."""
    sidecar = copy_edited_case(tmp_path, "fourbar", LONGER, runs=MUJOCO_RUNS)
    case = load_case(sidecar)
    cause = longer_rocker.diagnoses["fourbar", "sweep", "mujoco"].best
    here = replace(cause, faults=tuple(replace(f, file=case.model_path) for f in cause.faults))
    found = confirm_cause(case, "dynamics", "mujoco", here)
    assert found.complete
    assert found.key == here.key
    ((number, change),) = here.edits
    assert (
        confirm_cause(case, "dynamics", "mujoco", replace(here, edits=((number, -change),))) is None
    )
    keys = [("fourbar", run, "mujoco") for run in ("sweep", "dynamics")]
    other = Explanation("parameter", "something else", (), ("a",), 1.0, 17)
    result = Result(
        cases=[case],
        diagnoses={
            keys[0]: Diagnosis(*keys[0], differing=tuple("a" * 17), causes=(here,)),
            keys[1]: Diagnosis(*keys[1], differing=tuple("a" * 17), causes=(other,)),
        },
    )
    with ThreadPoolExecutor(1) as threads:
        share_causes(result, threads)
    assert [one.key for one in result.diagnoses[keys[1]].causes] == [here.key, other.key]
    assert len(shared_causes(result.diagnoses.values())) == 1


def test_the_opening_of_loops_is_that_of_mujoco(tmp_path):
    sidecar = copy_edited_case(tmp_path, "fourbar", LONGER)
    model = mujoco.MjModel.from_xml_path(str(sidecar.with_suffix(".xml")))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    mujoco.mj_forward(model, data)
    ends = [data.site_xpos[k] for k in (model.eq_obj1id[0], model.eq_obj2id[0])]
    gap = np.linalg.norm(ends[0] - ends[1])
    assert gap == pytest.approx(0.025, rel=1e-6)
    assert loop_opening(model, "start") == pytest.approx(gap, rel=1e-12)
    assert loop_opening(compiled_model(case_of("pendulum")), "start") == 0.0


def test_open_loops_are_a_finding_of_their_own(longer_rocker):
    found = longer_rocker.diagnoses["fourbar", "sweep", "mujoco"]
    assert any("are open by 0.025 m in the start pose" in words for words in found.remarks)


PENDULUM_IN_LOOP = Path(__file__).parents[1] / "data" / "pendulum_bias"


@pytest.mark.parametrize("variant", ["default", "game"])
def test_the_setting_that_decides_is_named(variant):
    """Chipmunk's bias moves the bob in each step, so that the pendulum loses its energy.

    Bare pymunk says the same: with `error_bias` 0 its energy stays, with the default it falls.
    """
    case = load_case(PENDULUM_IN_LOOP / "pendulum.toml")
    solver = f"pymunk:{variant}"
    found = find_causes(case, "dynamics", solver, solve(case, "dynamics", solver))
    best = found.best
    assert best.complete
    keys = [fault.name for fault in best.faults]
    assert f"error_bias of {solver}" in keys
    assert keys == [f"error_bias of {solver}"] or variant == "game"
    bias = best.faults[keys.index(f"error_bias of {solver}")]
    assert (bias.wrong, bias.right) == (pytest.approx(0.9**60), 0.0)
    assert bias.note == "as in pymunk"
    assert "each setting in which pymunk differs" in found.tried


@pytest.mark.parametrize(
    ("name", "run", "old", "new", "sentence"),
    [
        ("pendulum", "dynamics", 'gravity="0 -9.81 0"', 'gravity="0 9.81 0"',
         "gravity y is 9.81 m/s²; with -9.81 m/s²"),
        ("slider_crank", "sweep", '<joint name="crank"', '<joint name="crank" axis="0 0 -1"',
         "axis of joint crank z is -1; with 1"),
    ],
)  # fmt: skip
def test_a_sign_in_the_model_is_named(tmp_path, name, run, old, new, sentence):
    found = diagnose(copy_edited_case(tmp_path, name, (old, new)), run)
    told = [found.best.sentence, *found.best.same]
    assert any(f": {sentence}" in words for words in told), told
    assert found.best.complete


def test_agreeing_runs_have_no_diagnosis(tmp_path):
    result = check(
        [copy_edited_case(tmp_path, "fourbar", runs=MUJOCO_RUNS)], jobs=1, detectable=False
    )
    assert not result.diagnoses
    assert "agrees" in {c.outcome for c in result.comparisons}
    case, curves = solved("fourbar", "sweep", "mujoco")
    assert find_causes(case, "sweep", "mujoco", curves).causes == ()


def test_no_cause_is_named_if_none_explains_a_channel():
    case, curves = solved("fourbar", "sweep", "mujoco")
    noise = np.random.default_rng(1).normal(size=curves.x.size)
    spoilt = {**curves.channels, "pin.x": curves.channels["pin.x"] + 1e-3 * noise}
    found = find_causes(case, "sweep", "mujoco", replace(curves, channels=spoilt))
    assert found.differing == ("pin.x",)
    assert found.lines[0].startswith("none of those tried: sign, unit")


def test_a_failed_diagnosis_changes_no_outcome(monkeypatch, tmp_path):
    monkeypatch.setattr(import_module("proofmass.batch.check"), "CAUSES_SECONDS", 1e-3)
    result = check(
        [copy_edited_case(tmp_path, "fourbar", LONGER, runs=MUJOCO_RUNS)], jobs=1, detectable=False
    )
    assert any(c.outcome == "differs" for c in result.comparisons)
    assert (
        "causes were not searched for: no answer in"
        in next(iter(result.diagnoses.values())).lines[0]
    )


def test_causes_are_ranked_by_channels_then_by_the_remaining_error():
    """Exact causes leave only rounding; they are ranked by digits of values, then by change."""

    def cause(words: str, explains: str, left: float, free: int = 1, *change: float) -> Explanation:
        changes = {words: change} if change else {}
        return Explanation("parameter", words, tuple(explains), (), left, 4, free, changes)

    pair = cause("pair", "abcd", 1e-12, 3)
    single = cause("single", "abcd", 1e-3)
    most = cause("most", "abc", 3e-9, 1, 2.0, 2.2)
    twin, further = cause("twin", "abc", 1e-9, 1, 9.81, 10.464), cause("f", "abc", 2e-9, 1, 1, 1.2)
    rough = cause("rough", "abc", 1e-2, 1, 1.0, 2.0)
    none = cause("none", "", 1.0, 0)
    found = best_causes([none, pair, twin, further, rough, single, most])
    assert [c.words for c in found] == ["single", "pair", "most", "rough"]
    assert found[2].same == ("f", "twin")


def write_failing_case(folder: Path) -> Path:
    """The sidecar of a free four-bar with 6 samples and a time step of 1 s, the sample interval."""
    for name in ("fourbar.xml", "fourbar_released.toml"):
        shutil.copy(shipped(name), folder)
    model, sidecar = folder / "fourbar.xml", folder / "fourbar_released.toml"
    model.write_text(re.sub('timestep="[^"]*"', 'timestep="1"', model.read_text()))
    text = re.sub(r"(?m)^n = .*", "n = 6", sidecar.read_text())
    text = re.sub(r"(?m)^solvers = .*", 'solvers = ["mujoco"]', text)
    head, *tolerances = text.split("[[tolerance]]")
    text = "[[tolerance]]".join([head, *(one for one in tolerances if '"pymunk"' not in one)])
    sidecar.write_text(re.sub(r"(?m)^until = .*", "until = 5.0", text))
    return sidecar


def test_a_failed_run_is_described_up_to_its_failure(tmp_path):
    result = check([write_failing_case(tmp_path)], jobs=1, detectable=False)
    key = ("fourbar_released", "dynamics", "mujoco")
    assert {c.outcome for c in result.comparisons if c.solver == "mujoco"} == {"diverged"}
    assert key not in result.curves
    curves = result.failed[key]
    assert curves.x[-1] < 1.0
    assert all(y.size == curves.x.size for y in curves.channels.values())
    found = result.diagnoses[key]
    assert found.failed
    (words,) = (line for line in found.remarks if "time step" in line)
    step = float(re.search(r"with a time step of (\S+) s instead of 1 s it comes", words)[1])
    assert found.remedies == (f"Make the time step {1e3 * step:g} ms; it is 1000 ms.",)
    case = load_case(tmp_path / "fourbar_released.toml")
    for factor, ends in ((1.0, True), (2.0, False)):
        settings = {"mujoco": {**case.settings.get("mujoco", {}), "timestep": factor * step}}
        with nullcontext() if ends else pytest.raises(Diverged):
            solve(case.model_copy(update={"settings": settings}), "dynamics", "mujoco")
    assert any(line.plain.startswith("  failed: ") for line in failure_lines(result))


def test_a_failed_run_without_a_known_reason_has_a_line(tmp_path):
    found = Diagnosis("a", "dynamics", "mujoco", failed=True)
    assert found.lines == ["no reason was found"]
    fault = diagnose_run(
        load_case(write_failing_case(tmp_path)), "dynamics", "mujoco", None, failed=True
    )
    assert fault.fault
    assert fault.failed


def test_the_first_channel_to_differ_and_the_violation_are_described():
    case, whole = solved("fourbar", "dynamics", "mujoco")
    x = whole.x
    off = {**whole.channels, "pin.x": whole.channels["pin.x"] + np.where(x > 2.0, 1e-3, 0.0)}
    off["rocker"] = off["rocker"] + np.where(x > 1.0, 1e-3, 0.0)
    growing = 1e-9 * 10.0 ** (x - x[0])
    found = describe_failure(
        case, "dynamics", "mujoco", replace(whole, channels=off, violations=growing, seconds=9.0)
    )
    first = x[np.argmax(x > 1.0)]
    assert found.lines[0] == f"rocker left the tolerance first, at x = {first:.4g}"
    grown = re.search(r"tenfold, to (\S+) m, from x = (\S+) to (\S+)", found.lines[1])
    assert float(grown[1]) == pytest.approx(growing[-1], rel=1e-2)
    assert float(grown[3]) - float(grown[2]) == pytest.approx(1.0, abs=2 * (x[1] - x[0]))


def test_the_highest_frequency_is_that_of_the_stiffest_spring():
    model = mujoco.MjModel.from_xml_string(MODEL_WITH_SPRING)
    assert highest_frequency(model, "start") == pytest.approx(np.sqrt(400.0 / 0.25), rel=1e-9)
    assert highest_frequency(compiled_model(case_of("fourbar")), "start") == 0.0


MODEL_WITH_SPRING = """<mujoco><compiler angle="radian"/><worldbody>
<body><joint name="a" stiffness="400"/><geom type="sphere" size="0.01" mass="0"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.25 0.25 0.25"/></body></worldbody>
<keyframe><key name="start" qpos="0"/></keyframe></mujoco>"""


def test_a_failed_pytest_item_states_the_cause(pytester):
    sidecar = copy_edited_case(pytester.path, "fourbar", LONGER)
    run = pytester.runpytest_subprocess("-n0", f"{sidecar.name}::mujoco")
    run.assert_outcomes(failed=1)
    run.stdout.fnmatch_lines(
        [
            f"cause: {SENTENCE} all 34 curves of 2 runs agree",
            '    33 + <site*pos="2.5 0 0"/>',
            "*sweep *: differs*",
        ]
    )


def test_fitted_numbers_of_a_cause_are_counted():
    def cause(free: int, *changes: str) -> Explanation:
        return Explanation("", "", (), (), 1.0, 1, free, dict.fromkeys(changes, (1.0, 2.0)))

    counts = [cause(0), cause(1, "a"), cause(2), cause(3, "a", "b")]
    assert [one.fitted for one in counts] == [0, 1, 1, 2]
