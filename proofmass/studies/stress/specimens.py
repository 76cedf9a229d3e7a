"""Small models whose limits theory knows, as MJCF, and how to try them.

What is tried for stability is begun a thousandth large or less, in a shape that holds all its
modes, and stepped a number of times: it is lost when it is large then.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from proofmass.isolate import KILLED, Crashed, TimedOut, isolated
from proofmass.sim.protocol import Curves, Diverged, Run
from proofmass.solve import simulate
from proofmass.studies.measure import taken
from proofmass.studies.stress.boundary import Failure, Limit, Tried, told

STEPS, EVERY = 4000, 20  # of a run, and from sample to sample
SECONDS = 120.0
SENSORS = """<jointpos name="place" joint="{0}"/> <jointvel name="rate" joint="{0}"/>
    <e_kinetic name="kinetic"/> <e_potential name="potential"/>"""


def mjcf(world: str, watched: str = "joint", rest: str = "", gravity: str = "0 0 0",
         flags: str = "") -> str:
    """A model of what stands in its world, with the sensors of one joint."""
    return f"""<mujoco model="specimen">
  <compiler angle="radian"/>
  <option gravity="{gravity}" jacobian="dense"><flag contact="disable" {flags}/></option>
  <worldbody>{world}</worldbody>
  <sensor>{SENSORS.format(watched)}</sensor>
  {rest}
</mujoco>"""


def wheel(stiffness: float = 0.0, damping: float = 0.0, kind: str = "hinge", **more: str) -> str:
    """A body of unit inertia on a spring and a damper, turned or moved by a thousandth."""
    axis = "0 0 1" if kind == "hinge" else "1 0 0"
    return mjcf(f"""<body pos="1 0 0"><joint name="joint" type="{kind}" axis="{axis}"
        stiffness="{stiffness!r}" damping="{damping!r}"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>""",
                **{"rest": key("0.001"), **more})


def key(place: str, rate: str = "") -> str:
    """The start."""
    return f'<keyframe><key name="start" qpos="{place}" {rate and f"qvel={rate!r}"}/></keyframe>'


def chain(masses: int) -> str:
    """Unit masses in a row, on unit springs between them and to the ground at one end."""
    world = "".join(f"""<body pos="1 0 0">
        <joint name="j{k}" type="slide" axis="1 0 0" stiffness="1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>""" for k in range(masses))
    return mjcf(world + "</body>" * masses, f"j{masses - 1}",
                key("0 " * (masses - 1) + "0.001"))


def pendulum(gravity: float) -> str:
    """A point mass on a rod of unit length, hung, and turned by a millionth: linear all along."""
    return mjcf("""<body><joint name="joint" axis="0 0 1"/>
        <inertial pos="0 -1 0" mass="1" diaginertia="1e-12 1e-12 1e-12"/></body>""",
                gravity=f"0 {-gravity!r} 0", rest=key("1e-6"))


def whirl(speed: float) -> str:
    """A mass on a unit spring, on a slide of a heavy wheel that turns; drawn out by a thousandth.

    What stands a metre away gives the model a size, which open joints are judged by.
    """
    return mjcf("""<body><joint name="wheel" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1e9 1e9 1e9"/>
        <body><joint name="joint" type="slide" axis="1 0 0" stiffness="1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
        </body><body pos="1 0 0"><joint name="far" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>""",
                rest=key("0 0.001 0", f"{speed!r} 0 0"))


def column(load: float) -> str:
    """Where a rod is clamped that a load at its tip pushes back along itself."""
    return f"""<mujoco model="column">
  <compiler angle="radian"/>
  <option integrator="implicitfast" gravity="0 0 0" jacobian="dense">
    <flag contact="disable"/></option>
  <worldbody><site name="clamp"/></worldbody>
  <actuator><motor name="load" site="rod.tip" refsite="clamp" gear="-1 0 0 0 0 0"/></actuator>
  <keyframe><key name="start" ctrl="{load!r}"/></keyframe>
</mujoco>"""


def fourbar(crank: float, coupler: float, rocker: float, ground: float, start: float) -> str:
    """A four-bar, open, with its crank at an angle."""
    tip = crank * np.exp(1j * start)
    to_rocker = ground - tip
    turn = np.angle(to_rocker) + np.arccos(
        (coupler**2 + abs(to_rocker) ** 2 - rocker**2) / (2 * coupler * abs(to_rocker)))
    pin = tip + coupler * np.exp(1j * turn)
    pose = f"{start!r} {float(turn - start)!r} {float(np.angle(pin - ground))!r}"
    inertia = 'mass="1" diaginertia="1 1 1"'
    return mjcf(f"""<body><joint name="crank" axis="0 0 1"/><inertial pos="0 0 0" {inertia}/>
        <body pos="{crank} 0 0"><joint name="coupler" axis="0 0 1"/>
        <inertial pos="0 0 0" {inertia}/><site name="a" pos="{coupler} 0 0"/></body></body>
        <body pos="{ground} 0 0"><joint name="rocker" axis="0 0 1"/>
        <inertial pos="0 0 0" {inertia}/><site name="b" pos="{rocker} 0 0"/></body>""", "rocker",
                '<equality><connect name="pin" site1="a" site2="b"/></equality>' + key(pose))


def ran(engine: str, text: str, run: Run) -> Curves:
    """Run a model that is written here, in a process of its own."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "specimen.xml"
        file.write_text(text, encoding="utf-8")
        return isolated(simulate, engine, file, run, timeout=SECONDS)


def stepping(engine: str, text: str, step: float, settings: dict[str, Any], channel: str = "place",
             bound: float = 1.0, steps: int = STEPS) -> Tried:
    """Step a model: a failure when it is lost, or ends beyond a bound in silence."""
    x = step * EVERY * np.arange(steps // EVERY + 1.0)
    settings = {"timestep": step, **settings}
    try:
        curves = ran(engine, text, Run("duration", x, (channel,), settings=settings))
    except Diverged as error:
        return Tried(Failure(str(error), Limit.UNSTABLE, silent=not told(str(error))))
    except (Crashed, TimedOut) as error:
        aborted = str(error).startswith(KILLED)
        return Tried(Failure(str(error), Limit.UNSTABLE if aborted else Limit.OURS))
    last = float(np.abs(curves.channels[channel])[-curves.x.size // 4:].max())
    grew = Failure(f"grew to {last:.2g}", Limit.UNSTABLE, silent=True)
    return Tried(None if last < bound else grew, taken("duration", curves))
