"""``proofmass new NAME --from ROBOT.urdf``: an MJCF beside the URDF, and a sidecar for it.

MuJoCo reads the URDF; the MJCF gets sensors and the sidecar as if it had been given, see
`proofmass.commands.new_from_model`, which has a model in MJCF to itself.
"""

from pathlib import Path
from secrets import token_hex

from proofmass.base.errors import InputError, model_error
from proofmass.base.files import URDF_ENDING, write_atomically
from proofmass.base.worker import Crashed, OutOfMemory, TimedOut, call_isolated
from proofmass.commands.new_from_model import INSPECTION_SECONDS, write_proposal
from proofmass.sim.model_source import ADVICE, BINARY_ENDING, NO_TEXT
from proofmass.sim.protocol.failures import BadModel


def write_from_file(name: str, model: Path) -> tuple[list[Path], list[str]]:
    """Do what `write_proposal` or `write_from_urdf` does, by the ending of the model's file.

    Raises
    ------
    InputError
        See these; also for a file in another format.
    """
    if model.suffix == URDF_ENDING:
        return write_from_urdf(name, model)
    if why := {**ADVICE, BINARY_ENDING: NO_TEXT}.get(model.suffix):
        raise InputError(model, "", why)
    return write_proposal(name, model)


def write_from_urdf(name: str, urdf: Path) -> tuple[list[Path], list[str]]:
    """Write ``NAME.xml`` and ``NAME.toml`` into the folder of a URDF, which is not changed.

    Parameters
    ----------
    name : str
        Name of the case.
    urdf : Path

    Returns
    -------
    files : list of Path
        The files that were written.
    messages : list of str
        What was not carried over from the URDF, and what `write_proposal` says.

    Raises
    ------
    InputError
        A file exists already, the URDF cannot be read, or `write_proposal` finds no case.
    """
    for ending in (".toml", ".xml"):
        if (file := urdf.with_name(f"{name}{ending}")).exists():
            raise InputError(file, "", "it is there already; give another name")
    try:
        text, remarks = call_isolated(convert_here, urdf, timeout=INSPECTION_SECONDS)
    except BadModel as error:
        raise model_error(urdf, error) from None
    except (TimedOut, OutOfMemory, Crashed) as error:
        raise InputError(urdf, "", f"it cannot be read: {error}") from None
    converted = urdf.with_name(f".{name}-{token_hex(4)}.xml")
    write_atomically(converted, text)
    try:
        files, messages = write_proposal(name, converted)
    except InputError as error:
        if error.file == converted:
            raise InputError(urdf, error.key, error.wrong) from None
        raise
    finally:
        converted.unlink(missing_ok=True)
    return files, [*remarks, *messages]


def convert_here(urdf: Path) -> tuple[str, tuple[str, ...]]:
    """Do what `mjcf_of_urdf` does; it loads MuJoCo."""
    from proofmass.sim.urdf import mjcf_of_urdf

    return mjcf_of_urdf(urdf)
