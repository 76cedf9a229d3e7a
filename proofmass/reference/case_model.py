"""The compiled model of a case."""

from mujoco import MjModel

from proofmass.base.errors import model_error
from proofmass.base.read_once import read_once
from proofmass.case.case import Case
from proofmass.sim.mjcf import compile_model
from proofmass.sim.model_files import model_key
from proofmass.sim.protocol.failures import BadModel, BadRod

compile_once = read_once(model_key)(compile_model)
"""`compile_model`, once for each content of the files of a model and for each set of rods."""


def compiled_model(case: Case) -> MjModel:
    """The case's compiled MJCF; it is compiled once for all runs."""
    try:
        return compile_once(case.model_path, case.rods)
    except BadRod as error:
        rod, key, why = error.args
        raise case.error(f"rod.{rod}.{key}", why) from None
    except BadModel as error:
        raise model_error(case.model_path, error) from None
