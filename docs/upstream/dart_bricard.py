"""DART 6.20: an overconstrained loop brakes itself with the default error reduction.

    uv run --isolated --no-project --with dartpy==6.20.0 python dart_bricard.py

Bricard's mechanism on the edges of a cube of 1 m: five bars of 1 kg on hinges, and a sixth hinge to
the ground, two points of which are held by BallJointConstraint.  It is let go at rest under gravity
without friction, so that its energy is constant.  With the default error reduction of 0.01 the loop
opens by 0.2 mm, its equations then allow no motion, and half of the energy of the fall is lost, or
an eighth at 0.5 ms.  With 0.05 the same steps keep the energy to 0.3 %.
"""

import dartpy as dart
import numpy as np

STEP, TIME = 1e-3, 10.0
AXES = [[0, 1, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
WAYS = [[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0]]
LAST = np.array([0.0, 0.0, 1.0]), np.array([0.5, 0.0, 1.0])  # points of the sixth hinge


def run(reduction):
    """Share of the energy of the fall that is lost, and the largest opening [m]."""
    world, bricard = dart.simulation.World(), dart.dynamics.Skeleton("bricard")
    world.setTimeStep(STEP)
    world.setGravity([0.0, -9.81, 0.0])
    options = world.getDeactivationOptions()
    options.mEnabled = False
    world.setDeactivationOptions(options)
    node, way = None, np.zeros(3)
    for axis, along in zip(AXES, np.array(WAYS, float), strict=True):
        make = bricard.createRevoluteJointAndBodyNodePair
        joint, node = make() if node is None else make(node)
        joint.setAxis(axis)
        (place := dart.math.Isometry3()).set_translation(way)
        joint.setTransformFromParentBodyNode(place)
        moments = (np.eye(3) - np.outer(along, along)) / 12.0 + 1e-14 * np.outer(along, along)
        node.setInertia(dart.dynamics.Inertia(1.0, along / 2.0, moments))
        way = along
    world.addSkeleton(bricard)
    hold = dart.constraint.BallJointConstraint
    hold.setErrorReductionParameter(reduction)
    local = [node.getWorldTransform().inverse().multiply(point) for point in LAST]
    for point in LAST:
        world.getConstraintSolver().addConstraint(hold(node, point))
    start, lost, opening, fall = bricard.computePotentialEnergy(), 0.0, 0.0, 0.0
    for _ in range(round(TIME / STEP)):
        world.step()
        kinetic, potential = bricard.computeKineticEnergy(), bricard.computePotentialEnergy()
        fall = max(fall, start - potential)
        lost = max(lost, abs(kinetic + potential - start))
        now = [node.getWorldTransform().multiply(one) for one in local]
        opening = max(opening, *(np.linalg.norm(p - q) for p, q in zip(now, LAST, strict=True)))
    return lost / fall, opening


default = dart.constraint.BallJointConstraint.getErrorReductionParameter()
for one in (default, 0.05, 0.1, 1.0):
    lost, opening = run(one)
    print(f"error reduction {one}: {lost:.1%} of the energy lost, loop open by {opening:.1e} m")
