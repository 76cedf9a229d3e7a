"""Engines in interpreters of their own: what they return, how they fail, and that others go on."""

import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from proofmass import load_case
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.run import solve
from proofmass.run.solve import prescribed_run
from proofmass.sim.engines import NoEngine, engine_of, is_engine
from proofmass.sim.hosts.engine import About, HostedEngine, SteppedSettings
from proofmass.sim.hosts.process import (
    explain_uv,
    measure_start,
    own_processors,
    provide,
)
from proofmass.sim.interpreter import wire
from proofmass.sim.interpreter.mechanism import LinkStates, NeutralGear, NeutralLink
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.failures import Unavailable, Unsupported
from tests.shipped import MODELS

SCRIPT = Path(__file__).parent / "pendulum_host.py"


class SwingSettings(SteppedSettings):
    """Settings of the host of the tests: the way in which it fails."""

    fails: str = ""


SWING = HostedEngine(
    SCRIPT,
    (f"numpy=={np.__version__}",),
    title="Swing",
    about=About("one hinge", "none"),
    settings=SwingSettings,
    python=sys.executable,
)


def swing(**settings: object) -> Curves:
    """The pendulum in the host of the tests; called in a worker."""
    case = load_case(MODELS / "linkages/pendulum.toml")
    run = replace(prescribed_run(case, "dynamics"), settings=settings)
    return SWING.simulate(case.model_path, run)


def swing_isolated(timeout: float = 60.0, memory: float = 4.0, **settings: object) -> Curves:
    """The same in a worker with limits."""
    return call_isolated(swing_with, settings, timeout=timeout, memory=memory)


def swing_with(settings: dict) -> Curves:
    """`swing` with settings as a dict."""
    return swing(**settings)


@pytest.mark.skipif(not own_processors(), reason="runs are not pinned here")
def test_an_interpreter_uses_the_processors_of_each_run() -> None:
    """One that was started in a pinned run is not kept on the processor of that run."""
    every = own_processors()
    try:
        for numbers in (every[:1], every[-1:], every):
            os.sched_setaffinity(0, numbers)
            with pytest.raises(Crashed, match=f"ValueError: {' '.join(map(str, numbers))} "):
                swing(fails="tells its processors")
    finally:
        os.sched_setaffinity(0, every)


def test_the_start_of_an_interpreter_takes_processor_time() -> None:
    """It imports NumPy at least, which no processor does in a millisecond."""
    assert measure_start(SCRIPT, SWING.requires, sys.executable) > 1e-3


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """The angle of the pendulum in MuJoCo, which has it to 1e-11."""
    case = load_case(MODELS / "linkages/pendulum.toml")
    run = prescribed_run(case, "dynamics")
    return engine_of("mujoco").simulate(case.model_path, run).channels["angle"]


@pytest.mark.parametrize(("reading", "order"), [("plain", 1), ("half step", 2)])
def test_readings_have_their_orders(truth: np.ndarray, reading: str, order: int) -> None:
    """Semi-implicit steps are of first order, and of second order if read half a step later."""
    errors = [
        np.abs(swing(timestep=h, reading=reading).channels["angle"] - truth).max()
        for h in (1e-3, 5e-4)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.05)


def test_half_step_reading_gives_rates_of_second_order(truth: np.ndarray) -> None:
    """The kinetic energy, which is read from velocities alone, gains an order as well."""
    case = load_case(MODELS / "linkages/pendulum.toml")
    run = prescribed_run(case, "dynamics")
    exact = engine_of("mujoco").simulate(case.model_path, run).channels["kinetic"]
    errors = [np.abs(swing(timestep=h).channels["kinetic"] - exact).max() for h in (1e-3, 5e-4)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.05)


def test_versions_and_cost_are_recorded() -> None:
    """A run says what computed it, with the step it made."""
    curves = swing(timestep=5e-4)
    assert curves.versions == {"swing": "1.0"}
    assert "Computed by swing 1.0." in curves.notes
    assert curves.made_step == 5e-4
    assert curves.seconds > 0


def test_output_of_an_engine_does_not_disturb() -> None:
    """What an engine prints, by Python or by C, is no part of an answer."""
    quiet, loud = swing(), swing(fails="prints")
    assert np.array_equal(quiet.channels["angle"], loud.channels["angle"])


def test_exception_of_an_engine_is_a_crash_of_its_run() -> None:
    """The run has the engine's own words, and the interpreter makes the next run."""
    with pytest.raises(Crashed, match="ValueError: the engine is not content"):
        swing(fails="raises")
    assert len(swing().channels["angle"])


@pytest.mark.parametrize(
    ("fails", "words"),
    [("dies", r"SIGABRT.*the engine's last words"), ("exits", "exit code 3")],
)
def test_dead_interpreter_costs_its_run_only(fails: str, words: str) -> None:
    """A dead interpreter is a crash with its last words; the next run starts another."""
    with pytest.raises(Crashed, match=words):
        swing(fails=fails)
    assert len(swing().channels["angle"])


def test_engine_that_hangs_is_ended() -> None:
    """The limit of processor time of a worker holds for its interpreter."""
    with pytest.raises(TimedOut):
        swing_isolated(timeout=3.0, fails="computes for ever")


def test_interpreter_has_the_timers_of_a_worker() -> None:
    """An interpreter that waits for ever does not outlive its worker: wall time has a limit too."""
    with pytest.raises(Crashed) as crash:
        swing_isolated(timeout=10.0, fails="tells its timers")
    processor, wall = (float(one) for one in str(crash.value).split()[1:3])
    assert 0 < processor <= 10.0
    assert 99.0 * processor < wall <= 1000.0  # 100 times, and the system counts in ticks


def test_engine_that_eats_memory_is_ended() -> None:
    """So does the limit of memory."""
    with pytest.raises(OutOfMemory, match="1 GiB"):
        swing_isolated(memory=1.0, fails="eats memory")


def test_refusal_is_unsupported() -> None:
    """What a script refuses is unsupported, in its words."""
    case = load_case(MODELS / "linkages/fourbar.toml")
    with pytest.raises(Unsupported, match="more than one joint"):
        SWING.simulate(case.model_path, prescribed_run(case, "dynamics"))


def test_sweeps_and_contacts_are_refused() -> None:
    """A neutral mechanism is one of runs in time, without contacts."""
    case = load_case(MODELS / "linkages/fourbar.toml")
    with pytest.raises(Unsupported, match="sweep: the engine is stepped in time only"):
        SWING.simulate(case.model_path, prescribed_run(case, "sweep"))
    case = load_case(MODELS / "contacts/ball_bounces.toml")
    with pytest.raises(Unsupported, match="contacts"):
        SWING.simulate(case.model_path, prescribed_run(case, "dynamics"))


def test_script_that_cannot_be_loaded(tmp_path: Path) -> None:
    """The error of the script's import is that of the run."""
    script = tmp_path / "broken.py"
    script.write_text("import no_such_engine\n")
    pins = (f"numpy=={np.__version__}",)
    engine = HostedEngine(script, pins, title="X", about=About("", ""), python=sys.executable)
    case = load_case(MODELS / "linkages/pendulum.toml")
    with pytest.raises(Crashed, match="no_such_engine"):
        engine.simulate(case.model_path, prescribed_run(case, "dynamics"))


def test_interpreter_imports_nothing_of_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stranger's folder is not searched for modules, and its uv configuration is not read."""
    (tmp_path / "numpy.py").write_text("raise SystemExit(9)")
    (tmp_path / "uv.toml").write_text("no toml at all [")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert len(swing().channels["angle"])


def test_requirement_needs_one_version() -> None:
    """What computes must be known before a run."""
    with pytest.raises(ValueError, match="give one version"):
        HostedEngine("x.py", ("x>=1",), title="X", about=About("", ""))


def test_digest_and_pins_identify_what_computes() -> None:
    """Stored results depend on the packages and on the script."""
    there = SWING.versions()
    assert there["numpy"] == np.__version__
    assert len(there["host"]) == 64
    assert SWING.at_version("2.0").versions() == there | {"numpy": "2.0"}


def test_engines_at_versions() -> None:
    """A name may state a version; engines of this interpreter alone refuse that."""
    assert engine_of("mujoco==3.6.0").title == "MuJoCo 3.6.0"
    assert engine_of("mujoco==3.6.0:default").requires == ("mujoco==3.6.0",)  # type: ignore
    assert engine_of("pymunk==6.8.1").planar
    assert is_engine("drake==1.50.0")
    assert not is_engine("drak")
    with pytest.raises(NoEngine, match="is no version"):
        engine_of("mujoco==newest")
    with pytest.raises(NoEngine, match="only in the version"):
        engine_of("recorded==1.0")
    with pytest.raises(NoEngine, match="drake"):
        engine_of("drak==1.0")


@pytest.mark.parametrize("mark", ["@", "=", " ", "-", "", ">=", "@v"])
def test_another_mark_before_a_version_is_named(mark: str) -> None:
    """A version is asked for by one mark; what looks like another one is no other name."""
    with pytest.raises(NoEngine, match=r"a version is asked for by '==': mujoco==3\.2\.0$"):
        engine_of(f"mujoco{mark}3.2.0")
    with pytest.raises(NoEngine, match="no simulator 'mujoco-x'; did you mean 'mujoco'"):
        engine_of("mujoco-x")


def test_without_uv_an_engine_is_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said in words, by the fetching and by the run."""
    monkeypatch.setattr("proofmass.sim.hosts.process.find_uv", no_uv)
    assert "no uv here" in provide(("x==1",))
    case = load_case(MODELS / "linkages/pendulum.toml")
    with pytest.raises(Unavailable, match="no uv here"):
        engine_of("mujoco==3.5.0").simulate(case.model_path, prescribed_run(case, "dynamics"))


def no_uv() -> str:
    """A machine without uv."""
    raise Unavailable("no uv here")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ("Because there is no version of x==9 and you", "x==9 is not in the package index"),
        ("x==9 has no wheels with a matching Python ABI tag", "no wheel for this Python"),
        ("Connection refused", "cannot be had: Connection refused"),
        ("", "uv does not say why"),
    ],
)
def test_words_of_uv(said: str, words: str) -> None:
    """What uv says becomes a line."""
    assert words in explain_uv(said, ("x==9",))


def test_messages_come_back_as_they_were() -> None:
    """Data classes, arrays, tuples, dicts and numbers survive; code has no place in a message."""
    link = NeutralLink("bar", 1.0, np.eye(3), np.zeros(3), np.ones(3), np.zeros(3), 2)
    gear = NeutralGear("mesh", 0, 1, -0.5, 0.1)
    message = {"links": (link, gear), "list": [1, 2.5, None, True, "é"], "one": np.float64(0.1)}
    back = wire.unpack(wire.pack(message))
    assert back["list"] == message["list"]
    assert back["one"] == 0.1
    assert back["links"][1] == gear
    for name, value in vars(link).items():
        assert np.array_equal(vars(back["links"][0])[name], value)


def test_message_with_code_is_refused(tmp_path: Path) -> None:
    """An array of objects, which would be unpickled, is not read."""
    file = tmp_path / "evil.npz"
    np.savez(file, text=np.array([object()], dtype=object))
    with pytest.raises(ValueError, match="allow_pickle"):
        wire.unpack(file.read_bytes())


def test_states_end_where_a_run_failed() -> None:
    """The first samples are kept with the reason."""
    none = np.zeros((5, 2, 3))
    states = LinkStates(none, none, none, np.zeros((5, 2, 3, 3)), none, none)
    assert states.first(2, "lost").place.shape == (2, 2, 3)
    assert states.first(2, "lost").failed == "lost"


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("import no_such_engine", "No module named 'no_such_engine': add its package"),
        ("VERSIONS = {}", "broken.py has no simulate"),
        ("def simulate(m, s): ...", "broken.py has no VERSIONS"),
        (
            "VERSIONS = {}\ndef simulate(m, s):\n    return None",
            "returned NoneType, not LinkStates",
        ),
        (
            "VERSIONS = {}\ndef simulate(m, s):\n    return s['no such setting']",
            r"KeyError: 'no such setting' \(broken.py, line 3\)",
        ),
        (
            "from proofmass_host import record\nVERSIONS = {}\n"
            "def simulate(m, s):\n    return record(m, print, lambda k: (1, 2, 3))",
            r"read\(1\) returned 3 things",
        ),
        (
            "from proofmass_host import record\nimport numpy as np\nVERSIONS = {}\n"
            "def simulate(m, s):\n    x = np.zeros(3)\n"
            "    return record(m, print, lambda k: (x, np.zeros(4), x, x))",
            r"expected place \(3,\), rotation \(3, 3\)",
        ),
    ],
)
def test_faults_of_a_script_are_named(tmp_path: Path, script: str, words: str) -> None:
    """With the line of the script, or what it lacks."""
    file = tmp_path / "broken.py"
    file.write_text(script + "\n")
    pins = (f"numpy=={np.__version__}",)
    engine = HostedEngine(file, pins, title="X", about=About("", ""), python=sys.executable)
    case = load_case(MODELS / "linkages/pendulum.toml")
    with pytest.raises(Crashed, match=words):
        engine.simulate(case.model_path, prescribed_run(case, "dynamics"))


def test_interpreter_with_another_version_is_unavailable() -> None:
    """What an interpreter has is asked, so that a version is never the name alone."""
    case = load_case(MODELS / "linkages/pendulum.toml")
    with pytest.raises(Unavailable, match=f"has numpy {np.__version__}, and not numpy 1.2.3"):
        SWING.at_version("1.2.3").simulate(case.model_path, prescribed_run(case, "dynamics"))
    nowhere = HostedEngine(
        SCRIPT, ("numpy==1.2.3",), title="X", about=About("", ""), python="/nowhere/python"
    )
    assert nowhere.provide() == "there is no interpreter /nowhere/python"
    with pytest.raises(Unavailable, match="/nowhere/python"):
        nowhere.simulate(case.model_path, prescribed_run(case, "dynamics"))


def test_requirements_are_a_tuple() -> None:
    """A text alone is a sequence of letters."""
    with pytest.raises(ValueError, match="give a tuple"):
        HostedEngine("x.py", "x==1", title="X", about=About("", ""))


@pytest.mark.parametrize("error", [TimedOut("of time"), OutOfMemory("of memory"), Crashed("dead")])
def test_limits_of_an_interpreter_are_outcomes_of_the_run(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Time and memory are no crash, as in other engines."""

    class Failing(HostedEngine):
        def simulate(self, model: Path, run: object) -> Curves:
            raise error

    engine = Failing(SCRIPT, ("x==1",), title="X", about=About("", ""))
    monkeypatch.setattr(solve, "engine_of", lambda name: engine)
    with pytest.raises(type(error), match=f"^{error}$"):
        solve.call_engine("x", Path(), None)  # type: ignore[arg-type]
