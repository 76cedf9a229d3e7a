"""Small MJCF models with sensors of one joint, for test problems with limits known from theory."""

JOINT_SENSORS = """<jointpos name="place" joint="{0}"/> <jointvel name="rate" joint="{0}"/>
    <e_kinetic name="kinetic"/> <e_potential name="potential"/>"""


def problem_mjcf(
    world: str, watched: str = "joint", rest: str = "", gravity: str = "0 0 0", flags: str = ""
) -> str:
    """A model with the bodies `world`, and with sensors of the joint `watched`."""
    return f"""<mujoco model="problem">
  <compiler angle="radian"/>
  <option gravity="{gravity}" jacobian="dense"><flag contact="disable" {flags}/></option>
  <worldbody>{world}</worldbody>
  <sensor>{JOINT_SENSORS.format(watched)}</sensor>
  {rest}
</mujoco>"""


def wheel_model(
    stiffness: float = 0.0, damping: float = 0.0, kind: str = "hinge", **more: str
) -> str:
    """A body of unit inertia on a spring and a damper, displaced by 0.001 rad or m at the start."""
    axis = "0 0 1" if kind == "hinge" else "1 0 0"
    return problem_mjcf(
        f"""<body pos="1 0 0"><joint name="joint" type="{kind}" axis="{axis}"
        stiffness="{stiffness!r}" damping="{damping!r}"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>""",
        **{"rest": start_key("0.001"), **more},
    )


def start_key(place: str, rate: str = "") -> str:
    """The key with the start value, and the start rate, of the joint."""
    return f'<keyframe><key name="start" qpos="{place}" {rate and f"qvel={rate!r}"}/></keyframe>'
