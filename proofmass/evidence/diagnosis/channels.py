"""Causes in a single channel: its sign, its unit, an offset, another quantity, a shift along x."""

from collections.abc import Iterator, Sequence

import numpy as np

from proofmass.base.wording import format_list, format_unit
from proofmass.evidence.diagnosis.explanation import Explanation
from proofmass.evidence.diagnosis.fault import Fault, FaultValue, rounded_fit, sidecar_fault
from proofmass.evidence.diagnosis.fit import MAX_FIT_STEPS, ChannelCurves, Residuals
from proofmass.reference.evaluate import all_quantities

KNOWN_FACTORS = {
    "with the opposite sign": (-1.0, ""),
    "in degrees, not in radians": (180 / np.pi, "rad"),
    "in radians, not in degrees": (np.pi / 180, "rad"),
    "in thousandths of its unit": (1e3, "m kg N J"),
    "in thousands of its unit": (1e-3, "m kg N J"),
    "in inches, not in metres": (1 / 0.0254, "m"),
    "twice as large": (2.0, ""),
    "half as large": (0.5, ""),
}
"""Factors on a curve that are tried, by their descriptions, and the units that each is tried for,
by their first words; the empty text means all units."""
SAME_SHARE = 1e-3
"""Relative difference up to which a fitted factor or offset is a known one."""
ANGLE_OFFSETS = {"a whole turn": 2 * np.pi, "half a turn": np.pi, "a quarter turn": np.pi / 2}
"""Offsets of an angle that have a name [rad]."""
SAMPLE_SHIFTS = {"one sample": 1, "two samples": 2}
"""Shifts of a curve that have a name, in samples."""
MIN_SHIFTED_SAMPLES = 8  # fewest samples for a shift by any distance: a spline needs some
MAX_SHIFT = 0.1  # largest shift, as a share of the range of x; a longer one is no small fault


def channel_faults(
    residuals: Residuals, names: Sequence[str], key: str, change: float, note: str = ""
) -> list[Fault]:
    """The faults of a key of channels: its value times `change`, or plus it for `shift`."""
    faults = []
    for name in names:
        channel = residuals.case.channels[name]
        wrong: float = getattr(channel, key)
        if key == "scale":
            right, within = wrong * change, abs(wrong) / np.abs(residuals.reference[name]).max()
        else:
            right = wrong + change / channel.factor
            within = residuals.allowed[name] / channel.factor
        right = rounded_fit(right, within)
        unit = channel.unit.removeprefix("1") if key == "shift" else ""
        faults.append(channel_fault(residuals, name, key, wrong, right, unit, note))
    return faults


def channel_fault(
    residuals: Residuals,
    name: str,
    key: str,
    wrong: FaultValue,
    right: FaultValue,
    unit: str = "",
    note: str = "",
) -> Fault:
    """The fault of a key of a channel in the sidecar."""
    keys = ["channels", name, key]
    return sidecar_fault(residuals.case, keys, f"{key} of {name}", wrong, right, unit, note=note)


def factor_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which channels are a multiple of the reference: by sign, unit, or any factor."""
    units = {name: residuals.case.channels[name].si_unit for name in residuals.differing}
    moving = [name for name in residuals.differing if np.ptp(residuals.reference[name]) > 0]
    for words, (factor, unit_words) in KNOWN_FACTORS.items():
        divided = {
            name: residuals.curve[name] / factor - residuals.reference[name]
            for name in moving
            if has_unit(units[name], unit_words)
        }
        if right := residuals.agreeing(divided):
            faults = channel_faults(
                residuals, [*right], "scale", factor, words.removeprefix("with ")
            )
            yield residuals.judged("factor", f"{format_list(right)} {words}", right, faults=faults)
    for name in moving:
        square = float(residuals.reference[name] @ residuals.reference[name])
        factor = (
            float(residuals.curve[name] @ residuals.reference[name]) / square if square else 0.0
        )
        known = [f for f, unit_words in KNOWN_FACTORS.values() if has_unit(units[name], unit_words)]
        if not factor or any(abs(factor / one - 1) < SAME_SHARE for one in known):
            continue
        right = residuals.agreeing(
            {n: residuals.curve[n] / factor - residuals.reference[n] for n in moving}
        )
        if next(iter(right), "") == name:  # otherwise an earlier channel gave the same factor
            words = f"{format_list(right)} times {factor:.6g}"
            faults = channel_faults(residuals, [*right], "scale", factor)
            yield residuals.judged("factor", words, right, 2, faults=faults)


def has_unit(unit: str, words: str) -> bool:
    """Whether the first word of a unit is one of some words; all units are, if there are none.

    >>> has_unit("m/s", "m kg"), has_unit("rad", "m kg"), has_unit("rad", "")
    (True, False, True)
    """
    return not words or unit.partition("/")[0].partition(" ")[0] in words.split()


def offset_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which channels are off by a constant: by parts of a turn, or by any offset."""
    for name in residuals.differing:
        unit, allowed = residuals.case.channels[name].si_unit, residuals.allowed[name]
        offset = float(np.mean(residuals.before[name])) * allowed
        known = ANGLE_OFFSETS if unit == "rad" else {}
        turn = next((w for w, t in known.items() if abs(abs(offset) / t - 1) < SAME_SHARE), "")
        if turn:
            offset = float(np.copysign(ANGLE_OFFSETS[turn], offset))
        right = residuals.agreeing(
            {
                other: residuals.before[other] - offset / residuals.allowed[other]
                for other in residuals.differing
                if residuals.case.channels[other].si_unit == unit
            }
        )
        if next(iter(right), "") == name:
            words = turn or f"{offset:.6g} {format_unit(unit)}"
            way = "" if not turn else " ahead" if offset > 0 else " behind"
            text = f"{format_list(right)} off by {words}{way}"
            faults = channel_faults(residuals, [*right], "shift", offset, turn)
            yield residuals.judged("offset", text, right, 0 if turn else 2, faults=faults)


def quantity_causes(residuals: Residuals) -> Iterator[Explanation]:
    """The cause in which channels equal other quantities of the reference than the sidecar says."""
    case, curves = residuals.case, residuals.curves
    known = all_quantities(case, residuals.run, curves.x, curves.drive, dict(case.parameters))
    right, words, faults = ChannelCurves(), list[str](), list[Fault]()
    for name in residuals.differing:
        channel, allowed = case.channels[name], residuals.allowed[name]
        for quantity, values in known.items() if isinstance(channel.equals, str) else ():
            if quantity == channel.equals or not np.ptp(values) > 0:
                continue
            expected = channel.scale * np.broadcast_to(values, curves.x.shape)
            left = residuals.curve[name] - (expected + channel.shift * channel.factor) / allowed
            if np.isfinite(left).all() and residuals.agrees(name, left):
                right[name] = left
                words.append(f"{name} equal to {quantity}")
                wrong = str(channel.equals)
                faults.append(channel_fault(residuals, name, "equals", wrong, quantity))
                break
    if right:
        yield residuals.judged("quantity", format_list(words), right, faults=faults)


def shift_causes(residuals: Residuals) -> Iterator[Explanation]:
    """Causes in which channels are shifted along x: by one or two samples, or by any step."""
    moving = [n for n in residuals.differing if np.ptp(residuals.reference[n]) > 0]
    for words, count in SAMPLE_SHIFTS.items():
        for direction, mine, own in (
            ("late", slice(count, None), slice(None, -count)),
            ("early", slice(None, -count), slice(count, None)),
        ):
            right = residuals.agreeing(
                {n: residuals.curve[n][mine] - residuals.reference[n][own] for n in moving}
            )
            if right:
                yield residuals.judged("shift", f"{format_list(right)} {words} {direction}", right)
    if len(residuals.curves.x) < MIN_SHIFTED_SAMPLES or not moving:
        return
    from scipy.interpolate import CubicSpline  # slow to load

    x, shift, after = residuals.curves.x, 0.0, dict(residuals.before)
    splines = {name: CubicSpline(x, residuals.reference[name]) for name in moving}
    for _ in range(MAX_FIT_STEPS):
        slope = np.concatenate([-splines[name](x - shift, 1) for name in moving])
        step = float(np.concatenate([after[n] for n in moving]) @ slope / (slope @ slope))
        if not abs(shift + step) < MAX_SHIFT * np.ptp(x):
            return
        shift += step
        after = {name: residuals.curve[name] - splines[name](x - shift) for name in moving}
    if right := residuals.agreeing(after):
        direction = "late" if shift > 0 else "early"
        yield residuals.judged(
            "shift", f"{format_list(right)} {direction} by {abs(shift):.4g} in x", right, 2
        )
