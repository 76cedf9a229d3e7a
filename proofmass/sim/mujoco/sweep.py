"""Quasi-static sweep in MuJoCo: poses, rates, accelerations and holding moments without time steps.

The holding moment is virtual work: the engine's inverse dynamics at rest, projected on the motion
that the drive allows.  The engine's own ``qfrc_inverse`` at the drive is not it: on a closed loop
it leaves out what the loop carries.  Freedoms that the drives leave come to rest between springs,
weights and stops; see `proofmass.sim.mujoco.rest`, and `proofmass.sim.mujoco.settled` for the
engine's own way there.
"""

import time

import mujoco
import numpy as np

from proofmass.sim.mujoco.model import Recorder
from proofmass.sim.mujoco.reading import drive_moments, withhold
from proofmass.sim.mujoco.rest import Resting, linkage_of
from proofmass.sim.mujoco.settled import settled
from proofmass.sim.protocol import BadModel, Curves, Run, Unsupported

ACC = int(mujoco.mjtStage.mjSTAGE_ACC)
NO_ACC = "springs, weights or stops bring the model to rest: a path of rests has no accelerations"


def sweep(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Follow the drives over ``run.x`` and read every sensor at every pose.

    It stops where the loops cannot be closed any further, where a joint that the drives move leaves
    its range, or where the rest of the freedoms that are left folds or becomes unstable.  With the
    setting ``settled`` the engine steps in time.

    Raises
    ------
    BadModel
        The loops cannot be closed at the first values of the drives, or the start pose is an
        unstable equilibrium.
    Unsupported
        Freedoms are left that nothing brings to rest near the start pose, or an equality is of
        another kind.
    """
    if not run.drives:
        raise BadModel("a sweep needs a [drive]: the joint that is moved")
    if run.settings.get("settled"):
        return settled(model, data, run)
    state = run.motion(run.x)
    linkage = linkage_of(model, data, run)
    record = Recorder(model, data, run.channels, run.x.size)
    missing = withhold(record, ACC, NO_ACC) if isinstance(linkage, Resting) else {}
    moments, stopped, done = np.empty((run.x.size, len(run.drives))), "", run.x.size
    began = time.perf_counter()
    tangent = None
    for k, (values, rates, accelerations) in enumerate(zip(*(s.T for s in state), strict=True)):
        try:
            tangent = linkage.move(values, tangent)
            linkage.check_limits()
            moments[k] = linkage.holding_moments(tangent)
            data.qvel[:] = tangent @ rates
            data.qacc[:] = linkage.acceleration(data.qvel, accelerations)
        except (BadModel, Unsupported) as error:
            if k < 2:
                raise
            stopped, done = str(error), k
            break
        mujoco.mj_inverse(model, data)
        if data.ncon:
            raise Unsupported(f"{data.ncon} contact(s) in a sweep, at {linkage.spoken(values)}")
        record.sample(k)
    seconds = time.perf_counter() - began
    record.cut(done)
    channels = record.curves()
    channels |= drive_moments(model, linkage, record, moments[:done])
    value, rate, acceleration = (part[:, :done] for part in state)
    return Curves(run.x[:done], channels, missing, drive=(value, rate, acceleration),
                  gap=float(record.gaps().max()), seconds=seconds, steps=done, stopped=stopped,
                  derivatives=1 if isinstance(linkage, Resting) else 2)
