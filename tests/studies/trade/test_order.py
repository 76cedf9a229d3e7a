"""Measured orders of convergence of pymunk: second order in its time step on every mechanism."""

from dataclasses import replace

import numpy as np
import pytest

from proofmass.reference.case_model import compiled_model
from proofmass.run.sidecar import load_case
from proofmass.sim.contents import may_touch
from proofmass.sim.pymunk.theory import is_damped
from proofmass.studies.measure import StudyRun, call_engine
from proofmass.studies.record import Setting
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.orders import expected_orders
from proofmass.studies.trade.series import convergence_order
from proofmass.studies.trade.varied import list_series
from tests.shipped import shipped, shipped_case, shipped_files

# A second-order error e = a h^2 shows order 2 when the step is halved; higher terms and a
# first-order remainder of a tenth reduce the order by at most 0.2.
LEAST_ORDER = 1.8
# Error, as a share of the range, below which accelerations stop improving: the rounding of
# positions over the step squared, 1e-15 m / (0.25 ms)^2 = 2e-8 m/s^2, times the condition number of
# the loop.  More iterations do not lower it.  With the steps of the models all errors are above it.
ROUNDING_ERROR = 2e-7
# After 3000 iterations a step that ends near the folded pose leaves a constraint violation.  Rates
# do not show it, but differences of rates do: accelerations have order 1.5 from 12 to 2 ms, and no
# order below.
SINGULAR_CASE_AND_KIND = "change_point", "acceleration"
# Passes flat poses, in which its loops resist a shear of the parallelograms in second order only:
# the impulses of a step near them move the rates by an amount that depends on where the step ends.
FLAT_CASE = "parallelogram_chain"
# At rest in the corners of the rectangle the third derivative of the motors' angles jumps.  With
# the number of iterations that is chosen without a setting, accelerations and forces have an error
# of first order there; with 1000 it is gone, and 4000 give the same errors.
ENOUGH_ITERATIONS = {"fivebar_rectangle": 1000}
CASES = {
    case.name: case
    for case in map(shipped_case, shipped_files())
    if "dynamics" in case.run
    and "pymunk" in case.run["dynamics"].solvers
    and not case.reference.endswith(".csv")
    and not any(str(c.equals).startswith("drive.") for c in case.channels.values())
    and not may_touch(compiled_model(case))
    and not is_damped(compiled_model(case))
    and not case.rod  # the length of its links decides on the error
    and case.name != FLAT_CASE
    and not compiled_model(case).jnt_limited.any()  # Chipmunk's joint limits do not rebound
}  # cases that are left out have an error of their own, or a drive as a channel, whose acceleration
# is of first order where the profile bends


def errors_at_two_steps(case, folder, change=lambda setting: setting):
    """Steps and errors, by kind, of two successive settings of the series without bias.

    The first step is less than twice that of the model; `change` modifies both settings.
    """
    series = next(
        series for series in list_series(case, "dynamics") if series.name == "pymunk, no bias"
    )
    own = compiled_model(case).opt.timestep
    k = next((k for k, size in enumerate(series.sizes) if size < 2 * own), -2)
    pair = [change(setting) for setting in series.settings[k:][:2]]
    rows = Study(Store(folder), longest=600.0).run(
        [StudyRun(case, "dynamics", setting) for setting in pair], repeats=0
    )
    assert all(row.errors for row in rows), [row.message for row in rows]
    return {
        kind: [
            (s.parameters["timestep"], row.errors[kind]) for s, row in zip(pair, rows, strict=True)
        ]
        for kind in rows[0].errors
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_pymunk_is_second_order(name, tmp_path):
    def with_enough_iterations(setting):
        enough = {"iterations": ENOUGH_ITERATIONS[name]} if name in ENOUGH_ITERATIONS else {}
        return replace(setting, parameters={**setting.parameters, **enough})

    for kind, points in errors_at_two_steps(CASES[name], tmp_path, with_enough_iterations).items():
        if (name, kind) == SINGULAR_CASE_AND_KIND:
            continue
        seen = convergence_order(*points)
        assert seen >= LEAST_ORDER or points[0][1] <= ROUNDING_ERROR, (
            f"{kind}: order {seen:.2f}, errors {points}"
        )


def test_pymunk_with_its_default_bias_is_not_second_order(tmp_path):
    def biased(setting):
        return replace(setting, parameters={**setting.parameters, "error_bias": 0.9**60})

    found = errors_at_two_steps(CASES["slider_crank"], tmp_path, biased)
    assert convergence_order(*found["position"]) < LEAST_ORDER


def test_bias_damps_a_free_motion_by_the_square_of_its_time_constant():
    """Energy oscillates with the constraint violation, h T, and falls by h T^2 t.

    h is the time step and T the time constant of the bias: the violation is late by T.
    """
    case = load_case(shipped("pendulum.toml"))

    def fall_and_swing(h, lag):
        setting = Setting("pymunk", {"timestep": h, "error_bias": np.exp(-1 / lag)})
        model, dynamics = setting.apply_to(case, "dynamics")
        curves = call_engine("pymunk", model.model_path, dynamics)
        energy = curves.channels["kinetic"] + curves.channels["potential"]
        fall = -np.polyfit(curves.x, energy, 1)[0]
        return np.array([fall, np.ptp(energy + fall * curves.x)])

    coarse, quick, fine = (fall_and_swing(*of) for of in ((1e-3, 0.02), (1e-3, 0.01), (5e-4, 0.02)))
    assert all(coarse > 0)
    np.testing.assert_allclose(np.log2(coarse / quick), [2, 1], atol=0.1)  # T / (2 s) off
    np.testing.assert_allclose(np.log2(coarse / fine), [1, 1], atol=0.1)


def test_second_order_of_the_bias_is_expected_of_free_motions_only():
    for name, orders in (
        ("pendulum", (1.0, 2.0)),
        ("fourbar_released", (1.0, 2.0)),
        ("fourbar", (1.0,)),
    ):
        case = load_case(shipped(f"{name}.toml"))
        series = next(one for one in list_series(case, "dynamics") if one.varied == "error_bias")
        assert expected_orders(case, "dynamics", series, "position") == orders
        assert expected_orders(case, "dynamics", series, "acceleration") == (*orders, 0.0)


@pytest.mark.parametrize(
    ("name", "series_name", "orders"),
    [
        ("arm_servos", "pymunk, no bias", (2.0,)),
        ("arm_servos", "pymunk, defaults", (1.0, 2.0)),
        ("pendulum", "pymunk, no bias", (2.0,)),
    ],
)
def test_forces_that_depend_on_rates_are_of_first_order_in_chipmunk(name, series_name, orders):
    """Chipmunk's dampers and servos with a gain on the rate are; the midpoint rule is not."""
    case = load_case(shipped(f"{name}.toml"))
    series = next(one for one in list_series(case, "dynamics") if one.name == series_name)
    assert expected_orders(case, "dynamics", series, "position") == orders
