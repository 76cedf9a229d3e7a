"""``proofmass new``: a model and a sidecar that pass at once, with comments on what to change.

The model is a four-bar with bars of 1, 2, 2.5 and 3 m, whose crank makes one turn.  The reference
is the general planar solver, which reads the model: bars and pins can be changed without a change
of the sidecar.
"""

import re
from pathlib import Path

from proofmass.base.errors import InputError
from proofmass.base.files import write_atomically
from proofmass.run.schema import as_json_text

NAME_PATTERN = re.compile(r"[A-Za-z0-9][\w.-]*")
SCHEMA_FILE = "proofmass.schema.json"
MODEL_TEMPLATE = """\
<mujoco model="{name}">
  <!-- A four-bar in the x-y plane, gravity along -y: two bars in a chain from the left pivot, one
       from the right pivot, and a pin that joins their ends. Lengths in m, masses in kg. -->
  <compiler angle="radian"/>
  <option timestep="1e-3" integrator="RK4" gravity="0 -9.81 0" tolerance="1e-10">
    <flag contact="disable"/>   <!-- bars of one linkage lie in layers and do not touch -->
  </option>
  <default>
    <!-- Loops of MuJoCo are springs. These are stiffer than its own, so that the pin opens less;
         `proofmass trade` measures what they and the time step cost. -->
    <equality solref="0.005 1" solimp="0.9999 0.9999 0.001"/>
    <geom type="capsule" size="0.04" mass="0"/>   <!-- drawn, without a mass of its own -->
  </default>

  <worldbody>
    <!-- A body begins at its pivot (pos, in the frame of the body around it) and turns about it
         (joint, by default a hinge about z). Its mass is at inertial pos; the last of the three
         moments of inertia acts in the plane. -->
    <body name="crank">
      <joint name="crank"/>
      <inertial pos="0.5 0 0" mass="1" diaginertia="0.001 0.0833333333333333 0.0833333333333333"/>
      <geom fromto="0 0 0 1 0 0"/>
      <body name="coupler" pos="1 0 0">
        <joint name="coupler"/>
        <inertial pos="1 0 0" mass="2" diaginertia="0.001 0.666666666666667 0.666666666666667"/>
        <geom fromto="0 0 0 2 0 0"/>
        <site name="coupler_end" pos="2 0 0"/>
        <site name="point" pos="1 0.8 0"/>   <!-- a point to watch -->
      </body>
    </body>
    <body name="rocker" pos="3 0 0">
      <joint name="rocker"/>
      <inertial pos="1.25 0 0" mass="2.5" diaginertia="0.001 1.30208333333333 1.30208333333333"/>
      <geom fromto="0 0 0 2.5 0 0"/>
      <site name="rocker_end" pos="2.5 0 0"/>
    </body>
  </worldbody>

  <equality>
    <!-- The loop: two sites that are one point. -->
    <connect name="pin" site1="coupler_end" site2="rocker_end"/>
  </equality>

  <actuator>
    <motor name="motor" joint="crank"/>   <!-- its sensor: the moment that holds the crank -->
  </actuator>

  <sensor>
    <!-- What is compared: each sensor with a name, of places, rates, accelerations, moments. -->
    <jointpos name="rocker" joint="rocker"/>
    <framepos name="point" objtype="site" objname="point"/>
    <jointvel name="rocker_rate" joint="rocker"/>
    <framelinvel name="point_velocity" objtype="site" objname="point"/>
    <framelinacc name="point_acceleration" objtype="site" objname="point"/>
    <actuatorfrc name="holding_moment" actuator="motor"/>
  </sensor>

  <keyframe>
    <!-- The start pose: angles of the joints in the order of the file, where the loop closes. -->
    <key name="start" qpos="0 1.3502630658740633 2.2459278597319283"/>
  </keyframe>
</mujoco>
"""
SIDECAR_TEMPLATE = """\
#:schema {schema}
# What {name}.xml is compared with. docs/sidecar.md has every key; `proofmass show {name}.toml`
# prints this file with all that it leaves to defaults.
title = "Four-bar, one turn of the crank"
source = "where the lengths, masses and springs come from: a drawing, a table, a page"
reference = "planar"          # the general solver; or a closed form such as "fourbar", which needs
                              # [parameters]; or a recorded curve, "rig.csv"

[drive]                       # one joint for each degree of freedom
joint = "crank"
from = 0.0                    # rad, or m of a slide; the start pose of the model is here
to = 6.283185307179586
rate = 1.0                    # rad/s
"""


def write_new(name: str, folder: Path) -> list[Path]:
    """Write a model, its sidecar, and the schema that editors check the sidecar with.

    Parameters
    ----------
    name : str
        Name of the case; the files are ``NAME_PATTERN.xml`` and ``NAME_PATTERN.toml``.
    folder : Path
        The folder of the files, which is made if it does not exist.

    Returns
    -------
    list of Path
        The files that were written: the model, the sidecar, and the schema if there was none.

    Raises
    ------
    InputError
        The name cannot be that of a file, or a file of that name exists.
    """
    if not NAME_PATTERN.fullmatch(name):
        raise InputError(
            folder / f"{name}.toml",
            "",
            f"{name!r} is no name of a case; give letters, digits, '_', '-' and '.', such as arm",
        )
    texts = {
        folder / f"{name}.xml": MODEL_TEMPLATE.format(name=name),
        folder / f"{name}.toml": SIDECAR_TEMPLATE.format(name=name, schema=SCHEMA_FILE),
    }
    for file in texts:
        if file.exists():
            raise InputError(file, "", "it is there already; give another name or folder")
    folder.mkdir(parents=True, exist_ok=True)
    if not (schema := folder / SCHEMA_FILE).exists():
        texts[schema] = as_json_text()
    for file, text in texts.items():
        write_atomically(file, text)
    return list(texts)
