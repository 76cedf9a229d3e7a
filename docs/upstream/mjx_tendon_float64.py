"""MJX 3.17 cannot scan the steps of a model with a tendon in float64: its carry changes a type.

    uv run --no-project --with mujoco-mjx==3.17.0 --with mujoco==3.17.0 --with jax==0.10.2 \
        python mjx_tendon_float64.py
"""

import os

os.environ["JAX_PLATFORMS"] = "cpu"

import sys

import jax

jax.config.update("jax_enable_x64", "--single" not in sys.argv)

import mujoco  # noqa: E402
from mujoco import mjx  # noqa: E402

MODEL = """
<mujoco>
  <worldbody>
    <site name="ground" pos="0 0 1"/>
    <body>
      <joint type="slide" axis="0 0 1"/>
      <geom size="0.1"/>
      <site name="bob"/>
    </body>
  </worldbody>
  <tendon><spatial stiffness="10"><site site="ground"/><site site="bob"/></spatial></tendon>
</mujoco>
"""
model = mujoco.MjModel.from_xml_string(MODEL)
own, state = mjx.put_model(model), mjx.put_data(model, mujoco.MjData(model))


def step(now, _):
    """One step."""
    return mjx.step(own, now), None


try:
    last, _ = jax.lax.scan(step, state, None, 10)
    print("ran:", last.qpos)
except TypeError as error:
    print(type(error).__name__, str(error)[:600])
