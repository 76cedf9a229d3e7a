"""Random linkages of every family: an MJCF model and the closed form that it must follow.

Each builder draws lengths with hypothesis, writes the model with its start pose to seven digits, as
a modeller would, and maps each channel to the quantity that it must equal.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

from proofmass.analytic.linkages import (
    fivebar,
    fourbar,
    inverted_slider_crank,
    slider_crank,
    threeprr,
)

SAMPLES = 25
"""Samples of a sweep."""
MIN_SINE = 0.15
"""Least sine of a transmission angle in a sweep: accelerations lose digits by its third power."""


@dataclass(frozen=True)
class Linkage:
    """A model, its drives, their path, and its closed form."""

    model: mujoco.MjModel
    joints: tuple[str, ...]
    way: np.ndarray  # (N, drives)
    solve: Callable[..., dict[str, np.ndarray]]
    channels: dict[str, str]


def bar(name: str, length: float, at: str = "0 0 0", inside: str = "", mass: float = 1.0) -> str:
    """A uniform bar along x on a hinge, with a site at each end."""
    inertia = mass * length**2 / 12
    return (
        f'<body name="{name}" pos="{at}"><joint name="{name}"/>'
        f'<inertial pos="{length / 2!r} 0 0" mass="{mass!r}" '
        f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        f'<site name="{name}_root"/><site name="{name}_end" pos="{length!r} 0 0"/>{inside}</body>'
    )


def compile_model(
    bodies: str,
    loops: list[tuple[str, str]],
    drives: tuple[str, ...],
    frames: dict[str, str],
    joints: tuple[str, ...],
    key: list[float],
    ctrl: str = "",
    forces: tuple[str, ...] = (),
    moments: tuple[str, ...] = (),
) -> mujoco.MjModel:
    """Model with sensors of position, rate and acceleration on sites and joints.

    Sensors at the roots of bodies measure the forces and moments that their parent bodies apply.
    """
    sensors = "".join(
        f'<{kind} name="{name}{suffix}" objtype="site" objname="{site}"/>'
        for name, site in frames.items()
        for kind, suffix in (("framepos", ""), ("framelinvel", "_v"), ("framelinacc", "_a"))
    )
    sensors += "".join(
        f'<jointpos name="{j}" joint="{j}"/><jointvel name="{j}_rate" joint="{j}"/>'
        f'<user name="{j}_acceleration" objtype="joint" objname="{j}" dim="1" needstage="acc"/>'
        for j in joints
    )
    sensors += "".join(f'<actuatorfrc name="{d}_hold" actuator="{d}"/>' for d in drives)
    sensors += "".join(f'<force name="{one}_force" site="{one}_root"/>' for one in forces)
    sensors += "".join(f'<torque name="{one}_moment" site="{one}_root"/>' for one in moments)
    motors = "".join(f'<motor name="{d}" joint="{d}"/>' for d in drives)
    connects = "".join(f'<connect name="{a}" site1="{a}" site2="{b}"/>' for a, b in loops)
    qpos = " ".join(f"{q:.7g}" for q in key)
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="0 -9.81 0"/><worldbody>{bodies}'
        f"</worldbody><equality>{connects}</equality><actuator>{motors}</actuator>"
        f'<sensor>{sensors}</sensor><keyframe><key name="start" qpos="{qpos}" {ctrl}/></keyframe>'
        f"</mujoco>"
    )


def point_channels(channel: str, quantity: str) -> dict[str, str]:
    """Channels of position, velocity and acceleration of a point."""
    return {
        f"{channel}{c}.{x}": f"{quantity}_{o}{x}"
        for x in "xy"
        for c, o in (("", ""), ("_v", "v"), ("_a", "a"))
    }


def joint_channels(joint: str, quantity: str, rate: str) -> dict[str, str]:
    """Channels of value, rate and acceleration of a joint."""
    return {
        joint: quantity,
        f"{joint}_rate": f"{rate}_rate",
        f"{joint}_acceleration": f"{rate}_acceleration",
    }


def force_channels(*names: str) -> dict[str, str]:
    """Channels of the components of the forces of pins and guides."""
    return {f"{name}_force.{x}": f"{name}_force_{x}" for name in names for x in "xy"}


def massless_body(at: str = "0 0 0", name: str = "pin", inside: str = "") -> str:
    """Massless body fixed to a link; the link's force on it acts on another body through a loop."""
    return f'<body pos="{at}"><site name="{name}_root"/>{inside}</body>'


def solve_or_reject(
    solve: Callable, drive_path: np.ndarray, **parameters: float
) -> dict[str, np.ndarray]:
    """Closed form on a fine path of the drives; rejects an example that has no pose somewhere."""
    shares = np.linspace(0, 1, 401)
    path = drive_path[0] + shares[:, None] * (drive_path[-1] - drive_path[0])
    try:
        return solve(path[:, 0] if path.shape[1] == 1 else path.T, **parameters)
    except ValueError:
        assume(False)
        raise


lengths = st.floats(0.3, 3.0)
angles = st.floats(-3.0, 3.0)


def straight_path(*ends: tuple[float, float]) -> np.ndarray:
    """Straight path of the drives, each from its first to its second value."""
    return np.stack([np.linspace(a, b, SAMPLES) for a, b in ends], axis=1)


@st.composite
def four_bars(draw: st.DrawFn, min_sine: float = MIN_SINE, turn: float = 1.5) -> Linkage:
    p = {k: draw(lengths) for k in ("crank", "coupler", "rocker", "ground")}
    p |= {
        "mode": draw(st.sampled_from(fourbar.MODES)),
        "crank_mass": 1.0,
        "coupler_mass": 2.0,
        "rocker_mass": 3.0,
    }
    first = draw(angles)
    drive_path = straight_path((first, first + turn * draw(st.sampled_from((-1, 1)))))
    if min_sine:
        assume(
            np.sin(solve_or_reject(fourbar.solve, drive_path, **p)["transmission_angle"]).min()
            > min_sine
        )
    else:
        solve_or_reject(fourbar.solve, drive_path[:1].repeat(2, axis=0), **p)
    start = fourbar.solve(first, **p)
    bodies = bar(
        "crank",
        p["crank"],
        mass=1.0,
        inside=bar("coupler", p["coupler"], f"{p['crank']!r} 0 0", mass=2.0),
    )
    bodies += bar("rocker", p["rocker"], f"{p['ground']!r} 0 0", mass=3.0)
    key = [first, float(start["coupler_angle"]) - first, float(start["rocker_angle"])]
    model = compile_model(
        bodies,
        [("coupler_end", "rocker_end")],
        ("crank",),
        {"pin": "rocker_end"},
        ("rocker",),
        key,
        forces=("crank", "coupler", "rocker"),
    )
    return Linkage(
        model,
        ("crank",),
        drive_path,
        lambda *s, **more: fourbar.solve(*s, **p, **more),
        {
            **point_channels("pin", "pin"),
            **joint_channels("rocker", "rocker_angle", "rocker"),
            **force_channels("crank", "coupler", "rocker"),
            "crank_hold": "holding_moment",
        },
    )


@st.composite
def slider_cranks(draw: st.DrawFn) -> Linkage:
    p = {
        "crank": draw(lengths),
        "coupler": draw(lengths),
        "guide_x": draw(st.floats(-1, 1)),
        "guide_y": draw(st.floats(-1, 1)),
        "guide_angle": draw(angles),
        "mode": draw(st.sampled_from(slider_crank.MODES)),
        "crank_mass": 1.0,
        "coupler_mass": 2.0,
        "slider_mass": 3.0,
        "slider_load": draw(st.floats(-20, 20)),
    }
    first = draw(angles)
    drive_path = straight_path((first, first + 1.5 * draw(st.sampled_from((-1, 1)))))
    assume(
        np.sin(solve_or_reject(slider_crank.solve, drive_path, **p)["transmission_angle"]).min()
        > MIN_SINE
    )
    start = slider_crank.solve(first, **p)
    u = np.exp(1j * p["guide_angle"])
    ahead, left = (f"{float(z.real)!r} {float(z.imag)!r} 0" for z in (u, 1j * u))
    bodies = bar(
        "crank",
        p["crank"],
        mass=1.0,
        inside=bar("coupler", p["coupler"], f"{p['crank']!r} 0 0", mass=2.0),
    )
    bodies += (
        f'<body pos="{p["guide_x"]!r} {p["guide_y"]!r} 0"><joint name="slider" type="slide" '
        f'axis="{ahead}"/><inertial pos="0 0 0" mass="3" '
        f'diaginertia="1 1 1"/><site name="slider_pin"/>'
        f'<site name="guide_root" xyaxes="{ahead} {left}"/></body>'
    )
    key = [first, float(start["coupler_angle"]) - first, float(start["slide"])]
    model = compile_model(
        bodies,
        [("coupler_end", "slider_pin")],
        ("crank", "slider"),
        {"pin": "slider_pin"},
        ("slider",),
        key,
        f'ctrl="0 {p["slider_load"]!r}"',
        ("crank", "coupler", "guide"),
    )
    return Linkage(
        model,
        ("crank",),
        drive_path,
        lambda *s, **more: slider_crank.solve(*s, **p, **more),
        {
            **point_channels("pin", "slider"),
            **joint_channels("slider", "slide", "slide"),
            **force_channels("crank", "coupler", "guide"),
            "crank_hold": "holding_moment",
        },
    )


@st.composite
def inverted_slider_cranks(draw: st.DrawFn) -> Linkage:
    p = {
        "crank": draw(lengths),
        "bar": draw(lengths),
        "rod": draw(lengths),
        "ground_x": draw(st.floats(-3, 3)),
        "ground_y": draw(st.floats(-1, 1)),
        "mode": draw(st.sampled_from(inverted_slider_crank.MODES)),
        "crank_mass": 1.0,
        "bar_mass": 2.0,
        "rod_mass": 3.0,
        "slider_mass": 0.5,
        "slider_inertia": 1.0,
    }
    first, second = draw(angles), draw(angles)
    drive_path = straight_path((first, first + 1.2), (second, second + draw(st.floats(-1.5, 1.5))))
    assume(
        np.abs(solve_or_reject(inverted_slider_crank.solve, drive_path, **p)["slide"]).min() > 0.4
    )
    start = inverted_slider_crank.solve(drive_path[0], **p)
    rod = bar(
        "rod",
        p["rod"],
        f"{p['crank']!r} 0 0",
        mass=3.0,
        inside=(
            '<body name="slider"><joint name="slide" type="slide" axis="1 0 0"/>'
            '<inertial pos="0 0 0" mass="0.5" diaginertia="1 1 1"/><site name="guide_root"/>'
            f"{massless_body()}</body>"
        ),
    )
    bodies = bar("crank", p["crank"], mass=1.0, inside=rod)
    bodies += bar("bar", p["bar"], f"{p['ground_x']!r} {p['ground_y']!r} 0", mass=2.0)
    key = [first, float(start["rod_angle"]) - first, float(start["slide"]), second]
    model = compile_model(
        bodies,
        [("pin_root", "bar_end")],
        ("crank", "bar"),
        {"end": "rod_end"},
        ("slide",),
        key,
        forces=("crank", "bar", "rod", "guide", "pin"),
        moments=("guide",),
    )
    return Linkage(
        model,
        ("crank", "bar"),
        drive_path,
        lambda *s, **more: inverted_slider_crank.solve(*s, **p, **more),
        {
            **point_channels("end", "end"),
            **joint_channels("slide", "slide", "slide"),
            **force_channels("crank", "bar", "rod", "guide", "pin"),
            "guide_moment.z": "guide_moment",
            "crank_hold": "holding_moment",
            "bar_hold": "holding_moment_bar",
        },
    )


@st.composite
def five_bars(draw: st.DrawFn) -> Linkage:
    names = ("left_crank", "left_coupler", "right_coupler", "right_crank")
    p = {k: draw(lengths) for k in names}
    p |= {
        "left_x": draw(st.floats(-2, 0)),
        "right_x": draw(st.floats(0.2, 2)),
        "mode": draw(st.sampled_from(fivebar.MODES)),
    }
    p |= {f"{k}_mass": m for k, m in zip(names, (1.0, 2.0, 3.0, 4.0), strict=True)}
    p["tip_mass"] = 1.5
    first, second = draw(angles), draw(angles)
    drive_path = straight_path((first, first + draw(st.floats(-1.5, 1.5))), (second, second + 1.0))
    assume(np.abs(solve_or_reject(fivebar.solve, drive_path, **p)["assembly"]).min() > MIN_SINE)
    start = fivebar.solve(drive_path[0], **p)
    pins = (*names, "pin")
    tip_end = f"{p['left_coupler']!r} 0 0"
    payload = (
        f'<body pos="{tip_end}"><inertial pos="0 0 0" mass="1.5" diaginertia="1e-14 1e-14 1e-14"/>'
        f"</body>{massless_body(tip_end)}"
    )
    bodies = "".join(
        bar(
            f"{side}_crank",
            p[f"{side}_crank"],
            f"{p[f'{side}_x']!r} 0 0",
            mass=m,
            inside=bar(
                f"{side}_coupler",
                p[f"{side}_coupler"],
                f"{p[f'{side}_crank']!r} 0 0",
                mass=n,
                inside=more,
            ),
        )
        for side, m, n, more in (("left", 1.0, 2.0, payload), ("right", 4.0, 3.0, ""))
    )
    key = [
        first,
        float(start["left_coupler_angle"]) - first,
        second,
        float(start["right_coupler_angle"]) - second,
    ]
    model = compile_model(
        bodies,
        [("pin_root", "right_coupler_end")],
        ("left_crank", "right_crank"),
        {"tip": "left_coupler_end"},
        (),
        key,
        forces=pins,
    )
    return Linkage(
        model,
        ("left_crank", "right_crank"),
        drive_path,
        lambda *s, **more: fivebar.solve(*s, **p, **more),
        {
            **point_channels("tip", "tip"),
            **force_channels(*pins),
            "left_crank_hold": "left_moment",
            "right_crank_hold": "right_moment",
        },
    )


@st.composite
def parallel_robots(draw: st.DrawFn) -> Linkage:
    side, leg = draw(st.floats(0.3, 1.2)), draw(st.floats(0.8, 1.5))
    p = {
        "side": side,
        "leg": leg,
        "guide2_x": draw(st.floats(1.5, 3.0)),
        "guide3_x": draw(st.floats(1.0, 2.5)),
        "guide3_y": draw(st.floats(1.5, 3.0)),
        "platform_mass": 2.0,
        "leg_mass": 1.0,
        "slider_mass": 0.5,
    }
    p["mode"] = draw(st.sampled_from((1, -1)))
    firsts = [draw(st.floats(0.0, 2.0)) for _ in range(3)]
    drive_path = straight_path(*((s, s + draw(st.floats(-0.2, 0.2))) for s in firsts))
    fine = solve_or_reject(threeprr.solve, drive_path, **p)
    assume(np.abs(fine["singularity"]).min() > MIN_SINE)
    jumps = [np.abs(np.diff(fine[k])).max() for k in ("x", "y", "psi")]
    assume(max(jumps) < 0.02)  # a mode number means one branch only until another branch passes it
    start = threeprr.solve(drive_path[0], **p)
    angle = [float(start[f"leg_angle_{k}"]) for k in (1, 2, 3)]
    psi, third = float(start["psi"]), side * np.exp(1j * np.pi / 3)
    platform = (
        '<body name="platform"><joint name="platform"/>'
        f'<inertial pos="{side / 2!r} {side / 12**0.5!r} 0" mass="2" '
        f'diaginertia="1 1 {side**2 / 6!r}"/><site name="P"/><site name="P2" pos="{side!r} 0 0"/>'
        f'<site name="P3" pos="{float(third.real)!r} {float(third.imag)!r} 0"/></body>'
    )
    guides = (
        (0.0, 0.0, "1 0 0", "0 1 0"),
        (p["guide2_x"], 0.0, "-1 0 0", "0 -1 0"),
        (p["guide3_x"], p["guide3_y"], "0 -1 0", "1 0 0"),
    )
    bodies = "".join(
        f'<body name="s{k}" pos="{x!r} {y!r} 0"><joint name="s{k}" type="slide" axis="{axis}"/>'
        f'<inertial pos="0 0 0" mass="0.5" diaginertia="1 1 1"/>'
        f'<site name="guide{k}_root" xyaxes="{axis} {left}"/>'
        + bar(
            f"leg{k}",
            leg,
            mass=1.0,
            inside=massless_body(f"{leg!r} 0 0", f"pin{k}", platform if k == 1 else ""),
        )
        + "</body>"
        for k, (x, y, axis, left) in enumerate(guides, 1)
    )
    pins = ("guide", "leg", "pin")
    key = [firsts[0], angle[0], psi - angle[0], firsts[1], angle[1], firsts[2], angle[2]]
    model = compile_model(
        bodies,
        [("pin2_root", "P2"), ("pin3_root", "P3")],
        ("s1", "s2", "s3"),
        {"P": "P"},
        ("platform",),
        key,
        forces=tuple(f"{one}{k}" for one in pins for k in (1, 2, 3)),
    )
    return Linkage(
        model,
        ("s1", "s2", "s3"),
        drive_path,
        lambda *s, **more: threeprr.solve(*s, **p, **more),
        {
            "P.x": "x",
            "P_v.x": "x_rate",
            "P_a.x": "x_acceleration",
            "P.y": "y",
            "P_v.y": "y_rate",
            "P_a.y": "y_acceleration",
            **{f"s{k}_hold": f"holding_force_{k}" for k in (1, 2, 3)},
            **{
                f"{one}{k}_force.{x}": f"{one}_force_{k}_{x}"
                for one in pins
                for k in (1, 2, 3)
                for x in "xy"
            },
        },
    )


FAMILIES = {
    "four-bar": four_bars(),
    "slider-crank": slider_cranks(),
    "inverted slider-crank": inverted_slider_cranks(),
    "five-bar": five_bars(),
    "3PRR": parallel_robots(),
}
