"""How far MuJoCo may be off a driven linkage, and why: for cases without a tolerance of their own.

The shares hold for RK4 at 1 ms with `solref` 0.005 and `solimp` 0.9999, as the shipped models have.
"""

from proofmass.sim.protocol import AccuracyLimit

ACCURACY = {
    "sweep": AccuracyLimit(
        1e-12, "loops closed by Newton on the engine's constraint rows: rounding only"
    ),
    "rest": AccuracyLimit(
        1e-10,
        "stiffness by differences of the engine's forces: 1e-12 of it, over the least stiffness of "
        "what the drives leave",
    ),
    "position": AccuracyLimit(
        1e-6,
        "RK4: what is left is the softness of the loops, a floor of solref and "
        "solimp that no smaller step lowers",
    ),
    "velocity": AccuracyLimit(5e-6, "softness of the loops, differentiated once"),
    "acceleration": AccuracyLimit(
        1e-3,
        "solimp is capped at 0.9999, so 1e-4 of the acceleration that "
        "gravity would give the open loops remains; and RK4's own error in the "
        "spring and damper that holds a loop, 4th order in step over solref",
    ),
    "force": AccuracyLimit(
        1e-3, "forces go with accelerations, of which the softness of the loops leaves a part"
    ),
}
