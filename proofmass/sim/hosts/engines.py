"""The engines of this distribution that run in interpreters of their own.

Their scripts are in `proofmass/sim/hosts/scripts`.  MuJoCo in other versions, MJX and MuJoCo Warp
read the MJCF themselves and are in `proofmass.sim.mujoco.hosted`.
"""

from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator

from proofmass.base.strict import Count, StrictNumber
from proofmass.sim.hosts.engine import About, HostedEngine, HostedSettings, SteppedSettings
from proofmass.sim.protocol.part import LoadedPart

if TYPE_CHECKING:
    from proofmass.sim.protocol.tuning import Tuning

NUMPY = "numpy==2.4.6"
"""What scripts need beside an engine that does not need it itself."""
NO_ROTATION_IN_SPACE = "ball joint", "free joint"
"""Joints that an engine of the plane has not."""


class SteppedEngine(HostedEngine):
    """An engine with steps of a given length, whose schemes and defaults studies try as well."""

    tuning: LoadedPart["Tuning"] = LoadedPart("proofmass.sim.hosts.tried_settings:SteppedTuning")


class AccurateEngine(HostedEngine):
    """An engine that chooses its steps by an accuracy, which studies vary."""

    tuning: LoadedPart["Tuning"] = LoadedPart("proofmass.sim.hosts.tried_settings:AccuracyTuning")


class IteratedSettings(SteppedSettings):
    """Settings of an engine whose solver iterates: `iterations` in each step.

    With 500 a five-bar comes apart in pymunk near a singular pose: what they leave there grows,
    since each step closes all that is open.
    """

    iterations: Count = 2000


class RapierSettings(SteppedSettings):
    """Settings of Rapier: `iterations` over all joints in each step.

    With 200, 500 and 2000 a four-bar is off by the same 1e-6 of the range, and a five-bar that
    passes a singular pose by 2.5e-5, 1.1e-5 and 4e-6.
    """

    iterations: Count = 500


class PinocchioSettings(HostedSettings):
    """Settings of Pinocchio, which has no time stepping: the classical RK4 of its script.

    `accuracy` of the proximal solver of loops [SI].
    """

    accuracy: StrictNumber = Field(1e-12, gt=0)


class SimbodySettings(HostedSettings):
    """Settings of Simbody: Runge-Kutta-Merson with an error `accuracy` chooses its own steps."""

    accuracy: StrictNumber = Field(1e-11, gt=0)


class ExudynSettings(HostedSettings):
    """Settings of Exudyn: an implicit `scheme`.

    ``trapezoidal`` is the Newmark rule with index-2 constraints, without numerical damping: loops
    drift apart with second order, and may leave their branch at a change point.  ``generalized
    alpha`` has index-3 constraints and a spectral radius of 0.9, its default: loops stay closed,
    and accelerations have an error at the start that decays.
    """

    scheme: Literal["trapezoidal", "generalized alpha"] = "generalized alpha"


class DrakeSettings(SteppedSettings):
    """Settings of Drake: discrete steps with the SAP solver, or a `continuous` motion of a tree.

    A continuous motion has its velocities at the samples: its `reading` is always plain.
    """

    scheme: Literal["sap", "continuous"] = "sap"

    @model_validator(mode="before")
    @classmethod
    def read_plainly(cls, values: dict[str, object]) -> dict[str, object]:
        """Let a continuous motion be read where it is."""
        return values | ({"reading": "plain"} if values.get("scheme") == "continuous" else {})


PYMUNK = SteppedEngine(
    "pymunk_plain.py",
    ("pymunk==7.3.1", NUMPY),
    title="pymunk",
    about=About(
        "impulses with projection, semi-implicit Euler, in a plane",
        "MIT",
        "2000 iterations, no error bias",
    ),
    settings=IteratedSettings,
    lacks=NO_ROTATION_IN_SPACE,
    planar=True,
    oldest="6.4.0",
    stops=True,
    friction=True,
    contacts=True,
    rests=True,
)
PINOCCHIO = SteppedEngine(
    "pinocchio.py",
    ("pin==4.1.0",),
    title="Pinocchio",
    about=About(
        "exact constraints by a proximal solver; has no time stepping: RK4 of its script",
        "BSD-2-Clause",
        "accuracy 1e-12",
        "the package pinocchio on PyPI is another program",
    ),
    settings=PinocchioSettings,
    rests=True,
)
SIMBODY = AccurateEngine(
    "simbody.py",
    ("opensim==4.6",),
    title="Simbody",
    about=About(
        "exact constraints with projection; Runge-Kutta-Merson with chosen steps",
        "Apache-2.0",
        "accuracy 1e-11",
        "Simbody is part of the package opensim",
    ),
    settings=SimbodySettings,
    rests=True,
)
EXUDYN = SteppedEngine(
    "exudyn.py",
    ("exudyn==1.13.6",),
    title="Exudyn",
    about=About(
        "exact constraints of index 2 or 3; implicit Newmark or generalized-alpha steps",
        "Exudyn licence, like BSD-3-Clause",
        "Newton tolerance 1e-10; begins with the accelerations of two very short steps",
    ),
    settings=ExudynSettings,
    rests=True,
)
DRAKE = SteppedEngine(
    "drake.py",
    ("drake==1.51.1",),
    title="Drake",
    about=About(
        "loops as stiff springs of a convex solver (SAP); semi-implicit steps",
        "BSD-3-Clause",
        "drives with a heavy rotor; a body welded to the world as the ground of loops",
    ),
    settings=DrakeSettings,
    stops=True,
    friction=True,
    contacts=True,
    rests=True,
)
BULLET = SteppedEngine(
    "bullet.py",
    ("pybullet==3.2.7", NUMPY),
    title="Bullet",
    about=About(
        "a tree in reduced coordinates, loops by impulses; semi-implicit Euler",
        "Zlib",
        "at most 2000 iterations; an open loop is closed in one step, instead of 20 % of it; no "
        "damping",
    ),
    settings=IteratedSettings,
    stops=True,
    friction=True,
    contacts=True,
    rests=True,
)
DART = SteppedEngine(
    "dart.py",
    ("dartpy==6.20.0",),
    title="DART",
    about=About(
        "a tree in reduced coordinates, loops by impulses; semi-implicit Euler",
        "BSD-2-Clause",
        "an open loop is closed in one step, instead of 1 % of it; no link falls asleep; contacts "
        "by the collision detector of ODE",
    ),
    settings=SteppedSettings,
    stops=True,
    friction=True,
    contacts=True,
    rests=True,
)
BOX2D = SteppedEngine(
    "box2d.py",
    ("box2d==2.3.10", NUMPY),
    title="Box2D",
    about=About(
        "impulses in single precision, semi-implicit Euler, in a plane",
        "Zlib",
        "2000 iterations; no body falls asleep",
    ),
    settings=IteratedSettings,
    lacks=NO_ROTATION_IN_SPACE,
    planar=True,
    stops=True,
    friction=True,
    contacts=True,
    rests=True,
)
RAPIER = SteppedEngine(
    "rapier.py",
    ("rapier3d==0.36.1", NUMPY),
    title="Rapier",
    about=About(
        "impulses in single precision, semi-implicit Euler",
        "Apache-2.0",
        "500 iterations in one substep, without relaxation behind it; no body falls asleep",
        "the package rapier on PyPI is another program; the bindings are rapier3d",
    ),
    settings=RapierSettings,
    friction=True,
    contacts=True,
    rests=True,
)
NEWTON = HostedEngine(
    "newton.py",
    ("newton==1.8.0",),
    title="Newton",
    about=About(
        "loops by a direct solution in single precision (Kamino, DVI); semi-implicit Euler",
        "Apache-2.0",
        "an open loop is closed in one step, instead of 1 % of it",
        "newton-physics is its former name; a step takes 0.1 s of a processor, and the first run "
        "compiles for minutes",
    ),
    settings=SteppedSettings,
)
