"""A balancer: torsion springs that carry an inverted pendulum.

A chain of three segments with torsion springs pushes the pendulum back by nearly m g r
sin(angle), the moment of its weight. The sweep follows the static equilibrium of the chain. The
script compares the holding moment with this target, and its work with the energy that the springs
lose or gain.

    uv run python examples/balancer.py [SIDECAR]
"""

import sys
from pathlib import Path

import numpy as np

from proofmass import load_case, solve

MODELS = Path(__file__).parent.parent / "models"


def main(sidecar: Path) -> None:
    """Sweep the balancer in both engines, and print the errors of its moment and its work."""
    case = load_case(sidecar)
    target_moment = float(case.parameters["target_moment"])  # m g r [N m]
    for engine in ("mujoco", "pymunk"):
        curves = solve(case, "sweep", engine)
        angle = curves.drive[0][0]  # the drive goes up and comes back
        rising = slice(0, int(np.argmax(angle)) + 1)
        moment, energy = (curves.channels[name][rising] for name in ("holding_moment", "energy"))
        angle = angle[rising]
        work = np.trapezoid(moment, angle)
        angles = np.radians(np.arange(1, 91))  # where the source of the model compares moments
        errors = np.interp(angles, angle, moment) - target_moment * np.sin(angles)
        rms = np.sqrt(np.mean(errors**2))
        print(
            f"{engine:8}0 to {np.degrees(angle[-1]):.0f} degrees: rms of moment - m g r sin "
            f"{rms / target_moment:.4f} m g r"
        )
        print(
            f"{'':8}work {work:.3f} J, energy of the springs {energy[-1] - energy[0]:.3f} J, "
            f"energy of the weight {target_moment * (1 - np.cos(angle[-1])):.3f} J"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else MODELS / "balancers" / "balancer_sine.toml")
