"""Rods: a cantilever with a large deflection, as chains of 10, 20 and 40 links in both engines.

The sidecar describes a flexible rod; each engine runs it as a chain of rigid links with springs.
The error of the tip falls with the square of the links' length, so that the two finest chains give
the limit of many links by Richardson's extrapolation. This limit is much more accurate than the
finest chain. K. Mattiasson (1981) prints the place of the tip for P L^2 / EI = 10: 0.81061 L up
and 0.55500 L back.

    uv run python examples/rods.py
"""

import math
from pathlib import Path

from proofmass import Case, load_case, solve

MODELS = Path(__file__).parent.parent / "models"
PRINTED = 0.81061  # [m] printed height of the tip; the length of the rod is 1 m
SEGMENTS = (10, 20, 40)


def tip(case: Case, engine: str, segments: int) -> float:
    """Height of the tip in equilibrium [m]."""
    rod = case.rod["rod"].model_copy(update={"segments": segments})
    curves = solve(case.model_copy(update={"rod": {"rod": rod}}), "equilibrium", engine)
    return float(curves.channels["rod.y"][-1])


def main() -> None:
    """Print the height of the tip by number of segments, the order of its error, and the limit."""
    case = load_case(MODELS / "rods" / "rod_cantilever.toml")
    for engine in ("mujoco", "pymunk"):
        heights = [tip(case, engine, segments) for segments in SEGMENTS]
        for segments, height in zip(SEGMENTS, heights, strict=True):
            print(f"{engine:8}{segments:4} segments: tip at {height:.5f} m")
        coarse, middle, fine = heights
        order = math.log2(abs((coarse - middle) / (middle - fine)))
        print(
            f"{'':8}order {order:.2f}; limit {fine + (fine - middle) / 3:.5f} m, printed "
            f"{PRINTED} m"
        )


if __name__ == "__main__":
    main()
