"""The references that the physics engines are compared with.

The ``solve`` of a reference returns a dict of arrays, one entry per curve. SI units, radians;
angles are counter-clockwise from +x (the pendulum's from straight down) and continuous along the
sweep, which is the last axis. Other modules of this package compute further properties of a
mechanism: Grashof's classes, workspaces, all poses of a platform.

Closed forms consist of formulas only, so that their error is rounding, and need only numpy and
scipy. Those of linkages and contacts refuse numbers that are not finite or larger than
`numerics.LARGEST` with a ValueError that names them. `planar` solves any planar linkage of an MJCF
by iteration and integration; `spatial` integrates any mechanism in space whose equalities are
exact.
"""
