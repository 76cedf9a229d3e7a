"""Laws that every reference keeps; a new one is tested by being listed.

A reference is evaluated as its first shipped case does, at a few samples.  The laws need no names
of its curves and no numbers of their own:

- *Units*: in units of length, mass or time that are half as large, all numbers change by powers of
  two.  So each curve must change by one power of two, whatever it is.  A wrong unit of a parameter,
  or a tolerance or constant with a unit that is hidden in the code, breaks this.
- *Path*: the first samples of a motion do not depend on the later ones.
- *Choice*: a curve that is asked for alone is the one among all.
- *Constant loads*: a parameter that may change along a run may be an array of one value.
- *Guess*: a parameter that states which curves it moves, or that it moves none, moves no others.
- *Domain*: a value that the type of a parameter does not allow is refused by its name.
"""

from functools import cache

import numpy as np
import pytest

from proofmass.analytic.protocol import (
    REQUIRED,
    Ask,
    Domain,
    InputMotion,
    OneOf,
    Quantity,
    Whole,
)
from proofmass.base.units import unit_powers
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import find_reference, reference_names
from proofmass.run.sidecar import load_case
from proofmass.run.solve import prescribed_run
from proofmass.sim.contents import joints
from tests.shipped import shipped_files

SAMPLES = 9
BASE_UNITS = "length", "mass", "time"
LARGEST_POWER = 6.0
CLOSED_FORMS = [name for name in reference_names() if not find_reference(name).reads_model]
by_name = pytest.mark.parametrize("name", CLOSED_FORMS)


@cache
def example(name: str) -> tuple[Case, InputMotion]:
    """The first shipped case of a reference, and the motion of its first run at a few samples."""
    for file in shipped_files():
        if f'reference = "{name}"' in file.read_text(encoding="utf-8"):
            case = load_case(file)
            break
    else:
        pytest.fail(f"no shipped case has the reference {name}")
    kind = next(iter(case.run))
    run = prescribed_run(case, kind)
    x = run.x[np.linspace(0, len(run.x) - 1, SAMPLES).round().astype(int)]
    drives = run.motion(x) if run.drives and kind != "equilibrium" else None
    return case, InputMotion(x, drives)


def values_of(name: str) -> dict:
    """All quantities of a reference's example, also those that have their defaults."""
    case, _ = example(name)
    defaults = {
        key: one.default
        for key, one in find_reference(name).parameters.items()
        if one.is_quantity and one.default not in (REQUIRED, None)
    }
    return {**defaults, **case.parameters}


def curves(name: str, parameters: dict, motion: InputMotion, **asked: object) -> dict:
    """Curves of a reference."""
    return find_reference(name).evaluate(parameters, motion, Ask(**asked))


def rescale(name: str, unit: str) -> tuple[dict, InputMotion]:
    """The example in a unit of length, mass or time that is half as large."""
    case, motion = example(name)
    kinds, values = find_reference(name).parameters, values_of(name)
    for key, value in values.items():
        if kinds[key].is_quantity:
            values[key] = value * 2.0 ** power(kinds[key].unit, unit)
    if motion.drives is None:
        of_x = "s" if "dynamics" in case.run else "m"
        return values, InputMotion(motion.x * 2.0 ** power(of_x, unit))
    there = joints(compiled_model(case))
    units = [there[drive.joint] or "rad" for drive in case.drive]
    scales = [
        np.array([2.0 ** power(f"{one}{per}" if per else one, unit) for one in units])[:, None]
        for per in ("", "/s", "/s^2")
    ]
    value, rate, acceleration = (
        part * scale for part, scale in zip(motion.drives, scales, strict=True)
    )
    return values, InputMotion(motion.x, (value, rate, acceleration))


def power(unit: str, base: str) -> float:
    """The power of a base unit in a unit."""
    return unit_powers(unit)[BASE_UNITS.index(base)]


@by_name
@pytest.mark.parametrize("unit", BASE_UNITS)
def test_curves_change_by_a_power_of_two_in_units_half_as_large(name: str, unit: str) -> None:
    _, motion = example(name)
    before = curves(name, values_of(name), motion)
    after = curves(name, *rescale(name, unit))
    assert before.keys() == after.keys()
    odd = {}
    for key, curve in before.items():
        largest = float(np.abs(np.where(np.isfinite(curve), curve, 0.0)).max())
        if largest < 1e-9:  # zero up to rounding
            continue
        ratio = float(np.abs(np.where(np.isfinite(after[key]), after[key], 0.0)).max()) / largest
        found = round(np.log2(ratio)) if ratio > 0 else 99
        off = np.nanmax(np.abs(after[key] - curve * 2.0**found)) / (largest * 2.0**found)
        if abs(found) > LARGEST_POWER or off > 1e-8:
            odd[key] = (ratio, off)
    assert odd == {}


@by_name
def test_the_first_samples_do_not_depend_on_the_later_ones(name: str) -> None:
    _, motion = example(name)
    whole, half = curves(name, values_of(name), motion), SAMPLES // 2 + 1
    drives = motion.drives and tuple(part[:, :half] for part in motion.drives)
    first = curves(name, values_of(name), InputMotion(motion.x[:half], drives))
    for key, curve in first.items():
        allowed = 1e-9 * float(np.nanmax(np.abs(whole[key]))) + 1e-12  # of curves of zeros
        np.testing.assert_allclose(curve, whole[key][:half], atol=allowed, err_msg=key)


@by_name
def test_a_curve_that_is_asked_for_alone_is_the_one_among_all(name: str) -> None:
    _, motion = example(name)
    whole = curves(name, values_of(name), motion)
    for key in list(whole)[:: max(1, len(whole) // 6)]:
        alone = curves(name, values_of(name), motion, wanted=frozenset([key]))
        np.testing.assert_array_equal(alone[key], whole[key], err_msg=key)


@by_name
def test_an_array_of_one_load_is_that_load(name: str) -> None:
    _, motion = example(name)
    may = [key for key, one in find_reference(name).parameters.items() if one.may_change]
    if not may:
        return
    values = {**values_of(name), **{key: values_of(name)[key] or 1e-3 for key in may}}
    whole = curves(name, values, motion)
    arrays = {key: np.full(SAMPLES, values[key]) for key in may}
    rates = {key: np.zeros(SAMPLES) for key in may}
    for key, curve in curves(name, values | arrays, motion, load_rates=rates).items():
        size = np.nanmax(np.abs(whole[key]))
        np.testing.assert_allclose(curve, whole[key], rtol=1e-8, atol=1e-9 * size, err_msg=key)


def moving_little(name: str) -> list[str]:
    """The parameters of a reference that state which curves they move."""
    parameters = find_reference(name).parameters.items()
    return [
        k for k, one in parameters if isinstance(one.kind, Quantity) and one.kind.moves is not None
    ]


def test_first_guesses_and_targets_are_stated() -> None:
    found = {name: keys for name in CLOSED_FORMS if (keys := moving_little(name))}
    assert {name: len(keys) for name, keys in found.items()} == {
        "balancer": 1,
        "rod_assembly": 27,
        "rod_pair": 6,
        "rod_pair_driven": 6,
        "rod_pinned": 3,
    }


@by_name
def test_a_parameter_moves_only_the_curves_that_it_states(name: str) -> None:
    """A first guess that differs by 1e-3 leads to the same equilibrium, up to rounding."""
    _, motion = example(name)
    for key in moving_little(name):
        before, kind = (
            curves(name, values_of(name), motion),
            find_reference(name).parameters[key].kind,
        )
        after = curves(name, {**values_of(name), key: 1.001 * values_of(name)[key]}, motion)
        moved = [one for one in before if differs(before[one], after[one])]
        assert set(moved) <= set(kind.moves), key
        assert bool(moved) == bool(kind.moves), key


def differs(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two curves differ by more than Newton's method leaves."""
    return not np.allclose(one, other, rtol=0, atol=1e-9 * (np.nanmax(np.abs(one)) + 1e-3))


def bad_values(kind: object) -> list:
    """Values that a kind of parameter does not allow."""
    if isinstance(kind, OneOf):
        return ["no such word"] if isinstance(kind.values[0], str) else [0.5, 99]
    if isinstance(kind, Whole):
        return [0, 1.5]
    if isinstance(kind, Quantity):
        bad = [float("nan")]
        if kind.domain in (Domain.POSITIVE, Domain.POSITIVE_OR_INF):
            bad += [0.0, -1.0]
        elif kind.domain is Domain.NOT_NEGATIVE:
            bad += [-1.0]
        if kind.domain not in (Domain.EXTENDED, Domain.POSITIVE_OR_INF):
            bad += [float("inf"), -float("inf")]
        return bad
    return []


@by_name
def test_a_value_outside_its_domain_is_refused_by_its_name(name: str) -> None:
    _, motion = example(name)
    accepted = []
    for key, one in find_reference(name).parameters.items():
        for bad in bad_values(one.kind):
            try:
                curves(name, {**example(name)[0].parameters, key: bad}, motion)
            except (ValueError, TypeError) as error:
                if key.rstrip("0123456789") not in str(error):
                    accepted.append(f"{key} = {bad}: {error}")
            else:
                accepted.append(f"{key} = {bad} is accepted")
    assert accepted == []
