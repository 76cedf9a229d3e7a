"""The page of a stress study: the nearest boundaries, and positions of boundaries on axes."""

from dataclasses import replace
from pathlib import Path

import pytest

from proofmass.base.errors import InputError
from proofmass.report.svg_markers import MARKER_PATHS, page_tones
from proofmass.studies.stress.boundary import (
    Boundary,
    BoundaryKind,
    read_boundaries,
    write_boundaries,
)
from proofmass.studies.stress.page import (
    boundary_strip,
    by_parameter,
    largest_factor,
    nearest_boundaries,
    ratio_strip,
)

INACCURATE_STEP = Boundary(
    "fourbar",
    "mujoco",
    "Euler",
    "time step",
    "s",
    1e-3,
    1.0,
    0.1,
    0.101,
    limit=BoundaryKind.INACCURATE,
    failure="position off by 0.1",
    silent=True,
)
RK4 = replace(INACCURATE_STEP, setting="RK4", holds=0.2, breaks=0.202, silent=False)
WITHOUT_LIMIT = replace(
    INACCURATE_STEP, engine="pymunk", setting="as it is", holds=1.0, breaks=float("nan"),
    limit=BoundaryKind.HOLDS, failure="", silent=False,
)  # fmt: skip
TONE = page_tones(["#0072B2"])["#0072B2"]


def test_the_nearest_boundary_of_all_settings_is_shown() -> None:
    gravity = replace(WITHOUT_LIMIT, engine="mujoco", parameter="gravity", unit="times")
    rows = list(nearest_boundaries([RK4, INACCURATE_STEP, WITHOUT_LIMIT, gravity]))
    assert [row["parameter"] for row in rows] == ["time step", "gravity"]
    assert rows[0]["cells"] == [
        {"value": "0.1005 s", "more": "Euler: inaccurate, in silence"},
        {"value": "none to 1 s", "more": ""},
    ]
    assert rows[1]["cells"][1] == {"value": "—", "more": ""}  # pymunk was not run


def test_a_setting_that_fails_at_the_start_is_the_nearest_boundary() -> None:
    nan = float("nan")
    never = replace(RK4, holds=nan, breaks=nan, limit=BoundaryKind.UNSTABLE)
    (row,) = nearest_boundaries([INACCURATE_STEP, never])
    assert row["cells"] == [{"value": "nowhere", "more": "RK4: unstable"}]
    (row,) = nearest_boundaries([INACCURATE_STEP, replace(never, limit=BoundaryKind.OURS)])
    assert row["cells"][0]["more"] == "Euler: inaccurate, in silence"


def test_boundaries_are_grouped_by_parameter() -> None:
    other = replace(INACCURATE_STEP, parameter="gravity")
    assert by_parameter([INACCURATE_STEP, other, WITHOUT_LIMIT]) == [
        INACCURATE_STEP,
        WITHOUT_LIMIT,
        other,
    ]


def test_a_strip_shows_the_limit_and_the_theory() -> None:
    known = replace(INACCURATE_STEP, theory=1e-2, law="a law")
    strip = boundary_strip(known, TONE, 1000.0)
    assert strip.dot == pytest.approx(100 * 2.002 / 3, abs=0.05)  # log10(100.5) of 3 decades
    assert strip.tick == pytest.approx(100 / 3, abs=0.01)
    assert (strip.bar, strip.hollow, strip.mark) == ((0.0, strip.dot), True, MARKER_PATHS["o"])
    assert "theory 0.01" in strip.said
    downwards = replace(INACCURATE_STEP, reach=1e-6, holds=1e-5, breaks=0.99e-5)
    assert boundary_strip(downwards, TONE, 1000.0).dot == pytest.approx(66.8, abs=0.1)
    assert boundary_strip(WITHOUT_LIMIT, TONE, 1000.0).mark == MARKER_PATHS[">"]
    assert largest_factor(WITHOUT_LIMIT) == 1000.0


def test_ratios_to_theory_are_centred_at_one() -> None:
    exact = replace(INACCURATE_STEP, theory=INACCURATE_STEP.measured)
    assert ratio_strip(exact, TONE).dot == 50.0
    off = replace(INACCURATE_STEP, theory=INACCURATE_STEP.measured / 1.02)
    low, wide = ratio_strip(off, TONE).band or (0.0, 0.0)
    assert ratio_strip(off, TONE).dot == pytest.approx(low + wide)  # at the end of the band


def test_a_table_of_an_earlier_version_is_refused(tmp_path: Path) -> None:
    """The column `parameter` had another name in it."""
    file = tmp_path / "stress.csv"
    write_boundaries([INACCURATE_STEP], file)
    assert [one.measured for one in read_boundaries(file)] == [INACCURATE_STEP.measured]
    file.write_text(file.read_text().replace("parameter", "knob", 1))
    with pytest.raises(InputError, match=r"no column 'parameter'.*run proofmass stress"):
        read_boundaries(file)
