"""Forces of pins and guides: each body of a linkage is in balance, at rest and in motion.

Every body satisfies Newton's and Euler's equations about its centre of mass, with all forces that
act on it. The drives apply the moments and forces that the closed forms compute by virtual work.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from proofmass.analytic.linkages import (
    fivebar,
    fourbar,
    inverted_slider_crank,
    slider_crank,
    swinging_block,
    threeprr,
)

GRAVITY = 3.7
STATES = pytest.mark.parametrize("inertia", [False, True], ids=["at rest", "in motion"])
GRID = np.linspace(0.0, 2.0 * np.pi, 65)
DRIVE_PROFILES = np.array(  # both inputs turn back and forth, no derivative is zero
    [
        [0.4 + 0.8 * np.sin(GRID), 1.1 - 0.5 * np.cos(GRID)],
        [2.0 + 0.8 * np.cos(GRID), -3.0 + 0.5 * np.sin(GRID)],
        [-4.0 * np.sin(GRID), 5.0 * np.cos(GRID)],
    ]
)


@dataclass(frozen=True)
class Body:
    """A body, its motion, and all forces and moments on it except its weight."""

    mass: float  # kg
    inertia: float  # about the centre of mass, kg m^2
    centre: np.ndarray  # m, as all vectors a complex number
    acceleration: np.ndarray  # of the centre, m/s^2
    turning: np.ndarray | float  # angular acceleration, rad/s^2
    pulls: tuple[tuple[np.ndarray, np.ndarray], ...]  # a force [N] and its point [m]
    moment: np.ndarray | float = 0.0  # N m


def equilibrium_error(body: Body) -> float:
    """Residual of the equations of force and moment of a body, as a share of their largest term."""
    forces = [force for force, _ in body.pulls]
    levers = [(np.conj(place - body.centre) * force).imag for force, place in body.pulls]
    needed = body.mass * (body.acceleration + 1j * GRAVITY)
    left = np.abs(sum(forces) - needed).max() / np.abs([*forces, needed]).max()
    twists = [*levers, body.moment + 0.0 * levers[0], body.inertia * body.turning + 0.0 * levers[0]]
    return max(left, np.abs(sum(twists[:-1]) - twists[-1]).max() / max(np.abs(twists).max(), 1e-9))


def bar_body(mass, ends, accelerations, turning, forces, moment=0.0):
    """A uniform bar with a force on each end."""
    first, second = ends
    inertia = mass * np.abs(second - first).max() ** 2 / 12.0
    return Body(
        mass,
        inertia,
        0.5 * (first + second),
        0.5 * sum(accelerations),
        turning,
        tuple(zip(forces, (first + 0j, second + 0j), strict=True)),
        moment,
    )


def world_force(pose, name, angle):
    """Force in the axes of the world, from its components in a frame at `angle`."""
    return (pose[f"{name}_x"] + 1j * pose[f"{name}_y"]) * np.exp(1j * angle)


def driven_arm(length, k, inertia):
    """Vector of the k-th driven arm, and the acceleration of its end, zero without inertia."""
    angle, rate, change = DRIVE_PROFILES[:, k]
    vector = length * np.exp(1j * angle)
    return vector, inertia * (1j * change - rate**2) * vector


def driven_bar(k, base, length, mass, inertia, forces, moment):
    """The k-th driven arm as a bar about its base."""
    vector, acceleration = driven_arm(length, k, inertia)
    rest = np.zeros_like(vector)
    ends = (rest + base, rest + base + vector)
    return bar_body(
        mass, ends, (rest, acceleration), inertia * DRIVE_PROFILES[2, k], forces, moment
    )


def coupler_forces(pose):
    """Force of the crank on the coupler, and of the coupler on the next body."""
    return (world_force(pose, f"{k}_force", pose["coupler_angle"]) for k in ("coupler", "pin"))


def point_motion(pose, name, inertia):
    """Position and acceleration of a point, the latter zero without inertia."""
    place = pose[f"{name}_x"] + 1j * pose[f"{name}_y"]
    return place, inertia * (pose[f"{name}_ax"] + 1j * pose[f"{name}_ay"])


def fourbar_bodies(mode, inertia):
    link = {"crank": 1.0, "coupler": 2.0, "rocker": 2.5, "ground": 3.0, "mode": mode}
    masses = {"crank_mass": 1.3, "coupler_mass": 2.1, "rocker_mass": 0.8}
    pose = fourbar.solve(
        *DRIVE_PROFILES[:, 0], **link, **masses, rocker_load=6.0, gravity=GRAVITY, inertia=inertia
    )
    (p, at_p), (q, at_q) = driven_arm(1.0, 0, inertia), point_motion(pose, "pin", inertia)
    rest = np.zeros_like(p)
    on_crank = world_force(pose, "crank_force", DRIVE_PROFILES[0, 0])
    on_rocker = world_force(pose, "rocker_force", pose["rocker_angle"])
    on_coupler, of_pin = coupler_forces(pose)
    turning = {k: inertia * pose[f"{k}_acceleration"] for k in ("coupler", "rocker")}
    return {
        "crank": driven_bar(
            0, 0.0, 1.0, 1.3, inertia, (on_crank, -on_coupler), pose["holding_moment"]
        ),
        "coupler": bar_body(2.1, (p, q), (at_p, at_q), turning["coupler"], (on_coupler, -of_pin)),
        "rocker": bar_body(
            0.8, (rest + 3.0, q), (rest, at_q), turning["rocker"], (on_rocker, of_pin), 6.0
        ),
    }


def slider_crank_bodies(mode, inertia):
    """Bodies with dry friction against the motion of each joint, and with a load on the slider."""
    link = {"crank": 0.6, "coupler": 1.8, "guide_x": 0.4, "guide_y": 0.5, "guide_angle": 0.3}
    masses = {"crank_mass": 1.3, "coupler_mass": 2.1, "slider_mass": 0.7}
    frictions = {"crank_friction": 0.6, "pin_friction": 0.4, "slider_friction": 1.1}
    pose = slider_crank.solve(
        *DRIVE_PROFILES[:, 0],
        **link,
        **masses,
        **frictions,
        mode=mode,
        slider_load=-3.0,
        gravity=GRAVITY,
        inertia=inertia,
    )
    (p, at_p), (s, at_s) = driven_arm(0.6, 0, inertia), point_motion(pose, "slider", inertia)
    of_guide = world_force(pose, "guide_force", 0.3)
    on_crank = world_force(pose, "crank_force", DRIVE_PROFILES[0, 0])
    on_coupler, of_pin = coupler_forces(pose)
    # along the guide there are its friction and the load
    rubs = np.sign(pose["slide_rate"])
    assert set(rubs) == {-1.0, 1.0}
    np.testing.assert_allclose(pose["guide_force_x"], -3.0 - 1.1 * rubs, rtol=0, atol=1e-13)
    # moment of the crank on the coupler
    on_pin = -0.4 * np.sign(pose["coupler_rate"] - DRIVE_PROFILES[1, 0])
    turning = inertia * pose["coupler_acceleration"]
    return {
        "crank": driven_bar(
            0,
            0.0,
            0.6,
            1.3,
            inertia,
            (on_crank, -on_coupler),
            pose["holding_moment"] - 0.6 * np.sign(DRIVE_PROFILES[1, 0]) - on_pin,
        ),
        "coupler": bar_body(2.1, (p, s), (at_p, at_s), turning, (on_coupler, -of_pin), on_pin),
        "slider": Body(0.7, 0.0, s, at_s, 0.0, ((of_guide, s), (of_pin, s))),
    }


def inverted_slider_crank_bodies(mode, inertia):
    link = {"crank": 0.6, "bar": 0.5, "rod": 2.4, "ground_x": 1.9, "ground_y": 0.7, "mode": mode}
    masses = {"crank_mass": 1.3, "bar_mass": 0.8, "rod_mass": 2.1, "slider_mass": 0.7}
    pose = inverted_slider_crank.solve(
        *DRIVE_PROFILES, **link, **masses, slider_inertia=0.4, gravity=GRAVITY, inertia=inertia
    )
    ground = complex(link["ground_x"], link["ground_y"])
    (p, at_p), (s, at_s) = (driven_arm(link[k], i, inertia) for i, k in enumerate(("crank", "bar")))
    s = s + ground
    end, at_e = point_motion(pose, "end", inertia)
    turning, rest = inertia * pose["rod_acceleration"], np.zeros_like(p)
    on_crank, on_bar = (
        world_force(pose, f"{k}_force", DRIVE_PROFILES[0, i])
        for i, k in enumerate(("crank", "bar"))
    )
    on_rod, of_guide, of_pin = (
        world_force(pose, f"{k}_force", pose["rod_angle"]) for k in ("rod", "guide", "pin")
    )
    crank = driven_bar(
        0, 0.0, link["crank"], 1.3, inertia, (on_crank, -on_rod), pose["holding_moment"]
    )
    driven = driven_bar(
        1, ground, link["bar"], 0.8, inertia, (on_bar, of_pin), pose["holding_moment_bar"]
    )
    rod = bar_body(2.1, (p, end), (at_p, at_e), turning, (on_rod, rest), -pose["guide_moment"])
    rod = replace(rod, pulls=((on_rod, p), (-of_guide, s)))
    slider = Body(0.7, 0.4, s, at_s, turning, ((of_guide, s), (-of_pin, s)), pose["guide_moment"])
    return {"crank": crank, "bar": driven, "rod": rod, "slider": slider}


def fivebar_bodies(mode, inertia):
    link = {
        "left_crank": 1.2,
        "left_coupler": 2.6,
        "right_coupler": 2.4,
        "right_crank": 1.0,
        "left_x": -1.25,
        "right_x": 1.25,
        "mode": mode,
    }
    names = ("left_crank", "left_coupler", "right_coupler", "right_crank", "tip")
    masses = dict(zip(names, (1.3, 2.1, 0.7, 0.4, 0.9), strict=True))
    pose = fivebar.solve(
        *DRIVE_PROFILES,
        **link,
        **{f"{name}_mass": mass for name, mass in masses.items()},
        force_x=3.0,
        force_y=-5.0,
        gravity=GRAVITY,
        inertia=inertia,
    )
    tip, at_tip = point_motion(pose, "tip", inertia)
    rest = np.zeros_like(tip)
    of_pin, found = world_force(pose, "pin_force", pose["left_coupler_angle"]), {}
    for k, (side, at_pin) in enumerate((("left", -of_pin), ("right", of_pin))):
        base = rest + link[f"{side}_x"]
        vector, acceleration = driven_arm(link[f"{side}_crank"], k, inertia)
        on_crank = world_force(pose, f"{side}_crank_force", DRIVE_PROFILES[0, k])
        on_coupler = world_force(pose, f"{side}_coupler_force", pose[f"{side}_coupler_angle"])
        found[f"{side}_crank"] = driven_bar(
            k,
            link[f"{side}_x"],
            link[f"{side}_crank"],
            masses[f"{side}_crank"],
            inertia,
            (on_crank, -on_coupler),
            pose[f"{side}_moment"],
        )
        found[f"{side}_coupler"] = bar_body(
            masses[f"{side}_coupler"],
            (base + vector, tip),
            (acceleration, at_tip),
            inertia * pose[f"{side}_coupler_acceleration"],
            (on_coupler, at_pin),
        )
    # the left coupler carries the tip's mass and force
    load = 3.0 - 5.0j - masses["tip"] * (at_tip + 1j * GRAVITY)
    left = found["left_coupler"]
    found["left_coupler"] = replace(left, pulls=(*left.pulls, (load, tip)))
    return found


def threeprr_bodies(mode, inertia):
    where = {"side": 1.0, "leg": 1.1, "guide2_x": 3.0, "guide3_x": 2.5, "guide3_y": 2.8}
    profiles = np.array(
        [
            [2.0 + 0.1 * np.sin(GRID), 0.5 - 0.1 * np.cos(GRID), 0.2 + 0.1 * np.sin(2 * GRID)],
            [3.0 + np.cos(GRID), -2.0 + np.sin(GRID), 1.0 - np.cos(GRID)],
            [-4.0 * np.sin(GRID), 5.0 * np.cos(GRID), 3.0 * np.sin(GRID)],
        ]
    )
    pose = threeprr.solve(
        *profiles,
        **where,
        mode=mode,
        platform_mass=2.0,
        leg_mass=0.7,
        slider_mass=0.5,
        load_x=3.0,
        load_y=-2.0,
        load_moment=1.5,
        gravity=GRAVITY,
        inertia=inertia,
    )
    p, turning = pose["x"] + 1j * pose["y"], inertia * pose["psi_acceleration"]
    at_p = inertia * (pose["x_acceleration"] + 1j * pose["y_acceleration"])
    spin = 1j * turning - inertia * pose["psi_rate"] ** 2
    unit = where["side"] * np.exp(1j * pose["psi"])
    arms = [0.0 * unit, unit, unit * np.exp(1j * np.pi / 3)]
    found, on_platform = {}, []
    for k, (arm_k, origin, guide) in enumerate(
        zip(arms, (0.0, 3.0, 2.5 + 2.8j), (1.0, -1.0, -1.0j), strict=True)
    ):
        slider, at_slider = origin + profiles[0, k] * guide, inertia * profiles[2, k] * guide
        angle = pose[f"leg_angle_{k + 1}"]
        of_guide = world_force(pose, f"guide_force_{k + 1}", np.angle(guide))
        on_leg, of_leg = (world_force(pose, f"{n}_force_{k + 1}", angle) for n in ("leg", "pin"))
        found[f"slider {k + 1}"] = Body(
            0.5, 0.0, slider, at_slider, 0.0, ((of_guide, slider), (-on_leg, slider))
        )
        found[f"leg {k + 1}"] = bar_body(
            0.7,
            (slider, p + arm_k),
            (at_slider, at_p + spin * arm_k),
            inertia * pose[f"leg_angle_{k + 1}_acceleration"],
            (on_leg, -of_leg),
        )
        on_platform.append((of_leg, p + arm_k))
        # the force along the guide is the drive's force by virtual work
        along = pose[f"guide_force_{k + 1}_x"]
        np.testing.assert_allclose(along, pose[f"holding_force_{k + 1}"], rtol=0, atol=1e-12)
    middle = sum(arms) / 3.0
    found["platform"] = Body(
        2.0,
        2.0 * where["side"] ** 2 / 12.0,
        p + middle,
        at_p + spin * middle,
        turning,
        (*on_platform, (3.0 - 2.0j + 0.0 * p, p)),
        1.5,
    )
    return found


LINKAGES = {
    "four-bar": (fourbar_bodies, fourbar.MODES),
    "slider-crank": (slider_crank_bodies, slider_crank.MODES),
    "inverted slider-crank": (inverted_slider_crank_bodies, inverted_slider_crank.MODES),
    "five-bar": (fivebar_bodies, fivebar.MODES),
    "3PRR": (threeprr_bodies, (1, -1)),
}
EACH_MODE_OF_EACH_LINKAGE = pytest.mark.parametrize(
    ("linkage", "mode"), [(name, mode) for name, (_, modes) in LINKAGES.items() for mode in modes]
)


@STATES
@EACH_MODE_OF_EACH_LINKAGE
def test_every_body_is_in_balance(linkage, mode, inertia):
    """The residual is rounding: at most 40 eps of the largest force or moment on the body."""
    for name, body in LINKAGES[linkage][0](mode, inertia).items():
        assert equilibrium_error(body) < 2e-14, name


@STATES
@EACH_MODE_OF_EACH_LINKAGE
def test_the_ground_carries_weight_and_inertia_of_all_bodies(linkage, mode, inertia):
    """Forces between bodies cancel: the sum of all forces is that from outside the linkage."""
    bodies = LINKAGES[linkage][0](mode, inertia).values()
    forces = np.array([force for body in bodies for force, _ in body.pulls])
    needed = sum(body.mass * (body.acceleration + 1j * GRAVITY) for body in bodies)
    bound = 1e-14 * np.abs(forces).max()
    np.testing.assert_allclose(forces.sum(axis=0), needed, rtol=0, atol=bound)


MUTATIONS = {  # attribute that must not be zero, and the mutation
    "mass": ("mass", lambda body: replace(body, mass=1.001 * body.mass)),
    "inertia": ("turning", lambda body: replace(body, inertia=1.01 * body.inertia)),
    "centre of mass": ("mass", lambda body: replace(body, centre=body.centre + 1e-3)),
    "gravity": ("mass", lambda body: replace(body, acceleration=body.acceleration + 1e-2j)),
    "moment": ("moment", lambda body: replace(body, moment=1.001 * body.moment)),
    "sign": (
        "mass",
        lambda body: replace(body, pulls=((-body.pulls[0][0], body.pulls[0][1]), *body.pulls[1:])),
    ),
}


@pytest.mark.parametrize("how", MUTATIONS)
@pytest.mark.parametrize("linkage", LINKAGES)
def test_every_wrong_number_leaves_its_body_out_of_balance(linkage, how):
    bodies, modes = LINKAGES[linkage]
    needed, wrong = MUTATIONS[how]
    errors = {
        name: equilibrium_error(wrong(body))
        for name, body in bodies(modes[0], True).items()
        if np.any(getattr(body, needed))
    }
    assert errors
    assert min(errors.values()) > 1e-5, errors  # a body in balance leaves 1e-14


def test_swinging_block_has_the_forces_of_an_inverted_slider_crank():
    """The pivot carries the force of the bar's tip and the weight of the block."""
    ground, bar_vector = 1.9 + 0.7j, 0.5 * np.exp(0.8j)
    angle, rate, change = DRIVE_PROFILES[:, 0]
    zeros = np.zeros_like(angle)
    shared = {"crank": 0.6, "rod": 2.4, "crank_mass": 1.3, "rod_mass": 2.1, "gravity": GRAVITY}
    pivot = ground + bar_vector
    for inertia in (False, True):
        classic = swinging_block.solve(
            angle,
            rate,
            change,
            **shared,
            pivot_x=pivot.real,
            pivot_y=pivot.imag,
            block_mass=0.7,
            block_inertia=0.4,
            inertia=inertia,
        )
        whole = inverted_slider_crank.solve(
            [angle, zeros + 0.8],
            [rate, zeros],
            [change, zeros],
            **shared,
            bar=0.5,
            ground_x=ground.real,
            ground_y=ground.imag,
            slider_mass=0.7,
            slider_inertia=0.4,
            bar_mass=5.0,
            inertia=inertia,
        )
        names = [name for name in classic if "_force_" in name or name == "guide_moment"]
        assert len(names) == 9
        for name in names:
            size = np.abs(whole[name]).max()
            np.testing.assert_allclose(classic[name], whole[name], rtol=0, atol=1e-13 * size)


SOLVERS_WITH_LOADS = {
    "inverted slider-crank": (
        inverted_slider_crank.solve,
        DRIVE_PROFILES[0],
        {"crank": 0.6, "bar": 0.5, "rod": 2.4, "ground_x": 1.9, "rod_mass": 2.0},
    ),
    "five-bar": (
        fivebar.solve,
        DRIVE_PROFILES[0],
        {
            "left_crank": 1.2,
            "left_coupler": 2.6,
            "right_coupler": 2.4,
            "right_crank": 1.0,
            "left_x": -1.25,
            "right_x": 1.25,
            "tip_mass": 2.0,
        },
    ),
    "3PRR": (
        threeprr.solve,
        [2.0, 0.5, 0.2],
        {
            "side": 1.0,
            "leg": 1.0,
            "guide2_x": 3.0,
            "guide3_x": 2.5,
            "guide3_y": 2.8,
            "leg_mass": 1.0,
        },
    ),
}


@pytest.mark.parametrize("linkage", SOLVERS_WITH_LOADS)
def test_loads_are_computed_only_on_request_with_the_same_values(linkage):
    solve, inputs, parameters = SOLVERS_WITH_LOADS[linkage]
    whole = solve(inputs, **parameters)
    loads = {name for name in whole if "_force_" in name or "moment" in name}
    assert solve(inputs, **parameters, only={"pin_distance"}).keys() == whole.keys() - loads
    for name in loads:
        some = solve(inputs, **parameters, only={name})
        np.testing.assert_array_equal(some[name], whole[name])
        pins = {each for each in some if "pin_force" in each}
        assert bool(pins) == (not name.startswith(("holding", "left_moment", "right_moment")))
