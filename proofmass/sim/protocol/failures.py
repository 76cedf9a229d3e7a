"""What an engine may raise: each exception is an outcome of a run, or an error of its model."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from proofmass.sim.protocol.curves import Curves


class Unsupported(Exception):
    """The simulator cannot express something in the model; the message names it."""


class Unavailable(Unsupported):
    """The simulator is not installed here and cannot be had; the message says why."""


class Diverged(Exception):
    """The run failed: a value is not finite, the engine reset the state, or the loops opened.

    A message that begins with ``NAME warning`` is the engine's own.  `curves` are the curves up to
    the last sample before the failure, if the engine has them.
    """

    def __init__(self, message: str = "", curves: "Curves | None" = None) -> None:
        super().__init__(message)
        self.curves = curves


class NotSolved(Diverged):
    """The engine found no equilibrium or motion within its limits of steps, iterations or time."""


class BadModel(Exception):
    """The model cannot be used: it is unreadable, not assembled, or lacks an element."""


class BadRod(BadModel):
    """A rod cannot be built; the arguments are its name, the key that is wrong, and the reason."""

    def __str__(self) -> str:
        return "rod {!r}: {}: {}".format(*self.args)


class BadSetting(BadModel):
    """An engine does not accept a setting; the arguments are its name and what is wrong."""

    def __str__(self) -> str:
        return "setting {}: {}".format(*self.args)
