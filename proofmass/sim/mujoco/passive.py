"""Any MJCF let go in MuJoCo as it is: contacts, tendons, whatever it holds, and no drives.

Loops are neither closed nor watched and no motion is prescribed: what `proofmass.sim.mujoco.engine`
refuses in a duration runs here as well, and nothing is corrected.
"""

import time

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.settings import stepped_with
from proofmass.sim.mujoco.still import lost
from proofmass.sim.protocol import Curves, Diverged, Run


def passive(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Curves:
    """Step from the present pose through ``run.x`` (time) with its controls, and read every sensor.

    Parameters
    ----------
    model : mujoco.MjModel
        All sensors have names; those with several numbers become channels ``name[k]``.
    data : mujoco.MjData
    run : Run
        Of which ``x`` is used.

    Raises
    ------
    Diverged
        The engine reset itself, or a sensor is not finite.
    """
    count, model.opt.timestep = run.steps(model.opt.timestep)
    rows, began = np.empty((run.x.size, model.nsensordata)), time.perf_counter()
    for row in rows[:-1]:
        mujoco.mj_step(model, data)
        row[:] = data.sensordata  # of the state that the step began with
        if count > 1:
            mujoco.mj_step(model, data, count - 1)
    mujoco.mj_forward(model, data)
    rows[-1] = data.sensordata
    seconds = time.perf_counter() - began
    check(data, rows, run.x)
    return Curves(run.x, channels(model, rows), seconds=seconds, steps=count * (run.x.size - 1),
                  settings=stepped_with(model))


def check(data: mujoco.MjData, rows: Array, times: Array) -> None:
    """Raise `Diverged` if the run was lost."""
    if warning := lost(data):
        raise Diverged(warning)
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        raise Diverged(f"not finite at t = {times[int(np.argmin(finite))]:.4g} s")


def channels(model: mujoco.MjModel, rows: Array) -> dict[str, Array]:
    """Curves by the names of their sensors."""
    found = {}
    for s in range(model.nsensor):
        name, first, dim = model.sensor(s).name, model.sensor_adr[s], model.sensor_dim[s]
        for k in range(dim):
            found[name if dim == 1 else f"{name}[{k}]"] = rows[:, first + k].copy()
    return found
