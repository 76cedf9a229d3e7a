"""The stiff flyball governor by its equations in the height of the slider and one angle.

Both rods have the same angle a below the horizontal. The spin follows from the moment of momentum
about the shaft, H, which no force changes: T + V = H^2/(2 J(a)) + A a'^2 + m s'^2/2 + V(a, s). So
there is no body, no joint, no rotation and no model.
"""

import numpy as np
from scipy.integrate import solve_ivp

BENCHMARK = {
    "stiffness": 8e5,
    "damping": 4e4,
    "spin": 2 * np.pi,
    "ball": 5.0,
    "density": 3000.0,
    "angle": np.pi / 6,
    "height": 0.5,
}
"""The numbers of problem A05 that other programs have otherwise [SI]."""
ARM, LENGTH, HALF, THICK, SLIDER, REST, GRAVITY = 0.05, 1.0, 0.5, 0.01, 0.1, 0.5, 9.81
"""Hinge to shaft, rod, its half, its side, side of the slider, length at rest [m]; [m/s^2]."""


def move(times: np.ndarray, **changes: float) -> dict[str, np.ndarray]:
    """Height, angle, their rates, spin and its rate at times [s]; changes of `BENCHMARK` [SI]."""
    p = BENCHMARK | changes
    rod, slider = p["density"] * LENGTH * THICK**2, p["density"] * SLIDER**3
    ball, k, c = p["ball"], p["stiffness"], p["damping"]
    across = rod * (LENGTH**2 + THICK**2) / 12  # of a rod about its centre [kg m^2]
    along = rod * THICK**2 / 6
    fixed = along + slider * SLIDER**2 / 6  # the shaft is as thick as a rod
    swing = across + rod * HALF**2 + ball * LENGTH**2

    def about_shaft(a: float) -> tuple[float, float]:
        """J [kg m^2] and dJ/da of all that turns."""
        sine, cosine = np.sin(a), np.cos(a)
        middle, end = ARM + HALF * cosine, ARM + LENGTH * cosine
        one = rod * middle**2 + ball * end**2 + across * cosine**2 + along * sine**2
        slope = rod * middle * HALF + ball * end * LENGTH + (across - along) * cosine
        return fixed + 2 * one, -4 * sine * slope

    momentum = about_shaft(p["angle"])[0] * p["spin"]

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        height, a, up, turn, _ = y
        j, slope = about_shaft(a)
        spin = momentum / j
        x, z = HALF * np.cos(a), LENGTH - HALF * np.sin(a) - height  # slider's side to rod
        length = np.sqrt(x * x + z * z)
        by_angle = -HALF * (x * np.sin(a) + z * np.cos(a)) / length
        by_height = -z / length
        pull = k * (length - REST) + c * (by_angle * turn + by_height * up)
        weight = (rod * HALF + ball * LENGTH) * GRAVITY * np.cos(a)
        bend = (0.25 * spin**2 * slope + weight - pull * by_angle) / swing
        return np.array([up, turn, -GRAVITY - 2 * pull * by_height / slider, bend, spin])

    def slope_of_rate(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([rate(t, y + 1e-30j * unit).imag / 1e-30 for unit in np.eye(5)]).T

    start = (p["height"], p["angle"], 0.0, 0.0, 0.0)
    way = solve_ivp(
        rate, (0.0, times[-1]), start, "Radau", times, jac=slope_of_rate, rtol=1e-10, atol=1e-12
    )
    found = dict(zip(("height", "angle", "height_rate", "angle_rate", "spin"), way.y, strict=True))
    found["spin_rate"] = np.array([momentum / about_shaft(a)[0] for a in found["angle"]])
    return found
