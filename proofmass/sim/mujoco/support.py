"""What becomes of each feature of a model in MuJoCo's runs; see `proofmass.analytic.support`.

MuJoCo has all features of its own format.  Quasi-static runs are poses of proofmass's own Newton
method on MuJoCo's forces: whatever has a state that only time moves is refused there.
"""

from proofmass.analytic.support import (
    ACTS,
    ALL_KINDS,
    AT_REST,
    IRRELEVANT,
    QUASI_STATIC,
    REFUSED,
    SAID,
    Answers,
    FeatureAnswer,
    RunKind,
    answers,
    covers,
)

K = RunKind
AT_REST_NOTHING = answers(ALL_KINDS, ACTS, irrelevant=AT_REST)
NEEDS_TIME = answers(ALL_KINDS, ACTS, refused=QUASI_STATIC)
"""The feature has a state, or depends on how a pose was reached."""
NO_STEPS = answers(
    ALL_KINDS, ACTS, irrelevant=(K.SWEEP, K.FREE_SWEEP, K.MOVING_SWEEP, K.EQUILIBRIUM)
)
ONLY_WITHOUT_DRIVES = answers(ALL_KINDS, REFUSED, acts=(K.EQUILIBRIUM, K.FREE_MOTION))
EXTRA_INERTIA = answers(ALL_KINDS, ACTS, irrelevant=AT_REST, withheld=(K.DRIVEN_MOTION,))
"""In time MuJoCo's inverse dynamics leaves it out of the moments of drives."""
RIGID_LIMIT_OF_SWEEPS = answers(
    ALL_KINDS, ACTS, refused=(K.SWEEP, K.FREE_SWEEP, K.MOVING_SWEEP, K.EQUILIBRIUM)
)
NOT_WITH_FREEDOM = answers(
    ALL_KINDS,
    ACTS,
    partly=(K.SWEEP, K.MOVING_SWEEP),
    refused=(K.FREE_SWEEP, K.SETTLED_SWEEP, K.EQUILIBRIUM),
)
EXCEPTIONS: dict[str, Answers | FeatureAnswer] = {
    "spring that yields of a joint": NEEDS_TIME,
    "spring that yields of a tendon": NEEDS_TIME,
    "damping of a joint": AT_REST_NOTHING,
    "polynomial damping of a joint": AT_REST_NOTHING,
    "polynomial damping of a driven joint": EXTRA_INERTIA,
    "frictionloss of a joint": answers(
        ALL_KINDS, ACTS, partly=(K.FREE_SWEEP,), refused=(K.SETTLED_SWEEP, K.EQUILIBRIUM)
    ),
    "frictionloss of a driven joint": answers(
        ALL_KINDS, ACTS, withheld=(K.DRIVEN_MOTION,), refused=(K.SETTLED_SWEEP, K.EQUILIBRIUM)
    ),
    "armature of a hinge on the ground": AT_REST_NOTHING,
    "armature of a joint, which is no single hinge on the ground": AT_REST_NOTHING,
    "range of a joint": answers(ALL_KINDS, ACTS, partly=(K.SWEEP, K.MOVING_SWEEP)),
    "range of a ball joint": NOT_WITH_FREEDOM,
    "margin of the range of a joint": RIGID_LIMIT_OF_SWEEPS,
    "weld equality": ONLY_WITHOUT_DRIVES,
    "tendon equality, of sums of joints": ONLY_WITHOUT_DRIVES,
    "tendon equality, of ways in space": ONLY_WITHOUT_DRIVES,
    "equality of a flex": REFUSED,
    "damping of a tendon": AT_REST_NOTHING,
    "polynomial damping of a tendon": AT_REST_NOTHING,
    "frictionloss of a tendon": NEEDS_TIME,
    "range of a tendon": NOT_WITH_FREEDOM,
    "margin of the range of a tendon": NEEDS_TIME,
    "armature of a tendon": EXTRA_INERTIA,
    "activation of an actuator": NEEDS_TIME,
    "delay of an actuator": answers(
        ALL_KINDS,
        ACTS,
        refused=(K.SWEEP, K.FREE_SWEEP, K.MOVING_SWEEP, K.EQUILIBRIUM),
        irrelevant=(K.SETTLED_SWEEP,),
    ),
    "armature of an actuator": EXTRA_INERTIA,
    "armature of an actuator on a driven joint": EXTRA_INERTIA,
    "damping of an actuator": AT_REST_NOTHING,
    "damping of an actuator on a driven joint": AT_REST_NOTHING,
    "polynomial damping of an actuator": AT_REST_NOTHING,
    "polynomial damping of an actuator on a driven joint": AT_REST_NOTHING,
    "force of an actuator on a driven joint": IRRELEVANT,
    "contacts": answers(ALL_KINDS, ACTS, partly=QUASI_STATIC),
    "rates of the key": answers(ALL_KINDS, ACTS, irrelevant=QUASI_STATIC),
    "time of the key": IRRELEVANT,
    "integrator or solver of the options": NO_STEPS,
    "discrete inverse dynamics": IRRELEVANT,
    "sleep of bodies at rest": answers(ALL_KINDS, ACTS, irrelevant=QUASI_STATIC),
    "magnetic field": IRRELEVANT,
    "cutoff of a sensor": SAID,
    "delay of a sensor": SAID,
    "interval of a sensor": SAID,
    "noise of a sensor": IRRELEVANT,
}
SUPPORT = covers(ALL_KINDS, EXCEPTIONS)
"""Of all kinds of runs."""
