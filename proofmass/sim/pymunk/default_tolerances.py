"""How far pymunk may be off a driven linkage, and why: for cases without a tolerance of their own.

The shares hold for steps of 1 ms with `error_bias` 0, proofmass's own settings.
"""

from proofmass.sim.protocol import AccuracyLimit

ACCURACY = {
    "sweep": AccuracyLimit(
        1e-12,
        "the engine's own steps until nothing moves by 1e-12 of the mechanism; "
        "rounding of its pose and velocity solution",
    ),
    "position": AccuracyLimit(
        1e-5,
        "second order in the step with error_bias = 0: positions advance with "
        "the old velocity; a step half as long gives a quarter",
    ),
    "velocity": AccuracyLimit(
        3e-5, "second order: mean of the velocities before and after the sample"
    ),
    "acceleration": AccuracyLimit(1e-4, "second order: central difference of those velocities"),
    "force": AccuracyLimit(
        3e-4, "second order: what the impulses of a step do to the velocities before and after it"
    ),
}
