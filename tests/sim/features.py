"""Small models with one feature each, and their curves in bare MuJoCo, for `test_features.py`."""

from collections.abc import Callable
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

OPEN = """<mujoco model="features"><compiler angle="radian"/>
<option gravity="0 -9.81 0" integrator="RK4" timestep="1e-3"><flag contact="disable"/></option>
<worldbody>
  <body name="arm"><joint name="a"/>
    <inertial pos=".4 .05 0" mass="1" diaginertia=".02 .1 .1"/>
    <geom name="arm" type="capsule" size=".05" fromto="0 0 0 1 0 0" mass="0"/>
    <body name="fore" pos="1 0 0"><joint name="b" stiffness="40" damping=".5" springref=".1"/>
      <inertial pos=".3 0 0" mass=".7" diaginertia=".01 .05 .05"/>
      <geom name="fore" type="capsule" size=".05" fromto="0 0 0 .6 0 0" mass="0"/>
      <site name="tip" pos=".6 0 0"/></body></body>
  <body name="swing" pos="3 0 0"><joint name="c" stiffness="30" damping=".3"/>
    <inertial pos=".1 -.4 0" mass=".8" diaginertia=".01 .06 .06"/>
    <geom name="swing" type="capsule" size=".05" fromto="0 0 0 0 -.8 0" mass="0"/>
    <site name="swing_end" pos="0 -.8 0"/></body>
  <site name="post" pos="2 1 0"/>
</worldbody>
<tendon><spatial name="cable" stiffness="5" damping=".2" springlength=".5">
  <site site="tip"/><site site="swing_end"/></spatial></tendon>
<actuator><motor name="motor" joint="a"/><motor name="load" joint="b"/>
  <position name="servo" joint="c" kp="3" kv=".1"/></actuator>
<sensor><jointpos name="a" joint="a"/><jointpos name="b" joint="b"/><jointpos name="c" joint="c"/>
  <jointactuatorfrc name="hold" joint="a"/></sensor>
<keyframe><key name="start" qpos="0.2 -.1 .3" ctrl="0 .9 .4"/></keyframe></mujoco>"""
"""Two trees, of which a cable couples the ends: joints a and b, and joint c."""

Edit = Callable[[Element], None]


def change(path: str, **attributes: str) -> Edit:
    """Set attributes of the element at a path, or of the element of a name after a colon."""

    def edit(root: Element) -> None:
        tag, _, name = path.partition(":")
        found = root.find(f".//{tag}[@name='{name}']" if name else tag)
        assert found is not None, path
        found.attrib.update(attributes)

    return edit


def add(path: str, text: str) -> Edit:
    """Append an element to the element at a path."""

    def edit(root: Element) -> None:
        place = root if path == "." else root.find(path)
        assert place is not None, path
        place.append(ElementTree.fromstring(text))

    return edit


def replace_actuator(name: str, text: str) -> Edit:
    """Replace an actuator by another one, at its place."""

    def edit(root: Element) -> None:
        place = root.find("actuator")
        assert place is not None
        old = place.find(f"*[@name='{name}']")
        assert old is not None
        index = list(place).index(old)
        place.remove(old)
        place.insert(index, ElementTree.fromstring(text))

    return edit


def key(**attributes: str) -> Edit:
    """Set attributes of the key."""
    return change("keyframe/key", **attributes)


def close_loop(root: Element) -> None:
    """Make the open model a four-bar that joint a determines."""
    for name, place in (("tip", "2 0 0"), ("swing_end", "2.5 0 0")):
        change(f"site:{name}", pos=place)(root)
    add(
        ".",
        '<equality><connect name="pin" site1="tip" site2="swing_end" solref=".004 1" '
        'solimp=".9999 .9999 .001"/></equality>',
    )(root)
    change("joint:b", springref="1.1", stiffness="6")(root)
    change("tendon/spatial/site", site="post")(root)
    key(qpos="0 1.3502630658740633 2.2459278597319283")(root)


def write(*edits: Edit) -> str:
    """The text of the open model after edits."""
    root = ElementTree.fromstring(OPEN)
    for edit in edits:
        edit(root)
    return ElementTree.tostring(root, encoding="unicode")


@dataclass(frozen=True)
class Changed:
    """A model with one feature more.

    Attributes
    ----------
    edits : tuple of callable
    acts : bool
        Whether bare MuJoCo moves otherwise with it, in a free motion.
    known : bool
        Whether `truth` has the feature; it has smooth forces only, and no equalities.
    element : str
        The name that a refusal must have.
    """

    edits: tuple[Edit, ...]
    acts: bool = True
    known: bool = True
    element: str = "b"

    @property
    def adds_joints(self) -> bool:
        """Whether the model has more joints, so that a drive does not determine all."""
        return mujoco.MjModel.from_xml_string(write(*self.edits)).njnt > len("abc")


def with_load(text: str, **of_key: str) -> tuple[Edit, ...]:
    """Another actuator in place of the load on joint b."""
    return replace_actuator("load", text), key(**of_key) if of_key else key(ctrl="0 .9 .4")


def with_pull(text: str) -> tuple[Edit, ...]:
    """One more actuator, with a control of 1.5."""
    return add("actuator", text), key(ctrl="0 .9 .4 1.5")


def with_equality(text: str) -> tuple[Edit, ...]:
    """One more equality."""

    def edit(root: Element) -> None:
        place = root.find("equality")
        if place is None:
            place = ElementTree.SubElement(root, "equality")
        place.append(ElementTree.fromstring(text))

    return (edit,)


def with_motor(text: str) -> tuple[Edit, ...]:
    """Another actuator in place of the motor on the driven joint, with a control and a state."""
    return replace_actuator("motor", text), key(ctrl="2 .9 .4")


SOFT_ROPE = '<spatial name="rope" stiffness="8" springlength="0"><site site="tip"/><site site="{}"/></spatial>'
BOB = (
    '<body name="bob" pos=".6 0 0"><joint name="ball" type="ball" {}/>'
    '<geom size=".05" pos=".1 0 0" mass=".2"/></body>'
)
TURNED = {"qpos": "0.2 -.1 1 0 0 0 .3"}
PLUGIN = (
    '<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp" value="4"/>'
    "{}</instance></plugin></extension>"
)
PID = '<plugin name="load" joint="b" plugin="mujoco.pid" instance="pid"{}/>'
NET = (
    '<flexcomp type="grid" name="net" count="3 1 1" spacing=".1 .1 .1" radius=".01" dim="1" '
    'pos="4 0 0" mass=".1">{}</flexcomp>'
)
WITH_NET = {"qpos": "0.2 -.1 .3" + 9 * " 0"}
FLOOR = '<geom name="floor" type="plane" size="3 3 1" pos="0 .6 0" zaxis="0 1 0"/>'
FILTER = 'dyntype="filter" dynprm=".1"'
"""An actuator with a state of its own."""

CHANGED: dict[str, Changed] = {
    "ball joint": Changed(
        (add(".//body[@name='fore']", BOB.format("")), key(**TURNED)), True, False, "ball"
    ),
    "free joint": Changed(
        (
            add(
                "worldbody",
                '<body name="bob" pos="5 0 0"><freejoint name="loose"/><geom size=".05" mass=".2"/><site name="bob"/></body>',
            ),
            add("tendon", SOFT_ROPE.format("bob")),
            key(qpos="0.2 -.1 .3 5 0 0 1 0 0 0"),
        ),
        True,
        False,
        "loose",
    ),
    "stiffness of a joint": Changed((change("joint:b", stiffness="60"),)),
    "polynomial stiffness of a joint": Changed((change("joint:b", stiffness="40 20 10"),)),
    "polynomial stiffness of a ball or free joint": Changed(
        (
            add(".//body[@name='fore']", BOB.format('stiffness="1 2 3"')),
            key(qpos="0.2 -.1 .9 0 .435 0 .3"),
        ),
        True,
        False,
        "ball",
    ),
    "spring that yields of a joint": Changed((change("joint:b", springyield=".05"),), True, False),
    "damping of a joint": Changed((change("joint:b", damping="1.5"),)),
    "polynomial damping of a joint": Changed((change("joint:b", damping=".5 .8 .4"),)),
    "polynomial damping of a driven joint": Changed(
        (change("joint:a", damping="0 .8 .4"),), True, True, "a"
    ),
    "frictionloss of a joint": Changed((change("joint:b", frictionloss=".3"),), True, False),
    "frictionloss of a driven joint": Changed(
        (change("joint:a", frictionloss=".3"),), True, False, "a"
    ),
    "armature of a hinge on the ground": Changed((change("joint:c", armature=".1"),), element="c"),
    "armature of a joint, which is no single hinge on the ground": Changed(
        (change("joint:b", armature=".1"),)
    ),
    "range of a joint": Changed(
        (change("joint:c", range="-.05 .31", limited="true"),), True, False, "c"
    ),
    "range of a ball joint": Changed(
        (
            add(".//body[@name='fore']", BOB.format('range="0 .3" limited="true"')),
            key(qpos="0.2 -.1 .9 0 .435 0 .3"),
        ),
        True,
        False,
        "ball",
    ),
    "margin of the range of a joint": Changed(
        (change("joint:c", range="-2 2.6", limited="true", margin="2.4"),), True, False, "c"
    ),
    "actuatorfrcrange of a joint with motors": Changed(
        (change("joint:b", actuatorfrcrange="-.2 .2"),)
    ),
    "actuatorfrcrange of a joint with a servo": Changed(
        (change("joint:c", actuatorfrcrange="-.2 .2"),), element="c"
    ),
    "actuatorfrcrange of a joint beside actuators that act elsewhere": Changed(
        (
            *with_pull('<motor name="pull" site="tip" gear="0 2 0 0 0 0"/>'),
            change("joint:b", actuatorfrcrange="-.2 .2"),
        )
    ),
    "actuatorfrcrange of a driven joint": Changed(
        (change("joint:a", actuatorfrcrange="-.2 .2"),), False, True, "a"
    ),
    "gravcomp of a body": Changed((change("body:fore", gravcomp=".6"),), element="fore"),
    "mocap body": Changed(
        (
            add(
                "worldbody",
                '<body name="hand" mocap="true" pos="2 -1 0"><site name="hand"/></body>',
            ),
            add("tendon", SOFT_ROPE.format("hand")),
        ),
        element="hand",
    ),
    "density or viscosity of the options": Changed(
        (change("option", density="50", wind="3 0 0"),), element="density"
    ),
    "flex": Changed((add("worldbody", NET.format("")), key(**WITH_NET)), False, False, "flex"),
    "equality of a flex": Changed(
        (add("worldbody", NET.format('<edge equality="true"/>')), key(**WITH_NET)),
        False,
        False,
        "flex",
    ),
    "plugin": Changed((add(".", PLUGIN.format("")), *with_load(PID.format(""))), element="plugin"),
    "connect equality": Changed((close_loop,), True, False, "pin"),
    "weld equality": Changed(
        with_equality('<weld name="tie" body1="fore" body2="arm"/>'),
        True,
        False,
        "tie",
    ),
    "joint equality, of hinges on the ground or of a planet and its arm": Changed(
        with_equality('<joint name="tie" joint1="a" joint2="c" polycoef=".05 .5 0 0 0"/>'),
        True,
        False,
        "tie",
    ),
    "joint equality, whose joints are no such hinges": Changed(
        with_equality('<joint name="tie" joint1="b" joint2="c" polycoef="-.25 .5 0 0 0"/>'),
        True,
        False,
        "tie",
    ),
    "joint equality, whose polycoef is not linear": Changed(
        with_equality('<joint name="tie" joint1="b" joint2="c" polycoef="-.295 .5 .5 0 0"/>'),
        True,
        False,
        "tie",
    ),
    "joint equality, which locks a joint": Changed(
        with_equality('<joint name="tie" joint1="b" polycoef="-.1 0 0 0 0"/>'), True, False, "tie"
    ),
    "tendon equality, of sums of joints": Changed(
        (
            add(
                "tendon",
                '<fixed name="sum"><joint joint="b" coef="1"/><joint joint="c" coef="1"/></fixed>',
            ),
            *with_equality('<tendon name="tie" tendon1="sum" polycoef=".2 0 0 0 0"/>'),
        ),
        True,
        False,
        "tie",
    ),
    "tendon equality, of ways in space": Changed(
        with_equality('<tendon name="tie" tendon1="cable" polycoef="0.3 0 0 0 0"/>'),
        True,
        False,
        "tie",
    ),
    "a tendon, which is a sum of joints": Changed(
        (
            add(
                "tendon",
                '<fixed name="sum" stiffness="7"><joint joint="b" coef="1"/><joint joint="c" coef="-.5"/></fixed>',
            ),
        ),
        element="sum",
    ),
    "a tendon, which goes by several sites": Changed(
        (
            add(
                "tendon",
                '<spatial name="rope" stiffness="1" springlength="0"><site site="tip"/><site site="post"/><site site="swing_end"/></spatial>',
            ),
        ),
        element="rope",
    ),
    "a tendon, which goes around a geom or a pulley": Changed(
        (
            add(
                "tendon",
                '<spatial name="rope" stiffness="1" springlength="0"><site site="tip"/><site site="post"/><pulley divisor="2"/><site site="post"/><site site="swing_end"/></spatial>',
            ),
        ),
        element="rope",
    ),
    "stiffness of a tendon": Changed((change("tendon/spatial", stiffness="9"),), element="cable"),
    "polynomial stiffness of a tendon": Changed(
        (change("tendon/spatial", stiffness="5 .5 .2"),), element="cable"
    ),
    "damping of a tendon": Changed((change("tendon/spatial", damping="2"),), element="cable"),
    "polynomial damping of a tendon": Changed(
        (change("tendon/spatial", damping=".2 .3 .1"),), element="cable"
    ),
    "frictionloss of a tendon": Changed(
        (change("tendon/spatial", frictionloss=".6"),), True, False, "cable"
    ),
    "range of a tendon": Changed(
        (change("tendon/spatial", limited="true", range="0 1.2"),), True, False, "cable"
    ),
    "margin of the range of a tendon": Changed(
        (change("tendon/spatial", limited="true", range="0 3", margin="2.9"),), True, False, "cable"
    ),
    "armature of a tendon": Changed((change("tendon/spatial", armature=".3"),), element="cable"),
    "spring that yields of a tendon": Changed(
        (change("tendon/spatial", springyield=".3"),), True, False, "cable"
    ),
    "actuatorfrcrange of a tendon": Changed(
        (
            *with_pull('<motor name="pull" tendon="cable"/>'),
            change("tendon/spatial", actuatorfrcrange="-1 1"),
        ),
        element="cable",
    ),
    "an actuator, which is a motor on a joint": Changed((key(ctrl="0 1.9 .4"),), element="load"),
    "an actuator, which is a servo on a joint": Changed(
        (change("actuator/position", kp="9"),), element="servo"
    ),
    "an actuator, which is a motor on a site whose refsite, if any, is of the ground": Changed(
        with_pull('<motor name="pull" site="tip" refsite="post" gear="1 2 0 0 0 0"/>'),
        element="pull",
    ),
    "an actuator, which is a servo on such a site": Changed(
        with_pull(
            '<general name="pull" site="tip" refsite="post" gear="1 2 0 0 0 0" biastype="affine" gainprm="4" biasprm="0 -4 0"/>'
        ),
        element="pull",
    ),
    "an actuator, which acts on a tendon": Changed(
        with_pull('<motor name="pull" tendon="cable"/>'), element="pull"
    ),
    "an actuator, which acts on a ball or a free joint": Changed(
        (
            add(".//body[@name='fore']", BOB.format("")),
            add("actuator", '<motor name="ball" joint="ball" gear="0 0 1 0 0 0"/>'),
            key(ctrl="0 .9 .4 1.5", **TURNED),
        ),
        True,
        False,
        "ball",
    ),
    "an actuator, which acts at a site whose refsite moves, on a crank or on a body": Changed(
        with_pull('<motor name="pull" cranksite="tip" slidersite="post" cranklength="2"/>'),
        element="pull",
    ),
    "activation of an actuator": Changed(
        with_load(
            f'<general name="load" joint="b" {FILTER} gainprm="5"/>', ctrl="0 .9 .4", act=".3"
        ),
        element="load",
    ),
    "gain or bias that is not affine of an actuator": Changed(
        with_load('<general name="load" joint="b" gaintype="affine" gainprm="1 2 0"/>'),
        element="load",
    ),
    "ctrlrange of an actuator": Changed(
        (change("actuator/motor[2]", ctrlrange="-.2 .2", ctrllimited="true"),), element="load"
    ),
    "forcerange of a motor": Changed(
        (change("actuator/motor[2]", forcerange="-.2 .2", forcelimited="true"),), element="load"
    ),
    "forcerange of a servo": Changed(
        (change("actuator/position", forcerange="-.2 .2", forcelimited="true"),), element="servo"
    ),
    "delay of an actuator": Changed(
        with_load('<general name="load" joint="b" delay=".05" nsample="60"/>'), True, False, "load"
    ),
    "armature of an actuator": Changed(
        (change("actuator/motor[2]", armature=".1"),), element="load"
    ),
    "armature of an actuator on a driven joint": Changed(
        (change("actuator/motor[1]", armature=".1"),), element="motor"
    ),
    "damping of an actuator": Changed((change("actuator/motor[2]", damping=".6"),), element="load"),
    "damping of an actuator on a driven joint": Changed(
        (change("actuator/motor[1]", damping=".6"),), element="motor"
    ),
    "polynomial damping of an actuator": Changed(
        (change("actuator/motor[2]", damping="0 .6 .2"),), element="load"
    ),
    "polynomial damping of an actuator on a driven joint": Changed(
        (change("actuator/motor[1]", damping="0 .6 .2"),), element="motor"
    ),
    "force of an actuator on a driven joint": Changed(
        (
            replace_actuator(
                "motor",
                f'<general name="motor" joint="a" {FILTER} gaintype="affine" gainprm="5 1 0" biastype="affine" biasprm="1 2 3" forcerange="-4 4"/>',
            ),
            key(ctrl="2 .9 .4", act="1.5"),
        ),
        True,
        True,
        "motor",
    ),
    "contacts": Changed(
        (change("option/flag", contact="enable"), add("worldbody", FLOOR)), True, False, "contact"
    ),
    "rates of the key": Changed((key(qvel="0 1 -1"),), element=""),
    "time of the key": Changed((key(time="3"),), False, element=""),
    "integrator or solver of the options": Changed(
        (change("option", integrator="implicit"),), True, False, element=""
    ),
    "discrete inverse dynamics": Changed(
        (change("option/flag", invdiscrete="enable"),), False, element=""
    ),
    "sleep of bodies at rest": Changed(
        (change("option/flag", sleep="enable"), change("option", sleep_tolerance="10")),
        False,
        False,
        element="",
    ),
    "magnetic field": Changed((change("option", magnetic="1 2 3"),), False, element=""),
    "cutoff of a sensor": Changed((change("sensor/jointpos[2]", cutoff=".05"),), False),
    "delay of a sensor": Changed(
        (change("sensor/jointpos[2]", delay=".05", nsample="100"),), False
    ),
    "interval of a sensor": Changed((change("sensor/jointpos[2]", interval=".05"),), False),
    "noise of a sensor": Changed((change("sensor/jointpos[2]", noise=".1"),), False),
}
"""By the name of a feature, a model that has it."""


FREE = {"b": 1, "c": 2}
"""The joints that joint a leaves free, and their numbers."""


def drop_actuators(model: mujoco.MjModel, joints: tuple[str, ...]) -> None:
    """Disable the actuators of driven joints, whose place the drives take."""
    for a in range(model.nactuator):
        on_joint = int(model.actuator_trntype[a]) < 2
        if on_joint and model.joint(int(model.actuator_trnid[a, 0])).name in joints:
            model.actuator_group[a] = 30
            model.opt.disableactuator |= 1 << 30


def needed(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Forces that the joints need besides those of the actuators, by MuJoCo's inverse dynamics."""
    mujoco.mj_inverse(model, data)
    force = data.qfrc_inverse.copy()
    mujoco.mj_fwdActuation(model, data)
    return force - data.qfrc_actuator


def start(text: str, joints: tuple[str, ...] = ()) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A compiled model in the state of its key, without the actuators of driven joints."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    drop_actuators(model, joints)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def free_motion(text: str, times: np.ndarray) -> dict[str, np.ndarray]:
    """Joint values in bare MuJoCo, stepped a tenth of a millisecond at a time."""
    model, data = start(text)
    model.opt.timestep = 1e-4
    rows = []
    for span in np.diff(times, prepend=times[0]):
        mujoco.mj_step(model, data, round(span / 1e-4))
        rows.append([data.joint(name).qpos[0] for name in "abc"])
    return dict(zip("abc", np.array(rows).T, strict=True))


def driven_motion(text: str, times: np.ndarray, profile: Callable) -> dict[str, np.ndarray]:
    """Joint values and the moment of the drive at joint a, with MuJoCo's inverse dynamics."""
    model, data = start(text, ("a",))
    free = list(FREE.values())

    def solve(t: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        data.qpos[0], data.qvel[0], drive = profile(t)
        data.qpos[free], data.qvel[free], data.act[:] = state[:2], state[2:4], state[4:]
        data.qacc[:] = [drive, 0.0, 0.0]
        base = needed(model, data)
        rates = data.act_dot.copy()
        columns = []
        for i in free:
            data.qacc[i] = 1.0
            columns.append(needed(model, data) - base)
            data.qacc[i] = 0.0
        mass = np.array(columns).T
        found = np.linalg.solve(mass[free], -base[free])
        return found, rates, float(base[0] + mass[0] @ found)

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        found, rates, _ = solve(t, state)
        return np.concatenate([state[2:4], found, rates])

    begin = np.concatenate([data.qpos[free], data.qvel[free], data.act])
    way = solve_ivp(slope, (0.0, times[-1]), begin, t_eval=times, rtol=1e-9, atol=1e-11)
    hold = [solve(t, state)[2] for t, state in zip(times, way.y.T, strict=True)]
    return {"a": profile(times)[0], "b": way.y[0], "c": way.y[1], "hold": np.array(hold)}


def resting_sweep(text: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Equilibria of joints b and c, and the moment at joint a, for values of joint a."""
    model, data = start(text, ("a",))
    free, rows = list(FREE.values()), []
    data.qvel[:] = data.qacc[:] = 0.0

    def force(q: np.ndarray) -> np.ndarray:
        data.qpos[free] = q
        return needed(model, data)[free]

    for value in values:
        data.qpos[0] = value
        fsolve(force, data.qpos[free].copy(), xtol=1e-13)
        rows.append([*data.qpos, needed(model, data)[0]])
    return dict(zip(("a", "b", "c", "hold"), np.array(rows).T, strict=True))


def looped_sweep(text: str, values: np.ndarray, inertia: bool) -> dict[str, np.ndarray]:
    """The moment at joint a of the closed loop, at rest or at rate 1, by virtual work.

    The loop is closed by its geometry; rates and accelerations are differences of poses.
    """
    model, data = start(text, ("a",))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
    rest, rows, step = data.qpos[1:3].copy(), [], 1e-4

    def close(value: float, near: np.ndarray) -> np.ndarray:
        def gap(q: np.ndarray) -> np.ndarray:
            data.qpos[:3] = value, *q
            mujoco.mj_kinematics(model, data)
            return (data.site("tip").xpos - data.site("swing_end").xpos)[:2]

        return fsolve(gap, near, xtol=1e-13)

    for value in values:
        rest = close(value, rest)
        shifted = [close(value + k * step, rest) for k in (-2, -1, 1, 2)]
        rate = (8 * (shifted[2] - shifted[1]) - (shifted[3] - shifted[0])) / (12 * step)
        bend = 16 * (shifted[1] + shifted[2]) - shifted[0] - shifted[3] - 30 * rest
        tangent = np.array([1.0, *rate])
        data.qpos[:3] = value, *rest
        data.qvel[:3] = tangent * inertia
        data.qacc[:3] = np.array([0.0, *bend / (12 * step**2)]) * inertia
        rows.append([value, *rest, needed(model, data) @ tangent])
    return dict(zip(("a", "b", "c", "hold"), np.array(rows).T, strict=True))
