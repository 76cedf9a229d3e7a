"""The band of a balancer's moment by tolerances, and the same balancers in MuJoCo and pymunk.

    python -m docs.make.tolerance_band [--samples 1000] [--quick]

Draws balancers within the default tolerances around two designs, computes their moments by the
reference, and runs each of them as a model in both engines.  Prints the largest difference, and the
share of the engine's moments that lie in the band of 95 %.  Writes docs/tolerances.png, the band of
the first design.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np
from matplotlib import rc_context

from benchmarks import ROOT, command, folders
from proofmass.analytic.balancer.measures import precision_points
from proofmass.base.arrays import Array
from proofmass.commands.tolerances import BAND_POINTS
from proofmass.design.template import write_case
from proofmass.design.tolerance_table import draw_band, record_band, tell_band
from proofmass.design.tolerances import (
    DEFAULT_TOLERANCES,
    deviate,
    deviated_moments,
    draw_shares,
    find_band,
    list_deviations,
)
from proofmass.report.style import RC
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.run import Drive, Run

DESIGNS = {
    "sine, rest angle free (line 1766)": {
        "length1": 0.3394,
        "length2": 0.4573,
        "length3": 0.4752,
        "stiffness1": 1.2701,
        "stiffness2": 0.8473,
        "stiffness3": 4.1078,
        "rest_angle": 0.6641,
    },
    "sine, preload (line 1745)": {
        "length1": 0.4764,
        "length2": 0.4975,
        "length3": 0.4986,
        "stiffness1": 0.9341,
        "stiffness2": 0.1211,
        "stiffness3": 0.0927,
        "preload2": 0.3983,
        "low2": 0.0,
    },
}
"""Designs of van Nes 2022 for the sine, without stops and with one."""
ENGINES = ("mujoco", "pymunk")
ENGINE_ANGLES = precision_points(9)
"""Angles of the runs: every 10 degrees."""
DRIVE = Drive("pendulum", lambda x: (x, 1.0 + 0.0 * x, 0.0 * x))


def write_deviated_model(
    folder: Path, parameters: Mapping[str, float], shift: Sequence[float]
) -> Path:
    """Write the MJCF of a balancer whose springs are set wrongly by angles [rad]."""
    file = write_case(folder, "off", title="", source="", parameters=parameters).with_suffix(".xml")
    tree = ElementTree.parse(file)
    for joint in tree.iter("joint"):
        match = re.fullmatch(r"joint(\d)", joint.get("name", ""))
        if match and (turn := float(shift[int(match[1]) - 1])):
            joint.set("springref", repr(float(joint.get("springref", "0")) - turn))
    tree.write(file)
    return file


def run_engines(
    parameters: Mapping[str, float], shares: Array, folder: Path
) -> tuple[dict[str, Array], Array]:
    """Moments (S, A) of balancers off by shares of the deviations: of each engine, and ours."""
    deviations = list_deviations(parameters, DEFAULT_TOLERANCES)
    off, shift = deviate(parameters, deviations, shares)
    found: dict[str, list[Array]] = {name: [] for name in ENGINES}
    run = Run("sweep", ENGINE_ANGLES, ("holding_moment",), (DRIVE,))
    for k in range(len(shares)):
        own = {name: float(values[k]) for name, values in off.items()}
        model = write_deviated_model(folder, own, shift[k].tolist())
        for name in ENGINES:
            found[name].append(engine_of(name).simulate(model, run).channels["holding_moment"])
    ours = deviated_moments(parameters, deviations, shares, ENGINE_ANGLES)
    return {name: np.array(moments) for name, moments in found.items()}, ours


def compare(parameters: Mapping[str, float], samples: int) -> dict[str, Any]:
    """Largest differences of the engines from the reference, and their shares in the band.

    The band is that of other balancers, drawn with another seed.
    """
    deviations = list_deviations(parameters, DEFAULT_TOLERANCES)
    band = find_band(parameters, deviations, ENGINE_ANGLES, 4 * samples, seed=2)
    with TemporaryDirectory() as folder:
        theirs, ours = run_engines(
            parameters, draw_shares(len(deviations), samples, seed=1), Path(folder)
        )
    return {
        name: {
            "runs": samples,
            "largest_difference": float(np.abs(moments - ours).max()),
            "share_in_band": float(((moments >= band.low) & (moments <= band.high)).mean()),
        }
        for name, moments in theirs.items()
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Compare both designs, and draw the band of the first."""
    parser = command(__doc__)
    parser.add_argument("--samples", type=int, default=1000)
    given = parser.parse_args(argv)
    samples = 2 if given.quick else given.samples
    record: dict[str, Any] = {}
    for name, parameters in DESIGNS.items():
        deviations = list_deviations(parameters, DEFAULT_TOLERANCES)
        band = find_band(parameters, deviations, precision_points(BAND_POINTS))
        whole = record_band(band, deviations, np.sin(band.angle), seed=1)
        engines = compare(parameters, samples)
        record[name] = {"band": whole, "engines": engines}
        print(f"{name}: {tell_band(whole)}")
        for engine, found in engines.items():
            print(f"  {engine}: {found}", flush=True)
    with folders(given.quick, ROOT) as (_, docs):
        first = next(iter(record.values()))
        with rc_context(RC):
            draw_band(first["band"]).savefig(docs / "tolerances.png", dpi=130)


if __name__ == "__main__":
    main()
