"""Springs from a catalogue: the best of all combinations, and files that are refused."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

from proofmass.base.errors import InputError
from proofmass.design.springs import CATALOGUE, read_catalogue, select_springs


def test_the_springs_of_the_prototype_are_selected():
    found = select_springs([1.498937760758821, 1.0, 4.847839773931474])  # as in listing N.1
    assert found.springs == (("907",), ("903",), ("907", "908"))
    assert found.ratios == pytest.approx((1.5116, 1.0, 4.8371), abs=1e-4)  # to four digits
    assert found.error == pytest.approx(0.0166, abs=5e-5)


def test_scale_is_the_moment_that_the_springs_balance():
    exact = {"a": 0.02, "b": 0.03}
    found = select_springs([1.0, 1.5, 2.5], exact)
    assert found.springs == (("a",), ("b",), ("a", "b"))
    assert found.error == pytest.approx(0.0, abs=1e-15)
    assert found.scale == pytest.approx(0.02)


@pytest.mark.parametrize("seed", range(5))
def test_no_combination_is_better(seed):
    rng = np.random.default_rng(seed)
    catalogue = dict(zip("abcdefghijkl", rng.uniform(0.01, 0.1, 12), strict=True))
    wanted = rng.uniform(0.0, 5.0, 3)
    springs = np.array([0.0, *catalogue.values()])  # 13 entries with "no spring": listing N.1
    sums = np.array([a + b for a, b in combinations_with_replacement(springs, 2)])
    assert sums.size == 91
    second = sums[sums > 0]
    ratio = sums / second[:, None]
    first, third = (ratio[..., None] - w / wanted[1] for w in wanted[[0, 2]])
    error = np.sqrt(first**2 + third.swapaxes(1, 2) ** 2).min()
    assert select_springs(wanted, catalogue).error == pytest.approx(error, rel=1e-12, abs=0)


def test_springs_for_four_joints_are_selected():
    found = select_springs([1.0, 2.0, 0.0, 3.0], {"one": 1.0, "two": 2.0})
    assert found.springs[2] == ()
    assert found.ratios == pytest.approx((0.5, 1.0, 0.0, 1.5))


def test_ratios_need_a_second_spring():
    with pytest.raises(ValueError, match="ratios need a spring in joint 2"):
        select_springs([1.0, 0.0, 1.0])


def test_a_catalogue_file_is_read(tmp_path):
    file = tmp_path / "springs.csv"
    rows = [f"{name},{k}" for name, k in CATALOGUE.items()]
    file.write_text("\n".join(["spring,stiffness [N m/rad]", *rows, ""]))
    assert read_catalogue(file) == CATALOGUE


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,0.1", "line 1: the header must be 'spring,stiffness .N m/rad.'"),
        ("spring,stiffness [N m/rad]", "no springs"),
        ("spring,stiffness [N m/rad]\na,soft", "line 2, stiffness .N m/rad.: 'soft' is no number"),
        (
            "spring,stiffness [N m/rad]\na,-1",
            "line 2, stiffness .N m/rad.: must be positive, got -1",
        ),
        ("spring,stiffness [N m/rad]\na,1\na,2", "line 3: a spring needs a name of its own"),
        ("spring,stiffness [N m/rad]\na,1,2", "line 2: 2 cells, the header has 1"),
    ],
)
def test_a_wrong_catalogue_file_is_refused(tmp_path, text, said):
    file = tmp_path / "springs.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        read_catalogue(file)


def test_a_missing_catalogue_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file of springs"):
        read_catalogue(tmp_path / "none.csv")
