"""The motion of a model by itself, which an engine solves in several ways."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

from proofmass.base.arrays import Array
from proofmass.sim.protocol.curves import Curves
from proofmass.sim.protocol.part import EnginePart
from proofmass.sim.protocol.run import ChangingLoad, Drive, Run

if TYPE_CHECKING:
    from mujoco import MjModel


STIFFENING_FACTOR = 4.0
"""How many times as stiff the constraints are in the run that shows their softness [1]."""


@dataclass(frozen=True)
class OwnRun:
    """One way to solve the motion of a model by itself.

    Attributes
    ----------
    name : str
        Such as ``Euler, 2 ms``.
    step : float
        Time step [s]; 0 if the steps are chosen by an error tolerance.
    seconds : float
        Processor time [s].
    points : ndarray (samples, bodies, points, 3)
        Points of each body [m]; fewer samples if the run ended early.
    energy, depth, gap : ndarray (samples,)
        Kinetic energy and potential energy of gravity and springs [J], the deepest penetration of a
        contact [m], and the largest opening of a loop [m or rad].
    stopped, late : str, bool
        Why the run ended early, and whether its processor time was over.
    work : float
        Processor time that the run's steps and evaluations count, the same on every machine [s];
        NaN if the engine does not count it.
    evaluations : float
        Evaluations of the dynamics in a second of the motion, as `UntriedWay` counts them [1/s];
        NaN if the engine does not count them.
    opening_unit : str
        That of the largest opening at the start.
    """

    name: str
    step: float
    seconds: float
    points: Array
    energy: Array
    depth: Array
    gap: Array
    stopped: str = ""
    late: bool = False
    work: float = nan
    evaluations: float = nan
    opening_unit: str = "m or rad"

    @property
    def is_failure(self) -> bool:
        """Whether it ended early, and not since its processor time was over."""
        return bool(self.stopped) and not (self.late and len(self.points) > 1)


@dataclass(frozen=True)
class UntriedWay:
    """A setting with which a motion may be solved.

    Attributes
    ----------
    evaluations : float
        Evaluations of the dynamics in a second of the motion [1/s]: one a step, four in RK4.
    solve : callable
        Solves the motion; its argument is the largest counted processor time [s].
    seconds : float
        Counted processor time that all such ways together may take [s].
    """

    evaluations: float
    solve: Callable[[float], OwnRun]
    seconds: float


@dataclass(frozen=True)
class OwnMotion:
    """The motion of a model without a sidecar, solved in several ways.

    Attributes
    ----------
    times : ndarray (samples,)
        [s]
    extent : float
        Size of the model [m].
    runs : tuple of OwnRun
        Runs with the model's own settings and its step, half of it, a quarter of it, ..; those with
        finer steps may have fewer samples.  If the model fails with its own step, they begin with
        the first halving that does not.
    close, rough : OwnRun
        Runs by an integrator that chooses its steps, with a narrow and with a wide tolerance.
    compared : int
        Number of the run in `runs` with which `disturbed` and `stiffer` are compared.
    disturbed : OwnRun
        Run with a start pose that differs by `disturbance`.
    others : tuple of OwnRun
        Runs with other settings, and with the model's own step or finer ones.
    stiffer : OwnRun or None
        Run with contacts, loops, limits and dry friction that are `STIFFENING_FACTOR` times as
        stiff; None if there are none.
    dof : int
        Degrees of freedom of the model without its loops.
    disturbance : float
        Change of the start pose, as a share of the size [1] and in rad.
    notes : tuple of str
        Warnings of the engine, a sentence each.
    failed : OwnRun or None
        The run with the model's own step, if it failed and a finer step does not.
    """

    times: Array
    extent: float
    runs: tuple[OwnRun, ...]
    close: OwnRun
    rough: OwnRun
    compared: int
    disturbed: OwnRun
    others: tuple[OwnRun, ...]
    stiffer: OwnRun | None
    dof: int
    disturbance: float = 1e-9
    notes: tuple[str, ...] = ()
    failed: OwnRun | None = None


ChooseWays = Callable[[OwnMotion, Sequence[UntriedWay]], tuple[OwnRun, ...]]
"""Solves some of the ways that are not tried yet, of a motion that is known from others."""


def choose_none(motion: OwnMotion, ways: Sequence[UntriedWay]) -> tuple[OwnRun, ...]:
    """No other ways."""
    return ()


class OwnEquations(EnginePart):
    """Solutions of a model's own motion, by an engine whose equations are those of the MJCF."""

    def solve_motion(
        self,
        model: "Path | MjModel",
        until: float,
        samples: int,
        seconds: float,
        start: str = "start",
        drives: tuple[Drive, ...] = (),
        loads: tuple[ChangingLoad, ...] = (),
        choose: ChooseWays = choose_none,
    ) -> OwnMotion:
        """Solve the motion of a model by itself in several ways.

        Parameters
        ----------
        model : Path or MjModel
            The MJCF file, or a compiled model, which is not changed.
        until, samples : float, int
            Duration of the motion [s], and approximate number of samples.
        seconds : float
            Approximate processor time for all ways together, counted and not measured [s].
        start : str
            Key of the model from which the motion starts; the first key if there is none of that
            name.
        drives, loads : tuple of Drive, tuple of ChangingLoad
            Prescribed motions and controls, if any.
        choose : callable
            Chooses and solves the ways with other integrators, `OwnMotion.others`.

        Raises
        ------
        BadModel, Unsupported
        """
        raise NotImplementedError

    def solve_closely(self, path: Path, run: Run) -> Curves:
        """Solve a motion without fixed time steps, as accurately as possible.

        Raises
        ------
        BadModel, Unsupported, NotSolved
        """
        raise NotImplementedError
