"""Charts of the power hacksaw by Newton-Raphson: how it converges, and what it is off by.

All take the lengths of `solve`. The crank follows the report's motor over twice its run-up, as in
the report's own figures.
"""

import numpy as np

from proofmass.analytic.chart import Chart, ChartLine, Panel
from proofmass.analytic.linkages.hacksaw.kinematics import motor, solve, turn_time
from proofmass.analytic.linkages.hacksaw.newton import (
    FIRST_GUESS,
    NAMES,
    newton_pose,
    newton_sweep,
)
from proofmass.analytic.newton_raphson import NewtonLog, convergence, course
from proofmass.analytic.numerics import Array

UNITS = ("m", "rad", "rad", "m/s", "rad/s", "rad/s", "m/s²", "rad/s²", "rad/s²")
PANELS = ("sequential: positions", "sequential: rates", "sequential: accelerations")
POSES = 1000  # of the report's grid
FORMS = {True: "simultaneous", False: "sequential"}


def newton_course(
    *, crank: float, coupler: float, offset: float, guess: tuple[float, ...] = FIRST_GUESS
) -> Chart:
    """Unknowns over the iterations of one pose at rest, sequential and simultaneous.

    Parameters
    ----------
    crank, coupler, offset : float
        Lengths [m].
    guess : tuple of float
        Nine first values, in the order of `NAMES` [SI].

    Returns
    -------
    Chart
        Four panels: positions, rates, accelerations, all nine at once.
    """
    return course(
        logs_of_start(crank, coupler, offset, guess),
        "Crank at 0, at rest: the unknowns from the report's first guess on. Rates and "
        "accelerations are linear in themselves: one step of the sequential form finds them, the "
        "next confirms it. The simultaneous form has to wait for the positions.",
    )


def newton_convergence(
    *, crank: float, coupler: float, offset: float, guess: tuple[float, ...] = FIRST_GUESS
) -> Chart:
    """Errors and residuals over the iterations of one pose at rest.

    Parameters
    ----------
    crank, coupler, offset : float
        Lengths [m].
    guess : tuple of float
        Nine first values, in the order of `NAMES` [SI].

    Returns
    -------
    Chart
        Four panels, as `newton_course`.

    Examples
    --------
    >>> chart = newton_convergence(crank=0.075, coupler=0.170, offset=0.045)
    >>> [panel.title for panel in chart.panels][-1]
    'simultaneous: 5 iterations'
    """
    logs = logs_of_start(crank, coupler, offset, guess)
    return convergence(
        {f"{title}: {log.iterations} iterations": log for title, log in logs.items()},
        "Size of the step of each unknown, of the whole step, which the report calls the error and "
        "stops at 1e-6, and of the residual before it. Each step is about the square of the last: "
        "its exponent doubles. What is below 1e-17 is left out.",
    )


def logs_of_start(
    crank: float, coupler: float, offset: float, guess: tuple[float, ...]
) -> dict[str, NewtonLog]:
    """Logs of both forms at rest with the crank at 0, by the titles of their panels."""
    if len(guess) != len(NAMES):
        raise ValueError(f"guess must be {len(NAMES)} numbers, got {len(guess)}")
    each, (whole,) = (
        newton_pose(
            (0.0, 0.0, 0.0),
            guess,
            crank=crank,
            coupler=coupler,
            offset=offset,
            simultaneous=form,
            reduced=True,  # as the report's codes for a single pose
        )[1]
        for form in (False, True)
    )
    return {**dict(zip(PANELS, each, strict=True)), "simultaneous": whole}


def newton_steps(
    *, crank: float, coupler: float, offset: float, mode: int = 1, peak: float = 5.0
) -> Chart:
    """Last step of each pose of the report's sweep, and how far both forms differ.

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
        Panels of simultaneous and sequential steps over time, and of the norm of the difference.
    """
    time, sweeps, _ = swept(crank, coupler, offset, mode, peak, (True, False))
    steps = [
        Panel(
            (ChartLine(time, sweep["last_step"], "last step"),),
            title=f"{FORMS[form]}: at most {np.max(sweep['last_step']):.2g}",
        )
        for form, sweep in sweeps.items()
    ]
    apart = np.linalg.norm([sweeps[True][name] - sweeps[False][name] for name in NAMES], axis=0)
    return Chart(
        ("time", "s"),
        ("norm, SI units", ""),
        (
            *steps,
            Panel(
                (ChartLine(time, apart, "difference of both forms"),),
                title=f"difference: at most {apart.max():.2g}",
            ),
        ),
        "Steps end below the report's bound of 1e-6. The error that is left is about the square of "
        "the last step, so that both forms agree to about 1e-12.",
        logarithmic=True,
    )


def newton_errors(
    *, crank: float, coupler: float, offset: float, mode: int = 1, peak: float = 5.0
) -> Chart:
    """The nine errors of the simultaneous form against the closed form, over the report's sweep.

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
    time, sweeps, truth = swept(crank, coupler, offset, mode, peak, (True,))
    panels = []
    for name, unit in zip(NAMES, UNITS, strict=True):
        error = np.abs(sweeps[True][name] - truth[name])
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
        "Errors of the simultaneous form, whose last step is below 1e-6: what is left is rounding. "
        "Poses without any error are gaps. The report finds 1e-15 for positions and rates, 1e-14 "
        "for accelerations.",
        logarithmic=True,
    )


def swept(
    crank: float, coupler: float, offset: float, mode: int, peak: float, forms: tuple[bool, ...]
) -> tuple[Array, dict[bool, dict[str, Array]], dict[str, Array]]:
    """Times of the report's grid [s], sweeps by form, and the closed form at the same states."""
    time = np.linspace(0.0, 2.0 * turn_time(peak), POSES)
    law = motor(time, peak=peak)
    truth = solve(*law, crank=crank, coupler=coupler, offset=offset, mode=mode)
    guess = np.round([truth[name][0] for name in NAMES], 4)  # as the report starts: text line 1712
    sweeps = {
        form: newton_sweep(
            *law, crank=crank, coupler=coupler, offset=offset, guess=guess, simultaneous=form
        )
        for form in forms
    }
    return time, sweeps, truth
