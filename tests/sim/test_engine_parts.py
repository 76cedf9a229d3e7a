"""Parts of engines are loaded when they are asked for, and a check asks for none."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from proofmass import check
from proofmass.base.worker import call_isolated, close_idle_workers
from proofmass.sim.engines import engine_names, engine_of, own_engines
from proofmass.sim.protocol.engine import Engine
from proofmass.sim.protocol.failures import Unsupported
from proofmass.sim.protocol.own_equations import OwnEquations
from proofmass.sim.protocol.part import EnginePart, LoadedPart
from proofmass.sim.protocol.programs import Imposed, Programs
from proofmass.sim.protocol.theory import Theory
from proofmass.sim.protocol.tuning import Tuning
from tests.shipped import shipped

PARTS = {
    name: part
    for engine in map(engine_of, own_engines())
    for kind in type(engine).__mro__
    for name, part in vars(kind).items()
    if isinstance(part, LoadedPart)
}
"""A part of each name that an engine may have."""


def modules_of_parts() -> set[str]:
    """The modules with the parts of all engines of this distribution."""
    places = {
        getattr(type(engine_of(name)), part).made_by for name in own_engines() for part in PARTS
    }
    return {place.partition(":")[0] for place in places if place}


def test_a_check_in_a_worker_loads_no_part_of_an_engine() -> None:
    close_idle_workers()
    assert check([shipped("fourbar.toml")], jobs=1, causes=False).exit_code == 0
    loaded = set(call_isolated(eval, "list(__import__('sys').modules)", timeout=60.0))
    assert {"proofmass.sim.mujoco.engine", "proofmass.sim.pymunk.engine"} <= loaded
    of_engines = {name for name in modules_of_parts() if ".protocol." not in name}
    assert {"proofmass.sim.mujoco.program", "proofmass.sim.mujoco.tried_settings"} <= of_engines
    assert not of_engines & loaded


@pytest.mark.parametrize(
    ("part", "module"),
    [
        ("tuning", "proofmass.sim.mujoco.tried_settings"),
        ("theory", "proofmass.sim.mujoco.theory"),
        ("programs", "proofmass.sim.mujoco.program"),
        ("own_equations", "proofmass.sim.mujoco.own_motion"),
    ],
)
def test_a_part_is_loaded_when_it_is_asked_for(part: str, module: str) -> None:
    code = (
        f"import sys; from proofmass.sim.engines import engine_of; engine = engine_of('mujoco')\n"
        f"assert {module!r} not in sys.modules\n"
        f"assert engine.{part} is engine.{part}\n"
        f"assert {module!r} in sys.modules and type(engine.{part}).__module__ == {module!r}"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_part_of_the_engines_here_can_be_loaded() -> None:
    kinds = {
        "tuning": Tuning,
        "theory": Theory,
        "programs": Programs,
        "own_equations": OwnEquations,
    }
    assert set(PARTS) == set(kinds)
    for engine in map(engine_of, own_engines()):
        for name, kind in kinds.items():
            if getattr(type(engine), name).made_by:
                part = getattr(engine, name)
                assert isinstance(part, kind)
                assert (part.title, part.settings) == (engine.title, engine.settings)


def test_an_engine_says_which_part_it_does_not_have() -> None:
    assert "pymunk" in engine_names()
    with pytest.raises(Unsupported, match=r"^pymunk has no own equations$"):
        _ = engine_of("pymunk").own_equations


def test_an_engine_of_ones_own_states_its_parts_as_classes_or_places() -> None:
    class MyTheory(Theory):
        def orders(self, *_: object) -> tuple[float, ...]:
            return (3.0,)

    class Mine(Engine):
        theory = LoadedPart(MyTheory)
        tuning = LoadedPart("my_package.tuning:MyTuning")
        programs = LoadedPart("proofmass.sim.protocol.programs:MyPrograms")

    class Other(Mine):
        title = "Another"
        programs = LoadedPart()

    assert Mine().theory.orders() == (3.0,)
    assert Other().theory.title == "Another"  # a part belongs to one engine
    words = "Mine: its tuning, my_package.tuning:MyTuning, cannot be loaded: ModuleNotFoundError: "
    with pytest.raises(ValueError, match=f"^{re.escape(words)}"):
        _ = Mine().tuning
    with pytest.raises(ValueError, match=r"MyPrograms, cannot be loaded: AttributeError: "):
        _ = Mine().programs
    with pytest.raises(Unsupported, match=r"^Another has no programs$"):
        _ = Other().programs
    assert isinstance(Mine.theory, LoadedPart)  # the class states it without loading it
    assert issubclass(Mine.theory.made_by, EnginePart)


def test_an_engine_without_a_description_varies_its_time_step_and_has_no_programs() -> None:
    class Bare(Engine):
        settings = engine_of("pymunk").settings

    bare = Bare()
    assert bare.tuning.size("timestep", 0.5) == 0.5
    assert bare.tuning.at_step({"iterations": 3}, 0.1) == {"iterations": 3, "timestep": 0.1}
    assert bare.theory.schemes == () == tuple(bare.theory.limit_problems())
    assert bare.programs.write_snippet({"timestep": 0.1}, 10) == ""  # a table of the sidecar
    with pytest.raises(Unsupported, match=r"^Bare has no programs$"):
        bare.programs.write_program(Path(), None, "", "", Imposed("gear"))  # type: ignore[arg-type]
