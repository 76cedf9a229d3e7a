"""General solver of motions in phases, each of which ends at an event such as an impact."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

State = np.ndarray
Phase = tuple[Callable, Callable, Callable]
"""Functions of a state: its rates, a value that is zero at the end of the phase, the next phase."""


def solve_phases(phase: Phase, state: Sequence[float], times: np.ndarray) -> np.ndarray:
    """States (n, size) at rising times, by DOP853 from event to event (rtol 1e-13, atol 1e-14).

    A phase is ``(rates, ends, after)``.  ``rates(state)`` returns the rates of the state.
    ``ends(state)`` is positive at the start of the phase and falls through zero at its end.
    ``after(state)`` returns the next phase and its first state.
    """
    found, now, state = np.empty((len(times), len(state))), times[0], np.asarray(state, float)
    found[0] = state
    k = 1
    while k < len(times):
        rates, ends, after = phase

        def event(t, y, ends=ends):
            return ends(y)

        event.terminal, event.direction = True, -1
        done = solve_ivp(
            lambda t, y, rates=rates: rates(y),
            (now, times[-1]),
            state,
            "DOP853",
            events=event,
            dense_output=True,
            rtol=1e-13,
            atol=1e-14,
        )
        assert done.success, done.message
        while k < len(times) and times[k] <= done.t[-1]:
            found[k] = done.sol(times[k])
            k += 1
        if not done.t_events[0].size:
            return found
        now = done.t[-1]
        phase, state = after(done.y[:, -1])
    return found
