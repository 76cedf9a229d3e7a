"""Findings of `proofmass.evidence.coverage` agree with runs of models that are changed by other
code.

The functions here change attributes in the file of a model.  The changed models run again, and
their curves are compared as in `proofmass check`.
"""

import json
import math
import random
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copyfile, copytree
from typing import ClassVar
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import Result as ClickResult
from typer.testing import CliRunner

from docs.make.coverage import page, row, rows_of
from proofmass.base.errors import InputError
from proofmass.base.worker import OutOfMemory, TimedOut, call_isolated
from proofmass.batch.check import Result
from proofmass.case.case import Case
from proofmass.commands.cli import app
from proofmass.evidence import changed as changed_module
from proofmass.evidence import coverage as coverage_module
from proofmass.evidence.changed import (
    Baseline,
    Trial,
    change_limit,
    numbers_of_case,
    run_baseline,
    sample_stride,
    with_fewer_samples,
)
from proofmass.evidence.coverage import Coverage, cache_folder, find_coverage, stored_coverage
from proofmass.evidence.coverage_search import (
    FAILED_CHANGE_FACTOR,
    CheckedRun,
    Finding,
    Search,
    group_numbers,
    is_decreased,
    random_changes,
    signs_of_change,
)
from proofmass.formats.explain import (
    format_coverage,
    format_not_noticed,
    name_numbers,
    reason_not_noticed,
)
from proofmass.formats.terminal import failure_lines
from proofmass.reference.case_model import compiled_model
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve
from proofmass.sim.elements import Number, Place
from proofmass.sim.numbers import NUMBER_KINDS
from proofmass.sim.protocol.failures import BadModel
from proofmass.verdict.compare import compare
from proofmass.verdict.outcome import OUTCOME_OF_EXCEPTION, Outcome
from tests.shipped import shipped, shipped_files

QUICK_CASES = ("fourbar", "pendulum", "rod_cantilever")
CANTILEVER = shipped("rod_cantilever.toml")
SAMPLE_SIZE = 12
# A ball that touches a floor leaves it by any gap.  Below this share of the tried change, rounding
# decides which gap a run notices: that of a length ten times as long is 1e-15, and several add up.
ROUNDING_SHARE = 1e-14
FAILURES = (InputError, BadModel, *OUTCOME_OF_EXCEPTION)
JOINT_ATTRIBUTES = {
    "damping": "damping",
    "armature": "armature",
    "friction": "frictionloss",
    "stiffness": "stiffness",
    "rest angle": "springref",
    "zero": "ref",
}
DEFAULT_SOFTNESS = {"solref": [0.02, 1.0], "solimp": [0.9, 0.95, 0.001, 0.5, 2.0]}


def attribute_values(element, name: str, default) -> list[float]:
    """The numbers of an attribute, completed by the defaults."""
    own = [float(x) for x in element.get(name, "").split()]
    return own + list(default)[len(own) :]


def change_attribute(
    element, name: str, default, part: int, by: float, factor: bool = False
) -> None:
    """Add `by` to one number of an attribute, or multiply all of them by 1 + `by`."""
    values = attribute_values(element, name, default)
    if factor:
        values = [value * (1 + by) for value in values]
    else:
        values[part] += by
    element.set(name, " ".join(map(repr, values)))


def with_changed_file(case: Case, one: Finding, change: float, folder: Path) -> Case:
    """The case with one number changed in the file of its model, or in a rod of the sidecar.

    Directions of the model must be in radians, and its elements must have names.
    """
    folder.mkdir(parents=True)
    tree = ElementTree.parse(case.model_path)
    root, words = tree.getroot(), one.of.split(" ")
    axis = "xyz".find(words[-1]) if words[-1] in ("x", "y", "z") else 0
    named = words[-2] if words[-1] in ("x", "y", "z") and len(words) > 1 else words[-1]
    rods = dict(case.rod)

    def element(tag: str, name: str = named):
        return root.find(f".//{tag}[@name='{name}']")

    key = root.find(f".//key[@name='{case.start}']")
    zero = (0.0, 0.0, 0.0)
    match one.kind:
        case "load of a rod" | "natural curvature of a rod":
            rod, name = words[0], one.kind.split()[-4]
            parts = list(getattr(rods[rod], name))
            parts[axis] += change
            rods[rod] = rods[rod].model_copy(update={name: tuple(parts)})
        case kind if kind == "length" or kind.endswith(" of a rod"):
            name = kind.split()[0]
            value = getattr(rods[one.of], name) + change
            rods[one.of] = rods[one.of].model_copy(update={name: value})
        case "place":
            change_attribute(element("body"), "pos", zero, axis, change)
        case "anchor":
            change_attribute(element("joint"), "pos", zero, axis, change)
        case "site":
            change_attribute(element("site"), "pos", zero, axis, change)
        case "direction" if words[0] in ("body", "site"):
            x, y, *_ = map(float, element(words[0]).attrib.pop("xyaxes", "1 0").split())
            change_attribute(element(words[0]), "euler", zero, 2, float(np.arctan2(y, x)) + change)
        case "mass" | "centre of mass" | "inertia":
            body = element("body")
            inertial = body.find("inertial")
            if inertial is None:  # the body of a pin, which has no mass
                none = {"pos": "0 0 0", "mass": "0", "diaginertia": "0 0 0"}
                inertial = ElementTree.SubElement(body, "inertial", none)
            name = {"mass": "mass", "inertia": "diaginertia"}.get(one.kind, "pos")
            usual = zero if name == "pos" else ()
            change_attribute(inertial, name, usual, axis, change, factor=one.kind == "inertia")
        case "gravity":
            change_attribute(root.find("option"), "gravity", (0.0, 0.0, -9.81), axis, change)
        case "gear":
            part = int(words[-1]) - 1 if len(words) > 1 else 0
            change_attribute(
                element("motor", words[0]), "gear", (1.0, *zero, *zero[:2]), part, change
            )
        case "load":
            names = [motor.get("name") for motor in root.find("actuator")]
            change_attribute(key, "ctrl", [0.0] * len(names), names.index(one.of), change)
        case "start value" | "start rate":
            joints = [joint.get("name") for joint in root.find("worldbody").iter("joint")]
            name = {"start value": "qpos"}.get(one.kind, "qvel")
            change_attribute(key, name, [0.0] * len(joints), joints.index(one.of), change)
        case "softness of the loop":
            loop, name, part = one.of.replace(",", "").split(" ")
            usual = root.find("default/equality")
            own = (
                attribute_values(usual, name, DEFAULT_SOFTNESS[name])
                if usual is not None
                else DEFAULT_SOFTNESS[name]
            )
            change_attribute(element("connect", loop), name, own, int(part) - 1, change)
        case kind:
            joint = element("joint")
            turns = kind in ("zero", "rest angle") and joint.get("type", "hinge") == "hinge"
            if turns and root.find("compiler[@angle='radian']") is None:
                change = math.degrees(change)
            change_attribute(joint, JOINT_ATTRIBUTES[kind], [0.0], 0, change)
    tree.write(folder / case.model)
    for file in case.model_path.parent.glob("*.csv"):  # recorded curves and profiles
        copyfile(file, folder / file.name)
    runs = dict(case.run)
    if "equilibrium" in runs:  # samples keep their positions along the rod
        length = min(rod.length for rod in case.rod.values())
        whole = runs["equilibrium"].until or length
        runs["equilibrium"] = runs["equilibrium"].model_copy(update={"until": whole})
    return case.model_copy(update={"file": folder / case.file.name, "rod": rods, "run": runs})


def outcomes_of(changed: Case, own: Case, kind, solver: str) -> set[str]:
    """Outcomes of channels with a tolerance in a run of the changed case, or "failed"."""
    try:
        curves = solve(changed, kind, solver)
        # a closed form of rods reads its own parameters: it is evaluated at the unchanged places
        found = compare(own if changed.rod else changed, kind, solver, curves, detectable=False)
    except FAILURES:
        return {"failed"}
    return {c.outcome for c in found if c.allowed > 0 and c.outcome != Outcome.UNSUPPORTED}


def noticing_runs(case: Case, one: Finding, change: float, folder: Path) -> list[tuple[str, str]]:
    """The runs and solvers in which a changed number makes a channel differ or the run fail."""
    changed = with_changed_file(case, one, change, folder)
    return [
        (kind, solver)
        for kind, run in case.run.items()
        for solver in run.solvers
        if any(case.tolerance_for(kind, solver, name) for name in case.channels_of(kind))
        and outcomes_of(changed, case, kind, solver) & {"differs", "failed"}
    ]


def check_finding(case: Case, one: Finding, folder: Path) -> None:
    """Assert that a finding agrees with runs of changed models.

    If the change that was tried is not noticed, no channel differs and no run fails.  If it is
    refused, the run of the finding fails with it, and none of its channels differs with the next
    smaller change of the search.  Otherwise the run of the finding notices twice the
    smallest noticed change, and no run notices half of it unless that is rounding.
    """
    if not one.noticed:
        for side in (1, -1) if one.value else (1,):
            place = folder / f"tried {side}"
            assert not noticing_runs(case, one, side * one.tried, place), (one.name, "is noticed")
    elif one.refused:
        changed = with_changed_file(case, one, one.change, folder / "refused")
        assert outcomes_of(changed, case, one.run, one.solver) == {"failed"}, (
            one.name,
            "is not refused",
        )
        changed = with_changed_file(
            case, one, FAILED_CHANGE_FACTOR * one.change, folder / "smaller"
        )
        assert "differs" not in outcomes_of(changed, case, one.run, one.solver), (
            one.name,
            "is noticed by a channel",
        )
    else:
        found = noticing_runs(case, one, 2 * one.change, folder / "twice")
        assert (one.run, one.solver) in found, (one.name, "is not noticed at twice the change")
        if abs(one.change) > ROUNDING_SHARE * one.tried:
            found = noticing_runs(case, one, 0.5 * one.change, folder / "half")
            assert not found, (one.name, "is noticed at half the change")


def quick_case(name: str) -> Case:
    """A case with shortened runs.

    The four-bar has a sweep of half a turn with 13 samples in MuJoCo only, the pendulum the first
    half second; other cases are not shortened.
    """
    case = load_case(shipped(f"{name}.toml"))
    if name == "pendulum":
        dynamics = case.run["dynamics"].model_copy(update={"until": 0.5, "n": 51})
        return case.model_copy(update={"run": {"dynamics": dynamics}})
    if name != "fourbar":
        return case
    sweep = case.run["sweep"].model_copy(update={"solvers": ("mujoco",), "n": 13})
    half = case.drive[0].model_copy(update={"to": 3.0})
    return case.model_copy(update={"run": {"sweep": sweep}, "drive": (half,)})


def short_fourbar() -> Case:
    """The four-bar with a sweep in both engines; dynamics in MuJoCo for a twentieth of a turn."""
    case = load_case(shipped("fourbar.toml"))
    sweep = case.run["sweep"].model_copy(update={"n": 49})
    few = {"solvers": ("mujoco",), "until": 0.3, "n": 13}
    dynamics = case.run["dynamics"].model_copy(update=few)
    return case.model_copy(update={"run": {"sweep": sweep, "dynamics": dynamics}})


@pytest.fixture(scope="module")
def findings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which findings of some cases are stored."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def explained(findings: Path) -> ClickResult:
    """The result of `proofmass explain` for the cantilever, whose findings it has to search for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PROOFMASS_CACHE", str(findings))
        return CliRunner().invoke(app, ["explain", str(CANTILEVER), "--jobs", "1"])


@pytest.fixture(scope="module")
def covered(findings: Path, explained: ClickResult) -> dict[str, Coverage]:
    """The coverages of the quick cases, which are searched for once."""
    return {name: find_coverage(quick_case(name), folder=findings) for name in QUICK_CASES}


def sample_findings() -> list[tuple[str, int]]:
    """Cases, and random places in their lists of findings in thousandths, the same in each run."""
    chosen = random.Random(18)
    return [(QUICK_CASES[k % len(QUICK_CASES)], chosen.randrange(1000)) for k in range(SAMPLE_SIZE)]


@pytest.mark.parametrize(("name", "share"), sample_findings())
def test_a_finding_agrees_with_runs_of_a_changed_model(name, share, covered, tmp_path):
    found = covered[name].numbers
    check_finding(quick_case(name), found[share * len(found) // 1000], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(file.stem for file in shipped_files()))
def test_every_finding_agrees_with_runs_of_a_changed_model(name, tmp_path):
    case = load_case(shipped(f"{name}.toml"))
    found = find_coverage(case, folder=tmp_path / "cache")
    assert not found.differing
    for k, one in enumerate(found.numbers):
        if not (one.kind == "direction" and one.of.startswith("joint")) and is_in_file(case, one):
            check_finding(case, one, tmp_path / str(k))


def is_in_file(case: Case, one: Finding) -> bool:
    """Whether `with_changed_file` can change this number in the file of the model."""
    text = case.model_path.read_text()
    if one.kind == "direction":  # about z, if that is the normal of the plane of motion
        across = compiled_model(case).opt.gravity[2] == 0
        return across and not re.search('xyaxes|euler|freejoint|quat|axis="0 -?1 0"', text)
    # a body without <inertial> has the mass, inertia and centre of mass of its geoms
    if one.kind in ("mass", "inertia", "centre of mass"):
        name = one.of.split(" ")[0]
        body = ElementTree.fromstring(text).find(f".//body[@name='{name}']")
        return body is not None and (body.find("inertial") is not None or not body.findall("geom"))
    return one.kind not in ("range", "softness of the stop") and not one.of[-1:].isdigit()


@pytest.mark.parametrize("kind", [kind for kind in NUMBER_KINDS if "of a rod" in kind])
def test_numbers_of_several_rods_have_a_plural(kind):
    found = [Finding(kind, name, "1", 1.0, 0.1, False) for name in ("a", "b")]
    assert "of the rods" in name_numbers(kind, found)
    assert "a rod" not in name_numbers(kind, found)


def test_the_fourbar_leaves_the_inertia_of_its_steady_crank_unchecked(tmp_path):
    """Its inertia and armature are not noticed; the drive's moment depends on other inertias."""
    found = find_coverage(short_fourbar(), folder=tmp_path)
    unnoticed = {kind: {one.of for one in some} for kind, some in found.unnoticed.items()}
    assert unnoticed["inertia"] == unnoticed["armature"] == {"crank"}
    assert unnoticed.keys() == {"inertia", "armature", "softness of the loop"}
    words = list(format_not_noticed(short_fourbar(), found))
    assert words[0].startswith("inertia of crank: a drive of constant rate has no acceleration")


def test_a_number_that_an_engine_refuses_counts_as_refused(covered, tmp_path):
    numbers = covered["rod_cantilever"].numbers
    (gravity,) = (one for one in numbers if (one.kind, one.of) == ("gravity", "x"))
    assert "gravity acts on it" in gravity.refused
    check_finding(quick_case("rod_cantilever"), gravity, tmp_path)


def test_a_change_below_which_nothing_happens_is_found_between_two_bounds(covered, tmp_path):
    """MuJoCo's solver leaves out dry friction below about 1e-8 N m, its tolerance."""
    (friction,) = (one for one in covered["pendulum"].numbers if one.kind == "friction")
    assert friction.solver == "mujoco"
    assert 1e-9 < friction.change < 1e-7
    check_finding(quick_case("pendulum"), friction, tmp_path)


def test_a_noticed_number_that_is_called_refused_fails_the_check(covered, tmp_path):
    found = covered["fourbar"].numbers
    (mass,) = (one for one in found if one.name == "mass of crank")
    with pytest.raises(AssertionError, match="is not refused"):
        check_finding(quick_case("fourbar"), replace(mass, refused="fails"), tmp_path)


def test_noticed_changes_of_the_model_and_of_the_reference_agree(covered):
    """The smallest noticed changes of a changed model and of a changed reference agree.

    A change of the model is found by the errors of the unchanged and of the changed run, each of
    which uses up a share of the tolerance by rounding; a change of the reference without them.
    """
    found = covered["fourbar"]
    (run,) = found.runs
    used = run.error / run.allowed
    assert 0 < used < 0.01
    model = {one.name: abs(one.change) for one in found.numbers}
    reference = {one.of: one.change for one in found.parameters}
    for here, there in (
        ("site of rocker_end x", "rocker"),
        ("place of rocker x", "ground"),
        ("site of coupler_end x", "coupler"),
        ("place of coupler x", "crank"),
        ("site of point x", "point_along"),
        ("gravity of y", "gravity"),
    ):
        # rates are constant within changes of 1e-11 of a number
        assert model[here] == pytest.approx(reference[there], rel=2 * used, abs=0)


@pytest.mark.parametrize("name", ["inertia of crank", "mass of crank", "friction of crank"])
def test_a_finding_with_the_opposite_result_fails_the_check(name, covered, tmp_path):
    case = quick_case("fourbar")
    (one,) = (one for one in covered["fourbar"].numbers if one.name == name)
    change = one.change if one.noticed else one.tried
    wrong = replace(one, noticed=not one.noticed, change=change, run="sweep", solver="mujoco")
    with pytest.raises(AssertionError, match=name):
        check_finding(case, wrong, tmp_path)


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("fourbar", {"armature", "damping", "direction", "inertia", "zero"}),
        ("pendulum", {"inertia", "place"}),
    ],
)
def test_an_unnoticed_number_moves_channels_by_the_stated_share(name, kinds, covered, tmp_path):
    """The stated share is that of the curves of a model changed by hand and the unchanged model."""
    case = quick_case(name)
    silent = [one for one in covered[name].numbers if not one.noticed and is_in_file(case, one)]
    first = {one.kind: one for one in reversed(silent)}
    assert set(first) == kinds
    for k, one in enumerate(first.values()):
        moved: dict[tuple[str, str, str], float] = {}
        for side in (1, -1) if is_decreased(one.kind, one.value, one.tried) else (1,):
            changed = with_changed_file(case, one, side * one.tried, tmp_path / f"{k}{side}")
            for kind, run in case.run.items():
                for solver in run.solvers:
                    before, after = solve(case, kind, solver), solve(changed, kind, solver)
                    for c in compare(case, kind, solver, before, detectable=False):
                        if c.outcome == Outcome.AGREES:
                            there = after.channels[c.channel] - before.channels[c.channel]
                            by = np.abs(there).max() / case.channels[c.channel].factor / c.allowed
                            name = kind, solver, c.channel
                            moved[name] = max(by, moved.get(name, 0.0))
        most = max(moved, key=moved.__getitem__)
        assert one.moved == pytest.approx(moved[most], rel=1e-3, abs=1e-9), one.name
        if one.moved > 1e-9:
            assert (one.run, one.solver, one.channel) == most


def test_a_number_hidden_by_its_group_is_noticed_alone():
    """A group can hide the effect of one number if other numbers move the same error."""
    mass, other = make_number("mass", "a", 1.0), make_number("mass", "b", 1.0)

    class Asked(Search):
        def __init__(self):
            self.pool = ThreadPoolExecutor(1)

        def runs(self):
            return [Baseline(kind, "mujoco", {}, {}, {}, []) for kind in ("sweep", "dynamics")]

        def trial(self, run, changes, whole=False):
            assert whole
            ((one, change),) = changes
            if one is mass and run.kind == "dynamics" and change < 0:
                return Trial(3.0, moved=2.5)
            return Trial(0.5, moved=0.2 if change > 0 else 0.3, moves=f"{run.kind} {change}")

        def try_alone(self, run, one, whole):
            assert (run.kind, one, whole) == ("dynamics", mass, True)
            return Finding("mass", "a", "1", 1.0, 0.1, True, 0.04, "dynamics", "mujoco", "x")

    found = {one: Finding("mass", one.of, "1", 1.0, 0.1, False) for one in (mass, other)}
    for run in Asked().runs():
        found = Asked().alone(run, found)
    assert found[mass].noticed
    assert not found[other].noticed
    assert (found[other].moved, found[other].channel) == (0.3, "sweep -0.1")


def test_the_effect_of_an_unnoticed_number_is_described():
    small = Finding(
        "friction", "a", "N m", 2.0, 0.2, False, math.nan, "sweep", "pymunk", "x", "", 0.03
    )
    case = quick_case("fourbar")
    found = Coverage("fourbar", "", (), (), (small,))
    assert reason_not_noticed(case, found, "friction", [small]) == (
        "it does little: 10 % more or less of it moves no checked channel by more than 0.03 of "
        "its tolerance (x, sweep, pymunk)"
    )
    none = replace(small, value=0.0, moved=0.0)
    assert reason_not_noticed(case, found, "friction", [none]) == (
        "no checked channel depends on it: 0.2 N·m more moves none by a millionth of its tolerance"
    )
    assert "0.03" in reason_not_noticed(case, found, "friction", [none, small])
    assert reason_not_noticed(case, found, "friction", [none, replace(small, moved=math.nan)]) == ""


@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_a_change_that_is_wrong_by_a_factor_of_five_fails_the_check(factor, covered, tmp_path):
    case = quick_case("fourbar")
    (one,) = (one for one in covered["fourbar"].numbers if one.name == "mass of crank")
    with pytest.raises(AssertionError, match="mass of crank"):
        check_finding(case, replace(one, change=factor * one.change), tmp_path)


def make_search(name: str, kind, solver: str) -> Search:
    """A search of a case with one run, whose baseline is computed in this process."""
    case = load_case(shipped(f"{name}.toml"))
    case = with_fewer_samples(case, kind, sample_stride(case, kind))
    search = Search(case, ThreadPoolExecutor(1))
    search.before = [run_baseline(case, kind, solver)]
    return search


def test_findings_are_not_stored_if_the_unchanged_run_reaches_a_limit(tmp_path, monkeypatch):
    def full(self, kind, function, *args):
        raise OutOfMemory("needs more than 8 GiB of memory")

    monkeypatch.setattr(Search, "call", full)
    found = find_coverage(load_case(shipped("pendulum.toml")), 1, folder=tmp_path)
    words = "the dynamics of mujoco is out of memory as it is: needs more than 8 GiB of memory"
    assert found.left_out.startswith(words)
    assert not found.numbers
    assert not list(tmp_path.rglob("*.json"))


@pytest.mark.parametrize("again", [True, False])
def test_a_trial_that_times_out_is_repeated_once_with_a_longer_limit(again, monkeypatch):
    asked = []

    def slow(function, *args, timeout, memory):
        asked.append(timeout)
        if len(asked) == 1 or not again:
            raise TimedOut(f"no answer in {timeout:g} s")
        return call_isolated(function, *args, timeout=timeout, memory=memory)

    search = make_search("pendulum", "dynamics", "mujoco")
    monkeypatch.setattr("proofmass.evidence.coverage_search.call_isolated", slow)
    trial = search.trial(search.runs()[0], [])
    limit = search.case.run["dynamics"].timeout
    assert asked == [limit, 4 * limit]
    assert trial.failed == ("" if again else f"no answer in {4 * limit:g} s")


def test_constant_channels_notice_changes_if_the_reference_reads_the_model():
    """If the reference reads the model, only channels that must equal a number notice a change."""
    search = make_search("peaucellier", "sweep", "mujoco")
    there = {number.name: number for number in numbers_of_case(search.case)}
    (tip,) = search.tried([there["site of tip x"]])
    assert tip.noticed
    assert tip.channel.startswith("tip")
    (mass,) = search.tried([there["mass of crank"]])
    assert not mass.noticed


def test_check_says_that_a_reference_reads_the_model():
    cases = [load_case(shipped(f"{name}.toml")) for name in ("fourbar_released", "fourbar")]
    result = Result(cases=cases)
    (line,) = [text.plain for text in failure_lines(result) if "reads the numbers" in text.plain]
    assert line == (
        "· fourbar_released: the reference planar reads the numbers of fourbar.xml: a wrong one is "
        "wrong in the engines and in the reference"
    )


def test_the_first_tolerance_that_is_used_up_limits_the_change():
    error, rate = np.array([0.5, 0.0, -0.9]), np.array([0.1, 0.0, 0.1])
    assert change_limit(error, 1.0, rate, "y").factor == pytest.approx(5.0)
    assert change_limit(error, 1.0, -rate, "y").factor == pytest.approx(1.0)
    assert change_limit(error, 1.0, 0 * rate, "y").factor == math.inf


def make_number(kind: str, of: str, value: float = 0.0) -> Number:
    return Number(kind, of, value, "1", 0.1, Place("joint", 0, kind))


@pytest.mark.parametrize(("factor", "kept"), [(0.4, False), (1e6, True)])
def test_a_finding_is_replaced_only_by_one_with_a_smaller_change(factor, kept):
    """The search in another run may end with a larger change, which does not replace the first."""
    mass = make_number("mass", "a", 1.0)
    first = Finding("mass", "a", "kg", 1.0, 0.1, True, 1e-9, "sweep", "pymunk")
    other = replace(first, change=factor * first.change, run="dynamics")

    class Asked(Search):
        strides: ClassVar = {"sweep": 1, "dynamics": 1}

        def __init__(self):
            pass

        def runs(self):
            return [Baseline("dynamics", "mujoco", {}, {}, {}, [])]

        def noticed_at_half(self, run, group, found, alike):
            return [] if alike else list(group)

        def find_smallest(self, *args, **kwargs):
            return other

    assert Asked().try_half_changes({mass: first}) == {mass: first if kept else other}


def test_random_changes_have_both_signs_and_at_least_the_trial_size():
    group = [make_number("mass", name, 1.0) for name in "abcdef"] + [make_number("damping", "g")]
    there = [[change for _, change in changes] for changes in random_changes(group)]
    for own in zip(*there, strict=True):
        assert min(map(abs, own)) >= 0.1
        assert len({abs(change) for change in own}) == len(own)
    assert len(there) == 2
    assert all({np.sign(changes[k]) for changes in there} == {1, -1} for k in range(6))
    assert all(changes[6] > 0 for changes in there)


def test_numbers_that_are_not_negative_are_not_tried_below_0():
    assert signs_of_change(make_number("damping", "a")) == (1,)
    assert signs_of_change(make_number("damping", "a", 1.0)) == (1, -1)
    assert signs_of_change(make_number("gravity", "x")) == (1, -1)


def test_groups_have_one_kind_and_at_most_six_numbers():
    there = [make_number("mass", str(k)) for k in range(8)] + [make_number("inertia", "a")]
    assert {label: len(some) for label, some in group_numbers(there).items()} == {
        "mass 1": 6,
        "mass 2": 2,
        "inertia 1": 1,
    }


@pytest.mark.parametrize(("name", "whole"), [("balancer_prototype", True), ("fourbar", False)])
def test_a_sweep_that_needs_all_samples_is_searched_with_all_samples(name, whole, monkeypatch):
    """Dry friction needs a sample where the drive reverses, so the sweep is made at all samples."""
    monkeypatch.setattr(changed_module, "compare", partial(compare, detectable=False))  # slow
    search = Search(load_case(shipped(f"{name}.toml")), ThreadPoolExecutor(1))
    search.before = [run_baseline(search.case, "sweep", "mujoco")]
    assert search.strides["sweep"] > 1
    search.use_all_samples()
    assert (search.strides["sweep"] == 1) == whole


def test_a_sweep_is_searched_at_some_of_its_own_samples():
    case = load_case(shipped("fourbar.toml"))
    assert sample_stride(case, "sweep") == 15  # of 360 intervals
    assert sample_stride(case, "dynamics") == 1
    assert sample_stride(load_case(shipped("rod_snap.toml")), "sweep") == 1  # 42 intervals
    assert sample_stride(load_case(shipped("hacksaw_recorded.toml")), "sweep") == 1


def test_findings_are_stored_and_read_again(covered, findings, tmp_path, monkeypatch):
    case, found = load_case(shipped("rod_cantilever.toml")), covered["rod_cantilever"]
    assert stored_coverage(case, tmp_path) is None
    copytree(findings / "coverage", tmp_path / "coverage")
    monkeypatch.setattr(coverage_module, "Search", None)  # a new search would fail
    assert str(find_coverage(case, 1, folder=tmp_path)) == str(found)
    assert str(stored_coverage(case, tmp_path)) == str(found)
    looser = case.tolerance[0].model_copy(update={"abs": None, "relative_to_range": 0.5})
    other = case.model_copy(update={"tolerance": (looser, *case.tolerance[1:])})
    assert stored_coverage(other, tmp_path) is None
    (file,) = tmp_path.rglob("rod_cantilever-*.json")
    for text in ("not json", "{}", '{"groups": 1, "coverage": null, "seconds": 0}'):
        file.write_text(text)
        with pytest.raises(InputError, match="delete it"):
            stored_coverage(case, tmp_path)


def test_an_interrupted_search_continues(tmp_path, monkeypatch):
    case, progress = quick_case("pendulum"), list[tuple[int, int]]()

    def stop(label: str, done: int, total: int) -> None:
        progress.append((done, total))
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find_coverage(case, 1, stop, tmp_path)
    begun = len(progress)
    found = find_coverage(
        case, 1, lambda label, done, total: progress.append((done, total)), tmp_path
    )
    assert progress[begun][0] > 3
    assert progress[-1][0] == progress[-1][1]
    assert {one.kind for one in found.numbers} >= {"gravity", "mass", "friction"}


def test_the_cache_is_where_the_environment_says(monkeypatch, tmp_path):
    monkeypatch.setenv("PROOFMASS_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("PROOFMASS_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "proofmass"


def test_explain_prints_the_findings_as_text_and_as_json(explained, findings, monkeypatch):
    assert explained.exit_code == 0, explained.output
    assert max(map(len, explained.stdout.splitlines())) <= 80
    for words in ("Who checks what", "stiffness of a rod of rod", "Not noticed by any run"):
        assert words in explained.stdout
    monkeypatch.setenv("PROOFMASS_CACHE", str(findings))
    answer = CliRunner().invoke(app, ["explain", str(CANTILEVER), "--json"])
    assert answer.exit_code == 0, answer.output
    table = json.loads(answer.stdout)
    assert table["case"] == "rod_cantilever"
    assert {one["of"] for one in table["numbers"] if one["kind"] == "length"} == {"rod"}


@pytest.mark.parametrize("path", ["missing.toml", "models", "models/linkages/hacksaw_recorded.csv"])
def test_explain_refuses_paths_that_are_no_case(path, tmp_path, monkeypatch):
    monkeypatch.setenv("PROOFMASS_CACHE", str(tmp_path))
    answer = CliRunner().invoke(app, ["explain", path])
    assert answer.exit_code == 2
    assert answer.stderr.startswith("error: ")


def test_explain_refuses_a_damaged_store(tmp_path, monkeypatch):
    monkeypatch.setenv("PROOFMASS_CACHE", str(tmp_path))
    case = load_case(shipped("rod_cantilever.toml"))
    file = coverage_module.coverage_file(case, coverage_module.coverage_key(case), tmp_path)
    file.parent.mkdir(parents=True)
    file.write_text("[]")
    answer = CliRunner().invoke(app, ["explain", str(case.file)])
    assert answer.exit_code == 2
    assert "delete it, and it is made again" in answer.stderr


def test_explanations_fit_in_eighty_columns(covered):
    for name, found in covered.items():
        case = load_case(shipped(f"{name}.toml"))
        lines = [part for part in format_coverage(case, found) if isinstance(part, str)]
        assert max(map(len, lines)) <= 80


def test_no_number_of_a_case_without_checks_is_tried(tmp_path):
    case = load_case(shipped("fourbar.toml")).model_copy(update={"tolerance": ()})
    found = find_coverage(case, 1, folder=tmp_path)
    assert (found.numbers, {one.checked for one in found.runs}) == ((), {0})
    lines = [part for part in format_coverage(case, found) if isinstance(part, str)]
    assert lines[-1] == ("No number of fourbar.xml was tried: no run of the case checks anything.")


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("fourbar", "armature", "nothing of it acts at rest; in dynamics the drives prescribe"),
        ("fourbar", "softness of the loop", "a run at rest closes them to rounding; in dynamics"),
        ("balancer_sine", "mass", "there is no gravity, and all runs that are checked are at rest"),
        ("balancer_sine", "inertia", "all runs that are checked are at rest, where nothing of it"),
        ("peaucellier", "mass", "the reference reads them from the model as well"),
        ("pendulum", "inertia", ""),
    ],
)
def test_the_reason_for_an_unnoticed_kind_depends_on_the_case(name, kind, words):
    case = load_case(shipped(f"{name}.toml"))
    runs = tuple(
        CheckedRun(run, "mujoco", 1, 1, units=units)
        for run, units in (("sweep", ("N m",)), ("dynamics", ("m", "J")[: 1 + (not case.drive)]))
        if run in case.run
    )
    found = Coverage(name, "", runs, (), (), reads_model=name == "peaucellier")
    assert reason_not_noticed(case, found, kind).startswith(words)
    assert bool(reason_not_noticed(case, found, kind)) == bool(words)


def test_a_steady_drive_is_a_reason_for_the_inertia_of_its_crank_only():
    """The reason is not given for the inertia of the rocker, which swings."""
    case = load_case(shipped("fourbar.toml"))
    runs = tuple(CheckedRun(run, "mujoco", 1, 1, units=("N m",)) for run in case.run)
    found = Coverage("fourbar", "", runs, (), ())
    for of, words in (("crank", "a drive of constant rate"), ("rocker", "")):
        some = [Finding("inertia", of, "1", 1.0, 0.1, False)]
        assert bool(words) == bool(why := reason_not_noticed(case, found, "inertia", some))
        assert why.startswith(words)


def test_one_number_and_several_numbers_are_named():
    some = [Finding("mass", name, "kg", 1.0, 0.1, False) for name in "abc"]
    assert name_numbers("mass", some[:1]) == "mass of a"
    assert name_numbers("mass", some) == "masses of a, b and c"
    assert name_numbers("gear", some[:2]) == "gears of a and b"


def test_the_table_of_all_cases_counts_its_rows():
    case = load_case(shipped("balancer_sine.toml"))
    some = [
        Finding(kind, of, "1", 1.0, 0.1, noticed)
        for kind, of, noticed in (
            ("mass", "a", True),
            ("mass", "b", False),
            ("stiffness", "c", False),
            ("place", "d", False),
        )
    ]
    runs = (CheckedRun("sweep", "mujoco", 1, 1, units=("N m",)),)
    line = row(case, Coverage(case.name, "", runs, (), tuple(some)))
    assert line.startswith("| balancer_sine | 4 | 1 | 3 | 1 | 1 | mass of b: there is no gravity")
    assert line.endswith("; stiffness of c: no reason is known |")
    table = page([line, line.replace("balancer_sine", "other")], 3)
    words = " ".join(table.split())
    assert "searched 2 of 3 cases. Their models have 8 numbers. A change of 2 of them" in words
    assert "Of 6 masses" in words
    assert "4 are noticed by no run; `proofmass explain` states a reason for 2 of these" in words
    assert rows_of(table) == {
        "balancer_sine": line,
        "other": line.replace("balancer_sine", "other"),
    }
