"""A ``Space`` that a user built: it is stepped, and curves of its bodies are recorded.

A copy of the space is stepped, so that the user's stays as it is.  Objects that channels name are
copied with it.  Where that is not possible, since a channel is a function without arguments, which
reads the user's own objects, the space itself is stepped; a note says so.
"""

import copy
import inspect
from collections.abc import Callable, Iterator
from math import hypot
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pymunk

from proofmass.base.clock import processor_time
from proofmass.base.errors import InputError
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.object_run import ObjectRun

CALLBACKS = (
    *("_velocity_func", "_position_func", "_pre_solve_func", "_post_solve_func"),
    *("_force_func", "_torque_func"),
)
"""Where pymunk keeps the functions of a user in bodies and constraints.  A copy loses those of
springs, and the others may refer to the original bodies."""
WHOLE_STEPS = 1e-9  # share of a step by which a duration may miss a whole number of steps
NO_NAME = Path("space")
ChannelReader = Callable[[], float]


def record_space(space: pymunk.Space, run: ObjectRun) -> Curves:
    """Step a space, and record channels at its samples.

    Parameters
    ----------
    space : pymunk.Space
    run : ObjectRun

    Returns
    -------
    Curves
        `violation` is the largest opening of a pivot joint.  `notes` say if the space itself was
        stepped.

    Raises
    ------
    InputError
        The run is no whole number of steps, a channel cannot be read or gives no number, or the
        space cannot be copied.
    """
    require_steps(run)
    moved = [name for name, one in run.channels.items() if takes_nothing(name, one)]
    if moved and run.copies:
        raise space_error(
            f"channels.{moved[0]}",
            "a function without arguments reads the space itself, and copies of it are run; give "
            "(body, 'angle') or a function of the space",
        )
    stepped, objects = (space, list_objects(run)) if moved else copy_space(space, run)
    readers = {name: reader_of(name, one, stepped, objects) for name, one in run.channels.items()}
    pivots = [one for one in stepped.constraints if isinstance(one, pymunk.PivotJoint)]
    rows, gaps, begin = list[list[float]](), list[float](), processor_time()
    for k in range(run.samples):
        for _ in range(run.every if k else 0):
            stepped.step(run.step)
        rows.append([read_number(name, read) for name, read in readers.items()])
        gaps.append(max(map(opening, pivots), default=0.0))
    table = np.array(rows).T
    notes: tuple[str, ...] = ()
    if moved:
        notes = (
            f"The space itself was stepped, by {run.duration:g} s, since channel {moved[0]!r} is a "
            "function without arguments.",
        )
    return Curves(
        run.times,
        dict(zip(readers, table, strict=True)),
        violation=max(gaps),
        violations=np.array(gaps),
        seconds=processor_time() - begin,
        steps=run.every * (run.samples - 1),
        settings={"timestep": run.step, "iterations": stepped.iterations},
        notes=notes,
    )


def require_steps(run: ObjectRun) -> None:
    """Raise `InputError` unless a run is a positive whole number of steps to each sample."""
    if not (np.isfinite([run.step, run.duration]).all() and 0 < run.step <= run.duration):
        raise space_error(
            "step", f"0 < step <= duration must hold; got {run.step:g} and {run.duration:g} s"
        )
    count = run.duration / (run.step * run.every)
    if run.every < 1 or abs(count - round(count)) > WHOLE_STEPS * count or round(count) < 1:
        raise space_error(
            "duration",
            f"{run.duration:g} s are {count:.6g} times {run.every} steps of {run.step:g} s; give a "
            "whole number of them",
        )
    if not run.channels:
        raise space_error("channels", "give one or more, such as {'angle': (body, 'angle')}")


def takes_nothing(name: str, channel: Any) -> bool:
    """Whether a channel is a function without arguments.

    Raises
    ------
    InputError
        It is neither a function nor an object with the path of an attribute.
    """
    if isinstance(channel, tuple) and len(channel) == 2 and isinstance(channel[1], str):
        return False
    if not callable(channel):
        raise space_error(
            f"channels.{name}",
            "give an object with an attribute, (body, 'angle'), or a function of the space",
        )
    return not inspect.signature(channel).parameters


def list_objects(run: ObjectRun) -> dict[str, Any]:
    """The objects that channels name, by channel."""
    return {name: one[0] for name, one in run.channels.items() if isinstance(one, tuple)}


def copy_space(space: pymunk.Space, run: ObjectRun) -> tuple[pymunk.Space, dict[str, Any]]:
    """A copy of a space, and the copies of the objects that channels name.

    Raises
    ------
    InputError
        A function of the user acts in the space, which may refer to the original; an object is not
        in the space; or something cannot be copied.
    """
    for words in own_functions(space):
        raise space_error(
            "",
            f"{words}, which may refer to what a copy does not have; give a channel as a function "
            "without arguments, such as lambda: body.angle: the space itself is then stepped",
        )
    objects = list_objects(run)
    there = [space, space.static_body, *space.bodies, *space.shapes, *space.constraints]
    for name, one in objects.items():
        if not any(one is other for other in there):
            raise space_error(
                f"channels.{name}", f"{type(one).__name__} is neither the space nor added to it"
            )
    try:
        return copy.deepcopy((space, objects))
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
        raise space_error("", f"it cannot be copied: {words}") from None


def own_functions(space: pymunk.Space) -> Iterator[str]:
    """Sentences on the functions of a user that act in a space."""
    for kind, things in (("body", space.bodies), ("constraint", space.constraints)):
        for k, thing in enumerate(things):
            for name in CALLBACKS:
                if getattr(thing, name, None) is not None:
                    yield f"{kind} {k} has a {name.strip('_')}"
    if space._handlers:
        yield "the space has a collision handler"


def reader_of(
    name: str, channel: Any, space: pymunk.Space, objects: dict[str, Any]
) -> ChannelReader:
    """A function without arguments that reads a channel of the space that is stepped."""
    if name in objects:
        found, get = objects[name], attrgetter(channel[1])
        return lambda: get(found)
    return channel if takes_nothing(name, channel) else lambda: channel(space)


def read_number(name: str, read: ChannelReader) -> float:
    """Read a number.

    Raises
    ------
    InputError
        The function fails, or gives something else.
    """
    try:
        return float(read())
    except Exception as error:
        raise space_error(
            f"channels.{name}", f"cannot be read: {type(error).__name__}: {error}"
        ) from None


def opening(pivot: pymunk.PivotJoint) -> float:
    """The distance of the two points that a pivot joint joins [m]."""
    apart = pivot.a.local_to_world(pivot.anchor_a) - pivot.b.local_to_world(pivot.anchor_b)
    return hypot(*apart)


def space_error(key: str, wrong: str) -> InputError:
    """The error of a space."""
    return InputError(NO_NAME, key, wrong)
