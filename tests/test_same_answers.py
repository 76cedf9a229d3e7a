"""The same input has the same answer on a slow, a fast and a busy machine.

Each question is asked with processor clocks that run ten times as fast and ten times as slow, in
this process and in all workers, and by a slow test beside many busy processes.  The answers are
compared word by word, except for the seconds that they state as information.

The workers get their clocks from a `sitecustomize` module, which Python finds by PYTHONPATH and
imports when it starts.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import dedent

import pytest

from proofmass.base.worker import close_idle_workers
from proofmass.batch.check import Result, check
from proofmass.case.case import Case
from proofmass.reference.self_consistency import Rung
from proofmass.run.sidecar import load_case
from proofmass.sim.engines import engine_of
from proofmass.studies.diet.diet import DietSearch
from proofmass.studies.diet.scene import load_scene
from proofmass.studies.store import Store
from proofmass.studies.study import Study
from proofmass.studies.trade.choose import NoGoodSetting, choose, describe_choice, good_settings
from proofmass.studies.trade.search import search
from proofmass.studies.trade.series import Limits
from proofmass.studies.trade.verify import verify
from tests.shipped import shipped, shipped_files

CLOCKS = ("process_time", "thread_time", "perf_counter")
PATCHED_CLOCKS = f"""
    import time
    for name in {CLOCKS}:
        setattr(time, name, lambda real=getattr(time, name): {{speed}} * real())
"""
FAST, SLOW = 10.0, 0.1  # speeds of the clocks
BUSY_PROCESSES = 10 * (os.cpu_count() or 1)  # the load is 20 on two processors
STATED_SECONDS = re.compile(r"\b[\d.e+-]+ s\b")

ARM = """
    <mujoco><option timestep="0.004"/><worldbody><geom type="plane" size="5 5 1" pos="0 0 -2"/>
      <body><joint axis="0 1 0" damping="0.01"/><geom type="capsule" size=".05"
        fromto="0 0 0 1 0 0"/><body pos="1 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".05"
          fromto="0 0 0 1 0 0"/></body></body>
      <body pos="0 2 -1"><freejoint/><geom size=".2"/></body></worldbody></mujoco>
"""


@contextmanager
def clocks(speed: float, folder: Path) -> Iterator[None]:
    """Let the clocks of this process and of its workers run `speed` times as fast."""
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(dedent(PATCHED_CLOCKS.format(speed=speed)))
    close_idle_workers()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        for name in CLOCKS:
            real = getattr(time, name)
            patch.setattr(time, name, lambda real=real: speed * real())
        yield
    close_idle_workers()


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Let other processes compute for ever."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    close_idle_workers()
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def without_seconds(words: str) -> str:
    """A text without the seconds that it states."""
    return STATED_SECONDS.sub("… s", words)


def verdicts(result: Result) -> list[str]:
    """Every comparison of a check, and the causes that it names."""
    found = [
        repr(replace(one, seconds=0.0, message=without_seconds(one.message)))
        for one in result.comparisons
    ]
    found += [
        f"{key}: {without_seconds(line)}"
        for key, one in result.diagnoses.items()
        for line in one.lines
    ]
    return found + [str(error) for error in result.errors]


def ask_rung(folder: Path) -> list[str]:
    """The rung of a model without a sidecar, also where the counted time ends its motion early."""
    model = folder / "arm.xml"
    model.write_text(ARM)
    early = Rung(engine_of("mujoco").own_equations.solve_motion(model, 1.0, 101, 0.05))
    assert not early.whole_run
    return [*verdicts(check([model], jobs=1)), early.words()]


def ask_causes(folder: Path) -> list[str]:
    """The cause of a run that differs: the model's rocker is longer than the reference's."""
    for ending in ("xml", "toml"):
        shutil.copy(shipped(f"fourbar.{ending}"), folder)
    sidecar = folder / "fourbar.toml"
    text = sidecar.read_text(encoding="utf-8")
    sidecar.write_text(re.sub(r"(?m)^rocker = .*$", "rocker = 2.55", text), encoding="utf-8")
    return verdicts(check([sidecar], jobs=1, detectable=False))


def ask_order(folder: Path) -> list[str]:
    """All settings of an engine that a search tries, and the good ones in the order of their
    cost."""
    case, limits = short_pendulum(), Limits()
    rows = search(case, "position", 5e-4, Study(Store(folder)), engine="pymunk", limits=limits)
    found = [f"{row.series} {row.value} {row.cost} {row.errors}" for row in rows]
    good = good_settings(rows, "position", 1e-3)
    return [*found, limits.words, *(f"{row.series} {row.value}" for row in good)]


def short_pendulum() -> Case:
    """The pendulum, for a second."""
    return load_case(shipped("pendulum.toml")).with_run("dynamics", until=1.0, n=101)


def ask_choice(folder: Path) -> list[str]:
    """The chosen setting of an engine with its evidence, which a program of its own confirms."""
    case, store, limits = short_pendulum(), Store(folder), Limits()
    rows = search(case, "position", 5e-7, Study(store), engine="mujoco", limits=limits)
    tried = [f"{row.series} {row.value} {row.outcome} {row.cost} {row.errors}" for row in rows]
    try:
        choice = choose(
            case,
            "dynamics",
            rows,
            1e-6,
            engine="mujoco",
            verify=partial(verify, study=Study(store, longest=limits.longest)),
            limits=limits,
        )
    except NoGoodSetting as why:
        return [*tried, without_seconds(str(why))]
    return [*tried, limits.words, *map(without_seconds, describe_choice(choice, case))]


def ask_refusal(folder: Path) -> list[str]:
    """The refusal of a search whose budget ends it."""
    case, limits = short_pendulum(), Limits(budget=2e-3)
    rows = search(case, "position", 5e-8, Study(Store(folder)), engine="pymunk", limits=limits)
    with pytest.raises(NoGoodSetting) as why:
        choose(case, "dynamics", rows, 1e-7, engine="pymunk", limits=limits)
    assert "--budget 2e-3 s" in str(why.value)
    return [str(why.value)]


def ask_diet(folder: Path) -> list[str]:
    """What a model does not need, with its outcomes; the shares of time are measured."""
    model = folder / "arm.xml"
    model.write_text(ARM)
    found = DietSearch(
        load_scene(model, 0.2), Study(Store(folder / "runs")), rounds=8, tune=False
    ).run()
    return [
        f"{entry.kind} {entry.name} {entry.outcome} {without_seconds(entry.message)} {entry.worst}"
        for entry in found.table
    ]


QUESTIONS: dict[str, Callable[[Path], list[str]]] = {
    "rung": ask_rung,
    "causes": ask_causes,
    "order": ask_order,
    "choice": ask_choice,
    "refusal": ask_refusal,
    "diet": ask_diet,
}


def ask(question: Callable[[Path], list[str]], folder: Path) -> list[str]:
    """The answers to a question, with an empty store."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return question(folder)


@pytest.mark.parametrize("speed", [FAST, pytest.param(SLOW, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "name",
    [
        *("rung", "refusal"),  # a search that ends by a count, and a limit of time
        *(pytest.param(o, marks=pytest.mark.slow) for o in ("causes", "order", "choice", "diet")),
    ],
)
def test_no_answer_depends_on_the_speed_of_the_processor(name, speed, tmp_path):
    usual = ask(QUESTIONS[name], tmp_path / "asked")
    assert usual
    with clocks(speed, tmp_path / "clock"):
        assert ask(QUESTIONS[name], tmp_path / "asked") == usual


def test_the_clocks_of_workers_are_changed(tmp_path):
    """The test above would hold if the workers had their usual clocks."""
    from proofmass.base.worker import call_isolated

    with clocks(FAST, tmp_path / "clock"):
        assert call_isolated(clock_ratio, timeout=60) == pytest.approx(FAST, rel=0.5)
    assert call_isolated(clock_ratio, timeout=60) == pytest.approx(1.0, rel=0.5)


def clock_ratio() -> float:
    """The processor time of a loop by the module `time`, over that by the system's clock."""
    began, system = time.process_time(), time.clock_gettime(time.CLOCK_PROCESS_CPUTIME_ID)
    sum(range(3_000_000))
    system = time.clock_gettime(time.CLOCK_PROCESS_CPUTIME_ID) - system
    return (time.process_time() - began) / system


@pytest.mark.slow
@pytest.mark.parametrize("name", QUESTIONS)
def test_no_answer_depends_on_other_processes(name, tmp_path):
    usual = ask(QUESTIONS[name], tmp_path / "asked")
    with busy(BUSY_PROCESSES):
        assert ask(QUESTIONS[name], tmp_path / "asked") == usual


@pytest.mark.slow
def test_all_shipped_cases_have_the_same_verdicts_beside_other_processes():
    files = list(shipped_files())
    usual = verdicts(check(files))
    with busy(BUSY_PROCESSES):
        assert verdicts(check(files)) == usual
