"""Measure how fast bodies creep that friction should keep at rest, and find a slower setting.

    rate = |x(T) - x(T - T / 10)| / (T / 10)        of a coordinate x at rest in the reference

Soft contacts slip at any load.  The rate is measured by a program that needs the engine only, with
the settings of the model and with those that the engine's adapter proposes: in MuJoCo a larger
`impratio`, to which the rate is inversely proportional; see
`proofmass.sim.mujoco.contacts.creep_rate`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from proofmass.base.arrays import Array
from proofmass.base.wording import number
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.evaluate import evaluate
from proofmass.reference.samples import run_samples
from proofmass.sim.contents import size
from proofmass.sim.engines import engine_of
from proofmass.studies.bounded import call_limited
from proofmass.studies.record import NAN, Setting
from proofmass.studies.trade.program import NoCurves, drive_ways, program_text, run_bare_program
from proofmass.studies.trade.verify import setting_as_used

FINAL_SHARE = 0.1
"""Share of a run, at its end, over which the rate is taken."""
REST_MOTION = 1e-9
"""Largest motion of the reference in that time for it to be at rest [extents of the model]."""
RATE_MARGIN = 1.05
"""Ratio of the wanted rate to the rate that a proposed setting aims at."""
MAX_PROPOSALS = 4
"""Largest number of proposed settings; each asks for a tenth of the previous reduction."""


@dataclass(frozen=True)
class Creep:
    """The creep rate with a setting.

    Attributes
    ----------
    setting : Setting
        The setting as used, with parameters that the engine chooses by itself.
    rate : float
        Rate of the channel that creeps fastest [m/s]; NaN if the run has no result.
    channel : str
        Name of that channel.
    seconds, steps
        Cost of the run: processor time [s], and steps.
    failure : str
        Reason why there is no rate.
    """

    setting: Setting
    rate: float = NAN
    channel: str = ""
    seconds: float = NAN
    steps: int = 0
    failure: str = ""

    @property
    def words(self) -> str:
        """The rate and cost of the setting, or the failure, in words."""
        if self.failure:
            return self.failure
        return (
            f"{self.channel} creeps {number(self.rate, 3)} m/s as a program that runs by itself, "
            f"{self.steps} steps in {number(self.seconds, 2)} s"
        )


def final_samples(x: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the samples in the last tenth of a run."""
    return np.asarray(x >= x[-1] - FINAL_SHARE * np.ptp(x))


def find_resting_channels(case: Case) -> list[str]:
    """Names of the channels of position whose reference is at rest in the last tenth of a motion.

    Raises
    ------
    InputError
        There is no such channel.
    """
    x = run_samples(case, "dynamics")
    final = final_samples(x)
    largest_motion = REST_MOTION * size(compiled_model(case), case.start)
    reference = evaluate(case, "dynamics", x, None).channels
    places = [name for name, c in case.channels_of("dynamics").items() if c.si_unit == "m"]
    found = [name for name in places if np.ptp(reference[name][final]) <= largest_motion]
    if not found:
        raise case.error(
            "channels",
            f"no place is at rest in the last tenth of the run, from {x[final][0]:g} s on, so "
            "that no creep can be measured; give a run that ends at rest, and a channel of a place",
        )
    return found


def measure_creep(case: Case, setting: Setting, names: Sequence[str], longest: float) -> Creep:
    """Run a setting as a program in a worker, and measure the creep of the named channels."""
    used = setting_as_used(case, setting)
    text = program_text(case, used, drive_ways(case, setting.engine)[0])
    found: Creep = call_limited(
        case, "dynamics", measure_creep_here, case, used, names, text, longest
    )
    return found


def measure_creep_here(
    case: Case, setting: Setting, names: Sequence[str], text: str, longest: float
) -> Creep:
    """Run the program of a setting, and measure the creep of the named channels."""
    try:
        curves, seconds, steps = run_bare_program(
            text, setting.apply_to(case, "dynamics")[1], longest
        )
    except NoCurves as why:
        return Creep(setting, failure=str(why))
    final = final_samples(curves.x)
    time = float(np.ptp(curves.x[final]))
    ends = {name: curves.channels[name][final][[0, -1]] for name in names}
    rates = {name: abs(float(end - begin)) / time for name, (begin, end) in ends.items()}
    fastest = max(rates, key=lambda name: rates[name])
    return Creep(setting, rates[fastest], fastest, seconds, steps)


def find_slow_setting(case: Case, solver: str, wanted: float, longest: float) -> list[Creep]:
    """Measure the creep with the model's own settings, then with others until one is slow enough.

    If the last result is not slow enough, none is.

    Parameters
    ----------
    case : Case
        A case whose motion ends at rest.
    solver : str
        Name of one of its engines.
    wanted : float
        Largest rate that is slow enough [m/s].
    longest : float
        Processor time after which a program is ended [s].
    """
    names = call_limited(case, "dynamics", find_resting_channels, case)
    tuning = engine_of(solver).tuning
    given = dict(case.settings.get(solver, {}))
    found = [measure_creep(case, Setting(solver, given), names, longest)]
    reduction = RATE_MARGIN * found[0].rate / wanted
    for _ in range(MAX_PROPOSALS):
        if found[-1].rate <= wanted or not reduction > 1.0:
            break
        proposed = tuning.holding(case.model_path, given, float(f"{reduction:.2g}"))
        if proposed is None:
            break
        found.append(measure_creep(case, Setting(solver, proposed), names, longest))
        reduction /= 10.0
    return found
