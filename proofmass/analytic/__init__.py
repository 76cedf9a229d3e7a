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

REFERENCES = {
    **{
        name: f"proofmass.analytic.linkages.{name}"
        for name in (
            "fivebar",
            "fourbar",
            "hacksaw",
            "inverted_slider_crank",
            "pendulum",
            "shaft_pendulum",
            "slider_crank",
            "swinging_block",
            "threeprr",
        )
    },
    "planar": "proofmass.analytic.planar",
    "spatial": "proofmass.analytic.spatial",
    "refined": "proofmass.analytic.refined",
    **{
        name: f"proofmass.analytic.contacts.{name}"
        for name in (
            "ball_row",
            "bouncing_ball",
            "rocking_block",
            "rolling_ball",
            "sliding_block",
        )
    },
    "balancer": "proofmass.analytic.balancer",
    "balancer_posture": "proofmass.analytic.balancer.posture",
    "spring_release": "proofmass.analytic.balancer.spring_release",
    "rod": "proofmass.analytic.rods",
    **{
        name: f"proofmass.analytic.rods.{name}"
        for name in (
            "rod_pair",
            "rod_pair_driven",
            "rod_pinned",
            "rod_platform",
            "rod_platform_driven",
            "rod_released",
            "rod_snap",
            "spatial_rod",
            "slider_crank_elastic",
        )
    },
}
"""Modules by the name that a sidecar gives as its ``reference``."""
IN_SPACE = ("spatial", "refined", "spatial_rod")
"""References of mechanisms and rods in space, which engines of the plane cannot run."""
