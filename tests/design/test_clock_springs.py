"""Clock springs compared with a bent spiral, numbers of van Nes 2022, and all other choices."""

import numpy as np
import pytest
from scipy.integrate import quad

from proofmass.base.errors import InputError
from proofmass.design.springs import (
    STRIP_HEADER,
    SpringStrip,
    choose_strip,
    make_clock_spring,
    read_strips,
    strip_stiffness,
)

STEEL = 206e9  # [Pa]
# Table J.1, lines 1579-1581: windings, t, b, r_in, r_out [mm]; k to six digits by table J.2.
PRINTED_SPRINGS = {
    "907": (8, 0.6, 6.0, 4.0, 25.0, 0.037241),
    "903": (8, 0.5, 5.0, 3.5, 21.0, 0.024637),
    "908": (5, 0.7, 4.0, 5.0, 19.0, 0.081929),
}
STRIPS = [
    SpringStrip("soft", 6e-3, 0.6e-3, 0.2, 1.5, STEEL, 1.2e9),
    SpringStrip("stiff", 10e-3, 1.0e-3, 0.2, 1.5, STEEL, 1.2e9),
]


def test_a_spiral_turns_by_moment_times_length_over_bending_stiffness():
    """Castigliano's theorem for an Archimedean spiral: dU/dM with U = integral M^2/(2 E I) ds."""
    inner, outer, turns, b, t = 4e-3, 25e-3, 8, 6e-3, 0.6e-3
    growth = (outer - inner) / (2.0 * np.pi * turns)
    length, _ = quad(lambda a: np.hypot(inner + growth * a, growth), 0.0, 2.0 * np.pi * turns)
    inertia, _ = quad(lambda y: b * y**2, -t / 2, t / 2)
    strip = SpringStrip("", b, t, 0.1, 2.0, STEEL, 1e9)
    assert strip_stiffness(strip, length) == pytest.approx(
        STEEL * inertia / length, rel=1e-12, abs=0
    )
    spring = make_clock_spring(strip_stiffness(strip, length), 0.05, strip)
    assert spring.length == pytest.approx(length, rel=1e-12, abs=0)
    assert spring.stress == pytest.approx(0.05 * t / 2 / inertia, rel=1e-12)  # M y/I


@pytest.mark.parametrize(("name", "eq_i1"), [("907", 0.0305), ("903", 0.0174), ("908", 0.0625)])
def test_the_thesis_springs_are_stiffer_than_its_equation(name, eq_i1):
    """Eq. I.1 with the length of the windings is 18 to 29 % low: not the whole length bends."""
    turns, t, b, inner, outer, k = PRINTED_SPRINGS[name]
    strip = SpringStrip(name, 1e-3 * b, 1e-3 * t, 0.1, 2.0, STEEL, 1e9)
    length = 2.0 * np.pi * turns * 1e-3 * (inner + outer) / 2.0
    assert strip_stiffness(strip, length) == pytest.approx(eq_i1, abs=5.1e-5)
    assert make_clock_spring(k, 0.0, strip).length == pytest.approx(length * eq_i1 / k, rel=3e-3)


def test_a_thicker_and_narrower_strip_has_five_thirds_the_stiffness():
    """By line 1566 a factor of 5^(1/3) on the thickness t multiplies the stiffness k by five.

    With a width b of 2 mm instead of 6 the stiffness is 0.0621.  Table J.2 expects 0.051, by a
    factor that it does not name.
    """
    _, t, _, _, _, k = PRINTED_SPRINGS["907"]
    strip = SpringStrip("", 2e-3, 1e-3 * t * 5 ** (1 / 3), 0.1, 2.0, STEEL, 1e9)
    length = make_clock_spring(k, 0.0, SpringStrip("", 6e-3, 1e-3 * t, 0.1, 2.0, STEEL, 1e9)).length
    assert strip_stiffness(strip, length) == pytest.approx(k * 5.0 / 3.0, rel=1e-12, abs=0)
    assert abs(strip_stiffness(strip, length) - 0.051) > 0.01


def test_two_parallel_springs_share_stiffness_and_moment():
    one, two = (make_clock_spring(0.04, 0.06, STRIPS[0], n) for n in (1, 2))
    assert two.length == pytest.approx(2.0 * one.length)
    assert two.stress == pytest.approx(one.stress / 2.0)
    assert 2 * strip_stiffness(STRIPS[0], two.length) == pytest.approx(0.04)


@pytest.mark.parametrize("seed", range(3))
def test_no_other_spring_that_can_be_made_is_smaller(seed):
    rng = np.random.default_rng(seed)
    for k, moment in zip(rng.uniform(0.02, 0.4, 30), rng.uniform(0.0, 0.6, 30), strict=True):
        sizes = []
        for strip in STRIPS:
            for n in (1, 2):
                length = n * STEEL * strip.width * strip.thickness**3 / (12.0 * k)
                stress = 6.0 * moment / n / strip.width / strip.thickness**2
                if strip.shortest <= length <= strip.longest and stress <= strip.stress:
                    sizes.append(n * length * strip.width * strip.thickness)
        if sizes:
            assert choose_strip(k, moment, STRIPS).volume == pytest.approx(
                min(sizes), rel=1e-12, abs=0
            )
        else:
            with pytest.raises(ValueError, match="no clock spring"):
                choose_strip(k, moment, STRIPS)


def test_a_spring_that_cannot_be_made_is_refused_with_reasons():
    with pytest.raises(
        ValueError,
        match=r"4 N m/rad and 0.9 N m: 1 x soft has a length of 5.562 mm \(200 to 1500 mm can be "
        r"made\) and has a stress of 2500 MPa \(up to 1200 MPa is allowed\); 2 x soft",
    ):
        choose_strip(4.0, 0.9, STRIPS)


def test_a_file_of_strips_is_read(tmp_path):
    file = tmp_path / "strips.csv"
    rows = "soft,6,0.6,200,1500,206,1200\nstiff,10,1,200,1500,206,1200\n"
    file.write_text(",".join(STRIP_HEADER) + "\n" + rows)
    for found, strip in zip(read_strips(file), STRIPS, strict=True):
        assert found.name == strip.name
        own, wanted = ([*vars(s).values()][1:] for s in (found, strip))
        assert own == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("soft,6,0.6,200,1500,206", "line 2: 5 cells, the header has 6"),
        ("soft,6,0,200,1500,206,1200", r"line 2, thickness .mm.: must be positive, got 0"),
        ("soft,6,0.6,1500,200,206,1200", "soft: the longest piece must exceed the shortest"),
        ("", "no strips"),
    ],
)
def test_a_wrong_file_of_strips_is_refused(row, said, tmp_path):
    file = tmp_path / "strips.csv"
    file.write_text(",".join(STRIP_HEADER) + "\n" + row)
    with pytest.raises(InputError, match=said):
        read_strips(file)
