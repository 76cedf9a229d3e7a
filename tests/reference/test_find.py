"""The class of a case's reference, found by its name."""

from proofmass.analytic.linkages import fivebar, fourbar
from proofmass.reference.find import assembly_modes, load_reference
from tests.reference.stubs import (
    FIVEBAR,
    FOURBAR,
    PENDULUM,
    RECORDED,
    error_of,
    with_tables,
)


def test_a_reference_is_the_class_of_its_name():
    assert load_reference(FOURBAR) is fourbar.FourBar
    assert load_reference(FIVEBAR) is fivebar.FiveBar


def test_an_unknown_reference_is_reported_with_the_nearest_and_all_names():
    file, key, words = error_of(load_reference, with_tables(FOURBAR, reference="forbar"))
    assert (file, key) == (FOURBAR.file, "reference")
    head, _, names = words.partition("there are: ")
    assert head == "no reference 'forbar'; did you mean 'fourbar'? "
    names, _, tail = names.partition("; ")
    assert names.split(", ") == sorted(names.split(", "))
    assert {"fourbar", "pendulum", "planar"} <= set(names.split(", "))
    assert tail == "or name a recorded curve NAME.csv or a program NAME.py"


def test_assembly_modes_are_those_of_the_reference_if_it_has_any():
    assert assembly_modes(FOURBAR) == (1, -1)
    assert assembly_modes(PENDULUM) == ()
    assert assembly_modes(RECORDED) == ()
