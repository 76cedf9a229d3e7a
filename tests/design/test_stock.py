"""Designs whose springs are in a stock: exact cases, brute force, limits of clock springs."""

import json
from itertools import product

import numpy as np
import pytest
from scipy.optimize import least_squares
from typer.testing import CliRunner

from proofmass.analytic.balancer import solve
from proofmass.analytic.balancer.measures import precision_points
from proofmass.analytic.balancer.synthesis import Synthesis, Variant
from proofmass.commands import design as command
from proofmass.commands.cli import design as app
from proofmass.design import stock as stocks
from proofmass.design.search import Effort
from proofmass.design.springs import (
    CATALOGUE,
    STRIP_HEADER,
    SpringStrip,
    fit_catalogue,
    make_clock_spring,
)
from proofmass.design.stock import (
    StockProblem,
    catalogue_options,
    list_combinations,
    predict_errors,
    search_stock,
    strip_options,
)

FREE_SINE = Synthesis(Variant("sine", free_angle=True), np.sin)
# line 1766 of van Nes 2022: stiffnesses, lengths, rest angle
PRINTED = np.array([1.2701, 0.8473, 4.1078, 0.3394, 0.4573, 0.4752, 0.6641])


@pytest.fixture
def small(monkeypatch):
    """Rounds of few combinations and steps."""
    monkeypatch.setattr(stocks, "STOCK_CANDIDATES", 40)
    monkeypatch.setattr(stocks, "STOCK_HEATS", ((40, 4), (10, 6), (3, 10)))
    monkeypatch.setattr(stocks, "STOCK_ROUNDS", 1)


@pytest.mark.parametrize("moment", [0.05, 0.1, 0.2])
def test_one_spring_is_the_nearest_of_the_stock(moment, small):
    """Two segments turn as one body, M = k a: the best option is that of linear least squares."""
    task = Synthesis(Variant("sine", 2), np.sin)
    options = catalogue_options(CATALOGUE)
    found = search_stock(task, np.array([[0.7]]), options, moment)
    angle = precision_points(stocks.STOCK_POINTS)
    errors = [np.linalg.norm(o.low / moment * angle - np.sin(angle)) for o in options]
    assert found.springs == (options[int(np.argmin(errors))].names,)
    assert found.stiffness[0] == pytest.approx(found.vector[0] * moment)


def test_the_stock_is_a_constraint_and_no_rounding(small):
    """From the thesis's design; rounding its stiffnesses leaves it worse than it was."""
    found = search_stock(FREE_SINE, PRINTED[None], catalogue_options(CATALOGUE))
    error = FREE_SINE.figures(found.vector[None]).rmse[0]
    rounded = fit_catalogue(FREE_SINE, PRINTED[None], CATALOGUE)["rmse"]
    assert error < 0.3 * rounded
    for k, names, share in zip(found.stiffness, found.springs, found.vector[:3], strict=True):
        assert k == pytest.approx(sum(CATALOGUE[name] for name in names), abs=1e-15)
        assert share == pytest.approx(k / found.moment)


def test_the_prediction_is_that_of_linear_least_squares():
    """Each combination alone, by numpy's least squares in s and all other parameters."""
    problem = StockProblem(FREE_SINE, catalogue_options({"a": 0.05, "b": 0.12}), None)
    chosen, errors, scale = predict_errors(problem, PRINTED)
    terms, by_spring, by_other = stocks.split_slopes(problem, PRINTED)
    for k in range(0, len(chosen), 17):
        stiffness = problem.soft[chosen[k]]
        columns = np.column_stack([by_spring.T @ stiffness, by_other.T])
        aim = by_spring.T @ PRINTED[:3] - terms
        x, *_ = np.linalg.lstsq(columns, aim, rcond=None)
        assert errors[k] == pytest.approx(np.linalg.norm(columns @ x - aim), rel=1e-6, abs=1e-9)
        assert 1.0 / scale[k] == pytest.approx(x[0], rel=1e-6)
    assert len(chosen) > 100


def test_a_large_stock_is_ranked_near_the_design():
    rng = np.random.default_rng(1)
    catalogue = {f"s{k}": float(v) for k, v in enumerate(rng.uniform(0.01, 0.2, 60))}
    problem = StockProblem(FREE_SINE, catalogue_options(catalogue), 0.1)
    chosen = list_combinations(problem, PRINTED[:3])
    assert len(chosen) <= stocks.MAX_RANKED
    wanted = 0.1 * PRINTED[:3]
    nearest = [int(np.abs(problem.soft - k).argmin()) for k in wanted]
    assert any((row == nearest).all() for row in chosen)


def test_clock_springs_can_be_made(small):
    """Lengths and stresses by the maker's own formulas, for the largest moments of the path."""
    strips = [
        SpringStrip("thin", 6e-3, 0.6e-3, 0.2, 1.5, 206e9, 1.2e9),
        SpringStrip("thick", 20e-3, 2e-3, 0.3, 4.0, 206e9, 1.2e9),
    ]
    found = search_stock(FREE_SINE, PRINTED[None], strip_options(strips), 5.0)
    parameters = FREE_SINE.variant.parameters(found.vector[None])
    angle = precision_points(90)
    curves = solve(angle, **{name: float(v[0]) for name, v in parameters.items()})
    by_name = {strip.name: strip for strip in strips}
    for i, names in enumerate(found.springs, 1):
        if not names:
            assert found.stiffness[i - 1] == 0.0
            continue
        largest = 5.0 * np.abs(curves[f"moment{i}"]).max()
        made = make_clock_spring(found.stiffness[i - 1], largest, by_name[names[0]], len(names))
        # 30 angles of the search, 90 here
        assert made.stress < 1.001 * made.strip.stress
        assert made.strip.shortest * (1 - 1e-9) <= made.length <= made.strip.longest * (1 + 1e-9)


def test_a_stock_that_nothing_can_be_built_from():
    """Strips that break at any moment leave no combination."""
    strips = [SpringStrip("glass", 6e-3, 0.6e-3, 0.2, 1.5, 206e9, 1.0)]
    options = strip_options(strips)[1:]
    assert search_stock(FREE_SINE, PRINTED[None], options, 1.0) is None


def test_derivatives_by_the_rows_are_differences():
    problem = StockProblem(
        FREE_SINE, strip_options([SpringStrip("s", 0.02, 2e-3, 0.1, 4.0, 2e11, 1e12)]), 5.0
    )
    row = problem.rows(np.array([[1, 1, 1]]), np.array([5.0]), PRINTED[None])
    row = np.clip(row, 0.01, 0.99)
    terms, slopes = problem.linearize(row, coarse=False)
    step = 1e-6
    for j in range(problem.n, row.shape[1]):
        unit = step * np.eye(row.shape[1])[j]
        rise = problem.residuals(row + unit) - problem.residuals(row - unit)
        assert slopes[0, j] == pytest.approx(rise[0] / (2 * step), abs=1e-6)
    assert np.abs(slopes[0, 3:6]).max() > 1e-3
    assert not slopes[0, :3].any()
    assert terms == pytest.approx(problem.residuals(row), abs=1e-12)


@pytest.mark.slow
def test_no_combination_is_better_by_brute_force():
    """All 27 combinations of none, one or two equal springs, by scipy from the same designs."""
    options = catalogue_options({"a": 0.05})
    task = Synthesis(FREE_SINE.variant, np.sin, points=stocks.STOCK_POINTS)
    found = search_stock(task, PRINTED[None], options)
    ours = task.figures(found.vector[None]).rmse[0]
    low, high = task.low[3:], task.high[3:]

    def terms(x, stiffness):
        vectors = np.column_stack([stiffness * np.exp(x[:, :1]), x[:, 1:]])
        values = task.residuals(vectors)
        return np.where(np.isfinite(values), values, 1.0)

    def slopes(x, stiffness):
        step = np.where(x > 0.4, -1e-6, 1e-6)
        found = terms(np.vstack([x, x + np.diag(step)]), stiffness)
        return ((found[1:] - found[0]) / step[:, None]).T

    best = np.inf
    for chosen in product(options, repeat=3):
        stiffness = np.array([option.low for option in chosen])
        if not stiffness.any():
            continue
        scale = np.log(PRINTED[:3] @ stiffness / (stiffness @ stiffness))
        ended = least_squares(
            lambda x, k=stiffness: terms(x[None], k)[0],
            np.append(scale, PRINTED[3:]),
            jac=lambda x, k=stiffness: slopes(x, k),
            bounds=[np.append(-9.0, low), np.append(9.0, high)],
            x_scale="jac",
            max_nfev=30,
        )
        best = min(best, float(np.linalg.norm(ended.fun)))
    assert ours <= 1.01 * best


def run_design(*args):
    return CliRunner().invoke(app, ["balancer", *map(str, args)])


@pytest.fixture
def quick(monkeypatch, small):
    monkeypatch.setattr(command, "scale_effort", lambda _, seed: Effort(((8, 2), (4, 4)), seed))
    monkeypatch.setattr(command, "check_design", lambda *_: 0)


def write_catalogue(folder):
    file = folder / "springs.csv"
    rows = [f"{name},{k}" for name, k in CATALOGUE.items()]
    file.write_text("\n".join(["spring,stiffness [N m/rad]", *rows, ""]))
    return file


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("moment", [None, 0.1])
def test_the_command_designs_with_springs_of_the_stock(tmp_path, moment):
    given = ("--moment", moment) if moment else ()
    file, output = write_catalogue(tmp_path), tmp_path / "out"
    answer = run_design("--free-angle", "--catalogue", file, *given, "--samples", 0, "-o", output)
    assert answer.exit_code == 0, answer.output
    record = json.loads((output / "design.json").read_text())
    chosen = record["selection"]
    assert record["rmse"] == chosen["rmse"]
    assert moment is None or chosen["moment"] == pytest.approx(moment)
    for i, names in enumerate(chosen["springs"], 1):
        k = sum(CATALOGUE[name] for name in names)
        assert record["parameters"][f"stiffness{i}"] == pytest.approx(k / chosen["moment"])
    angle = precision_points(90)
    made = solve(angle, **record["parameters"])["balancing_moment"]
    assert record["rmse"] == pytest.approx(np.sqrt(np.mean((made - np.sin(angle)) ** 2)), abs=1e-12)
    assert "without regard to the stock" in answer.output
    again = run_design("--free-angle", "--catalogue", file, *given, "--samples", 0, "-o", output)
    assert again.output == answer.output  # from the saved states


@pytest.mark.usefixtures("quick")
def test_strips_of_which_nothing_can_be_built_are_exit_code_1(tmp_path):
    strips = tmp_path / "strips.csv"
    strips.write_text(",".join(STRIP_HEADER) + "\nfoil,1,0.01,300,301,206,1\n")
    answer = run_design("--free-angle", "--strips", strips, "--samples", 0, "-o", tmp_path / "out")
    assert answer.exit_code == 1, answer.output
    assert "no combination of springs of the stock can be built and balances" in answer.output
    assert "joint 1: no clock spring for" in answer.output


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--springs", "nonlinear"), "--catalogue: its springs are linear"),
        (("--strips", "strips.csv"), "--catalogue, --strips: give one stock"),
    ],
)
def test_a_stock_that_does_not_fit_is_refused(tmp_path, options, words, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "strips.csv").write_text(
        ",".join(STRIP_HEADER) + "\nthick,20,2,300,4000,206,1400\n"
    )
    answer = run_design("--catalogue", write_catalogue(tmp_path), *options, "-o", "out")
    assert answer.exit_code == 2
    assert words in answer.output
