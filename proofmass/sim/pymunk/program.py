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

from proofmass.base.arrays import Array
from proofmass.sim.program_text import escape_text, load_template
from proofmass.sim.protocol.curves import drive_columns
from proofmass.sim.protocol.failures import BadSetting, Unsupported
from proofmass.sim.protocol.programs import Imposed, Programs, sidecar_instructions
from proofmass.sim.protocol.run import Run
from proofmass.sim.protocol.settings import ParameterValues
from proofmass.sim.pymunk.contacts import ContactShape
from proofmass.sim.pymunk.dampers import Damped
from proofmass.sim.pymunk.dynamics import MAX_LOOP_VIOLATION, MIN_FIRST_ITERATIONS, start_state
from proofmass.sim.pymunk.links import LinkConstraint, LinkGear, LinkJoint, Links, LinkSpring
from proofmass.sim.pymunk.loads import changing_forces, control_limits, links_at_start, load_names
from proofmass.sim.pymunk.model import find_channels, read_model, with_controls
from proofmass.sim.pymunk.read import (
    ConstantValue,
    Direction,
    JointValue,
    LinkAngle,
    LinkSpringLength,
    PointPosition,
    Potential,
    Sensor,
    body_masses,
    read_channel,
)
from proofmass.sim.pymunk.settings import CONTACT_SETTINGS, SPACE_SETTINGS
from proofmass.sim.pymunk.space import (
    HALF_GROOVE,
    STOP_TYPES,
    HingeDrive,
    LinkDrive,
    Settings,
    SlideDrive,
    SlideFriction,
    add_drives,
    body_point,
    build_space,
    make_constraints,
    make_friction,
)

IMPOSED = Imposed("gear"), Imposed("motor")
"""The ways in which a program can prescribe the motion of a hinge: a gear whose phase is moved, or
a motor whose rate is set before each step.  For slides a groove is moved in both."""
MAX_LINE_LENGTH = 100
"""Line length of the program; only lines that cannot be broken are longer."""
PRINTED_ROUNDING = 1e-15
"""Components of unit vectors that differ by less from 0 or from 1 are printed as 0 or 1."""
FORCE_ORDER = -2
"""`Sensor.order` of the force of a drive."""
JOINT_UNITS = {True: ("rad", "N m"), False: ("m", "N")}
"""Units of the coordinate and of the force of a joint, by whether it is a hinge."""


class PymunkPrograms(Programs):
    """Settings as lines of Python, and programs that need only pymunk and NumPy."""

    imposed = IMPOSED

    def write_snippet(
        self, parameters: ParameterValues, steps: int, model: Path | None = None
    ) -> str:
        """Lines of Python that step a pymunk space with given settings; `model` is not used.

        Settings that pymunk does not have are added as comments.  There are no lines if the time
        step, the iterations or the bias is missing.
        """
        if not set(parameters) >= set(SPACE_SETTINGS):
            return ""
        stated = *SPACE_SETTINGS, *CONTACT_SETTINGS, "defaults"
        others = (f"# {line}" for line in sidecar_instructions(parameters, stated))
        return "\n".join([*stepping_lines(parameters, steps), *others])

    def write_program(
        self,
        path: Path,
        run: Run,
        motion: str,
        head: str,
        drive: Imposed = IMPOSED[0],
        controls: str = "",
    ) -> str:
        """A program with the same steps as a run; see `Programs.write_program`.

        The settings of the run must have ``iterations`` or ``defaults``.  The program writes the
        channels that pymunk delivers, and prints the number of steps and their processor time [s].
        If the run fails, it prints an error and ends with exit code 1.

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
            raise Unsupported(
                f"a program in pymunk of another run than dynamics, such as {run.kind}"
            )
        links, settings = read_model(path, run)
        links = links_at_start(links, run)
        if settings["iterations"] is None:
            raise BadSetting("iterations", "missing; a program needs their number")
        if drive.kind == "motor":
            for joint in links.drives:
                if joint.constraint.axis is not None:
                    raise Unsupported(
                        f"a motor on slide joint '{joint.name}': pymunk has none that "
                        f"moves along a line"
                    )
        placeholders = [f"body_{k}_of_{len(links.mass)}" for k in range(len(links.mass) + 1)]
        used_names = {
            *names_in(
                _render_program(
                    links, run, settings, motion, head, drive.kind, placeholders, controls
                )
            ),
            *keyword.kwlist,
        } - set(placeholders)
        names = body_names(links, used_names)
        return _render_program(links, run, settings, motion, head, drive.kind, names, controls)


def stepping_lines(parameters: ParameterValues, steps: int) -> Iterator[str]:
    """Lines of Python that set a space and step it.

    The first step takes more iterations, since there are no impulses of an earlier step.
    """
    iterations = int(str(parameters["iterations"]))
    yield from (
        f"space.{key} = {parameters[key]!r}" for key in CONTACT_SETTINGS if key in parameters
    )
    yield from (
        "for constraint in space.constraints:",
        f"    constraint.error_bias = {parameters['error_bias']!r}",
        f"space.iterations = {max(MIN_FIRST_ITERATIONS, 10 * iterations)}"
        "  # there are no impulses to start from",
        f"space.step({parameters['timestep']!r})",
        f"space.iterations = {iterations}",
        f"for _ in range({steps - 1}):",
        f"    space.step({parameters['timestep']!r})",
    )


def names_in(program: str) -> set[str]:
    """All names of variables, functions, parameters and imports in a program."""
    tree = list(ast.walk(ast.parse(program)))
    return {
        *(node.id for node in tree if isinstance(node, ast.Name)),
        *(node.arg for node in tree if isinstance(node, ast.arg)),
        *(node.name for node in tree if isinstance(node, ast.FunctionDef)),
        *(node.asname or node.name for node in tree if isinstance(node, ast.alias)),
    }


def body_names(links: Links, used_names: Iterable[str]) -> list[str]:
    """Names of variables for all links and the ground, which are all different.

    None of them is in `used_names`.  A link has the name of its first body, or that of the body's
    joint if the body has no name.
    """
    found: list[str] = []
    for k in range(len(links.mass)):
        body = int(np.flatnonzero(links.of_body == k)[0])
        name = (
            links.model.body(body).name
            or links.model.joint(int(links.model.body_jntadr[body])).name
        )
        found.append(unused_name(name, {*used_names, *found}))
    return [*found, unused_name("ground", {*used_names, *found})]


def unused_name(name: str, used_names: set[str]) -> str:
    """A valid name of a variable that is not in `used_names`, from the name of a body.

    >>> unused_name("left crank", set()), unused_name("3rd", set()), unused_name("time", {"time"})
    ('left_crank', 'body_3rd', 'time_body')
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", name)
    if not re.match("[A-Za-z]", name):
        name = f"body_{name.strip('_')}".rstrip("_")
    if name in used_names:
        name = f"{name}_body"
    tried, k = name, 2
    while tried in used_names:
        tried, k = f"{name}_{k}", k + 1
    return tried


def escape_for_comment(name: str) -> str:
    """A name as it is written in a comment: on one line, with special characters escaped."""
    return escape_text(repr(name)[1:-1]).replace("\\\\", "\\").replace("\n", " ")


def literal(number: float) -> str:
    """A number with all its digits, -0.0 as 0.0."""
    return repr(float(number) + 0.0)


def format_numbers(numbers: Iterable[float]) -> str:
    """Numbers as the source of a list, with infinity as ``np.inf``.

    >>> format_numbers([-np.inf, 2.5])
    '[-np.inf, 2.5]'
    """
    return f"[{', '.join(map(literal, numbers))}]".replace("inf", "np.inf")


def as_tuple(numbers: Iterable[float]) -> str:
    """Numbers as the source of a tuple."""
    return f"({', '.join(map(literal, numbers))})"


def format_sum(terms: Iterable[tuple[float, str]], constant: float = 0.0) -> str:
    """The source of a sum: `constant` plus products of factors and terms.

    Terms whose factor is at most `PRINTED_ROUNDING` are left out.

    >>> format_sum([(1.0, "x"), (0.0, "y")]), format_sum([(-0.5, "x"), (-1.0, "y")], 2.0)
    ('x', '2.0 - 0.5 * x - y')
    """
    text = literal(constant) if constant else ""
    for share, term in terms:
        if abs(share) <= PRINTED_ROUNDING:
            continue
        size = "" if abs(abs(share) - 1.0) <= PRINTED_ROUNDING else f"{literal(abs(share))} * "
        between = (" + ", " - ") if text else ("", "-")
        text += f"{between[share < 0]}{size}{term}"
    return text or "0.0"


def wrap_lines(text: str, first_indent: int = 0, indent: int = 4) -> str:
    """Break an expression into lines at its blanks, but not within a tuple.

    The expression must be in brackets and without strings.  The first line is broken as if it were
    indented by `first_indent`; the other lines are indented by `indent`.
    """
    whole = re.sub(r"(?<!\w)\([^()]*\)", lambda found: found[0].replace(" ", "\0"), text)
    return (
        fill(
            whole,
            MAX_LINE_LENGTH,
            initial_indent=" " * first_indent,
            subsequent_indent=" " * indent,
            break_long_words=False,
            break_on_hyphens=False,
        )
        .strip()
        .replace("\0", " ")
    )


def format_array_sum(terms: list[tuple[float, str]], constant: float) -> str:
    """The source of a sum as in `format_sum`, but always an array over the poses."""
    if all(abs(share) <= PRINTED_ROUNDING for share, _ in terms):
        return f"np.full(len(pose), {literal(constant)})"
    return format_sum(terms, constant)


def comment_lines(text: str, indent: int = 0) -> str:
    """A text as the lines of a comment."""
    return fill(
        text,
        MAX_LINE_LENGTH,
        initial_indent=" " * indent + "# ",
        break_on_hyphens=False,
        subsequent_indent=" " * indent + "# ",
        break_long_words=False,
    )


def minus(text: str, number: float) -> str:
    """The source of a term less a number.

    >>> minus("x", 0.0), minus("x", -1.8)
    ('x', 'x + 1.8')
    """
    return text if number == 0 else f"{text} {'-' if number > 0 else '+'} {literal(abs(number))}"


def _render_program(
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
    writer = Writer(links, tuple(names), channel_changes(links, run))
    steps_per_sample, dt = run.steps(settings["timestep"])
    pose, velocity, _ = start_state(links, run, steps_per_sample, dt)
    space = build_space(links, settings["iterations"], settings["error_bias"])
    motors = add_drives(space, links)
    parts = list(writer.parts(space))
    limited = any(joint.limits for joint in links.joints)  # then stops may exert forces too
    channels = {
        repr(name): writer.channel(name, channel)
        for name, channel in [*find_channels(links, run)[0].items(), *drive_channels(links)]
        if channel.order > -2 or (channel.order == FORCE_ORDER and not limited)
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
    return load_template("pymunk.py.jinja", comment=comment_lines).render(
        docstring=f'"""{escape_text(head).strip()}\n"""\n' if head.strip() else "",
        motion=motion.strip("\n"),
        dt=literal(dt),
        iterations=settings["iterations"],
        first=max(MIN_FIRST_ITERATIONS, 10 * settings["iterations"]),
        error_bias=literal(settings["error_bias"]),
        begin=literal(run.x[0]),
        end=literal(run.x[-1]),
        samples=len(run.x),
        per=steps_per_sample,
        extent=literal(links.extent),
        gravity=as_tuple(links.gravity),
        bodies=writer.bodies(),
        ground=names[-1],
        pulls=writer.pulls(),
        parts=parts,
        rubs=list(writer.rubs(space)),
        slides=bool(links.table.slides.any()),
        gears=bool(links.gears),
        drives=drives,
        needs=needs,
        start=writer.start(pose, velocity),
        channels=channels,
        potential=potential,
        forces=forces,
        changing=changing,
        open_loop=MAX_LOOP_VIOLATION,
        contacts=writer.contacts(settings) if links.contacts else None,
        dampers=damper_kinds(space) if settings.get("midpoint_damping") else set(),
    )


def damper_kinds(space: pymunk.Space) -> set[str]:
    """The kinds of dampers in a space, "turn" of rotations and "line" of distances."""
    return {
        "turn" if isinstance(one, pymunk.DampedRotarySpring) else "line"
        for one in space.constraints
        if isinstance(one, Damped) and one.damping
    }


def channel_changes(links: Links, run: Run) -> dict[str, tuple[float, ...]]:
    """Change of each channel of the force of a load by a unit of each control, by channel name."""
    found = dict[str, tuple[float, ...]]()
    if not run.loads:
        return found
    asked = run.controls(run.x)[0]
    values = np.clip(asked.T, *control_limits(links, run)).T

    def levels(name: str, k: int, curve: Array) -> list[float]:
        """Values of a channel at the smallest and at the largest value of control k."""
        found = []
        for control in (curve.min(), curve.max()):
            controls = values[:, 0].copy()
            controls[k] = control
            shown = read_channel(with_controls(links, load_names(run), controls), name)
            assert isinstance(shown, Sensor)
            assert isinstance(shown.function, ConstantValue)
            found.append(shown.function.value)
        return found

    for name in run.channels:
        first = read_channel(links, name)
        if (
            not isinstance(first, Sensor)
            or first.order
            or not isinstance(first.function, ConstantValue)
        ):
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
            yield name, Sensor(order, JointValue(joint))


@dataclass(frozen=True)
class Writer:
    """Writes the parts of a program, as the template ``pymunk.py.jinja`` needs them.

    `names` are the variables of all links and of the ground, and `levels` is from
    `channel_changes`.
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
                "mass": literal(mass),
                "moment": literal(moment),
                "x": literal(x),
                "y": literal(y),
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
                f"{self.names[k]} has {literal(mass)} kg and is nearly a point mass on a pin of "
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
                0, f"({as_tuple(pull.at)}, {as_tuple(pull.force)}, {literal(pull.moment)})"
            )
        return [wrap_lines(f"pull({body}, {', '.join(loads)})") for body, loads in found.items()]

    def parts(self, space: pymunk.Space) -> Iterator[dict[str, Any]]:
        """Comment and lines for each constraint except drives, in the solver's order."""
        bodies = [*space.bodies, space.static_body]
        name = dict(zip(bodies, self.names, strict=True))
        seen, together = None, ""
        for owner, constraint in make_constraints(self.links, bodies):
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
            elif isinstance(constraint, STOP_TYPES):
                yield self._stop(owner, constraint, a, b)
            elif isinstance(constraint, pymunk.GearJoint):
                together = f"add(pymunk.GearJoint({a}, {b}, 0.0, 1.0))"  # the groove follows
            else:
                yield self._hold(owner, constraint, a, b, [together] if together else [])
                together = ""

    def rubs(self, space: pymunk.Space) -> Iterator[dict[str, Any]]:
        """Comment and lines for the dry friction of each joint that is not driven."""
        joints = self.links.rubbing_loose
        bodies = [*space.bodies, space.static_body]
        for j, motor in zip(joints, make_friction(self.links, joints, bodies), strict=True):
            joint = self.links.joints[j]
            a, b = self.names[joint.constraint.a], self.names[joint.constraint.b]
            unit = JOINT_UNITS[joint.constraint.axis is None][1]
            words = f"{describe(joint)}: dry friction of {joint.friction:g} {unit}"
            if isinstance(motor, SlideFriction):
                anchor = body_point(self.links, joint.constraint.b, joint.constraint.on_b)
                make = f"GrooveJoint({a}, {b}, {as_tuple(motor.left)}, {as_tuple(motor.right)}, "
                make += f"{as_tuple(anchor)})"
                words += ", by a groove across it that has no bias"
            else:
                make = f"SimpleMotor({a}, {b}, 0.0)"
            lines = [wrap_lines(f"friction = add(pymunk.{make})")]
            lines += [f"friction.max_force = {literal(joint.friction)}"]
            lines += ["friction.error_bias = 1.0"] * isinstance(motor, SlideFriction)
            yield {"words": words, "lines": lines}

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
        unit, force = JOINT_UNITS[joint.constraint.axis is None]
        own = first and bool(any(joint.acting) or joint.damping)
        linear = own and not (square or cube)
        damping = literal(constraint.damping)
        if isinstance(constraint, pymunk.DampedRotarySpring):
            make = ["DampedRotarySpring", literal(constraint.rest_angle)]
            value = format_sum([(1.0, literal(joint.value)), (-joint.sign, "angle")])
            setter, sign = "torque_func = lambda _, angle", "-" if joint.sign < 0 else ""
            load = joint.sign * joint.load
        else:
            ends = as_tuple(constraint.anchor_a), as_tuple(constraint.anchor_b)
            make = ["DampedSpring", *ends, literal(constraint.rest_length)]
            value = minus(
                format_sum([(1.0, "length")], joint.value), HALF_GROOVE * self.links.extent
            )
            setter, sign = "force_func = lambda _, length", ""
            load = joint.load
        text = f"pymunk.{make[0]}({', '.join([a, b, *make[1:], literal(constraint.stiffness)])}, "
        lines = [wrap_lines(f"add({text}{damping}))")]
        if not linear:
            force = (
                f"{sign}spring_force({minus(value, joint.rest)}, {literal(k)}, "
                f"{literal(square)}, {literal(cube)})"
                if own
                else literal(load)
            )
            whole = f"spring.{setter}: {force}"
            lines = [
                wrap_lines(f"spring = add({text}{damping}))"),
                *(
                    [whole]
                    if len(whole) <= MAX_LINE_LENGTH
                    else [f"spring.{setter}: (", f"    {wrap_lines(force, 4, 8)})"]
                ),
            ]
        if not own:
            return {"words": f"{describe(joint)}: a load of {joint.load:g} {force}", "lines": lines}
        poly = "".join(f" + {c:g} x^{n}" for n, c in ((2, square), (3, cube)) if c)
        texts = [f"a spring, {k:g} x{poly} [{force}], x = 0 at {joint.rest:g} {unit}"] * any(
            joint.acting
        ) + [f"a damper, {joint.damping:g} {force} s/{unit}"] * bool(joint.damping)
        return {"words": f"{describe(joint)}: {' and '.join(texts)}", "lines": lines}

    def _point_spring(
        self, spring: LinkSpring, made: pymunk.DampedSpring, a: str, b: str
    ) -> dict[str, Any]:
        """Comment and lines for a spring between points."""
        (low, high), numbers = spring.slack, (made.rest_length, made.stiffness, made.damping)
        ends = f"{as_tuple(made.anchor_a)}, {as_tuple(made.anchor_b)}"
        text = f"add(pymunk.DampedSpring({a}, {b}, {ends}, {', '.join(map(literal, numbers))}))"
        lines, slack = [wrap_lines(text)], f"slack at {low:g} m"
        if high > low:
            lines, slack = [wrap_lines(f"spring = {text}")], f"slack from {low:g} to {high:g} m"
            force = f"spring_force({self._beyond('length', spring)}, {literal(made.stiffness)}"
            lines += ["spring.force_func = lambda _, length: (", f"    {force}, 0.0, 0.0))"]
        texts = [f"a spring, {spring.stiffness:g} N/m, {slack}"] * bool(spring.stiffness)
        texts += [f"a damper, {spring.damping:g} N s/m"] * bool(spring.damping)
        named = f'spring "{escape_for_comment(spring.name)}"' if spring.name else "a spring"
        return {"words": f"{named} between points: {' and '.join(texts)}", "lines": lines}

    def _gear(self, gear: LinkGear, a: str, b: str) -> dict[str, Any]:
        """Comment and lines for a gear."""
        ratio, phase = literal(gear.ratio), literal(gear.phase)
        named = f'gear "{escape_for_comment(gear.name)}"' if gear.name else "a gear"
        return {
            "words": f"{named}: {a} turns {gear.ratio:g} times as far as {b}",
            "lines": [wrap_lines(f"add(pymunk.GearJoint({a}, {b}, {phase}, {ratio}))")],
        }

    def _length(self, spring: LinkSpring) -> str:
        """The source of the length of a spring between points, in terms of ``pose``."""
        places = [
            as_tuple(body_point(self.links, link, on))
            for link, on in ((spring.a, spring.on_a), (spring.b, spring.on_b))
        ]
        return f"apart(pose, {self.names[spring.a]}, {self.names[spring.b]}, {', '.join(places)})"

    def _beyond(self, length: str, spring: LinkSpring) -> str:
        """The source of the extension of a spring at a length: 0 where it is slack."""
        low, high = spring.slack
        return (
            minus(length, low)
            if low == high
            else f"beyond({length}, {literal(low)}, {literal(high)})"
        )

    def _stop(
        self, joint: LinkJoint | LinkConstraint, stop: pymunk.Constraint, a: str, b: str
    ) -> dict[str, Any]:
        """Comment and lines for the stop of a joint."""
        if isinstance(stop, pymunk.RotaryLimitJoint):
            text = f"pymunk.RotaryLimitJoint({a}, {b}, {literal(stop.min)}, {literal(stop.max)})"
        else:
            assert isinstance(stop, pymunk.SlideJoint)
            text = (
                f"pymunk.SlideJoint({a}, {b}, {as_tuple(stop.anchor_a)}, {as_tuple(stop.anchor_b)},"
                f" {literal(stop.min)}, {literal(stop.max)})"
            )
        return {
            "words": f"{describe(joint)}: its limits; with an error_bias of 0 it would bounce",
            "lines": [wrap_lines(f"space.add({text})")],
        }

    def _hold(
        self,
        owner: LinkJoint | LinkConstraint,
        hold: pymunk.Constraint,
        a: str,
        b: str,
        before: list[str],
    ) -> dict[str, Any]:
        """Comment and lines for a pin, or for a slide, whose gear is in the lines `before`."""
        if isinstance(hold, pymunk.PivotJoint):
            text = (
                f"pymunk.PivotJoint({a}, {b}, {as_tuple(hold.anchor_a)}, {as_tuple(hold.anchor_b)})"
            )
            words = f"a pin of {a} and {b}"
        else:
            assert isinstance(hold, pymunk.GrooveJoint)
            text = (
                f"pymunk.GrooveJoint({a}, {b}, {as_tuple(hold.groove_a)}, "
                f"{as_tuple(hold.groove_b)}, {as_tuple(hold.anchor_b)})"
            )
            words = (
                f"{b} moves along a line of {a}, {HALF_GROOVE:g} EXTENT each way, and does not turn"
            )
        return {
            "words": f"{describe(owner)}: {words}",
            "lines": [*before, wrap_lines(f"add({text})")],
        }

    def drive(self, k: int, joint: LinkJoint, motor: LinkDrive, kind: str) -> dict[str, Any]:
        """Comment, constructor and lines that set the value of drive k after the next step."""
        a, b = self.names[joint.constraint.a], self.names[joint.constraint.b]
        if isinstance(motor, SlideDrive):
            aims = [f"move = {minus(f'values[{k}]', motor.start)}"] + [
                f"drives[{k}].groove_{end} = "
                + ", ".join(
                    format_sum([(d, "move")], p) for p, d in zip(place, motor.axis, strict=True)
                )
                for end, place in (("a", motor.left), ("b", motor.right))
            ]
            anchor = body_point(self.links, joint.constraint.b, joint.constraint.on_b)
            make = (
                f"GrooveJoint({a}, {b}, {as_tuple(motor.left)}, {as_tuple(motor.right)}, "
                f"{as_tuple(anchor)})"
            )
            words = f"{describe(joint)}, by a groove across it that moves along"
        elif kind == "motor":
            assert isinstance(motor, HingeDrive)
            now = format_sum([(motor.sign, f"ahead({a}, {b})")], motor.start)
            aims = [
                f"drives[{k}].rate = ("
                + (f"{now} - values[{k}]" if motor.sign > 0 else f"values[{k}] - ({now})")
                + ") / TIMESTEP"
            ]
            make = f"SimpleMotor({a}, {b}, 0.0)"
            words = f"{describe(joint)}, by a motor: Chipmunk's rate is that of {a} against {b}"
        else:
            assert isinstance(motor, HingeDrive)
            phase = minus(f"values[{k}]", motor.start)
            aims = [f"drives[{k}].phase = {phase if motor.sign > 0 else f'-({phase})'}"]
            make = f"GearJoint({a}, {b}, 0.0, 1.0)"
            words = f"{describe(joint)}, by a gear of ratio 1 whose phase is moved"
        return {"words": words, "aim": aims, "make": wrap_lines(f"pymunk.{make}", 4, 8)}

    def start(self, pose: np.ndarray, velocity: np.ndarray) -> list[dict[str, str]]:
        """Name, start pose and start velocity of every link."""
        return [
            {
                "name": name,
                "pose": ", ".join(map(literal, p)),
                "velocity": ", ".join(map(literal, v)),
            }
            for name, p, v in zip(self.names[:-1], pose[:-1], velocity[:-1], strict=True)
        ]

    def channel(self, name: str, channel: Sensor) -> str:
        """The source of the curve of a channel."""
        function = channel.function
        if channel.order == -1:
            return "kinetic(0.5 * (before + after))"
        if channel.order == FORCE_ORDER:
            return format_sum([(channel.factor, f"force({channel.drive})")])
        if isinstance(function, ConstantValue):
            shares = [(s, f"more[{k}]") for k, s in enumerate(self.levels.get(name, ())) if s]
            if shares:
                return format_sum(shares, function.value)
            return f"np.full(SAMPLES, {literal(function.value)})"
        text = (
            "potential"
            if isinstance(function, Potential)
            else (f"lambda pose: {self._function(function)}")
        )
        text = f"{('value', 'rate', 'acceleration')[channel.order]}({text})"
        text = f"unwrapped({text})" if name.endswith(".angle") else text
        return wrap_lines(text, 10 + len(repr(name)), 12)

    def _function(self, function: object) -> str:
        """The source of a function of a `Sensor` in terms of ``pose``."""
        if isinstance(function, JointValue):
            return self._value(function.joint)
        if isinstance(function, LinkSpringLength):
            return self._length(function.spring)
        if isinstance(function, LinkAngle):
            return format_array_sum(
                [(function.share, f"angle(pose, {self.names[function.link]})")], function.start
            )
        assert isinstance(function, PointPosition | Direction)
        kind = "point" if isinstance(function, PointPosition) else "direction"
        at_x, at_y = map(literal, function.local)
        text = f"{kind}(pose, {self.names[function.link]}, {at_x}, {at_y})"
        plane, k = function.plane, function.part
        level = float(function.height * plane.normal[k])
        return format_array_sum(
            [(float(plane.e1[k]), f"{text}[0]"), (float(plane.e2[k]), f"{text}[1]")],
            level if abs(level) > PRINTED_ROUNDING * self.links.extent else 0.0,
        )

    def _value(self, joint: LinkJoint) -> str:
        """The source of a joint's coordinate in terms of ``pose``."""
        constraint, ground = joint.constraint, len(self.names) - 1
        if constraint.axis is None:
            turns = [
                (s * joint.sign, f"angle(pose, {self.names[link]})")
                for s, link in ((1.0, constraint.b), (-1.0, constraint.a))
                if link != ground
            ]
            return format_sum(turns, joint.value)
        places = [
            as_tuple(body_point(self.links, link, on))
            for link, on in ((constraint.a, constraint.on_a), (constraint.b, constraint.on_b))
        ]
        text = (
            f"slid(pose, {self.names[constraint.a]}, {self.names[constraint.b]}, {places[0]}, "
            f"{places[1]}, {as_tuple(constraint.axis)})"
        )
        return format_sum([(1.0, text)], joint.value)

    def _springs(
        self, servos: bool
    ) -> Iterator[tuple[str, float, tuple[float, ...], float, float]]:
        """Value, rest, stiffness, damping and load of each joint and each spring between points.

        With `servos` the stiffness of a joint includes that of its servos, which store no energy.
        """
        for joint in self.links.joints:
            stiffness = joint.acting if servos else joint.stiffness
            yield self._value(joint), joint.rest, stiffness, joint.damping, joint.load
        for spring in self.links.springs:
            beyond = self._beyond(self._length(spring), spring)
            yield beyond, 0.0, (spring.stiffness, 0.0, 0.0), spring.damping, 0.0

    def forces(self) -> dict[str, Any]:
        """Data for the forces of drives: driven coordinates and their sizes, springs and loads."""
        springs = [
            {
                "value": wrap_lines(f"lambda pose: {value}", 9, 9),
                "numbers": ", ".join(map(literal, (rest, *stiffness))),
                "damping": literal(damping),
                "load": literal(load),
            }
            for value, rest, stiffness, damping, load in self._springs(servos=True)
            if any(stiffness) or damping or load
        ]
        pulls = [
            f"{self.names[pull.link]}, {as_tuple(pull.at)}, {as_tuple(pull.force)}, "
            f"{literal(pull.moment)}"
            for pull in self.links.pulls
        ]
        return {
            "driven": [wrap_lines(self._value(joint), 8, 12) for joint in self.links.drives],
            "sizes": ", ".join(
                "1.0" if joint.constraint.axis is None else "EXTENT" for joint in self.links.drives
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
                unit, hold = literal(one.force), joint.constraint
                a, b = self.names[hold.a], self.names[hold.b]
                row = {"k": k, "unit": unit, "value": f"lambda pose: {self._value(joint)}"}
                forces.append(row)
                if hold.axis is None:
                    make, setter = "DampedRotarySpring", "torque_func"
                    ends, unit = "0.0", literal(joint.sign * one.force)
                else:
                    make, setter, far = (
                        "DampedSpring",
                        "force_func",
                        HALF_GROOVE * self.links.extent,
                    )
                    places = (hold.a, hold.on_a - far * hold.axis), (hold.b, hold.on_b)
                    anchors = ", ".join(
                        as_tuple(body_point(self.links, *place)) for place in places
                    )
                    ends = f"{anchors}, {literal(far)}"
                made = wrap_lines(f"pymunk.{make}({a}, {b}, {ends}, 0.0, 0.0)")
                lines += [f"load = add({made})", f"load.{setter} = lambda *_: {unit} * change[{k}]"]
            elif one.pull:
                if one.pull.follows:
                    raise Unsupported("a program with a load that turns with its body")
                row = {
                    "k": k,
                    "body": self.names[one.pull.link],
                    "at": as_tuple(one.pull.at),
                    "force": as_tuple(one.pull.force),
                    "moment": literal(one.pull.moment),
                }
                pulls.append(row)
                lines.append(
                    wrap_lines("pull_more({body}, {k}, {at}, {force}, {moment})".format(**row))
                )
        reach = control_limits(self.links, run)
        limited = np.isfinite(reach).any()
        return {
            "source": source.strip(),
            "ends": [format_numbers(end) for end in reach] if limited else None,
            "first": np.clip(run.controls(run.x[:1])[0][:, 0], *reach).tolist(),
            "names": ", ".join(map(escape_for_comment, load_names(run))),
            "lines": lines,
            "forces": forces,
            "pulls": pulls,
        }

    def contacts(self, settings: Settings) -> dict[str, Any]:
        """Data of contacts: settings, shapes, and friction and restitution of the pairs."""
        own = self.links.contacts
        return {
            "slop": literal(settings["collision_slop"]),
            "bias": literal(settings["collision_bias"]),
            "shapes": [
                {"make": self._shape(shape), "name": escape_for_comment(shape.name)}
                for shape in own.shapes
            ],
            "laws": {
                pair: as_tuple((law.friction, law.restitution)) for pair, law in own.laws.items()
            },
        }

    def _shape(self, shape: ContactShape) -> str:
        """The constructor of a shape."""
        points = [as_tuple(body_point(self.links, shape.link, point)) for point in shape.points]
        body, radius = self.names[shape.link], literal(shape.radius)
        if len(points) == 1:
            return f"pymunk.Circle({body}, {radius}, {points[0]})"
        if len(points) == 2:
            return f"pymunk.Segment({body}, {points[0]}, {points[1]}, {radius})"
        return f"pymunk.Poly({body}, [{', '.join(points)}], radius={radius})"

    def potential(self) -> dict[str, Any]:
        """Data of the potential energy: its parts in words, springs, weights and the constant."""
        model, plane = self.links.model, self.links.plane
        masses = [(mass, place) for mass, place in body_masses(self.links) if mass]
        up = float(plane.normal @ model.opt.gravity)
        heavy = bool(self.links.gravity.any())
        springs = [
            f"{wrap_lines(minus(value, rest), 29, 8)}, {', '.join(map(literal, stiffness))}"
            for value, rest, stiffness, _, _ in self._springs(servos=False)
            if any(stiffness)
        ]
        return {
            "words": " and ".join(["gravity"] * heavy + ["springs"] * bool(springs)) or "nothing",
            "springs": springs,
            "level": literal(-sum(mass * place.height * up for mass, place in masses)),
            "weights": [
                f"{self.names[place.link]}, {literal(mass)}, {', '.join(map(literal, place.local))}"
                for mass, place in masses
            ]
            if heavy
            else [],
        }


def describe(owner: LinkJoint | LinkConstraint) -> str:
    """The kind and name of a joint or loop in words, such as ``hinge "crank"``."""
    kind = "loop"
    if isinstance(owner, LinkJoint):
        kind = "hinge" if owner.constraint.axis is None else "slide"
    return f'{kind} "{escape_for_comment(owner.name)}"' if owner.name else f"a {kind}"
