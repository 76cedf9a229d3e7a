"""The whole mechanism larger and larger, and smaller and smaller: the curves must scale."""

from collections.abc import Iterator
from functools import partial

import mujoco
import numpy as np

from proofmass.reference import compiled
from proofmass.studies import rescaled
from proofmass.studies.measure import Found
from proofmass.studies.stress.boundary import NAN, Failure, Limit, Sought, Tried
from proofmass.studies.stress.stand import Stand, judged, needs

ROUNDING = 1e-9  # share of a curve's range that rounding may change, at worst in chaos
NULL = 1e-6  # [m] `kFrameEps` of MuJoCo's src/user/user_model.cc


def sizes(stand: Stand) -> Iterator[Sought]:
    """All lengths longer and shorter, beside what MuJoCo compiles at all."""
    model = compiled(stand.case)
    driven = [int(model.joint(drive.joint).type[0]) for drive in stand.case.drive]
    needs(not (stand.case.rod or mujoco.mjtJoint.mjJNT_SLIDE in driven
               or stand.case.reference.endswith(".csv")), "size: the reference has its own lengths")
    needs(len(rescaled.bodies(stand.case)) >= int((model.body_jntnum > 0).sum()),
          "size: masses of geoms")
    weighs = bool(model.opt.gravity.any()) if stand.kind != "duration" else not driven
    least = smallest(model, weighs)
    limit = least if least > 1e-6 else 0.0
    if limit and stand.setting.engine != "mujoco":  # of another engine than the one it is read for
        limit = NAN
    for word, reach, theory in (("larger", 1e6, np.inf), ("smaller", 1e-6, limit)):
        yield stand.sought(f"all lengths {word}", "times", 1.0, reach,
                           partial(resized, stand, least), theory=theory,
                           law="dimensional analysis, of what MuJoCo compiles")


def resized(stand: Stand, least: float, factor: float) -> Tried:
    """Run at another size, down to the least that MuJoCo compiles for other engines as well."""
    if factor < least and stand.setting.engine != "mujoco":
        return Tried(Failure(f"MuJoCo, which reads the model for {stand.setting.engine}, compiles "
                             f"the same mechanism down to {least:.3g} times its size", Limit.OURS))
    found = stand.run(rescaled.larger(stand.case, stand.models, factor))
    return Tried(unlike(found, stand.run(stand.case)), found.step)


def unlike(found: Found, own: Found) -> Failure | None:
    """Why a run at another size is lost: errors must be those at its own, by dimensional analysis.

    What is ten times as large is another curve; rounding is not that of another size.
    """
    if failure := judged(found):
        return failure
    for kind, error in found.errors.items():
        if error > 10.0 * own.errors[kind] + ROUNDING:
            return Failure(f"{kind} off by {error:.2g} of its range, {own.errors[kind]:.2g} at its "
                           f"size", Limit.INACCURATE, silent=True)
    return None


def smallest(model: mujoco.MjModel, weighs: bool) -> float:
    """Size from which on MuJoCo compiles the same mechanism.

    It refuses inertias, s^2 times as large here, up to mjMINVAL, and takes for the origin of its
    body what is less than 1e-6 m from it along each axis: sites, and where bodies weigh anything
    their centres of mass.
    """
    alike = int(mujoco.mjtSameFrame.mjSAMEFRAME_BODYROT)  # turned as their bodies are
    places = model.site_pos[model.site_sameframe == alike]
    centres = model.body_ipos[(model.body_sameframe == alike) & weighs]
    inertia = model.body_inertia[model.body_mass > 0]
    return float(np.concatenate([NULL / np.abs(places).max(axis=1), NULL / np.abs(centres).max(
        axis=1), np.sqrt(mujoco.mjMINVAL / inertia).max(axis=1)]).max())
