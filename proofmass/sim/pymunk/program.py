"""Write a run of pymunk as a separate program that imports numpy and pymunk but not proofmass."""

import ast
import keyword
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pymunk

from proofmass.analytic.numerics import Array
from proofmass.sim.program_text import escaped, template
from proofmass.sim.protocol import BadSetting, Imposed, Run, Unsupported, drive_columns
from proofmass.sim.pymunk.contacts import ContactShape
from proofmass.sim.pymunk.dynamics import OPEN_LOOP, SURE, start_state
from proofmass.sim.pymunk.links import Hold, LinkGear, LinkJoint, Links, LinkSpring
from proofmass.sim.pymunk.loads import at_start, changing_forces, followed, names_of
from proofmass.sim.pymunk.model import find_channels, read_model, with_controls
from proofmass.sim.pymunk.read import (
    Direction,
    Level,
    LinkSpringLength,
    PointPlace,
    Potential,
    Sensor,
    Turn,
    Value,
    weights,
)
from proofmass.sim.pymunk.read import channel as channel_of
from proofmass.sim.pymunk.space import (
    REACH,
    STOPS,
    HingeDrive,
    Motor,
    Settings,
    SlideDrive,
    add_drives,
    at,
    build,
    constraints,
)

IMPOSED = Imposed("gear"), Imposed("motor")
"""The ways in which a program can prescribe the motion of a hinge: a gear whose phase is moved, or
a motor whose rate is set before each step.  For slides a groove is moved in both."""
WIDE = 100
"""Line length of the program; only lines that cannot be broken are longer."""
ZERO = 1e-15
"""Components of unit vectors that differ by less from 0 or from 1 are printed as 0 or 1."""
FORCE = -2
"""`Sensor.order` of the force of a drive."""
UNIT = {True: ("rad", "N m"), False: ("m", "N")}
"""Units of the coordinate and of the force of a joint, by whether it is a hinge."""


def write_program(
    model: Path,
    run: Run,
    motion: str,
    head: str,
    drive: Imposed = IMPOSED[0],
    controls: str = "",
) -> str:
    """Write a program that runs the same steps as `proofmass.sim.pymunk.engine.simulate`.

    Parameters
    ----------
    model : Path
        The MJCF file.
    run : Run
        A dynamics run; its settings must have ``iterations`` or ``defaults``.
    motion : str
        Source of ``motion(t)``: values [rad or m], rates and accelerations (drives, n) of the
        drives at times (n,) [s]; empty for a free motion.
    head : str
        Docstring of the program.
    drive : Imposed, optional
        The way in which it moves driven hinges, one of `IMPOSED`.
    controls : str, optional
        Source of ``controls(t)``: controls (loads, n) of the loads of the run at times (n,) [s].

    Returns
    -------
    str
        Python source.  ``python run.py [FILE]`` writes the channels that pymunk delivers, at the
        samples, to a CSV file, and prints the number of steps and their wall time [s].  If the run
        fails, it prints an error and ends with exit code 1.

    Raises
    ------
    Unsupported
        The run is not a dynamics run, or a slide is to be driven by a motor.
    BadSetting
        A setting is missing or out of range.
    BadModel
        See `proofmass.sim.pymunk.engine.simulate`.
    """
    if drive not in IMPOSED:
        raise ValueError(
            f"a drive by {drive.kind!r}; known: {', '.join(one.kind for one in IMPOSED)}"
        )
    if run.kind != "dynamics":
        raise Unsupported(f"a program in pymunk of another run than dynamics, such as {run.kind}")
    links, settings = read_model(model, run)
    links = at_start(links, run)
    if settings["iterations"] is None:
        raise BadSetting("iterations", "missing; a program needs their number")
    if drive.kind == "motor":
        for joint in links.drives:
            if joint.hold.axis is not None:
                raise Unsupported(
                    f"a motor on slide joint '{joint.name}': pymunk has none that "
                    f"moves along a line"
                )
    plain = [f"body_{k}_of_{len(links.mass)}" for k in range(len(links.mass) + 1)]
    taken = {
        *names_in(_rendered(links, run, settings, motion, head, drive.kind, plain, controls)),
        *keyword.kwlist,
    } - set(plain)
    names = body_names(links, taken)
    return _rendered(links, run, settings, motion, head, drive.kind, names, controls)


def names_in(program: str) -> set[str]:
    """All names of variables, functions, parameters and imports in a program."""
    tree = list(ast.walk(ast.parse(program)))
    return {
        *(node.id for node in tree if isinstance(node, ast.Name)),
        *(node.arg for node in tree if isinstance(node, ast.arg)),
        *(node.name for node in tree if isinstance(node, ast.FunctionDef)),
        *(node.asname or node.name for node in tree if isinstance(node, ast.alias)),
    }


def body_names(links: Links, taken: Iterable[str]) -> list[str]:
    """Names of variables for all links and the ground, which are all different.

    None of them is in `taken`.  A link has the name of its first body, or that of the body's
    joint if the body has no name.
    """
    found: list[str] = []
    for k in range(len(links.mass)):
        body = int(np.flatnonzero(links.of_body == k)[0])
        name = (
            links.model.body(body).name
            or links.model.joint(int(links.model.body_jntadr[body])).name
        )
        found.append(free_name(name, {*taken, *found}))
    return [*found, free_name("ground", {*taken, *found})]


def free_name(name: str, taken: set[str]) -> str:
    """A valid name of a variable that is not in `taken`, from the name of a body.

    >>> free_name("left crank", set()), free_name("3rd", set()), free_name("time", {"time"})
    ('left_crank', 'body_3rd', 'time_body')
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.match("[A-Za-z]", name):
        name = f"body_{name.strip('_')}".rstrip("_")
    if name in taken:
        name = f"{name}_body"
    tried, k = name, 2
    while tried in taken:
        tried, k = f"{name}_{k}", k + 1
    return tried


def format_comment(name: str) -> str:
    """A name as it is written in a comment: on one line, with special characters escaped."""
    return escaped(repr(name)[1:-1]).replace("\\\\", "\\").replace("\n", " ")


def digits(number: float) -> str:
    """A number with all its digits, -0.0 as 0.0."""
    return repr(float(number) + 0.0)


def format_numbers(numbers: Iterable[float]) -> str:
    """Numbers as the source of a list, with infinity as ``np.inf``.

    >>> format_numbers([-np.inf, 2.5])
    '[-np.inf, 2.5]'
    """
    return f"[{', '.join(map(digits, numbers))}]".replace("inf", "np.inf")


def tupled(numbers: Iterable[float]) -> str:
    """Numbers as the source of a tuple."""
    return f"({', '.join(map(digits, numbers))})"


def summed(terms: Iterable[tuple[float, str]], level: float = 0.0) -> str:
    """The source of a sum: `level` plus products of factors and terms.

    Terms whose factor is at most `ZERO` are left out.

    >>> summed([(1.0, "x"), (0.0, "y")]), summed([(-0.5, "x"), (-1.0, "y")], 2.0)
    ('x', '2.0 - 0.5 * x - y')
    """
    text = digits(level) if level else ""
    for share, term in terms:
        if abs(share) <= ZERO:
            continue
        size = "" if abs(abs(share) - 1.0) <= ZERO else f"{digits(abs(share))} * "
        between = (" + ", " - ") if text else ("", "-")
        text += f"{between[share < 0]}{size}{term}"
    return text or "0.0"


def wrapped(text: str, first: int = 0, indent: int = 4) -> str:
    """Break an expression into lines at its blanks, but not within a tuple.

    The expression must be in brackets and without strings.  The first line is broken as if it were
    indented by `first`; the other lines are indented by `indent`.
    """
    whole = re.sub(r"(?<!\w)\([^()]*\)", lambda found: found[0].replace(" ", "\0"), text)
    return (
        fill(
            whole,
            WIDE,
            initial_indent=" " * first,
            subsequent_indent=" " * indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        .strip()
        .replace("\0", " ")
    )


def changing(terms: list[tuple[float, str]], level: float) -> str:
    """The source of a sum as in `summed`, but always an array over the poses."""
    if all(abs(share) <= ZERO for share, _ in terms):
        return f"np.full(len(pose), {digits(level)})"
    return summed(terms, level)


def comment(text: str, indent: int = 0) -> str:
    """A text as the lines of a comment."""
    return fill(
        text,
        WIDE,
        initial_indent=" " * indent + "# ",
        break_on_hyphens=False,
        subsequent_indent=" " * indent + "# ",
        break_long_words=False,
    )


def less(text: str, number: float) -> str:
    """The source of a term less a number.

    >>> less("x", 0.0), less("x", -1.8)
    ('x', 'x + 1.8')
    """
    return text if number == 0 else f"{text} {'-' if number > 0 else '+'} {digits(abs(number))}"


def _rendered(
    links: Links,
    run: Run,
    settings: dict[str, Any],
    motion: str,
    head: str,
    drive: str,
    names: Sequence[str],
    controls: str,
) -> str:
    """The program with given names of variables for the links and the ground."""
    writer = Writer(links, tuple(names), levels_of(links, run))
    per, dt = run.steps(settings["timestep"])
    pose, velocity, _ = start_state(links, run, per, dt)
    space = build(links, settings["iterations"], settings["error_bias"])
    motors = add_drives(space, links)
    parts = list(writer.parts(space))
    limited = any(joint.limits for joint in links.joints)  # then stops may exert forces too
    channels = {
        repr(name): writer.channel(name, channel)
        for name, channel in [*find_channels(links, run)[0].items(), *drive_channels(links)]
        if channel.order > -2 or (channel.order == FORCE and not limited)
    }
    asks_energy = any("value(potential)" in text for text in channels.values())
    potential = writer.potential() if asks_energy else None
    written = "\n".join(
        [
            *channels.values(),
            *(line for part in parts for line in part["lines"]),
            *(potential["springs"] if potential else ()),
        ]
    )
    drives = [
        writer.drive(k, joint, motor, drive)
        for k, (joint, motor) in enumerate(zip(links.drives, motors, strict=True))
    ]
    needs = {
        word
        for word in (
            "spring_force",
            "beyond",
            "apart",
            "slid",
            "kinetic",
            "unwrapped",
            "value",
            "rate",
            "acceleration",
            "force",
        )
        if re.search(rf"\b{word}\(", written)
    }
    forces = writer.forces() if "force" in needs else None
    changing = writer.changing(run, controls) if run.loads else None
    if forces:
        rows = [*forces["springs"], *(changing["forces"] if changing else ())]
        asked = "\n".join([*forces["driven"], *(row["value"] for row in rows)])
        needs |= {word for word in ("slid", "apart", "beyond") if f"{word}(" in asked}
        needs |= {"along"} | ({"spring_force"} if forces["springs"] else set())
    needs |= {"along"} if needs & {"rate", "acceleration"} else set()
    needs |= {"ahead"} if drive == "motor" else set()
    return template("pymunk.py.jinja", comment=comment).render(
        docstring=f'"""{escaped(head).strip()}\n"""\n' if head.strip() else "",
        motion=motion.strip("\n"),
        dt=digits(dt),
        iterations=settings["iterations"],
        first=max(SURE, 10 * settings["iterations"]),
        error_bias=digits(settings["error_bias"]),
        begin=digits(run.x[0]),
        end=digits(run.x[-1]),
        samples=len(run.x),
        per=per,
        extent=digits(links.extent),
        gravity=tupled(links.gravity),
        bodies=writer.bodies(),
        ground=names[-1],
        pulls=writer.pulls(),
        parts=parts,
        slides=bool(links.table.slides.any()),
        gears=bool(links.gears),
        drives=drives,
        needs=needs,
        start=writer.start(pose, velocity),
        channels=channels,
        potential=potential,
        forces=forces,
        changing=changing,
        open_loop=OPEN_LOOP,
        contacts=writer.contacts(settings) if links.contacts else None,
    )


def levels_of(links: Links, run: Run) -> dict[str, tuple[float, ...]]:
    """Change of each channel of the force of a load by a unit of each control, by channel name."""
    found = dict[str, tuple[float, ...]]()
    if not run.loads:
        return found
    asked = run.controls(run.x)[0]
    values = np.clip(asked.T, *followed(links, run)).T

    def levels(name: str, k: int, curve: Array) -> list[float]:
        """Values of a channel at the smallest and at the largest value of control k."""
        found = []
        for control in (curve.min(), curve.max()):
            controls = values[:, 0].copy()
            controls[k] = control
            shown = channel_of(with_controls(links, names_of(run), controls), name)
            assert isinstance(shown, Sensor)
            assert isinstance(shown.function, Level)
            found.append(shown.function.value)
        return found

    for name in run.channels:
        first = channel_of(links, name)
        if not isinstance(first, Sensor) or first.order or not isinstance(first.function, Level):
            continue
        shares = []
        for k, curve in enumerate(values):
            least, most = ends = levels(name, k, curve)
            clipped = (curve != asked[k]).any()
            if clipped and not np.allclose(ends, levels(name, k, asked[k]), rtol=1e-12, atol=0.0):
                raise Unsupported(
                    f"a program with sensor '{name}', which shows a force beyond the range of "
                    f"forces of its joint"
                )
            width = float(np.ptp(curve))
            shares.append((most - least) / width if width else 0.0)
        found[name] = tuple(shares)
    return found


def drive_channels(links: Links) -> Iterator[tuple[str, Sensor]]:
    """Names and sensors of the value, rate and acceleration of each driven joint."""
    for joint in links.drives:
        for order, name in enumerate(drive_columns(joint.name)):
            yield name, Sensor(order, Value(joint))


@dataclass(frozen=True)
class Writer:
    """Writes the parts of a program, as the template ``pymunk.py.jinja`` needs them.

    `names` are the variables of all links and of the ground, and `levels` is from
    `levels_of`.
    """

    links: Links
    names: tuple[str, ...]
    levels: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def bodies(self) -> list[dict[str, Any]]:
        """Mass, moment and centre of every link."""
        columns = zip(
            self.names, self.links.mass, self.links.moment, self.links.centre, strict=False
        )
        return [
            {
                "name": name,
                "mass": digits(mass),
                "moment": digits(moment),
                "x": digits(x),
                "y": digits(y),
                "notes": list(self._notes(k)),
            }
            for k, (name, mass, moment, (x, y)) in enumerate(columns)
        ]

    def _notes(self, k: int) -> Iterator[str]:
        """Comments on properties of link k that differ from those in the MJCF."""
        model, own = self.links.model, np.flatnonzero(self.links.of_body == k)
        mass = model.body_mass[own].sum()
        dofs = [model.body_dofadr[b] for b in own if model.body_dofnum[b]]
        if model.dof_armature[dofs].any():
            yield f"the moment of {self.names[k]} is that with the armature of its hinge"
        if abs(self.links.mass[k] / mass - 1.0) > 1e-12:  # rounding of the sum
            yield (
                f"{self.names[k]} has {digits(mass)} kg and is nearly a point mass on a pin of "
                f"the ground; its small moment would magnify rounding, so this body has more "
                f"mass on a shorter arm, and the same moment about the pin"
            )

    def pulls(self) -> list[str]:
        """Calls that add the constant loads of each body; the last load of a body comes first."""
        found: dict[str, list[str]] = {}
        for pull in self.links.pulls:
            if pull.follows:
                raise Unsupported("a program with a load that turns with its body")
            found.setdefault(self.names[pull.link], []).insert(
                0, f"({tupled(pull.at)}, {tupled(pull.force)}, {digits(pull.moment)})"
            )
        return [wrapped(f"pull({body}, {', '.join(loads)})") for body, loads in found.items()]

    def parts(self, space: pymunk.Space) -> Iterator[dict[str, Any]]:
        """Comment and lines for each constraint except drives, in the solver's order."""
        bodies = [*space.bodies, space.static_body]
        name = dict(zip(bodies, self.names, strict=True))
        seen, together = None, ""
        for owner, constraint in constraints(self.links, bodies):
            a, b = name[constraint.a], name[constraint.b]
            if isinstance(owner, LinkSpring):
                assert isinstance(constraint, pymunk.DampedSpring)
                yield self._point_spring(owner, constraint, a, b)
                continue
            if isinstance(owner, LinkGear):
                yield self._gear(owner, a, b)
                continue
            first, seen = owner is not seen, owner
            if isinstance(constraint, pymunk.DampedRotarySpring | pymunk.DampedSpring):
                assert isinstance(owner, LinkJoint)
                yield self._spring(owner, constraint, a, b, first)
            elif isinstance(constraint, STOPS):
                yield self._stop(owner, constraint, a, b)
            elif isinstance(constraint, pymunk.GearJoint):
                together = f"add(pymunk.GearJoint({a}, {b}, 0.0, 1.0))"  # the groove follows
            else:
                yield self._hold(owner, constraint, a, b, [together] if together else [])
                together = ""

    def _spring(
        self,
        joint: LinkJoint,
        constraint: pymunk.DampedRotarySpring | pymunk.DampedSpring,
        a: str,
        b: str,
        first: bool,
    ) -> dict[str, Any]:
        """Comment and lines for the spring and damper of a joint, or for its constant load.

        The first constraint of a joint is its spring, if it has one.
        """
        k, square, cube = joint.acting
        unit, force = UNIT[joint.hold.axis is None]
        own = first and bool(any(joint.acting) or joint.damping)
        linear = own and not (square or cube)
        damping = digits(constraint.damping)
        if isinstance(constraint, pymunk.DampedRotarySpring):
            make = ["DampedRotarySpring", digits(constraint.rest_angle)]
            value = summed([(1.0, digits(joint.value)), (-joint.sign, "angle")])
            setter, sign = "torque_func = lambda _, angle", "-" if joint.sign < 0 else ""
            load = joint.sign * joint.load
        else:
            ends = tupled(constraint.anchor_a), tupled(constraint.anchor_b)
            make = ["DampedSpring", *ends, digits(constraint.rest_length)]
            value = less(summed([(1.0, "length")], joint.value), REACH * self.links.extent)
            setter, sign = "force_func = lambda _, length", ""
            load = joint.load
        text = f"pymunk.{make[0]}({', '.join([a, b, *make[1:], digits(constraint.stiffness)])}, "
        lines = [wrapped(f"add({text}{damping}))")]
        if not linear:
            force = (
                f"{sign}spring_force({less(value, joint.rest)}, {digits(k)}, "
                f"{digits(square)}, {digits(cube)})"
                if own
                else digits(load)
            )
            whole = f"spring.{setter}: {force}"
            lines = [
                wrapped(f"spring = add({text}{damping}))"),
                *(
                    [whole]
                    if len(whole) <= WIDE
                    else [f"spring.{setter}: (", f"    {wrapped(force, 4, 8)})"]
                ),
            ]
        if not own:
            return {"words": f"{called(joint)}: a load of {joint.load:g} {force}", "lines": lines}
        poly = "".join(f" + {c:g} x^{n}" for n, c in ((2, square), (3, cube)) if c)
        texts = [f"a spring, {k:g} x{poly} [{force}], x = 0 at {joint.rest:g} {unit}"] * any(
            joint.acting
        ) + [f"a damper, {joint.damping:g} {force} s/{unit}"] * bool(joint.damping)
        return {"words": f"{called(joint)}: {' and '.join(texts)}", "lines": lines}

    def _point_spring(
        self, spring: LinkSpring, made: pymunk.DampedSpring, a: str, b: str
    ) -> dict[str, Any]:
        """Comment and lines for a spring between points."""
        (low, high), numbers = spring.slack, (made.rest_length, made.stiffness, made.damping)
        ends = f"{tupled(made.anchor_a)}, {tupled(made.anchor_b)}"
        text = f"add(pymunk.DampedSpring({a}, {b}, {ends}, {', '.join(map(digits, numbers))}))"
        lines, slack = [wrapped(text)], f"slack at {low:g} m"
        if high > low:
            lines, slack = [wrapped(f"spring = {text}")], f"slack from {low:g} to {high:g} m"
            force = f"spring_force({self._beyond('length', spring)}, {digits(made.stiffness)}"
            lines += ["spring.force_func = lambda _, length: (", f"    {force}, 0.0, 0.0))"]
        texts = [f"a spring, {spring.stiffness:g} N/m, {slack}"] * bool(spring.stiffness)
        texts += [f"a damper, {spring.damping:g} N s/m"] * bool(spring.damping)
        named = f'spring "{format_comment(spring.name)}"' if spring.name else "a spring"
        return {"words": f"{named} between points: {' and '.join(texts)}", "lines": lines}

    def _gear(self, gear: LinkGear, a: str, b: str) -> dict[str, Any]:
        """Comment and lines for a gear."""
        ratio, phase = digits(gear.ratio), digits(gear.phase)
        named = f'gear "{format_comment(gear.name)}"' if gear.name else "a gear"
        return {
            "words": f"{named}: {a} turns {gear.ratio:g} times as far as {b}",
            "lines": [wrapped(f"add(pymunk.GearJoint({a}, {b}, {phase}, {ratio}))")],
        }

    def _length(self, spring: LinkSpring) -> str:
        """The source of the length of a spring between points, in terms of ``pose``."""
        places = [
            tupled(at(self.links, link, on))
            for link, on in ((spring.a, spring.on_a), (spring.b, spring.on_b))
        ]
        return f"apart(pose, {self.names[spring.a]}, {self.names[spring.b]}, {', '.join(places)})"

    def _beyond(self, length: str, spring: LinkSpring) -> str:
        """The source of the extension of a spring at a length: 0 where it is slack."""
        low, high = spring.slack
        return (
            less(length, low) if low == high else f"beyond({length}, {digits(low)}, {digits(high)})"
        )

    def _stop(
        self, joint: LinkJoint | Hold, stop: pymunk.Constraint, a: str, b: str
    ) -> dict[str, Any]:
        """Comment and lines for the stop of a joint."""
        if isinstance(stop, pymunk.RotaryLimitJoint):
            text = f"pymunk.RotaryLimitJoint({a}, {b}, {digits(stop.min)}, {digits(stop.max)})"
        else:
            assert isinstance(stop, pymunk.SlideJoint)
            text = (
                f"pymunk.SlideJoint({a}, {b}, {tupled(stop.anchor_a)}, {tupled(stop.anchor_b)},"
                f" {digits(stop.min)}, {digits(stop.max)})"
            )
        return {
            "words": f"{called(joint)}: its limits; with an error_bias of 0 it would bounce",
            "lines": [wrapped(f"space.add({text})")],
        }

    def _hold(
        self, owner: LinkJoint | Hold, hold: pymunk.Constraint, a: str, b: str, before: list[str]
    ) -> dict[str, Any]:
        """Comment and lines for a pin, or for a slide, whose gear is in the lines `before`."""
        if isinstance(hold, pymunk.PivotJoint):
            text = f"pymunk.PivotJoint({a}, {b}, {tupled(hold.anchor_a)}, {tupled(hold.anchor_b)})"
            words = f"a pin of {a} and {b}"
        else:
            assert isinstance(hold, pymunk.GrooveJoint)
            text = (
                f"pymunk.GrooveJoint({a}, {b}, {tupled(hold.groove_a)}, "
                f"{tupled(hold.groove_b)}, {tupled(hold.anchor_b)})"
            )
            words = f"{b} moves along a line of {a}, {REACH:g} EXTENT each way, and does not turn"
        return {"words": f"{called(owner)}: {words}", "lines": [*before, wrapped(f"add({text})")]}

    def drive(self, k: int, joint: LinkJoint, motor: Motor, kind: str) -> dict[str, Any]:
        """Comment, constructor and lines that set the value of drive k after the next step."""
        a, b = self.names[joint.hold.a], self.names[joint.hold.b]
        if isinstance(motor, SlideDrive):
            aims = [f"move = {less(f'values[{k}]', motor.start)}"] + [
                f"drives[{k}].groove_{end} = "
                + ", ".join(
                    summed([(d, "move")], p) for p, d in zip(place, motor.axis, strict=True)
                )
                for end, place in (("a", motor.left), ("b", motor.right))
            ]
            anchor = at(self.links, joint.hold.b, joint.hold.on_b)
            make = (
                f"GrooveJoint({a}, {b}, {tupled(motor.left)}, {tupled(motor.right)}, "
                f"{tupled(anchor)})"
            )
            words = f"{called(joint)}, by a groove across it that moves along"
        elif kind == "motor":
            assert isinstance(motor, HingeDrive)
            now = summed([(motor.sign, f"ahead({a}, {b})")], motor.start)
            aims = [
                f"drives[{k}].rate = ("
                + (f"{now} - values[{k}]" if motor.sign > 0 else f"values[{k}] - ({now})")
                + ") / TIMESTEP"
            ]
            make = f"SimpleMotor({a}, {b}, 0.0)"
            words = f"{called(joint)}, by a motor: Chipmunk's rate is that of {a} against {b}"
        else:
            assert isinstance(motor, HingeDrive)
            phase = less(f"values[{k}]", motor.start)
            aims = [f"drives[{k}].phase = {phase if motor.sign > 0 else f'-({phase})'}"]
            make = f"GearJoint({a}, {b}, 0.0, 1.0)"
            words = f"{called(joint)}, by a gear of ratio 1 whose phase is moved"
        return {"words": words, "aim": aims, "make": wrapped(f"pymunk.{make}", 4, 8)}

    def start(self, pose: np.ndarray, velocity: np.ndarray) -> list[dict[str, str]]:
        """Name, start pose and start velocity of every link."""
        return [
            {"name": name, "pose": ", ".join(map(digits, p)), "velocity": ", ".join(map(digits, v))}
            for name, p, v in zip(self.names[:-1], pose[:-1], velocity[:-1], strict=True)
        ]

    def channel(self, name: str, channel: Sensor) -> str:
        """The source of the curve of a channel."""
        function = channel.function
        if channel.order == -1:
            return "kinetic(0.5 * (before + after))"
        if channel.order == FORCE:
            return summed([(channel.factor, f"force({channel.drive})")])
        if isinstance(function, Level):
            shares = [(s, f"more[{k}]") for k, s in enumerate(self.levels.get(name, ())) if s]
            if shares:
                return summed(shares, function.value)
            return f"np.full(SAMPLES, {digits(function.value)})"
        text = (
            "potential"
            if isinstance(function, Potential)
            else (f"lambda pose: {self._function(function)}")
        )
        text = f"{('value', 'rate', 'acceleration')[channel.order]}({text})"
        text = f"unwrapped({text})" if name.endswith(".angle") else text
        return wrapped(text, 10 + len(repr(name)), 12)

    def _function(self, function: object) -> str:
        """The source of a function of a `Sensor` in terms of ``pose``."""
        if isinstance(function, Value):
            return self._value(function.joint)
        if isinstance(function, LinkSpringLength):
            return self._length(function.spring)
        if isinstance(function, Turn):
            return changing(
                [(function.share, f"angle(pose, {self.names[function.link]})")], function.start
            )
        assert isinstance(function, PointPlace | Direction)
        kind = "point" if isinstance(function, PointPlace) else "direction"
        at_x, at_y = map(digits, function.local)
        text = f"{kind}(pose, {self.names[function.link]}, {at_x}, {at_y})"
        plane, k = function.plane, function.part
        level = float(function.height * plane.normal[k])
        return changing(
            [(float(plane.e1[k]), f"{text}[0]"), (float(plane.e2[k]), f"{text}[1]")],
            level if abs(level) > ZERO * self.links.extent else 0.0,
        )

    def _value(self, joint: LinkJoint) -> str:
        """The source of a joint's coordinate in terms of ``pose``."""
        hold, ground = joint.hold, len(self.names) - 1
        if hold.axis is None:
            turns = [
                (s * joint.sign, f"angle(pose, {self.names[link]})")
                for s, link in ((1.0, hold.b), (-1.0, hold.a))
                if link != ground
            ]
            return summed(turns, joint.value)
        places = [
            tupled(at(self.links, link, on))
            for link, on in ((hold.a, hold.on_a), (hold.b, hold.on_b))
        ]
        text = (
            f"slid(pose, {self.names[hold.a]}, {self.names[hold.b]}, {places[0]}, "
            f"{places[1]}, {tupled(hold.axis)})"
        )
        return summed([(1.0, text)], joint.value)

    def _springs(self) -> Iterator[tuple[str, float, tuple[float, ...], float, float]]:
        """Value, rest, stiffness, damping and load of each joint and each spring between points."""
        for joint in self.links.joints:
            yield self._value(joint), joint.rest, joint.acting, joint.damping, joint.load
        for spring in self.links.springs:
            beyond = self._beyond(self._length(spring), spring)
            yield beyond, 0.0, (spring.stiffness, 0.0, 0.0), spring.damping, 0.0

    def forces(self) -> dict[str, Any]:
        """Data for the forces of drives: driven coordinates and their sizes, springs and loads."""
        springs = [
            {
                "value": wrapped(f"lambda pose: {value}", 9, 9),
                "numbers": ", ".join(map(digits, (rest, *stiffness))),
                "damping": digits(damping),
                "load": digits(load),
            }
            for value, rest, stiffness, damping, load in self._springs()
            if any(stiffness) or damping or load
        ]
        pulls = [
            f"{self.names[pull.link]}, {tupled(pull.at)}, {tupled(pull.force)}, "
            f"{digits(pull.moment)}"
            for pull in self.links.pulls
        ]
        return {
            "driven": [wrapped(self._value(joint), 8, 12) for joint in self.links.drives],
            "sizes": ", ".join(
                "1.0" if joint.hold.axis is None else "EXTENT" for joint in self.links.drives
            ),
            "springs": springs,
            "pulls": pulls,
        }

    def changing(self, run: Run, source: str) -> dict[str, Any]:
        """Data of loads that change: source, limits and start of the controls, and effects."""
        lines, forces, pulls = list[str](), list[dict[str, Any]](), list[dict[str, Any]]()
        for k, one in enumerate(changing_forces(self.links, run)):
            if one.joint >= 0:
                joint = self.links.joints[one.joint]
                unit, hold = digits(one.force), joint.hold
                a, b = self.names[hold.a], self.names[hold.b]
                row = {"k": k, "unit": unit, "value": f"lambda pose: {self._value(joint)}"}
                forces.append(row)
                if hold.axis is None:
                    make, setter = "DampedRotarySpring", "torque_func"
                    ends, unit = "0.0", digits(joint.sign * one.force)
                else:
                    make, setter, far = "DampedSpring", "force_func", REACH * self.links.extent
                    places = (hold.a, hold.on_a - far * hold.axis), (hold.b, hold.on_b)
                    anchors = ", ".join(tupled(at(self.links, *place)) for place in places)
                    ends = f"{anchors}, {digits(far)}"
                made = wrapped(f"pymunk.{make}({a}, {b}, {ends}, 0.0, 0.0)")
                lines += [f"load = add({made})", f"load.{setter} = lambda *_: {unit} * change[{k}]"]
            elif one.pull:
                if one.pull.follows:
                    raise Unsupported("a program with a load that turns with its body")
                row = {
                    "k": k,
                    "body": self.names[one.pull.link],
                    "at": tupled(one.pull.at),
                    "force": tupled(one.pull.force),
                    "moment": digits(one.pull.moment),
                }
                pulls.append(row)
                lines.append(
                    wrapped("pull_more({body}, {k}, {at}, {force}, {moment})".format(**row))
                )
        reach = followed(self.links, run)
        limited = np.isfinite(reach).any()
        return {
            "source": source.strip(),
            "ends": [format_numbers(end) for end in reach] if limited else None,
            "first": np.clip(run.controls(run.x[:1])[0][:, 0], *reach).tolist(),
            "names": ", ".join(map(format_comment, names_of(run))),
            "lines": lines,
            "forces": forces,
            "pulls": pulls,
        }

    def contacts(self, settings: Settings) -> dict[str, Any]:
        """Data of contacts: settings, shapes, and friction and restitution of the pairs."""
        own = self.links.contacts
        return {
            "slop": digits(settings["collision_slop"]),
            "bias": digits(settings["collision_bias"]),
            "shapes": [
                {"make": self._shape(shape), "name": format_comment(shape.name)}
                for shape in own.shapes
            ],
            "laws": {
                pair: tupled((law.friction, law.restitution)) for pair, law in own.laws.items()
            },
        }

    def _shape(self, shape: ContactShape) -> str:
        """The constructor of a shape."""
        points = [tupled(at(self.links, shape.link, point)) for point in shape.points]
        body, radius = self.names[shape.link], digits(shape.radius)
        if len(points) == 1:
            return f"pymunk.Circle({body}, {radius}, {points[0]})"
        if len(points) == 2:
            return f"pymunk.Segment({body}, {points[0]}, {points[1]}, {radius})"
        return f"pymunk.Poly({body}, [{', '.join(points)}], radius={radius})"

    def potential(self) -> dict[str, Any]:
        """Data of the potential energy: its parts in words, springs, weights and the constant."""
        model, plane = self.links.model, self.links.plane
        masses = [(mass, place) for mass, place in weights(self.links) if mass]
        up = float(plane.normal @ model.opt.gravity)
        heavy = bool(self.links.gravity.any())
        springs = [
            f"{wrapped(less(value, rest), 29, 8)}, {', '.join(map(digits, stiffness))}"
            for value, rest, stiffness, _, _ in self._springs()
            if any(stiffness)
        ]
        return {
            "words": " and ".join(["gravity"] * heavy + ["springs"] * bool(springs)) or "nothing",
            "springs": springs,
            "level": digits(-sum(mass * place.height * up for mass, place in masses)),
            "weights": [
                f"{self.names[place.link]}, {digits(mass)}, {', '.join(map(digits, place.local))}"
                for mass, place in masses
            ]
            if heavy
            else [],
        }


def called(owner: LinkJoint | Hold) -> str:
    """The kind and name of a joint or loop in words, such as ``hinge "crank"``."""
    kind = "loop"
    if isinstance(owner, LinkJoint):
        kind = "hinge" if owner.hold.axis is None else "slide"
    return f'{kind} "{format_comment(owner.name)}"' if owner.name else f"a {kind}"
