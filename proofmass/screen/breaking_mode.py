"""What sets the largest stable step: a servo, a spring, a damper, or the softness of a loop."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import NamedElement
from proofmass.screen.linear import LinearMotion
from proofmass.screen.stable_step import StepLimit, StepMatrices
from proofmass.sim.dense import moment_arms, outputs_of

RIGID_SHARE = 1e-3
"""Angular frequency over the rate of decay below which a mode is told by its decay alone [1]."""
CHANGE = 1e-6
"""Step of the differences of actuator forces [rad or m, and per s]."""
WEIGHT, DAMPING, SOFTNESS = "springs and weight", "damping of joints and tendons", "softness"


@dataclass(frozen=True)
class Share:
    """The part of one cause in the mode that breaks.

    Attributes
    ----------
    what : str
        ``stiffness`` or ``damping`` of an actuator, or one of the names of this module.
    actuator : NamedElement or None
        The actuator, if it is one.
    size : float
        (h omega / 2)^2 of a stiffness, h c / (2 m) of a damping in which the integrator is
        explicit, over the mode's mass [1]; the whole of a mode at its limit is about 1.
    """

    what: str
    actuator: NamedElement | None
    size: float

    @property
    def is_damping(self) -> bool:
        """Whether the limit falls with a damping, and not with the root of a stiffness."""
        return self.what in ("damping", DAMPING)

    def __str__(self) -> str:
        if self.actuator is not None:
            return f"the {self.what} of {self.actuator}"
        if self.what == SOFTNESS:
            return "the softness of loops and joint limits (solref)"
        return f"the {self.what}"


@dataclass(frozen=True)
class BreakingMode:
    """The mode that breaks first beyond the largest stable step.

    Attributes
    ----------
    joint : NamedElement
        The joint with the largest share of its kinetic energy.
    coordinate : int
        Its coordinate.
    cause : Share
        The largest of its causes.
    mass : float
        The mode's mass where the joint moves by one [kg or kg m^2].
    stiffness, damping : float
        What springs, servos, weight and loops resist it with there [N m/rad or N/m], and per rate
        [N m s/rad or N s/m].
    """

    joint: NamedElement
    coordinate: int
    cause: Share
    mass: float
    stiffness: float
    damping: float

    @property
    def rates(self) -> str:
        """Its angular frequency and damping ratio; its rate of decay if nothing holds it in place.

        >>> joint, cause = NamedElement("joint", "j"), Share(DAMPING, None, 1.0)
        >>> BreakingMode(joint, 0, cause, 0.01, 3948.0, 2.5).rates
        'ω = 628/s, ζ = 0.199'
        >>> BreakingMode(joint, 0, cause, 0.01, 0.0, 2.0).rates
        'decays with 200/s'
        """
        omega = np.sqrt(max(self.stiffness, 0.0) / self.mass)
        decay = self.damping / self.mass
        if omega <= RIGID_SHARE * abs(decay):
            return f"decays with {number(decay)}/s"
        return f"ω = {number(float(omega))}/s, ζ = {number(float(decay / (2.0 * omega)))}"


def find_breaking_mode(steps: StepMatrices, limit: StepLimit) -> BreakingMode:
    """The joint and the cause of a limit with a mode."""
    motion, pose = steps.motion, steps.motion.pose
    assert limit.shape is not None
    shape = limit.shape
    k = int(np.argmax(np.abs(shape.conj() * (motion.masses @ shape))))
    real = np.real(shape * np.exp(-1j * np.angle(shape[k])))
    stiffness, damping, weights = motion.softness(limit.step)
    added = weights * (motion.soft_rows @ real) ** 2 if weights.size else np.zeros(0)
    mass = float(real @ motion.masses @ real + added.sum())
    softness = float((added * stiffness).sum())
    shares = list(find_shares(steps, limit, real, softness))
    worst = max(shares, key=lambda share: share.size)
    unit = float(real[k]) ** 2
    return BreakingMode(
        pose.joint_of(k),
        k,
        Share(worst.what, worst.actuator, worst.size / mass),
        mass / unit,
        (float(real @ motion.stiffness @ real) + softness) / unit,
        (float(real @ motion.damping @ real) + float((added * damping).sum())) / unit,
    )


def find_shares(
    steps: StepMatrices, limit: StepLimit, shape: Array, softness: float
) -> Iterator[Share]:
    """The causes of a mode at a limit, not yet divided by the mode's mass."""
    motion, pose = steps.motion, steps.motion.pose
    stiff, damped = actuator_parts(motion, shape)
    half, quarter = limit.step / 2.0, limit.step**2 / 4.0
    explicit = explicit_damping(steps, limit.integrator)
    if limit.integrator == "discrete":  # it is implicit in springs and servos
        stiff, damped = np.zeros((2, len(stiff)))
        weight = motion.stiffness - steps.implicit_stiffness
        yield Share(WEIGHT, None, quarter * float(shape @ weight @ shape))
    else:
        yield Share(WEIGHT, None, quarter * float(shape @ motion.stiffness @ shape - stiff.sum()))
    yield Share(SOFTNESS, None, quarter * softness)
    if explicit is not None:
        yield Share(DAMPING, None, half * float(shape @ explicit @ shape - damped.sum()))
    for a in range(pose.model.nactuator):
        actuator, own = pose.element("actuator", a), outputs_of(pose.model, a)
        yield Share("stiffness", actuator, quarter * float(stiff[own].sum()))
        if explicit is not None:
            yield Share("damping", actuator, half * float(damped[own].sum()))


def explicit_damping(steps: StepMatrices, integrator: str) -> Array | None:
    """The damping (nv, nv) in which an integrator is explicit; None if there is none."""
    if integrator == "Euler":
        return steps.motion.damping - steps.implicit_dampings["Euler"]
    if integrator == "discrete":
        return steps.motion.damping - steps.implicit_dampings["implicitfast"]
    return steps.motion.damping if integrator == "RK4" else None


def actuator_parts(motion: LinearMotion, shape: Array) -> tuple[Array, Array]:
    """The stiffness and the damping (outputs,) that actuators add to a mode of a real shape."""
    pose = motion.pose
    pose.enter(pose.qpos)
    arms = moment_arms(pose.model, pose.data)
    still = np.array(pose.data.actuator_force)
    pose.enter(pose.moved(CHANGE * shape))
    moved = np.array(pose.data.actuator_force)
    pose.enter(pose.qpos, CHANGE * shape)
    moving = np.array(pose.data.actuator_force)
    pose.enter(pose.qpos)
    lever = -(arms @ shape) / CHANGE
    return lever * (moved - still), lever * (moving - still)
