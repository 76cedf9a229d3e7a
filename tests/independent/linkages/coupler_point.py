"""Coupler points of four-bars and slider-cranks by elementary geometry, for tests of the product.

The end of the coupler is constructed from the crank pin with ruler and compass: the foot on the
line of centres and the height above it, or the foot on the guide.  Nothing of the product is used.
"""

import math


def four_bar_point(p: dict[str, float], mode: int, angle: float) -> tuple[float, float]:
    """The coupler point at a crank angle; ValueError if the linkage does not close there."""
    px = p["pivot_x"] + p["crank"] * math.cos(angle)
    py = p["pivot_y"] + p["crank"] * math.sin(angle)
    bx = p["pivot_x"] + p["ground"] * math.cos(p["ground_angle"])
    by = p["pivot_y"] + p["ground"] * math.sin(p["ground_angle"])
    distance = math.hypot(bx - px, by - py)
    foot = (p["coupler"] ** 2 - p["rocker"] ** 2 + distance**2) / (2.0 * distance)
    height = mode * math.sqrt(p["coupler"] ** 2 - foot**2)  # ValueError where it does not close
    ex, ey = (bx - px) / distance, (by - py) / distance
    qx, qy = px + foot * ex - height * ey, py + foot * ey + height * ex
    return on_coupler(p, (px, py), (qx, qy))


def slider_crank_point(p: dict[str, float], angle: float) -> tuple[float, float]:
    """The coupler point of a slider-crank whose slider is ahead of its crank pin."""
    px = p["pivot_x"] + p["crank"] * math.cos(angle)
    py = p["pivot_y"] + p["crank"] * math.sin(angle)
    gx, gy = math.cos(p["guide_angle"]), math.sin(p["guide_angle"])
    ox, oy = p["pivot_x"] - p["offset"] * gy, p["pivot_y"] + p["offset"] * gx
    along = (px - ox) * gx + (py - oy) * gy
    across = -(px - ox) * gy + (py - oy) * gx
    run = along + math.sqrt(p["coupler"] ** 2 - across**2)
    return on_coupler(p, (px, py), (ox + run * gx, oy + run * gy))


def on_coupler(
    p: dict[str, float], pin: tuple[float, float], end: tuple[float, float]
) -> tuple[float, float]:
    """The point that lies point_along from the pin to the end, and point_across to the left."""
    ux, uy = (end[0] - pin[0]) / p["coupler"], (end[1] - pin[1]) / p["coupler"]
    x = pin[0] + p["point_along"] * ux - p["point_across"] * uy
    return x, pin[1] + p["point_along"] * uy + p["point_across"] * ux


def sextic_residual(p: dict[str, float], x: float, y: float) -> float:
    """The equation of the coupler curve of a four-bar, of the sixth degree, over its scale.

    The distances of both pins from their pivots are linear in the cosine and the sine of the
    coupler angle; the sum of their squares must be 1.  No crank angle, and no mode, is in it.
    """
    rows = []
    bx = p["pivot_x"] + p["ground"] * math.cos(p["ground_angle"])
    by = p["pivot_y"] + p["ground"] * math.sin(p["ground_angle"])
    for cx, cy, along, length in (
        (p["pivot_x"], p["pivot_y"], p["point_along"], p["crank"]),
        (bx, by, p["point_along"] - p["coupler"], p["rocker"]),
    ):
        dx, dy, across = x - cx, y - cy, p["point_across"]
        # |d - R(psi) (along, across)|^2 = length^2
        rows.append(
            (
                2.0 * (dx * along + dy * across),
                2.0 * (dy * along - dx * across),
                dx * dx + dy * dy + along**2 + across**2 - length**2,
            )
        )
    (a, b, e), (c, d, f) = rows
    determinant = a * d - b * c
    cosine, sine = (e * d - b * f), (a * f - e * c)
    return (cosine**2 + sine**2) / determinant**2 - 1.0


def worst_transmission(p: dict[str, float], count: int = 3600) -> float:
    """The least angle between coupler and rocker, or its supplement, over a turn [rad]."""
    least = math.pi
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        px = p["pivot_x"] + p["crank"] * math.cos(angle)
        py = p["pivot_y"] + p["crank"] * math.sin(angle)
        bx = p["pivot_x"] + p["ground"] * math.cos(p["ground_angle"])
        by = p["pivot_y"] + p["ground"] * math.sin(p["ground_angle"])
        square = (bx - px) ** 2 + (by - py) ** 2
        cosine = (p["coupler"] ** 2 + p["rocker"] ** 2 - square) / (2 * p["coupler"] * p["rocker"])
        between = math.acos(max(-1.0, min(1.0, cosine)))
        least = min(least, between, math.pi - between)
    return least
