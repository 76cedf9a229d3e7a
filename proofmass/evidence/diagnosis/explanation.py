"""What a search for causes finds: explanations, and the diagnosis of a run that they make up."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from proofmass.base.grouping import group_by
from proofmass.base.wording import format_list, number
from proofmass.evidence.diagnosis.fault import Fault
from proofmass.sim.elements import Number

HANDICAPS = {0: 0.0, 1: 0.01, 2: 0.1, 3: 0.25}
"""Handicap of a cause in the ranking, as a share of the channels that differ, by how freely it was
chosen, see `Explanation.free`."""
FINER_KIND = "finer"
"""The kind of changes that make an error smaller and need not put a channel right."""
FINER_HANDICAP = 0.005
"""Handicap of the latter, as above: a change with which curves agree says more."""
Edits = tuple[tuple[Number, float], ...]
"""Changes of a model: numbers, and what is added to each."""


@dataclass(frozen=True)
class Explanation:
    """A change of the case that would explain the differences of a run.

    Attributes
    ----------
    kind : str
        parameter, pair of parameters, sign, assembly mode, factor, offset, quantity, shift, number
        of the model, rebound, setting, or finer: a shorter time step, shorter segments, or
        another setting with which the engine should have a smaller error.
    words : str
        Description of the change, with numbers and units, from what is to what would explain.
    explains, breaks : tuple of str
        Channels that differ and agree with the change, and channels that agree and differ with it.
    left : float
        Root mean square of the differences after the change, over that before [1], of the channels
        that it explains, or of all if it explains none; each channel in units of what is allowed.
    differing : int
        How many channels differ.
    free : int
        How freely the change was chosen, see `HANDICAPS`: 0 without a fitted number, such as a
        sign; 1 one fitted parameter; 2 a fitted factor, offset or shift, which any channel may
        have; 3 two fitted parameters.
    changes : mapping of str to tuple of float
        For each fitted parameter its value in the sidecar, and the fitted value [SI].
    same : tuple of str
        Descriptions of other changes that fit the curves equally well.
    faults : tuple of Fault
        The wrong values with their places; empty if no single place has them.
    edits : tuple of (Number, float)
        The change as changes of numbers of the model; empty if it is none.
    estimated : bool
        Whether its effect is only estimated to first order, since the search reached its limit.
    ratio : float
        Largest error after the change over what is allowed [1], of the channels that it explains;
        NaN if it explains none.
    """

    kind: str
    words: str
    explains: tuple[str, ...]
    breaks: tuple[str, ...]
    left: float
    differing: int
    free: int = 0
    changes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    same: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    edits: Edits = ()
    estimated: bool = False
    ratio: float = math.nan

    @property
    def fitted(self) -> int:
        """The number of fitted values."""
        return len(self.changes) or int(self.free > 0)

    @property
    def score(self) -> int:
        """Number of channels that it explains, less that of channels that it breaks."""
        return len(self.explains) - len(self.breaks)

    @property
    def share(self) -> float:
        """The score as a share of the channels that differ."""
        return self.score / self.differing

    @property
    def complete(self) -> bool:
        """Whether it is known to explain all channels that differ, and to break none."""
        return self.score == self.differing and not self.estimated

    @property
    def fault(self) -> Fault | None:
        """Its wrong value, if it is a single one."""
        return self.faults[0] if len(self.faults) == 1 else None

    @property
    def mirrors(self) -> tuple[str, ...]:
        """The sentences among `same`, which say how the value at the other side would be wrong."""
        return tuple(words for words in self.same if "; with " in words)

    @property
    def effect(self) -> str:
        """What the change does, as the end of a sentence: ``all 17 curves agree``."""
        if self.kind == FINER_KIND:
            of = count_curves(len(self.explains), self.differing)
            return f"the error of {of} falls to {number(self.left, 2)} of it"
        broken = f", but {len(self.breaks)} that agreed would differ" if self.breaks else ""
        agree = "agrees" if self.differing == 1 else "agree"
        note = ", as estimated to first order" if self.estimated else ""
        return f"{count_curves(len(self.explains), self.differing)} {agree}{broken}{note}"

    @property
    def key(self) -> tuple[object, ...]:
        """What makes two explanations the same: their faults, or their words."""
        return tuple(fault.key for fault in self.faults) or (self.kind, self.words)

    @property
    def sentence(self) -> str:
        """The explanation as one sentence: place, wrong value, right value, effect."""
        return self.sentence_with(self.effect)

    def sentence_with(self, effect: str) -> str:
        """The sentence with another effect, such as that on several runs."""
        if self.fault:
            return self.fault.sentence(effect)
        files = dict.fromkeys(f.file.name for f in self.faults)
        lines = dict.fromkeys(f.line for f in self.faults)
        at = ""
        if len(files) == 1 and None not in lines:
            plural = "s" * (len(lines) > 1)
            at = f"{next(iter(files))}, line{plural} {format_list(map(str, lines))}: "
        return f"{at}{self.words}; with that changed {effect}"


def rank_key(cause: Explanation) -> tuple[float, float]:
    """The key by which causes are ranked, smallest first.

    The first number is the handicap of the cause less the share of channels that it explains, or 0
    if it explains none; the second is the share of the differences that it leaves.
    """
    handicap = HANDICAPS[cause.free] + FINER_HANDICAP * (cause.kind == FINER_KIND)
    return handicap - cause.share if cause.score > 0 else 0.0, cause.left


def count_curves(some: int, there: int) -> str:
    """A phrase on some of the curves that differ.

    >>> count_curves(1, 1), count_curves(2, 2), count_curves(17, 17), count_curves(12, 13)
    ('the curve', 'both curves', 'all 17 curves', '12 of 13 curves')
    """
    if some < there:
        return f"{some} of {there} curves"
    return {1: "the curve", 2: "both curves"}.get(there, f"all {there} curves")


def likely(share: float) -> str:
    """The words before a cause that does not explain all curves.

    >>> likely(0.42)
    'most likely (42 % explained)'
    """
    return f"most likely ({100 * share:.0f} % explained)"


def describe_proof(explanations: Sequence[Explanation]) -> str:
    """What a cause leaves of the differences of one or several runs, and how exactly it is known.

    >>> one = Explanation("parameter", "rocker", ("pin",), (), 3e-14, 1, ratio=0.41)
    >>> describe_proof([one])
    'with it the largest error is 0.41 of what is allowed, 3e-14 of what it was'
    """
    left = max(one.left for one in explanations)
    text = f"with it {number(left, 2)} of the error is left"
    if math.isfinite(ratio := max(one.ratio for one in explanations)):
        text = (
            f"with it the largest error is {number(ratio, 2)} of what is allowed, "
            f"{number(left, 2)} of what it was"
        )
    known = [fault.known for fault in finest_faults(explanations) if fault.known]
    return f"{text}; known to {format_list(known)}" if known else text


def finest_faults(explanations: Sequence[Explanation]) -> list[Fault]:
    """The faults of a cause of several runs, each as the run says that knows it best."""
    return [
        min(same, key=lambda fault: fault.within or math.inf)
        for same in zip(*(one.faults for one in explanations), strict=True)
    ]


@dataclass(frozen=True)
class Diagnosis:
    """The causes that would explain why the run of a solver differs from its reference.

    Attributes
    ----------
    case, run, solver : str
        Names of the case, the run and the solver.
    differing : tuple of str
        Its channels that differ.
    checked : int
        Number of its channels that have a tolerance and a finite curve.
    causes : tuple of Explanation
        The causes, best first.
    tried : tuple of str
        Descriptions of the changes that were tried.
    untried : tuple of str
        Descriptions of changes that were left out, because the search had reached its limit.
    remarks : tuple of str
        Further findings, such as loops that are open at the start, and the effect of a shorter time
        step or shorter segments.
    seconds : float
        Wall time of the search [s].
    fault : str
        The reason why causes could not be searched for; empty if they were.
    failed : bool
        Whether the run failed; then there are only remarks and remedies.
    remedies : tuple of str
        Sentences on what mends a run that failed.
    """

    case: str
    run: str
    solver: str
    differing: tuple[str, ...] = ()
    checked: int = 0
    causes: tuple[Explanation, ...] = ()
    tried: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    seconds: float = 0.0
    fault: str = ""
    failed: bool = False
    remedies: tuple[str, ...] = ()

    @property
    def best(self) -> Explanation | None:
        """The best cause, if it explains more channels than it breaks."""
        return self.causes[0] if self.causes and self.causes[0].score > 0 else None

    @property
    def found(self) -> bool:
        """Whether there is a cause that explains more channels than it breaks."""
        return self.best is not None

    @property
    def head(self) -> str:
        """The word before the first line: a cause explains all curves, what is likely does not."""
        if self.failed:
            return "failed"
        if self.best is None or self.best.complete:
            return "cause"
        return likely(self.best.share)

    @property
    def lines(self) -> list[str]:
        """Lines of text: the best cause, what it leaves, the next best cause, and remarks."""
        if self.fault:
            return [f"causes were not searched for: {self.fault}"]
        if self.failed:
            return [*self.remarks, *self.remedies] or ["no reason was found"]
        if self.best is None:
            return [f"none of those tried: {', '.join(self.tried)}", *self.limits, *self.remarks]
        return [self.best.sentence, *self.details, *self.remarks]

    @property
    def details(self) -> list[str]:
        """Lines on the best cause; none without one."""
        return SharedCause((self,)).details if self.best else []

    @property
    def limits(self) -> list[str]:
        """A line on what the search left out, if it reached its limit."""
        return [f"the search reached its limit before {format_list(self.untried)}"] * bool(
            self.untried
        )

    @property
    def text(self) -> str:
        """All lines, after the word "cause", "most likely" or "failed"."""
        return f"{self.head}: " + f"\n{' ' * 9}".join(self.lines)


@dataclass(frozen=True)
class SharedCause:
    """One cause of the differences of several runs, which may be of several cases.

    Attributes
    ----------
    diagnoses : tuple of Diagnosis
        The diagnoses of the runs that have it as their best cause.
    """

    diagnoses: tuple[Diagnosis, ...]

    @property
    def explanations(self) -> list[Explanation]:
        """The cause in each of the runs."""
        return [found.best for found in self.diagnoses if found.best]

    @property
    def best(self) -> Explanation:
        """The cause in the first of the runs."""
        return self.explanations[0]

    @property
    def complete(self) -> bool:
        """Whether it explains all curves that differ in its runs."""
        return all(one.complete for one in self.explanations)

    @property
    def head(self) -> str:
        """The word before its sentence."""
        score = sum(one.score for one in self.explanations)
        there = sum(one.differing for one in self.explanations)
        return "cause" if self.complete else likely(score / there)

    @property
    def cases(self) -> tuple[str, ...]:
        """The names of the cases of its runs."""
        return tuple(dict.fromkeys(found.case for found in self.diagnoses))

    @property
    def effect(self) -> str:
        """What the change does in all runs, as the end of a sentence."""
        if len(self.diagnoses) == 1 or self.best.kind == FINER_KIND:
            return self.best.effect
        broken = sum(len(one.breaks) for one in self.explanations)
        there = sum(one.differing for one in self.explanations)
        many = count_curves(sum(len(one.explains) for one in self.explanations), there)
        of = f" of {format_list(self.cases)}" if len(self.cases) > 1 else ""
        more = f", but {broken} that agreed would differ" if broken else ""
        return f"{many} of {len(self.diagnoses)} runs{of} agree{more}"

    @property
    def sentence(self) -> str:
        """The cause as one sentence."""
        return self.best.sentence_with(self.effect)

    @property
    def text(self) -> str:
        """The sentence after the word "cause" or "most likely"."""
        return f"{self.head}: {self.sentence}"

    @property
    def title(self) -> str:
        """The sentence, after "Most likely" if it does not explain all curves."""
        return self.sentence if self.complete else f"{self.text[:1].upper()}{self.text[1:]}"

    @property
    def written_faults(self) -> tuple[Fault, ...]:
        """Its wrong values that a file writes, so that their lines can be shown."""
        return tuple(fault for fault in self.best.faults if fault.instead)

    @property
    def runs(self) -> set[tuple[str, str, str]]:
        """The case, run and solver of each of its runs."""
        return {(found.case, found.run, found.solver) for found in self.diagnoses}

    @property
    def proof(self) -> str:
        """What the cause leaves of the differences of all its runs, and how exactly it is known."""
        return describe_proof(self.explanations)

    @property
    def details(self) -> list[str]:
        """Lines on the cause: the wrong line and the right one, the proof, other explanations."""
        found = [line for fault in self.best.faults for line in fault.diff]
        rest = [
            name
            for diagnosis, one in zip(self.diagnoses, self.explanations, strict=True)
            for name in diagnosis.differing
            if name not in one.explains
        ]
        left = f"; not {format_list(dict.fromkeys(rest))}" if rest else ""
        found.append(f"{self.proof}{left}")
        if self.best.same:
            found.append(f"as good: {format_list(self.best.same)}")
        if self.complete:
            return found
        first = self.diagnoses[0]
        following = [f"next best: {one.sentence}" for one in first.causes[1:2]]
        return [*found, *following, *first.limits]

    @property
    def remarks(self) -> list[str]:
        """The remarks on its runs, each once."""
        return list(dict.fromkeys(line for one in self.diagnoses for line in one.remarks))

    @property
    def further_remedies(self) -> list[str]:
        """Sentences on what to do, beside the corrected lines that a page or the terminal shows."""
        if self.best.kind == FINER_KIND:
            return [f"Make the run finer: {self.best.words}."]
        lead = "" if self.complete else "First look here; the cause does not explain all curves. "
        found = [f"{lead}{fault.remedy}" for fault in self.best.faults if lead or not fault.instead]
        if not self.best.faults:
            found = [f"{lead}Change this: {self.best.words}."]
        return [*found, *(f"If that value is right: {same}." for same in self.best.mirrors)]


def shared_causes(diagnoses: Iterable[Diagnosis]) -> list[SharedCause]:
    """The best causes of some runs, each once, in the order of their first runs.

    A cause with a place in a file is the same in all cases that read the file.
    """
    found = (one for one in diagnoses if one.best)
    groups = group_by(found, lambda one: one.best and (one.best.key, place_of(one)))
    return [SharedCause(tuple(group)) for group in groups.values()]


def place_of(found: Diagnosis) -> str:
    """The case of a cause without a place in a file, which others do not share."""
    return "" if found.best and found.best.faults else found.case
