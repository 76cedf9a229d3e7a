"""What becomes of each feature of a model in the planar reference."""

from proofmass.analytic.support import (
    ACTS,
    IRRELEVANT,
    PARTLY,
    REFERENCE_KINDS,
    REFUSED,
    STEPS_AND_SENSORS,
    Answers,
    FeatureAnswer,
    RunKind,
    answers,
    covers,
)

K = RunKind
SWEEPS_AT_REST = K.SWEEP, K.FREE_SWEEP
AT_REST_NOTHING = answers(REFERENCE_KINDS, ACTS, irrelevant=SWEEPS_AT_REST)
ON_DRIVE = answers(REFERENCE_KINDS, REFUSED, irrelevant=SWEEPS_AT_REST)
FRICTION = answers(REFERENCE_KINDS, ACTS, refused=(K.FREE_SWEEP,))
EXCEPTIONS: dict[str, Answers | FeatureAnswer] = {
    "ball joint": REFUSED,
    "free joint": REFUSED,
    "polynomial stiffness of a ball or free joint": REFUSED,
    "spring that yields of a joint": REFUSED,
    "damping of a joint": AT_REST_NOTHING,
    "polynomial damping of a joint": AT_REST_NOTHING,
    "polynomial damping of a driven joint": AT_REST_NOTHING,
    "frictionloss of a joint": FRICTION,
    "frictionloss of a driven joint": FRICTION,
    "armature of a hinge on the ground": AT_REST_NOTHING,
    "armature of a joint, which is no single hinge on the ground": AT_REST_NOTHING,
    "range of a joint": PARTLY,
    "range of a ball joint": REFUSED,
    "margin of the range of a joint": PARTLY,
    "actuatorfrcrange of a joint with a servo": REFUSED,
    "actuatorfrcrange of a joint beside actuators that act elsewhere": REFUSED,
    "actuatorfrcrange of a driven joint": IRRELEVANT,
    "gravcomp of a body": REFUSED,
    "mocap body": PARTLY,
    "density or viscosity of the options": REFUSED,
    "flex": REFUSED,
    "plugin": REFUSED,
    "connect equality": PARTLY,
    "weld equality": REFUSED,
    "tendon equality, of ways in space": REFUSED,
    "equality of a flex": REFUSED,
    "a tendon, which goes by several sites": REFUSED,
    "a tendon, which goes around a geom or a pulley": REFUSED,
    "damping of a tendon": AT_REST_NOTHING,
    "polynomial damping of a tendon": AT_REST_NOTHING,
    "frictionloss of a tendon": REFUSED,
    "range of a tendon": REFUSED,
    "margin of the range of a tendon": REFUSED,
    "armature of a tendon": REFUSED,
    "spring that yields of a tendon": REFUSED,
    "actuatorfrcrange of a tendon": REFUSED,
    "an actuator, which is a motor on a site whose refsite, if any, is of the ground": PARTLY,
    "an actuator, which is a servo on such a site": REFUSED,
    "an actuator, which acts on a tendon": REFUSED,
    "an actuator, which acts on a ball or a free joint": REFUSED,
    "an actuator, which acts at a site whose refsite moves, on a crank or on a body": REFUSED,
    "activation of an actuator": REFUSED,
    "gain or bias that is not affine of an actuator": REFUSED,
    "delay of an actuator": REFUSED,
    "armature of an actuator": REFUSED,
    "armature of an actuator on a driven joint": ON_DRIVE,
    "damping of an actuator": REFUSED,
    "damping of an actuator on a driven joint": ON_DRIVE,
    "polynomial damping of an actuator": REFUSED,
    "polynomial damping of an actuator on a driven joint": ON_DRIVE,
    "force of an actuator on a driven joint": IRRELEVANT,
    "contacts": answers(
        REFERENCE_KINDS,
        REFUSED,
        said=(K.SWEEP, K.MOVING_SWEEP),
        partly=(K.DRIVEN_MOTION,),
    ),
    "rates of the key": answers(
        REFERENCE_KINDS, ACTS, irrelevant=(K.SWEEP, K.FREE_SWEEP, K.MOVING_SWEEP)
    ),
    **STEPS_AND_SENSORS,
}
SUPPORT = covers(REFERENCE_KINDS, EXCEPTIONS)
"""Of the runs of the planar reference."""
