"""The mobility of a first screen, beside exact ranks, Kutzbach's formula, and other readers."""

from fractions import Fraction
from pathlib import Path
from random import Random

import mujoco
import numpy as np
import pytest

from proofmass.screen.finding import FindingKind
from proofmass.screen.mobility import find_mobility
from proofmass.screen.pose import RestPose
from proofmass.screen.screen import screen_model

MODELS = Path(__file__).parents[2] / "models"
CASES = Path(__file__).parents[1] / "data" / "screen"


def rank_of(rows):
    """The exact rank of rational rows, by Gaussian elimination."""
    rows, rank = [list(map(Fraction, row)) for row in rows], 0
    for column in range(len(rows[0]) if rows else 0):
        pivot = next((k for k in range(rank, len(rows)) if rows[k][column]), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for k in range(rank + 1, len(rows)):
            factor = rows[k][column] / rows[rank][column]
            rows[k] = [a - factor * b for a, b in zip(rows[k], rows[rank], strict=True)]
        rank += 1
    return rank


def cross(a, b):
    """The cross product of two vectors of integers."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Linkage:
    """A random tree of hinged bodies on a grid of integers, with some bodies pinned together."""

    def __init__(self, seed, in_space):
        draw = Random(seed)

        def place():
            x, y, z = (draw.randint(-3, 3) for _ in range(3))
            return [x, y if in_space else 0, z]

        self.joints, self.axes, self.parents = [], [], []
        for k in range(draw.randint(3, 7)):
            self.joints.append(place())
            axis = [draw.randint(-2, 2) for _ in range(3)] if in_space else [0, 1, 0]
            self.axes.append(axis if any(axis) else [0, 0, 1])
            self.parents.append(draw.randint(-1, k - 1))
        bodies = range(-1, len(self.joints))
        self.pins = []
        for _ in range(draw.randint(1, 3)):
            one, other = draw.sample(bodies, 2)
            self.pins.append((max(one, other), min(one, other), place()))

    @property
    def xml(self):
        """The MJCF of the linkage, in which all frames are parallel to the world's."""
        bodies = {-1: ""}
        for k in range(len(self.joints) - 1, -1, -1):
            children = "".join(bodies[j] for j, parent in enumerate(self.parents) if parent == k)
            origin = self.joints[self.parents[k]] if self.parents[k] >= 0 else [0, 0, 0]
            pos = " ".join(str(a - b) for a, b in zip(self.joints[k], origin, strict=True))
            axis = " ".join(map(str, self.axes[k]))
            bodies[k] = (
                f'<body name="b{k}" pos="{pos}"><joint axis="{axis}"/>'
                '<geom type="sphere" size="0.1" mass="1" contype="0" conaffinity="0"/>'
                f"{children}</body>"
            )
        roots = "".join(bodies[k] for k, parent in enumerate(self.parents) if parent < 0)
        connects = "".join(
            f'<connect body1="b{one}" {self.second(other)} anchor="{self.local(one, point)}"/>'
            for one, other, point in self.pins
        )
        return f"<mujoco><worldbody>{roots}</worldbody><equality>{connects}</equality></mujoco>"

    def second(self, body):
        """The attribute of the second body of a connect, which is left out for the world."""
        return f'body2="b{body}"' if body >= 0 else ""

    def local(self, body, point):
        """A point in the frame of a body."""
        return " ".join(str(a - b) for a, b in zip(point, self.joints[body], strict=True))

    @property
    def rows(self):
        """Velocities of each pin on one body over that on the other, for unit joint rates."""
        rows = []
        for one, other, point in self.pins:
            columns = []
            for k, (joint, axis) in enumerate(zip(self.joints, self.axes, strict=True)):
                arm = [a - b for a, b in zip(point, joint, strict=True)]
                sign = (k in self.above(one)) - (k in self.above(other))
                columns.append([sign * x for x in cross(axis, arm)])
            rows += [list(row) for row in zip(*columns, strict=True)]
        return rows

    def above(self, body):
        """A body and those that carry it."""
        found = set()
        while body >= 0:
            found.add(body)
            body = self.parents[body]
        return found


@pytest.mark.parametrize("in_space", [False, True], ids=["planar", "in space"])
def test_ranks_are_those_of_exact_arithmetic(in_space):
    redundant = 0
    for seed in range(100):
        linkage = Linkage(seed, in_space)
        model = mujoco.MjModel.from_xml_string(linkage.xml)
        pose = RestPose(model, model.qpos0, np.zeros(0), np.zeros(0))
        found = find_mobility(pose)
        exact = rank_of(linkage.rows)
        assert found.rank == exact, seed
        assert found.loops == len(linkage.pins)
        redundant += exact < 3 * len(linkage.pins)
    assert redundant > 10  # so that ranks below the number of equations were tried


@pytest.mark.parametrize(
    ("bars", "loops"), [(4, 1), (6, 2), (8, 3)], ids=["four-bar", "Watt's", "eight bars"]
)
def test_planar_mechanisms_have_the_mobility_of_kutzbach(bars, loops):
    # each loop adds two bars and three hinges, one of which is the pin that closes it
    draw, bodies, connects, tips = Random(bars), [], [], [(0.0, 0.0)]
    inner = ""
    for _ in range(bars - 1):
        step = draw.uniform(0.5, 1.0), draw.uniform(-0.4, 0.4)
        bodies.append(step)
        tips.append((tips[-1][0] + step[0], tips[-1][1] + step[1]))
    for k in reversed(range(bars - 1)):
        at = (0.0, 0.0) if k == 0 else bodies[k - 1]
        inner = (
            f'<body name="b{k}" pos="{at[0]} 0 {at[1]}"><joint axis="0 1 0"/>'
            f'<geom type="sphere" size="0.01" mass="1" contype="0" conaffinity="0"/>{inner}</body>'
        )
    ends = [bars - 2 - 2 * k for k in range(loops)]
    for k in ends:
        step = bodies[k]
        connects.append(f'<connect body1="b{k}" anchor="{step[0]} 0 {step[1]}"/>')
    xml = f"<mujoco><worldbody>{inner}</worldbody><equality>{''.join(connects)}</equality></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    found = find_mobility(RestPose(model, model.qpos0, np.zeros(0), np.zeros(0)))
    assert found.dof == 3 * (bars - 1) - 2 * (bars - 1 + loops) == bars - 1 - 2 * loops
    assert found.redundant == loops  # a connect has an equation out of the plane
    assert all(needed == (3, 2) for needed in found.needed.values())


@pytest.mark.parametrize(
    "name", ["linkages/fourbar", "linkages/fivebar", "linkages/slider_crank", "linkages/stephenson"]
)
def test_the_general_planar_solver_counts_the_same(name):
    from proofmass.analytic.planar import read
    from proofmass.analytic.planar.kinematics import count_dof, nearest_pose

    found = screen_model(MODELS / f"{name}.xml")
    mechanism, _ = read(mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml")), "start")
    assert found.mobility.dof == count_dof(mechanism, nearest_pose(mechanism, mechanism.start))


def test_a_loop_that_is_closed_by_a_weld_has_no_mobility():
    # six equations on two joints: a Scotch yoke of the issue tracker of a public library
    found = screen_model(CASES / "scotch_weld.xml")
    assert (found.mobility.dof, found.mobility.rank, found.mobility.equations) == (0, 2, 6)
    assert FindingKind.NO_MOBILITY in {finding.kind for finding in found.findings}


SQUARE = """
<mujoco><option gravity="0 0 0"/>
<default><geom type="capsule" size=".02" mass="1"/><joint axis="0 1 0"/></default>
<worldbody>
<body name="a"><joint name="h1"/><geom fromto="0 0 0 0 0 1"/>
<body name="b" pos="0 0 1"><joint/><geom fromto="0 0 0 {base} 0 {rise}"/></body></body>
<body name="c" pos="{base} 0 0"><joint/><geom fromto="0 0 0 0 0 {last}"/></body>
</worldbody>
<equality><connect body1="b" body2="c" anchor="{base} 0 {rise}"/></equality>
<contact><exclude body1="a" body2="c"/><exclude body1="b" body2="c"/></contact></mujoco>
"""


def test_change_points_lie_where_the_bars_of_a_parallelogram_are_in_line():
    xml = SQUARE.format(base=1.5, rise=0, last=1)
    model = mujoco.MjModel.from_xml_string(xml)
    found = [f.value for f in screen_model(model).findings if f.kind is FindingKind.CHANGE_POINT]
    assert sorted(found) == pytest.approx([-np.pi / 2, np.pi / 2], abs=2e-3)


def test_a_linkage_without_bars_in_line_has_no_change_point():
    # its bars 1, 1.53, 1.3 and 1.5 do not fit on a line: no sum of two is that of the others, and
    # none is the sum of all others
    xml = SQUARE.format(base=1.5, rise=0.3, last=1.3)
    model = mujoco.MjModel.from_xml_string(xml)
    kinds = {finding.kind for finding in screen_model(model).findings}
    assert FindingKind.CHANGE_POINT not in kinds


def test_bars_in_line_at_the_start_are_a_singular_start():
    model = mujoco.MjModel.from_xml_string(SQUARE.format(base=1.5, rise=0, last=1))
    model_key = model.qpos0.copy()
    model_key[:] = [np.pi / 2, -np.pi / 2, np.pi / 2]  # all bars along x
    spec = mujoco.MjSpec.from_string(SQUARE.format(base=1.5, rise=0, last=1))
    spec.add_key(name="start", qpos=model_key)
    found = screen_model(spec.compile())
    assert FindingKind.SINGULAR_START in {finding.kind for finding in found.findings}
    assert (found.mobility.rank, found.mobility.rank_beside) == (1, 2)
