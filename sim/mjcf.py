"""Compiling an MJCF file; both simulators start from the compiled numbers."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from sim.protocol import BadModel, Rod
from sim.rods import compile_with_rods

OFF = mujoco.mjtDisableBit
CONSTRAINTS = {OFF.mjDSBL_EQUALITY: ("eq_active0",),
               OFF.mjDSBL_FRICTIONLOSS: ("dof_frictionloss", "tendon_frictionloss"),
               OFF.mjDSBL_LIMIT: ("jnt_limited", "tendon_limited")}
LEFT_OUT = {OFF.mjDSBL_CONSTRAINT: tuple(field for own in CONSTRAINTS.values() for field in own),
            **CONSTRAINTS,
            OFF.mjDSBL_SPRING: ("jnt_stiffness", "jnt_stiffnesspoly",
                                "tendon_stiffness", "tendon_stiffnesspoly"),
            OFF.mjDSBL_DAMPER: ("dof_damping", "dof_dampingpoly",
                                "tendon_damping", "tendon_dampingpoly")}


def compile_model(path: Path, rods: Sequence[Rod] = ()) -> mujoco.MjModel:
    """Compile a model, completed with rods, or say in one line why it does not.

    What its flags disable is left out of the compiled numbers; see `leave_out_disabled`.

    Raises
    ------
    BadModel
        Malformed, or a NaN in the file: MuJoCo's reader puts a zero in its place and only warns.
    BadRod
        A rod that cannot be built.
    """
    try:
        if rods:
            model = compile_with_rods(mujoco.MjSpec.from_file(str(path)), rods)
        else:
            model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        raise BadModel(f"{path.name}: {' '.join(str(error).split())}") from None
    for element in ElementTree.parse(path).iter():
        for key, value in element.attrib.items():
            if "nan" in value.lower().split():
                raise BadModel(f"{path.name}: <{element.tag} name={element.get('name')!r}>: "
                               f"{key}={value!r} is not a number")
    leave_out_disabled(model)
    return model


def leave_out_disabled(model: mujoco.MjModel) -> None:
    """Set to zero, in place, the numbers of what the model's disable flags turn off.

    MuJoCo keeps these numbers and passes over them when it steps.  Whoever else reads them, the
    gravity that is taken off a sensor or a spring that is rebuilt in another engine, would have to
    ask for the flag each time.  Flags of actuators need nothing: their forces are the engine's own.
    """
    for flag, fields in LEFT_OUT.items():
        if model.opt.disableflags & int(flag):
            for field in fields:
                getattr(model, field)[:] = 0
    if model.opt.disableflags & int(OFF.mjDSBL_GRAVITY):
        model.opt.gravity[:] = 0
