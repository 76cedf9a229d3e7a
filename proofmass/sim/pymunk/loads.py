"""Loads that change along a run: motors and servos whose controls are not those of the key.

In a step Chipmunk moves the bodies with their old velocities, and then computes new velocities from
the forces at the new positions.  A step therefore uses the control at its end, which is the middle
of the interval to which the new velocities belong, so that the effect of the control is of second
order in the step.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pymunk

from proofmass.base.arrays import Array
from proofmass.sim.contents import actuators_on, gear_of, joint_of
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.run import Run
from proofmass.sim.pymunk.links import LinkLoad, Links
from proofmass.sim.pymunk.model import LinkProjection, with_controls
from proofmass.sim.pymunk.reactions import SampledMotion
from proofmass.sim.pymunk.read import ConstantValue, Sensor, force_curves, read_channel
from proofmass.sim.pymunk.space import add_changing_load, add_changing_spring


@dataclass(frozen=True)
class LoadedLinks:
    """Links whose loads change from sample to sample.

    Attributes
    ----------
    links : Links
        Links with the constant controls of the start key, or any other.
    loads : tuple of str
        Names of the actuators whose controls change.
    controls : ndarray (n, loads)
        Controls of these actuators at the samples [SI].
    """

    links: Links
    loads: tuple[str, ...]
    controls: Array

    @classmethod
    def of(cls, links: Links, run: Run) -> "LoadedLinks":
        """Links with the changing loads of a run."""
        return cls(links, load_names(run), run.controls(run.x)[0].T)

    def at(self, controls: Array) -> Links:
        """The links with given controls (loads,)."""
        return with_controls(self.links, self.loads, controls)

    def curves(
        self, channels: dict[str, Sensor], motion: SampledMotion, drives: bool = False
    ) -> dict[str, Array]:
        """Curves of the channels that depend on the loads, with the loads of each sample.

        These are channels of the forces of motors and of forces between bodies, and with `drives`
        also those of the forces of drives.
        """
        changing = {name for name, c in channels.items() if isinstance(c.function, ConstantValue)}
        changing = {name for name in changing if channels[name].order == 0}
        orders = (-2, -3) if drives else (-3,)
        between = {name: c for name, c in channels.items() if c.order in orders}
        found = {name: np.empty(len(motion.pose)) for name in (*changing, *between)}
        for k in range(len(motion.pose) if found else 0):
            links = self.at(self.controls[k])
            for name, curve in force_curves(links, between, motion.at(k)).items():
                found[name][k] = curve[0]
            for name in changing:
                sensor = read_channel(links, name)
                assert isinstance(sensor, Sensor)
                found[name][k] = sensor.function(motion.pose[k])
        return found


@dataclass(frozen=True)
class ChangingForce:
    """Effect of a unit of a control: a force on a joint [N m or N], or a load on a link.

    ``joint`` is -1 for a load on a link; ``pull`` is None for a load on a joint, and for a load on
    the ground, which has no effect.
    """

    joint: int = -1
    force: float = 0.0
    pull: LinkLoad | None = None


def load_names(run: Run) -> tuple[str, ...]:
    """Names of the actuators of a run whose controls change."""
    return tuple(load.actuator for load in run.loads)


def links_at_start(links: Links, run: Run) -> Links:
    """The links with the controls of the first sample of a run."""
    if not run.loads:
        return links
    return with_controls(links, load_names(run), run.controls(run.x[:1])[0][:, 0])


def control_limits(links: Links, run: Run) -> tuple[Array, Array]:
    """Smallest and largest controls (loads,) between which the forces are proportional to them.

    The limits follow from the range of forces of each motor, and from the part of the range of its
    joint that the motors with constant controls leave.  They are infinite without a range.

    Parameters
    ----------
    links : Links
        From `links_at_start`.
    run : Run

    Raises
    ------
    Unsupported
        Several motors whose controls change share the range of a joint.
    """
    model, names = links.model, load_names(run)
    ids = [model.actuator(name).id for name in names]
    low, high = np.full(len(ids), -np.inf), np.full(len(ids), np.inf)
    for k, (name, a) in enumerate(zip(names, ids, strict=True)):
        j, gain, gear = joint_of(model, a), model.actuator_gainprm[a, 0], gear_of(model, a)[0]
        limited = j >= 0 and model.jnt_actfrclimited[j]
        others = [b for b in actuators_on(model, j) if b != a] if limited else []
        if set(others) & set(ids):
            raise Unsupported(
                f"the range of actuator forces of joint '{model.joint(j).name}', on which actuator "
                f"'{name}' is not the only one whose control changes"
            )
        constant_force = sum(
            links.reader.actuator_force(b)[0] * gear_of(model, b)[0] for b in others
        )
        for has_range, ends, unit in (
            (model.actuator_forcelimited[a], model.actuator_forcerange[a], gain),
            (limited, model.jnt_actfrcrange[j] - constant_force, gain * gear),
        ):
            if has_range and unit:
                least, most = np.sort(ends / unit)
                low[k], high[k] = np.clip([low[k], high[k]], least, most)
    return low, high


def changing_forces(links: Links, run: Run) -> tuple[ChangingForce, ...]:
    """Effects of a unit of the control of each load."""
    model, found = links.model, list[ChangingForce]()
    project = LinkProjection(links.plane, links.centre)
    pulls = {one.actuator: one for one in links.reader.loads()}
    for name in load_names(run):
        a = model.actuator(name).id
        gain, joint = float(model.actuator_gainprm[a, 0]), joint_of(model, a)
        if joint >= 0:
            found.append(ChangingForce(joint, gain * float(gear_of(model, a)[0])))
        else:
            pull = project.load(pulls[a], gain, model) if a in pulls else None
            found.append(ChangingForce(pull=pull))
    return tuple(found)


def control_changes(links: Links, run: Run, times: Array) -> Array:
    """Controls of the loads (n, loads) at times, less those of the first sample.

    Both are clipped to the limits of `control_limits`.
    """
    ends = control_limits(links, run)
    return np.clip(run.controls(times)[0].T, *ends) - np.clip(run.controls(run.x[:1])[0].T, *ends)


def add_loads(space: pymunk.Space, links: Links, run: Run) -> Callable[[list[float]], None]:
    """Add the changes of the loads of a run to a space that has the loads of its first sample.

    Returns
    -------
    callable
        A function that sets the `control_changes` of the controls (loads,).
    """
    now = [0.0] * len(run.loads)
    for k, one in enumerate(changing_forces(links, run)):
        if one.joint >= 0:
            add_changing_spring(space, links, links.joints[one.joint], k, one.force, now)
        elif one.pull:
            add_changing_load(space, one.pull, k, now)

    def set_changes(values: list[float]) -> None:
        now[:] = values

    return set_changes
