"""A row of a study's table: one run, what it was set to, how far it was off and what it cost."""

from dataclasses import dataclass, field

from proofmass.studies.setting import Knob

NAN = float("nan")
KINDS = {"position": ("rad", "m"), "rate": ("rad/s", "m/s"), "acceleration": ("rad/s^2", "m/s^2"),
         "effort": ("N", "N m"), "energy": ("J",)}
"""Kinds of channels, by their units; errors are told for each."""


@dataclass(frozen=True)
class Row:
    """One run of a study.

    Attributes
    ----------
    study : str
        trade, choose, stress or diet.
    case, run, engine : str
        What was run.
    line, axis : str
        Which line of the study's figure the run belongs to (all knobs but one, in words), and the
        knob that changes along it.
    value : float
        Of that knob.
    knobs : dict of str to Knob
        All of them.
    errors : dict of str to float
        Largest error of each kind of channel, as a share of the reference's range, at the state
        that the drives really had.
    invariants : dict of str to float
        gap [m]; energy, its drift over the largest kinetic energy, where nothing drives or brakes;
        stretch of rods [1].
    seconds, steps : float, int
        Least wall time of the repeats [s], of the first run where there are none; time steps.
    repeats : tuple of float
        All wall times [s], warm-up apart.
    pinned : bool
        Whether its process kept to one processor, which no other run of a study used meanwhile.
    shared : float
        Share of the time of the run in `seconds` that its processor gave to others.
    machine : str
        Processor that it was on, and how many the machine has.
    outcome, message : str
        ran; stopped: a sweep that ended early, with errors up to there; or why there are no errors:
        diverged, not finite, no reference (at a pose that the run came to), crashed, timed out,
        out of memory, unsupported.
    key : str
        What its files in the store are called: ``store.curves(row.key)``.
    asked : dict of str to float
        `errors` at the state that the drives were asked to have; empty without drives in time.
    step : float
        Time step that the engine took [s], which need not be the one that was asked for: whole
        steps lead from sample to sample.  NaN where nothing was stepped, or the run gave no curves.
    """

    study: str
    case: str
    run: str
    engine: str
    line: str
    axis: str
    value: float
    knobs: dict[str, Knob] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    invariants: dict[str, float] = field(default_factory=dict)
    seconds: float = NAN
    steps: int = 0
    repeats: tuple[float, ...] = ()
    pinned: bool = False
    shared: float = NAN
    machine: str = ""
    outcome: str = "ran"
    message: str = ""
    key: str = ""
    asked: dict[str, float] = field(default_factory=dict)
    step: float = NAN

    def reached(self, kind: str) -> float:
        """Error of a kind that somebody gets who asks for the motion; NaN if there is none."""
        return (self.asked or self.errors).get(kind, NAN)
