"""What becomes of each feature of a model in each kind of run, and the refusals that follow.

Every engine and every general reference has a `Support`: for each feature of
`proofmass.analytic.features` and each kind of run a `FeatureAnswer`.  Before a run, `examine` finds
what is refused by name, and what is left out.  The table in docs/engines.md is written from the
same data by ``python -m docs.make.features``.
"""

from collections.abc import Mapping
from enum import StrEnum

from proofmass.analytic.features import FEATURES, Scope
from proofmass.analytic.mjcf import ModelData
from proofmass.analytic.numerics import NotCovered


class RunKind(StrEnum):
    """Kinds of runs as far as features act differently in them."""

    SWEEP = "sweep"
    """At rest; the drives determine all joints."""
    FREE_SWEEP = "sweep with degrees of freedom left"
    MOVING_SWEEP = "sweep with inertia"
    SETTLED_SWEEP = "settled sweep"
    EQUILIBRIUM = "equilibrium"
    FREE_MOTION = "dynamics"
    DRIVEN_MOTION = "dynamics with drives"

    @property
    def in_words(self) -> str:
        """The kind in a sentence.

        >>> RunKind.SWEEP.in_words, RunKind.EQUILIBRIUM.in_words
        ('a sweep', 'equilibrium')
        """
        return f"a {self}" if "sweep" in self else str(self)


ALL_KINDS = tuple(RunKind)
AT_REST = (RunKind.SWEEP, RunKind.FREE_SWEEP, RunKind.SETTLED_SWEEP, RunKind.EQUILIBRIUM)
"""Runs without rates."""
QUASI_STATIC = (*AT_REST, RunKind.MOVING_SWEEP)
"""Runs that follow poses, not time."""
REFERENCE_KINDS = (
    RunKind.SWEEP,
    RunKind.FREE_SWEEP,
    RunKind.MOVING_SWEEP,
    RunKind.FREE_MOTION,
    RunKind.DRIVEN_MOTION,
)
"""Runs that the general references `planar` and `spatial` have."""
IN_TIME = (RunKind.FREE_MOTION, RunKind.DRIVEN_MOTION)
"""Runs in time."""


def run_kind(joints: tuple[str, ...], has_dof: bool, inertia: bool, in_time: bool) -> RunKind:
    """The kind of a run of a reference.

    `joints` are driven, `has_dof` is whether they leave degrees of freedom, and `in_time` whether
    they move in time.
    """
    if in_time or not joints:
        return RunKind.DRIVEN_MOTION if joints else RunKind.FREE_MOTION
    if has_dof:
        return RunKind.FREE_SWEEP
    return RunKind.MOVING_SWEEP if inertia else RunKind.SWEEP


class FeatureAnswer(StrEnum):
    """What becomes of a feature in a run."""

    ACTS = "acts"
    """The run has it."""
    REFUSED = "refused"
    """A model with it is not run; the error names the element."""
    PARTLY = "acts or refused"
    """It acts, or the run is refused by name, which depends on the mechanism or on its motion."""
    SAID = "left out"
    """The run leaves it out and says so."""
    WITHHELD = "withheld"
    """It acts on the motion; channels that it falsifies are not delivered, with the reason."""
    IRRELEVANT = "no effect"
    """It changes nothing in this kind of run."""


ACTS, REFUSED, PARTLY, SAID, WITHHELD, IRRELEVANT = FeatureAnswer
STEPS_AND_SENSORS: dict[str, FeatureAnswer] = dict.fromkeys(
    (
        "time of the key",
        "integrator or solver of the options",
        "discrete inverse dynamics",
        "sleep of bodies at rest",
        "magnetic field",
        "cutoff of a sensor",
        "delay of a sensor",
        "interval of a sensor",
        "noise of a sensor",
    ),
    IRRELEVANT,
)
"""The answers of references to features of time steps and of sensors: they have neither."""
Answers = Mapping[RunKind, FeatureAnswer]
Support = Mapping[str, Answers]
"""By the name of a feature, the answer for each kind of run that there is."""


def covers(
    kinds: tuple[RunKind, ...],
    exceptions: Mapping[str, Answers | FeatureAnswer],
    usual: FeatureAnswer = ACTS,
) -> Support:
    """A support of all features: the `usual` answer but for `exceptions`, by name.

    Raises
    ------
    KeyError
        There is no feature of that name.
    """
    if unknown := exceptions.keys() - FEATURES.keys():
        raise KeyError(f"no such features: {sorted(unknown)}")
    found = {name: exceptions.get(name, usual) for name in FEATURES}
    return {
        name: answers(kinds, own) if isinstance(own, FeatureAnswer) else own
        for name, own in found.items()
    }


def answers(
    kinds: tuple[RunKind, ...], usual: FeatureAnswer, **other: tuple[RunKind, ...]
) -> dict[RunKind, FeatureAnswer]:
    """The `usual` answer for all kinds of runs, but for those that are given for `other` ones.

    The keywords are names of answers.

    >>> answers((RunKind.SWEEP, RunKind.FREE_MOTION), ACTS, refused=(RunKind.SWEEP,)).values()
    dict_values([<FeatureAnswer.REFUSED: 'refused'>, <FeatureAnswer.ACTS: 'acts'>])
    """
    by_kind = {kind: FeatureAnswer[name.upper()] for name, there in other.items() for kind in there}
    return {kind: by_kind.get(kind, usual) for kind in kinds}


def examine(
    data: ModelData, support: Support, kind: RunKind | None, driven: tuple[int, ...] = ()
) -> tuple[list[str], list[str]]:
    """What a run of a model does not cover, and what it leaves out, in words.

    Parameters
    ----------
    data : ModelData
    support : mapping
        That of the engine or reference.
    kind : RunKind, optional
        If it is not known yet, only features with one answer for all kinds of runs are looked for.
    driven : tuple of int
        Numbers of the driven joints.

    Returns
    -------
    refused, said : list of str
        Such as ``armature of tendon 'rope'``.
    """
    scope = Scope(data, driven)
    found: dict[FeatureAnswer, list[str]] = {REFUSED: [], SAID: []}
    for name, by_kind in support.items():
        given = set(by_kind.values()) if kind is None else {by_kind[kind]}
        if len(given) == 1 and (own := found.get(given.pop())) is not None:
            feature = FEATURES[name]
            own += [feature.what.format(element) for element in feature.find(scope)]
    return found[REFUSED], found[SAID]


def left_out(data: ModelData, support: Support) -> tuple[str, ...]:
    """Remarks on what all runs of an engine leave out of a model, a sentence each."""
    return tuple(f"Left out: {words}." for words in examine(data, support, None)[1])


def refuse(
    data: ModelData, support: Support, kind: RunKind | None = None, driven: tuple[str, ...] = ()
) -> None:
    """Raise NotCovered if a reference does not cover a model; `driven` are names of joints.

    The message lists what is not covered, see `examine`.
    """
    numbers = tuple(j for j, joint in enumerate(data.joints) if joint.name in driven)
    if refused := examine(data, support, kind, numbers)[0]:
        where = f" in {kind.in_words}" if kind else ""
        raise NotCovered(f"{'; '.join(refused)}{where}")


def refuse_placed_bodies(data: ModelData) -> None:
    """Raise NotCovered if a key places a mocap body: a reference has it where the MJCF has it."""
    for body in data.bodies:
        if body.is_placed_by_key:
            raise NotCovered(
                f"mocap body {body.name!r}, which a key places: give it that place in the MJCF"
            )


def refuse_contacts(data: ModelData) -> None:
    """Raise NotCovered if bodies of a model may touch: a free motion does not cover contacts."""
    if data.may_touch:
        raise NotCovered(
            'contacts are not covered by a free motion: give <option> a <flag contact="disable"/>'
        )
