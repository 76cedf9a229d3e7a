"""An oracle that judges good outcomes by the curves that bare MuJoCo gives for the same files.

It shares no code with the product.  It reads the sidecar with `tomllib`, the recorded curve with
`csv`, compiles the MJCF with MuJoCo alone, and computes every channel in a second way:

- driven runs by Newton's method on the loops and the forces together, ``f + J' s = 0`` and
  ``c(q) = 0``, with the engine's constraint rows and forces, and with numerical derivatives; rates
  and accelerations are differences along the drive; the multiplier of the drive is its holding
  moment, to which a motion adds the work of the inertial forces, of masses and armatures, per
  displacement of the drive;
- free motions by `mj_step` with the options of the file.

A verdict is a *false agreement* if a channel agrees although one of these holds:

- the engine's curve, or its x, is not that of bare MuJoCo for the mutated files;
- a parameter of a closed form differs by more than three times its detectable change, or the
  assembly mode differs;
- a channel's `equals` differs from that of the case before the mutation, and a closed form has
  another curve for it, or its `unit` measures another quantity;
- the model has dry friction, a joint range that the motion leaves, or a contact, although a channel
  depends on forces; the product's sweeps have none of them.

Harmless changes, which need not change an outcome, and the reasons:

- drawing (colours, sizes and groups of geoms without contact, lights, comments, names of elements
  that no channel uses): no motion depends on it;
- masses, inertias, springs, dampers, armature, gravity and loads in a run whose channels are
  kinematic: its drives prescribe the motion (bare MuJoCo gives the same curves);
- steps, iterations, softness: they determine the engine's accuracy, which the tolerance judges;
- samples, limits of time, rates and ends of a drive: engine and reference both follow them;
- lengths of a model whose reference is the general solver: it reads them from the same MJCF, as
  docs/sidecar.md says;
- tolerances that are wider, narrower or removed, and channels, runs and solvers that are removed:
  the result shows it (`allowed`, "unchecked", no row);
- texts: titles, sources, reasons.
"""

import csv
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from proofmass.analytic.protocol import Ask, InputMotion
from proofmass.reference.find import find_reference

SENSOR, DISABLE = mujoco.mjtSensor, mujoco.mjtDisableBit
Array = Any
FORCE_SENSORS = ("actuatorfrc", "jointactuatorfrc", "e_potential")
UNITS = {"deg": ("rad", math.pi / 180), "J": ("N m", 1.0)}
"""SI units and factors of a channel's units; other units are SI units."""
PREFIXES = dict(
    zip(
        "qryzafpnµmcdhkMGTPEZYRQ",
        (
            *(10.0**k for k in range(-30, 0, 3)),
            1e-2,
            1e-1,
            1e2,
            *(10.0**k for k in range(3, 31, 3)),
        ),
        strict=True,
    )
) | {"u": 1e-6, "da": 10.0}
"""Prefixes of units and their factors; a mutation of `rad` may be `rrad`, 1e-27 rad."""


class Unjudged(Exception):
    """The oracle does not cover this input, for the reason given."""


def find_false_agreements(
    folder: Path, name: str, before: dict[str, bytes], result: Any
) -> tuple[list[str], str]:
    """The false agreements of a result, and the reason if some channels were not judged."""
    new = tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8-sig"))
    old = tomllib.loads(before[f"{name}.toml"].decode())
    agrees = [c for c in result.comparisons if c.outcome == "agrees" and c.case == name]
    if not agrees:
        return [], ""
    new |= runs_and_channels(new, next(case for case in result.cases if case.name == name))
    found = [*wrong_parameters(old, new, agrees), *wrong_channels(old, new, agrees, result)]
    try:
        found += (
            wrong_rods(folder, name, old, new, before, agrees)
            if "rod" in new
            else wrong_curves(folder, name, new, agrees, result)
        )
    except Unjudged as error:
        return list(dict.fromkeys(found)), str(error)
    return list(dict.fromkeys(found)), ""


def runs_and_channels(new: dict, case: Any) -> dict[str, dict]:
    """Runs and channels as in the file, with the keys that it leaves to defaults as in the case.

    So a default is judged like a key of the file: a channel that is compared with another quantity
    than before the mutation is found, whether the file or a default chose the quantity.
    """
    whole = case.model_dump(by_alias=True, exclude_none=True)
    return {
        key: {name: table | new.get(key, {}).get(name, {}) for name, table in whole[key].items()}
        for key in ("run", "channels")
    }


def wrong_parameters(old: dict, new: dict, agrees: list) -> list[str]:
    """Parameters that differ by more than the detectable changes of the channels that agree."""
    if old["reference"] != new["reference"] or "parameters" not in old:
        return []
    default = {k: p.default for k, p in find_reference(new["reference"]).parameters.items()}
    found = []
    for key, value in old["parameters"].items():
        now = new.get("parameters", {}).get(key, default.get(key))
        if isinstance(value, str) or isinstance(now, str) or now == value:
            continue
        if key == "mode":
            found.append(f"parameter mode {value} is {now}")
            continue
        if now is None or abs(now - value) > 3 * smallest_detectable_change(agrees, key, value):
            found.append(f"parameter {key}")
    return found


def smallest_detectable_change(agrees: list, key: str, value: float) -> float:
    """The smallest detectable change of a parameter over channels, or infinity without any.

    A change of unknown size, NaN, does not count.
    """
    changes = [c.detectable[key] for c in agrees if key in c.detectable]
    return min(
        (
            change.size * (abs(value) if change.relative else 1.0)
            for change in changes
            if not math.isnan(change.size)
        ),
        default=math.inf,
    )


def in_si(unit: str) -> tuple[str, float]:
    """The SI unit of a channel's unit, and the factor that converts to it."""
    unit = " ".join(unit.split())
    hit = re.fullmatch(f"({'|'.join(PREFIXES)})(rad|m)", unit)
    return (hit[2], PREFIXES[hit[1]]) if hit else UNITS.get(unit, (unit, 1.0))


def wrong_channels(old: dict, new: dict, agrees: list, result: Any) -> list[str]:
    """Channels that agree although their quantity, unit, scale or shift is another one."""
    found = []
    for c in agrees:
        was, now = old["channels"].get(c.channel), new["channels"].get(c.channel)
        if was is None or now is None:  # such as a row with an order of convergence
            continue
        (quantity, factor), (other, its) = in_si(was["unit"]), in_si(now["unit"])
        if quantity != other:
            found.append("channel unit")
        if (
            was["equals"] != now["equals"]
            and new["reference"] == old["reference"]
            and not has_same_curve(
                old,
                result.curves[c.case, c.run, c.solver],
                was["equals"],
                now["equals"],
                c.allowed * its,
            )
        ):
            found.append("channel equals")
        for key, usual, one, two in (("scale", 1.0, 1.0, 1.0), ("shift", 0.0, factor, its)):
            if abs(was.get(key, usual) * one - now.get(key, usual) * two) > max(
                3 * c.allowed * its, 1e-3
            ):
                found.append(f"channel {key}")
    return found


def has_same_curve(
    old: dict, curves: Any, one: str | float, two: str | float, allowed: float
) -> bool:
    """Whether two quantities of a closed form have the same curve, as those of a slide along x."""
    if "parameters" not in old:
        return False
    motion = InputMotion(curves.x, curves.drive)
    known = find_reference(old["reference"]).evaluate(old["parameters"], motion, Ask())
    return one in known and two in known and not is_far(known[one], known[two], allowed)


# behaviour of bare MuJoCo


def wrong_curves(folder: Path, name: str, new: dict, agrees: list, result: Any) -> list[str]:
    """Channels whose curves are not those of bare MuJoCo."""
    model = mujoco.MjModel.from_xml_path(str(folder / new.get("model", f"{name}.xml")))
    if (model.jnt_type < int(mujoco.mjtJoint.mjJNT_SLIDE)).any() or model.nq > 12:
        raise Unjudged("joints other than a few hinges and slides")
    found, bares = [], dict[str, BareRun]()  # by runs, for all solvers
    recorded = (
        recorded_columns(folder / new["reference"]) if new["reference"].endswith(".csv") else None
    )
    for run, solver in dict.fromkeys((c.run, c.solver) for c in agrees):
        mine = [c for c in agrees if (c.run, c.solver) == (run, solver)]
        curves = result.curves[name, run, solver]
        x, drives = samples_and_drives(new, run, recorded)
        if x.shape != curves.x.shape or not np.allclose(x, curves.x, rtol=1e-9, atol=1e-12):
            found.append("x")
            continue
        bare = bares[run] = bares.get(run) or BareRun(model, new, run, x, drives)
        for c in mine:
            factor = in_si(c.unit)[1]
            if recorded is not None:
                want = recorded[new["channels"][c.channel]["equals"]]
                shown = new["channels"][c.channel]
                want = shown.get("scale", 1.0) * want + shown.get("shift", 0.0) * factor
                if is_far(curves.channels[c.channel], want, c.allowed * factor):
                    found.append("recorded column")
            want = bare.channel(c.channel)
            if want is not None and is_far(
                curves.channels[c.channel], want, c.allowed * factor, c.channel.endswith(".angle")
            ):
                found.append(f"curve of {bare.kind(c.channel)}")
            if bare.kind(c.channel) in FORCE_SENSORS or not drives:
                found += sorted(bare.warnings)
    return found


def is_far(curve: Array, want: Array, allowed: float, angle: bool = False) -> bool:
    """Whether two curves differ by more than the tolerance and the oracle's own error."""
    error = curve - want
    if angle:
        error = np.angle(np.exp(1j * (error - error[0]))) + np.angle(np.exp(1j * error[0]))
    scale = max(float(np.ptp(want)), 1e-3 * float(np.abs(want).max()))
    limit = 3 * allowed + 1e-4 * scale + 1e-9
    return not bool(np.all(np.abs(error) <= limit))


def samples_and_drives(new: dict, run: str, recorded: dict | None) -> tuple[Array, list]:
    """The samples of a run, and (joint, value, rate, acceleration) of each drive at them."""
    drives = new.get("drive", [])
    drives = [drives] if isinstance(drives, dict) else drives
    if len(drives) > 1:
        raise Unjudged("several drives")
    table = new["run"][run]
    if recorded is not None:
        x = run_times(next(iter(recorded.values())))
        if run == "dynamics" and np.ptp(np.diff(x)) > 1e-9 * np.diff(x).mean():
            raise Unjudged("uneven times, between which the reference is interpolated")
        return x, [(d["joint"], *(recorded[c] for c in d["profile"])) for d in drives]
    n = int(table["n"])
    if not drives:
        return np.linspace(0, float(table["until"]), n), []
    drive = drives[0]
    if "profile" in drive:
        raise Unjudged("a law of the reference")
    a, b = float(drive.get("from", 0.0)), float(drive["to"])
    if "period" in drive:
        period = float(drive["period"])
        x = np.linspace(0, float(table.get("until", drive.get("until", period))), n)
        w = 2 * np.pi / period
        half = (b - a) / 2
        return x, [
            (
                drive["joint"],
                a + half * (1 - np.cos(w * x)),
                half * w * np.sin(w * x),
                half * w * w * np.cos(w * x),
            )
        ]
    rate = float(drive.get("rate", 1.0))
    x = np.linspace(a, b, n) if run == "sweep" else np.linspace(0, (b - a) / rate, n)
    value = x if run == "sweep" else a + rate * x
    return x, [(drive["joint"], value, np.full(n, rate), np.zeros(n))]


def run_times(clock: Array) -> Array:
    """Times since the run began, which is at 0 of the clock, or at the first row without a 0."""
    row = float(np.median(np.diff(clock)))
    lost_or_zero = -0.5 * row <= clock[0] <= 1.5 * row or clock[0] < 0 <= clock[-1] - 0.5 * row
    return clock if lost_or_zero else clock - clock[0]


def recorded_columns(file: Path) -> dict[str, Array]:
    """The columns of a recorded curve in SI units; the oracle knows few units."""
    data = file.read_bytes()
    text = data.decode("utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[0] != "#"]
    mark = next((m for m in ";\t" if m in lines[0]), ",")
    rows = list(csv.reader(lines, delimiter=mark))
    if mark != ",":
        rows[1:] = [[cell.replace(",", ".") for cell in row] for row in rows[1:]]
    found: dict[str, Array] = {}
    numbers = np.array([[float(v) for v in r] for r in rows[1:]])
    for head, column in zip(rows[0], numbers.T, strict=True):
        hit = re.fullmatch(r"\s*(.*?)\s*\[\s*(.*?)\s*\]\s*", head)
        if not hit:
            raise Unjudged(f"header {head!r}")
        factor = {"mm": 1e-3, "deg": math.pi / 180}.get(hit[2].split("/")[0])
        if factor is None and hit[2].split("/")[0] not in ("m", "rad", "s"):
            raise Unjudged(f"unit {hit[2]!r}")
        if hit[1] in found and not np.array_equal(found[hit[1]], column):
            raise Unjudged(f"twice column {hit[1]!r}")
        found[hit[1]] = column * (factor or 1.0)
    return found


class BareRun:
    """One run in bare MuJoCo."""

    def __init__(self, model: Any, new: dict, run: str, x: Array, drives: list):
        self.model, self.data = model, mujoco.MjData(model)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.warnings: set[str] = set()
        m, d = self.model, self.data
        if m.nkey:
            mujoco.mj_resetDataKeyframe(m, d, model.key(new.get("start", "start")).id)
        frictionless = bool(m.opt.disableflags & int(DISABLE.mjDSBL_FRICTIONLOSS))
        if not frictionless and m.dof_frictionloss.any():
            self.warnings.add("dry friction")
        self.drives = drives
        self.moves = run == "dynamics" or bool(new["run"][run].get("inertia"))
        self.joints = [model.joint(joint).id for joint, *_ in drives]
        self.dofs = [int(m.jnt_dofadr[j]) for j in self.joints]
        for a in range(m.nu):
            if m.actuator_trntype[a] <= 1 and m.actuator_trnid[a, 0] in self.joints:
                d.ctrl[a] = 0
                m.actuator_biasprm[a] = 0  # the drive takes the place of a servo too
        self.rows = np.empty((x.size, m.nsensordata))
        self.accelerations = np.empty((x.size, m.nv))
        self.moments = np.empty(x.size)
        self.forces = np.empty((x.size, m.nsensordata))
        if drives:
            self.follow(x)
        else:
            self.fall(x)

    def fall(self, x: Array) -> None:
        """Step a free motion through time, and read all sensors at the samples."""
        m, d = self.model, self.data
        if m.neq:
            raise Unjudged("a free motion with loops")
        width = (x[-1] - x[0]) / (x.size - 1)
        if not m.opt.timestep > width / 1e5:
            raise Unjudged("a step too small")
        count = max(1, math.ceil(width / m.opt.timestep - 1e-9))
        m.opt.timestep = width / count
        for k in range(x.size):
            mujoco.mj_forward(m, d)
            self.read(k)
            for _ in range(count):
                mujoco.mj_step(m, d)

    def read(self, k: int) -> None:
        """Store sensors and accelerations of sample k, and note contacts and left joint ranges."""
        m, d = self.model, self.data
        self.rows[k], self.accelerations[k] = d.sensordata, d.qacc
        if d.ncon:
            self.warnings.add("contact")
        limits = bool(m.opt.disableflags & int(DISABLE.mjDSBL_LIMIT | DISABLE.mjDSBL_CONSTRAINT))
        outside = (d.qpos < m.jnt_range[:, 0] - 1e-3) | (d.qpos > m.jnt_range[:, 1] + 1e-3)
        if not limits and self.drives and (outside & (m.jnt_limited > 0)).any():
            self.warnings.add("joint range")

    def follow(self, x: Array) -> None:
        """Find the pose, rates, accelerations and forces of a driven run at each sample."""
        m, d = self.model, self.data
        ((_, value, rate, acceleration),) = self.drives
        q, h = d.qpos.copy(), 1e-3
        start = float(q[self.dofs[0]])
        strides = max(1, math.ceil(abs(value[0] - start) / 0.05))
        if strides > 2000:
            raise Unjudged("a start pose far off")
        s = np.zeros(self.constraints(q, start)[0].size)
        for part in range(1, strides + 1):
            q, s = self.close(q, s, start + (value[0] - start) * part / strides)
        last = value[0]
        for k in range(x.size):
            substeps = max(1, math.ceil(abs(value[k] - last) / 0.2))
            if substeps > 2000:
                raise Unjudged("a long way")
            for part in range(1, substeps + 1):
                q, s = self.close(q, s, last + (value[k] - last) * part / substeps)
            last = value[k]
            up, down = (self.close(q, s, value[k] + side * h)[0] for side in (1, -1))
            first, second = (up - down) / (2 * h), (up - 2 * q + down) / h**2
            d.qpos[:], d.qvel[:] = q, first * rate[k]
            d.qacc[:] = second * rate[k] ** 2 + first * acceleration[k]
            acc = d.qacc.copy()
            mujoco.mj_fwdPosition(m, d)
            mujoco.mj_fwdActuation(m, d)
            d.qacc[:] = acc
            mujoco.mj_inverse(m, d)
            d.qacc[:] = acc
            self.read(k)
            self.moments[k] = s[-1]
            self.forces[k] = self.at_rest(q, s)
            if self.moves:
                self.moments[k] += first @ self.inertial_forces(q, first * rate[k], acc)
            d.qvel[:] = 0

    def at_rest(self, q: Array, s: Array) -> Array:
        """All sensors in a pose at rest, with the multipliers as the forces of the loops."""
        m, d = self.model, self.data
        d.qpos[:], d.qvel[:], d.qacc[:] = q, 0, 0
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        d.efc_force[:] = 0
        d.efc_force[d.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)] = s[:-1]
        mujoco.mj_rnePostConstraint(m, d)
        mujoco.mj_sensorAcc(m, d)
        return d.sensordata.copy()

    def inertial_forces(self, q: Array, v: Array, a: Array) -> Array:
        """The forces on the joints in a motion, less those at rest in the same pose."""
        m, d = self.model, self.data
        forces = []
        for rates, accelerations in ((v, a), (0 * v, 0 * a)):
            d.qpos[:], d.qvel[:], d.qacc[:] = q, rates, accelerations
            mujoco.mj_fwdPosition(m, d)
            mujoco.mj_fwdVelocity(m, d)
            full = np.zeros((m.nv, m.nv))
            mujoco.mj_fullM(m, d, full)
            forces.append(full @ accelerations + d.qfrc_bias - d.qfrc_passive)
        return forces[0] - forces[1]

    def constraints(self, q: Array, value: float) -> tuple[Array, Array, Array]:
        """The residual of loops and drive, its Jacobian, and the forces on the joints at rest."""
        m, d = self.model, self.data
        d.qpos[:], d.qvel[:] = q, 0
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        mujoco.mj_fwdActuation(m, d)
        keep = d.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        unit = np.eye(m.nv)[self.dofs]
        c = np.append(d.efc_pos[keep], q[self.dofs[0]] - value)
        jacobian = np.vstack([d.efc_J.reshape(d.nefc, m.nv)[keep], unit])
        return c, jacobian, d.qfrc_passive + d.qfrc_actuator - d.qfrc_bias

    def close(self, q: Array, s: Array, value: float) -> tuple[Array, Array]:
        """The pose with closed loops, balanced forces and the drive at its value; multipliers."""
        nv, e = self.model.nv, 1e-6
        scale = 1.0
        for _ in range(40):
            c, jacobian, f = self.constraints(q, value)
            if s.size != c.size:
                raise Unjudged("loops come and go")
            scale = max(1.0, float(np.abs(f).max(initial=0)))
            r = np.concatenate([(f + jacobian.T @ s) / scale, c])
            big = np.zeros((r.size, nv + s.size))
            for k in range(nv):
                c2, j2, f2 = self.constraints(q + e * np.eye(nv)[k], value)
                if c2.size != c.size:
                    raise Unjudged("loops come and go")
                big[:, k] = (np.concatenate([(f2 + j2.T @ s) / scale, c2]) - r) / e
            big[:nv, nv:] = jacobian.T / scale
            move = -np.linalg.lstsq(big, r, rcond=1e-11)[0]
            if not np.isfinite(move).all() or np.abs(move[:nv]).max() > 3:
                raise Unjudged("no rest nearby")
            q, s = q + move[:nv], s + move[nv:]
            if np.abs(move[:nv]).max() < 1e-11 and np.abs(r).max() < 1e-7:
                return q, s
        raise Unjudged("no rest found")

    def kind(self, channel: str) -> str:
        """The type of a channel's sensor, as it is called in MJCF."""
        kind = SENSOR(int(self.model.sensor(channel.partition(".")[0]).type[0]))
        return kind.name[7:].lower()

    def channel(self, name: str) -> Array | None:
        """The curve of a channel, or None if the oracle does not know it."""
        m = self.model
        sensor, _, part = name.partition(".")
        i = m.sensor(sensor).id
        kind, obj = SENSOR(int(m.sensor_type[i])), int(m.sensor_objid[i])
        block = self.rows[:, m.sensor_adr[i] : m.sensor_adr[i] + m.sensor_dim[i]]
        if kind in (SENSOR.mjSENS_FORCE, SENSOR.mjSENS_TORQUE) and self.drives:
            if self.moves:
                return None  # soft loops transmit other forces
            block = self.forces[:, m.sensor_adr[i] : m.sensor_adr[i] + m.sensor_dim[i]]
        if kind == SENSOR.mjSENS_USER:
            return self.accelerations[:, m.jnt_dofadr[obj]]
        if kind == SENSOR.mjSENS_FRAMELINACC and not m.opt.disableflags & int(
            DISABLE.mjDSBL_GRAVITY
        ):
            block = block + m.opt.gravity
        if kind in (SENSOR.mjSENS_ACTUATORFRC, SENSOR.mjSENS_JOINTACTFRC) and self.drives:
            joint = int(m.actuator_trnid[obj, 0]) if kind == SENSOR.mjSENS_ACTUATORFRC else obj
            if joint in self.joints:
                gear = m.actuator_gear[obj, 0] if kind == SENSOR.mjSENS_ACTUATORFRC else 1.0
                return self.moments / gear if gear else None
        if part == "angle":
            flat = np.abs(m.jnt_axis[:, :2]).max() < 1e-12 or (m.jnt_type == 2).any()
            if not flat:
                return None
            first = np.flatnonzero(m.jnt_type == 3)
            if not first.size or m.jnt_axis[first[0], 2] < 0:
                return None  # the plane is seen from below, where the product chooses the sense
            return np.arctan2(block[:, 1], block[:, 0])
        return block[:, "xyz".index(part) if part else 0]


# rods


def wrong_rods(
    folder: Path, name: str, old: dict, new: dict, before: dict[str, bytes], agrees: list
) -> list[str]:
    """Rods and loads that differ in the numbers from which they are built.

    The oracle does not compute curves of rods.
    """
    found = []
    for rod, was in old["rod"].items():
        now = new["rod"].get(rod, {})
        for key in ("length", "stiffness"):
            if abs(now.get(key, math.inf) - was[key]) > 3 * smallest_detectable_change(
                agrees, key, was[key]
            ):
                found.append(f"rod {key}")
        for key in ("from", "to", "ends"):
            if was.get(key) != now.get(key) and now.get(key) != ["clamped", "free"]:
                found.append(f"rod {key}")
    xml = new.get("model", f"{name}.xml")
    one = rod_numbers(
        mujoco.MjSpec.from_string(before[f"{name}.xml"].decode()), old.get("start", "start")
    )
    two = rod_numbers(mujoco.MjSpec.from_file(str(folder / xml)), new.get("start", "start"))
    share = min(
        (
            change.size
            for c in agrees
            for change in c.detectable.values()
            if change.relative and not math.isnan(change.size)
        ),
        default=math.inf,
    )
    for key, numbers in one.items():
        other = two.get(key)
        if (
            other is None
            or len(other) != len(numbers)
            or any(
                abs(a - b) > 3 * share * max(1.0, abs(a))
                for a, b in zip(numbers, other, strict=True)
            )
        ):
            found.append(f"{key} of a rod's model")
    return found


def rod_numbers(spec: Any, start: str) -> dict[str, list[float]]:
    """The numbers on which the equilibrium of the small rod depends, as MuJoCo reads them."""
    key = spec.key(start)
    found = {
        "key ctrl": key.ctrl if key else [],
        "option gravity": spec.option.gravity,
        "flag actuation": [spec.option.disableflags & int(DISABLE.mjDSBL_ACTUATION)],
    }
    for motor in spec.actuators[:1]:
        found["motor gear"] = motor.gear
    for site in spec.sites[:1]:
        found |= {"site pos": site.pos, "site euler": site.alt.euler, "site quat": site.quat}
    return {what: list(map(float, numbers)) for what, numbers in found.items()}
