"""Loading of a MuJoCo model and reading of its sensors, for all kinds of runs.

MuJoCo compiles the model and computes its motion from its own arrays, on purpose without the plain
data of the references (`proofmass.analytic.mjcf`), in which only features are looked for: a number
that the references misread makes their curves differ from those of this engine.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np

from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.numerics import unwrap_quaternions
from proofmass.analytic.support import RunKind, examine
from proofmass.base.arrays import Array
from proofmass.sim.contents import (
    active_connects,
    anchors,
    find_id,
    format_parts,
    joint_of,
    pose_of,
    sensor_names,
    sensor_parts,
)
from proofmass.sim.mjcf import compile_model, leave_out_disabled, refusal
from proofmass.sim.mujoco.settings import configure
from proofmass.sim.mujoco.support import SUPPORT
from proofmass.sim.plane import find_plane
from proofmass.sim.protocol.curves import split_channel
from proofmass.sim.protocol.failures import BadModel, Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.rods import dead_loads

S = mujoco.mjtSensor


def load(path: Path, run: Run) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Compile the model, apply the run's settings, and put it into the start pose.

    Parameters
    ----------
    path : Path
        The MJCF file.
    run : Run
        Names the start key, the driven joints and the settings.

    Returns
    -------
    MjModel, MjData

    Raises
    ------
    BadModel
        The file does not compile, or lacks an element that the run names.
    """
    return prepare_model(compile_model(path, run.rods), run)


def prepare_model(model: mujoco.MjModel, run: Run) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Apply the run's settings to a compiled model, in place, and put it into the start pose.

    Sensors show their quantities as they are: without a cutoff, a delay or an interval.  The flag
    ``energy`` is cleared too.  It changes nothing but the sensor ``e_kinetic``, which with it shows
    the kinetic energy of the pass before (MuJoCo 4.0.0).  So is ``invdiscrete``: accelerations of a
    sweep are those of its motion and not those of a step.
    """
    driven = [find_id(model, mujoco.mjtObj.mjOBJ_JOINT, "joint", d.joint) for d in run.drives]
    leave_out_disabled(model)
    model.opt.enableflags &= ~int(
        mujoco.mjtEnableBit.mjENBL_ENERGY | mujoco.mjtEnableBit.mjENBL_INVDISCRETE
    )
    for limits in (model.sensor_cutoff, model.sensor_delay, model.sensor_interval):
        limits[:] = 0.0
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, start_key(model, run))
    for actuator in range(model.nactuator):
        # the drive takes the place of the actuators on its joint, whatever makes their force
        if joint_of(model, actuator) in driven:
            first = model.actuator_ctrladr[actuator]
            data.ctrl[first : first + model.actuator_ctrlnum[actuator]] = 0.0
            model.actuator_dyntype[actuator] = mujoco.mjtDyn.mjDYN_NONE
            model.actuator_gaintype[actuator] = mujoco.mjtGain.mjGAIN_FIXED
            if model.actuator_biastype[actuator] != mujoco.mjtBias.mjBIAS_AFFINE:
                model.actuator_biastype[actuator] = mujoco.mjtBias.mjBIAS_NONE
            model.actuator_gainprm[actuator] = model.actuator_biasprm[actuator] = 0.0
    for body, force, moment in dead_loads(model, data, run.rods) if run.rods else ():
        data.xfrc_applied[body] += [*force, *moment]
    configure(model, run.settings)
    return model, data


def start_key(model: mujoco.MjModel, run: Run) -> int:
    """Number of the key from which a run starts."""
    if run.kind == "passive":
        return max(0, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, run.start))
    return find_id(model, mujoco.mjtObj.mjOBJ_KEY, "key", run.start)


def refuse_uncovered(model: mujoco.MjModel, kind: RunKind, drives: Sequence[str] = ()) -> None:
    """Raise `Unsupported` if a model has features that a kind of run does not cover."""
    driven = tuple(find_id(model, mujoco.mjtObj.mjOBJ_JOINT, "joint", name) for name in drives)
    if refused := examine(read_compiled(model), SUPPORT, kind, driven)[0]:
        raise Unsupported(f"{'; '.join(refused)} in {kind.in_words}")


def loop_violations(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Distance between the two points of every active ``connect`` [m], shape (loops,).

    It is computed from the poses of the bodies, not from the engine's own constraint residual.
    """
    pairs = [anchors(model, i, pose_of(data)) for i in active_connects(model)]
    return np.array([float(np.linalg.norm(one - two)) for one, two in pairs])


def is_acceleration(model: mujoco.MjModel, sensor: int) -> bool:
    """Whether a sensor is a ``user`` sensor on a joint, which here stands for its acceleration.

    MJCF has no sensor of a joint's acceleration.
    """
    return bool(
        model.sensor_type[sensor] == S.mjSENS_USER
        and model.sensor_objtype[sensor] == mujoco.mjtObj.mjOBJ_JOINT
    )


class Recorder:
    """Records whole arrays of MuJoCo's data at each sample; channels are extracted at the end.

    Two readings differ from ``sensordata``: a ``user`` sensor on a joint is the joint's
    acceleration, see `is_acceleration`; and ``framelinacc`` is the acceleration of the point
    itself, of which MuJoCo's reading is the difference to gravity.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, channels: tuple[str, ...], samples: int
    ):
        if channels and model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_SENSOR):
            raise Unsupported('<flag sensor="disable"/>: MuJoCo then leaves all channels at zero')
        self.model = model
        self.plane = find_plane(model, data) if any(".angle" in c for c in channels) else None
        self.sensors = {c: self._resolve(c) for c in channels}
        self.samples = samples
        names = ["qpos", "qvel", "sensordata", "qacc"]
        on_sites = [model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE for i in active_connects(model)]
        names += ["site_xpos"] if any(on_sites) else []
        names += ["xpos", "xmat"] if not all(on_sites) else []
        views = {name: getattr(data, name) for name in names}
        self.rows = {name: np.empty((samples, *view.shape)) for name, view in views.items()}
        pairs = [(view, self.rows[name]) for name, view in views.items()]
        self.state, self.shown = pairs[:2], pairs[2:]
        self.data, self.inverse = data, np.empty(0)

    def _resolve(self, channel: str) -> tuple[int, str]:
        name, part = split_channel(channel, sensor_names(self.model))
        index = find_id(self.model, mujoco.mjtObj.mjOBJ_SENSOR, "sensor", name)
        angle = ("angle",) if self.model.sensor_dim[index] == 3 else ()
        if part not in (*sensor_parts(self.model, index), *angle):
            right = format_parts(self.model, index)
            raise BadModel(f"channel {channel!r}: no such part of sensor {name!r}; use {right}")
        return index, part

    def sample(self, k: int) -> None:
        """Record the state, and the sensors and accelerations of it, as sample k."""
        self.sample_state(k)
        self.sample_shown(k)

    def sample_state(self, k: int) -> None:
        """Record the state alone; the engine computes its sensors in the next step."""
        for view, rows in self.state:
            rows[k] = view

    def record_forces(self) -> None:
        """Record the generalized forces on the joints as well, from now on.

        ``qfrc_inverse`` is then the generalized force that the accelerations of the bodies need,
        for the open tree without armatures.
        """
        self.inverse = np.empty(self.model.nv)
        views = {
            "qfrc_inverse": self.inverse,
            **{
                name: getattr(self.data, name)
                for name in ("qfrc_passive", "qfrc_constraint", "qfrc_actuator")
            },
        }
        for name, view in views.items():
            self.rows[name] = np.empty((self.samples, self.model.nv))
            self.shown.append((view, self.rows[name]))

    def sample_shown(self, k: int) -> None:
        """Record sensors, accelerations and positions of the state in which the last step began."""
        if self.inverse.size:
            velocity = self.data.qvel.copy()
            self.data.qvel[:] = self.rows["qvel"][k]
            mujoco.mj_rne(self.model, self.data, 1, self.inverse)
            self.data.qvel[:] = velocity
        for view, rows in self.shown:
            rows[k] = view

    def cut(self, samples: int) -> None:
        """Keep only the first `samples` samples."""
        self.samples = samples
        self.rows = {name: rows[:samples] for name, rows in self.rows.items()}

    def curves(self) -> dict[str, Array]:
        """The curves of all channels over all samples."""
        return {channel: self._curve(*place) for channel, place in self.sensors.items()}

    def violations(self) -> Array:
        """Largest constraint violation of each sample [m], from the bodies' poses."""
        worst = np.zeros(self.samples)
        for one, two in (anchors(self.model, i, self.rows) for i in active_connects(self.model)):
            worst = np.maximum(worst, np.linalg.norm(one - two, axis=-1))
        return worst

    def _curve(self, index: int, part: str) -> Array:
        kind, model = self.model.sensor_type[index], self.model
        first = model.sensor_adr[index]
        block = self.rows["sensordata"][:, first : first + model.sensor_dim[index]]
        if is_acceleration(model, index):
            return self.rows["qacc"][:, model.jnt_dofadr[model.sensor_objid[index]]]
        if kind == S.mjSENS_FRAMELINACC:
            block = block + model.opt.gravity
        if part == "angle" and self.plane:
            x, y = self.plane.flat(block).T
            return np.unwrap(np.arctan2(y, x))
        if S(int(kind)) in (S.mjSENS_FRAMEQUAT, S.mjSENS_BALLQUAT):
            block = unwrap_quaternions(block)
        return block[:, sensor_parts(model, index).index(part)]


@contextmanager
def translate_fatal_errors() -> Iterator[None]:
    """Raise MuJoCo's own fatal errors as errors of the model."""
    try:
        yield
    except mujoco.FatalError as error:
        raise refusal(error) from None
