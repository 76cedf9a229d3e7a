"""Lines of a sidecar that use a clean table: as truth, as party, as profile, or as path."""

import json
import re
from enum import StrEnum

from proofmass.tables.foreign import ForeignColumn, ForeignTable
from proofmass.tables.headers import ACCELERATION_WORDS, is_angle_name, is_time_name, words_of
from proofmass.tables.unit_words import dimension

TIME_UNIT = "s"  # the unit that is proposed for an x without one
PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]+")


class TableRole(StrEnum):
    """What a table is in a case."""

    TRUTH = "truth"
    PARTY = "party"
    PROFILE = "profile"
    PATH = "path"


def sidecar_lines(table: ForeignTable, name: str, role: TableRole) -> list[str]:
    """Lines to copy into a sidecar in the folder of the clean table.

    Parameters
    ----------
    table : ForeignTable
    name : str
        Name of the file with the clean table.
    role : TableRole

    Returns
    -------
    list of str
    """
    by_role = {
        TableRole.TRUTH: truth,
        TableRole.PARTY: party,
        TableRole.PROFILE: profile,
        TableRole.PATH: path,
    }
    return by_role[role](table, name)


def truth(table: ForeignTable, name: str) -> list[str]:
    """Lines that make a table the reference of a case."""
    lines = [f"reference = {quote(name)}"]
    unknown = [column for column in table.columns if not column.unit]
    if unknown:
        lines += ["", "[recording]"]
    for column in unknown:
        if column is table.columns[0]:
            lines.append(f"x = {column_table(column, TIME_UNIT)}   # the file has no unit")
        else:
            lines.append(
                f"columns.{key(column.name)} = {{ unit = {quote(guess(column))} }}"
                "   # the file has no unit"
            )
    lines += ["", "[channels]   # a sensor of the model = a column"]
    for column in table.columns[1:]:
        unit = quote(column.unit or guess(column))
        line = f"{key(column.name)} = {{ equals = {quote(column.name)}, unit = {unit} }}"
        lines.append(line if all(column.cells) else f"# {line}   # has empty cells")
    return lines


def party(table: ForeignTable, name: str) -> list[str]:
    """Lines that make a table a party, which is compared with the reference."""
    x = table.columns[0]
    word = solver_name(name)
    solver = f'settings."recorded:{word}"'
    lines = [f'# in the table of a run: solvers = ["mujoco", "recorded:{word}"]']
    lines += [f"[{solver}]", f"file = {quote(name)}"]
    lines.append(f"x = {quote(x.name) if x.unit else column_table(x, TIME_UNIT)}")
    lines += ["", f"[{solver}.channels]   # a channel = a column"]
    for column in table.columns[1:]:
        value = quote(column.name) if column.unit else column_table(column)
        line = f"{key(column.name)} = {value}"
        lines.append(line if all(column.cells) else f"# {line}   # has empty cells")
    return lines


def profile(table: ForeignTable, name: str) -> list[str]:
    """Lines that let a drive follow a table."""
    x = table.columns[0]
    time = "" if x.unit else f", time = {column_table(x, TIME_UNIT)}"
    lines = ["[drive]", 'joint = "JOINT"   # the joint that follows the rows']
    found = [(c, role) for c in table.columns[1:] if (role := drive_role(c)) and all(c.cells)]
    found.sort(key=lambda one: one[1] != "value")
    for k, (column, role) in enumerate(found):
        value = quote(column.name) if column.unit else column_table(column)
        line = f"profile = {{ file = {quote(name)}{time}, {role} = {value} }}"
        lines.append(f"# or: {line}" if k else line)
    if not found:
        lines.append("# no column is a position or a velocity of a joint")
    return lines


def path(table: ForeignTable, name: str) -> list[str]:
    """Lines that let all drives lead an end point or a platform along a table, under its loads."""
    kinds = {c: dimension(c.unit or guess(c)) for c in table.columns if all(c.cells)}
    places = {
        letter: column
        for letter, kind in (("x", "m"), ("y", "m"), ("phi", "rad"))
        if (column := coordinate(letter, [c for c in kinds if kinds[c] == kind]))
    }
    if not {"x", "y"} <= places.keys():
        return ["# no two columns are the places x and y of a path"]
    parts = [f"path = {quote(name)}"] + [
        f"{letter} = {quote(column.name) if column.unit else column_table(column)}"
        for letter, column in places.items()
    ]
    lines = ["[[drive]]", 'joint = "JOINT"   # the first drive of the reference']
    lines.append(f"profile = {{ {', '.join(parts)} }}")
    if kinds.get(table.columns[0]) != TIME_UNIT:
        lines.append("until = 1.0   # s, for all rows, which have no times")
    lines += ["", "[[drive]]   # and one for each further drive, in the order of the reference"]
    lines.append('joint = "JOINT_2"')
    for column in (c for c, kind in kinds.items() if kind in ("N", "N m")):
        value = quote(column.name) if column.unit else column_table(column)
        lines += ["", "[[load]]", f'actuator = "MOTOR"   # that applies {column.name}']
        lines.append(f"profile = {{ file = {quote(name)}, value = {value} }}")
        lines.append(
            'scales = "PARAMETER"   # 1 in [parameters]; leave it out without a closed form'
        )
    return lines


def coordinate(letter: str, columns: list[ForeignColumn]) -> ForeignColumn | None:
    """The column that has a coordinate in its name; for an angle the first one else."""
    named = (column for column in columns if letter in words_of(column.name))
    return next(named, columns[0] if columns and letter == "phi" else None)


def drive_role(column: ForeignColumn) -> str:
    """Whether a column may be the value or the rate of a drive; empty if it is neither."""
    kind = dimension(column.unit or guess(column))
    return {"rad": "value", "m": "value", "rad/s": "rate", "m/s": "rate"}.get(kind, "")


def guess(column: ForeignColumn) -> str:
    """The unit that is proposed for a column without one.

    >>> [guess(ForeignColumn(name, ())) for name in ("theta", "v_{x}", "time", "omega", "a_y", "y")]
    ['rad', 'm/s', 's', 'rad/s', 'm/s^2', 'm']
    """
    words = words_of(column.name)
    if is_time_name(column.name):
        return "s"
    if is_angle_name(column.name):
        return "rad"
    if words & {"omega", "w", "ω", "angvel"} or {"angular", "velocity"} <= words:
        return "rad/s"
    first = column.name[:2].lower()
    if first in ("v_", "vx", "vy", "vz", "v") or words & {"velocity", "speed", "vel"}:
        return "m/s"
    if first in ("a_", "ax", "ay", "az", "a") or words & ACCELERATION_WORDS:
        return "m/s^2"
    return "N" if words & {"force", "f", "fx", "fy", "fz"} else "m"


def column_table(column: ForeignColumn, unit: str = "") -> str:
    """A column with a proposed unit, as a table of TOML."""
    return f"{{ column = {quote(column.name)}, unit = {quote(unit or guess(column))} }}"


def solver_name(name: str) -> str:
    """A word for the solver of a file.

    >>> solver_name("run 3 (new).csv")
    'run_3_new'
    """
    return re.sub(r"\W+", "_", name.rpartition(".")[0]).strip("_") or "other"


def key(name: str) -> str:
    """A name as a key of TOML."""
    return name if PLAIN_KEY.fullmatch(name) else quote(name)


def quote(text: str) -> str:
    """A text as a string of TOML."""
    return json.dumps(text, ensure_ascii=False)
