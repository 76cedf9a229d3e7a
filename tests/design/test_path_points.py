"""Tables of the points of a path: units, angles, tolerances, and what is refused."""

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.design.path_points import read_points

HEAD = "x [mm],y [mm],angle [deg],tolerance [um]"


def write(folder, *lines):
    file = folder / "points.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_units_of_the_header_are_converted(tmp_path):
    path = read_points(write(tmp_path, HEAD, "0,0,10,50", "10,5,-20,100", "20,0,-90,50"))
    np.testing.assert_allclose(path.points, [0, 0.01 + 0.005j, 0.02])
    np.testing.assert_allclose(path.angles, np.radians([10, -20, -90]))
    np.testing.assert_allclose(path.tolerances, [5e-5, 1e-4, 5e-5])
    np.testing.assert_allclose(path.weights, [1.0, 0.5, 1.0])
    assert path.senses == (-1,)
    assert path.size == pytest.approx(0.02)


def test_without_angles_both_senses_are_searched(tmp_path):
    path = read_points(write(tmp_path, "x [m];y [m]", "0,5;0", "1;0", "1;1"))
    assert path.senses == (1, -1)
    assert path.angles is None
    assert path.points[0] == 0.5


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (["x [m],y [m]", "0,0", "1,0"], ("2 points", "needs 3")),
        (["x [m],z [m]", "0,0", "1,0", "1,1"], ("no column 'y'", "'x [m]' and 'y [m]'")),
        (["x [m],y [m],speed [m/s]", "0,0,1", "1,0,1", "1,1,1"], ("'speed'", "leave it out")),
        (["x,y [m]", "0,0", "1,0", "1,1"], ("'x'", "no unit")),
        (["x [m],y [kg]", "0,0", "1,0", "1,1"], ("'y'", "'kg'", "a length")),
        (
            ["x [m],y [m],angle [m]", "0,0,0", "1,0,1", "1,1,2"],
            ("'angle'", "an angle, such as deg"),
        ),
        (["x [m],y [m]", "0,0", "nan,0", "1,1"], ("line 3, x", "not finite")),
        (["x [m],y [m]", "0,0", "one,0", "1,1"], ("line 3, x", "'one' is no number")),
        (["x [m],y [m]", "0,0", "1,0", "1,0", "1,1"], ("line 4", "the row before")),
        (["x [m],y [m]", "1,1", "1,1", "1,1"], ("line 3", "the row before")),
        (
            ["x [m],y [m],angle [deg]", "0,0,0", "1,0,40", "1,1,30", "0,1,60"],
            ("line 4", "angle does not rise"),
        ),
        (
            ["x [m],y [m],angle [deg]", "0,0,0", "1,0,200", "1,1,400"],
            ("line 4", "cover 400 degrees", "one turn"),
        ),
        (
            ["x [m],y [m],tolerance [m]", "0,0,1", "1,0,0", "1,1,1"],
            ("line 3, tolerance", "must be positive"),
        ),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, lines, words):
    with pytest.raises(InputError) as refused:
        read_points(write(tmp_path, *lines))
    for word in ("points.csv", *words):
        assert word in str(refused.value)


def test_angles_from_an_axis_need_angles(tmp_path):
    file = write(tmp_path, "x [m],y [m]", "0,0", "1,0", "1,1")
    with pytest.raises(InputError, match="need a column 'angle"):
        read_points(file, "ground")


def test_a_closed_path_may_end_at_its_first_point(tmp_path):
    path = read_points(write(tmp_path, "x [m],y [m]", "0,0", "1,0", "1,1", "0,0"), closed=True)
    assert path.closing_share == 1.0
