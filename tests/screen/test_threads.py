"""Questions of public threads: the first screen gives the answer, which is known otherwise."""

from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

from docs.make.threads import FOLDER, PAGE, TABLE_BEGIN, TABLE_END, table, threads
from proofmass.screen.finding import FindingKind, Severity
from proofmass.screen.screen import screen_model

THREADS = {thread.file: thread for thread in threads()}
NOT_ANSWERED = {"wrist204.xml"}  # an inertia that belongs to another mass breaks no law
GRAVITY = 9.81


@cache
def screen_of(file):
    return screen_model(THREADS[file].path)


@pytest.mark.parametrize("file", THREADS)
def test_the_first_paragraph_gives_the_right_answer(file):
    assert bool(THREADS[file].answer(screen_of(file))) == (file not in NOT_ANSWERED)


def test_the_page_has_the_answers_of_today():
    answers = {thread: thread.answer(screen_of(file)) for file, thread in THREADS.items()}
    written = PAGE.read_text(encoding="utf-8").split(TABLE_BEGIN)[1].split(TABLE_END)[0]
    assert written.strip() == table(answers), "python -m docs.make.threads writes the table"


def explicit_limit(gain, damping, inertia):
    """The step of Euler's method with an explicit spring and damper: 2 h c / I + h^2 k / I = 4."""
    return brentq(lambda h: 2 * h * damping / inertia + h**2 * gain / inertia - 4, 0, 1)


def two_links(masses, arms, length, inertias):
    """The inverse mass matrix of two links that lie in line, hinged at their ends."""
    m22 = inertias[1] + masses[1] * arms[1] ** 2
    m12 = m22 + masses[1] * length * arms[1]
    m11 = inertias[0] + masses[0] * arms[0] ** 2 + masses[1] * length**2
    m11 += m22 + 2 * masses[1] * length * arms[1]
    return np.linalg.inv([[m11, m12], [m12, m22]])


def creep(load, inverse_inertia, impedance=0.9, largest=0.95, time=0.02):
    """MuJoCo's creep of a joint with dry friction, (1 - d) f T D A / (2 d)."""
    return (1 - impedance) * load * time * largest * inverse_inertia / (2 * impedance)


def sag_of_two_links():
    """The angles of the links of ur39 at rest."""

    def balance(angles):
        fore = 4 * GRAVITY * 0.15 * np.cos(angles.sum())
        upper = (8.4 * 0.2125 + 4 * 0.425) * GRAVITY * np.cos(angles[0]) + fore
        return 2000 * angles - [upper, fore]

    return fsolve(balance, [0.0, 0.0], xtol=1e-12)


RIGHT = {
    "kinova232.xml": lambda: 2e-3 / explicit_limit(500, 50, 6.74e-4),
    "gripper1904.xml": lambda: 2e-3 / explicit_limit(1000, 20, 0.015),
    "servo184.xml": lambda: 2e-3 / (2 * 1e-3 / 1.2),
    "damping548.xml": lambda: 2e-3 / (2.785294 * (0.01 + 0.1**2) / 30),
    "rizon254_rk4.xml": lambda: 1e-4 / (2.785294 * 9e-4 / 200),
    "drag2082.xml": lambda: creep(
        0.05 * GRAVITY * (3 * 0.2 + 1.5 * 0.55),
        two_links((3, 1.5), (0.2, 0.15), 0.4, (0.05, 0.02))[0, 0],
    ),
    "weak1371.xml": lambda: brentq(lambda q: q - 2 * GRAVITY * 0.25 * np.cos(q), 0, 1.5),
    "hand1861.xml": lambda: 4 * GRAVITY / 400,
    "ur39.xml": lambda: sag_of_two_links()[0],
    "jansen613.xml": lambda: np.hypot(0.05, 4.85) - 0.0125,
    "rim1026.xml": lambda: np.linalg.norm([0.01, 0.755 - 0.4, 0.015]) - 0.01,
    "snap227.xml": lambda: 0.08 + 0.05 - np.hypot(0.02, 0.07),
    "bouncy278.xml": lambda: np.pi / 2,
    "twomass1524.xml": lambda: np.sqrt(80 * (1 / 0.002 + 1 / 0.02)) / (2 * np.pi),
}


@pytest.mark.parametrize("file", RIGHT)
def test_the_right_values_of_the_table_follow_from_formulas(file):
    thread = THREADS[file]
    if thread.says:
        assert thread.says == f"{RIGHT[file]():.3g} Hz"
    else:
        assert thread.value == pytest.approx(RIGHT[file](), rel=max(thread.within / 4, 2e-5))


def bare(file):
    """A model and its start state, in MuJoCo alone."""
    model = mujoco.MjModel.from_xml_path(str(THREADS[file].path))
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return model, data


def run_until(model, data, seconds):
    while data.time < seconds - model.opt.timestep / 2:
        mujoco.mj_step(model, data)


def test_a_pinched_capsule_creeps_in_bare_mujoco_as_the_table_says():
    model, data = bare("pinch3328.xml")
    run_until(model, data, 1.0)
    assert -data.qvel[4] == pytest.approx(THREADS["pinch3328.xml"].value, rel=1e-4)


@pytest.mark.parametrize(("file", "seconds"), [("boom114.xml", 5.0), ("backlash995.xml", 2.0)])
def test_loops_give_way_in_bare_mujoco_as_the_table_says(file, seconds):
    model, data = bare(file)
    run_until(model, data, seconds)
    opening = np.linalg.norm(data.efc_pos[: data.ne])
    assert opening == pytest.approx(THREADS[file].value, rel=2e-3)


def test_euler_adds_the_energy_that_the_table_says_and_rk4_does_not():
    gains = {}
    for integrator in ("EULER", "RK4"):
        model, data = bare("chain2896.xml")
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
        mujoco.mj_forward(model, data)
        start, kinetic = data.energy.sum(), 0.0
        for _ in range(50):
            mujoco.mj_step(model, data)
            kinetic = max(kinetic, data.energy[1])
        mujoco.mj_forward(model, data)
        gains[integrator] = (data.energy.sum() - start) / kinetic
    assert gains["EULER"] == pytest.approx(THREADS["chain2896.xml"].value, rel=1e-2)
    assert abs(gains["RK4"]) < 1e-5


CURED = [
    # the model, what is replaced by what, and the kind of finding that is gone
    ("hand1861.xml", '<body name="palm">', '<body name="palm" gravcomp="1">', FindingKind.SERVO),
    ("panda5.xml", '-1.57079"/>', '-1.57079" ctrl="0.398506 -1.57002"/>', FindingKind.SERVO),
    ("pinch3328.xml", "<option ", '<option noslip_iterations="10" ', FindingKind.CREEP),
    ("chain2896.xml", "<option ", '<option integrator="RK4" ', FindingKind.ENERGY),
    ("chain2896.xml", 'type="ball"', 'type="ball" damping=".1"', FindingKind.ENERGY),
    ("boom114.xml", "<connect ", '<connect solimp="0.9999 0.9999 .001" ', FindingKind.SOFT_LOOP),
    ("jansen613.xml", "-.05 .2 4.85", "0 .2 0", FindingKind.PIN),
    (
        "snap227.xml",
        "</worldbody>",
        '</worldbody><contact><exclude body1="hip" body2="thigh"/></contact>',
        FindingKind.CONTACT,
    ),
    ("unimal1593.xml", '"disable"', '"enable"', FindingKind.CONTACT),
]


@pytest.mark.parametrize(("file", "old", "new", "kind"), CURED)
def test_what_is_advised_cures(file, old, new, kind):
    text = (FOLDER / file).read_text(encoding="utf-8")
    assert text.count(old) == 1
    cured = screen_model(mujoco.MjModel.from_xml_string(text.replace(old, new)))
    assert kind not in {finding.kind for finding in cured.findings}


def test_a_pin_of_a_weld_and_ends_that_a_weld_joins_are_no_faults():
    severities = {one.kind: one.severity for one in screen_of("weld2729.xml").findings}
    assert severities[FindingKind.PIN] is Severity.NOTE
    assert FindingKind.FREE_ENDS not in severities


def test_controls_that_hold_a_start_hold_it_in_bare_mujoco():
    [finding] = [f for f in screen_of("ur39.xml").findings if f.kind is FindingKind.SERVO]
    model, data = bare("ur39.xml")
    data.ctrl[:] = [float(word) for word in finding.remedy.split('"')[1].split()]
    run_until(model, data, 1.0)
    assert np.abs(data.qpos).max() < 1e-6
