"""Poses per second of quasi-static sweeps in both engines.

    python -m benchmarks.sweeping [CASE ...] [--quick]

Times are processor times.  Runs are interleaved, and the shortest of the repeats counts.  The last
column, which depends less on the machine, is the time of a pose in MuJoCo over that of a call of
``mj_forward``, which its repeats follow.  A sweep reads positions alone,
positions and rates, or all channels of its case, with moments and forces if the case has them.
"""

from collections.abc import Sequence
from dataclasses import replace

import mujoco

from benchmarks import ROOT, command
from proofmass.base.clock import processor_time
from proofmass.reference.case_model import compiled_model
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run
from proofmass.sim.contents import pose_of_key

CASES = ("fourbar", "slider_crank", "hacksaw", "fivebar", "threeprr")
ENGINES = ("mujoco", "pymunk")
REPEATS = 7
FORWARD_CALLS = 2000
"""Calls of ``mj_forward`` that are timed together, about as long as a sweep of the four-bar."""
STAGES = {
    "positions": mujoco.mjtStage.mjSTAGE_POS,
    "with rates": mujoco.mjtStage.mjSTAGE_VEL,
    "all": mujoco.mjtStage.mjSTAGE_ACC,
}
"""The last stage of MuJoCo whose sensors are read."""


def time_forward(model: mujoco.MjModel, start: str) -> float:
    """Processor time of a call of ``mj_forward`` in the pose of a key [s]."""
    data = pose_of_key(model, start)
    began = processor_time()
    for _ in range(FORWARD_CALLS):
        mujoco.mj_forward(model, data)
    return (processor_time() - began) / FORWARD_CALLS


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row for each case and each of `STAGES`."""
    asked = command(__doc__)
    asked.add_argument("cases", nargs="*", metavar="CASE", help="cases of models/linkages/")
    given = asked.parse_args(argv)
    quick = given.quick
    heads = "".join(f"{name:>10}" for name in ENGINES) + f"{'mj_forward':>12}"
    print(f"{'poses a second':<28}{'poses':>6}{heads}")
    for name in given.cases or (CASES[:1] if quick else CASES):
        case = load_case(ROOT / "models" / "linkages" / f"{name}.toml")
        model = compiled_model(case)
        for words, stage in STAGES.items():
            least, forward = dict.fromkeys(ENGINES, float("inf")), float("inf")
            for engine in ENGINES * (1 if quick else REPEATS):
                run = plan_run(case, "sweep", engine)
                sensors = {one: model.sensor(one.partition(".")[0]) for one in run.channels}
                read = tuple(one for one, s in sensors.items() if s.needstage[0] <= int(stage))
                curves = call_engine(engine, case.model_path, replace(run, channels=read))
                least[engine] = min(least[engine], curves.seconds)
                forward = min(forward, time_forward(model, run.start))
            count = run.x.size
            print(
                f"{f'{name}, {words}':<28}{count:>6}"
                + "".join(f"{count / least[engine]:>10.0f}" for engine in ENGINES)
                + f"{least['mujoco'] / count / forward:>12.1f}"
            )


if __name__ == "__main__":
    main()
