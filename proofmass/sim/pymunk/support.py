"""What becomes of each feature of a model in pymunk; see `proofmass.analytic.support`.

pymunk has few of the features of MJCF.  A feature that is not named here is refused, so that a new
one is refused until pymunk has it.
"""

from proofmass.analytic.support import (
    ACTS,
    IN_TIME,
    IRRELEVANT,
    PARTLY,
    REFUSED,
    SAID,
    Answers,
    FeatureAnswer,
    RunKind,
    answers,
    covers,
)

KINDS = tuple(kind for kind in RunKind if kind != RunKind.SETTLED_SWEEP)
POSES = tuple(kind for kind in KINDS if kind not in IN_TIME)
"""Runs without forces of motion: a sweep with inertia has no moments in pymunk."""
ONLY_IN_TIME = answers(KINDS, ACTS, irrelevant=POSES)
ON_DRIVE = answers(KINDS, IRRELEVANT, refused=(RunKind.DRIVEN_MOTION,))
FRICTION = answers(
    KINDS,
    ACTS,
    partly=(RunKind.FREE_SWEEP,),
    refused=(RunKind.EQUILIBRIUM,),
    withheld=(RunKind.DRIVEN_MOTION,),
)
FRICTION_ON_DRIVE = answers(
    KINDS, ACTS, partly=(RunKind.FREE_SWEEP,), refused=(RunKind.EQUILIBRIUM,)
)
ACTING = (
    "stiffness of a joint",
    "polynomial stiffness of a joint",
    "actuatorfrcrange of a joint with motors",
    "joint equality, of hinges on the ground or of a planet and its arm",
    "stiffness of a tendon",
    "an actuator, which is a motor on a joint",
    "an actuator, which is a servo on a joint",
    "ctrlrange of an actuator",
    "forcerange of a motor",
)
"""The features that act in all kinds of runs."""
OTHERS: dict[str, Answers | FeatureAnswer] = {
    "damping of a joint": ONLY_IN_TIME,
    "frictionloss of a joint": FRICTION,
    "frictionloss of a driven joint": FRICTION_ON_DRIVE,
    "armature of a hinge on the ground": ONLY_IN_TIME,
    "range of a joint": PARTLY,
    "actuatorfrcrange of a driven joint": IRRELEVANT,
    "connect equality": PARTLY,
    "damping of a tendon": ONLY_IN_TIME,
    "an actuator, which is a motor on a site whose refsite, if any, is of the ground": PARTLY,
    "armature of an actuator on a driven joint": ON_DRIVE,
    "damping of an actuator on a driven joint": ON_DRIVE,
    "polynomial damping of an actuator on a driven joint": ON_DRIVE,
    "force of an actuator on a driven joint": IRRELEVANT,
    "contacts": PARTLY,
    "rates of the key": ONLY_IN_TIME,
    "time of the key": IRRELEVANT,
    "integrator or solver of the options": IRRELEVANT,
    "discrete inverse dynamics": IRRELEVANT,
    "sleep of bodies at rest": IRRELEVANT,
    "magnetic field": IRRELEVANT,
    "cutoff of a sensor": SAID,
    "delay of a sensor": SAID,
    "interval of a sensor": SAID,
    "noise of a sensor": IRRELEVANT,
}
SUPPORT = covers(KINDS, {**dict.fromkeys(ACTING, ACTS), **OTHERS}, usual=REFUSED)
"""Of all kinds of runs of pymunk."""
