"""``proofmass diet``: what a scene does not need.

Each feature is taken out of the model, and every run of the scene is done again.  What changes no
channel by more than it may is harmless; all that is harmless is then taken out together, or one
after the other if not all of it can go at once, and what is left is looked at again.
"""

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import astuple, dataclass, field, replace
from typing import Any, TypeVar

import mujoco

from proofmass.check import FAILURES
from proofmass.isolate import isolated
from proofmass.study.diet_table import WHOLE, Entry, Moved
from proofmass.study.draft import Draft
from proofmass.study.feature import DRAWN, Feature, features
from proofmass.study.kept import Kept
from proofmass.study.run import pool
from proofmass.study.scene import Scene, Watch, moved
from proofmass.study.trial import Cost, attempt, paced
from sim.protocol import BadModel, Run

SLOWER = 20.0  # times as long as the model as it is takes: given up
LEAST = 30.0  # s, to give up
SETTLED = ("matters", "drawn")  # what is not tried again when others have gone
T = TypeVar("T")
ASKING = 8  # features that wait for workers at a time
Tried = tuple[Feature, Entry]


@dataclass(frozen=True)
class Diet:
    """What was found out of a scene.

    Attributes
    ----------
    entries : list of Entry
        Its features.
    slim : Draft
        Without all that is harmless.
    whole : Entry
        All of that together, as one feature.
    """

    entries: list[Entry]
    slim: Draft
    whole: Entry


@dataclass
class Search:
    """Finds what a scene does not need.

    Attributes
    ----------
    scene : Scene
        From `scene_of`.
    blind : bool
        Whether geoms that are only drawn go as well.
    rounds : int
        In which the steps of models with and without a feature are timed; 0: not at all.
    workers : Executor, optional
        Where runs go, from `proofmass.study.run.pool`; local ones if not given.  What is timed has
        a processor of its own.
    kept : Kept
        What was tried before, which is not done again.
    progress : callable
        Called with what is tried.
    """

    scene: Scene
    blind: bool = False
    rounds: int = 5
    workers: Executor | None = None
    kept: Kept = field(default_factory=Kept)
    progress: Callable[[str], None] = lambda _: None
    found: dict[tuple[str, str], Entry] = field(default_factory=dict)

    def run(self) -> Diet:
        """Look at all features, until none is left that can go."""
        if self.workers is None:
            with pool() as local:
                return replace(self, workers=local).run()
        slim, left = self.scene.draft, True
        while left:
            there = list(features(slim, self.scene))
            with ThreadPoolExecutor(ASKING) as threads:
                fresh = [one for each in threads.map(lambda f, d=slim: self.explored(d, f), there)
                         for one in each]
            self.found |= {(e.kind, e.name): e for _, e in fresh}
            wanted = [feature for feature, e in fresh if e.outcome == "harmless"]
            left = bool(wanted)
            slim = self.together(slim, wanted)
        whole = self.timed(self.scene.draft, *self.tried(slim, all_of([])))
        return Diet(list(self.found.values()), slim, whole)

    def explored(self, now: Draft, feature: Feature) -> list[Tried]:
        """What becomes of a feature, or of its parts where it cannot go as a whole."""
        last = self.found.get((feature.kind, feature.name))
        if last and last.outcome in SETTLED:
            return []
        draft, entry = self.tried(now, feature)
        if entry.outcome != "harmless" and feature.parts:
            return [one for part in feature.parts for one in self.explored(now, part)]
        if entry.outcome == "harmless" and feature.kind == DRAWN and not self.blind:
            entry = replace(entry, outcome="drawn")
        return [(feature, self.timed(now, draft, entry))]

    def together(self, now: Draft, wanted: list[Feature]) -> Draft:
        """A draft without as many of the features as can go together."""
        draft, entry = self.tried(now, all_of(wanted))
        if entry.outcome == "harmless":
            return draft
        for feature in wanted:
            draft, entry = self.tried(now, feature)
            if entry.outcome == "harmless":
                now = draft
        return now

    def tried(self, now: Draft, feature: Feature) -> tuple[Draft, Entry]:
        """A draft without a feature, and what comes of it in the runs of the scene."""
        self.progress(f"{feature.kind} {feature.name}")
        try:
            draft = now.without(feature.cut)
            models = [draft.compiled(watch.run.rods) for watch in self.scene.watches]
        except (ValueError, mujoco.FatalError) as error:
            return now, Entry(feature.kind, feature.name, "needed",
                              message=" ".join(str(error).removeprefix("Error: ").split()))
        watches = [(w.name, w.run, w.allowed, w.before.channels) for w in self.scene.watches]
        outcome, shares, message = self.kept.once(models, watches, lambda: self.ran(models, draft))
        return draft, Entry(feature.kind, feature.name, outcome, shares, message)

    def ran(self, models: list[mujoco.MjModel], draft: Draft) -> tuple[str, Moved, str]:
        """Outcome, changes and message of a draft's models in the runs of the scene."""
        shares: Moved = {}
        try:
            for watch, model in zip(self.scene.watches, models, strict=True):
                curves = self.worked(isolated, attempt, model, rodded(watch, draft),
                                     timeout=max(LEAST, SLOWER * watch.before.seconds))
                shares[watch.name] = moved(watch, curves, draft.probes)
        except BadModel as error:
            return "needed", shares, str(error)
        except tuple(FAILURES) as error:
            return FAILURES[type(error)], shares, str(error)
        same = all(share <= 1 for each in shares.values() for share in each.values())
        return "harmless" if same else "matters", shares, ""

    def timed(self, now: Draft, draft: Draft, entry: Entry) -> Entry:
        """The same with what a step and the memory cost, before and after, if the model runs."""
        if entry.outcome not in ("harmless", *SETTLED) or not self.rounds:
            return entry
        watch = self.scene.longest
        run = replace(watch.brief, rods=draft.segmented(watch.run.rods))
        models = [d.compiled(watch.run.rods) for d in (now, draft)]
        limit = self.rounds * SLOWER * max(LEAST, watch.before.seconds)
        costs = self.kept.once(models, (run, self.rounds), lambda: [
            astuple(c) for c in self.worked(paced, tuple(models), run, self.rounds, limit)])
        return replace(entry, costs=tuple(Cost(*c) for c in costs))

    def worked(self, what: Callable[..., T], *args: Any, **more: Any) -> T:
        """What a worker makes of something."""
        if self.workers is None:
            return what(*args, **more)
        return self.workers.submit(what, *args, **more).result()


def all_of(wanted: list[Feature]) -> Feature:
    """Many features as one."""
    def cut(draft: Draft) -> None:
        for feature in wanted:
            feature.cut(draft)

    return Feature(WHOLE, "", cut)


def rodded(watch: Watch, draft: Draft) -> Run:
    """A run with the rods of a draft."""
    return replace(watch.run, rods=draft.segmented(watch.run.rods))
