"""A fault as an object: where a wrong value is written, what is said of it, and who shares it."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from proofmass.base.lines import (
    LineIndex,
    WrittenValue,
    attribute_value,
    element_starts,
    key_value,
)
from proofmass.case.case import Case
from proofmass.evidence.changed import model_source, numbers_of_case
from proofmass.evidence.diagnosis.explanation import (
    Diagnosis,
    Explanation,
    SharedCause,
    rank_key,
    shared_causes,
)
from proofmass.evidence.diagnosis.fault import (
    Fault,
    count_digits,
    format_values,
    model_fault,
    parameter_fault,
    shortest_within,
    sidecar_fault,
)
from proofmass.run.sidecar import load_case
from tests.shipped import shipped

ROCKER = Fault(
    Path("a/fourbar.xml"),
    33,
    "rocker_end x",
    "m",
    2.525,
    2.5,
    1e-12,
    instead='<site pos="2.5 0 0"/>',
    written='<site pos="2.525 0 0"/>',
)


def make_cause(
    explains: str = "ab",
    breaks: str = "",
    differing: int = 2,
    *,
    kind: str = "parameter",
    faults: tuple[Fault, ...] = (ROCKER,),
    **more: object,
) -> Explanation:
    return Explanation(
        kind, "rocker_end x longer", tuple(explains), tuple(breaks), 3e-14, differing, 1,
        faults=faults, **more,
    )  # fmt: skip


def make_diagnosis(*causes: Explanation, case: str = "fourbar", **more: object) -> Diagnosis:
    fields = {"run": "sweep", "solver": "mujoco", "differing": ("a", "b"), **more}
    return Diagnosis(case, causes=causes, **fields)


@pytest.mark.parametrize(
    ("wrong", "right", "unit", "texts"),
    [
        (2.525, 2.5, "m", ("2.525 m", "2.5 m")),
        (1.0, -1.0, "", ("1", "-1")),
        (1.0, -1.0, "1", ("1", "-1")),
        (0.07500001, 0.075, "m", ("0.07500001 m", "0.075 m")),
        (1.23456789, 2.0, "N m", ("1.23457 N·m", "2 N·m")),
        ("pin_x", "pin_y", "", ("pin_x", "pin_y")),
        (1 / 3, 1 / 3, "", ("0.3333333333333333", "0.3333333333333333")),
    ],
)
def test_two_values_have_the_digits_that_tell_them_apart(wrong, right, unit, texts):
    assert format_values(wrong, right, unit)[:2] == pytest.approx(texts) or (
        format_values(wrong, right, unit)[0].startswith(texts[0])
    )


def test_a_sentence_has_place_wrong_value_and_right_value_in_this_order():
    assert ROCKER.place == "fourbar.xml, line 33"
    assert replace(ROCKER, line=None).place == "fourbar.xml"
    assert ROCKER.change == "rocker_end x 2.525 m → 2.5 m"
    assert ROCKER.sentence("all agree") == (
        "fourbar.xml, line 33: rocker_end x is 2.525 m; with 2.5 m all agree"
    )
    noted = replace(ROCKER, note="as in b")
    assert noted.sentence("it agrees").endswith("; with 2.5 m (as in b) it agrees")
    assert noted.change == "rocker_end x 2.525 m → 2.5 m (as in b)"
    assert ROCKER.remedy == (
        'In fourbar.xml, line 33, change rocker_end x from 2.525 m to 2.5 m: <site pos="2.5 0 0"/>'
    )
    assert replace(ROCKER, instead="").remedy.endswith(" from 2.525 m to 2.5 m")
    assert ROCKER.key == (
        str(Path("a/fourbar.xml").absolute()), 33, "rocker_end x", "2.525 m", "2.5 m",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("value", "within", "found"),
    [
        (2.5000000003, 1e-9, 2.5),
        (2.5000000003, 1e-11, 2.5000000003),
        (-0.7499996, 1e-6, -0.75),
        (1234.4, 0.5, 1234.0),
        (0.26, 0.05, 0.3),
        (0.0, 0.0, 0.0),
        (1 / 3, 0.0, 1 / 3),
    ],
)
def test_a_fitted_value_is_written_in_the_digits_that_are_known(value, within, found):
    assert shortest_within(value, within) == found


def test_significant_digits_are_counted():
    values = [2.0, 2.5, 2.525, -9.81, 100.0, 0.075, 1.380800001, 0.0]
    assert [count_digits(v) for v in values] == [1, 2, 4, 3, 1, 2, 5, 1]


def test_the_line_of_a_parameter_is_that_of_the_sidecar():
    case = load_case(shipped("fourbar.toml"))
    fault = parameter_fault(case, "rocker", "m", 2.5, 2.525000000001, 1e-9)
    lines = case.file.read_text(encoding="utf-8").splitlines()
    assert lines[fault.line - 1].startswith("rocker = 2.5 ")
    assert fault.right == 2.525
    assert fault.within == 1e-9
    assert fault.instead == lines[fault.line - 1].replace("2.5 ", "2.525 ", 1).strip()
    mode = sidecar_fault(case, ["parameters", "mode"], "mode", 1.0, -1.0)
    assert mode.instead.startswith("mode = -1 ")
    assert mode.within == 0.0  # it is no fitted number
    crank = parameter_fault(case, "crank", "m", 1.0, 3.0)
    assert crank.instead.startswith("crank = 3.0 ")
    missing = sidecar_fault(case, ["settings", "mujoco", "timestep"], "timestep", 1.0, 2.0)
    assert (missing.line, missing.instead) == (None, "")


@pytest.mark.parametrize(
    ("text", "right", "within", "wrong_and_right", "instead"),
    [
        ("2525 mm", 2.5000000001, 1e-9, (2525.0, 2500.0), 'rocker = "2500 mm" # longest'),
        ("252.5cm", 2.4375, 1e-9, (252.5, 243.75), 'rocker = "243.75 cm" # longest'),
    ],
)
def test_a_parameter_with_a_unit_is_corrected_in_that_unit(
    text, right, within, wrong_and_right, instead, models, edit
):
    file = edit("fourbar.toml", r"(?m)^rocker = 2.*", f'rocker = "{text}" # longest')
    case = load_case(file)
    fault = parameter_fault(case, "rocker", "m", case.parameters["rocker"], right, within)
    lines = file.read_text(encoding="utf-8").splitlines()
    assert lines[fault.line - 1] == f'rocker = "{text}" # longest'
    assert (fault.wrong, fault.right) == wrong_and_right
    assert fault.unit == text.lstrip("0123456789. ")
    assert fault.instead == instead


MODEL = """<mujoco>
  <!-- <body name="no"/> -->
  <compiler angle="degree"/>
  <default><joint damping="0.5"/></default>
  <option gravity="0 -9.81 0"/>
  <worldbody>
    <body name="arm" pos="0 0 0.1">
      <joint name="hinge" axis="0 0 1" range="-10 30"
             ref="5" stiffness="2"/>
      <geom size="0.1"/>
      <site name="tip" pos="1 2 3"/>
      <body name="hand" pos="1 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
        <inertial pos="0.1 0 0" mass="3" diaginertia="1 1 1"/></body>
    </body>
  </worldbody>
  <sensor><framepos name="tip" objtype="site" objname="tip"/></sensor>
  <keyframe><key name="start" qpos="0.1 0.2"/></keyframe>
</mujoco>
"""
SIDECAR = """title = "arm"
source = "a test"
reference = "spatial"
model = "arm.xml"
[run.dynamics]
n = 11
until = 1.0
solvers = ["mujoco"]
[channels]
"tip.x" = { equals = "tip.x", unit = "m" }
[[tolerance]]
abs = 1e-6
why = "a test"
"""


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    (tmp_path / "arm.xml").write_text(MODEL)
    (tmp_path / "arm.toml").write_text(SIDECAR)
    return load_case(tmp_path / "arm.toml")


@pytest.mark.parametrize(
    ("name", "right", "line", "wrong", "shown", "unit", "instead"),
    [
        ("gravity of y", 9.81, 5, -9.81, "gravity y", "m/s^2", '<option gravity="0 9.81 0"/>'),
        ("zero of hinge", 0.17453292519943295, 9, 5.0, "zero of hinge", "deg",
         'ref="10" stiffness="2"/>'),
        ("range of hinge high", 0.6981317007977318, 8, 30.0, "range of hinge high", "deg",
         '<joint name="hinge" axis="0 0 1" range="-10 40"'),
        ("stiffness of hinge", 2.5, 9, 2.0, "stiffness of hinge", "N m/rad",
         'ref="5" stiffness="2.5"/>'),
        ("site of tip y", 4.0, 11, 2.0, "tip y", "m", '<site name="tip" pos="1 4 3"/>'),
        ("place of hand x", 1.5, 12, 1.0, "place of hand x", "m",
         '<body name="hand" pos="1.5 0 0"><joint name="slide" type="slide" axis="1 0 0"/>'),
        ("mass of hand", 4.0, 13, 3.0, "mass of hand", "kg",
         '<inertial pos="0.1 0 0" mass="4" diaginertia="1 1 1"/></body>'),
        ("damping of slide", 0.25, 12, 0.5, "damping of slide", "N s/m", ""),
        ("mass of arm", 1.0, 7, None, "mass of arm", "kg", ""),
        ("start value of slide", 0.25, 17, 0.2, "start value of slide", "m",
         '<keyframe><key name="start" qpos="0.1 0.25"/></keyframe>'),
    ],
)  # fmt: skip
def test_the_line_of_a_number_is_that_of_the_model(
    arm, name, right, line, wrong, shown, unit, instead
):
    numbers = {one.name: one for one in numbers_of_case(arm)}
    fault = model_fault(arm, model_source(arm), numbers[name], right)
    assert (fault.line, fault.name, fault.unit) == (line, shown, unit)
    assert fault.file == arm.model_path
    assert wrong is None or fault.wrong == pytest.approx(wrong, rel=1e-12)
    assert fault.instead == instead
    if instead:  # MuJoCo reads the right value from the line to copy
        lines = MODEL.splitlines()
        lines[line - 1] = instead
        changed = mujoco.MjModel.from_xml_string("\n".join(lines))
        before = mujoco.MjModel.from_xml_string(MODEL)
        assert changed.nv == before.nv == 2


def test_elements_are_numbered_without_comments():
    starts = element_starts(MODEL.encode())
    names = [re.match(r"<(\w+)", MODEL[k:])[1] for k in starts]
    assert names[:5] == ["mujoco", "compiler", "default", "joint", "option"]
    assert element_starts(b"<a><b></a>") == []
    assert len(starts) == MODEL.count("<") - MODEL.count("</") - 2


def test_a_value_that_is_not_written_has_the_line_of_its_element(tmp_path):
    file = tmp_path / "m.xml"
    file.write_text('<a>\n  <b pos="1 2"\n     c="ü  7"/>\n</a>', encoding="utf-8")
    assert attribute_value(file, 1, "c", 1) == WrittenValue(3, '     c="ü  7"/>', "7", 11)
    assert attribute_value(file, 1, "pos", 0) == WrittenValue(2, '  <b pos="1 2"', "1", 10)
    assert attribute_value(file, 1, "pos", 2).literal == ""
    assert attribute_value(file, 1, "d", 0) == WrittenValue(2, '  <b pos="1 2"', "", 2)
    assert attribute_value(file, 2, "pos", 0) is None
    assert WrittenValue(2, "text", "", 2).instead("5") == ""
    file.write_text('\n<a>\n  <b pos="1 2"/>\n</a>', encoding="utf-8")  # begins with an empty line
    assert attribute_value(file, 1, "pos", 1) == WrittenValue(3, '  <b pos="1 2"/>', "2", 12)


@pytest.mark.parametrize(
    ("keys", "line", "literal"),
    [
        (["parameters", "crank"], 2, "1.0"),
        (["parameters", "name"], 3, '"a, b"'),
        (["channels", "pin.x", "equals"], 5, '"pin_x"'),
        (["channels", "pin.x", "unit"], 5, '"m"'),
        (["channels", "pin.x", "scale"], 5, ""),
        (["channels", "pin.y", "scale"], 4, ""),
        (["other"], None, None),
    ],
)
def test_the_value_of_a_key_is_found_in_inline_tables_too(tmp_path, keys, line, literal):
    file = tmp_path / "a.toml"
    file.write_text(
        '[parameters]\ncrank = 1.0 # m\nname = "a, b"\n[channels]\n'
        '"pin.x" = { equals = "pin_x", unit = "m" }\n'
    )
    found = key_value(LineIndex(), file, keys)
    if line is None:
        assert found is None
    else:
        assert (found.line, found.literal) == (line, literal)


@pytest.mark.parametrize(
    ("explains", "breaks", "differing", "effect", "head"),
    [
        ("a", "", 1, "the curve agrees", "cause"),
        ("ab", "", 2, "both curves agree", "cause"),
        ("a", "", 2, "1 of 2 curves agree", "most likely (50 % explained)"),
        ("ab", "c", 2, "both curves agree, but 1 that agreed would differ",
         "most likely (50 % explained)"),
        ("abcdefgh", "", 19, "8 of 19 curves agree", "most likely (42 % explained)"),
    ],
)  # fmt: skip
def test_a_cause_explains_all_curves_and_what_is_likely_does_not(
    explains, breaks, differing, effect, head
):
    cause = make_cause(explains, breaks, differing)
    assert cause.effect == effect
    assert cause.complete == (head == "cause")
    diagnosis = make_diagnosis(cause, differing=tuple("abcdefghijklmnopqrs"[:differing]))
    assert diagnosis.head == head
    (shared,) = shared_causes([diagnosis])
    assert (shared.head, shared.complete) == (head, head == "cause")
    assert diagnosis.lines[0] == shared.sentence == f"{ROCKER.sentence(effect)}"
    assert diagnosis.text.startswith(f"{head}: fourbar.xml, line 33: rocker_end x is 2.525 m; ")
    assert shared.text == f"{head}: {shared.sentence}"


def test_what_makes_an_error_smaller_says_by_how_much():
    cause = make_cause(kind="finer", faults=())
    assert cause.effect == "the error of both curves falls to 3e-14 of it"
    assert cause.sentence == f"rocker_end x longer; with that changed {cause.effect}"
    (shared,) = shared_causes([make_diagnosis(cause)])
    assert shared.further_remedies == ["Make the run finer: rocker_end x longer."]


def test_the_lines_of_a_diagnosis():
    other = make_cause("a", faults=(replace(ROCKER, name="crank"),))
    best = replace(make_cause("a"), same=("x 1 → 2", ROCKER.sentence("it agrees")))
    found = make_diagnosis(best, other, remarks=("a remark",), untried=("pairs",))
    assert found.lines == [
        best.sentence,
        '33 - <site pos="2.525 0 0"/>',
        '33 + <site pos="2.5 0 0"/>',
        "with it 3e-14 of the error is left; known to ± 1e-12 m; not b",
        f"as good: x 1 → 2 and {ROCKER.sentence('it agrees')}",
        f"next best: {other.sentence}",
        "the search reached its limit before pairs",
        "a remark",
    ]
    assert best.mirrors == (ROCKER.sentence("it agrees"),)
    whole = make_diagnosis(make_cause(), other, remarks=("a remark",), untried=("pairs",))
    assert whole.lines[3:] == ["with it 3e-14 of the error is left; known to ± 1e-12 m", "a remark"]
    none = make_diagnosis(make_cause("", "c"), tried=("sign", "unit"), untried=("pairs",))
    assert none.best is None
    assert none.lines == [
        "none of those tried: sign, unit",
        "the search reached its limit before pairs",
    ]
    assert (none.head, none.details) == ("cause", [])
    assert make_diagnosis().found is False
    assert make_diagnosis(failed=True).head == "failed"
    assert make_diagnosis(fault="no time").lines == ["causes were not searched for: no time"]
    assert found.text.splitlines()[1].startswith(" " * 9 + "33 - <site")


def test_runs_and_cases_share_a_cause_by_its_place():
    same = make_diagnosis(make_cause(), case="released", run="dynamics")
    partly = make_diagnosis(make_cause("a"), case="released", solver="pymunk")
    other = make_diagnosis(make_cause(faults=(replace(ROCKER, line=34),)))
    worded = [make_diagnosis(make_cause(faults=()), case=name) for name in ("a", "b", "a")]
    nothing = make_diagnosis()
    found = shared_causes([make_diagnosis(make_cause()), same, other, *worded, nothing])
    assert [len(one.diagnoses) for one in found] == [2, 1, 2, 1]
    first = found[0]
    assert first.cases == ("fourbar", "released")
    assert first.effect == "all 4 curves of 2 runs of fourbar and released agree"
    assert found[2].effect == "all 4 curves of 2 runs agree"
    assert found[1].effect == "both curves agree"
    likely = SharedCause((make_diagnosis(make_cause()), partly))
    assert likely.head == "most likely (75 % explained)"
    assert likely.effect == "3 of 4 curves of 2 runs of fourbar and released agree"
    assert likely.further_remedies == [
        f"First look here; the cause does not explain all curves. {ROCKER.remedy}"
    ]
    broken = SharedCause((make_diagnosis(make_cause("ab", "c")), same))
    assert broken.effect.endswith("agree, but 1 that agreed would differ")
    mirror = ROCKER.sentence("all agree").replace("xml", "toml")
    told = SharedCause((make_diagnosis(replace(make_cause(), same=("b", mirror))),))
    assert told.further_remedies == [f"If that value is right: {mirror}."]
    unwritten = replace(ROCKER, instead="", written="")
    (default,) = shared_causes([make_diagnosis(make_cause(faults=(unwritten,)))])
    assert default.further_remedies == [unwritten.remedy]
    assert not any(line.startswith("33 ") for line in default.details)


def test_several_wrong_values_have_their_lines():
    two = make_cause(faults=(ROCKER, replace(ROCKER, line=35)))
    assert two.fault is None
    assert two.sentence.startswith("fourbar.xml, lines 33 and 35: rocker_end x longer; with that ")
    same = make_cause(faults=(ROCKER, replace(ROCKER, name="y")))
    assert same.sentence.startswith("fourbar.xml, line 33: rocker_end x longer; ")
    apart = make_cause(faults=(ROCKER, replace(ROCKER, file=Path("b.xml"))))
    assert apart.sentence.startswith("rocker_end x longer; ")
    unknown = make_cause(faults=(ROCKER, replace(ROCKER, line=None)))
    assert unknown.sentence.startswith("rocker_end x longer; ")


@pytest.mark.parametrize(("free", "handicap"), [(0, 0.0), (1, 0.01), (2, 0.1), (3, 0.25)])
def test_a_cause_is_ranked_by_what_it_explains_less_its_freedom(free, handicap):
    assert rank_key(replace(make_cause(), free=free)) == (pytest.approx(handicap - 1.0), 3e-14)
    assert rank_key(replace(make_cause("a"), free=free))[0] == pytest.approx(handicap - 0.5)
    assert rank_key(replace(make_cause("", "c"), free=free)) == (0.0, 3e-14)
    assert rank_key(replace(make_cause(""), free=free)) == (0.0, 3e-14)


def test_an_attribute_may_go_over_several_lines(tmp_path):
    file = tmp_path / "a.xml"
    file.write_text("<mujoco>\n<body\n  name=\"a é>\"\n  pos = '1\n 2e-3\t3' />\n</mujoco>")
    found = [attribute_value(file, 1, "pos", part) for part in range(4)]
    assert [(one.line, one.literal) for one in found] == [(4, "1"), (5, "2e-3"), (5, "3"), (4, "")]
    assert found[1].instead("2.5") == "2.5\t3' />"
    assert attribute_value(file, 1, "os", 0).line == 2
    assert attribute_value(file, 1, "name", 1).literal == "é>"
    assert attribute_value(file, 2, "pos", 0) is None
