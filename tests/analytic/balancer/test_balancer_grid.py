"""The thesis's own search over a grid, against the 112 results that it printed.

data/balancer.json has source and line of every number. The search has no free choices; our numbers
differ from the print because of the fourth decimal of the printed parameters: half a unit of it
moves the minimum to another point of the grid.
"""

from functools import cache

import numpy as np
import pytest

from proofmass.analytic.balancer.measures import precision_points, rmse, target, work_reduction
from tests.analytic.balancer.balancer_table import DATA, parameters, rows
from tests.independent.balancer import grid, grid4

THREE_SEGMENTS, FOUR_SEGMENTS = rows(3), rows(4)
OTHER_DESIGNS = {row["name"]: row for row in DATA["others"]}
DESIGNS = THREE_SEGMENTS | FOUR_SEGMENTS | OTHER_DESIGNS
OFF_PATH_LINE = (
    "1847"  # its least energy at 1 deg is far from the printed path; it has its own test
)
LARGER_TOLERANCES = {
    "2107": 8e-4,  # its grid has moments in steps of 9e-3, twice the printed rmse of 4e-3
    "2117": 8e-4,
}  # arm stretched from 60 deg on: rounding decides
NOT_AS_PRINTED = [
    "1744",
    "1747",
    "1793",
    "1800",
    "1825",
    "1915",
    "1918",
    "2007",
    "2010",
    "2085",
    "2095",
    "2134",
    "2159",
]  # four segments, steps of 0.02 rad: rounding selects other points
STAGE_LETTERS = {"locked": "L", "joint 3 free": "3", "joint 2 free": "2", "both free": "B"}
WARNINGS_OF_NO_PATH = {
    "unstable at rest",
    "pinned at the stretched arm",
    "jump",
    "least energy is not the path from rest",
}


@cache
def search_design(line, **changes):
    """Result of the search as in the thesis, and its rmse and work reduction."""
    row = DESIGNS[line]
    search, count = (grid, 90) if row["segments"] == 3 else (grid4, 15)
    angles = precision_points(count)
    found = search.minimise(angles, **{**parameters(row), **changes})
    return found, *rmse_and_reduction(row, angles, found["balancing_moment"])


def rmse_and_reduction(row, angles, moment):
    wanted = target(row["target"], angles)
    return float(rmse(moment, wanted)), float(work_reduction(moment, wanted, angles))


def differences_from_print(line, **changes):
    """Absolute differences from the printed rmse and work reduction."""
    (_, error, reduction), printed = search_design(line, **changes), DESIGNS[line]["printed"]
    return abs(error - printed["rmse"]), abs(reduction - printed["work_reduction"])


@pytest.mark.parametrize("line", [line for line in THREE_SEGMENTS if line != OFF_PATH_LINE])
def test_printed_results_of_three_segments_are_met(line):
    error, reduction = differences_from_print(line)
    assert error <= LARGER_TOLERANCES.get(line, 4e-4)
    assert reduction <= 0.1  # percentage points: an rmse of 4e-4 over a mean target of 0.4 to 0.6


def test_most_results_of_three_segments_are_met_to_their_last_digit():
    errors = [differences_from_print(line)[0] for line in THREE_SEGMENTS if line != OFF_PATH_LINE]
    assert np.median(errors) <= 5e-5  # half a unit of the fourth decimal


def test_least_energy_of_line_1847_is_not_on_the_path_from_rest():
    """At 1 deg the stretched arm with quadratic springs wound backwards has negative energy."""
    row, angles = THREE_SEGMENTS[OFF_PATH_LINE], precision_points(90)
    found, error, _ = search_design(OFF_PATH_LINE)
    assert found["energy"][0] < 0.0 < found["energy"][1]
    assert found["theta3"][0] - found["theta2"][0] < 1e-6  # stretched: last point of the range
    assert error > 2.0 * row["printed"]["rmse"]
    remaining_rmse, _ = rmse_and_reduction(row, angles[1:], found["balancing_moment"][1:])
    assert remaining_rmse == pytest.approx(row["printed"]["rmse"], abs=4e-4)  # as for all others


@pytest.mark.parametrize("line", [line for line in FOUR_SEGMENTS if line not in NOT_AS_PRINTED])
def test_printed_results_of_four_segments_are_met(line):
    error, reduction = differences_from_print(line)
    assert error <= 1.5e-4  # one and a half units of the fourth decimal
    assert reduction <= 0.03  # percentage points, as above


@pytest.mark.parametrize("line", NOT_AS_PRINTED)
def test_other_results_of_four_segments_are_as_another_program_found_them(line):
    """They differ from the print, and agree with independent recomputations to the kept digits."""
    _, error, reduction = search_design(line)
    printed, again = (
        FOUR_SEGMENTS[line]["printed"],
        FOUR_SEGMENTS[line].get("recomputed", {}).get("grid"),
    )
    assert abs(error - printed["rmse"]) > 1.5e-4
    assert error == pytest.approx(printed["rmse"], abs=5e-3)  # half a step times k1, as below
    if again:
        assert error == pytest.approx(again["rmse"], abs=1.1e-4)  # four decimals
        assert reduction == pytest.approx(again["work_reduction"], abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [
        "1935",
        "2018",
        "2020",
        "2069",
        "2107",
        "2117",
        "2132",
        "2165",
        "2178",
        "2180",
        "1747",
        "2007",
        "2159",
    ],
)
def test_prints_lie_within_the_rounding_of_the_printed_parameters(line):
    """Some parameters that round to the printed parameters give the printed result."""
    row, random = DATA["rows"][line], np.random.default_rng(1)
    names = [
        name
        for name in parameters(row)
        if name[:-1] in ("length", "stiffness", "quadratic", "preload")
        or name in ("rest_angle", "high2")
    ]

    def meets_the_print():
        shift = {name: row["parameters"][name] + random.uniform(-5e-5, 5e-5) for name in names}
        if "quadratic1" in shift:  # one spring for all joints
            shift |= {n: shift[n[:-1] + "1"] for n in shift if n[:-1] in ("stiffness", "quadratic")}
        error, reduction = differences_from_print(line, **shift)
        return error <= 1.5e-4 and reduction <= 0.05  # bounds of other designs without a shift

    assert any(meets_the_print() for _ in range(400))


@pytest.mark.parametrize("line", ["1743", "1766", "1814", "1860", "2041"])
def test_swapped_lengths_and_the_other_elbow_differ(line):
    p = parameters(THREE_SEGMENTS[line])
    for change in ({"length2": p["length3"], "length3": p["length2"]}, {"mode": -1}):
        assert differences_from_print(line, **change)[0] > 4e-4  # the tolerance of the print


@pytest.mark.parametrize("line", ["1743", "2107", "2178"])
def test_moments_are_multiples_of_the_grid_step(line):
    """In steps of the grid every moment less the share of the angle is a whole number."""
    row, angles = THREE_SEGMENTS[line], precision_points(90)
    p = parameters(row)
    r, l1, rest = p["pendulum"], p["length1"], p["length2"] + p["length3"]
    # the range as in lines 2588-2612, not as in the module
    at_tip = np.arccos((r**2 + rest**2 - l1**2) / (2 * r * rest))
    at_node = np.arccos((l1**2 + rest**2 - r**2) / (2 * l1 * rest))
    step = 2.0 * (np.pi - at_tip - at_node) / 1000
    moment = search_design(line)[0]["balancing_moment"]
    steps = (moment / p["stiffness1"] - angles + p.get("rest_angle", 0.0)) / step
    np.testing.assert_allclose(
        steps, np.rint(steps), atol=1e-9, rtol=0
    )  # rounding times 1000 steps
    errors = [
        rmse_and_reduction(row, angles, grid.minimise(angles, points=n, **p)["balancing_moment"])[0]
        for n in (250, 16000)
    ]
    path = row["recomputed"]["path"]["rmse"]
    assert abs(errors[1] - path) < 0.1 * abs(errors[0] - path)  # noise of the grid, 64 times finer


@pytest.mark.parametrize(
    "line",
    [
        line
        for line, row in THREE_SEGMENTS.items()
        if "moments" in row.get("recomputed", {})
        and not WARNINGS_OF_NO_PATH & set(row.get("warnings", []))
    ],
)
def test_moments_are_within_one_grid_step_of_the_path(line):
    row, p = THREE_SEGMENTS[line], parameters(THREE_SEGMENTS[line])
    found = grid.minimise(np.radians(np.arange(10.0, 91.0, 10.0)), points=10000, **p)
    slope = p["stiffness1"] + 2.0 * p.get("quadratic1", 0.0) * found["deflection1"]
    step = 2.0 * np.pi / 10000  # of segment 1, all round at most
    error = found["balancing_moment"] - row["recomputed"]["moments"]
    # moments are kept to 1e-8; the square of the step is the spring's curvature, below 2 N m/rad^2
    assert np.all(abs(error) <= abs(slope) * step + 2.0 * step**2 + 1e-8)


@pytest.mark.parametrize("line", ["1745", "1768", "2041", "1839", "2167"])
def test_preload_holds_the_rest_posture_until_its_load_exceeds_it(line):
    row, (found, *_) = THREE_SEGMENTS[line], search_design(line)
    p, angles = parameters(row), precision_points(90)
    release = row["recomputed"].get("release_deg", 180.0)
    locked = np.degrees(angles) < release
    alone = p["stiffness1"] * angles + p.get("quadratic1", 0.0) * angles**2
    np.testing.assert_allclose(
        found["balancing_moment"][locked], alone[locked], atol=2e-15, rtol=0
    )  # eps
    assert not found["deflection2"][locked].any()
    assert locked.all() == ("never released" in row.get("warnings", []))
    assert locked.all() or found["deflection2"][~locked].max() > 0.1


@pytest.mark.parametrize(
    "line", [line for line, row in THREE_SEGMENTS.items() if "high2" in row["parameters"]]
)
def test_contact_keeps_joint_two_below_its_stop(line):
    row, (found, *_) = THREE_SEGMENTS[line], search_design(line)
    top, stop = found["deflection2"].max(), row["parameters"]["high2"]
    assert top <= stop
    # a stop is touched if the next point, 2 pi/1000 of segment 1 or 0.03 of joint 2, is beyond it
    assert (top < stop - 0.03) == ("stop never touched" in row.get("warnings", []))


@pytest.mark.parametrize("line", [*OTHER_DESIGNS, "1747", "1818"])
def test_stages_of_four_segments_are_those_recomputed(line):
    found, error, reduction = search_design(line)
    again = DESIGNS[line]["recomputed"]
    assert error == pytest.approx(again["grid"]["rmse"], abs=1.1e-4)  # four decimals
    assert reduction == pytest.approx(again["grid"]["work_reduction"], abs=0.011)  # two decimals
    if "stages" in again:
        assert "".join(STAGE_LETTERS[stage] for stage in found["stage"]) == again["stages"]


def test_a_finer_grid_of_line_1790_gives_the_rmse_of_the_path():
    row, angles = FOUR_SEGMENTS["1790"], precision_points(15)
    fine = grid4.minimise(angles, points=300, **parameters(row))
    error, _ = rmse_and_reduction(row, angles, fine["balancing_moment"])
    assert row["printed"]["rmse"] == 0.04
    # the path has 0.0466; tolerance: half a step of 0.021 rad times k1, over the root of 15 points
    assert error == pytest.approx(row["recomputed"]["path"]["rmse"], abs=3.5e-3)


def test_postures_close_and_energies_are_sums():
    for line, ends in (("1776", 3), ("1757", 4)):
        p, (found, *_) = parameters(DESIGNS[line]), search_design(line)
        angles = precision_points(90 if ends == 3 else 15)
        tip = sum(p[f"length{i}"] * np.exp(1j * found[f"theta{i}"]) for i in range(1, ends + 1))
        np.testing.assert_allclose(tip, np.exp(1j * angles), atol=1e-14)  # rounding
        assert np.all(found[f"theta{ends}"] > found[f"theta{ends - 1}"])  # elbow up
    e = np.array([found[f"deflection{i}"] for i in (1, 2, 3, 4)])
    wound = [0.0, *(_preload_winding(p, p[f"preload{i}"]) for i in (2, 3)), 0.0]
    e = e + np.array(wound)[:, None]
    energy = (p["stiffness1"] * e**2 / 2 + p["quadratic1"] * e**3 / 3).sum(axis=0)
    np.testing.assert_allclose(found["energy"], energy, atol=1e-14, rtol=0)  # rounding


def _preload_winding(p, preload):
    """Winding of a preloaded spring, the first root of A x^2 + B x = M0."""
    roots = np.roots([p["quadratic1"], p["stiffness1"], -preload])
    return min(root for root in roots if root >= 0.0)


def test_summary_tables_repeat_the_work_reductions_of_the_figures():
    cells = {
        (row["segments"], row["option"], row["target"], row["variant"]): row["printed"][
            "work_reduction"
        ]
        for row in rows().values()
    }
    table = {
        (block["segments"], block["option"], wanted, variant): cell
        for block in DATA["tables"]["blocks"]
        for wanted, line in block["work_reductions"].items()
        for variant, cell in zip(DATA["tables"]["columns"], line, strict=True)
        if cell is not None
    }
    assert table == cells
    assert len(cells) == 112


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight": 1.0}, "listing N.3 has no weight"),
        ({"low2": -0.1}, "low must be 0"),
        ({"length1": 1.05, "length2": 0.2, "length3": 0.2}, "length1 must be below pendulum"),
        ({"points": 1}, "points must be"),
    ],
)
def test_parameters_unknown_to_the_listing_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        grid.minimise([0.1, 0.2], **{**parameters(THREE_SEGMENTS["1743"]), **change})


def test_bad_angles_and_half_a_preload_are_refused():
    with pytest.raises(ValueError, match="angles must be one row that rises"):
        grid.minimise([0.2, 0.1], **parameters(THREE_SEGMENTS["1743"]))
    with pytest.raises(ValueError, match="low2 and low3 belong together"):
        grid4.minimise([0.1], **{**parameters(FOUR_SEGMENTS["1744"]), "low2": 0.0})
