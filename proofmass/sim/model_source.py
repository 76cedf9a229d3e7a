"""A model without a sidecar, in any form in which a person has it: a file, or an object of MuJoCo.

A file is an MJCF, a URDF, or an MJB, which is a compiled model; its ending says which.  A worker
reads the file; an ``MjModel`` is sent to it, and so is an ``MjSpec`` in its compiled form.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from proofmass.base.errors import InputError
from proofmass.base.files import MODEL_ENDING, URDF_ENDING
from proofmass.sim.protocol.failures import BadModel

if TYPE_CHECKING:
    import mujoco

BINARY_ENDING = ".mjb"
SEARCHED_ENDINGS = MODEL_ENDING, URDF_ENDING
"""Endings of the models that are looked for in folders; an MJB is read if it is named."""
SOURCE_ENDINGS = *SEARCHED_ENDINGS, BINARY_ENDING
"""Endings of files that a model is read from."""
DEFAULT_NAME = "MuJoCo Model"  # the name that MuJoCo gives to a model without one
ADVICE = {
    ".sdf": (
        "SDF is not read; convert it to MJCF with sdf2mjcf of gz-mujoco, which needs Gazebo's "
        "sdformat and gz-math, or give the URDF"
    ),
    ".xacro": "macros of xacro are not expanded here; write the URDF first: xacro FILE > NAME.urdf",
    ".mjcf": "an MJCF is read if its name ends in .xml; rename it",
    ".usd": "USD is not read; give an MJCF, a URDF or an MJB",
}
"""What to do with models in other formats, by the ending of the file."""
NO_TEXT = "a compiled model has no text to write sensors into; give the MJCF that it was made of"


class SourceReading(NamedTuple):
    """A compiled model, and remarks on what reading it left out or assumed."""

    model: "mujoco.MjModel"
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class ModelSource:
    """A model without a sidecar.

    Attributes
    ----------
    file : Path
        Its file; for an object of MuJoCo a name that stands for it in messages.
    model : MjModel or None
        The model, if it was given as an object.
    within : Path or None
        The folder that a user named, in which the file was found; None if the file was named.
    """

    file: Path
    model: "mujoco.MjModel | None" = None
    within: Path | None = None

    @property
    def is_file(self) -> bool:
        """Whether the model is in a file."""
        return self.model is None

    @property
    def may_lose(self) -> bool:
        """Whether reading it may leave something out, so that there are remarks."""
        return self.is_file and self.file.suffix == URDF_ENDING

    def read(self) -> SourceReading:
        """Compile the model.

        Raises
        ------
        BadModel
            The file is at fault, or a number of the model is not finite or too large.
        """
        from proofmass.sim.mjcf import compile_model, require_usable

        if self.model is not None:
            return SourceReading(require_usable(self.model, self.file.name))
        if self.file.suffix == URDF_ENDING:
            from proofmass.sim.urdf import read_urdf

            found = read_urdf(self.file, self.within)
            return SourceReading(require_usable(found.model, self.file.name), found.remarks)
        if self.file.suffix == BINARY_ENDING:
            return SourceReading(require_usable(read_binary(self.file), self.file.name))
        return SourceReading(compile_model(self.file))


def read_binary(file: Path) -> "mujoco.MjModel":
    """Read an MJB, which MuJoCo of the same version has written.

    Raises
    ------
    BadModel
        MuJoCo does not read it.
    """
    import mujoco

    if not file.is_file():
        raise BadModel(f"{file.name}: no such file, or no regular file")
    from proofmass.sim.mjcf import collected_warnings

    with collected_warnings() as warned:
        try:
            return mujoco.MjModel.from_binary_path(os.fsencode(file))
        except (ValueError, mujoco.FatalError) as error:
            why = "; ".join(" ".join(one.split()) for one in warned) or " ".join(str(error).split())
    raise BadModel(
        f"{file.name}: MuJoCo {mujoco.__version__} cannot read it: {why}; an MJB is read by the "
        "version that wrote it: give the MJCF"
    )


def is_model_object(thing: Any) -> bool:
    """Whether something is an ``MjModel`` or an ``MjSpec``; MuJoCo is not loaded for that."""
    module = sys.modules.get("mujoco")
    return module is not None and isinstance(thing, (module.MjModel, module.MjSpec))


def source_of_object(thing: Any, name_of: Callable[[str], str]) -> ModelSource:
    """The source of an ``MjModel`` or an ``MjSpec``, which stays as it is.

    Parameters
    ----------
    thing : MjModel or MjSpec
    name_of : callable
        Makes a name that no other has of the one that the model states, or of ``model``.

    Raises
    ------
    InputError
        The specification cannot be compiled.
    """
    import mujoco

    if isinstance(thing, mujoco.MjModel):
        own = thing.names[: thing.names.index(b"\0")].decode(errors="replace")
        return ModelSource(Path(name_of(stated_name(own))), thing)
    name = name_of(stated_name(thing.modelname))
    try:
        return ModelSource(Path(name), thing.copy().compile())
    except (ValueError, mujoco.FatalError) as error:
        words = " ".join(str(error).split()).removeprefix("Error: ")
        raise InputError(Path(name), "", f"MjSpec cannot be compiled: {words}") from None


def stated_name(name: str) -> str:
    """The name that a model states, without what a path would be; ``model`` if it states none.

    >>> stated_name("arm"), stated_name("MuJoCo Model"), stated_name("a/b")
    ('arm', 'model', 'a_b')
    """
    return name.replace("/", "_") if name not in ("", DEFAULT_NAME) else "model"
