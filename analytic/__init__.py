"""The references that the physics engines are compared with.

A module with a ``solve`` is one: it returns a dict of arrays, one entry per curve. SI units,
radians; angles are counter-clockwise from +x (the pendulum's from straight down) and continuous
along the sweep, which is the last axis. Modules without one hold what belongs to a mechanism beside
its motion: Grashof's classes, workspaces, all poses of a platform.

Closed forms are formulas only, so what is left is rounding, and need no more than numpy and scipy.
`planar` solves any planar linkage of an MJCF by iteration and integration; `newton_raphson` and
`hacksaw_newton` do as the documents did.
"""
