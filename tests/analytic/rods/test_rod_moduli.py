"""Charts of moduli and loads of a clamped rod with a pinned tip, against integration along it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from proofmass.analytic.chart import Chart
from proofmass.analytic.rods import rod_pinned
from proofmass.case.case import Case
from proofmass.reference.charts import compute_chart
from proofmass.run.sidecar import load_case
from tests.shipped import shipped


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case(shipped("rod_pinned.toml"))


@pytest.fixture(scope="module")
def charts(case: Case) -> list[Chart]:
    return [compute_chart(case, table) for table in case.chart]


def tip_moment_and_inflections(psi: float, k: float, size: float) -> tuple[float, int]:
    """Moment [EI/L] at the tip and number of inflections before it, by integration.

    The equation is theta'' = R sin(theta - psi) from theta = 0, with the slope of the modulus k.
    """
    slope = np.sign(k) * 2.0 * np.sqrt(size * (k**2 - np.cos(psi / 2.0) ** 2))
    run = solve_ivp(
        lambda _, y: [y[1], size * np.sin(y[0] - psi)],
        (0.0, 1.0),
        [0.0, slope],
        "DOP853",
        rtol=1e-11,
        atol=1e-12,
        t_eval=np.append(np.linspace(0.0, 0.998, 2000), 1.0),
    )
    return float(run.y[1, -1]), int(np.sum(np.diff(np.sign(run.y[1, :-1])) != 0.0))


def test_rods_under_loads_of_the_chart_end_in_an_inflection(charts: list[Chart]) -> None:
    """Under loads of the charts a rod has no moment at its tip, and inflections of the mode."""
    rng, checked = np.random.default_rng(8), []
    for mode, panel in enumerate(charts[1].panels, 1):
        field = panel.field
        for _ in range(5):
            i = int(rng.integers(3, field.x.size - 3))
            j = int(rng.integers(6, field.y.size - 6))
            psi, k_rel, size = field.x[i], field.y[j], 10.0 ** field.values[i, j]
            if k_rel == 0.0 or size > 500.0:  # the tip of a long rod does not depend on its clamp
                continue
            least = abs(np.cos(psi / 2.0))
            k = np.sign(k_rel) * (least + (1.0 - least) * abs(k_rel))
            moment, before = tip_moment_and_inflections(psi, k, size)
            # rounding of the load, e^sqrt(R) times at the tip; a wrong load gives 0.1 or more
            assert abs(moment) < 1e-6 * np.sqrt(size), (mode, psi, k_rel)
            assert before == mode - 1
            assert abs(tip_moment_and_inflections(psi, k, 1.02 * size)[0]) > 1e-4
            checked.append(mode)
    assert set(checked) == set(range(1, len(charts[1].panels) + 1))  # at least one load per mode


def test_moduli_lie_between_their_bound_and_one(charts: list[Chart]) -> None:
    """Regions of the chart are bounded by |k| = |cos(psi/2)| and |k| = 1; lines are inside."""
    for sign, region in zip((1.0, -1.0), charts[0].panels[0].regions, strict=True):
        (outline,) = region.outlines
        edge = np.abs(np.abs(outline[:, 1]) - np.abs(np.cos(outline[:, 0] / 2.0)))
        assert np.all((edge < 1e-15) | (outline[:, 1] == sign))
        assert np.all(sign * outline[:, 1] >= 0.0)
    for line in charts[0].panels[0].lines:
        assert np.all(np.abs(line.y) > np.abs(np.cos(line.x / 2.0)))
        assert np.all(np.abs(line.y) < 1.0)


def test_all_rods_under_the_load_of_the_case_are_drawn(charts: list[Chart], case: Case) -> None:
    """The chart has the three rods under the direction and size of the case's load, and the case.

    By integration each of them has no moment at its tip; two have one half wave, one has two.
    """
    (panel,) = charts[2].panels
    every, this = panel.lines[-2:]
    assert every.x.size == 3
    assert np.abs(every.x - this.x).min() < 1e-9
    assert this.x[0] == pytest.approx(-0.3222579, abs=1e-7)  # rod A, by many shootings
    force = rod_pinned.pinned(
        0.8, 0.1, (-3.2, -1.2, -0.6), stiffness=case.parameters["stiffness"]
    ).unknowns
    size = np.hypot(*force[:2]) / case.parameters["stiffness"]
    assert this.y == pytest.approx([size], rel=1e-9)
    psi = np.arctan2(force[1], force[0]) % (2.0 * np.pi)
    least = abs(np.cos(psi / 2.0))
    counts = []
    for k_rel in every.x:
        k = np.sign(k_rel) * (least + (1.0 - least) * abs(k_rel))
        moment, before = tip_moment_and_inflections(psi, k, float(size))
        assert abs(moment) < 1e-5 * size  # as above
        counts.append(before + 1)
    assert sorted(counts) == [1, 1, 2]


def test_bad_parameters_are_refused() -> None:
    guess = {"pin_x": 0.8, "pin_y": 0.1, "force_x": -20.0, "force_y": -7.0, "moment": -3.7}
    with pytest.raises(ValueError, match=r"nodes must lie within \[5, 401\], got 4"):
        rod_pinned.loads(**guess, nodes=4)
    with pytest.raises(ValueError, match="length must reach beyond the pin"):
        rod_pinned.moduli(**guess | {"pin_x": 1.8})
