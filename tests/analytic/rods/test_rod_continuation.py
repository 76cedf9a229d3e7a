"""Paths of flexible mechanisms: load ramps, trajectories, folds, and manifolds over a grid."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from proofmass.analytic.rods.continuation import follow, trace
from proofmass.analytic.rods.equilibrium import (
    RodState,
    closure,
    derivatives,
    solve_direct,
    solve_inverse,
    state,
)
from proofmass.analytic.rods.workspace import find_singularities, map_equilibria
from tests.analytic.rods.rod_assembly_cases import (
    DATA,
    PAIR,
    TABLE_7_NAMES,
    table_7_state,
    three_rod_platform,
)

PATHS, TABLE7 = DATA["trajectories"], DATA["rfr2"]["recomputed"]
MIRROR = [-1.0, 1.0]


@cache
def unloaded_start():
    """Start of the document's trajectories: the pin of S2, without load."""
    s = table_7_state("S2")
    return follow(s, pose=s.pose[None], load=[[0.0, 0.0]]).last


@cache
def path_over_the_fold():
    """The path from there by turning motor 1, over a fold, and back on the other side of it."""
    return trace(unloaded_start(), inputs=[1.0, 0.0], to=(-1.0, 0.0))


@pytest.mark.parametrize("name", TABLE_7_NAMES)
def test_unloading_leads_to_the_recomputed_equilibria(name):
    """S1 to S4 are unloaded with fixed motors and with a fixed pin, to the recomputed values."""
    s, row = table_7_state(name), TABLE7[name]
    ramp = np.outer([0.5, 0.0], s.load)
    free, pinned = follow(s, load=ramp), follow(s, load=ramp, pose=np.tile(s.pose, (2, 1)))
    assert free.reached == pinned.reached == 2
    assert np.abs(free.last.pose - row["unloaded_pose"]).max() <= 1e-6  # seven decimals
    # recomputed by RK4 with 400 steps and six digits of the pose, times dq/dP up to 20 rad/m
    assert np.abs(np.degrees(pinned.last.inputs) - row["unloaded_inputs_deg"]).max() <= 1e-4
    assert np.abs(pinned.states.pose - s.pose).max() <= 1e-15  # rounding of steps of up to 0.9 m


def test_clamp_moment_crosses_zero_smoothly():
    """As S2 is unloaded, the moment at clamp 1 passes zero without a kink.

    The elliptic form changes the sign of k and the mode there, so that its Newton method fails.
    """
    s = table_7_state("S2")
    m = follow(s, load=np.outer(np.linspace(1.0, 0.0, 21)[1:], s.load)).states.moment[:, 0]
    assert m[0] < 0.0 < m[-1]
    assert m[-1] == pytest.approx(0.005433, abs=1e-6)  # recomputed
    fit = np.polynomial.Chebyshev.fit(np.arange(20), m, 10)
    assert np.abs(fit(np.arange(20)) - m).max() <= 1e-9  # N m: a kink of 1 % leaves 1e-5


def test_motor_angles_along_a_ring_are_the_recomputed_ones():
    """Motor angles along a ring of diameter 0.2 m are the recomputed ones, and the ring closes."""
    rows = PATHS["ring"]
    turn = np.radians([*(row["angle_deg"] for row in rows), 360.0])
    way_points = unloaded_start().pose + 0.1 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    followed = follow(unloaded_start(), pose=way_points)
    assert not followed.why
    wanted = np.array([row["inputs_deg"] for row in rows])
    # five decimals, from a centre with eight digits
    assert np.abs(np.degrees(followed.states.inputs[:-1]) - wanted).max() <= 1e-4
    found = np.linalg.det(derivatives(followed.states[np.arange(8)]).inverse)
    assert found == pytest.approx([row["determinant"] for row in rows], rel=1e-4)
    assert np.abs(followed.states.inputs[-1] - followed.states.inputs[0]).max() <= 1e-9  # it closes


def test_motor_angles_along_a_line_do_not_depend_on_the_stride():
    """Motor angles along a line are the recomputed ones, and do not depend on the stride."""
    rows = PATHS["line"]
    way_points = unloaded_start().pose + np.outer([row["dx"] for row in rows], [1.0, 0.0])
    coarse = follow(unloaded_start(), pose=way_points)
    wanted = [row["inputs_deg"] for row in rows]
    assert np.abs(np.degrees(coarse.states.inputs) - wanted).max() <= 1e-4  # four to five decimals
    fine = follow(unloaded_start(), pose=way_points[:2], stride=0.25)
    assert np.abs(fine.states.inputs - coarse.states.inputs[:2]).max() <= 1e-9  # the same branch


def test_the_path_of_a_rectangle_closes():
    """The motors are back at their start after the document's square of 0.2 m.

    The square has four divisions a side.  A jump to another branch would leave other angles.
    """
    corner = 0.1 * np.array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]])
    way_points = np.concatenate(
        [np.linspace(a, b, 4, endpoint=False) for a, b in pairwise(corner)] + [corner[:1]]
    )
    followed = follow(unloaded_start(), pose=unloaded_start().pose + way_points)
    assert not followed.why
    assert np.abs(followed.states.inputs[-1] - followed.states.inputs[0]).max() <= 1e-9
    back = solve_direct(followed.states)
    assert np.abs(back.pose - followed.states.pose).max() <= 1e-9


def test_poses_along_a_motor_line_are_the_recomputed_ones():
    """Poses and clamp moments are the recomputed ones as motor 1 turns."""
    rows = PATHS["motor"]
    way_points = unloaded_start().inputs + np.outer([row["turn"] for row in rows], [1.0, 0.0])
    followed = follow(unloaded_start(), inputs=way_points)
    # six decimals
    assert np.abs(followed.states.pose - [row["pose"] for row in rows]).max() <= 2e-6
    assert np.abs(followed.states.moment - [row["moment"] for row in rows]).max() <= 1e-5


def test_a_path_ends_at_a_fold_and_keeps_the_samples_before_it():
    """A path ends at the fold at its recomputed angle; way points beyond it are NaN."""
    way_points = unloaded_start().inputs + np.outer([-0.2, -0.35, -0.4, -1.0], [1.0, 0.0])
    followed = follow(unloaded_start(), inputs=way_points)
    assert followed.why == "fold: direct singularity"
    assert np.isfinite(followed.states.vector).all(axis=1).tolist() == [True, True, False, False]
    turn = (followed.last.inputs - unloaded_start().inputs)[0]
    assert turn == pytest.approx(PATHS["fold"]["turn"], abs=1e-5)  # five decimals
    assert followed.reached == pytest.approx(2 + (-turn - 0.35) / 0.05, abs=1e-9)
    assert np.abs(followed.last.pose - PATHS["fold"]["pose"]).max() <= 1e-5


def test_fold_is_singular_and_has_two_solutions_on_one_side_only():
    """At a fold the direct determinant and the least stiffness are zero, the inverse is not.

    There are two solutions on one side of the fold and none on the other.
    """
    branch = path_over_the_fold()
    assert not branch.why
    assert branch.at.shape == (1,)
    fold, start = branch.folds[0], derivatives(unloaded_start())
    found = derivatives(fold)
    assert abs(found.direct_determinant) <= 1e-9 * start.direct_determinant  # rounding
    assert abs(found.inverse_determinant) > 0.1 * abs(start.inverse_determinant)
    assert abs(np.linalg.eigvalsh(found.stiffness)[0]) <= 1e-9  # N/m: no stiffness
    slack, eps = np.linalg.svd(closure(fold)[1][:, :8])[2][-1], 1e-6
    ahead = fold.inputs + np.array([eps, 0.0])
    # the parameter is quadratic along the null vector, so solutions are sqrt(eps) = 1e-3 away
    sides = [
        solve_direct(
            RodState(PAIR, fold.vector + np.pad(step * slack, (0, 4))).with_parts(inputs=ahead)
        )
        for step in (3e-3, -3e-3)
    ]
    assert 1e-4 < np.linalg.norm(sides[0].pose - sides[1].pose) < 1e-2
    with pytest.raises(ValueError, match="no equilibrium"):
        solve_direct(fold.with_parts(inputs=fold.inputs - [eps, 0.0]))


def test_a_symmetric_pair_has_no_sideways_stiffness_at_a_branch_point():
    """Under a load a symmetric pair passes a branch point, where its sideways stiffness is zero.

    The path continues on the symmetric branch, which is unstable beyond it.
    """
    turns = np.radians(DATA["symmetric"]["inputs_deg"])
    row = DATA["symmetric"]["recomputed"][0]
    first = np.array(row["force1"])
    start = solve_direct(
        state(
            PAIR,
            inputs=turns,
            pose=[0.0, row["y"]],
            force=[first, -first],
            moment=[row["moment1"], -row["moment1"]],
        )
    )
    followed = follow(start, load=[[0.0, -2.0]])
    assert not followed.why
    assert followed.crossed.shape == (1,)
    near_branch_point = followed.crossed[0] * np.array([1.0 - 1e-5, 1.0 + 1e-5])
    there = follow(start, load=np.outer(near_branch_point, [0.0, -2.0])).states
    assert np.abs(there.pose[:, 0]).max() <= 1e-9
    across = derivatives(there).stiffness[:, 0, 0]
    assert across[0] > 0.0 > across[1]
    assert derivatives(start).stiffness[0, 0] > 0.0 > derivatives(followed.last).stiffness[0, 0]


def test_equilibria_beyond_the_fold_are_unstable():
    """Beyond the fold the least stiffness is negative, and before it positive.

    This is checked up to where a rod buckles between its ends as well and the stiffness passes
    infinity.
    """
    branch = path_over_the_fold()
    found = derivatives(branch.states)
    least, turn = np.linalg.eigvalsh(found.stiffness)[:, 0], branch.parameter.argmin()
    assert (least[: turn - 1] > 0.0).all()
    unbuckled = (found.rod_determinants * found.rod_determinants[0] > 0.0).all(axis=1)
    assert unbuckled[: turn + 6].all()
    assert (least[turn + 1 :][unbuckled[turn + 1 :]] < 0.0).all()
    assert (np.diff(np.sign(found.direct_determinant)) != 0).sum() == 1
    assert np.abs(closure(branch.states)[0]).max() <= 1e-9
    assert branch.parameter[-1] == 0.0
    assert np.abs(branch.states.pose[-1] - unloaded_start().pose).max() > 0.1  # another equilibrium


def test_inverse_singularity_ends_a_line_of_poses():
    """A path of poses ends at the reach of rod 1, which is straight there.

    There is a direction in which no motor moves the pin.
    """
    followed = follow(unloaded_start(), pose=unloaded_start().pose[None] + [1.2, 0.0])
    assert followed.why == "fold: inverse singularity"
    found = derivatives(followed.last)
    assert abs(found.inverse_determinant) <= 1e-9 * abs(
        derivatives(unloaded_start()).inverse_determinant
    )
    assert abs(found.direct_determinant) > 0.01
    sizes = np.linalg.svd(found.direct, compute_uv=False)
    assert sizes[1] <= 1e-9 * sizes[0]  # no motor moves the pin in one direction
    assert np.hypot(*(followed.last.pose - [-0.3, 0.0])) == pytest.approx(1.0, abs=1e-10)
    assert abs(followed.last.moment[0]) <= 1e-9


def test_a_manifold_of_poses_has_the_inputs_of_paths_to_its_nodes():
    """The manifold over a grid of poses has the inputs of paths to its nodes."""
    manifold = map_equilibria(unloaded_start(), np.linspace(0.0, 0.6, 4), np.linspace(-0.5, 0.0, 5))
    x, y = np.meshgrid(manifold.first, manifold.second, indexing="ij")
    kept = manifold.states[manifold.reached]
    assert manifold.reached.sum() > 13
    off = kept.pose - np.stack([x, y], axis=-1)[manifold.reached]
    assert np.abs(off).max() <= 1e-15  # rounding of steps of up to 0.6 m
    assert np.abs(closure(kept)[0]).max() <= 1e-9
    for node in ((1, 1), (2, 3), (3, 4)):
        goal = manifold.states[node]
        path = follow(unloaded_start(), pose=goal.pose[None])
        assert np.abs(path.last.inputs - goal.inputs).max() <= 1e-8


def test_manifold_and_singularities_have_the_symmetry_of_the_mechanism():
    """Without load the manifold and its direct singularities are their own mirror images, x -> -x.

    The mirror image exchanges the two rods.
    """
    manifold = map_equilibria(
        unloaded_start(), np.linspace(-0.6, 0.6, 9), np.linspace(-0.4, 0.1, 4)
    )
    assert (manifold.reached == manifold.reached[::-1]).all()
    found = find_singularities(manifold, "direct")
    assert len(found.vector) > 10
    size = np.abs(derivatives(manifold.states[manifold.reached]).direct_determinant).max()
    assert np.abs(derivatives(found).direct_determinant).max() <= 1e-7 * size  # 1e-9 of an edge
    distances = np.linalg.norm(found.pose[:, None] - found.pose * MIRROR, axis=-1).min(axis=1)
    assert np.quantile(distances, 0.8) <= 1e-6  # an edge may be left out where the manifold is torn
    # there are no inverse singularities on it: a manifold of poses ends there
    assert not len(find_singularities(manifold, "inverse").vector)


def test_a_manifold_of_inputs_ends_at_the_fold():
    """The manifold over a grid of motor angles ends at the last node before the fold."""
    q = unloaded_start().inputs
    manifold = map_equilibria(
        unloaded_start(),
        q[0] + np.linspace(-0.5, 0.1, 13),
        q[1] + np.array([-0.05, 0.0, 0.05]),
        name="inputs",
    )
    turns = manifold.first[manifold.reached[:, 1]] - q[0]
    # nodes are 0.05 rad apart, the fold is at -0.365 rad
    assert turns.min() == pytest.approx(-0.35, abs=1e-9)
    assert turns.max() == pytest.approx(0.1, abs=1e-9)


def test_platform_follows_a_circle_at_constant_orientation():
    """The slides of a 3PFR are back at their start after a circle, with three-fold symmetry."""
    turns = np.radians([0.0, 120.0, -120.0])
    a = three_rod_platform(0.2 * np.sqrt(3.0), angle=turns, guide=turns, rigid_extension=0.1)
    row = DATA["pfr3"]
    start = solve_inverse(
        state(
            a,
            pose=[0.0, 0.0, np.radians(row["phi_deg"])],
            moment=-0.002,
            force=0.04 * np.array([a.clamp.real, a.clamp.imag]).T,
        )
    )
    angle = np.linspace(0.0, 2 * np.pi, 13)
    way_points = start.pose + 0.05 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    followed = follow(start, pose=way_points)
    assert not followed.why
    assert np.abs(followed.states.inputs[-1] - followed.states.inputs[0]).max() <= 1e-9
    # three-fold symmetry: after a third of the circle the next slide has this value
    assert np.abs(np.roll(followed.states.inputs[4], -1) - followed.states.inputs[0]).max() <= 1e-9


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({}, "give way points"),
        ({"inputs": [[0.0, 0.0]], "pose": [[0.0, 0.0]]}, "not of both"),
        ({"pose": [[0.0, 0.0, 0.0]]}, r"pose must be finite, \(\.\.\., 2\)"),
        ({"load": [[np.nan, 0.0]]}, "load must be finite"),
    ],
)
def test_bad_way_points(wrong, word):
    with pytest.raises(ValueError, match=word):
        follow(unloaded_start(), **wrong)


def test_bad_maps():
    with pytest.raises(ValueError, match="name must be 'pose' or 'inputs'"):
        map_equilibria(unloaded_start(), [0.0], [0.0], name="load")
    with pytest.raises(ValueError, match="the start cannot be followed to the grid's node"):
        map_equilibria(unloaded_start(), [0.65], [-0.35])  # beyond the reach of rod 1
    manifold = map_equilibria(unloaded_start(), *unloaded_start().pose[:, None])
    with pytest.raises(ValueError, match="which must be 'direct' or 'inverse'"):
        find_singularities(manifold, "both")
