"""Rods: a cantilever that bends far, as chains of more and more links in both engines.

A flexible rod stands in the sidecar; each engine gets it as a chain of rigid links with springs.
The error of the tip falls with the square of the links' length, so two chains point to the limit
of many links (Richardson), which is much closer than the finer of them. K. Mattiasson (1981)
prints the tip of this cantilever, P L^2 / EI = 10: 0.81061 L up and 0.55500 L back.

    uv run python examples/rods.py
"""

import math
from pathlib import Path

from proofmass import Case, load_case, solve

MODELS = Path(__file__).parent.parent / "models"
PRINTED = 0.81061  # of the length, which is 1 m
SEGMENTS = (10, 20, 40)


def tip(case: Case, engine: str, segments: int) -> float:
    """How high the tip of the rod comes to rest [m]."""
    rod = case.rod["rod"].model_copy(update={"segments": segments})
    curves = solve(case.model_copy(update={"rod": {"rod": rod}}), "equilibrium", engine)
    return float(curves.channels["rod.y"][-1])


def main() -> None:
    """Print the tip by numbers of segments, the order of its error, and the limit."""
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
