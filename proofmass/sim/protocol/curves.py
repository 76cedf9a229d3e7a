"""Curves: what an engine returns of a run, by channel."""

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from math import isnan, nan

import numpy as np

from proofmass.base.arrays import Array


@dataclass(frozen=True)
class Curves:
    """Named curves over one rising parameter, and the cost of their computation.

    Attributes
    ----------
    x : ndarray (n,)
        Time [s], drive value, or arc length [m] in equilibrium.
    channels : dict of str to ndarray (n,)
        The recorded curves [SI].
    missing : dict of str to str
        Channels that this simulator cannot deliver in this kind of run, with the reason.
    drive : tuple of three ndarray (drives, n), or None
        Value, rate and acceleration [rad or m, per s, per s^2] of the *actual* motion of the driven
        joints; rates and accelerations of a sweep are those of its motion profile.  None in a
        driven run stands for the motion profiles.
    violation : float
        Largest constraint violation: distance between two points that a loop joins [m].
    seconds : float
        Processor time of the run without loading the model [s].
    steps : int
        Engine steps (dynamics) or pose solutions (sweep).
    settings : dict
        Settings that were used and had an effect: time step, integrator, ...
    stopped : str
        Why a sweep ended before its last sample, for example at a limit position; `x` and
        `channels` then have the samples before the end.
    derivatives : {2, 1, 0}
        Highest time derivative of the motion that the run has: 2 accelerations, 1 rates, 0 poses
        alone, as in a sweep in which the engine steps to rest at every sample.
    violations : ndarray (n,), or None
        The constraint violation at each sample [m] of a run in time.
    uncertainty : dict of str to ndarray (n,)
        By channel, the possible error of its curve from a cause that is no fault of the judged
        party, such as the interpolation of rows [SI]; zero for channels that are left out.
    rows : dict of str to tuple of two ndarray (m,)
        By channel, the rows of a recorded curve that lie in the run, rising, and its values there
        [SI]; only where these are not the samples.
    by_profile : bool
        Whether `drive` is that of the motion profiles, since the run has no record of its drives.
    notes : tuple of str
        Remarks on the curves, a sentence each.
    asked_step : float
        Time step that the model or its settings ask for [s]; the step that was made is
        ``settings["timestep"]``.  NaN in runs without time steps.
    work : float
        Processor time that the steps of the run count [s]: their number times a time that the
        engine computes from the sizes of the model and the settings.  It is the same on every
        machine, so that it decides which of two settings is cheaper; NaN if the engine does not
        count it.
    versions : dict of str to str
        Versions of the packages that computed, of an engine that runs in another interpreter.
    compile_seconds : float
        Processor time in which the engine compiled the model before its steps [s].
    """

    x: Array
    channels: dict[str, Array]
    missing: dict[str, str] = field(default_factory=dict)
    drive: tuple[Array, Array, Array] | None = None
    violation: float = 0.0
    seconds: float = 0.0
    steps: int = 0
    settings: dict[str, object] = field(default_factory=dict)
    stopped: str = ""
    derivatives: int = 2
    violations: Array | None = None
    uncertainty: dict[str, Array] = field(default_factory=dict)
    rows: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    by_profile: bool = False
    notes: tuple[str, ...] = ()
    asked_step: float = float("nan")
    work: float = nan
    versions: dict[str, str] = field(default_factory=dict)
    compile_seconds: float = 0.0

    @property
    def made_step(self) -> float:
        """The time step that was made [s]; NaN in runs without time steps."""
        made = self.settings.get("timestep")
        return made if isinstance(made, float) else float("nan")

    @property
    def step_share(self) -> float:
        """The time step that was made over that asked for [1]; NaN in runs without time steps."""
        return self.made_step / self.asked_step

    @property
    def cost(self) -> float:
        """The counted processor time, or the measured one if none is counted [s]."""
        return self.seconds if isnan(self.work) else self.work

    def first(self, count: int) -> "Curves":
        """The curves at the first `count` samples."""
        value, rate, acceleration = self.drive or 3 * (np.empty((0, 0)),)
        return replace(
            self,
            x=self.x[:count],
            channels={name: curve[:count] for name, curve in self.channels.items()},
            drive=self.drive and (value[:, :count], rate[:, :count], acceleration[:, :count]),
            violations=None if self.violations is None else self.violations[:count],
            uncertainty={name: size[:count] for name, size in self.uncertainty.items()},
            rows={name: rows_until(self.x[:count], *one) for name, one in self.rows.items()},
        )


def rows_until(x: Array, rows: Array, values: Array) -> tuple[Array, Array]:
    """The rows of a recorded curve, rising, and its values, where they lie within samples.

    >>> rows_until(np.array([0.0, 1.0]), np.array([0.1, 0.9, 1.1]), np.arange(3))
    (array([0.1, 0.9]), array([0, 1]))
    """
    inside = (rows >= x.min(initial=np.inf)) & (rows <= x.max(initial=-np.inf))
    return rows[inside], values[inside]


def split_channel(channel: str, names: Collection[str]) -> tuple[str, str]:
    """Split a channel into a sensor or rod of one of `names`, which may have dots, and its part.

    >>> split_channel("tip.x", ["tip"]), split_channel("tip.pos.x", ["tip", "tip.pos"])
    (('tip', 'x'), ('tip.pos', 'x'))
    >>> split_channel("tip.x", ["tip", "tip.x"])
    ('tip.x', '')
    """
    if channel in names:
        return channel, ""
    name, _, part = channel.rpartition(".")
    if name not in names:
        name, _, part = channel.partition(".")
    return name, part


def drive_columns(joint: str) -> tuple[str, str, str]:
    """Names of table columns with value, rate and acceleration of a joint's drive.

    >>> drive_columns("crank")
    ('crank drive', 'crank drive rate', 'crank drive acceleration')
    """
    return f"{joint} drive", f"{joint} drive rate", f"{joint} drive acceleration"
