"""``proofmass design tolerances``: the band of a balancer's moment if its parts are not exact."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from proofmass.analytic.balancer.measures import chain_of, precision_points, target_for
from proofmass.base.arrays import Array
from proofmass.base.files import make_folder, protect
from proofmass.base.units import si_unit
from proofmass.commands.command import exit_on_error
from proofmass.design.tolerances import BAND_SAMPLES, DEFAULT_TOLERANCES, find_band, list_deviations
from proofmass.run.sidecar import load_case

TOLERANCE_UNITS = {"length": "m", "stiffness": "1", "preload": "1", "angle": "rad"}
"""SI units of the tolerances by their keys; shares are written in percent."""
BAND_POINTS = 30
"""Number of angles of the band up to 90 degrees."""


@dataclass(frozen=True)
class ToleranceCheck:
    """What is asked of a check of tolerances.

    Attributes
    ----------
    tolerances : mapping
        Tolerances by key [SI].
    samples, seed : int
        Number of balancers, 0 for no check, and the seed of their deviations.
    pendulum : float
        Length of the real pendulum [m].
    """

    tolerances: dict[str, float]
    samples: int = BAND_SAMPLES
    seed: int = 1
    pendulum: float = 1.0

    def run(
        self, parameters: dict[str, Any], wanted: Callable[[Array], Array], scale: float, stem: Path
    ) -> list[str]:
        """Check a balancer, write the files of the band, and return its sentence and their names.

        `wanted` gives the moment over m g r at angles, and `scale` is m g r [N m].
        """
        from proofmass.design.tolerance_table import record_band, tell_band, write_band

        if not self.samples:
            return []
        deviations = list_deviations(parameters, self.tolerances, self.pendulum)
        if not deviations:
            raise ValueError("--tolerance: all tolerances are zero; give --samples 0 for no check")
        band = find_band(
            parameters, deviations, precision_points(BAND_POINTS), self.samples, self.seed
        )
        record = record_band(band.over(scale), deviations, wanted(band.angle), self.seed)
        return [tell_band(record), *map(str, write_band(record, stem))]


def ask_tolerances(
    tolerance: list[str] | None, samples: int, seed: int, pendulum: float
) -> ToleranceCheck:
    """The check that options ask for."""
    if not pendulum > 0:
        raise ValueError(f"--pendulum {pendulum:g}: the length must be positive")
    return ToleranceCheck(
        DEFAULT_TOLERANCES | parse_tolerances(tolerance or []), samples, seed, pendulum
    )


def parse_tolerances(texts: Sequence[str]) -> dict[str, float]:
    """Tolerances [SI] from texts such as ``length=0.1mm``.

    >>> parse_tolerances(["length=0.1mm", "stiffness = 5 %"])
    {'length': 0.0001, 'stiffness': 0.05}
    """
    found = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        match = re.fullmatch(r"([\d.eE+-]+)\s*(\S.*)?", value)
        if name not in TOLERANCE_UNITS or not match:
            raise tolerance_error(text)
        try:
            number, unit = float(match[1]), match[2] or ("1" if match[1].strip("0.") == "" else "")
            found[name] = number * factor_of(unit, TOLERANCE_UNITS[name], not number)
        except ValueError:
            raise tolerance_error(text) from None
        if not 0.0 <= found[name] < 1.0:
            raise ValueError(f"--tolerance {text}: must be from 0 to less than 1 m, 100 % or 1 rad")
    return found


def factor_of(unit: str, wanted: str, is_zero: bool) -> float:
    """The factor from a unit to the wanted one; ValueError if it is another quantity."""
    if is_zero:
        return 1.0
    if unit == "%":
        unit, factor = "1", 0.01
    else:
        unit, factor = si_unit(unit)
    if unit != wanted:
        raise ValueError
    return factor


def tolerance_error(text: str) -> ValueError:
    """The error for a text that is no tolerance."""
    return ValueError(
        f"--tolerance {text}: write it as length=0.1mm, stiffness=5%, preload=5% or angle=0.5deg, "
        f"or with =0 for an exact group"
    )


def check_case(
    file: Path,
    tolerance: list[str] | None,
    samples: int,
    seed: int,
    pendulum: float | None,
    output: Path,
) -> None:
    """Run ``proofmass design tolerances``; `proofmass.commands.cli` describes the parameters."""
    with exit_on_error("nothing is kept"):
        case = load_case(file)
        if case.reference != "balancer":
            raise case.error("reference", f"{case.reference!r} is no balancer")
        given = dict(case.parameters)
        real = pendulum or float(given.get("pendulum", 1.0))
        asked = ask_tolerances(tolerance, samples, seed, real)
        protect([file])
        make_folder(output)
        chain, scale = chain_of(given), float(given.get("target_moment", 1.0))
        name = str(given.get("target", ""))
        if not name:
            raise case.error("parameters", "there is no target, against which errors are measured")
        own = {k: v for k, v in given.items() if is_of_chain(k)}
        for line in asked.run(own, target_for(chain, name), scale, output / "tolerances"):
            print(line)
        raise typer.Exit(0)


def is_of_chain(name: str) -> bool:
    """Whether a parameter is of the chain and not of its target or friction."""
    return not (name.startswith("target") or name == "expected" or "friction" in name)
