"""Pictures of a mechanism along a run; the poses are the engine's own.

    picture(model: Path, run: Run) -> Picture
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from proofmass.analytic.numerics import Array
from proofmass.sim.mujoco.model import load
from proofmass.sim.mujoco.rest import linkage_of
from proofmass.sim.picture import Picture
from proofmass.sim.picture_scene import Scene
from proofmass.sim.protocol import BadModel, Run, Unsupported

SECONDS = 5.0  # at most for stepping a free motion


def picture(model: Path, run: Run, count: int = 121) -> Picture:
    """The mechanism at `count` poses, evenly over the run, or as far as it comes.

    Raises
    ------
    Unsupported
        The model has no joint, or does not move in a plane; the message names what leaves it.
    BadModel
        It does not compile.
    """
    compiled, data = load(model, run)
    scene = Scene(compiled, data.qpos)
    x = run.x[:1] if run.kind == "rest" else np.linspace(run.x[0], run.x[-1], count)
    rows, stopped = follow(compiled, data, replace(run, x=x))
    drawn = scene.drawn({name: np.array([row[name] for row in rows]) for name in rows[0]}, run)
    return replace(drawn, x=x[: len(rows)], inputs=run.motion(x)[0][:, : len(rows)],
                   stopped=stopped)


def follow(model: mujoco.MjModel, data: mujoco.MjData,
           run: Run) -> tuple[list[dict[str, Array]], str]:
    """Poses along the run, as far as they can be had, and why there are no more.

    When not even the first can be had, it is the start pose as it stands in the MJCF.
    """
    mujoco.mj_kinematics(model, data)
    rows, kept = [], ("qpos", "xpos", "xmat", "xanchor", "xaxis", "site_xpos")
    still = run.drives or run.kind == "rest"
    moves = swept(model, data, run) if still else stepped(model, data, run)
    first, stopped = {name: getattr(data, name).copy() for name in kept}, ""
    try:
        for _ in moves:
            rows.append({name: getattr(data, name).copy() for name in kept})
    except (BadModel, Unsupported) as error:
        stopped = str(error)
    return rows or [first], stopped


def swept(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Iterator[None]:
    """Put the model into each pose that the drives want."""
    linkage, tangent = linkage_of(model, data, run), None
    for values in run.motion(run.x)[0].T:
        tangent = linkage.move(values, tangent)
        yield


def stepped(model: mujoco.MjModel, data: mujoco.MjData, run: Run) -> Iterator[None]:
    """Let the model move freely from time to time."""
    late, data.time = time.monotonic() + SECONDS, run.x[0]
    for moment in run.x:
        while data.time < moment - 0.5 * model.opt.timestep and time.monotonic() < late:
            mujoco.mj_step(model, data)
        if time.monotonic() >= late or not np.isfinite(data.qpos).all():
            raise Unsupported("the free motion was not followed to its end")
        mujoco.mj_kinematics(model, data)
        yield
