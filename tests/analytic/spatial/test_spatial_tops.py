"""Tops: the spatial reference compared with elliptic functions."""

import mujoco
import numpy as np
import pytest
from scipy.special import ellipkm1, elliprf

from proofmass.analytic import spatial
from proofmass.analytic.spatial.kinematics import rotation_matrices
from proofmass.sim.smooth import SmoothTerms
from tests.shipped import shipped

MOMENTS_OF_INERTIA = np.array([1.0, 2.0, 2.5])


def compile_shipped(name: str) -> mujoco.MjModel:
    """A shipped model."""
    return mujoco.MjModel.from_xml_path(str(shipped(f"{name}.xml")))


def jacobi_functions(u: np.ndarray, rest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The elliptic functions sn, cn and dn of parameter 1 - rest, by arithmetic-geometric means.

    The functions of scipy take the parameter itself, whose rounding is 1e-12 of a rest of 1e-4.
    """
    a, b, c = [1.0], [np.sqrt(rest)], [np.sqrt(1.0 - rest)]
    while abs(c[-1]) > 1e-16:
        a, b, c = (
            [*a, 0.5 * (a[-1] + b[-1])],
            [*b, np.sqrt(a[-1] * b[-1])],
            [*c, 0.5 * (a[-1] - b[-1])],
        )
    angle = 2.0 ** (len(a) - 1) * a[-1] * u
    for k in range(len(a) - 1, 0, -1):
        angle = 0.5 * (angle + np.arcsin(c[k] / a[k] * np.sin(angle)))
    return np.sin(angle), np.cos(angle), np.sqrt(np.cos(angle) ** 2 + rest * np.sin(angle) ** 2)


def free_body_spins(start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Angular velocity (n, 3) of a free body in its axes (Landau and Lifshitz, § 37)."""
    one, two, three = MOMENTS_OF_INERTIA
    twice, square = MOMENTS_OF_INERTIA @ start**2, MOMENTS_OF_INERTIA**2 @ start**2
    over = three * twice - square
    under = square - one * twice
    peaks = np.sqrt(
        [
            over / (one * (three - one)),
            over / (two * (three - two)),
            under / (three * (three - one)),
        ]
    )
    apart = one * (one - two) * start[0] ** 2 + three * (three - two) * start[2] ** 2
    rest = (three - one) * apart / ((three - two) * under)  # 1 - m, 1e-3 here
    pace = np.sqrt((three - two) * under / (one * two * three))
    sine, cosine = start[1] / peaks[1], start[0] / peaks[0]
    phase = sine * elliprf(cosine**2, cosine**2 + rest * sine**2, 1.0)
    sn, cn, dn = jacobi_functions(pace * times + phase, rest)
    return np.column_stack([peaks[0] * cn, peaks[1] * sn, peaks[2] * dn])


def free_body_axes(start: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Axes (n, 3, 3) of a free body whose axes are those of the world at time 0.

    Two of Euler's angles about the angular momentum follow from the angular velocity, and the third
    from an integral over time.
    """
    momentum = MOMENTS_OF_INERTIA * start
    length = np.linalg.norm(momentum)

    def axes(spin: np.ndarray, precession: np.ndarray) -> np.ndarray:
        """Axes of the body in those of a frame whose third axis is the momentum."""
        along = MOMENTS_OF_INERTIA * spin / length  # the momentum's direction, in the body
        first = np.cross([0.0, 0.0, 1.0], along)  # the line of nodes, in the body
        first /= np.linalg.norm(first, axis=-1, keepdims=True)
        second = np.cross(along, first)
        nodes = np.stack([first, second, along], axis=-2)
        cos, sin, zero = np.cos(precession), np.sin(precession), np.zeros_like(precession)
        about = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1], axis=-1)
        return about.reshape(-1, 3, 3) @ nodes

    points, weights = np.polynomial.legendre.leggauss(16)
    middles, halves = 0.5 * (times[1:] + times[:-1]), 0.5 * np.diff(times)
    inner = free_body_spins(start, (middles[:, None] + halves[:, None] * points).ravel())
    rate = (
        length
        * (MOMENTS_OF_INERTIA[:2] * inner[:, :2] ** 2).sum(axis=1)
        / (MOMENTS_OF_INERTIA[:2] ** 2 * inner[:, :2] ** 2).sum(axis=1)
    )
    steps = rate.reshape(middles.size, -1) @ weights * halves
    found = axes(free_body_spins(start, times), np.append(0.0, np.cumsum(steps)))
    return found[0].T @ found


def test_a_flipping_free_body_agrees_with_elliptic_functions():
    """Angular velocity and axes over 20 s; the first four samples also without MuJoCo's terms."""
    model, times = compile_shipped("euler_top"), np.linspace(0.0, 20.0, 401)
    start = model.key_qvel[0, 3:].copy()
    found = spatial.solve(times, model=model, terms=SmoothTerms(model))
    spin = np.column_stack([found[f"spin.{part}"] for part in "xyz"])
    assert np.ptp(spin[:, 1]) > 1.99 * start[1]  # it flips
    np.testing.assert_allclose(spin, free_body_spins(start, times), rtol=0, atol=1e-9)
    quaternion = np.column_stack([found[f"turn.{part}"] for part in "wxyz"])
    np.testing.assert_allclose(
        rotation_matrices(quaternion), free_body_axes(start, times), rtol=0, atol=1e-9
    )
    own = spatial.solve(times[:4], model=model)
    for name, curve in own.items():
        np.testing.assert_allclose(curve, found[name][:4], rtol=0, atol=1e-12)


def centre_of_heavy_top(times: np.ndarray) -> np.ndarray:
    """Centre of mass (n, 3) of Lagrange's top that starts horizontally and passes below its pivot.

    The height u satisfies u'^2 = beta u (u + 1) (u - w): with the spin a and the precession -a at
    the start, -1 is a root, and u + 1 = sn^2.  The root sn changes its sign below the pivot.  The
    rate of precession, -a / (1 - u), is integrated over time.
    """
    transverse, axial, spin = 15.234375, 0.46875, 150.0
    a, beta = axial * spin / transverse, 2 * 15.0 * 9.81 / transverse
    above = (2 * a * a + np.sqrt(4 * a**4 + 4 * beta * (2 * a * a + beta))) / (2 * beta)
    m = 1.0 / (1.0 + above)
    pace = 0.5 * np.sqrt(beta * (1.0 + above))

    def root(t: np.ndarray) -> np.ndarray:
        return jacobi_functions(pace * t + ellipkm1(1.0 - m), 1.0 - m)[0]

    points, weights = np.polynomial.legendre.leggauss(16)
    middles, halves = 0.5 * (times[1:] + times[:-1]), 0.5 * np.diff(times)
    inner = root((middles[:, None] + halves[:, None] * points).ravel())
    rates = -a / (2.0 - inner**2)
    steps = rates.reshape(middles.size, -1) @ weights * halves
    turned, now = np.append(0.0, np.cumsum(steps)), root(times)
    out = now * np.sqrt(2.0 - now**2)
    return np.column_stack([-out * np.sin(turned), out * np.cos(turned), now**2 - 1.0])


@pytest.mark.parametrize("end", [0.2, 2.0])
def test_a_heavy_top_agrees_with_elliptic_functions(end):
    model, times = compile_shipped("heavy_top"), np.linspace(0.0, end, 41)
    found = spatial.solve(times, model=model, terms=SmoothTerms(model))
    centre = np.column_stack([found[f"centre.{part}"] for part in "xyz"])
    wanted = centre_of_heavy_top(times)
    assert wanted[:, 2].min() < (-0.15 if end < 1 else -0.99)
    np.testing.assert_allclose(centre, wanted, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["spin.y"], 150.0, rtol=0, atol=1e-9)
