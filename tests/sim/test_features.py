"""Every feature of the table of docs/engines.md in a small model: it acts, is refused, or is said.

Bare MuJoCo and its inverse dynamics say how a feature acts, see `tests/sim/features.py`.
"""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest

from docs.make.features import PAGE, page_with_table
from proofmass.analytic import planar, spatial
from proofmass.analytic.features import FEATURES, Scope
from proofmass.analytic.mjcf import read_compiled
from proofmass.analytic.numerics import CannotMove, NotCovered
from proofmass.analytic.planar.support import SUPPORT as OF_PLANAR
from proofmass.analytic.refined import SUPPORT as OF_REFINED
from proofmass.analytic.spatial.support import SUPPORT as OF_SPATIAL
from proofmass.analytic.support import (
    IN_TIME,
    IRRELEVANT,
    PARTLY,
    REFUSED,
    SAID,
    WITHHELD,
    RunKind,
)
from proofmass.analytic.support import refuse as refuse_in_reference
from proofmass.sim.engines import engine_of
from proofmass.sim.protocol.failures import BadModel, Diverged, Unsupported
from proofmass.sim.protocol.run import Drive, Run
from tests.sim import features
from tests.sim.features import CHANGED, OPEN, close_loop, write

SUPPORT = {
    "mujoco": engine_of("mujoco").support,
    "pymunk": engine_of("pymunk").support,
    "planar": OF_PLANAR,
    "spatial": OF_SPATIAL,
    "refined": OF_REFINED,
}
VALUES, TIMES = np.linspace(0.0, 0.6, 4), np.linspace(0.0, 0.3, 4)
CHANNELS = ("a", "b", "c", "hold")


def profile_of(first):
    return lambda x: (first + x, 1.0 + 0.0 * x, 0.0 * x)


def profile_at(value, x):
    """A drive that stays where it is."""
    return value + 0.0 * x, 0.0 * x, 0.0 * x


LOOPED = RunKind.SWEEP, RunKind.MOVING_SWEEP
"""Runs of the model that is closed to a loop, whose drive determines all joints."""


def run_of(kind):
    looped = kind in LOOPED
    if kind == RunKind.EQUILIBRIUM:  # of all joints that the drive leaves, at one place of it
        return Run(
            "equilibrium", np.zeros(1), CHANNELS, (Drive("a", lambda x: profile_at(0.2, x)),)
        )
    drives = (
        () if kind == RunKind.FREE_MOTION else (Drive("a", profile_of(0.0 if looped else 0.2)),)
    )
    if kind in (RunKind.FREE_MOTION, RunKind.DRIVEN_MOTION):
        return Run("dynamics", TIMES, CHANNELS, drives)
    settled = {"settled": True} if kind == RunKind.SETTLED_SWEEP else {}
    return Run(
        "sweep", VALUES, CHANNELS, drives, settings=settled, inertia=kind == RunKind.MOVING_SWEEP
    )


KINDS = list(RunKind)
RUNS = {kind: run_of(kind) for kind in KINDS}
REFERENCES = "planar", "spatial", "refined"
"""General references; they solve no run of the kind equilibrium."""


@cache
def kinds_of(name, party):
    """Kinds of runs in which a model with a feature acts: a drive holds other joints otherwise."""
    only_in_time = CHANGED[name].adds_joints or "equality" in name
    return [
        kind
        for kind in KINDS
        if (kind in IN_TIME or not only_in_time)
        and not (kind == RunKind.EQUILIBRIUM and party in REFERENCES)
        and not (kind == RunKind.FREE_MOTION and "driven" in name)
    ]


def text_of(name, kind):
    """The model with a feature, closed to a loop if the drive determines all joints."""
    loop = [close_loop] if kind in LOOPED else []
    edits = CHANGED[name].edits if name else ()
    return write(*loop, *edits)


def curves_of(party, kind, text):
    """Curves of an engine or a reference, and its remarks."""
    run = RUNS[kind]
    model, joints = mujoco.MjModel.from_xml_string(text), tuple(d.joint for d in run.drives)
    if party in ("planar", "spatial"):
        solve = {"planar": planar.solve, "spatial": spatial.solve}[party]
        args, more = (run.x,), {}
        if joints:
            args = tuple(np.array(part) for part in run.motion(run.x))
            more = {
                "joints": joints,
                "inertia": kind in (RunKind.MOVING_SWEEP, RunKind.DRIVEN_MOTION),
            }
        if kind == RunKind.DRIVEN_MOTION:
            more["in_time"] = run.x, [drive.profile for drive in run.drives]
        found = solve(*args, model=model, **more)
        return {name: found[name] for name in CHANNELS if name in found}, ()
    with TemporaryDirectory() as folder:
        file = Path(folder) / "model.xml"
        file.write_text(text)
        if party == "refined":
            refuse_in_reference(read_compiled(model), OF_REFINED, kind, joints)
            return engine_of("mujoco").own_equations.solve_closely(file, run).channels, ()
        found = engine_of(party).simulate(file, run)
    return found.channels, found.notes


@cache
def plain_curves(party, kind):
    return curves_of(party, kind, text_of("", kind))[0]


def truth(kind, text):
    """Curves of bare MuJoCo."""
    if kind == RunKind.FREE_MOTION:
        return features.free_motion(text, TIMES)
    if kind == RunKind.DRIVEN_MOTION:
        return features.driven_motion(text, TIMES, profile_of(0.2))
    if kind == RunKind.EQUILIBRIUM:
        return features.resting_sweep(text, np.array([0.2]))
    if kind in (RunKind.FREE_SWEEP, RunKind.SETTLED_SWEEP):
        return features.resting_sweep(text, 0.2 + VALUES)
    return features.looped_sweep(text, VALUES, kind == RunKind.MOVING_SWEEP)


@cache
def plain_truth(kind):
    return truth(kind, text_of("", kind))


def distance(one, two):
    """Largest difference of curves that both have."""
    return max(float(np.abs(one[name] - two[name]).max()) for name in one.keys() & two.keys())


def test_every_feature_has_a_model_and_every_table_has_every_feature():
    assert CHANGED.keys() == FEATURES.keys()
    for party, support in SUPPORT.items():
        assert list(support) == list(FEATURES), party


def test_the_plain_model_has_no_feature_that_is_asked_for():
    """Features of the plain model are those that no test adds: its springs, motors and options."""
    scope = Scope(read_compiled(mujoco.MjModel.from_xml_string(OPEN)))
    there = {name for name, feature in FEATURES.items() if any(True for _ in feature.find(scope))}
    assert there == {
        "stiffness of a joint",
        "damping of a joint",
        "stiffness of a tendon",
        "damping of a tendon",
        "an actuator, which is a motor on a joint",
        "an actuator, which is a servo on a joint",
        "integrator or solver of the options",
        "magnetic field",
    }


@pytest.mark.parametrize("name", CHANGED)
def test_a_feature_is_found_and_acts_in_bare_mujoco(name):
    changed = CHANGED[name]
    text = text_of(name, RunKind.FREE_MOTION)
    driven = (0,) if "driven" in name else ()
    found = list(
        FEATURES[name].find(Scope(read_compiled(mujoco.MjModel.from_xml_string(text)), driven))
    )
    assert any(changed.element in FEATURES[name].what.format(one) for one in found)
    moved = distance(features.free_motion(text, TIMES), plain_truth(RunKind.FREE_MOTION))
    assert (moved > 1e-4) == changed.acts, moved


def test_the_table_of_the_documentation_is_that_of_the_runs():
    """``python -m docs.make.features`` writes it."""
    text = PAGE.read_text(encoding="utf-8")
    assert page_with_table(text) == text


REFUSALS = (NotCovered, Unsupported, BadModel, CannotMove, Diverged, ValueError)
ROUNDING = 1e-9
"""Change of curves [SI] that is none: rounding, and the steps to rest of settled sweeps."""
UNCHANGED = {"refined": 1e-6}
"""The same for a party whose steps follow from errors, here of moments [SI]: those of a state that
has no effect shorten the steps."""
STEPPING = {"pymunk": 0.1, "mujoco": 1e-4, "refined": 1e-4, "planar": 1e-6, "spatial": 1e-6}
"""Largest error of a party in the plain model [SI]: pymunk steps 1 ms and damps to first order,
MuJoCo closes the loop by a soft constraint, and the truth integrates with a tolerance of 1e-9."""


@pytest.mark.parametrize("name", CHANGED)
def test_a_feature_that_is_not_covered_is_refused_by_name(name):
    for party, support in SUPPORT.items():
        for kind, answer in support[name].items():
            if answer == REFUSED and kind in kinds_of(name, party):
                with pytest.raises(REFUSALS, match=re.escape(CHANGED[name].element)):
                    curves_of(party, kind, text_of(name, kind))


def shown_by_engines(name, kind):
    """Whether no engine silently does without a feature too: it acts, is said, or is refused."""
    return all(SUPPORT[engine][name][kind] != IRRELEVANT for engine in ("mujoco", "pymunk"))


@pytest.mark.parametrize("name", CHANGED)
@pytest.mark.parametrize("party", SUPPORT)
def test_a_feature_acts_as_in_bare_mujoco_or_is_said_or_has_no_effect(name, party):
    for kind, answer in SUPPORT[party][name].items():
        if kind not in kinds_of(name, party) or answer == REFUSED:
            continue
        text = text_of(name, kind)
        try:
            found, notes = curves_of(party, kind, text)
        except REFUSALS:
            if answer == PARTLY:
                continue
            raise
        plain = plain_curves(party, kind)
        if answer in (IRRELEVANT, SAID):
            assert distance(found, plain) < UNCHANGED.get(party, ROUNDING), kind
            if party in REFERENCES:  # they have no remarks: a run shows it by its engines
                assert answer == IRRELEVANT or shown_by_engines(name, kind), kind
                continue
            assert (answer == SAID) == any(CHANGED[name].element in note for note in notes), kind
            continue
        if answer == WITHHELD:
            assert "hold" not in found
        if CHANGED[name].known:
            known = {name: curve for name, curve in truth(kind, text).items() if name in found}
            effect = distance(known, plain_truth(kind))
            error = distance(found, known)
            assert error < STEPPING[party] + 0.02 * effect, (kind, error, effect)
            if effect > 10 * STEPPING[party]:
                assert distance(found, plain) > 0.5 * effect, (kind, effect)


@pytest.mark.parametrize(
    ("kind", "attributes"),
    [
        ("general", 'dyntype="filter" dynprm=".1" gainprm="5"'),
        ("general", 'dyntype="filterexact" dynprm=".1" gainprm="5"'),
        ("general", 'dyntype="integrator"'),
        ("cylinder", 'timeconst=".1" area="3"'),
        ("muscle", 'lengthrange="-2 2" force="10"'),
        ("intvelocity", 'kp="3" actrange="-1 1"'),
        ("dcmotor", 'motorconst=".1" resistance="1" inductance=".2"'),
    ],
)
def test_a_state_of_an_undriven_actuator_is_refused_where_the_drive_determines_all(
    tmp_path, kind, attributes
):
    """And on the driven joint itself it has no effect, even with an activation in the key."""
    state = f'<{kind} name="lag" joint="{{}}" {attributes}/>'
    file, run = tmp_path / "loop.xml", RUNS[RunKind.SWEEP]
    on_rocker = features.replace_actuator("load", state.format("b"))
    file.write_text(write(close_loop, on_rocker))
    with pytest.raises(Unsupported, match="activation of actuator 'lag' in a sweep"):
        engine_of("mujoco").simulate(file, run)
    on_drive = features.replace_actuator("motor", state.format("a"))
    file.write_text(write(close_loop, on_drive, features.key(ctrl="1 .9 .4", act=".7")))
    found = engine_of("mujoco").simulate(file, run).channels
    assert distance(found, plain_curves("mujoco", RunKind.SWEEP)) < ROUNDING


def test_dry_friction_acts_beside_a_drive_with_the_default_tolerance_of_the_solver(tmp_path):
    """The flywheel of a drive does not make the solver stop before friction acts.

    The motion without time steps has a tolerance of its own.
    """
    text = text_of("frictionloss of a joint", RunKind.DRIVEN_MOTION)
    found, _ = curves_of("mujoco", RunKind.DRIVEN_MOTION, text)
    effect = distance(found, plain_curves("mujoco", RunKind.DRIVEN_MOTION))
    assert effect > 0.1
    known, _ = curves_of("refined", RunKind.DRIVEN_MOTION, text)
    assert distance(found, known) < 1e-3 * effect  # friction that changes its sign within a step
