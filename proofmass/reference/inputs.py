"""What was read of the files of a case, and the key of all that its reference depends on."""

from functools import lru_cache

from mujoco import MjModel

from proofmass.base.errors import model_error
from proofmass.base.files import content_key
from proofmass.case.case import Case
from proofmass.sim.mjcf import compile_model, model_key
from proofmass.sim.protocol.failures import BadModel, BadRod

RESULTS_IN_MEMORY = 64
"""Number of compiled models in memory; a study tries many numbers of rod links."""
compile_once = lru_cache(RESULTS_IN_MEMORY)(lambda file, content, rods: compile_model(file, rods))


def compiled_model(case: Case) -> MjModel:
    """The case's compiled MJCF; it is compiled once for all runs."""
    try:
        return compile_once(case.model_path, model_key(case.model_path), case.rods)
    except BadRod as error:
        rod, key, why = error.args
        raise case.error(f"rod.{rod}.{key}", why) from None
    except BadModel as error:
        raise model_error(case.model_path, error) from None


def reference_identity(case: Case) -> tuple[str | int, ...]:
    """A key that differs for cases with different reference curves: their tables and files."""
    asked = repr(case.model_copy(update={"settings": {}, "tolerance": ()}).model_dump())
    files = [case.file.parent / case.reference] if case.recorded or case.program else []
    return asked, *model_key(case.model_path), *map(content_key, [*case.profile_files, *files])
