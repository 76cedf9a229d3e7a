"""Names of elements of a compiled MJCF, as they are written in sentences."""

from typing import Any

import mujoco
import numpy as np

JOINED_BY_KIND = {
    int(mujoco.mjtEq.mjEQ_JOINT): int(mujoco.mjtObj.mjOBJ_JOINT),
    int(mujoco.mjtEq.mjEQ_TENDON): int(mujoco.mjtObj.mjOBJ_TENDON),
}
"""What equalities join whose kind of element a compiled model does not state."""


def equality_name(model: Any, e: Any) -> str:
    """The name of equality number e; without one, the names of the two elements that it joins.

    If these have no names either, it is the number of the equality in the file, from 1 on.

    Examples
    --------
    >>> sites = ('<site name="tip"/>', '<site name="end"/>')
    >>> bodies = "".join(f"<body><joint/><geom size='1'/>{site}</body>" for site in sites)
    >>> loop = '<equality><connect site1="tip" site2="end"/></equality>'
    >>> text = f"<mujoco><worldbody>{bodies}</worldbody>{loop}</mujoco>"
    >>> equality_name(mujoco.MjModel.from_xml_string(text), 0)
    'tip to end'
    """
    if name := str(model.equality(e).name):
        return name
    ends = model.eq_obj1id[e], model.eq_obj2id[e]
    kind = JOINED_BY_KIND.get(int(model.eq_type[e]), int(model.eq_objtype[e]))
    names = [mujoco.mj_id2name(model, kind, int(i)) for i in ends if i >= 0]
    return " to ".join(names) if all(names) else f"number {e + 1}"


def radian_hint(model: Any, key: str) -> str:
    """A clause on a hinge that a key turns by more than a turn, as if its qpos were in degrees.

    It is empty if there is no such hinge.
    """
    numbers = [k for k in range(model.nkey) if model.key(k).name == key]
    for j in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) if numbers else ():
        value = model.key_qpos[numbers[0], model.jnt_qposadr[j]]
        if abs(value) > 2 * np.pi:
            return (
                f"; the qpos of a key is in rad, also where the compiler's angles are in degrees, "
                f"and that of joint {model.joint(j).name!r} is {value:g}"
            )
    return ""
