"""Compiling an MJCF file; both simulators start from the compiled numbers."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from sim.protocol import BadModel, Rod
from sim.rods import compile_with_rods


def compile_model(path: Path, rods: Sequence[Rod] = ()) -> mujoco.MjModel:
    """Compile a model, completed with rods, or say in one line why it does not.

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
    return model
