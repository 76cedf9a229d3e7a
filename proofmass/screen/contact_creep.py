r"""Contacts that slip though friction would hold them, since MuJoCo's friction is soft.

Inside the friction cone a contact is a damper: a tangential load f moves it with f R / b, whatever
the time step is.  A body in a grip or on a slope therefore sinks at a constant speed.  The speed is
that of a run: it counts if it is the same at two times, at a contact whose friction is far from its
bound.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.screen.finding import FindingKind, ModelFinding, NamedElement, Severity
from proofmass.screen.pose import named_element
from proofmass.screen.short_run import SECONDS, start_of
from proofmass.sim.mjcf import failure_warning

LONGEST_RUN = 5000
"""Steps of a second up to which a model is run; of finer steps nothing is said."""
LAST_SHARE = 0.8
"""Time of the first of two speeds that have to agree, as a share of the run."""
STEADY = 0.05
"""Largest difference of these two speeds, as a share of the second."""
HELD_SHARE = 0.9
"""Largest tangential force of a contact that sticks, as a share of its friction's bound."""
LEAST_SLIP, SEEN_SLIP = 1e-5, 1e-4
"""Speeds that are told, and that are a warning [m/s]: 0.6 and 6 mm in a minute."""
NOSLIP_ITERATIONS = 10
"""Iterations of MuJoCo's solver without slip that are tried as a remedy."""
HELPFUL_SLOWNESS = 2.0
"""How much slower a remedy has to make a contact [1]."""


@dataclass(frozen=True)
class SlippingContact:
    """A contact that slips inside its friction cone.

    Attributes
    ----------
    geoms : tuple of int
    speed : float
        [m/s]
    used : float
        The tangential force as a share of the bound of friction [1].
    """

    geoms: tuple[int, int]
    speed: float
    used: float


def judge_contact_creep(model: mujoco.MjModel, key: int) -> Iterator[ModelFinding]:
    """The contact that slips fastest, if friction would hold it."""
    slip = find_slip(model, key)
    if slip is None:
        return
    one, other = (named_element(model, "geom", g) for g in slip.geoms)
    yield ModelFinding(
        FindingKind.CREEP,
        Severity.WARNING if slip.speed > SEEN_SLIP else Severity.NOTE,
        f"{one} slips along {other} with {number(1e3 * slip.speed)} mm/s, though the friction of "
        f"their contact holds {number(1.0 / slip.used, 2)} times its load: MuJoCo's friction is "
        "soft",
        propose_noslip(model, key, slip),
        element_with_name(one, other),
        slip.speed,
    )


def element_with_name(one: NamedElement, other: NamedElement) -> NamedElement:
    """The first of two elements, or the second if only that has a name."""
    return other if one.name.isdigit() and not other.name.isdigit() else one


def propose_noslip(model: mujoco.MjModel, key: int, slip: SlippingContact) -> str:
    """The setting of the solver that holds a contact in a run; empty if it does not."""
    changed = copy.copy(model)
    changed.opt.noslip_iterations = max(NOSLIP_ITERATIONS, model.opt.noslip_iterations)
    left = find_slip(changed, key)
    slower = slip.speed / left.speed if left is not None else slip.speed / LEAST_SLIP
    if slower < HELPFUL_SLOWNESS:
        return 'cone="elliptic" with a large impratio'
    at_least = "at least " if left is None else ""
    return (
        f'noslip_iterations="{changed.opt.noslip_iterations}" makes it {at_least}'
        f"{number(slower, 2)} times slower"
    )


def find_slip(model: mujoco.MjModel, key: int) -> SlippingContact | None:
    """The fastest slip of a contact that sticks, at a constant speed, after a second."""
    count = int(np.ceil(SECONDS / model.opt.timestep))
    data = start_of(model, key)
    if count > LONGEST_RUN or not data.ncon:
        return None
    before: dict[tuple[int, int], float] = {}
    for k in range(1, count + 1):
        mujoco.mj_step(model, data)
        if failure_warning(data):
            return None
        if k == int(LAST_SHARE * count):
            before = {slip.geoms: slip.speed for slip in sticking_contacts(model, data)}
    found = [
        slip
        for slip in sticking_contacts(model, data)
        if slip.speed > LEAST_SLIP
        and abs(before.get(slip.geoms, np.inf) - slip.speed) < STEADY * slip.speed
    ]
    return max(found, key=lambda slip: slip.speed, default=None)


def sticking_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[SlippingContact]:
    """The contacts that carry a tangential load which friction holds, of a state after a step."""
    mujoco.mj_forward(model, data)
    for c, contact in enumerate(data.contact[: data.ncon]):
        if contact.dim < 3 or contact.exclude:
            continue
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, c, force)
        bound = float(contact.friction[0] * force[0])
        used = float(np.linalg.norm(force[1:3])) / bound if bound > 0.0 else np.inf
        if 0.0 < used < HELD_SHARE:
            speed = float(np.linalg.norm(slip_velocity(model, data, contact)))
            yield SlippingContact((int(contact.geom1), int(contact.geom2)), speed, used)


def slip_velocity(
    model: mujoco.MjModel, data: mujoco.MjData, contact: "mujoco._structs.MjContact"
) -> Array:
    """The tangential velocity (2,) of a contact's second geom against its first [m/s]."""
    velocity = np.zeros(3)
    for geom, sign in ((contact.geom1, -1.0), (contact.geom2, 1.0)):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, contact.pos, model.geom_bodyid[geom])
        velocity += sign * (jacobian @ data.qvel)
    return np.asarray(contact.frame.reshape(3, 3)[1:] @ velocity)
