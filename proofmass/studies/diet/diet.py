"""``proofmass diet``: the features that a scene does not need, and the model without them.

Each feature is removed from the model by itself, and every run of the scene is repeated.  A feature
is harmless if its removal changes no channel by more than is allowed.  All harmless features are
then removed together, or one after the other if they cannot be removed at once, and the remaining
features are tried again.

Then options of the engine are made cheaper, one after the other, as long as the results are as
close to the reference as before: see `proofmass.studies.diet.options`.

The result of each trial is kept in a file of its own, so a diet that was stopped can be continued.
"""

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from secrets import token_hex
from typing import Any

import mujoco
from rich.table import Table

from proofmass.base.errors import InputError
from proofmass.base.files import (
    OUTPUT_MARK,
    PARTIAL_ENDING,
    make_folder,
    write_output,
)
from proofmass.base.wording import number
from proofmass.run.fingerprint import bytes_of_model
from proofmass.sim.engines import NATIVE_ENGINE
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.run import Run
from proofmass.studies.diet.edits import EditedModel, model_text, read_model, write_model
from proofmass.studies.diet.options import (
    COUNTED_OPTIONS,
    DRAWN_GEOM,
    OPTION_ORDERS,
    TIMED_OPTIONS,
    Feature,
    OptionMaker,
    change_integrator,
    evaluations_per_second,
    lengthen_step,
    list_features,
    stepped_runs,
)
from proofmass.studies.diet.scene import (
    TIMED_STEPS,
    DietScene,
    MonitoredRun,
    channel_changes,
    channel_errors,
)
from proofmass.studies.diet.table import (
    NO_GAIN,
    SENTENCE_KIND,
    WHOLE_KIND,
    ChannelChanges,
    Entry,
    format_saving,
    sort_entries,
    summary_sentences,
    write_entries,
)
from proofmass.studies.diet.trial import (
    Cost,
    CostComparison,
    attempt,
    compare_costs_isolated,
    failed_outcome,
)
from proofmass.studies.measure import Measurement, measure
from proofmass.studies.store import digest, digest_of_sources, package_versions
from proofmass.studies.study import Study

OUTCOME_LABELS = {
    "harmless": "✓ goes",
    "drawn": "· drawn",
    NO_GAIN: "· no gain",
    "matters": "✗ matters",
}
"""Outcomes of models that run, as the terminal shows them."""


MAX_SLOWDOWN = 20.0  # times the counted time of the original model, after which a run is given up
MAX_OPTION_SLOWDOWN = 3.0  # the same for an option, which has to be cheaper
MIN_GAIN = 0.05
"""Least share of the time that an option must save for certain: processes that share the caches of
the processor change smaller shares."""
MIN_TIMEOUT = 30.0  # s: no run is given up before
TIMING_ROUNDS = 15
"""Number of pairs of timed runs; the interval of their median is from the 3rd to the 13th value."""
FINAL_OUTCOMES = ("matters", "drawn")  # outcomes that are not tried again after others were removed
FEATURE_THREADS = 8  # features that are tried at a time
TriedFeature = tuple[Feature, Entry]
Judge = Callable[[list[mujoco.MjModel], EditedModel], tuple[str, ChannelChanges, str]]
ChangedOption = tuple[EditedModel, EditedModel, Entry]
"""An edited model, the same model with an option changed, and the result of the change."""


@dataclass(frozen=True)
class Diet:
    """The result of a diet.

    Attributes
    ----------
    entries : list of Entry
        The features of the scene, and the options that were tried.
    reduced : EditedModel
        The model without its harmless features, and with its cheaper options.
    whole : Entry
        All of these changes together, as one feature.
    tuned : bool
        Whether the reduced model has other options, so that its runs are compared with a reference.
    said : list of Entry
        Sentences on what was monitored, and what options were compared with.
    """

    entries: list[Entry]
    reduced: EditedModel
    whole: Entry
    tuned: bool = False
    said: list[Entry] = field(default_factory=list)

    @property
    def table(self) -> tuple[Entry, ...]:
        """All entries in the order in which they are written."""
        return (*self.said, *self.entries, self.whole)


def write_result(scene: DietScene, study: Study, found: Diet, file: Path) -> None:
    """Write the reduced model and the table, after a trial of the model as it is written.

    That trial is made anew and not kept.

    Raises
    ------
    InputError
        The written model does not give the same results, since digits were lost.
    """
    make_folder(file.parent)
    partial = file.with_name(f".{token_hex(8)}{PARTIAL_ENDING}.xml")
    try:
        write_model(found.reduced, partial, with_additions=True)
        written = read_model(partial, found.reduced.rods)
        models = [
            written.compiled(found.reduced.segmented(w.run.rods)) for w in scene.monitored_runs
        ]
        search = DietSearch(scene, study)
        outcome, _, message = (search.judge_errors if found.tuned else search.judge_changes)(
            models, found.reduced
        )
        if outcome != "harmless":
            raise InputError(
                scene.edited.file,
                "",
                f"cannot be written with all its digits: its reduced model {message or outcome}",
            )
    finally:
        partial.unlink(missing_ok=True)
    write_output(file, f"<!-- {OUTPUT_MARK} -->\n{model_text(found.reduced, file.parent)}")
    write_entries(found.table, file.with_suffix(".csv"))


def result_parts(entries: Sequence[Entry]) -> Iterator[str | Table]:
    """The parts of standard output: sentences, a table of models that run, and needed features."""
    yield from (f"{text}\n" for text in summary_sentences(entries))
    rows = Table(box=None, header_style="bold", pad_edge=False)
    for name in ("feature", "outcome", "time", "memory", "moves", "most of all"):
        rows.add_column(
            name,
            justify="right" if name in ("time", "memory", "moves") else "left",
            no_wrap=name not in ("feature", "most of all"),
            overflow="fold",
        )
    for entry in sort_entries(entries):
        if entry.outcome in OUTCOME_LABELS:
            rows.add_row(*result_row(entry))
    if rows.row_count:
        yield rows
        yield (
            "\ntime and memory: saved; time in brackets: interval of the median with 99 %, none "
            "where 0 is within it; moves: largest change of a channel, or with another option "
            "its error, of what is allowed"
        )
    if needed := [e.title for e in sort_entries(entries) if e.outcome not in OUTCOME_LABELS]:
        yield f"\nWithout these it does not run: {'; '.join(needed)}"


def result_row(entry: Entry) -> tuple[str, ...]:
    """A row of the table on standard output."""
    run, channel, share = entry.worst
    saved = ("–", "–")
    if entry.costs:
        saved = format_saving(entry), f"{entry.saved_memory:+.1f} KB"
    return (
        entry.title,
        OUTCOME_LABELS[entry.outcome],
        *saved,
        number(share, 2),
        f"{channel} in {run}" if share else "",
    )


@dataclass
class DietSearch:
    """The search for the features that a scene does not need, and for cheaper options.

    Attributes
    ----------
    scene : DietScene
        The scene, from `load_scene`.
    study : Study
        Where the results of trials are kept, and who makes the runs; timed runs have a processor of
        their own.  Its progress is called with the name of each feature that is tried.
    blind : bool
        Whether geoms that are only drawn are removed as well.
    rounds : int
        Pairs of timed runs of models with and without a feature.  With 0 nothing is timed, and
        options whose gain only the time can show are not tried.
    tune : bool
        Whether options of the engine are made cheaper as well.
    found : dict of (str, str) to Entry
        The result for each feature that was tried so far, by its kind and its name.
    """

    scene: DietScene
    study: Study
    blind: bool = False
    rounds: int = TIMING_ROUNDS
    tune: bool = True
    found: dict[tuple[str, str], Entry] = field(default_factory=dict)

    def run(self) -> Diet:
        """Try all features until no other can be removed, then options; return the result."""
        with self.study.working() as working:
            return replace(self, study=working).reduce()

    def reduce(self) -> Diet:
        """Do what `run` does, with the workers that the study has."""
        reduced, is_changed = self.scene.edited, True
        while is_changed:
            candidates = list(list_features(reduced, self.scene))
            with ThreadPoolExecutor(FEATURE_THREADS) as threads:
                fresh = [
                    one
                    for each in threads.map(
                        lambda f, d=reduced: self.try_with_parts(d, f), candidates
                    )
                    for one in each
                ]
            self.found |= {(e.kind, e.name): e for _, e in fresh}
            wanted = [feature for feature, e in fresh if e.outcome == "harmless"]
            if is_changed := bool(wanted):
                reduced = self.together(reduced, wanted)
        tune = self.tune and bool(stepped_runs(self.scene))
        cheapened, changed = self.optioned(reduced) if tune else (reduced, [])
        self.found |= {(e.kind, e.name): e for e in changed}
        tuned = cheapened is not reduced
        whole = self.timed(
            self.scene.edited, *self.tried(cheapened, combine_features([]), tuned), tuned
        )
        said = [Entry(SENTENCE_KIND, "", SENTENCE_KIND, message=text) for text in self.scene.said]
        return Diet(list(self.found.values()), cheapened, whole, tuned, said)

    def optioned(self, reduced: EditedModel) -> tuple[EditedModel, list[Entry]]:
        """The edited model with cheaper options, and the results of all that were tried."""
        current, changed = self.changed(reduced, COUNTED_OPTIONS)
        orders = OPTION_ORDERS if change_integrator(current, self.scene) else OPTION_ORDERS[:1]
        current, more = min(
            (self.changed(current, order) for order in orders),
            key=lambda way: evaluations_per_second(way[0]),
        )
        entries = [self.timed(old, new, entry, True) for old, new, entry in (*changed, *more)]
        for make in TIMED_OPTIONS if self.rounds else ():
            for rung in make(current, self.scene):
                edited, entry = self.tried(current, rung, True)
                entry = self.timed(current, edited, entry, True)
                if entry.outcome == "harmless" and not (entry.saved and entry.saved[0] > MIN_GAIN):
                    entry = replace(entry, outcome=NO_GAIN)
                entries.append(entry)
                if entry.outcome == "harmless":
                    current = edited
                    break
        return current, entries

    def changed(
        self, current: EditedModel, makers: tuple[OptionMaker, ...]
    ) -> tuple[EditedModel, list[ChangedOption]]:
        """The model with the first harmless option of each maker, and the results.

        If no option of a maker is harmless, the result of its last one is given.
        """
        found: list[ChangedOption] = []
        for make in makers:
            again = True
            while again:
                again = False
                for rung in (rungs := make(current, self.scene)):
                    edited, entry = self.tried(current, rung, True)
                    holds = entry.outcome == "harmless"
                    if holds or rung is rungs[-1]:
                        found.append((current, edited, entry))
                    if holds:
                        current, again = (
                            edited,
                            make is lengthen_step,
                        )  # a still longer step may be harmless
                        break
        return current, found

    def try_with_parts(self, current: EditedModel, feature: Feature) -> list[TriedFeature]:
        """The results of a feature, or of its parts if it cannot be removed as a whole."""
        last = self.found.get((feature.kind, feature.name))
        if last and last.outcome in FINAL_OUTCOMES:
            return []
        edited, entry = self.tried(current, feature)
        if entry.outcome != "harmless" and feature.parts:
            return [one for part in feature.parts for one in self.try_with_parts(current, part)]
        if entry.outcome == "harmless" and feature.kind == DRAWN_GEOM and not self.blind:
            entry = replace(entry, outcome="drawn")
        return [(feature, self.timed(current, edited, entry))]

    def together(self, current: EditedModel, wanted: list[Feature]) -> EditedModel:
        """An edited model without the features, or without those that can be removed in turn."""
        edited, entry = self.tried(current, combine_features(wanted))
        if entry.outcome == "harmless":
            return edited
        for feature in wanted:
            edited, entry = self.tried(current, feature)
            if entry.outcome == "harmless":
                current = edited
        return current

    def tried(
        self, current: EditedModel, feature: Feature, tuned: bool = False
    ) -> tuple[EditedModel, Entry]:
        """An edited model without a feature, and its result in the runs of the scene.

        A model that is `tuned` has other options, so its runs are compared with a reference.
        """
        self.study.progress(f"{feature.kind} {feature.name}", len(self.found), 0)
        try:
            edited = current.without(feature.cut)
            models = [
                edited.compiled(monitored.run.rods) for monitored in self.scene.monitored_runs
            ]
        except (ValueError, mujoco.FatalError) as error:
            return current, Entry(
                feature.kind,
                feature.name,
                "needed",
                message=" ".join(str(error).removeprefix("Error: ").split()),
                edit=feature.edit,
            )
        monitored_runs = [
            (w.name, w.run, w.allowed, w.before.channels) for w in self.scene.monitored_runs
        ]
        judge: Judge = self.judge_errors if tuned else self.judge_changes
        runs = (
            [*monitored_runs, *map(reference_key, self.scene.monitored_runs)]
            if tuned
            else monitored_runs
        )
        outcome, shares, message = self.once(models, runs, lambda: judge(models, edited))
        return edited, Entry(
            feature.kind, feature.name, outcome, shares, message, edit=feature.edit
        )

    def judge_changes(
        self, models: list[mujoco.MjModel], edited: EditedModel
    ) -> tuple[str, ChannelChanges, str]:
        """Outcome, message, and changes of the channels of compiled models in the scene's runs.

        There is one compiled model for each run; its changes are shares of what is allowed.
        """
        optional = set() if edited.monitored else edited.added_sensors
        return self.judged(
            models,
            edited,
            MAX_SLOWDOWN,
            lambda monitored: monitored.run,
            lambda monitored, curves: channel_changes(monitored, curves, optional),
        )

    def judge_errors(
        self, models: list[mujoco.MjModel], edited: EditedModel
    ) -> tuple[str, ChannelChanges, str]:
        """The same with errors instead of changes, in runs that have a reference."""
        optional = set() if edited.monitored else edited.added_sensors
        return self.judged(
            models,
            edited,
            MAX_OPTION_SLOWDOWN,
            lambda monitored: monitored.bound.run if monitored.bound else monitored.run,
            lambda monitored, curves: (
                channel_errors(monitored, curves)
                if monitored.bound
                else channel_changes(monitored, curves, optional)
            ),
        )

    def judged(
        self,
        models: list[mujoco.MjModel],
        edited: EditedModel,
        slower: float,
        run_of: Callable[[MonitoredRun], Run],
        shares_of: Callable[[MonitoredRun, Curves], dict[str, float]],
    ) -> tuple[str, ChannelChanges, str]:
        """Outcome, shares of what is allowed, and message of compiled models in the scene's runs.

        A run is given up after a processor time of `slower` times the counted one of the original
        model.
        """
        shares: ChannelChanges = {}
        for monitored, model in zip(self.scene.monitored_runs, models, strict=True):
            run = run_of(monitored)
            run = replace(run, rods=edited.segmented(run.rods))
            curves = self.study.call(
                measure,
                attempt,
                model,
                run,
                timeout=max(MIN_TIMEOUT, slower * monitored.before.cost),
            )
            if isinstance(curves, Measurement):
                return failed_outcome(curves), shares, curves.message
            shares[monitored.name] = shares_of(monitored, curves)
        same = all(share <= 1 for each in shares.values() for share in each.values())
        return "harmless" if same else "matters", shares, ""

    def timed(
        self, current: EditedModel, edited: EditedModel, entry: Entry, tuned: bool = False
    ) -> Entry:
        """The entry with the costs of both models, in time and memory, if the edited one runs."""
        if entry.outcome not in ("harmless", *FINAL_OUTCOMES) or not self.rounds:
            return entry
        monitored = self.scene.longest
        run = monitored.shortened(
            monitored.bound.run if tuned and monitored.bound else monitored.run, TIMED_STEPS
        )
        run = replace(run, rods=edited.segmented(monitored.run.rods))
        models = [d.compiled(monitored.run.rods) for d in (current, edited)]
        limit = self.rounds * MAX_SLOWDOWN * max(MIN_TIMEOUT, monitored.before.cost)
        found = self.once(
            models,
            (run, self.rounds),
            lambda: asdict(
                self.study.call(compare_costs_isolated, tuple(models), run, self.rounds, limit)
            ),
        )
        one, two = (Cost(**cost) for cost in found["costs"])
        low, middle, high = found["saved"]
        pace = CostComparison((one, two), (low, middle, high))
        return replace(entry, costs=pace.costs, saved=pace.saved)

    def once(self, models: list[mujoco.MjModel], runs: Any, make: Callable[[], Any]) -> Any:
        """A result of compiled models, read from the store or else made; see `trial_name`."""
        return self.study.store.value(trial_name(models, runs), make)


def trial_name(models: Sequence[mujoco.MjModel], runs: Any) -> str:
    """Name of the file for the result of compiled models; `runs` is all else that it depends on."""
    key = [
        *map(bytes_of_model, models),
        pickle.dumps(runs),
        repr(package_versions(NATIVE_ENGINE)).encode(),
        digest_of_sources().encode(),
    ]
    return f"{digest(b''.join(key))}.json"


def combine_features(wanted: list[Feature]) -> Feature:
    """One feature that removes several features."""

    def cut(edited: EditedModel) -> None:
        for feature in wanted:
            feature.cut(edited)

    return Feature(WHOLE_KIND, "", cut)


def reference_key(monitored: MonitoredRun) -> object:
    """All that a run's errors depend on besides its model, such that it always pickles alike."""
    if (bound := monitored.bound) is None:
        return None
    case = bound.case and (
        bound.case.reference,
        sorted(bound.case.parameters.items(), key=lambda item: item[0]),
    )
    return bound.run, bound.allowed, bound.reference, case
