"""A run: what an engine is to do with a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from math import ceil

import numpy as np

from proofmass.analytic.controls import MotionProfile
from proofmass.base.arrays import Array
from proofmass.sim.protocol.failures import BadModel, Unsupported

STEP_ROUNDING = 1e-9
"""Deviation from a whole number of steps that is rounding of the times [steps]."""
MIN_STEP_SHARE = 0.9
"""Least share of the time step of a model or of its settings that a run may step with, if its
samples are at round values of a drive or at rows of a recorded curve, which whole steps do not lead
to: 42 shipped cases, all driven, run with 0.926 to 0.999 of their step.  An error of second order
is then smaller by a fifth at most."""
MIN_FREE_STEP_SHARE = 0.99
"""Least share of the same step for another run, whose samples can be anywhere.  The share may be
less than 1, since a duration need not be a whole number of steps."""
MAX_STEPS = 1e12  # steps from sample to sample; at 1 us a step, of the smallest models, 12 days


@dataclass(frozen=True)
class Drive:
    """A prescribed joint motion.

    Attributes
    ----------
    joint : str
        Name of the driven joint in the MJCF.
    profile : callable
        The motion profile: ``profile(x) -> (value, rate, acceleration)`` for arrays of x, in the
        joint's SI units.  In a sweep x is the run's x; in dynamics it is time [s].
    """

    joint: str
    profile: MotionProfile


@dataclass(frozen=True)
class ChangingLoad:
    """An actuator whose control changes along a run.

    Attributes
    ----------
    actuator : str
        Its name in the MJCF.  It acts on a joint that is not driven, at a site or on a tendon; in
        a sweep it is a motor.
    profile : callable
        ``profile(x) -> (value, rate, acceleration)`` of its control, see `Drive`.  The force of a
        motor is the control times its gear and its gain.
    """

    actuator: str
    profile: MotionProfile


@dataclass(frozen=True)
class Rod:
    """An elastic rod on a site of the MJCF, bending in the model's plane, or in space.

    Attributes
    ----------
    name : str
        Name of the rod; its bodies, joints and sites are ``name.1``, ``name.2``, ...
    start : str
        Site where it begins, with its tangent along the site's x axis; it bends about the z axis.
    end : str, optional
        Site, of another body or of another rod, that constrains its far end.
    length : float
        [m]
    stiffness : float
        EI [N m^2]
    segments : int
        Number n >= 2 of segments of h = length / n.
    ends : tuple of two str
        ``clamped`` or ``pinned`` at the start; ``pinned``, ``clamped`` or ``free`` at the far end.
    scheme : {"half", "double", "naive"}
        Positions of its springs; see `proofmass.sim.rods`.
    mass : float, optional
        Mass of the whole rod [kg]; without gravity it has no effect in statics.
    turn : float
        Rotation of its tangent from end to end in the start pose, an arc [rad].
    shape : tuple of float
        In place of `turn`: rotations of its tangent, from its beginning to the ends of as many
        equal parts, in the start pose [rad].
    axial, shear : float, optional
        EA and GA [N]; None: the rod does not stretch, and its sections stay normal to it.
    load : tuple of three float
        Dead load per length in the axes of the world [N/m], such as wind.
    couple : float
        Dead moment per length about the z axis of its first site in the start pose [N].
    torsion : float, optional
        GJ [N m^2]; None: the rod does not leave the plane of its site's x and y axes.
    stiffness_y : float, optional
        In space, EI of bending about the y axes of its sections [N m^2]; None: as about z.
    curvature : tuple of three float
        Natural twist, and natural curvatures about the y and z axes of its sections [1/m]; the
        first two are zero in the plane.
    """

    name: str
    start: str
    end: str | None
    length: float
    stiffness: float
    segments: int
    ends: tuple[str, str]
    scheme: str = "half"
    mass: float | None = None
    turn: float = 0.0
    shape: tuple[float, ...] = ()
    axial: float | None = None
    shear: float | None = None
    load: tuple[float, float, float] = (0.0, 0.0, 0.0)
    couple: float = 0.0
    torsion: float | None = None
    stiffness_y: float | None = None
    curvature: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def spatial(self) -> bool:
        """Whether the rod may leave the plane of its site."""
        return self.torsion is not None


@dataclass(frozen=True)
class Run:
    """A run: what an engine is to do with a model.

    Attributes
    ----------
    kind : {"sweep", "dynamics", "equilibrium", "passive"}
        Quasi-static poses, time stepping, or one static equilibrium with the shapes of its rods.  A
        passive run steps a model without a sidecar, with the engine's own initial state from the
        key `start`, or from the first key if there is none of that name, and records all sensors.
    x : ndarray (n,)
        Samples, in rising order: time [s] in dynamics, arc length [m] of the rods in equilibrium.
    channels : tuple of str
        Sensors of the MJCF to record.  ``name`` for a scalar sensor, ``name.x``, ``.y``, ``.z``
        for a component of a vector, ``name.angle`` for the direction of a ``framexaxis`` sensor
        in the plane of motion, unwrapped along the run [rad].  In equilibrium also ``rod.x``,
        ``.y``, ``.z`` [m], ``.angle`` [rad] and ``.moment`` [N m] along a rod.
    drives : tuple of Drive
        Prescribed motions, all at the same time; empty for a free motion.
    start : str
        Name of the ``<key>`` with the start pose, which determines the assembly mode.
    settings : mapping
        Engine settings that replace those of the model: ``timestep``, ``iterations``, ...
    rods : tuple of Rod
        Rods with which the model is completed before it is compiled.
    inertia : bool
        Whether moments and forces of a sweep include the inertia forces at the rates and
        accelerations of its drives; those of dynamics always do.
    loads : tuple of ChangingLoad
        Actuators whose controls change, in place of the controls of the key; an engine that cannot
        change them raises `Unsupported`.
    """

    kind: str
    x: Array
    channels: tuple[str, ...]
    drives: tuple[Drive, ...] = ()
    start: str = "start"
    settings: Mapping[str, object] = field(default_factory=dict)
    rods: tuple[Rod, ...] = ()
    inertia: bool = False
    loads: tuple[ChangingLoad, ...] = ()

    def controls(self, x: Array) -> tuple[Array, Array]:
        """Controls of all loads that change and their rates at x, each (loads, n)."""
        value, rate, _ = evaluate_profiles(self.loads, x)
        return value, rate

    def motion(self, x: Array) -> tuple[Array, Array, Array]:
        """Values, rates and accelerations of all drives at x, each (drives, n)."""
        return evaluate_profiles(self.drives, x)

    def steps(self, timestep: float) -> tuple[int, float]:
        """Number of steps from sample to sample, and the step [s] <= `timestep` that fits it.

        Raises
        ------
        Unsupported
            The samples are not evenly spaced.
        BadModel
            There are more than `MAX_STEPS` steps from sample to sample.
        """
        spacing = np.diff(self.x)
        if np.ptp(spacing) > 1e-9 * spacing.mean():
            raise Unsupported("samples at uneven times in dynamics")
        width = float(self.x[-1] - self.x[0]) / (self.x.size - 1)
        if not (steps := width / float(timestep)) < MAX_STEPS:
            raise BadModel(
                f"{width:g} s from sample to sample are {steps:.3g} time steps of "
                f"{timestep:g} s; give a longer step or a shorter run"
            )
        count = whole_steps(width, float(timestep))
        return count, width / count


def fitting_samples(duration: float, timestep: float, samples: int) -> int:
    """A number of samples, not less than `samples` if steps allow it, that whole steps lead to.

    The steps are as long as `timestep` if they fit into the duration, and otherwise hardly shorter:
    by less than a hundredth, if the duration has a hundred steps.

    >>> fitting_samples(1.0, 0.02, 361), fitting_samples(1.0, 0.002, 361)
    (51, 501)
    >>> fitting_samples(1.0, 0.0002, 361), fitting_samples(6.283, 0.001, 361)
    (501, 371)
    >>> fitting_samples(6.283, 0.001, 11)
    12
    """
    steps = whole_steps(duration, timestep)
    most = max(1, steps // (samples - 1))
    exact = (k for k in range(most, most // 2, -1) if steps % k == 0)
    close = (k for k in range(most, 1, -1) if steps >= MIN_FREE_STEP_SHARE * k * ceil(steps / k))
    per_sample = next(chain(exact, close), 1)
    return ceil(steps / per_sample) + 1


def evaluate_profiles(
    parts: Sequence[Drive | ChangingLoad], x: Array
) -> tuple[Array, Array, Array]:
    """Values, rates and accelerations of all profiles at x, each (parts, n)."""
    rows = [np.broadcast_arrays(*one.profile(x)) for one in parts]
    value, rate, acceleration = (
        np.array(part, float).reshape(len(rows), x.size)
        for part in (zip(*rows, strict=True) if rows else [()] * 3)
    )
    return value, rate, acceleration


def whole_steps(width: float, longest: float) -> int:
    """The least number of equal steps over a width that are no longer than the longest.

    >>> whole_steps(1.0, 0.3), whole_steps(1.0, 0.1), whole_steps(1.0, 2.0)
    (4, 10, 1)
    """
    return max(1, ceil(width / longest - STEP_ROUNDING))
