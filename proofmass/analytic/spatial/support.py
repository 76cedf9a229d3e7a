"""What becomes of each feature of a model in the spatial reference."""

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
FRICTION = answers(REFERENCE_KINDS, PARTLY, refused=(K.FREE_SWEEP,))
EXCEPTIONS: dict[str, Answers | FeatureAnswer] = {
    "polynomial stiffness of a ball or free joint": REFUSED,
    "spring that yields of a joint": REFUSED,
    "damping of a joint": AT_REST_NOTHING,
    "polynomial damping of a joint": AT_REST_NOTHING,
    "polynomial damping of a driven joint": AT_REST_NOTHING,
    "frictionloss of a joint": FRICTION,
    "frictionloss of a driven joint": answers(REFERENCE_KINDS, ACTS, refused=(K.FREE_SWEEP,)),
    "armature of a hinge on the ground": AT_REST_NOTHING,
    "armature of a joint, which is no single hinge on the ground": AT_REST_NOTHING,
    "range of a joint": PARTLY,
    "range of a ball joint": REFUSED,
    "margin of the range of a joint": PARTLY,
    "actuatorfrcrange of a driven joint": IRRELEVANT,
    "mocap body": PARTLY,
    "density or viscosity of the options": REFUSED,
    "flex": REFUSED,
    "plugin": REFUSED,
    "connect equality": PARTLY,
    "weld equality": PARTLY,
    "tendon equality, of ways in space": PARTLY,
    "equality of a flex": REFUSED,
    "a tendon, which goes around a geom or a pulley": REFUSED,
    "damping of a tendon": AT_REST_NOTHING,
    "polynomial damping of a tendon": AT_REST_NOTHING,
    "frictionloss of a tendon": REFUSED,
    "range of a tendon": PARTLY,
    "margin of the range of a tendon": PARTLY,
    "armature of a tendon": REFUSED,
    "spring that yields of a tendon": REFUSED,
    "actuatorfrcrange of a tendon": REFUSED,
    "an actuator, which is a servo on such a site": REFUSED,
    "an actuator, which acts on a ball or a free joint": REFUSED,
    "an actuator, which acts at a site whose refsite moves, on a crank or on a body": REFUSED,
    "activation of an actuator": REFUSED,
    "gain or bias that is not affine of an actuator": REFUSED,
    "delay of an actuator": REFUSED,
    "armature of an actuator": REFUSED,
    "armature of an actuator on a driven joint": REFUSED,
    "damping of an actuator": REFUSED,
    "damping of an actuator on a driven joint": REFUSED,
    "polynomial damping of an actuator": REFUSED,
    "polynomial damping of an actuator on a driven joint": REFUSED,
    "force of an actuator on a driven joint": PARTLY,
    "contacts": PARTLY,
    "rates of the key": answers(
        REFERENCE_KINDS, ACTS, irrelevant=(K.SWEEP, K.FREE_SWEEP, K.MOVING_SWEEP)
    ),
    **STEPS_AND_SENSORS,
}
SUPPORT = covers(REFERENCE_KINDS, EXCEPTIONS)
"""Of the runs of the spatial reference."""
