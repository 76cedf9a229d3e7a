"""Elements of a model are named in errors, also those without a name."""

import mujoco
import pytest

from proofmass.analytic.names import equality_name, radian_hint

BODY = '<body{}><joint name="{}"/><geom size="1"/><site name="{}"/></body>'
BODIES = BODY.format(' name="a"', "one", "tip") + BODY.format("", "two", "end")
MODEL = f"""<mujoco><worldbody>{BODIES}</worldbody><equality>{{}}</equality>
<keyframe><key name="start" qpos="0 90"/><key name="half" qpos="3.14 -6.28"/></keyframe></mujoco>"""


@pytest.mark.parametrize(
    ("equality", "name"),
    [
        ('<connect name="pin" site1="tip" site2="end"/>', "pin"),
        ('<connect site1="tip" site2="end"/>', "tip to end"),
        ('<joint joint1="two" joint2="one"/>', "two to one"),
        ('<joint joint1="two"/>', "two"),
        ('<connect body1="a" anchor="0 0 0"/>', "a to world"),
    ],
)
def test_an_equality_without_a_name_is_called_by_what_it_joins(equality, name):
    model = mujoco.MjModel.from_xml_string(MODEL.format(equality))
    assert equality_name(model, 0) == name


def test_a_hinge_that_is_turned_by_more_than_a_turn_may_be_in_degrees():
    model = mujoco.MjModel.from_xml_string(MODEL.format(""))
    assert radian_hint(model, "start").endswith("and that of joint 'two' is 90")
    assert radian_hint(model, "half") == ""
    assert radian_hint(model, "missing") == ""
