"""In which equilibria engines come to rest, and the cases that are written of them."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from proofmass.analytic.rods.assembly import assembly
from proofmass.analytic.rods.assembly_newton import RodProblem
from proofmass.analytic.rods.assembly_search import SearchLimits, find_equilibria
from proofmass.analytic.rods.rod_assembly import RodAssembly
from proofmass.base.errors import InputError
from proofmass.run.sidecar import load_case
from proofmass.run.solve import solve
from proofmass.sim.protocol.failures import Unsupported
from proofmass.studies.equilibria import engine_rests
from proofmass.studies.equilibria.engine_rests import EngineRest, find_engine_rests
from proofmass.studies.equilibria.output import format_numbers, rest_lines
from proofmass.studies.equilibria.rod_input import RodInput
from proofmass.studies.equilibria.written_case import ChainsInCase, write_cases
from proofmass.verdict.compare import compare
from tests.shipped import shipped, shipped_case


@cache
def pair() -> ChainsInCase:
    """The rods of Table 7: four stable equilibria and one that is not, up to R = 5.45² EI/L²."""
    rods = assembly([[-0.3, 0.0], [0.3, 0.0]])
    problem = RodProblem(rods, np.radians([40.0, 60.0]), np.array([5.7, -1.9, 0.0]))
    found = find_equilibria(problem, SearchLimits(inflections=2, alpha=5.45))
    assert found.index.tolist() == [0, 0, 1, 0, 1, 0]
    return ChainsInCase(RodInput(Path("pair.toml"), "A pair", ("left", "pin1"), problem), found)


def words(rests):
    return [one.words for one in rests]


def test_mujoco_stays_in_stable_equilibria_and_leaves_others():
    rests = find_engine_rests(pair(), ["mujoco"])["mujoco"]
    assert words(rests) == ["stays", "stays", "to 1", "stays", "to 4", "stays"]
    assert max(one.distance for one in rests) < 1e-9
    lines = rest_lines(pair().found, {"mujoco": rests})
    assert lines == [
        "mujoco, started from the shape of each: stays in 4 of the 4 stable ones, and leaves 2 of "
        "the 2 unstable ones."
    ]


def test_pymunk_stays_in_the_lowest_equilibrium():
    lowest = replace(pair(), found=pair().found.only(0))
    assert words(find_engine_rests(lowest, ["pymunk"])["pymunk"]) == ["stays"]


def test_a_rest_that_is_not_listed_is_told():
    """The third equilibrium alone: it leads to the first, which is not there."""
    alone = replace(pair(), found=pair().found.only(2))
    (rest,) = find_engine_rests(alone, ["mujoco"])["mujoco"]
    assert rest.words == "another"
    assert rest.distance > 0.1
    (line,) = rest_lines(alone.found, {"mujoco": [rest]})
    assert line.endswith("from no. 1 it goes to a rest that is none of them.")


def test_an_engine_that_refuses_is_told_with_its_reason(monkeypatch):
    def refuse(*_):
        raise Unsupported("rods of rubber")

    monkeypatch.setattr(engine_rests, "solve", refuse)
    rests = find_engine_rests(pair(), ["mujoco"])
    assert words(rests["mujoco"]) == ["not run: rods of rubber"] * 6
    assert rest_lines(pair().found, rests)[1] == "mujoco, no. 1 to 6: not run: rods of rubber"
    assert EngineRest("not run: rods of rubber").is_run is False


def test_recorded_curves_are_no_engine():
    with pytest.raises(InputError, match="does not run models"):
        find_engine_rests(pair(), ["recorded"])


def outcomes(case):
    return {
        c.outcome
        for c in compare(
            case, "equilibrium", "mujoco", solve(case, "equilibrium", "mujoco"), detectable=False
        )
    }


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("xml", 'clamp2" pos="0.3 ', 'clamp2" pos="0.302 '),
        ("xml", 'gear="5.7 ', 'gear="5.75 '),
        ("toml", 'to = "pin1"\nlength = 1.0', 'to = "pin1"\nlength = 1.005'),
        ("toml", "length1 = 1.0", "length1 = 1.005"),
    ],
)
def test_a_wrong_length_in_a_written_case_differs(file, old, new, tmp_path):
    (sidecar,) = write_cases(pair(), [3], tmp_path)
    assert outcomes(load_case(sidecar)) == {"agrees"}
    changed = sidecar.with_suffix(f".{file}")
    text = changed.read_text()
    assert text.count(old) == 1
    changed.write_text(text.replace(old, new))
    assert "differs" in outcomes(load_case(sidecar))


def test_the_guess_of_a_case_chooses_its_equilibrium_and_moves_no_curve(tmp_path):
    (sidecar,) = write_cases(pair(), [3], tmp_path)
    text = sidecar.read_text()
    other = write_cases(pair(), [0], tmp_path)[0].read_text()
    guesses = [line for line in other.splitlines() if line.startswith("guess_")]
    kept = [line for line in text.splitlines() if not line.startswith("guess_")]
    at = kept.index("[parameters]") + 1
    sidecar.write_text("\n".join([*kept[:at], *guesses, *kept[at:]]))
    assert "differs" in outcomes(load_case(sidecar))  # the other equilibrium


def test_names_that_the_model_has_itself_are_replaced():
    assert pair().names == ["left", "rod2"]


def test_the_shipped_case_is_as_it_would_be_written():
    """Its shapes and its tolerances are those of chains without an engine."""
    case = shipped_case(shipped("rod_assembly.toml"))
    found = RodAssembly(**case.parameters).equilibrium()
    own = RodInput(case.file, case.title, tuple(case.rod), found.problem)
    text = ChainsInCase(own, found).text(0, "rod_assembly")
    written = shipped("rod_assembly.toml").read_text()
    for line in text["toml"].splitlines()[2:]:
        assert line in written.splitlines()
    model = shipped("rod_assembly.xml").read_text().splitlines()
    assert [line for line in text["xml"].splitlines() if "site" in line] == [
        line for line in model if "site" in line
    ]


def test_unstable_equilibria_have_no_case(tmp_path):
    with pytest.raises(InputError, match=r"3 is unstable.*stable ones are 1, 2, 4, 6"):
        write_cases(pair(), [2], tmp_path)
    with pytest.raises(InputError, match="no equilibrium 9; there are 1 to 6"):
        write_cases(pair(), [8], tmp_path)


def test_numbers_in_a_row_are_a_range():
    assert format_numbers([2]) == "2"
