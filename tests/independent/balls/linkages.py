"""The loops of the linkages with closed forms, written as sums of vectors.

Nothing is taken from the closed forms but the names of parameters and curves.
"""

from collections.abc import Sequence

from flint import acb, acb_series, arb

from tests.independent.balls.loops import (
    GROUND,
    IMAGINARY,
    AppliedLoad,
    CaseNumbers,
    DryFriction,
    Form,
    Inertia,
    Loops,
    Reaction,
    turn,
)

Variables = Sequence[acb_series]


def arm(p: CaseNumbers, name: str, angle: acb_series) -> acb_series:
    """A bar as a vector: its length is a parameter."""
    return acb(arb(p[name])) * turn(angle)


def fourbar(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drive: crank; unknowns: angles of coupler and rocker."""
    crank, coupler, rocker = arm(p, "crank", u[0]), arm(p, "coupler", q[0]), arm(p, "rocker", q[1])
    ground = acb(arb(p["ground"])) * (IMAGINARY * acb(arb(p["ground_angle"]))).exp()
    loops = Loops([crank + coupler - rocker - ground], {"holding_moment": 0})
    if not whole:
        return loops
    origin, pivot = 0 * crank, 0 * crank + ground
    loops.add_scalar("coupler", q[0], "{}_angle")
    loops.add_scalar("rocker", q[1], "{}_angle")
    loops.add_point("pin", rocker + ground)
    loops.add_point("point", crank + turn(q[0]) * p.complex("point_along", "point_across"))
    loops.add_bar(p, "crank", origin, crank, u[0])
    loops.add_bar(p, "coupler", crank, coupler, q[0])
    loops.add_bar(p, "rocker", pivot, rocker, q[1])
    loops.loads.append(AppliedLoad(acb(arb(p["rocker_load"])), q[1], "rocker", is_moment=True))
    loops.motors["holding_moment"] = "crank"
    loops.add_pin("crank", "crank", GROUND, origin, u[0])
    loops.add_pin("coupler", "coupler", "crank", crank, q[0])
    loops.add_pin("rocker", "rocker", GROUND, pivot, q[1])
    loops.add_pin("pin", "rocker", "coupler", rocker + ground, q[0])
    return loops


def slider_crank(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drive: crank; unknowns: angle of the coupler, place of the slider along its guide."""
    guide = 0 * q[1] + acb(arb(p["guide_angle"]))
    crank, coupler = arm(p, "crank", u[0]), arm(p, "coupler", q[0])
    slider = q[1] * turn(guide) + p.complex("guide_x", "guide_y")
    loops = Loops([crank + coupler - slider], {"holding_moment": 0})
    if not whole:
        return loops
    loops.add_scalar("coupler", q[0], "{}_angle")
    loops.add_scalar("slide", q[1])
    loops.add_point("slider", slider)
    loops.add_point("point", crank + turn(q[0]) * p.complex("point_along", "point_across"))
    add_crank_and_slider(loops, p, u[0], q[0], slider, guide, p["slider_load"])
    loops.loads.append(AppliedLoad(acb(arb(p["slider_load"])), q[1]))
    bearing, pin, rub = (arb(p[f"{name}_friction"]) for name in ("crank", "pin", "slider"))
    if bearing != 0 or pin != 0 or rub != 0:
        loops.frictions = [
            DryFriction(bearing, u[0], "crank"),
            DryFriction(pin, q[0] - u[0], "coupler", "crank"),
            DryFriction(rub, q[1], reaction="guide_force"),
        ]
    return loops


def add_crank_and_slider(
    loops: Loops,
    p: CaseNumbers,
    crank_angle: acb_series,
    coupler_angle: acb_series,
    slider: acb_series,
    guide: acb_series,
    load: float,
) -> None:
    """Add masses and forces of a slider-crank with a load on the slider, along its guide."""
    crank, coupler = arm(p, "crank", crank_angle), arm(p, "coupler", coupler_angle)
    loops.add_bar(p, "crank", 0 * crank, crank, crank_angle)
    loops.add_bar(p, "coupler", crank, coupler, coupler_angle)
    loops.masses.append(point_mass("slider", p["slider_mass"], slider))
    loops.motors["holding_moment"] = "crank"
    loops.add_pin("crank", "crank", GROUND, 0 * crank, crank_angle)
    loops.add_pin("coupler", "coupler", "crank", crank, coupler_angle)
    loops.add_pin("pin", "slider", "coupler", slider, coupler_angle)
    loops.reactions.append(
        Reaction("guide_force", "slider", GROUND, slider, guide, along=arb(load))
    )


def point_mass(body: str, mass: float, point: acb_series) -> Inertia:
    """A mass at a point of a body."""
    return Inertia(body, arb(mass), point, arb(0), 0 * point, turns=False)


def hacksaw(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drive: crank; unknowns: polar length and angle of the slider, coupler's angle, slide."""
    crank, coupler = arm(p, "crank", u[0]), arm(p, "coupler", q[2])
    slider = q[0] * turn(q[1])
    guided = q[3] + acb(0, arb(p["offset"]))
    loops = Loops([crank + coupler - slider, slider - guided], {"holding_moment": 0})
    if not whole:
        return loops
    for name, one in zip(("r1", "theta1", "theta3"), q[:3], strict=True):
        loops.add_scalar(name, one)
    for order, name in enumerate(("slider_x", "slider_velocity", "slider_acceleration")):
        loops.channels[name] = q[3], order, "real"
    add_crank_and_slider(loops, p, u[0], q[2], guided, 0 * guided, p["cutting_force"])
    loops.loads.append(AppliedLoad(acb(arb(p["cutting_force"])), q[3]))
    return loops


def fivebar(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drives: two cranks; unknowns: angles of the couplers."""
    left, right = arm(p, "left_crank", u[0]), arm(p, "right_crank", u[1])
    along, back = arm(p, "left_coupler", q[0]), arm(p, "right_coupler", q[1])
    a, b = acb(arb(p["left_x"])), acb(arb(p["right_x"]))
    tip = left + a + along
    loops = Loops([tip - right - b - back], {"left_moment": 0, "right_moment": 1})
    if not whole:
        return loops
    loops.add_scalar("left_coupler", q[0], "{}_angle")
    loops.add_scalar("right_coupler", q[1], "{}_angle")
    loops.add_point("tip", tip)
    loops.add_bar(p, "left_crank", 0 * left + a, left, u[0])
    loops.add_bar(p, "right_crank", 0 * right + b, right, u[1])
    loops.add_bar(p, "left_coupler", left + a, along, q[0])
    loops.add_bar(p, "right_coupler", right + b, back, q[1])
    loops.masses.append(point_mass("left_coupler", p["tip_mass"], tip))
    loops.loads.append(AppliedLoad(p.complex("force_x", "force_y"), tip, "left_coupler"))
    loops.motors |= {"left_moment": "left_crank", "right_moment": "right_crank"}
    loops.add_pin("left_crank", "left_crank", GROUND, 0 * left + a, u[0])
    loops.add_pin("right_crank", "right_crank", GROUND, 0 * right + b, u[1])
    loops.add_pin("left_coupler", "left_coupler", "left_crank", left + a, q[0])
    loops.add_pin("right_coupler", "right_coupler", "right_crank", right + b, q[1])
    loops.add_pin("pin", "right_coupler", "left_coupler", tip, q[0])
    return loops


def inverted_slider_crank(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drives: crank and bar; unknowns: angle of the rod, place of the slider on it."""
    crank, bar = arm(p, "crank", u[0]), arm(p, "bar", u[1])
    ground = p.complex("ground_x", "ground_y")
    slider = bar + ground
    moments = {"holding_moment": 0, "holding_moment_bar": 1}
    loops = Loops([crank + q[1] * turn(q[0]) - slider], moments)
    if not whole:
        return loops
    add_rod(loops, p, u[0], q, slider, ("slider_mass", "slider_inertia"))
    loops.add_point("slider", slider)
    loops.add_bar(p, "bar", 0 * bar + ground, bar, u[1])
    loops.motors["holding_moment_bar"] = "bar"
    loops.add_pin("bar", "bar", GROUND, 0 * bar + ground, u[1])
    loops.add_pin("pin", "bar", "slider", slider, q[0])
    return loops


def add_rod(
    loops: Loops,
    p: CaseNumbers,
    crank_angle: acb_series,
    q: Variables,
    slider: acb_series,
    names: tuple[str, str],
) -> None:
    """Add crank, rod and the slider that turns with the rod: curves, masses and forces."""
    crank, rod = arm(p, "crank", crank_angle), arm(p, "rod", q[0])
    loops.add_scalar("rod", q[0], "{}_angle")
    loops.add_scalar("slide", q[1])
    loops.add_point("end", crank + rod)
    loops.add_bar(p, "crank", 0 * crank, crank, crank_angle)
    loops.add_bar(p, "rod", crank, rod, q[0])
    mass, inertia = (arb(p[name]) for name in names)
    loops.masses.append(Inertia("slider", mass, slider, inertia, q[0]))
    loops.motors["holding_moment"] = "crank"
    loops.add_pin("crank", "crank", GROUND, 0 * crank, crank_angle)
    loops.add_pin("rod", "rod", "crank", crank, q[0])
    loops.reactions.append(
        Reaction("guide_force", "slider", "rod", slider, q[0], arb(0), "guide_moment")
    )


def swinging_block(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drive: crank; unknowns: angle of the rod, place of the block on it."""
    crank = arm(p, "crank", u[0])
    block = 0 * crank + p.complex("pivot_x", "pivot_y")
    loops = Loops([crank + q[1] * turn(q[0]) - block], {"holding_moment": 0})
    if not whole:
        return loops
    add_rod(loops, p, u[0], q, block, ("block_mass", "block_inertia"))
    loops.reactions.append(Reaction("pin_force", GROUND, "slider", block, q[0]))
    return loops


def threeprr(p: CaseNumbers, u: Variables, q: Variables, whole: bool) -> Loops:
    """Drives: three sliders; unknowns: x, y and angle of the platform, angles of the legs."""
    place, psi, legs = q[0] + IMAGINARY * q[1], q[2], q[3:]
    starts = acb(0), acb(arb(p["guide2_x"])), p.complex("guide3_x", "guide3_y")
    side, zero = acb(arb(p["side"])), 0 * psi
    corners = [place, place + side * turn(psi), place + side * turn(psi + acb(arb.pi() / 3))]
    guides = [zero, zero + acb(arb.pi()), zero - acb(arb.pi() / 2)]
    sliders = [zero + o + s * turn(g) for o, s, g in zip(starts, u, guides, strict=True)]
    bars = [acb(arb(p["leg"])) * turn(angle) for angle in legs]
    loops = Loops(
        [a + b - c for a, b, c in zip(sliders, bars, corners, strict=True)],
        {f"holding_force_{k + 1}": k for k in range(3)},
    )
    if not whole:
        return loops
    for name, one in (("x", q[0]), ("y", q[1]), ("psi", psi)):
        loops.add_scalar(name, one)
    centre = place + side * turn(psi + acb(arb.pi() / 6)) * acb(1 / arb(3).sqrt())
    mass, length = arb(p["platform_mass"]), arb(p["side"])
    loops.masses.append(Inertia("platform", mass, centre, mass * length * length / 12, psi))
    loops.loads.append(AppliedLoad(p.complex("load_x", "load_y"), place, "platform"))
    loops.loads.append(AppliedLoad(acb(arb(p["load_moment"])), psi, "platform", is_moment=True))
    for k, (start, bar, corner) in enumerate(zip(sliders, bars, corners, strict=True)):
        number, angle = k + 1, legs[k]
        loops.add_scalar(f"leg_angle_{number}", angle)
        leg_mass = arb(p["leg_mass"])
        inertia = leg_mass * arb(p["leg"]) * arb(p["leg"]) / 12
        middle = start + bar * acb(0.5)
        loops.masses.append(Inertia(f"leg_{number}", leg_mass, middle, inertia, angle))
        loops.masses.append(point_mass(f"slider_{number}", p["slider_mass"], start))
        for name, on, by, point, frame in (
            ("pin", "platform", f"leg_{number}", corner, angle),
            ("leg", f"leg_{number}", f"slider_{number}", start, angle),
            ("guide", f"slider_{number}", GROUND, start, guides[k]),
        ):
            loops.reactions.append(Reaction(f"{name}_force_{number}", on, by, point, frame))
    return loops


FORMS: dict[str, tuple[Form, tuple[str, ...]]] = {
    "fourbar": (fourbar, ("coupler_angle", "rocker_angle")),
    "slider_crank": (slider_crank, ("coupler_angle", "slide")),
    "hacksaw": (hacksaw, ("r1", "theta1", "theta3", "slider_x")),
    "fivebar": (fivebar, ("left_coupler_angle", "right_coupler_angle")),
    "inverted_slider_crank": (inverted_slider_crank, ("rod_angle", "slide")),
    "swinging_block": (swinging_block, ("rod_angle", "slide")),
    "threeprr": (threeprr, ("x", "y", "psi", "leg_angle_1", "leg_angle_2", "leg_angle_3")),
}
"""The loops of a reference, and its curves from which the search of the unknowns starts."""
