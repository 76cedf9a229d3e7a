"""Mutators of MJCF, TOML and CSV: ``mutator(rng, content) -> content``, all of them bytes.

A mutator that finds nothing to change returns its input.  All random choices come from `rng`, so
that a list of (file ending, mutator, seed) determines an input.
"""

import re
from collections.abc import Callable
from random import Random
from typing import NamedTuple
from xml.etree import ElementTree

Mutator = Callable[[Random, bytes], bytes]


class Mutation(NamedTuple):
    """A change of the file with an ending, by the mutator with a name, with a seed."""

    ending: str
    mutator: str
    seed: int


NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
NONSENSE = [
    "nan",
    "inf",
    "-inf",
    "1e400",
    "1e308",
    "1e-320",
    "",
    "0x10",
    "1,5",
    "１",
    "1e",
    "--1",
    "true",
    "12abc",
    "\u00a0",
    "1e9",
    "-1e9",
    "1 2",
    "?",
]


def text_of(content: bytes) -> str:
    return content.decode("utf-8", errors="surrogateescape")


def bytes_of(text: str) -> bytes:
    return text.encode("utf-8", errors="surrogateescape")


def changed_number(rng: Random, old: str) -> str:
    """Another number in place of `old`, or a text that is no number."""
    kind = rng.random()
    if kind < 0.15:
        return rng.choice(NONSENSE)
    try:
        value = float(old)
    except ValueError:
        return "1"
    if kind < 0.25:
        return "0"
    if kind < 0.4:
        return f"{-value:.17g}"
    if kind < 0.5:
        return f"{value * 10.0 ** rng.randint(-9, 9):.17g}"
    if kind < 0.6:
        return f"{value + rng.choice([1, -1, 0.1, 3.141592653589793]):.17g}"
    return f"{value * (1 + rng.choice([1, -1]) * 10.0 ** -rng.randint(0, 12)):.17g}"


def change_number_in_line(rng: Random, line: str) -> str:
    """A line with one of its numbers changed."""
    hits = list(NUMBER.finditer(line))
    if not hits:
        return line
    hit = rng.choice(hits)
    return line[: hit.start()] + changed_number(rng, hit[0]) + line[hit.end() :]


def word_with_typo(rng: Random, word: str) -> str:
    """A word with a letter swapped, dropped, doubled or in the other case, or a mark added."""
    if not word:
        return "x"
    k = rng.randrange(len(word))
    return rng.choice(
        [
            word[:k] + word[k + 1 :],
            word[:k] + word[k] + word[k:],
            word[:k] + word[k].swapcase() + word[k + 1 :],
            word[:k] + word[k + 1 : k + 2] + word[k] + word[k + 2 :],
            word + " ",
            word.upper(),
            word + "_",
        ]
    )


def odd_word(rng: Random, others: list[str]) -> str:
    """One of the other words of the file, or one of a list of unusual words."""
    if others and rng.random() < 0.6:
        return rng.choice(others)
    return rng.choice(
        [
            "",
            " ",
            "*",
            "[",
            "[a",
            "ü",
            "../x",
            "/etc/passwd",
            "x" * 100_000,
            "\t",
            "0",
            "nan",
            "world",
            "%s{}",
            "\\",
            "[red]x[/red]",
            "\u202e",
            "\x1b[31m",
        ]
    )


# any text


def truncated(rng: Random, content: bytes) -> bytes:
    return content[: rng.randrange(len(content))] if content else content


def flipped(rng: Random, content: bytes) -> bytes:
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 8])):
        if data:
            data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)


def encoded(rng: Random, content: bytes) -> bytes:
    text = text_of(content)
    k = rng.randrange(len(content) + 1)
    return rng.choice(
        [
            lambda: b"\xef\xbb\xbf" + content,
            lambda: text.encode("utf-16", errors="replace"),
            lambda: text.encode("utf-16-le", errors="replace"),
            lambda: text.encode("utf-32", errors="replace"),
            lambda: text.encode("cp037", errors="replace"),
            lambda: content[:k] + "°".encode("latin-1") + content[k:],
            lambda: content[:k] + "é".encode() + content[k:],
            lambda: content[:k] + b"\0" + content[k:],
            lambda: content.replace(b"\n", b"\r\n"),
            lambda: content.replace(b"\n", b"\r"),
            lambda: b"",
            lambda: b"\n" * 3,
            lambda: content + b"\x1a",
            lambda: content[:k] + b"\xe2\x80\x8b" + content[k:],
        ]
    )()


def line_doubled(rng: Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    k = rng.randrange(len(lines))
    return b"\n".join([*lines[: k + 1], *lines[k:]])


def line_dropped(rng: Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    k = rng.randrange(len(lines))
    return b"\n".join([*lines[:k], *lines[k + 1 :]])


def lines_swapped(rng: Random, content: bytes) -> bytes:
    lines = content.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


# MJCF

ATTRIBUTE = re.compile(r'(?<!\w)(\w+)="([^"]*)"')
SETTERS: dict[str, list[tuple[str, list[str]]]] = {
    "flag": [
        (f, ["disable", "enable"])
        for f in (
            "constraint equality frictionloss limit contact spring damper gravity clampctrl "
            "warmstart filterparent actuation refsafe sensor midphase override energy "
            "fwdinv invdiscrete multiccd island nativeccd autoreset eulerdamp"
        ).split()
    ],
    "option": [
        ("timestep", ["0", "1e9", "-1", "1e-9", "0.02", "1e-320"]),
        ("gravity", ["0 9.81 0", "0 0 -9.81", "-9.81 0 0", "0 0 0", "0 -9.81", "0 -1e30 0"]),
        ("integrator", ["Euler", "implicit", "rk4", "foo"]),
        ("solver", ["PGS", "CG"]),
        ("iterations", ["0", "1", "-5", "1000000000"]),
        ("tolerance", ["0", "-1", "1e9"]),
        ("jacobian", ["sparse", "auto"]),
        ("cone", ["elliptic"]),
        ("density", ["1000"]),
        ("viscosity", ["1"]),
        ("wind", ["1 0 0"]),
        ("impratio", ["0", "1e9"]),
        ("o_solref", ["1 1"]),
        ("disableactuator", ["0"]),
        ("magnetic", ["1 0 0"]),
    ],
    "compiler": [
        ("angle", ["degree"]),
        ("autolimits", ["false"]),
        ("eulerseq", ["zyx"]),
        ("inertiafromgeom", ["true"]),
        ("boundmass", ["10"]),
        ("settotalmass", ["1"]),
        ("fusestatic", ["true"]),
        ("balanceinertia", ["true"]),
        ("coordinate", ["global"]),
        ("discardvisual", ["true"]),
        ("usethread", ["false"]),
        ("alignfree", ["true"]),
    ],
    "joint": [
        ("frictionloss", ["0.1", "10", "-1"]),
        ("range", ["-0.1 0.1", "0.5 0.2", "1 2", "-10 10", "0 0"]),
        ("damping", ["0.5", "-1", "1e9"]),
        ("armature", ["0.1", "1e6", "-1"]),
        ("stiffness", ["1", "-1", "100"]),
        ("springref", ["1"]),
        ("ref", ["0.5", "1"]),
        ("axis", ["0 0 -1", "0 1 0", "0 0.1 1", "0 0 0", "1 0 0"]),
        ("type", ["slide", "ball", "free", "hinge"]),
        ("pos", ["0.1 0 0", "0 0 1"]),
        ("limited", ["true", "false"]),
        ("actuatorfrcrange", ["-0.1 0.1"]),
        ("actuatorgravcomp", ["true"]),
        ("margin", ["1"]),
        ("springdamper", ["1 1"]),
        ("solreflimit", ["0 0", "-1 -1"]),
        ("name", ["crank", "", "rocker", "pivot"]),
    ],
    "body": [
        ("gravcomp", ["1"]),
        ("mocap", ["true"]),
        ("euler", ["0 0 0.3", "0.3 0 0"]),
        ("quat", ["0 0 0 1", "0 0 0 0"]),
        ("pos", ["0 0 0", "1 1 1"]),
        ("childclass", ["x"]),
    ],
    "inertial": [
        ("mass", ["0", "-1", "1e30", "1e-30"]),
        ("diaginertia", ["0 0 0", "1 1 10"]),
        ("pos", ["0 0 0", "0 0 1"]),
    ],
    "geom": [
        ("mass", ["1"]),
        ("type", ["mesh", "plane", "box"]),
        ("size", ["0", "1e9", "-1"]),
        ("contype", ["0"]),
        ("rgba", ["1 0 0 1"]),
        ("mesh", ["none"]),
        ("fromto", ["0 0 0 0 0 0"]),
        ("material", ["none"]),
    ],
    "site": [("pos", ["0 0 0", "2 0 0"]), ("euler", ["0 0 1"]), ("name", ["point", "tip", ""])],
    "connect": [
        ("active", ["false"]),
        ("solref", ["0 0", "1e9 1", "-1 -1", "0.02 1"]),
        ("solimp", ["0 0 0", "2 2 2", "0.9 0.95 0.001"]),
        ("site2", ["point", "none"]),
        ("body1", ["crank"]),
        ("anchor", ["0 0 0"]),
    ],
    "motor": [
        ("gear", ["0", "2", "-1", "nan"]),
        ("ctrlrange", ["-1 1", "1 -1"]),
        ("forcerange", ["-0.1 0.1"]),
        ("joint", ["coupler", "rocker", "slider"]),
        ("ctrllimited", ["true"]),
        ("group", ["0"]),
    ],
    "key": [
        ("qvel", ["1 1 1", "1"]),
        ("time", ["5"]),
        ("ctrl", ["1", "1 1", "100"]),
        ("name", ["start", "", "other"]),
        ("qpos", ["", "0", "0 0 0", "1 2 3 4 5 6 7"]),
    ],
    "sensor/*": [
        ("cutoff", ["0.1"]),
        ("noise", ["1"]),
        ("objtype", ["geom", "body", "site"]),
        ("reftype", ["site"]),
        ("delay", ["0.1"]),
        ("interval", ["0.1"]),
        ("nsample", ["3"]),
        ("dim", ["3", "0", "1000000000"]),
        ("needstage", ["pos"]),
        ("datatype", ["axis"]),
    ],
    "equality": [("solref", ["0 0"]), ("active", ["false"])],
    "*": [("class", ["none"]), ("user", ["1 2 3"]), ("group", ["7", "-1"]), ("nosuch", ["1"])],
}
INSERTS: dict[str, list[str]] = {
    "worldbody": [
        '<geom type="plane" size="1 1 1"/>',
        '<body name="ball"><freejoint/><geom size="0.1"/></body>',
        "<light/>",
        '<camera name="c"/>',
        '<body mocap="true" name="m"/>',
        '<site name="point"/>',
        '<frame pos="1 0 0"/>',
        "<body/>",
        '<replicate count="{n}"><site/></replicate>',
        '<replicate count="{n}"><geom size="1"/></replicate>',
        "<foo/>",
        '<include file="{self}"/>',
        '<include file="none.xml"/>',
        "<include/>",
        '<composite type="cable" count="5 1 1" size="1"/>',
        '<flexcomp type="grid" name="f" count="{n} 2 2"/>',
    ],
    "mujoco": [
        '<include file="{self}"/>',
        '<include file="none.xml"/>',
        '<size memory="1K"/>',
        '<size nkey="{n}"/>',
        '<size nuser_body="{n}"/>',
        '<size njmax="1"/>',
        "<visual/>",
        "<option/>",
        '<option gravity="0 9.81 0"/>',
        '<default class="main"><joint damping="1"/></default>',
        '<default><joint frictionloss="1"/></default>',
        '<default><joint range="-0.1 0.1"/></default>',
        '<statistic extent="1e9"/>',
        '<statistic extent="1e-9" center="1 1 1"/>',
        '<statistic meaninertia="1e-9"/>',
        '<custom><text name="a" data="b"/></custom>',
        '<custom><numeric name="a" size="{n}"/></custom>',
        '<asset><mesh name="m" file="none.stl"/></asset>',
        '<asset><hfield name="h" nrow="{n}" ncol="{n}" size="1 1 1 1"/></asset>',
        '<asset><texture name="t" type="2d" builtin="flat" width="{n}" height="9"/></asset>',
        '<tendon><fixed name="t" frictionloss="1"><joint joint="crank" coef="1"/></fixed></tendon>',
        '<tendon><fixed name="t" stiffness="10"><joint joint="crank" coef="1"/></fixed></tendon>',
        '<extension><plugin plugin="mujoco.pid"/></extension>',
        "<worldbody/>",
        "<contact/>",
        '<keyframe><key name="start"/></keyframe>',
        "<!-- a -- b -->",
        "<!-- a --->",
        "<?foo?>",
        "<![CDATA[x]]>",
        "&amp;",
        "&nbsp;",
        "text",
        "<!DOCTYPE a>",
        "<unknown/>",
        '<equality><joint joint1="crank"/></equality>',
        '<equality><joint joint1="crank" joint2="coupler"/></equality>',
        '<equality><weld body1="crank"/></equality>',
    ],
    "actuator": [
        '<position joint="crank" kp="10"/>',
        '<velocity joint="crank" kv="10"/>',
        '<motor joint="coupler"/>',
        '<damper joint="crank" kv="1" ctrlrange="0 1"/>',
        '<general joint="crank" biastype="affine" biasprm="1 1 1"/>',
        '<muscle joint="crank"/>',
    ],
    "keyframe": ['<key name="start" qpos="0"/>', "<key/>", '<key name="other"/>'],
    "sensor": [
        '<clock name="t"/>',
        '<jointpos name="x" joint="none"/>',
        '<user name="u" dim="{n}"/>',
        '<rangefinder site="point"/>',
        '<contact name="c"/>',
    ],
}
COUNTS = ["0", "1", "-1", "1000", "1000000", "1000000000", "99999999999999999999"]


def find_attributes(text: str) -> list[re.Match]:
    return list(ATTRIBUTE.finditer(text))


def x_number(rng: Random, content: bytes) -> bytes:
    text = text_of(content)
    hits = [m for m in find_attributes(text) if NUMBER.fullmatch((m[2].split() or ["x"])[0])]
    if not hits:
        return content
    hit, kind = rng.choice(hits), rng.random()
    parts = hit[2].split()
    if kind < 0.06:
        parts.append("1")
    elif kind < 0.12:
        parts.pop()
    elif kind < 0.18 and len(parts) > 1:
        rng.shuffle(parts)
    else:
        k = rng.randrange(len(parts))
        parts[k] = changed_number(rng, parts[k])
    return bytes_of(text[: hit.start(2)] + " ".join(parts) + text[hit.end(2) :])


def x_attribute(rng: Random, content: bytes) -> bytes:
    text = text_of(content)
    hits = find_attributes(text)
    if not hits:
        return content
    hit = rng.choice(hits)
    same = [m[2] for m in hits if m[1] == hit[1]]
    names = [m[2] for m in hits if m[1] == "name"]
    new = rng.choice(
        [
            lambda: "",
            lambda: f'{word_with_typo(rng, hit[1])}="{hit[2]}"',
            lambda: f"{hit[0]} {hit[0]}",
            lambda: f'{hit[1]}="{word_with_typo(rng, hit[2])}"',
            lambda: f'{hit[1]}="{odd_word(rng, same)}"',
            lambda: f'{hit[1]}="{odd_word(rng, names)}"',
            lambda: hit[0].replace('"', "'"),
            lambda: f"{hit[1]}={hit[2]}",
            lambda: f'{rng.choice(hits)[1]}="{hit[2]}"',
        ]
    )()
    return bytes_of(text[: hit.start()] + new + text[hit.end() :])


def x_names_swapped(rng: Random, content: bytes) -> bytes:
    text = text_of(content)
    key = rng.choice(["name", "joint", "site", "objname", "site1", "site2", "joint", "objname"])
    hits = [m for m in find_attributes(text) if m[1] == key]
    if len(hits) < 2:
        return content
    one, two = sorted(rng.sample(hits, 2), key=lambda m: m.start())
    return bytes_of(
        text[: one.start(2)]
        + two[2]
        + text[one.end(2) : two.start(2)]
        + one[2]
        + text[two.end(2) :]
    )


def parse_xml(content: bytes) -> ElementTree.Element | None:
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError):
        return None


def format_xml(root: ElementTree.Element) -> bytes:
    return bytes_of(ElementTree.tostring(root, encoding="unicode"))


def x_element(rng: Random, content: bytes) -> bytes:
    root = parse_xml(content)
    if root is None:
        return content
    pairs = [(parent, child) for parent in root.iter() for child in parent]
    if not pairs:
        return content
    parent, child = rng.choice(pairs)
    kind = rng.choice("remove double move swap rename".split())
    if kind in ("remove", "move"):
        parent.remove(child)
    if kind == "double":
        parent.insert(rng.randrange(len(parent) + 1), child)
    if kind == "move":
        rng.choice(list(root.iter())).append(child)
    if kind == "swap":
        k, j = list(parent).index(child), rng.randrange(len(parent))
        parent[k], parent[j] = parent[j], parent[k]
    if kind == "rename":
        child.tag = rng.choice([word_with_typo(rng, child.tag), rng.choice(pairs)[1].tag])
    try:
        return format_xml(root)
    except RecursionError:  # moved into itself
        return content


def x_set(rng: Random, content: bytes) -> bytes:
    root = parse_xml(content)
    if root is None:
        return content
    tag = rng.choice([*SETTERS, "joint", "joint", "flag", "flag", "option"])
    attribute, values = rng.choice(SETTERS[tag])
    found = [e for e in root.iterfind(f".//{tag}") if e is not root]
    if not found:
        if tag not in ("flag", "compiler"):
            return content
        parent = root.find("option") if tag == "flag" else root
        if parent is None:
            return content
        found = [ElementTree.SubElement(parent, tag)]
    rng.choice(found).set(attribute, rng.choice(values))
    return format_xml(root)


def x_insert(rng: Random, content: bytes) -> bytes:
    text = text_of(content)
    section = rng.choice([*INSERTS, "mujoco", "mujoco"])
    places = [m.end() for m in re.finditer(rf"<{section}(?:\s[^>]*)?(?<!/)>", text)]
    if not places:
        return content
    model = re.search(r'model="(\w+)"', text)
    snippet = rng.choice(INSERTS[section]).replace("{n}", rng.choice(COUNTS))
    snippet = snippet.replace("{self}", f"{model[1] if model else 'x'}.xml")
    k = places[0]
    return bytes_of(text[:k] + snippet + text[k:])


# TOML

SETTINGS = [
    "timestep = 0",
    "timestep = -1e-3",
    "timestep = 1e9",
    "timestep = 1e-9",
    'timestep = "a"',
    "iterations = -1",
    "iterations = 0",
    "iterations = 1000000000",
    "iterations = 1.5",
    "tolerance = nan",
    'integrator = "foo"',
    'integrator = "Euler"',
    "integrator = 3",
    'defaults = "yes"',
    "defaults = true",
    "flex = true",
    "settled = true",
    "settled = 1",
    "error_bias = 2",
    "error_bias = -1",
    'error_bias = "a"',
    "error_bias = 0.1",
    "solref = [0.02, 1]",
    "solref = []",
    "solref = [1, 2, 3, 4, 5, 6, 7]",
    'solref = "a"',
    "solimp = [nan, 1, 1]",
    "solimp = {}",
    "nosuch = 1",
    'solver = "PGS"',
    "timestep = true",
    "timestep = [1]",
    "tolerance = -1",
]
VALUES = [
    "1",
    "-1",
    "0",
    "true",
    '""',
    '"x"',
    "[]",
    "[1, 2]",
    '["x"]',
    "{}",
    "{ a = 1 }",
    "nan",
    "inf",
    "1979-05-27",
    "1e400",
    "1e9",
    "1000000000000",
    "99999999999999999999",
    "[[1]]",
    "0.5",
    "'''\na\n'''",
    "-0.0",
    '"planar"',
    '"mujoco"',
    '"*"',
    '"["',
    "1.0",
]
TABLES = [
    '[[view]]\ntitle = "a"\nx = "{c}"\ny = "{c}"',
    "[[view]]\ntitle = 1",
    '[[view]]\nx = "no"',
    '[[view]]\ntitle = "a"\nx = "{c}"\nstack = ["no"]',
    '[[chart]]\ntitle = "a"\ndraw = "solve"',
    '[[chart]]\ntitle = "a"\ndraw = "np"',
    '[[chart]]\ntitle = "a"\ndraw = "__doc__"',
    "[compare_with.x]\nparameters = { crank = 1.0 }",
    '[refine]\nsegments = [2, 4]\norder = 2\nwithin = 1\nwhy = "a"',
    '[rod.r]\nfrom = "a"\nlength = 1\nstiffness = 1\nsegments = {n}',
    '[run.equilibrium]\nn = 3\nsolvers = ["mujoco"]',
    '[run.dynamics]\nn = 5\nuntil = 0.1\nsolvers = ["pymunk"]',
    '[[drive]]\njoint = "coupler"\nfrom = 0\nto = 0',
    '[[tolerance]]\nabs = 1\nwhy = "a"',
    '[[tolerance]]\nrelative_to_range = 1\nchannels = "["\nwhy = "a"',
    "[settings.mujoco]\n{s}",
    "[settings.pymunk]\n{s}",
    "[settings.mujoco]\n{s}",
    "[settings.pymunk]\n{s}",
    '[settings."mujoco:default"]\n{s}',
    "[settings]\nmujoco = 1",
    "[parameters.x]\na = 1",
    "[nosuch]\na = 1",
]
SCALES, SHIFTS = ["-1", "0", "2", "nan", "1.0001"], ["6.283185307179586", "0.1", "inf"]
KINDS = ["sweep", "dynamics", "equilibrium", "x"]
UNITS = ["mm", "deg", "rad", "m", "deg/s", "rpm", "s", "1", "", "m^x", "m^", "rad/s^-2"]
TOML_WORD = re.compile(r'"([^"\n]*)"')


def t_number(rng: Random, content: bytes) -> bytes:
    lines = text_of(content).split("\n")
    places = [
        k
        for k, line in enumerate(lines)
        if re.match(r"[^#]*=\s*[-\[{\d]", line)
        and NUMBER.search(line.split("#")[0].partition("=")[2])
    ]
    if not places:
        return content
    k = rng.choice(places)
    key, _, rest = lines[k].partition("=")
    value, mark, comment = rest.partition("#")
    lines[k] = f"{key}={change_number_in_line(rng, value)}{mark}{comment}"
    return bytes_of("\n".join(lines))


def t_line(rng: Random, content: bytes) -> bytes:
    lines = text_of(content).split("\n")
    places = [k for k, line in enumerate(lines) if "=" in line or line.startswith("[")]
    if not places:
        return content
    k = rng.choice(places)
    key, _, value = lines[k].partition("=")
    kind = rng.choice("remove typo double value value value".split())
    if kind == "remove":
        del lines[k]
    elif kind == "double":
        lines.insert(rng.choice(places), lines[k])
    elif kind == "typo":
        lines[k] = (
            f"{word_with_typo(rng, key.rstrip())} ={value}"
            if value
            else word_with_typo(rng, lines[k])
        )
    elif value:
        other = lines[rng.choice(places)].partition("=")[2] or " 1"
        lines[k] = f"{key}={rng.choice([' ' + rng.choice(VALUES), other])}"
    return bytes_of("\n".join(lines))


def t_word(rng: Random, content: bytes) -> bytes:
    text = text_of(content)
    hits = list(TOML_WORD.finditer(text))
    if not hits:
        return content
    hit = rng.choice(hits)
    new = word_with_typo(rng, hit[1]) if rng.random() < 0.4 else odd_word(rng, [m[1] for m in hits])
    if rng.random() < 0.8:  # otherwise TOML refuses a backslash
        new = new.replace("\\", "\\\\")
    return bytes_of(text[: hit.start(1)] + new + text[hit.end(1) :])


def t_table(rng: Random, content: bytes) -> bytes:
    blocks = re.split(r"(?m)^(?=\[)", text_of(content))
    k = rng.randrange(len(blocks))
    kind = rng.choice("remove double swap add add add".split())
    if kind == "remove":
        del blocks[k]
    elif kind == "double":
        blocks.insert(k, blocks[k])
    elif kind == "swap":
        j = rng.randrange(len(blocks))
        blocks[k], blocks[j] = blocks[j], blocks[k]
    else:
        names = [n.strip('"') for n in re.findall(r'(?m)^("?[\w.]+"?) = \{', text_of(content))]
        block = rng.choice(TABLES).replace("{c}", rng.choice(names or ["x"]))
        block = block.replace("{s}", rng.choice(SETTINGS)).replace("{n}", rng.choice(COUNTS))
        blocks.append(f"\n{block}\n")
    return bytes_of("".join(blocks))


def t_samples(rng: Random, content: bytes) -> bytes:
    n = rng.choice(
        [
            "0",
            "1",
            "2",
            "-1",
            "3",
            "1e9",
            "1000000000",
            "100000000000",
            "true",
            '"7"',
            "7.0",
            "7.5",
            "99999999999999999999999",
        ]
    )
    key = rng.choice(["n", "n", "n", "until", "timeout", "segments", "rate", "period"])
    text = re.sub(rf"(?m)^{key} = \S+", f"{key} = {n}", text_of(content), count=rng.choice([0, 1]))
    return bytes_of(text)


def t_deep(rng: Random, content: bytes) -> bytes:
    n = rng.choice([50, 2000, 100_000])
    deep = rng.choice(
        [
            "a = " + "[" * n + "]" * n,
            "a = " + "{a=" * n + "1" + "}" * n,
            "a." * n + "a = 1",
            "[" + "a." * n + "a]",
            f'title2 = "{"x" * n * 10}"',
            "a = " + "9" * n,
            "title = " + "9" * n,
        ]
    )
    return bytes_of(deep + "\n") + content


def t_unit(rng: Random, content: bytes) -> bytes:
    """Change the unit, the scale, the shift or `only` of one channel."""
    text = text_of(content)
    hits = list(re.finditer(r'unit = "([^"]*)" ?', text))
    if not hits:
        return content
    hit = rng.choice(hits)
    new = rng.choice(
        [f'unit = "{u}" ' for u in ("m", "mm", "rad", "deg", "rad/s", "N m", "", "J", "M")]
        + [
            hit[0].rstrip() + f", scale = {rng.choice(SCALES)} ",
            hit[0].rstrip() + f", shift = {rng.choice(SHIFTS)} ",
            hit[0].rstrip() + f', only = "{rng.choice(KINDS)}" ',
        ]
    )
    return bytes_of(text[: hit.start()] + new + text[hit.end() :])


# CSV


def parse_csv(content: bytes) -> tuple[list[list[str]], int]:
    rows = [line.split(",") for line in text_of(content).split("\n")]
    first = next((k for k, row in enumerate(rows) if not row[0].startswith("#")), 0)
    return rows, first


def format_csv(rows: list[list[str]]) -> bytes:
    return bytes_of("\n".join(",".join(row) for row in rows))


def c_cell(rng: Random, content: bytes) -> bytes:
    rows, first = parse_csv(content)
    below = [row for row in rows[first + 1 :] if len(row) > 1]
    if not below:
        return content
    row = rng.choice(below)
    k = rng.randrange(len(row))
    row[k] = changed_number(rng, row[k])
    return format_csv(rows)


def c_header(rng: Random, content: bytes) -> bytes:
    rows, first = parse_csv(content)
    row = rows[first]
    k = rng.randrange(len(row))
    name, _, unit = row[k].partition(" [")
    row[k] = rng.choice(
        [
            lambda: name,
            lambda: word_with_typo(rng, row[k]),
            lambda: row[rng.randrange(len(row))],
            lambda: "",
            lambda: f"{name} [{rng.choice(UNITS)}]",
            lambda: f"{name} ({unit}",
            lambda: f"{name} [{unit[:-1]}",
            lambda: f'"{row[k]}',
            lambda: f'"{row[k]}"',
            lambda: f"{name} [°]",
            lambda: f"{name} [deg^99999]",
            lambda: f"{name} [mm^-400]",
            lambda: f"{name} [[m]]",
            lambda: f"{name} [{unit[:-1]}^2]",
            lambda: f"{name}[{unit}",
        ]
    )()
    return format_csv(rows)


def c_column(rng: Random, content: bytes) -> bytes:
    rows, first = parse_csv(content)
    wide = len(rows[first])
    i, j = rng.randrange(wide), rng.randrange(wide)
    kind = rng.choice("drop double swap content".split())
    for k, row in enumerate(rows[first:]):
        if len(row) < wide:
            continue
        if kind == "drop":
            del row[i]
        elif kind == "double":
            row.append(row[i])
        elif kind == "swap" or k:
            row[i], row[j] = row[j], row[i]
    return format_csv(rows)


def c_separator(rng: Random, content: bytes) -> bytes:
    return rng.choice(
        [
            lambda: content.replace(b",", b";"),
            lambda: content.replace(b",", b"\t"),
            lambda: content.replace(b",", b" "),
            lambda: content.replace(b",", b";").replace(b".", b","),
            lambda: content.replace(b",", b", "),
            lambda: b'"' + content,
            lambda: b"sep=,\n" + content,
            lambda: content.replace(b"\n", b",\n"),
            lambda: content.replace(b"\n", b"\n\n"),
            lambda: content + b"9" * 200_000,
        ]
    )()


def c_constant(rng: Random, content: bytes) -> bytes:
    """Scale a column, make it constant, or shift it."""
    rows, first = parse_csv(content)
    k, factor = rng.randrange(len(rows[first])), rng.choice([0.0, 1.0, 2.0, -1.0, 1.001])
    more = rng.choice([0.0, 0.0, 1.0, 6.283185307179586])
    for row in rows[first + 1 :]:
        if len(row) > k:
            try:
                row[k] = f"{float(row[k]) * factor + more:.17g}"
            except ValueError:
                continue
    return format_csv(rows)


COMMON: dict[str, tuple[Mutator, int]] = {
    "truncated": (truncated, 2),
    "flipped": (flipped, 3),
    "encoded": (encoded, 3),
    "line_doubled": (line_doubled, 1),
    "line_dropped": (line_dropped, 2),
    "lines_swapped": (lines_swapped, 1),
}
MUTATORS: dict[str, dict[str, tuple[Mutator, int]]] = {  # with weights
    ".xml": {
        **COMMON,
        "x_number": (x_number, 14),
        "x_attribute": (x_attribute, 8),
        "x_names_swapped": (x_names_swapped, 4),
        "x_element": (x_element, 7),
        "x_set": (x_set, 14),
        "x_insert": (x_insert, 8),
    },
    ".toml": {
        **COMMON,
        "t_number": (t_number, 12),
        "t_line": (t_line, 8),
        "t_word": (t_word, 8),
        "t_table": (t_table, 8),
        "t_samples": (t_samples, 3),
        "t_deep": (t_deep, 1),
        "t_unit": (t_unit, 5),
    },
    ".csv": {
        **COMMON,
        "c_cell": (c_cell, 8),
        "c_header": (c_header, 8),
        "c_column": (c_column, 4),
        "c_separator": (c_separator, 3),
        "c_constant": (c_constant, 4),
    },
}


def draw_mutations(rng: Random, endings: list[str]) -> list[Mutation]:
    """Draw one to three mutations of files with these endings."""
    found = []
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        ending = rng.choice(endings)
        names = list(MUTATORS[ending])
        name = rng.choices(names, [MUTATORS[ending][n][1] for n in names])[0]
        found.append(Mutation(ending, name, rng.getrandbits(32)))
    return found


def apply_mutations(files: dict[str, bytes], mutations: list[Mutation]) -> dict[str, bytes]:
    """The files after all mutations, which are applied one after the other."""
    changed = dict(files)
    for mutation in mutations:
        name = next(n for n in changed if n.endswith(mutation.ending))
        act = MUTATORS[mutation.ending][mutation.mutator][0]
        changed[name] = act(Random(mutation.seed), changed[name])
    return changed
