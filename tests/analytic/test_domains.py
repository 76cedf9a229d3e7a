"""Closed forms of linkages and contacts take what their docstrings say, and refuse all else."""

import importlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import ArrayLike

from proofmass.analytic.chart import Chart
from proofmass.analytic.contacts import (
    ball_row,
    bouncing_ball,
    rocking_block,
    rolling_ball,
    sliding_block,
)
from proofmass.analytic.inverse import PathMotion
from proofmass.analytic.linkages import (
    fivebar,
    fourbar,
    hacksaw,
    inverted_slider_crank,
    pendulum,
    shaft_pendulum,
    slider_crank,
    swinging_block,
    threeprr,
)
from proofmass.analytic.numerics import LARGEST
from proofmass.analytic.protocol import ClosedForm, Reference
from proofmass.base.entry_points import entry_points_of
from proofmass.base.units import unit_powers
from proofmass.reference.find import find_reference, reference_names


@dataclass(frozen=True)
class Call:
    """A valid call of a public function, by its arguments."""

    function: Callable[..., Any]
    arguments: dict[str, Any]
    rows: int = 0
    """Number of inputs, the length of the first axis of a motion; 0 for a motion without it."""
    shapes: str = "any"
    """Shapes of a motion without that axis: any, row for (n,) alone, none for no motion."""

    @property
    def name(self) -> str:
        """The function with the last part of its module, as an id of a test."""
        return f"{self.function.__module__.split('.', 3)[-1]}.{self.function.__name__}"


FOUR = {"crank": 1.0, "coupler": 4.0, "rocker": 4.0, "ground": 2.0}
FIVE = {
    "left_crank": 2.0,
    "left_coupler": 4.0,
    "right_coupler": 4.0,
    "right_crank": 1.0,
    "left_x": 0.0,
    "right_x": 2.0,
}
MODES_OF_CRANKS = {"left_mode": 1, "right_mode": -1}
ROBOT = {"side": 1.0, "leg": 1.0, "guide2_x": 3.0, "guide3_x": 2.5, "guide3_y": 2.8}
SAW = {"crank": 0.075, "coupler": 0.17, "offset": 0.045}
SHAFT = {"length": 0.2, "mass": 0.5, "friction": 0.3}
SLIDER = {"crank": 1.0, "coupler": 3.0}
BLOCK = {"width": 0.1, "height": 0.4, "tilt": 0.1}
BALL = {"radius": 0.1, "friction": 0.3, "speed": 7.0}
DROP = {"height": 5.0, "restitution": 0.5}
SLOPE = {"friction": 0.3, "angle": 0.1, "speed": 7.0}
MOTION = {"angle": 0.5, "rate": 2.0, "acceleration": -1.0}
TWO_MOTIONS = {"angle": [0.5, 0.9], "rate": [2.0, 1.0], "acceleration": [-1.0, 3.0]}
SLIDERS = {"sliders": [2.0, 0.5, 0.2], "rate": [1.0, 2.0, 3.0], "acceleration": [0.5, 1.0, 2.0]}
POSE = {"pose": [2.2, 0.97, 0.0], "rate": [1.0, 2.0, 3.0], "acceleration": [0.5, 1.0, 2.0]}
TIP = {"tip": [-0.5, 2.5], "velocity": [1.0, 2.0], "acceleration": [0.5, 1.0]}
PATH = {"center_x": -0.5, "center_y": 2.5, "radius": 0.1, "rate": 1.0}


def along_path(place: str, motion: dict[str, list[float]]) -> PathMotion:
    """One place of a path with its rate and acceleration, from a motion of a tip or a pose."""
    keys = place, "velocity" if "velocity" in motion else "rate", "acceleration"
    return PathMotion(np.zeros(1), *(np.array(motion[key])[:, None] for key in keys))


CORNERS = {"corner_x": -0.5, "corner_y": 2.5, "width": 0.1, "height": 0.2, "period": 2.0}
CIRCLE = {"centre_x": 2.0, "centre_y": 1.2, "radius": 0.1, "period": 2.0}
CALLS = [
    Call(fourbar.solve, {**MOTION, **FOUR, "rocker_load": 3.0}),
    *(
        Call(function, FOUR, shapes="none")
        for function in (
            fourbar.grashof_margin,
            fourbar.classify,
            fourbar.crank_range,
            fourbar.dead_centres,
            fourbar.swing_angle,
            fourbar.time_ratio,
            fourbar.transmission_range,
            fourbar.properties,
        )
    ),
    Call(slider_crank.solve, {**MOTION, **SLIDER, "slider_load": 3.0}),
    Call(slider_crank.dead_points, SLIDER, shapes="none"),
    Call(slider_crank.properties, SLIDER, shapes="none"),
    Call(hacksaw.solve, {**MOTION, **SAW, "cutting_force": 3.0}),
    Call(hacksaw.motor, {"time": 1.5, "peak": 5.0}),
    Call(hacksaw.turn_time, {"peak": 5.0}, shapes="none"),
    Call(
        inverted_slider_crank.solve,
        {**TWO_MOTIONS, "crank": 2.0, "bar": 1.0, "rod": 3.0, "ground_x": 2.0},
        rows=2,
    ),
    Call(swinging_block.solve, {**MOTION, "crank": 1.0, "rod": 3.0, "pivot_x": 2.0}),
    Call(
        pendulum.solve, {"time": 0.5, "length": 1.0, "mass": 1.0, "gravity": 9.81, "amplitude": 1.0}
    ),
    Call(pendulum.period, {"length": 1.0, "gravity": 9.81, "amplitude": 1.0}, shapes="none"),
    Call(
        shaft_pendulum.solve,
        {"angle": [0.0, 1.0, -1.0], "rate": 1.0, "acceleration": 0.0, **SHAFT},
        shapes="none",
    ),
    *(
        Call(function, SHAFT, shapes="none")
        for function in (shaft_pendulum.slip_angle, shaft_pendulum.events)
    ),
    Call(shaft_pendulum.properties, SHAFT, shapes="none"),
    Call(
        inverted_slider_crank.off_rod_intervals,
        {"x": [0.0, 1.0, 2.0], "slide_margin": [1.0, -1.0, 2.0]},
        shapes="none",
    ),
    Call(swinging_block.extremes, {"crank": 1.0, "pivot_x": 2.0}, shapes="none"),
    Call(fivebar.solve, {**TWO_MOTIONS, **FIVE, "force_x": 2.0, "force_y": -1.0}, rows=2),
    Call(fivebar.solve_inverse, {**TIP, **FIVE}, rows=2),
    Call(
        fivebar.jacobians,
        {
            "angle": [0.5, 0.9],
            "tip": [-0.5, 2.5],
            "left_crank": 2.0,
            "right_crank": 1.0,
            "left_x": 0.0,
            "right_x": 2.0,
        },
        rows=2,
    ),
    Call(fivebar.circle, {"time": 0.5, **PATH, **FIVE, **MODES_OF_CRANKS}, shapes="row"),
    Call(fivebar.rectangle, {"time": 0.5, **CORNERS, **FIVE, **MODES_OF_CRANKS}, shapes="row"),
    Call(
        fivebar.follow_path,
        {"motion": along_path("tip", TIP), **FIVE, **MODES_OF_CRANKS},
        shapes="none",
    ),
    Call(fivebar.properties, FIVE, shapes="none"),
    Call(fivebar.FivebarLengths, FIVE, shapes="none"),
    Call(
        threeprr.solve,
        {**SLIDERS, **ROBOT, "load_x": 1.0, "load_y": 2.0, "load_moment": 3.0},
        rows=3,
    ),
    Call(threeprr.solve_inverse, {**POSE, **ROBOT}, rows=3),
    Call(threeprr.poses, {"sliders": SLIDERS["sliders"], **ROBOT}, rows=3),
    Call(threeprr.circle, {"time": 2.0, **CIRCLE, **ROBOT}, shapes="row"),
    Call(threeprr.follow_path, {"motion": along_path("pose", POSE), **ROBOT}, shapes="none"),
    Call(threeprr.RobotLengths, ROBOT, shapes="none"),
    Call(
        threeprr.WorkspaceSlice,
        {"robot": threeprr.RobotLengths(**ROBOT), "psi": 0.5},
        shapes="none",
    ),
    Call(threeprr.angles_of_place, {"x": 1.5, "y": 0.2, "robot": threeprr.RobotLengths(**ROBOT)}),
    Call(threeprr.reach_of_place, {"y": 0.2, "robot": threeprr.RobotLengths(**ROBOT)}),
    Call(ball_row.solve, {"time": 1.0, "balls": 3, "radius": 0.1, "gap": 0.05, "speed": 2.0}),
    Call(
        ball_row.properties, {"balls": 3, "radius": 0.1, "gap": 0.05, "speed": 2.0}, shapes="none"
    ),
    Call(bouncing_ball.solve, {"time": 1.5, **DROP}),
    Call(bouncing_ball.rest_time, DROP, shapes="none"),
    Call(bouncing_ball.properties, DROP, shapes="none"),
    Call(rocking_block.solve, {"time": 0.5, **BLOCK}),
    Call(rocking_block.rate_ratio, {"width": 0.1, "height": 0.4}, shapes="none"),
    Call(rocking_block.time_to_impact, BLOCK, shapes="none"),
    Call(rocking_block.properties, BLOCK, shapes="none"),
    Call(rolling_ball.roll_time, BALL, shapes="none"),
    Call(rolling_ball.solve, {"time": 0.5, **BALL}),
    Call(rolling_ball.properties, BALL, shapes="none"),
    Call(sliding_block.solve, {"time": 0.5, **SLOPE}),
    Call(sliding_block.stop_time, SLOPE, shapes="none"),
    Call(sliding_block.properties, SLOPE, shapes="none"),
]
NO_NUMBERS = {
    "assembly_margins",
    "apply_play",
    "jacobi_functions",
    "aspects",
    "aspects_of_slice",
    "reach_area",
    "reach_area_of_place",
    "type_2",
    "type_2_of_slice",
    "unassembled_share",
    "volume",
}
"""Public functions of checked lengths: of a dataclass, or of a function that checked them."""
ITERATIONS = {"logs_of_start", "report_sweeps"}
"""Functions around Newton-Raphson, beside all whose names begin with ``newton_``."""
SPARSE = "poses", "reach_of_place", "dead_centres"
"""Functions with NaN where there is no such pose, as their docstrings say."""
by_call = pytest.mark.parametrize("call", CALLS, ids=lambda call: call.name)


def is_motion(call: Call, name: str) -> bool:
    """Whether an argument may be an array along a sweep."""
    found = inspect.signature(call.function).parameters.get(name)
    return found is not None and found.annotation == ArrayLike


def arrays_of(result: Any) -> list[np.ndarray]:
    """All arrays and numbers of a result."""
    if isinstance(result, dict):
        result = tuple(result.values())
    if isinstance(result, tuple):
        return [one for part in result for one in arrays_of(part)]
    found = np.asarray(result)
    return [found] if found.dtype.kind in "fcb" else []


def numbers_of(call: Call) -> dict[str, Any]:
    """The numeric arguments of a function, with zero for those that the call leaves out."""
    parameters = inspect.signature(call.function).parameters.values()
    left_out = {
        p.name: p.default
        for p in parameters
        if isinstance(p.default, float) and p.name not in call.arguments
    }
    given = {k: v for k, v in call.arguments.items() if isinstance(v, (int, float, list))}
    return given | left_out


def spoil(valid: Any, bad: float) -> Any:
    """A bad number in the place of a valid one, or of the last entry of a list."""
    return [*valid[:-1], bad] if isinstance(valid, list) else bad


def test_every_public_function_is_here_or_said_to_take_no_numbers() -> None:
    known = {call.function for call in CALLS}
    there = [one.module for (one,) in entry_points_of("proofmass.references").values()]
    modules = [m for m in there if ".linkages." in m or ".contacts." in m]
    missing = [
        f"{module}.{name}"
        for module in modules
        for name, function in vars(importlib.import_module(module)).items()
        if getattr(function, "__module__", "").startswith(module)
        and not name.startswith(("_", "newton_"))
        and not (isinstance(function, type) and issubclass(function, Reference))
        and function not in known
        and name not in NO_NUMBERS | ITERATIONS
        and getattr(function, "__annotations__", {}).get("return") is not Chart
    ]
    assert len(modules) >= 14
    assert missing == [], "add a call of each to CALLS"


@by_call
def test_a_number_that_is_not_finite_or_too_large_is_refused_by_its_name(call: Call) -> None:
    """An infinite rate or time, and lengths whose products are no floating-point numbers."""
    call.function(**call.arguments)
    for name, valid in numbers_of(call).items():
        for bad in (np.nan, np.inf, -np.inf, 10.0 * LARGEST, -10.0 * LARGEST):
            with pytest.raises(ValueError, match=rf"^{name} must "):
                call.function(**{**call.arguments, name: spoil(valid, bad)})


@by_call
def test_an_array_in_the_place_of_a_number_is_refused_by_its_name(call: Call) -> None:
    for name in numbers_of(call):
        if not is_motion(call, name):
            for bad in ([], [1.0, 2.0], np.ones((2, 2))):
                with pytest.raises(ValueError, match=f"^{name} must "):
                    call.function(**{**call.arguments, name: bad})


@pytest.mark.parametrize(
    "call", [one for one in CALLS if one.shapes != "none"], ids=lambda call: call.name
)
@settings(derandomize=True, max_examples=30, deadline=None)
@given(st.data())
def test_results_have_the_shape_of_the_motion_and_are_numbers(call: Call, data: Any) -> None:
    """A motion is a number, a list, or an array with any number of axes, also without entries."""
    shape = data.draw(
        st.integers(0, 3).map(lambda n: (n,))
        if call.shapes == "row"
        else hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3)
    )
    given_motion = [name for name in call.arguments if is_motion(call, name)]
    constant = data.draw(st.sets(st.sampled_from(given_motion[1:]))) if given_motion[1:] else set()
    as_list, as_int = data.draw(st.booleans()), data.draw(st.booleans())
    changed: dict[str, Any] = {}
    for name in given_motion:
        value = np.asarray(call.arguments[name], float)
        whole = value.reshape(value.shape + (1,) * len(shape)) * np.ones(shape)
        if as_int and (name == "rate" or not value.ndim):
            whole = np.rint(whole).astype(int)
        if name not in constant:
            changed[name] = whole.tolist() if as_list and whole.size else whole
    found = arrays_of(call.function(**{**call.arguments, **changed}))
    assert found
    for one in found:
        at_end = (
            one.shape[: len(shape)]
            if call.name.endswith(("jacobians", "reach_of_place"))
            else one.shape[one.ndim - len(shape) :]
        )
        assert at_end == shape
        if call.function.__name__ not in SPARSE:
            assert np.isfinite(one).all()


@by_call
def test_a_whole_number_and_an_array_without_axes_are_numbers(call: Call) -> None:
    for name, valid in call.arguments.items():
        if isinstance(valid, float):
            expected = call.function(**call.arguments)
            found = call.function(**{**call.arguments, name: np.array(valid)})
            if found is not expected and arrays_of(expected):
                for one, other in zip(arrays_of(found), arrays_of(expected), strict=True):
                    np.testing.assert_array_equal(one, other)
            if valid.is_integer():
                call.function(**{**call.arguments, name: int(valid)})


CLASSES = {
    found.function: found
    for found in map(find_reference, reference_names())
    if issubclass(found, ClosedForm)
}
LINKAGES = [
    call
    for call in CALLS
    if call.function in CLASSES and call.shapes == "any" and "acceleration" in call.arguments
]
LARGEST_POWER = 2
"""Largest power of length in the unit of a curve: that of a moment."""


def in_smaller_unit(call: Call, scale: float) -> dict[str, Any]:
    """The arguments of a linkage without loads, in a unit of length that is smaller by a factor."""
    kinds = CLASSES[call.function].parameters
    units = {key: one.unit for key, one in kinds.items() if one.is_quantity}
    if "angle" not in call.arguments:
        units |= dict.fromkeys(list(call.arguments)[:3], "m")
    lengths = {key: unit_powers(unit)[0] for key, unit in units.items()}
    return {
        key: np.multiply(value, scale ** lengths.get(key, 0.0))
        for key, value in {"gravity": 9.81, **call.arguments}.items()
        if (key in kinds or is_motion(call, key)) and not unit_powers(units.get(key, "1"))[1]
    }


@pytest.mark.parametrize("power", [-128, 128])
@pytest.mark.parametrize("call", LINKAGES, ids=lambda call: call.name)
def test_curves_of_a_linkage_change_by_a_power_of_its_size(call: Call, power: int) -> None:
    """Next to the largest and the smallest lengths products of lengths neither overflow nor vanish.

    Lengths that differ by a power of four have products and roots with the same digits, so that an
    angle or its rate stays the same, and a length or its rate changes as the size does.
    """
    scale = 2.0**power
    assert 1.0 / LARGEST < scale < LARGEST
    expected = call.function(**in_smaller_unit(call, 1.0))
    found = call.function(**in_smaller_unit(call, scale))
    changed = [name for name, curve in expected.items() if np.any(curve)]
    assert len(changed) >= 2
    for name in changed:
        assert any(
            np.array_equal(found[name], expected[name] * scale**k) for k in range(LARGEST_POWER + 1)
        ), (name, found[name], expected[name])
