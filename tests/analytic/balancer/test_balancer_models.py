"""The thesis's 112 balancers as models: statics by MuJoCo's Jacobian, sweeps, and warnings.

Source: van Nes 2022 (see `tests/data/balancer.json`); rows by the line of its text.
"""

import re

import mujoco
import numpy as np
import pytest

from proofmass.analytic import balancer
from proofmass.analytic.balancer.measures import warnings
from proofmass.design.template import write_case
from proofmass.sim.mujoco import engine as with_mujoco
from proofmass.sim.protocol.failures import BadModel
from proofmass.sim.protocol.run import Drive, Run
from proofmass.sim.pymunk import engine as with_pymunk
from tests.analytic.balancer.balancer_table import parameters, rows

ANGLES = np.radians(np.arange(5, 91, 5))
DRIVE = Drive("pendulum", lambda x: (x, 1 + 0 * x, 0 * x))
EARLY_ENDS = {  # rows whose path does not reach 90 degrees, and why
    "1825": "rest posture is an unstable equilibrium",
    "1870": "rest posture is an unstable equilibrium",
    "2188": "rest posture is an unstable equilibrium",
    "2159": "at 70.96.* fold",
}
REGULAR = [line for line in rows() if line not in EARLY_ENDS]
# plain, a preload, a stop that is met, four segments
DEFAULT_LINES = ["1766", "1745", "1860", "1747"]
EACH = pytest.mark.parametrize(
    "line",
    [
        pytest.param(line, marks=() if line in DEFAULT_LINES else pytest.mark.slow)
        for line in REGULAR
    ],
)
WARNING_OF_FLAG = {
    "never released": "never leaves its preload",
    "stop never touched": "never touches",
    "unstable at rest": "unstable",
    "jump": "unstable",
    "pinned at the stretched arm": "straight",
}


@pytest.fixture
def write_model(tmp_path):
    """Writes the MJCF of a row of the tables."""

    def write(line: str):
        file = write_case(
            tmp_path, f"row{line}", title="", source="", parameters=parameters(rows()[line])
        )
        return file.with_suffix(".xml")

    return write


def statics(model: mujoco.MjModel, alpha: float, deflection: np.ndarray):
    """Forces that hold a pose at rest: of the drive, of the stops, and the part that is missing.

    The force f that must act in addition to springs, weights and loads is fitted by least squares
    with the rows of the loop, of the drive and of the stops that the joints lie on.

    Returns
    -------
    residual : float
        Largest component of f [N m] that the fit leaves.
    moment : float
        Of the drive [N m].
    pushes : ndarray
        Of the stops, inwards positive [N m].
    violation, energy : float
        Constraint violation of the loop [m], and energy [J].
    """
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[:] = [alpha, *deflection]
    mujoco.mj_forward(model, data)
    force = data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator
    loop = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    bound = np.where(model.jnt_limited[:, None], model.jnt_range, np.inf)
    # 1e-12: a stop is met to rounding of the deflections
    low, high = (np.flatnonzero(np.abs(data.qpos - side) <= 1e-12) for side in bound.T)
    unit = np.eye(model.nv)
    rows = np.vstack([data.efc_J.reshape(-1, model.nv)[loop], unit[:1], unit[low], -unit[high]])
    shares = np.linalg.lstsq(rows.T, force, rcond=None)[0]
    first = int(loop.sum())
    ends = data.site("tip").xpos - data.site("pendulum_tip").xpos
    return (
        np.abs(rows.T @ shares - force).max(),
        shares[first],
        shares[first + 1 :],
        np.linalg.norm(ends),
        data.energy[0],
    )


@EACH
def test_every_analytic_pose_is_an_equilibrium_of_mujoco(line, write_model):
    pose = balancer.solve(ANGLES, **parameters(rows()[line]))
    n = rows()[line]["segments"]
    deflections = np.stack([pose[f"deflection{i}"] for i in range(1, n + 1)], axis=-1)
    compiled = mujoco.MjModel.from_xml_path(str(write_model(line)))
    compiled.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    constant = rows()[line]["parameters"].get("stiffness2") == 0  # no spring stores its energy
    for k, alpha in enumerate(ANGLES):
        residual, moment, pushes, violation, energy = statics(compiled, alpha, deflections[k])
        # 1e-12: rounding of the deflections times stiffness, over the sine of a nearly straight arm
        assert residual <= 1e-12
        assert abs(moment - pose["balancing_moment"][k]) <= 1e-12
        assert (pushes >= -1e-12).all()
        assert violation <= 1e-12  # rounding of four points
        # rounding of the energy of a preload, which is 100 J where a soft spring is wound 400 rad
        assert constant or abs(energy - pose["energy"][k]) <= 1e-14 * max(1.0, energy)


@EACH
def test_a_sweep_of_mujoco_follows_the_path(line, write_model):
    n = rows()[line]["segments"]
    names = (*(f"deflection{i}" for i in range(1, n + 1)), "holding_moment")
    found = with_mujoco.simulate(write_model(line), Run("sweep", ANGLES, names, (DRIVE,)))
    pose = balancer.solve(ANGLES, **parameters(rows()[line]))
    assert found.stopped == ""
    for name in names:
        # 1e-12: rounding of the pose, over the sine of a nearly straight arm
        assert np.abs(found.channels[name] - pose[name]).max() <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("line", REGULAR)
def test_a_sweep_of_pymunk_follows_the_path(line, write_model):
    n = rows()[line]["segments"]
    names = (*(f"deflection{i}" for i in range(1, n + 1)), "holding_moment")
    found = with_pymunk.simulate(write_model(line), Run("sweep", ANGLES, names, (DRIVE,)))
    pose = balancer.solve(ANGLES, **parameters(rows()[line]))
    for name in names:
        # 1e-9: the last motion is 1e-12 of the mechanism, and a nearly straight arm magnifies it
        assert np.abs(found.channels[name] - pose[name]).max() <= 1e-9


@pytest.mark.parametrize("line", EARLY_ENDS)
def test_a_path_that_ends_early_is_reported(line):
    with pytest.raises(ValueError, match=EARLY_ENDS[line]):
        balancer.solve(ANGLES, **parameters(rows()[line]))
    assert any(
        "unstable" in flag or "fold" in flag for flag in warnings(**parameters(rows()[line]))
    )


@pytest.mark.parametrize("line", ["1825", "1870", "2188"])
def test_mujoco_also_finds_the_rest_posture_unstable(line, write_model):
    with pytest.raises(BadModel, match="unstable equilibrium"):
        with_mujoco.simulate(
            write_model(line), Run("sweep", ANGLES - ANGLES[0], ("deflection1",), (DRIVE,))
        )


def test_mujoco_also_stops_at_the_fold(write_model):
    fine = np.radians(np.arange(0.0, 90.0, 0.5))
    found = with_mujoco.simulate(
        write_model("2159"), Run("sweep", fine, ("deflection1",), (DRIVE,))
    )
    assert "pendulum = 1.2385" in found.stopped  # 70.961 degrees, to the digits it says
    assert found.x[-1] == np.radians(70.5)


@pytest.mark.parametrize("line", [line for line, row in rows().items() if "warnings" in row])
def test_known_flags_of_a_row_are_among_its_warnings(line):
    found = "; ".join(warnings(**parameters(rows()[line])))
    for flag in rows()[line]["warnings"]:
        if flag in WARNING_OF_FLAG and not (line in EARLY_ENDS and "unstable" in found):
            assert WARNING_OF_FLAG[flag] in found


LINES_WITH_STOPS = [line for line in REGULAR if "high2" in parameters(rows()[line])]


@pytest.mark.parametrize("line", LINES_WITH_STOPS[::3])
def test_a_warning_names_a_stop_that_the_path_never_touches(line):
    chain = parameters(rows()[line])
    pose = balancer.solve(np.radians(np.linspace(0.0, 90.0, 181)), **chain)
    clear = pose["deflection2"].max() < chain["high2"] - 1e-9
    assert ("joint 2 never touches its stop" in "; ".join(warnings(**chain))) == clear


PAST_PEAK_PATTERN = re.compile(r"spring (\d) is past its largest moment from ([\d.]+) deg on")
WOUND_PATTERN = re.compile(r"spring (\d) is wound by ([\d.]+) rad, more than a quarter turn")


@pytest.mark.parametrize("line", ["2165", "1926", "1800", "1754", "2180"])
def test_warnings_name_the_springs_past_their_range_or_largest_moment(line):
    """Spring 1 has no stops, so its winding is not limited: in 2165 it exceeds a quarter turn.

    Past its largest moment a spring resists less when it is wound further.
    """
    chain, fine = parameters(rows()[line]), np.radians(np.linspace(0.0, 90.0, 721))
    pose, text = balancer.solve(fine, **chain), "; ".join(warnings(**chain))
    wound, past = (
        {int(k): float(x) for k, x in one.findall(text)}
        for one in (WOUND_PATTERN, PAST_PEAK_PATTERN)
    )
    expected_wound, expected_past = {}, {}
    for k in range(1, 5 if "length4" in chain else 4):
        winding, moment = np.abs(pose[f"deflection{k}"]), np.abs(pose[f"moment{k}"])
        if winding.max() > np.pi / 2:
            expected_wound[k] = winding.max()
        further = np.diff(winding) > 1e-9  # not by rounding on a stop
        if (falls := (np.diff(moment) < 0.0) & further).any():
            expected_past[k] = np.degrees(fine[np.argmax(falls)])
    assert expected_wound or expected_past
    expected_wound.pop(1, None)
    assert wound == pytest.approx(expected_wound, abs=5.1e-3)  # printed with two decimals
    # steps of 1/8 and 1/4 degree, one decimal
    assert past == pytest.approx(expected_past, abs=0.45)
