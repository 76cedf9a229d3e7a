"""A balancer in words: what its parameters amount to, and where its stops switch."""

from typing import Any

import numpy as np

from proofmass.analytic.balancer.design import Balancer, balancer
from proofmass.analytic.balancer.diagnose import flags
from proofmass.analytic.balancer.follow import follow
from proofmass.analytic.balancer.measures import (
    energy_spread,
    precision_points,
    rmse,
    work_reduction,
)
from proofmass.analytic.balancer.path import along
from proofmass.analytic.balancer.targets import TARGETS

ALL = np.pi / 2


def chain_of(parameters: dict[str, Any]) -> Balancer:
    """The balancer alone, without what it is designed for."""
    return balancer(**{k: v for k, v in parameters.items() if not k.startswith("target")})


def marks(**parameters: Any) -> dict[str, float]:
    """Pendulum angles [rad] up to 90 degrees at which a joint leaves or meets a stop, by name.

    >>> found = marks(length1=0.4764, length2=0.4975, length3=0.4986, stiffness1=0.9341,
    ...               stiffness2=0.1211, stiffness3=0.0927, preload2=0.3983, low2=0.0)
    >>> {name: round(float(np.degrees(angle)), 4) for name, angle in found.items()}
    {'joint 2 released': 46.6595}
    """
    trail = follow(chain_of(parameters), ALL)
    words = {0: "released", -1: "back on its stop", 1: "on its stop"}
    return {f"joint {joint} {words[side]}": angle for _, joint, angle, side in trail.switches}


def facts(**parameters: Any) -> dict[str, str]:
    """What the parameters amount to, for the report's page.

    With a `target` also how well it is met over its precision points, as van Nes 2022 counts them:
    90 for three segments, 15 for four, angle 0 left out; a work reduction names its reference.

    >>> facts(length1=0.3394, length2=0.4573, length3=0.4752, stiffness1=1.2701,
    ...       stiffness2=0.8473, stiffness3=4.1078, rest_angle=0.6641,
    ...       target="sine")["work reduction"]
    '99.30 % against the sine'
    """
    b = chain_of(parameters)
    trail = follow(b, ALL)
    found = {"rest posture": ", ".join(f"{np.degrees(a):.1f}°" for a in b.rest[0])
             + " from the upright, clockwise"}
    found |= {name: f"{np.degrees(angle):.2f}°" for name, angle in marks(**parameters).items()}
    if not trail.why[0]:
        found |= measured(b, str(parameters.get("target", "")),
                          float(parameters.get("target_moment", 1.0)))
    warnings = flags(**{k: v for k, v in parameters.items() if not k.startswith("target")})
    return found | ({"mind": "; ".join(warnings)} if warnings else {})


def measured(b: Balancer, target: str, scale: float) -> dict[str, str]:
    """Largest winding, and how a target is met."""
    angle = precision_points(90 if b.segments == 3 else 15)
    path = along(b, follow(b, ALL + 1e-9), angle)
    moment, energy = path.moment[0, :, 0], path.energy[0]
    far = np.degrees(np.abs(path.winding[0]).max(axis=0))
    found = {"springs wound by": ", ".join(f"{w:.0f}°" for w in far) + " at most"}
    if target:
        wanted = scale * TARGETS[target](angle)
        found |= {
            "error": f"{float(rmse(moment, wanted, scale=scale)):.5f} m g r, root mean square at "
                     f"{angle.size} angles",
            "work reduction": f"{float(work_reduction(moment, wanted, angle)):.2f} % against the "
                              f"{target}",
            "energy spread": f"{float(energy_spread(*energy.T, scale=scale)):.3f} m g r between "
                             f"springs"}
    return found
