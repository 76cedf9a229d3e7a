"""Power hacksaw: offset slider-crank with the slider on a guide above the crank axis.

`solve` is the closed form.  `newton_sweep` and `newton_pose` solve the linkage by Newton-Raphson as
its report does.  Charts named ``newton_...`` show the convergence and the errors.  These functions
take the lengths of `solve`.  In charts of a sweep the crank follows the report's motor over twice
the duration of its run-up, as in the figures of the report.
"""

from collections.abc import Collection
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.analytic.linkages import slider_crank
from proofmass.analytic.linkages.bars import LOAD_ENDINGS, is_requested
from proofmass.analytic.newton_raphson import (
    NewtonLog,
    NotConverged,
    convergence_chart,
    course_chart,
    newton_raphson,
)
from proofmass.analytic.numerics import (
    TURN,
    broadcast_loads,
    broadcast_motion,
    check_finite,
    check_number,
    check_one_of,
    check_positive,
)
from proofmass.analytic.protocol import (
    Acceleration,
    ClosedForm,
    Length,
    Mass,
    Mode,
    Position,
    VaryingForce,
)
from proofmass.base.arrays import Array, Complex

__all__ = [
    "MODES",
    "Hacksaw",
    "motor",
    "newton_convergence",
    "newton_course",
    "newton_errors",
    "newton_pose",
    "newton_steps",
    "newton_sweep",
    "solve",
    "turn_time",
]

MODES = (1, -1)
UNKNOWNS: tuple[str, ...] = (
    "r1",
    "theta1",
    "theta3",
    "r1_rate",
    "theta1_rate",
    "theta3_rate",
    "r1_acceleration",
    "theta1_acceleration",
    "theta3_acceleration",
)
FIRST_GUESS = (-0.1, -0.5, 3.0, 0.5, 0.0, -0.5, 0.5, 0.0, -0.5)  # text line 357
SWEEP_GUESS = (-0.0997, -0.4684, 2.8737, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # text line 1712
UNKNOWN_UNITS = ("m", "rad", "rad", "m/s", "rad/s", "rad/s", "m/s²", "rad/s²", "rad/s²")
SEQUENTIAL_TITLES = ("sequential: positions", "sequential: rates", "sequential: accelerations")
SWEEP_POSES = 1000  # number of poses of the report's sweep
FORM_NAMES = {True: "simultaneous", False: "sequential"}


def solve(
    angle: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    mode: int = 1,
    cutting_force: ArrayLike = 0.0,
    crank_mass: float = 0.0,
    coupler_mass: float = 0.0,
    slider_mass: float = 0.0,
    gravity: float = 9.81,
    inertia: bool = False,
    only: Collection[str] | None = None,
) -> dict[str, Array]:
    r"""Motion of the hacksaw linkage whose crank motion is given, as the report's nine curves.

    ::

        --[S]------------------- guide, y = offset   O = (0, 0) crank axis
             `--.__  coupler                         O-P crank r2, angle theta2 (given)
                   `--.__                            P-S coupler r3, angle theta3
                         `P                          O-S polar length r1, angle theta1
                     crank O

    It is a slider-crank with a level guide, see `slider_crank.solve`: theta3 is the angle of the
    coupler, and x the slide. The polar length and its angle follow from x and the offset h::

        r1 = -hypot(x, h)              theta1 = atan2(-h, -x)
        r1' = x x'/r1                  r1'' = (x x'' + (h x'/r1)^2)/r1
        theta1' = -h x'/r1^2           theta1'' = h (2 x x'^2/r1^2 - x'')/r1^2

    At rest, virtual work gives the moment of the weights, less cutting_force dx/dtheta2.

    r1 is negative by the report's convention, so that theta1 points away from the slider: with the
    slider on the left theta1 lies in (-pi/2, 0). r1' and r1'' are not the velocity x' and the
    acceleration x'' of the slider.

    Parameters
    ----------
    angle, rate, acceleration : crank angle theta2 [rad], its first [rad/s] and second [rad/s^2]
        time derivative, (...) broadcast together
    crank, coupler : lengths r2, r3 between pins [m]
    offset : height h of the guide above the crank axis [m], of either sign
    mode : +1 slider left of the crank pin, theta3 = pi - asin((h - r2 sin(theta2))/r3) (the
        report's); -1 right of it, theta3 = asin(..). With a change point, coupler = crank +
        |offset|: where theta2 = 0, as in `slider_crank.solve`
    cutting_force : force on the slider along +x [N], a constant or (...)
    crank_mass, coupler_mass, slider_mass : uniform bars and slider [kg]
    gravity : along -y [m/s^2]
    inertia : whether moment and forces include those of the accelerations
    only : names of all requested quantities; None requests all. Moment and forces are computed only
        if one of them is requested

    Returns
    -------
    dict of (...) arrays: r1 [m], theta1, theta3 [rad], each with _rate and _acceleration;
    slider_x [m], slider_velocity [m/s], slider_acceleration [m/s^2]; holding_moment [N m] of the
    crank's drive; crank_force_x .. guide_force_y [N], see `slider_crank.solve`.

    Raises
    ------
    ValueError
        A length not positive, a mass negative, a value not finite, a mode unknown, or a pose that
        cannot be assembled: the message gives the first such angle and by how much the coupler
        misses the guide.

    Notes
    -----
    Loop residual below 1e-14 of the lengths. Rates are not finite where the coupler is vertical,
    except at a change point, and those of r1 and theta1 where the slider meets the axis. theta3
    starts in [0, 2 pi) for mode +1 and in [-pi, pi] for mode -1, and is unwrapped. theta1 is
    continuous through x = 0, where the report's acot(x/offset) jumps by pi and r1 changes sign.
    Source: power hacksaw report, Universidad Nacional de Colombia, text lines 300-338 (loop),
    530-543 (solution).
    Misprints: lines 300 and 302 print the coupler terms with theta2 for theta3; lines 533-534
    print the formula of theta3' for r1 and that of theta1 for theta3'.

    Examples
    --------
    >>> pose = solve(0.0, 0.0, 0.0, crank=0.075, coupler=0.170, offset=0.045)
    >>> [round(float(pose[name]), 6) for name in ("r1", "theta1", "theta3")]
    [-0.099672, -0.468422, 2.873694]
    """
    check_number(offset=offset)
    check_one_of(MODES, mode=mode)
    shape = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)[0].shape
    broadcast_loads(shape, cutting_force=cutting_force)
    motion = slider_crank.solve(
        angle,
        rate,
        acceleration,
        crank=crank,
        coupler=coupler,
        guide_y=offset,
        mode=-mode,  # there +1 is ahead of the crank pin along the guide
        crank_mass=crank_mass,
        coupler_mass=coupler_mass,
        slider_mass=slider_mass,
        slider_load=cutting_force,
        gravity=gravity,
        inertia=inertia,
        only=None if only is None else {"slide_rate", *only},  # rates, not positions alone
    )
    x, v, a = (motion[f"slide{part}"] for part in ("", "_rate", "_acceleration"))
    theta3 = np.atleast_1d(motion["coupler_angle"])
    if mode > 0:
        theta3 = theta3 + TURN * (theta3[..., :1] < 0.0)
    square = x**2 + offset**2
    with np.errstate(divide="ignore", invalid="ignore"):  # on the axis, upright: as documented
        r1 = -np.sqrt(square)
        curves = {
            "r1": r1,
            "r1_rate": x * v / r1,
            "r1_acceleration": (x * a + (v * offset) ** 2 / square) / r1,
            "theta1": np.arctan2(-offset, -x),
            "theta1_rate": -offset * v / square,
            "theta1_acceleration": offset * (2.0 * x * v**2 / square - a) / square,
            "theta3": theta3.reshape(shape),
            "theta3_rate": motion["coupler_rate"],
            "theta3_acceleration": motion["coupler_acceleration"],
            "slider_x": x,
            "slider_velocity": v,
            "slider_acceleration": a,
        }
    loads = {name: curve for name, curve in motion.items() if is_requested({name}, *LOAD_ENDINGS)}
    return {name: np.asarray(curve) for name, curve in (curves | loads).items()}


def turn_time(peak: float = 5.0) -> float:
    """Duration T [s] of the motor's run-up, in which it makes one turn: peak T^2/3 = 2 pi.

    `peak` is the largest crank acceleration [rad/s^2]; ValueError unless it is positive.
    >>> round(turn_time(), 3)
    1.942
    """
    check_positive("rad/s^2", peak=peak)
    return float(np.sqrt(6.0 * np.pi / peak))


def motor(time: ArrayLike, *, peak: float = 5.0) -> tuple[Array, Array, Array]:
    r"""Crank motion of the report's motor: smooth run-up over one turn, then constant speed.

    ::

        peak       ________
                  /        \           acceleration over time, T = turn_time(peak)
           0   __/          \_________
                 0  T/3  2T/3  T

    `time` [s] (...), not negative; returns the crank angle [rad], rate [rad/s] and acceleration
    [rad/s^2], each (...). The final rate is 2 peak T/3. ValueError for a time that is negative or
    not finite. Source: power hacksaw report, Universidad Nacional de Colombia, text lines 206-253.
    Difference: line 222 prints a final rate of 6.45 rad/s; 2 peak T/3 is 6.472 rad/s, its 62
    turns/min.
    >>> [round(float(value), 3) for value in motor(turn_time())]
    [6.283, 6.472, 0.0]
    """
    t, total = np.asarray(time, float), turn_time(peak)
    check_finite(time=t)
    if not np.all(t >= 0.0):
        raise ValueError(f"time must not be negative [s], got {t.min()}")
    third, cruise = total / 3.0, np.maximum(t - total, 0.0)
    rise, hold, fall = (np.clip(t - k * third, 0.0, third) for k in range(3))  # time in each third
    jerk = peak / third
    angle = jerk * (rise**3 - fall**3) / 6.0 + peak * (
        (hold**2 + fall**2) / 2.0 + third * (0.5 * hold + 1.5 * fall + 2.0 * cruise)
    )
    rate = jerk * (rise**2 - fall**2) / 2.0 + peak * (hold + fall)
    return np.asarray(angle), np.asarray(rate), np.asarray(jerk * (rise - fall))


def newton_sweep(
    angle: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    simultaneous: bool = True,
    reduced: bool = False,
    guess: ArrayLike = SWEEP_GUESS,
    tolerance: float = 1e-6,
) -> dict[str, Array]:
    """Sweep by Newton-Raphson with continuation: a pose is the first guess of the next pose.

    Parameters
    ----------
    angle, rate, acceleration : array_like (n,)
        Crank angle [rad] and its derivatives [rad/s, rad/s^2], broadcast together.
    crank, coupler, offset : float
        Lengths [m], see `proofmass.analytic.linkages.hacksaw.solve`.
    simultaneous, reduced : bool
        See `newton_pose`, `newton_system`.
    guess : array_like (9,)
        First guess of the first pose, in the order of `UNKNOWNS` [SI]; it determines which of four
        solutions is followed: two assembly modes, each with either sign of r1.
    tolerance : float
        Largest norm of the last step [SI], units mixed.

    Returns
    -------
    dict of ndarray (n,)
        The nine curves of `UNKNOWNS` [SI], the number of iterations [1] and the norm of the last
        step [SI]; in the sequential form the sum and the largest value of the three systems.

    Raises
    ------
    NotConverged
        A ValueError: there is no root after 50 iterations. The message gives the first such angle.
        The cause may be a loop that cannot be closed, a length of zero or a poor guess.
    ValueError
        A value not finite.

    Notes
    -----
    The curves agree with `proofmass.analytic.linkages.hacksaw.solve` within 1e-13 in the
    simultaneous and 2e-12 in the sequential form, at the report's tolerance of 1e-6. Source: power
    hacksaw report, Universidad Nacional de Colombia, text lines 340-345, 655-686, 1650-1760.

    Examples
    --------
    >>> link = {"crank": 0.075, "coupler": 0.170, "offset": 0.045}
    >>> sweep = newton_sweep([0.0, 0.05], 0.0, 0.0, **link)
    >>> [round(float(r1), 6) for r1 in sweep["r1"]]
    [-0.099672, -0.100635]
    """
    check_number(crank=crank, coupler=coupler, offset=offset)
    crank_motions = broadcast_motion(angle=angle, rate=rate, acceleration=acceleration)
    x, rows = np.asarray(guess, float), []
    for crank_motion in np.stack(crank_motions, axis=-1):
        try:
            x, logs = newton_pose(
                crank_motion,
                x,
                crank=crank,
                coupler=coupler,
                offset=offset,
                simultaneous=simultaneous,
                reduced=reduced,
                tolerance=tolerance,
                max_iterations=50,
            )
        except NotConverged as error:
            raise type(error)(f"at angle {crank_motion[0]:.9g} rad: {error}", error.log) from None
        last = max(float(np.linalg.norm(np.diff(log.iterates[-2:], axis=0))) for log in logs)
        rows.append([*x, sum(log.iterations for log in logs), last])
    names = *UNKNOWNS, "iterations", "last_step"
    return dict(zip(names, np.reshape(rows, (-1, len(names))).T, strict=True))


def newton_pose(
    crank_motion: ArrayLike,
    guess: ArrayLike,
    *,
    crank: float,
    coupler: float,
    offset: float,
    simultaneous: bool = True,
    reduced: bool = False,
    tolerance: float = 1e-6,
    max_iterations: int = 15,
) -> tuple[Array, list[NewtonLog]]:
    """Solve one pose: the nine unknowns, and the log of each system of equations.

    Parameters
    ----------
    crank_motion : array_like (3,)
        Crank angle, rate and acceleration [SI].
    guess : array_like (9,)
        First iterate, in the order of `UNKNOWNS` [SI].
    crank, coupler, offset : float
        Lengths [m].
    simultaneous : bool
        Whether one system of nine equations is solved; otherwise there are three systems of three
        equations, for positions, rates and accelerations, each with the results of those before it.
    reduced : bool
        See `newton_system`.
    tolerance : float
        Largest norm of the last step [SI], units mixed; by default that of the report for one pose.
    max_iterations : int
        Largest number of iterations of a system; by default that of the report for one pose.

    Returns
    -------
    unknowns : ndarray (9,)
        Solution in the order of `UNKNOWNS` [SI].
    logs : list of NewtonLog
        One log, or three in the sequential form.
    """
    x, lengths = np.array(guess, float), (crank, coupler, offset)
    if simultaneous:
        log = newton_raphson(
            lambda q: newton_system(q, crank_motion, *lengths, reduced=reduced),
            x,
            tolerance=tolerance,
            max_iterations=max_iterations,
            names=UNKNOWNS,
        )
        return np.array(log.root), [log]
    logs = []
    for order in range(3):
        part = slice(3 * order, 3 * order + 3)

        def block(q: Array, part: slice = part) -> tuple[Array, Array]:
            x[part] = q
            residual, jacobian = newton_system(x, crank_motion, *lengths, reduced=reduced)
            return residual[part], jacobian[part, part]

        logs.append(
            newton_raphson(
                block,
                x[part],
                tolerance=tolerance,
                max_iterations=max_iterations,
                names=UNKNOWNS[part],
            )
        )
        x[part] = logs[-1].root
    return x, logs


def newton_system(
    unknowns: Array,
    crank_motion: ArrayLike,
    crank: float,
    coupler: float,
    offset: float,
    *,
    reduced: bool = False,
) -> tuple[Array, Array]:
    r"""The nine loop equations F (9,) and their Jacobian (9, 9).

    With z1 = r1 exp(i theta1), z2 and z3 in the same way, and k = 0, 1, 2 time derivatives (dots)::

        F_3k   = Im z1 (less the offset if k = 0)         guide
        F_3k+1 = Re(z2 + z3 - z1)                         loop along x
        F_3k+2 = -Im(z2 + z3 - z1)                        loop along y

    J is block triangular. Since dz/dt = (dz/dq) dq/dt, the derivative of z with k dots by q with j
    dots is binomial(k, j) times dz/dq with k - j dots. Each block on the diagonal is therefore the
    Jacobian of the positions.

    Parameters
    ----------
    unknowns : ndarray (9,)
        Unknowns in the order of `UNKNOWNS` [SI].
    crank_motion : array_like (3,)
        Crank angle, rate and acceleration [SI].
    crank, coupler, offset : float
        Lengths [m].
    reduced : bool
        Whether r1 = offset/sin(theta1) is substituted in the two loop rows of position, as in the
        report's codes for a single pose (text lines 1296, 1304), but not in the code of its sweep.

    Returns
    -------
    residual : ndarray (9,)
        [SI]
    jacobian : ndarray (9, 9)
        [SI]

    Notes
    -----
    Source: text lines 300-338, where 300 and 302 print theta2 for theta3; Jacobian text lines
    398-456 and 1109, where line 1109 prints columns 7, 8 of row 7 as 2 theta1' cos(theta1),
    cos(theta1). Difference: the rows of rates have the order guide, x, y, as those of position and
    acceleration have.
    """
    r1, theta1, theta3 = (unknowns[i::3] for i in range(3))  # values and their two derivatives
    along, z2, z3 = (
        _rotation_derivatives(theta1),
        crank * _rotation_derivatives(crank_motion),
        coupler * _rotation_derivatives(theta3),
    )
    z1 = np.array([sum(comb(k, j) * r1[j] * along[k - j] for j in range(k + 1)) for k in range(3)])
    violation = z2 + z3 - z1
    residual = np.stack([z1.imag, violation.real, -violation.imag], 1)
    residual[0, 0] -= offset
    guide, loop = np.array([[along, 1j * z1, 0.0 * z1], [-along, -1j * z1, 1j * z3]])
    slopes = np.stack([guide.imag, loop.real, -loop.imag])  # rows, unknowns, time derivatives
    jacobian = np.block(
        [[comb(k, j) * slopes[..., max(k - j, 0)] for j in range(3)] for k in range(3)]
    )
    if reduced:
        c, s = np.cos(theta1[0]), np.sin(theta1[0])
        residual[0, 1:] += (r1[0] - offset / s) * c, offset - r1[0] * s
        jacobian[1:3, :2] = [[0.0, offset / s**2], [0.0, 0.0]]
    return residual.ravel(), jacobian


def _rotation_derivatives(motion: ArrayLike) -> Complex:
    """exp(i angle) and its first two time derivatives, from angle, rate and acceleration."""
    angle, rate, acceleration = np.asarray(motion)
    return np.exp(1j * angle) * np.array([1.0, 1j * rate, 1j * acceleration - rate**2])


def newton_course(
    *, crank: float, coupler: float, offset: float, guess: tuple[float, ...] = FIRST_GUESS
) -> Chart:
    """Unknowns over the iterations of one pose at rest, in the sequential and simultaneous form.

    Parameters
    ----------
    crank, coupler, offset : float
        Lengths [m].
    guess : tuple of float
        Nine first values, in the order of `UNKNOWNS` [SI].

    Returns
    -------
    Chart
        Four panels: positions, rates, accelerations, and all nine unknowns at once.
    """
    return course_chart(
        logs_of_start(crank, coupler, offset, guess),
        "Crank at 0, at rest: the unknowns from the report's first guess on. With known "
        "positions the equations are linear in the rates, and with known rates in the "
        "accelerations: one step of the sequential form finds them, and the next step confirms "
        "them. In the simultaneous form they converge after the positions.",
    )


def newton_convergence(
    *, crank: float, coupler: float, offset: float, guess: tuple[float, ...] = FIRST_GUESS
) -> Chart:
    """Steps and residuals over the iterations of one pose at rest.

    Parameters
    ----------
    crank, coupler, offset : float
        Lengths [m].
    guess : tuple of float
        Nine first values, in the order of `UNKNOWNS` [SI].

    Returns
    -------
    Chart
        Four panels, as in `newton_course`.

    Examples
    --------
    >>> chart = newton_convergence(crank=0.075, coupler=0.170, offset=0.045)
    >>> [panel.title for panel in chart.panels][-1]
    'simultaneous: 5 iterations'
    """
    logs = logs_of_start(crank, coupler, offset, guess)
    return convergence_chart(
        {f"{title}: {log.iterations} iterations": log for title, log in logs.items()},
        "Size of the step of each unknown, of the whole step, which the report calls the error and "
        "stops at 1e-6, and of the residual before the step. Each step is about the square of the "
        "step before: its exponent doubles. Sizes below 1e-17 are left out.",
    )


def logs_of_start(
    crank: float, coupler: float, offset: float, guess: tuple[float, ...]
) -> dict[str, NewtonLog]:
    """Logs of both forms for the crank at angle 0 and at rest, by the titles of their panels."""
    if len(guess) != len(UNKNOWNS):
        raise ValueError(f"guess must be {len(UNKNOWNS)} numbers, got {len(guess)}")
    sequential, (simultaneous,) = (
        newton_pose(
            (0.0, 0.0, 0.0),
            guess,
            crank=crank,
            coupler=coupler,
            offset=offset,
            simultaneous=form,
            reduced=True,  # as in the report's codes for a single pose
        )[1]
        for form in (False, True)
    )
    return {**dict(zip(SEQUENTIAL_TITLES, sequential, strict=True)), "simultaneous": simultaneous}


def newton_steps(
    *, crank: float, coupler: float, offset: float, mode: int = 1, peak: float = 5.0
) -> Chart:
    """Last step of each pose of the report's sweep, and the difference of both forms.

    Parameters
    ----------
    crank, coupler, offset : float
        Lengths [m].
    mode : int
        Assembly mode of `solve`.
    peak : float
        Largest acceleration of the motor [rad/s^2].

    Returns
    -------
    Chart
        Three panels over time: last steps of the simultaneous form, of the sequential form, and
        norm of the difference of both solutions.
    """
    time, sweeps, _ = report_sweeps(crank, coupler, offset, mode, peak, (True, False))
    steps = [
        Panel(
            (ChartLine(time, sweep["last_step"], "last step"),),
            title=f"{FORM_NAMES[form]}: at most {np.max(sweep['last_step']):.2g}",
        )
        for form, sweep in sweeps.items()
    ]
    difference = np.linalg.norm(
        [sweeps[True][name] - sweeps[False][name] for name in UNKNOWNS], axis=0
    )
    return Chart(
        ("time", "s"),
        ("norm, SI units", ""),
        (
            *steps,
            Panel(
                (ChartLine(time, difference, "difference of both forms"),),
                title=f"difference: at most {difference.max():.2g}",
            ),
        ),
        "The last steps are below the report's bound of 1e-6. The error after the last step is "
        "about its square, so that both forms agree to about 1e-12.",
        logarithmic=True,
    )


def newton_errors(
    *, crank: float, coupler: float, offset: float, mode: int = 1, peak: float = 5.0
) -> Chart:
    """Errors of the nine unknowns of the simultaneous form against the closed form, over time.

    Parameters
    ----------
    crank, coupler, offset : float
        Lengths [m].
    mode : int
        Assembly mode of `solve`.
    peak : float
        Largest acceleration of the motor [rad/s^2].

    Returns
    -------
    Chart
        A panel for each unknown.
    """
    time, sweeps, reference = report_sweeps(crank, coupler, offset, mode, peak, (True,))
    panels = []
    for name, unit in zip(UNKNOWNS, UNKNOWN_UNITS, strict=True):
        error = np.abs(sweeps[True][name] - reference[name])
        panels.append(
            Panel(
                (ChartLine(time, error, "|Newton-Raphson - closed form|"),),
                title=f"{name}: at most {error.max():.2g} {unit}",
            )
        )
    return Chart(
        ("time", "s"),
        ("error, SI units", ""),
        tuple(panels),
        "Errors of the simultaneous form, whose last step is below 1e-6: they are rounding errors. "
        "Poses without any error are gaps. The report finds 1e-15 for positions and rates, 1e-14 "
        "for accelerations.",
        logarithmic=True,
    )


def report_sweeps(
    crank: float, coupler: float, offset: float, mode: int, peak: float, forms: tuple[bool, ...]
) -> tuple[Array, dict[bool, dict[str, Array]], dict[str, Array]]:
    """Times of the report's sweep [s], its results by form, and the closed form at these times."""
    time = np.linspace(0.0, 2.0 * turn_time(peak), SWEEP_POSES)
    crank_motion = motor(time, peak=peak)
    reference = solve(*crank_motion, crank=crank, coupler=coupler, offset=offset, mode=mode)
    start = [reference[name][0] for name in UNKNOWNS]
    guess = np.round(start, 4)  # rounded as the first guess of the report: text line 1712
    sweeps = {
        form: newton_sweep(
            *crank_motion,
            crank=crank,
            coupler=coupler,
            offset=offset,
            guess=guess,
            simultaneous=form,
        )
        for form in forms
    }
    return time, sweeps, reference


class Hacksaw(ClosedForm, function=solve):
    """Power hacksaw: offset slider-crank with the slider on a guide above the crank axis."""

    covers_inertia = True
    selects = True
    charts = (
        newton_convergence,
        newton_course,
        newton_errors,
        newton_steps,
    )
    profiles = (motor,)

    crank: Length
    coupler: Length
    offset: Position
    mode: Mode
    cutting_force: VaryingForce
    crank_mass: Mass
    coupler_mass: Mass
    slider_mass: Mass
    gravity: Acceleration
