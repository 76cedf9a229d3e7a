"""A host of the tests: one hinge under gravity, by semi-implicit Euler steps; and how hosts fail.

It runs in the interpreter of the tests, and needs NumPy and ``proofmass_host`` alone.
"""

import os
import signal
import sys
import time

import numpy as np
from proofmass_host import LinkStates, NeutralMechanism, Refused, record, turn_about

VERSIONS = {"swing": "1.0"}


def simulate(mechanism: NeutralMechanism, settings: dict) -> LinkStates:
    """Swing the only link about its only joint."""
    fail(settings.get("fails", ""))
    if len(mechanism.joints) != 1:
        raise Refused("more than one joint")
    joint, link = mechanism.joints[0], mechanism.links[1]
    arm = link.centre - joint.anchor
    inertia = joint.axis @ link.inertia @ joint.axis + link.mass * (arm @ arm)
    state = [0.0, joint.rate]
    h = mechanism.step

    def step(i):
        lever = turn_about(joint.axis, state[0]) @ arm
        moment = joint.axis @ np.cross(lever, link.mass * mechanism.gravity)
        state[1] += h * (moment + joint.force_in(i)) / inertia
        state[0] += h * state[1]

    def read(k):
        turn = turn_about(joint.axis, state[0])
        omega = state[1] * joint.axis
        return joint.anchor + turn @ arm, turn, np.cross(omega, turn @ arm), omega

    return record(mechanism, step, read)


def fail(how: str) -> None:
    """Fail in a way."""
    if how == "prints":
        print("the engine says something")
        os.write(1, b"and its C library too\n")
    elif how == "raises":
        raise ValueError("the engine is not content")
    elif how == "dies":
        os.write(2, b"the engine's last words\n")
        os.abort()
    elif how == "exits":
        sys.exit(3)
    elif how == "computes for ever":
        while True:
            pass
    elif how == "tells its timers":
        timers = signal.ITIMER_PROF, signal.ITIMER_REAL
        raise ValueError(" ".join(str(signal.getitimer(one)[0]) for one in timers))
    elif how == "tells its processors":
        raise ValueError(" ".join(map(str, sorted(os.sched_getaffinity(0)))))
    elif how == "eats memory":
        kept = [np.ones(2**27) for _ in range(10**6)]
        time.sleep(len(kept))
