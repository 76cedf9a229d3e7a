"""Files in the shapes that programs write, made from closed forms, with the numbers they have.

``python -m tests.tables.shapes FOLDER`` writes them all.  Each shape is made by a function below:
the numbers are those of a slider-crank with a crank of 0.1 m and a rod of 0.35 m that turns at a
constant rate, or of a pendulum of small amplitude.  No formula is shared with the package.  A shape
states, for each column that must come in, its unit and its numbers as they are printed in the file,
or what a stated rule makes of them.

The layouts are those of the programs' documentation and of exports that people published; no file
is copied.
"""

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from decimal import Decimal
from math import asin, cos, degrees, pi, sin, sqrt
from pathlib import Path
from typing import Any

CRANK, ROD = 0.1, 0.35  # [m]
OMEGA = 1.6 * pi  # [rad/s], 288 deg/s: a turn takes 1.25 s
STEP = 0.005  # [s] between rows
ROWS = 301
Texts = list[str]


@dataclass(frozen=True)
class TableShape:
    """A file in a shape, and what is right.

    Attributes
    ----------
    name : str
        Name of the file.
    shape : str
        The kind that it is of, as the table of outcomes has it.
    write : callable
        Writes the file to a path.
    columns : dict
        By the name of each column that must come in its unit, and its numbers as texts.
    options : tuple of str
        Options that the command needs.
    says : tuple of str
        Words that the account must have: what was changed is said.
    library : str
        A library that must be installed to write or read it.
    """

    name: str
    shape: str
    write: Callable[[Path], object]
    columns: dict[str, tuple[str, Texts]]
    options: tuple[str, ...] = ()
    says: tuple[str, ...] = ()
    library: str = ""


@dataclass
class Motion:
    """The slider-crank in time.

    Attributes
    ----------
    rows : int
    step : float
    """

    rows: int = ROWS
    step: float = STEP
    start: float = 0.0
    times: list[float] = field(init=False)

    def __post_init__(self) -> None:
        self.times = [self.start + k * self.step for k in range(self.rows)]

    def phi(self, t: float) -> float:
        """The crank angle [deg]."""
        return degrees(OMEGA * t)

    def psi(self, t: float) -> float:
        """The rod's angle [deg]."""
        return degrees(-asin(CRANK / ROD * sin(OMEGA * t)))

    def psi_rate(self, t: float) -> float:
        """The rate of the rod [deg/s]."""
        s = CRANK / ROD * sin(OMEGA * t)
        return degrees(-CRANK / ROD * OMEGA * cos(OMEGA * t) / sqrt(1 - s * s))

    def x(self, t: float) -> float:
        """The slider's place [mm]."""
        a = OMEGA * t
        return 1000 * (CRANK * cos(a) + sqrt(ROD**2 - (CRANK * sin(a)) ** 2))

    def y(self, t: float) -> float:
        """The height of the crank's pin [mm]."""
        return 1000 * CRANK * sin(OMEGA * t)

    def texts(self, curve: Callable[[float], float], form: str) -> Texts:
        """A curve as printed numbers."""
        return [format(curve(t), form) for t in self.times]

    def clock(self, form: str) -> Texts:
        """The times as printed numbers."""
        return [format(t, form) for t in self.times]


SHAPES: list[TableShape] = []
M = Motion()


def comma(texts: Texts) -> Texts:
    """Numbers with decimal commas."""
    return [text.replace(".", ",") for text in texts]


def lines(columns: Iterable[Texts], mark: str) -> str:
    """Rows of cells."""
    return "".join(mark.join(row) + "\n" for row in zip(*columns, strict=True))


def as_text(text: str, encoding: str = "utf-8", newline: str = "\n") -> Callable[[Path], object]:
    """A writer of a text."""
    return lambda path: path.write_bytes(text.replace("\n", newline).encode(encoding))


def add(
    name: str,
    shape: str,
    write: Callable[[Path], object],
    columns: dict[str, tuple[str, Texts]],
    *options: str,
    says: tuple[str, ...] = (),
    library: str = "",
) -> None:
    """Add a shape."""
    SHAPES.append(TableShape(name, shape, write, columns, options, says, library))


def minus(texts: Texts) -> Texts:
    """Numbers with the other sign."""
    return [format(-Decimal(text), "f") for text in texts]


# Adams and SolidWorks ---------------------------------------------------------------------------

T8, PSI8, RATE8 = (M.clock(".8E"), M.texts(M.psi, ".8E"), M.texts(M.psi_rate, ".8E"))
add(
    "adams.tab",
    "Adams, table",
    as_text(
        "ADAMS/View model name: crank\nLast_Run            : 2026-03-02 10:11:12\n\n"
        '"TIME"\t"rod.ANG"\t"rod.WZ"\n"sec"\t"deg"\t"deg/sec"\n' + lines([T8, PSI8, RATE8], "\t"),
        newline="\r\n",
    ),
    {"TIME": ("s", T8), "rod.ANG": ("deg", PSI8), "rod.WZ": ("deg/s", RATE8)},
    says=("lines 1 to 2 before the table are left out", "line 5 has the units"),
)


def results(title: str, angle: str, force: str) -> str:
    """A file of results: a map of columns, the model as it was read, and steps."""
    g17 = [M.clock(".17g"), M.texts(M.psi, ".17g"), M.texts(M.x, ".17g")]
    steps = "".join(
        f'<Step type="dynamic">\n{t}\n{a} {x}\n0 0.5\n</Step>\n'
        for t, a, x in zip(*g17, strict=True)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<Results xmlns="http://www.mscsoftware.com/:xrf10">\n'
        f'<Bibliography>\n<Application name="{title}" version="2022.01.00" />\n</Bibliography>\n'
        '<Analysis name="Last_Run" script="">\n'
        '<Units angle="deg" length="mm" mass="kg" time="sec" />\n'
        '<StepMap name="map_001">\n<Entity name="time">\n'
        '<Component name="TIME" unitsValue="sec" id="1" />\n</Entity>\n'
        '<Entity name="ROD_XFORM" entType="Part">\n'
        f'<Component name="PSI" unitsValue="{angle}" id="2" />\n'
        '<Component name="X" unitsValue="mm" id="3" />\n</Entity>\n'
        f'<Entity name="JOINT_1">\n<Component name="FX" unitsValue="{force}" id="4" />\n'
        '<Component name="TZ" unitsValue="newton-mm" id="5" />\n</Entity>\n</StepMap>\n'
        '<Data name="modelInput_001" id="1">\n'
        '<Step type="input">\n0\n99 99\n0 0\n</Step>\n</Data>\n'
        f'<Data name="dynamic_001" id="2">\n{steps}</Data>\n</Analysis>\n</Results>\n'
    )


G17 = {
    "TIME": ("s", M.clock(".17g")),
    "ROD_XFORM.PSI": ("deg", M.texts(M.psi, ".17g")),
    "ROD_XFORM.X": ("mm", M.texts(M.x, ".17g")),
    "JOINT_1.FX": ("N", ["0"] * ROWS),
    "JOINT_1.TZ": ("N mm", ["0.5"] * ROWS),
}
add("adams.res", "Adams, results (XML)", as_text(results("Adams View", "deg", "newton")), G17,
    says=("steps of kind input are left out",))  # fmt: skip
add("solidworks.res", "SolidWorks, results (XML)",
    as_text(results("SolidWorks Motion", "degrees", "newtons"), newline="\r\n"), G17)  # fmt: skip
T3, PSI4, RATE4, X3 = (
    M.clock(".3f"), M.texts(M.psi, ".4f"), M.texts(M.psi_rate, ".4f"), M.texts(M.x, ".3f"),
)  # fmt: skip
add(
    "solidworks.csv",
    "SolidWorks, CSV",
    as_text(
        "Angular Displacement1,\n"
        "Time (sec),Angular Displacement1 (deg),Angular Velocity2 (deg/sec)\n"
        + lines([T3, PSI4, RATE4], ","),
        newline="\r\n",
    ),
    {
        "Time": ("s", T3),
        "Angular Displacement1": ("deg", PSI4),
        "Angular Velocity2": ("deg/s", RATE4),
    },
    says=("line 1 before the table is left out: 'Angular Displacement1,'",),
)

# SAM and Inventor -------------------------------------------------------------------------------

T5, PSI5, X5 = M.clock(".5f"), M.texts(M.psi, ".5f"), M.texts(M.x, ".5f")
SAM = {"Time": ("s", T5), "Angle(4)": ("deg", PSI5), "X(3)": ("mm", X5)}
SAM_HEAD = "Time;Angle(4);X(3)\n[s];[deg];[mm]\n"
SAM_ROWS = lines(map(comma, [T5, PSI5, X5]), ";")
add("sam.csv", "SAM, semicolons and decimal commas", as_text(SAM_HEAD + SAM_ROWS, newline="\r\n"),
    SAM, says=("decimal commas became points",))  # fmt: skip
by_value = sorted(range(ROWS), key=lambda k: Decimal(PSI5[k]))
by_x = sorted(range(ROWS), key=lambda k: Decimal(X5[k]))
EXTREMES = "".join(
    f"{word};{PSI5[by_value[k]]};{X5[by_x[k]]}\n".replace(".", ",")
    for word, k in (("Minimum", 0), ("Maximum", -1))
)
add("sam_extremes.csv", "footer of extremes", as_text(SAM_HEAD + SAM_ROWS + "\n" + EXTREMES), SAM,
    says=("after the table are left out: 'Minimum;",))  # fmt: skip
LOW_HIGH = "".join(
    f"{T5[by_value[k]]};{PSI5[by_value[k]]};{X5[by_x[k]]}\n".replace(".", ",") for k in (0, -1)
)
add("rows_of_extremes.csv", "footer of extremes", as_text(SAM_HEAD + SAM_ROWS + LOW_HIGH), SAM,
    says=("the extremes of the columns",))  # fmt: skip
PSI6, V6 = M.texts(M.psi, ".6f"), M.texts(M.psi_rate, ".6f")
add(
    "inventor.csv",
    "Inventor, units beside names with brackets",
    as_text(
        "Tiempo ( s );P[4.1] ( grd );V[4.1] ( grd/s )\n" + lines(map(comma, [T5, PSI6, V6]), ";"),
        "cp1252",
    ),
    {"Tiempo": ("s", T5), "P(4.1)": ("deg", PSI6), "V(4.1)": ("deg/s", V6)},
    says=("'P[4.1]' is called 'P(4.1)'",),
)
add(
    "inventor.txt",
    "Inventor, units beside names with brackets",
    as_text(
        "Dynamic simulation\nVersion 2024\n\nTime ( s )\tP[1] ( deg )\tForce[2][X] ( N )\n"
        + lines([T5, PSI6, M.texts(M.y, ".4f")], "\t")
    ),
    {"Time": ("s", T5), "P(1)": ("deg", PSI6), "Force(2)(X)": ("N", M.texts(M.y, ".4f"))},
)

# LabVIEW ----------------------------------------------------------------------------------------

LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\n"
    "Decimal_Separator\t{decimal}\nMulti_Headings\tNo\nX_Columns\t{columns}\n"
    "Time_Pref\tAbsolute\nDate\t2026/03/02\nTime\t10:45:47{decimal}0352557\n"
    "***End_of_Header***\t\n\t\nChannels\t2\t\t\t\nSamples\t301\t301\t\t\n"
    "Y_Unit_Label\tdeg\tmm\t\nX_Dimension\tTime\tTime\t\n"
    "X0\t0{decimal}0000000000000000E+0\t0{decimal}0000000000000000E+0\t\n"
    "Delta_X\t0{decimal}005000\t0{decimal}005000\t\n***End_of_Header***\t\t\t\n"
)
T6, X6 = M.clock(".6f"), M.texts(M.x, ".6f")
LVM_COLUMNS = {"X_Value": ("s", T6), "rod": ("deg", PSI6), "slider": ("mm", X6)}
add(
    "rig.lvm",
    "LabVIEW, .lvm",
    as_text(
        LVM.format(decimal=".", columns="One")
        + "X_Value\trod\tslider\tComment\n"
        + lines([T6, PSI6, [f"{X6[0]}\tstart", f"{X6[1]}\t", *X6[2:]]], "\t"),
        newline="\r\n",
    ),
    LVM_COLUMNS,
    says=("a measurement of LabVIEW: lines 1 to 19",),
)
add(
    "rig_comma.lvm",
    "LabVIEW, .lvm",
    as_text(
        LVM.format(decimal=",", columns="One")
        + "X_Value\trod\tslider\tComment\n"
        + lines(map(comma, [T6, PSI6, X6]), "\t")
    ),
    LVM_COLUMNS,
    says=("decimal commas became points",),
)
add(
    "rig_no_times.lvm",
    "LabVIEW, times in the header",
    as_text(
        LVM.format(decimal=".", columns="No")
        + "X_Value\trod\tslider\tComment\n"
        + lines([[""] * ROWS, PSI6, X6], "\t")
    ),
    LVM_COLUMNS,
    says=("times follow from the header: X0 = 0E-16, Delta_X = 0.005000",),
)
add(
    "rig_multi.lvm",
    "LabVIEW, .lvm",
    as_text(
        LVM.format(decimal=".", columns="Multi").replace(
            "Y_Unit_Label\tdeg\t", "Y_Unit_Label\tdeg\t\t"
        )
        + "X_Value\trod\tX_Value\tslider\tComment\n"
        + lines([T6, PSI6, T6, X6], "\t")
    ),
    LVM_COLUMNS,
    says=("column X_Value (2) is left out: the clock of X_Value",),
)

# Excel ------------------------------------------------------------------------------------------


def workbook(fill: Callable[[Any], object]) -> Callable[[Path], object]:
    """A writer of a workbook."""

    def write(path: Path) -> None:
        from openpyxl import Workbook

        book = Workbook()
        fill(book)
        book.save(path)

    return write


def titled_sheet(book: Any) -> None:
    """A sheet with a title, names, units, and numbers from the second column on."""
    sheet = book.active
    sheet["B2"] = "Slider-crank, run 3"
    for k, (name, unit) in enumerate((("Time", "s"), ("psi", "deg"), ("x", "mm"))):
        sheet.cell(4, 2 + k, name)
        sheet.cell(5, 2 + k, unit)
    for row, cells in enumerate(zip(T5, PSI5, X5, strict=True)):
        for k, cell in enumerate(cells):
            sheet.cell(6 + row, 2 + k, float(cell))
    book.create_sheet("Notes")["A1"] = "nothing here"


add("sheet.xlsx", "Excel, .xlsx", workbook(titled_sheet),
    {"Time": ("s", T5), "psi": ("deg", PSI5), "x": ("mm", X5)}, library="openpyxl",
    says=("row 2 before the table is left out", "row 5 has the units"))  # fmt: skip


def formatted_sheet(book: Any) -> None:
    """A sheet whose numbers have their units in their formats, and that has a chart's copy."""
    sheet = book.active
    sheet.append(["t", "psi"])
    for t, psi in zip(T5, PSI5, strict=True):
        sheet.append([float(t), float(psi)])
        sheet.cell(sheet.max_row, 1).number_format = '0.000" s"'
        sheet.cell(sheet.max_row, 2).number_format = '0.00" deg"'


add("formats.xlsx", "Excel, .xlsx", workbook(formatted_sheet),
    {"t": ("s", T5), "psi": ("deg", PSI5)}, library="openpyxl",
    says=("cells of t had the unit 's' in them",))  # fmt: skip


def text_sheet(book: Any) -> None:
    """A sheet whose numbers are texts with decimal commas, as of a CSV that was pasted."""
    sheet = book.active
    sheet.append(["Zeit in s", "Winkel in Grad"])
    for t, psi in zip(comma(T5), comma(PSI5), strict=True):
        sheet.append([t, psi])


add("texts.xlsx", "Excel, .xlsx", workbook(text_sheet),
    {"Zeit": ("s", T5), "Winkel": ("deg", PSI5)}, library="openpyxl",
    says=("Grad of Winkel is German",))  # fmt: skip

# MATLAB and Simulink ----------------------------------------------------------------------------

FULL_T, FULL_PSI, FULL_X = (
    [repr(t) for t in M.times], [repr(M.psi(t)) for t in M.times], [repr(M.x(t)) for t in M.times],
)  # fmt: skip


def mat(**variables: Any) -> Callable[[Path], object]:
    """A writer of a file of MATLAB."""

    def write(path: Path) -> None:
        from scipy.io import savemat

        savemat(path, variables)

    return write


def column(texts: Texts) -> Any:
    """Numbers as a column of a matrix."""
    import numpy as np

    return np.array([[float(text)] for text in texts])


MAT = {"t": ("s", FULL_T), "psi": ("deg", FULL_PSI)}
add("vectors.mat", "MATLAB, vectors", mat(t=column(FULL_T), psi_deg=column(FULL_PSI), g=9.81), MAT)
add(
    "structure.mat",
    "MATLAB, structure with time",
    mat(
        out={
            "time": column(FULL_T),
            "signals": {"values": column(FULL_PSI), "label": "psi_deg", "dimensions": 1.0},
        }
    ),
    {"time": ("s", FULL_T), "psi": ("deg", FULL_PSI)},
)
add(
    "tofile.mat",
    "MATLAB, To File",
    mat(ans=[[float(v) for v in row] for row in (FULL_T, FULL_PSI, FULL_X)]),
    {"ans(1)": ("", FULL_T), "ans(2)": ("", FULL_PSI), "ans(3)": ("", FULL_X)},
)
add(
    "timetable.csv",
    "MATLAB, timetable",
    as_text("Time,psi_deg,x_mm\n" + lines([[f"{t} sec" for t in T3], PSI4, X3], ",")),
    {"Time": ("s", T3), "psi": ("deg", PSI4), "x": ("mm", X3)},
    says=("cells of Time had the unit 'sec' in them",),
)
add(
    "timetable_units.csv",
    "cells with units",
    as_text(
        "Time,psi,x\n"
        + lines([[f"{t} s" for t in T3], [f"{a}°" for a in PSI4], [f"{x} mm" for x in X3]], ",")
    ),
    {"Time": ("s", T3), "psi": ("deg", PSI4), "x": ("mm", X3)},
    says=("cells of psi had the unit '°' in them",),
)
add(
    "inspector.csv",
    "Simulink, data inspector",
    as_text(
        "time,rod angle,slider\n,Type: double,Type: double\n,Unit: deg,Unit: mm\n"
        ",Interp: linear,Interp: linear\n" + lines([T3, PSI4, X3], ",")
    ),
    {"time": ("s", T3), "rod angle": ("deg", PSI4), "slider": ("mm", X3)},
    says=("line 3 has the units",),
)

# Tracker, ROS, Parquet, phones ------------------------------------------------------------------

FILM = Motion(61, 1 / 30)
F9, FX, FY = FILM.clock(".9E"), FILM.texts(FILM.x, ".9E"), FILM.texts(FILM.y, ".9E")
FV = ["", *FILM.texts(FILM.psi_rate, ".9E")[1:-1], ""]
TRACKER = {"t": ("s", F9), "x": ("", FX), "y": ("", FY), "v_{x}": ("", FV)}
TRACKER_ROWS = [F9, FX, FY, FV]
add("tracker.txt", "Tracker",
    as_text("mass A\nt\tx\ty\tv_{x}\n" + lines(TRACKER_ROWS, "\t")), TRACKER,
    says=("column v_{x} is empty in lines 3 and 63",))  # fmt: skip
add("tracker_comma.txt", "Tracker",
    as_text("masse A\nt\tx\ty\tv_{x}\n" + lines(map(comma, TRACKER_ROWS), "\t")), TRACKER,
    says=("decimal commas became points",))  # fmt: skip
NANOSECONDS = [str(1714557600123456789 + k * 5_000_000) for k in range(ROWS)]
SECONDS_9 = [format(Decimal(k * 5_000_000).scaleb(-9), "f") for k in range(ROWS)]
add(
    "ros1.csv",
    "ROS, CSV",
    as_text(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.position0\n"
        + lines(
            [
                NANOSECONDS,
                [str(700 + k) for k in range(ROWS)],
                [str(int(n) - 250_000) for n in NANOSECONDS],
                ["base_link"] * ROWS,
                M.texts(M.psi, ".15g"),
            ],
            ",",
        )
    ),
    {
        "time": ("s", SECONDS_9),
        "field.header.seq": ("", [str(700 + k) for k in range(ROWS)]),
        "field.position0": ("", M.texts(M.psi, ".15g")),
    },
    says=("0 s is 2024-05-01T10:00:00.123456789Z", "field.header.frame_id is left out"),
)
add(
    "ros2.csv",
    "ROS, CSV",
    as_text(
        "header.stamp.sec,header.stamp.nanosec,position_rad\n"
        + lines(
            [
                [n[:-9] for n in NANOSECONDS],
                [str(int(n[-9:])) for n in NANOSECONDS],
                M.texts(lambda t: M.psi(t) * pi / 180, ".12f"),
            ],
            ",",
        )
    ),
    {
        "header.stamp": ("s", SECONDS_9),
        "position": ("rad", M.texts(lambda t: M.psi(t) * pi / 180, ".12f")),
    },
    says=("seconds and nanoseconds of header.stamp are one time",),
)


def parquet_file(columns: dict[str, tuple[str, Any]]) -> Callable[[Path], object]:
    """A writer of a file of Parquet."""

    def write(path: Path) -> None:
        import pyarrow as arrow
        from pyarrow import parquet

        arrays = [arrow.array(values) for _, values in columns.values()]
        fields = [
            arrow.field(name, array.type, metadata={"unit": unit} if unit else None)
            for (name, (unit, _)), array in zip(columns.items(), arrays, strict=True)
        ]
        parquet.write_table(arrow.table(arrays, schema=arrow.schema(fields)), path)

    return write


add("curves.parquet", "Parquet",
    parquet_file({"t [s]": ("", M.times), "psi": ("deg", [M.psi(t) for t in M.times])}),
    {"t": ("s", FULL_T), "psi": ("deg", FULL_PSI)}, library="pyarrow")  # fmt: skip


def stamped_parquet(path: Path) -> None:
    """A file of Parquet with stamps of time in nanoseconds."""
    import pyarrow as arrow
    from pyarrow import parquet

    stamps = arrow.array([int(n) for n in NANOSECONDS], arrow.timestamp("ns"))
    psi = arrow.array([float(v) for v in PSI4])
    parquet.write_table(arrow.table({"timestamp": stamps, "psi [deg]": psi}), path)


add("stamped.parquet", "Parquet", stamped_parquet,
    {"timestamp": ("s", SECONDS_9), "psi": ("deg", PSI4)}, library="pyarrow",
    says=("counts nanoseconds since 1970",))  # fmt: skip
add(
    "phyphox.csv",
    "phone, quoted names with units",
    as_text(
        '"Time (s)","Gyroscope z (rad/s)","Acceleration x (m/s^2)"\n'
        + lines([M.clock(".9E"), M.texts(M.psi_rate, ".9E"), M.texts(M.x, ".9E")], ",")
    ),
    {
        "Time": ("s", M.clock(".9E")),
        "Gyroscope z": ("rad/s", M.texts(M.psi_rate, ".9E")),
        "Acceleration x": ("m/s^2", M.texts(M.x, ".9E")),
    },
)

# Encodings --------------------------------------------------------------------------------------

UMLAUT = {"Zeit": ("s", T5), "Winkel φ": ("deg", PSI5), "Höhe": ("mm", M.texts(M.y, ".3f"))}
GERMAN = "Zeit [s]\tWinkel φ [°]\tHöhe [mm]\n" + lines(
    map(comma, [T5, PSI5, M.texts(M.y, ".3f")]), "\t"
)
add("unicode.txt", "UTF-16", as_text(GERMAN, "utf-16", "\r\n"), UMLAUT,
    says=("the text is in UTF-16",))  # fmt: skip
add("unicode_no_mark.txt", "UTF-16", as_text(GERMAN, "utf-16-le", "\r\n"), UMLAUT)
add("latin1.csv", "Latin-1",
    as_text(GERMAN.replace(" φ", "").replace("\t", ";"), "latin-1"),
    {"Zeit": UMLAUT["Zeit"], "Winkel": UMLAUT["Winkel φ"], "Höhe": UMLAUT["Höhe"]},
    says=("the text is in CP1252",))  # fmt: skip
add("mark.csv", "UTF-8 with a mark",
    as_text("\ufefft [s],ψ [°]\n" + lines([T5, PSI5], ",")),
    {"t": ("s", T5), "ψ": ("deg", PSI5)})  # fmt: skip
add("japanese.csv", "Shift-JIS",
    as_text("時間[秒],角度[度],変位[mm]\n" + lines([T5, PSI5, X5], ","), "cp932", "\r\n"),
    {"時間": ("s", T5), "角度": ("deg", PSI5), "変位": ("mm", X5)},
    says=("the text is in CP932",))  # fmt: skip

# Numbers ----------------------------------------------------------------------------------------

MICRO = [format(1000 * M.x(t), ".1f") for t in M.times]


def grouped(texts: Texts, group: str, decimal: str) -> Texts:
    """Numbers with groups of three digits."""
    return [
        format(Decimal(text), ",").replace(".", "d").replace(",", group).replace("d", decimal)
        for text in texts
    ]


add("grouped_english.csv", "grouped digits",
    as_text("t [s],x [um]\n" + lines([T3, [f'"{c}"' for c in grouped(MICRO, ",", ".")]], ",")),
    {"t": ("s", T3), "x": ("um", MICRO)}, says=("commas between groups",))  # fmt: skip
add("grouped_german.csv", "grouped digits",
    as_text("t [s];x [µm]\n" + lines([comma(T3), grouped(MICRO, ".", ",")], ";"), "cp1252"),
    {"t": ("s", T3), "x": ("um", MICRO)}, says=("points between groups",))  # fmt: skip
add("grouped_french.csv", "grouped digits",
    as_text("temps (s);x (µm)\n" + lines([comma(T3), grouped(MICRO, "\u202f", ",")], ";")),
    {"temps": ("s", T3), "x": ("um", MICRO)}, says=("blanks between groups",))  # fmt: skip
FORTRAN = [text.replace("E", "D") for text in PSI8]
add("fortran.dat", "Fortran, blanks",
    as_text("   TIME          PSI_DEG\n" + lines([["  " + t for t in T8], FORTRAN], "  ")),
    {"TIME": ("s", T8), "PSI": ("deg", PSI8)})  # fmt: skip
add("savetxt.txt", "header in a comment",
    as_text("# t [s] psi [deg] x [mm]\n" + lines([T8, PSI8, M.texts(M.x, ".8e")], " ")),
    {"t": ("s", T8), "psi": ("deg", PSI8), "x": ("mm", M.texts(M.x, ".8e"))})  # fmt: skip
add("wide.txt", "columns of a fixed width",
    as_text("Run of 2026\n\nTime (s)    Crank angle (deg)    Slider (mm)\n"
            + lines([[f"{t:>8}" for t in T3], [f"{a:>20}" for a in M.texts(M.phi, ".3f")],
                     [f"{x:>14}" for x in X3]], "")),
    {"Time": ("s", T3), "Crank angle": ("deg", M.texts(M.phi, ".3f")),
     "Slider": ("mm", X3)})  # fmt: skip

# Headers and rows -------------------------------------------------------------------------------

add(
    "capture.csv",
    "names in two rows",
    as_text(
        "run 3,,,,\n,rod,rod,pin,pin\nTime,X,Y,X,Y\ns,mm,mm,mm,mm\n"
        + lines([T3, X3, M.texts(M.y, ".3f"), M.texts(M.y, ".4f"), X3], ",")
    ),
    {
        "Time": ("s", T3),
        "rod X": ("mm", X3),
        "rod Y": ("mm", M.texts(M.y, ".3f")),
        "pin X": ("mm", M.texts(M.y, ".4f")),
        "pin Y": ("mm", X3),
    },
    says=("line 4 has the units",),
)
add(
    "names_with_units.csv",
    "units in names",
    as_text("time_ms,psi_deg,psi_rate_deg_s,slider_mm\n"
            + lines([[str(5 * k) for k in range(ROWS)], PSI4, RATE4, X3], ",")),
    {"time": ("ms", [str(5 * k) for k in range(ROWS)]), "psi": ("deg", PSI4),
     "psi_rate": ("deg/s", RATE4), "slider": ("mm", X3)},
)  # fmt: skip
add("din.csv", "units behind a slash",
    as_text("t / s;ψ / °;v / (mm/s)\n" + lines(map(comma, [T3, PSI4, RATE4]), ";")),
    {"t": ("s", T3), "ψ": ("deg", PSI4), "v": ("mm/s", RATE4)})  # fmt: skip
HALF = ROWS // 2
add(
    "event.csv",
    "time twice at an event",
    as_text(
        "t [s],psi [deg],w [deg/s]\n"
        + lines(
            [
                [*T3[: HALF + 1], *T3[HALF:]],
                [*PSI4[: HALF + 1], *PSI4[HALF:]],
                [*RATE4[:HALF], "-7.5000", *RATE4[HALF:]],
            ],
            ",",
        )
    ),
    {"t": ("s", T3), "psi": ("deg", PSI4), "w": ("deg/s", RATE4)},
    says=("t = 0.750 stands twice", "line 152 is left out"),
)
DOUBLED = [k for k in range(ROWS) for _ in range(2 if k in (0, 40, 41) else 1)]
add("doubled.csv", "doubled rows",
    as_text("t [s],psi [deg]\n"
            + lines([[T3[k] for k in DOUBLED], [PSI4[k] for k in DOUBLED]], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4)}, says=("3 rows repeat those before",))  # fmt: skip
ALL_TWICE = [k for k in range(ROWS) for _ in range(2)]
add("all_doubled.csv", "doubled rows",
    as_text("t [s],psi [deg]\n"
            + lines([[T3[k] for k in ALL_TWICE], [PSI4[k] for k in ALL_TWICE]], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4)}, says=("301 rows repeat those before",))  # fmt: skip
LOST = (17, 80, 81)
KEPT = [k for k in range(ROWS) if k not in LOST]
add("dropout.csv", "empty cells",
    as_text("t [s],psi [deg],x [mm]\n"
            + lines([T3, ["" if k in LOST else v for k, v in enumerate(PSI4)], X3], ",")),
    {"t": ("s", [T3[k] for k in KEPT]), "psi": ("deg", [PSI4[k] for k in KEPT]),
     "x": ("mm", [X3[k] for k in KEPT])}, says=("lines 19, 82 and 83 are left out",))  # fmt: skip
add("nan.csv", "empty cells",
    as_text("t [s],psi [deg],x [mm]\n"
            + lines([T3, ["NaN" if k in LOST else v for k, v in enumerate(PSI4)], X3], ",")),
    {"t": ("s", [T3[k] for k in KEPT]), "psi": ("deg", [PSI4[k] for k in KEPT]),
     "x": ("mm", [X3[k] for k in KEPT])})  # fmt: skip
WRAPPED = [format((Decimal(v) + 180) % 360 - 180, "f") for v in M.texts(M.phi, ".3f")]
add("wrapped.csv", "wrapped angle",
    as_text("t [s],phi [deg]\n" + lines([T3, WRAPPED], ",")),
    {"t": ("s", T3), "phi": ("deg", M.texts(M.phi, ".3f"))},
    says=("phi jumped by a turn, first at line 127",))  # fmt: skip
add("clockwise.csv", "clockwise sign",
    as_text("t [s],psi_cw [deg],psi rate (deg/s CW)\n"
            + lines([T3, minus(PSI4), minus(RATE4)], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4), "psi rate": ("deg/s", RATE4)},
    says=("counted clockwise: the sign is turned round",))  # fmt: skip
add("frames.csv", "frame numbers",
    as_text("Camera 2, 240 fps\n\nframe,psi [deg]\n"
            + lines([[str(k) for k in range(1, ROWS + 1)], PSI4], ",")),
    {"t": ("s", [format(Decimal(k) / 240, ".15f") for k in range(ROWS)]), "psi": ("deg", PSI4)},
    says=("states 240 rows per second", "frame 1 is at 0 s"))  # fmt: skip
add("frames_asked.csv", "frame numbers",
    as_text("Frame No.,psi [deg]\n" + lines([[str(k) for k in range(ROWS)], PSI4], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4)}, "--fps", "200")  # fmt: skip
MILLISECONDS = [str(1714557600000 + 5 * k) for k in range(ROWS)]
add("epoch_ms.csv", "epoch",
    as_text("timestamp,psi [deg]\n" + lines([MILLISECONDS, PSI4], ",")),
    {"timestamp": ("s", T3), "psi": ("deg", PSI4)},
    says=("counts milliseconds since 1970; 0 s is 2024-05-01T10:00:00Z",))  # fmt: skip


def clock_texts(start: int, seconds: bool = True) -> Texts:
    """Times of a clock from a second of the day on."""
    found = []
    for k in range(ROWS):
        millis = (1000 * start + 5 * k) % 86_400_000
        hour, rest = divmod(millis, 3_600_000)
        minute, rest = divmod(rest, 60_000)
        found.append(f"{hour:02}:{minute:02}:{rest // 1000:02}.{rest % 1000:03}")
    return found


add("iso.csv", "dates and times of a clock",
    as_text("Date,psi [deg]\n"
            + lines([[f"2024-05-01T{c}Z" for c in clock_texts(36000)], PSI4], ",")),
    {"Date": ("s", T3), "psi": ("deg", PSI4)},
    says=("0 s is 2024-05-01T10:00:00.000Z",))  # fmt: skip
add("midnight.csv", "dates and times of a clock",
    as_text("Uhrzeit;psi [deg]\n" + lines([comma(clock_texts(86399)), comma(PSI4)], ";")),
    {"Uhrzeit": ("s", T3), "psi": ("deg", PSI4)}, says=("it passes midnight",))  # fmt: skip
add("reversed.csv", "rows in the opposite order",
    as_text("t [s],psi [deg]\n" + lines([T3[::-1], PSI4[::-1]], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4)}, says=("in the opposite order",))  # fmt: skip
ROWS_1 = lines([T3[:100], PSI4[:100]], ",")
ROWS_2 = lines([T3[100:], PSI4[100:]], ",")
add("repeated.csv", "header again, comments among rows",
    as_text(f"t [s],psi [deg]\n{ROWS_1}t [s],psi [deg]\n\n# resumed\n{ROWS_2}"),
    {"t": ("s", T3), "psi": ("deg", PSI4)},
    says=("lines 102 to 104 among the numbers are left out",))  # fmt: skip
add("trailing.csv", "separator behind each row",
    as_text("t [s];psi [deg];\n" + lines([T3, PSI4, [""] * ROWS], ";")),
    {"t": ("s", T3), "psi": ("deg", PSI4)})  # fmt: skip
add("modelica.csv", "time twice at an event",
    as_text('"time","rod.phi","rod.w"\n'
            + lines([[*T3, T3[-1]], [*PSI4, PSI4[-1]], [*RATE4, RATE4[-1]]], ",")),
    {"time": ("s", T3), "rod.phi": ("deg", PSI4), "rod.w": ("", RATE4)},
    "--unit", "rod.phi=deg", says=("line 303 is left out",))  # fmt: skip


add("joined.csv", "commas as separators and decimal signs",
    as_text("Time (s),psi (deg)\n" + lines([comma(T3), comma(PSI4)], ",")),
    {"Time": ("s", T3), "psi": ("deg", PSI4)}, says=("halves of numbers are joined",))  # fmt: skip
add("frame_of_names.csv", "units below names, with an index",
    as_text(",psi,x\nt,deg,mm\n" + lines([T3, PSI4, X3], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4), "x": ("mm", X3)})  # fmt: skip
add("row_names.csv", "numbers of rows without a name",
    as_text('"t","psi_deg"\n' + lines([[f'"{k + 1}"' for k in range(ROWS)], T3, PSI4], ",")),
    {"row": ("", [str(k + 1) for k in range(ROWS)]), "t": ("s", T3),
     "psi": ("deg", PSI4)})  # fmt: skip
add("markdown.txt", "bars and a ruler",
    as_text("| t [s] | psi [deg] |\n|---|---|\n"
            + lines([[f"| {t}" for t in T3], [f"{a} |" for a in PSI4]], " | ")),
    {"t": ("s", T3), "psi": ("deg", PSI4)})  # fmt: skip
add("motion.sto", "OpenSim, .sto",
    as_text("Coordinates\nversion=1\nnRows=301\nnColumns=3\ninDegrees=yes\nendheader\n"
            "time\trod_angle\tslider_tx\n" + lines([T8, PSI8, M.texts(M.x, ".8f")], "\t")),
    {"time": ("s", T8), "rod_angle": ("deg", PSI8), "slider_tx": ("", M.texts(M.x, ".8f"))},
    says=("a line above the table says deg",))  # fmt: skip
add("russian.csv", "Windows-1251",
    as_text("Время, с;Угол, град;Скорость, град/с\n"
            + lines(map(comma, [T3, PSI4, RATE4]), ";"), "cp1251"),
    {"Время": ("s", T3), "Угол": ("deg", PSI4), "Скорость": ("deg/s", RATE4)},
    says=("the text is in CP1251",))  # fmt: skip
add("remark.csv", "a remark among rows",
    as_text(f"t [s],psi [deg]\n{ROWS_1}--- impact ---\n{ROWS_2}"),
    {"t": ("s", T3), "psi": ("deg", PSI4)},
    says=("line 102 among the numbers is left out",))  # fmt: skip
add("clocks.csv", "several clocks",
    as_text("time,psi [deg],time,x [mm]\n"
            + lines([T3, PSI4, [format(2 * t, ".3f") for t in M.times], X3], ",")),
    {"time": ("s", T3), "psi": ("deg", PSI4)}, "--time", "time",
    says=("columns time (2) and x are left out: they have another clock",))  # fmt: skip
add("killed.csv", "cut off as it was written",
    as_text("t [s],psi [deg]\n" + lines([T3, PSI4], ",")[:-3]),
    {"t": ("s", T3[:-1]), "psi": ("deg", PSI4[:-1])},
    says=("line 302 is left out: it is cut",))  # fmt: skip
add("slope.csv", "an angle without a unit beside its rate",
    as_text("t,theta,omega [deg/s]\n" + lines([T3, PSI4, RATE4], ",")),
    {"t": ("s", T3), "theta": ("deg", PSI4), "omega": ("deg/s", RATE4)},
    says=("its slope shows that it is in deg",))  # fmt: skip
GRAVITY = [format(v / 500, ".4f") for v in map(M.x, M.times)]
add("gravity.csv", "accelerations in g",
    as_text("t [s],acc_x [g],x [mm]\n" + lines([T3, GRAVITY, X3], ",")),
    {"t": ("s", T3), "acc_x": ("m/s^2", [format(Decimal(g) * Decimal("9.80665"), "f")
                                         for g in GRAVITY]), "x": ("mm", X3)},
    says=("acc_x was in g",))  # fmt: skip
add("no_time.csv", "rows without a time",
    as_text("t [s],psi [deg]\n,0.5\n" + lines([T3, PSI4], ",") + ",12.5\n,-12.5\n"),
    {"t": ("s", T3), "psi": ("deg", PSI4)}, says=("left out: t is empty",))  # fmt: skip
add("rated.txt", "rows per second, and no times",
    as_text("Sample rate (Hz): 200\nChannels: 2\n\npsi (deg)\tx (mm)\n" + lines([PSI4, X3], "\t")),
    {"t": ("s", T3), "psi": ("deg", PSI4), "x": ("mm", X3)},
    says=("states 200 rows per second",))  # fmt: skip
add("sweep.csv", "a sweep over an angle",
    as_text("alpha [deg];M [Nmm]\n" + lines(map(comma, [M.texts(M.phi, ".2f"), X3]), ";")),
    {"alpha": ("deg", M.texts(M.phi, ".2f")), "M": ("N mm", X3)},
    says=("alpha [deg] is the x",))  # fmt: skip
add("no_header.csv", "no header",
    as_text(lines([T3, PSI4], ",")), {"column 1": ("", T3), "column 2": ("", PSI4)},
    says=("there is no header",))  # fmt: skip
add("differences.txt", "first row without its last cell",
    as_text("t [s]\tx [mm]\tv [mm/s]\n" + lines([T3, X3, ["", *RATE4[1:]]], "\t")),
    {"t": ("s", T3), "x": ("mm", X3), "v": ("mm/s", ["", *RATE4[1:]])},
    says=("column v is empty in line 2, which stays",))  # fmt: skip
add("top_extremes.csv", "extremes above the numbers",
    as_text(f"Time (s),psi (deg),x (mm)\nMax,{PSI4[by_value[-1]]},{X3[by_x[-1]]}\n"
            f"Min,{PSI4[by_value[0]]},{X3[by_x[0]]}\n" + lines([T3, PSI4, X3], ",")),
    {"Time": ("s", T3), "psi": ("deg", PSI4), "x": ("mm", X3)},
    says=("lines 2 to 3 before the table are left out: 'Max,",))  # fmt: skip
add("clockwise_comma.csv", "clockwise sign",
    as_text("t [s],psi (deg, clockwise)\n" + lines([T3, minus(PSI4)], ",")),
    {"t": ("s", T3), "psi": ("deg", PSI4)}, says=("column psi counted clockwise",))  # fmt: skip
add("seconds.csv", "ROS, CSV",
    as_text("secs,nsecs,psi_deg\n"
            + lines([[n[:-9] for n in NANOSECONDS], [str(int(n[-9:])) for n in NANOSECONDS],
                     PSI4], ",")),
    {"time": ("s", SECONDS_9), "psi": ("deg", PSI4)})  # fmt: skip
ARCTANGENT = [format((Decimal(v) + 90) % 180 - 90, "f") for v in M.texts(M.phi, ".3f")]
add("arctangent.csv", "angle of an arctangent",
    as_text("t [s],phi [deg]\n" + lines([T3, ARCTANGENT], ",")),
    {"t": ("s", T3), "phi": ("deg", M.texts(M.phi, ".3f"))},
    says=("phi jumped by half turns, 2 times",))  # fmt: skip


add("merged.csv", "names in two rows",
    as_text("Time [s],rod [deg],,slider [mm]\n,angle,rate,\n"
            + lines([T3, PSI4, RATE4, X3], ",")),
    {"Time": ("s", T3), "rod angle": ("deg", PSI4), "rod rate": ("deg", RATE4),
     "slider": ("mm", X3)})  # fmt: skip
add("keys_above.csv", "keys above a header with an empty end",
    as_text("Model;crank;\nDate;2026;\nt [s];psi [deg];\n"
            + lines([*map(comma, [T3, PSI4]), [""] * ROWS], ";")),
    {"t": ("s", T3), "psi": ("deg", PSI4)},
    says=("lines 1 to 2 before the table are left out: 'Model;crank;'",))  # fmt: skip


add("datetimes.csv", "MATLAB, timetable with dates",
    as_text("Time,psi_deg\n"
            + lines([[f"01-May-2024 {c}" for c in clock_texts(36000)], PSI4], ",")),
    {"Time": ("s", T3), "psi": ("deg", PSI4)},
    says=("0 s is 01-May-2024 10:00:00.000",))  # fmt: skip
add("hours.csv", "units in names",
    as_text("time_h,psi_deg,load (min)\n"
            + lines([[format(t / 3600, ".9f") for t in M.times], PSI4, X3], ",")),
    {"time": ("h", [format(t / 3600, ".9f") for t in M.times]), "psi": ("deg", PSI4),
     "load (min)": ("", X3)})  # fmt: skip


add("labels.csv", "labels in front of the header",
    as_text("Channel,Time,Angle\nUnits,s,deg\nData,,\n"
            + lines([[""] * ROWS, T3, PSI4], ",")),
    {"Time": ("s", T3), "Angle": ("deg", PSI4)}, says=("line 2 has the units",))  # fmt: skip
add("quoted_names.txt", "quoted names between blanks",
    as_text('"Position"\n"Time (sec)"  "Crank angle (deg)"\n' + lines([T8, PSI8], "  ")),
    {"Time": ("s", T8), "Crank angle": ("deg", PSI8)})  # fmt: skip


def write_all(folder: Path) -> list[Path]:
    """Write all files to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for shape in SHAPES:
        shape.write(folder / shape.name)
    return [folder / shape.name for shape in SHAPES]


if __name__ == "__main__":
    print(*write_all(Path(sys.argv[1])), sep="\n")
