"""Motion in phases, each of which ends at an event: a general solver for what impacts interrupt."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp

State = np.ndarray
Phase = tuple[Callable, Callable, Callable]
"""Rates of a state, what is zero at the end of the phase, and the next phase with its state."""


def follow(phase: Phase, state: Sequence[float], times: np.ndarray) -> np.ndarray:
    """States (n, size) at rising times, by DOP853 at 1e-13 from event to event.

    A phase is ``(rates, ends, after)``: ``rates(state)``; ``ends(state)`` falls through zero;
    ``after(state) -> (phase, state)``.  It is positive at the start of the phase.
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
