"""Compare two MJCF files in bare MuJoCo: nothing here imports proofmass or sim.

    python diet_bare.py '{"files": ["before.xml", "after.xml"], "seconds": 1, "joints": ["crank"]}'

Both models start from their key ``start`` and are stepped with their own options.  For each joint
and each body that is asked for, the script prints the largest difference between the two models,
and the largest error of each model against a fine solution of the first file.  The fine solution
has 16 times shorter steps and constraints solved by Newton's method to 1e-15.  It is finer than the
solution that a diet compares options with (8 times shorter steps, 1e-14), and independent of it.
"""

import json
import sys

import mujoco
import numpy as np

STEP_DIVISOR = 16


def simulate(file, times, joints, bodies, step_divisor=1):
    """Values of joints and coordinates of bodies at some times, in one column each."""
    model = mujoco.MjModel.from_xml_path(file)
    if step_divisor > 1:
        model.opt.timestep /= step_divisor
        model.opt.solver, model.opt.tolerance = mujoco.mjtSolver.mjSOL_NEWTON, 1e-15
        model.opt.iterations = 200
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    rows = []
    for time in times:
        steps = round((time - data.time) / model.opt.timestep)
        assert abs(data.time + steps * model.opt.timestep - time) < 1e-9, "a step does not fit"
        for _ in range(steps):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        rows.append(
            [
                *(float(data.qpos[model.joint(j).qposadr[0]]) for j in joints),
                *(float(x) for b in bodies for x in data.body(b).xpos),
            ]
        )
    return np.array(rows)


def main():
    parameters = json.loads(sys.argv[1])
    joints, bodies = parameters.get("joints", []), parameters.get("bodies", [])
    samples = parameters.get("samples", 26)
    times = np.linspace(0, parameters["seconds"], samples)
    one, two = (simulate(f, times, joints, bodies) for f in parameters["files"])
    fine = simulate(parameters["files"][0], times, joints, bodies, STEP_DIVISOR)
    names = [*joints, *(f"{b}.{x}" for b in bodies for x in "xyz")]
    print(
        json.dumps(
            {
                name: {
                    "size": float(np.abs(fine[:, k]).max()),
                    "range": float(np.ptp(fine[:, k])),
                    "moved": float(np.abs(one[:, k] - two[:, k]).max()),
                    "before": float(np.abs(one[:, k] - fine[:, k]).max()),
                    "after": float(np.abs(two[:, k] - fine[:, k]).max()),
                }
                for k, name in enumerate(names)
            }
        )
    )


if __name__ == "__main__":
    main()
