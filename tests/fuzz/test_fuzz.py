"""Mutated MJCF, TOML and CSV cause no uncaught exception, no hang and no false agreement.

An input is a small shipped case with one to three mutations, all drawn with one seed, the number of
the input.  `oracle` defines false agreements and harmless changes.  ``python -m tests.fuzz.hunt``
shrinks findings and stores them in `tests/data/fuzz`.  A stored finding with ``"open": true`` is
not repaired yet, and another finding with its signature fails no test.  Once it is repaired, `open`
must be set to false.
"""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from proofmass.batch.check import Result, check
from tests.fuzz import oracle
from tests.fuzz.cases import EDITS, Files, small_files, start_worker, write_files
from tests.fuzz.hunt import (
    FINDINGS_FOLDER,
    input_by_number,
    input_files,
    judge_by_command_line,
    read_finding,
)
from tests.fuzz.judge import Judge, time_limit
from tests.fuzz.mutators import MUTATORS, Mutation, apply_mutations

FAST_INPUTS, BLOCK_SIZE, BLOCK_COUNT = 40, 500, 20
Good = tuple[Path, Files, Result]
STORED_FILES = sorted(FINDINGS_FOLDER.glob("*.json"))
OPEN_SIGNATURES = {
    table["signature"] for _, _, table in map(read_finding, STORED_FILES) if table["open"]
}


@pytest.fixture(scope="module")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Judge]:
    one = Judge(tmp_path_factory.mktemp("fuzz"), causes=False)
    yield one
    one.close()


@pytest.fixture(scope="module")
def thorough(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Judge]:
    """A judge whose checks search for causes of differences too."""
    one = Judge(tmp_path_factory.mktemp("thorough"))
    yield one
    one.close()


@pytest.fixture(scope="module")
def idle_worker(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Start an idle worker of this process, since its start would count towards a run's limit."""
    start_worker(tmp_path_factory.mktemp("start"))


def new_findings(judge: Judge, first: int, last: int) -> list[str]:
    """Findings whose signature is not open, and failures of the oracle, for inputs by number."""
    found = []
    for number in range(first, last):
        name, mutations = input_by_number(number)
        answer = judge.judge(name, input_files(name, mutations))
        wrong = [f for f in answer.findings if f not in OPEN_SIGNATURES]
        wrong += [n for n in answer.notes if n.startswith("oracle failed")]
        found += [f"input {number}, {name}, {mutations}: {w}\n{answer.detail}" for w in wrong]
    return found


@pytest.mark.parametrize("name", EDITS)
def test_a_small_case_agrees_and_the_oracle_covers_it(name, judge):
    answer = judge.judge(name, dict(small_files(name)))
    assert (answer.exit_code, answer.findings, answer.notes) == (0, [], [])


CHANGED_FILES = [  # changes of files, and the finding of the oracle if the outcome stays good
    (
        "fourbar",
        b'name="coupler" pos="1 0 0"',
        b'name="coupler" pos="1.01 0 0"',
        "curve of framepos",
    ),
    ("fourbar", b'gravity="0 -9.81 0"', b'gravity="0 -9.8 0"', "curve of actuatorfrc"),
    (
        "fourbar",
        b'<joint name="rocker"/>',
        b'<joint name="rocker" frictionloss="0.1"/>',
        "dry friction",
    ),
    ("fourbar", b'<joint name="crank"/>', b'<joint name="crank" range="-1 0.3"/>', "joint range"),
    (
        "fourbar",
        b'<frameangacc name="rocker_acceleration"',
        b'<frameangvel name="rocker_acceleration"',
        "curve of frameangvel",
    ),
    (
        "slider_crank",
        b'<jointvel name="slide_rate" joint="slider"',
        b'<jointvel name="slide_rate" joint="crank"',
        "curve of jointvel",
    ),
    ("pendulum", b'gravity="0 -9.81 0"', b'gravity="0 -9.8 0"', "curve of jointpos"),
    ("balancer_sine", b'stiffness="0.4359"', b'stiffness="0.44"', "curve of jointpos"),
    (
        "watt",
        b'name="second_end" pos="2.8 0 0"',
        b'name="second_end" pos="2.801 0 0"',
        "curve of framepos",
    ),
    (
        "hacksaw_recorded",
        b'name="crank_end" pos="0.075 0 0"',
        b'name="crank_end" pos="0.076 0 0"',
        "curve of jointpos",
    ),
    ("rod_cantilever", b'ctrl="10"', b'ctrl="30"', "key ctrl of a rod's model"),
    ("fourbar", b"rocker = 2.5 ", b"rocker = 2.6 ", "parameter rocker"),
    ("fourbar", b"mode = 1 ", b"mode = -1 ", "parameter mode 1 is -1"),
    ("fourbar", b'"pin_x", unit = "m"', b'"pin_x", unit = "rad"', "channel unit"),
    ("fourbar", b"to = 0.6", b"to = 0.7", "x"),
    ("fourbar", b'equals = "coupler_rate"', b'equals = "rocker_rate"', "channel equals"),
]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory, idle_worker: None) -> Callable[[str], Good]:
    """``good(name)``: folder, files and result of a small case without a false agreement."""

    @cache
    def of(name: str) -> Good:
        folder, files = tmp_path_factory.mktemp(name), dict(small_files(name))
        write_files(files, folder)
        result = check([folder / f"{name}.toml"], jobs=1)
        assert oracle.find_false_agreements(folder, name, files, result) == ([], "")
        return folder, files, result

    return of


@pytest.mark.parametrize(("name", "old", "new", "signature"), CHANGED_FILES)
def test_the_oracle_finds_changed_files_behind_a_good_result(name, old, new, signature, good):
    """The good result of the unchanged case is judged with changed files."""
    folder, files, result = good(name)
    changed = {k: v.replace(old, new) for k, v in files.items()}
    assert changed != files
    write_files(changed, folder)
    assert signature in oracle.find_false_agreements(folder, name, files, result)[0]


def test_another_quantity_with_the_same_curve_is_no_false_agreement(judge):
    """The acceleration of a slide along x is that of its x coordinate."""
    files = dict(small_files("slider_crank"))
    files["slider_crank.toml"] = files["slider_crank.toml"].replace(
        b'"slide_acceleration",', b'"slider_ax",'
    )
    answer = judge.judge("slider_crank", files)
    assert (answer.exit_code, answer.findings) == (0, [])


def test_a_servo_on_a_driven_joint_does_not_act(judge):
    """The drive takes its place, so that the moment of the drive stays as it is."""
    files = dict(small_files("slider_crank"))
    files["slider_crank.xml"] = files["slider_crank.xml"].replace(
        b"<actuator>", b'<actuator><position joint="crank" kp="10"/>'
    )
    answer = judge.judge("slider_crank", files)
    assert (answer.exit_code, answer.findings, answer.notes) == (0, [], [])


def test_the_oracle_reads_a_file_that_is_not_strict_xml(judge):
    files = dict(small_files("rod_cantilever"))
    files["rod_cantilever.xml"] = files["rod_cantilever.xml"].replace(b"<key ", b"\xb4<key ")
    answer = judge.judge("rod_cantilever", files)
    assert (answer.exit_code, answer.findings, answer.notes) == (0, [], [])


def test_each_mutator_changes_something_and_is_repeatable():
    for name in EDITS:
        files = dict(small_files(name))
        for ending in {Path(file).suffix for file in files}:
            for mutator in MUTATORS[ending]:
                tried = [
                    apply_mutations(files, [Mutation(ending, mutator, seed)]) for seed in range(10)
                ]
                assert any(t != files for t in tried), (name, mutator)
                assert tried[3] == apply_mutations(files, [Mutation(ending, mutator, 3)])


@pytest.mark.parametrize(
    "file",
    [  # a hang takes as long as its time limits
        pytest.param(file, id=file.stem, marks=[pytest.mark.slow] * file.stem.startswith("hang"))
        for file in STORED_FILES
    ],
)
def test_a_stored_finding_is_repaired(file, judge):
    name, files, table = read_finding(file)
    if table["open"]:
        pytest.xfail(f"not repaired yet: {table['signature']}")
    assert judge.judge(name, files).findings == []


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [("rrad", ("rad", 1e-27)), (" mm", ("m", 1e-3)), ("N  m", ("N m", 1.0)), ("kg", ("kg", 1.0))],
)
def test_the_oracle_knows_units_with_prefixes_and_blanks(unit, wanted):
    assert oracle.in_si(unit) == wanted


def test_a_few_mutated_inputs_have_no_new_finding(judge):
    assert not new_findings(judge, 0, FAST_INPUTS)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(BLOCK_COUNT))
def test_ten_thousand_mutated_inputs_have_no_new_finding(block, thorough):
    assert not new_findings(thorough, block * BLOCK_SIZE, (block + 1) * BLOCK_SIZE)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_mutated_inputs_have_no_new_finding_on_the_command_line(block, tmp_path):
    for number in range(100_000 + 30 * block, 100_000 + 30 * (block + 1)):
        name, mutations = input_by_number(number)
        files = input_files(name, mutations)
        _, stated = time_limit(files, name)
        answer = judge_by_command_line(files, tmp_path / str(number))
        wrong = [
            f for f in answer.findings if f not in OPEN_SIGNATURES and (stated or "hang" not in f)
        ]
        assert not wrong, f"input {number}, {name}, {mutations}: {wrong}\n{answer.detail}"
