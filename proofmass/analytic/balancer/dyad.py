"""The last two segments of a chain, closed upon the pendulum's tip by the cosine rule."""

import numpy as np

from proofmass.analytic.numerics import Array


def close(pendulum: Array | float, length: Array, first: Array, mode: Array | int) -> Array:
    """Angles of all segments when the first ones are given and the pendulum stands upright.

    ::

                 tip
          q2    /|         v = tip - P, from the end P of the given segments
        elbow  / |         d = |v|, its direction b = atan2(v_x, v_y)
             \\  v          A = acos((d^2 + a^2 - c^2)/(2 d a))   at P
           a  \\ |          C = acos((d^2 + c^2 - a^2)/(2 d c))   at the tip
               \\P          mode +1: b - A and b + C;  mode -1: b + A and b - C

    Parameters
    ----------
    pendulum : float or ndarray (...)
        Length r [m]; the tip is at (0, r).
    length : ndarray (..., n)
        Lengths [m]; a and c are the last two.
    first : ndarray (..., n - 2)
        Angles of the first segments, clockwise from the pendulum [rad].
    mode : +1 or -1, or an array (...)
        Elbow up: the last segment is turned clockwise against the one before; or elbow down.

    Returns
    -------
    ndarray (..., n)
        All angles, clockwise from the pendulum [rad]; NaN where the segments cannot reach.

    Notes
    -----
    Source: van Nes 2022, appendix A (the cosine rule); the two-argument arc tangent replaces the
    sectors of its listings N.3 and N.4.

    Examples
    --------
    >>> close(np.array(1.0), np.array([0.5, 0.5, 0.5]), np.array([0.0]), 1).round(6).tolist()
    [0.0, -1.047198, 1.047198]
    """
    a, c = length[..., -2], length[..., -1]
    x = -(length[..., :-2] * np.sin(first)).sum(axis=-1)
    y = pendulum - (length[..., :-2] * np.cos(first)).sum(axis=-1)
    d, toward = np.hypot(x, y), np.arctan2(x, y)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.arccos((d**2 + a**2 - c**2) / (2 * d * a))
        far = np.arccos((d**2 + c**2 - a**2) / (2 * d * c))
    last = np.stack([toward - mode * near, toward + mode * far], axis=-1)
    return np.concatenate([np.broadcast_to(first, (*last.shape[:-1], first.shape[-1])), last], -1)
