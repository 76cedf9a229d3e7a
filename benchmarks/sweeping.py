"""Poses per second of quasi-static sweeps in both engines.

    python -m benchmarks.sweeping [--quick]

Runs are interleaved, and the shortest of the repeats counts.  A sweep reads positions alone,
positions and rates, or all channels of its case, with moments and forces if the case has them.
"""

from collections.abc import Sequence
from dataclasses import replace

import mujoco

from benchmarks import ROOT, command
from proofmass.reference.case_model import compiled_model
from proofmass.run.sidecar import load_case
from proofmass.run.solve import call_engine, plan_run

CASES = ("fourbar", "slider_crank", "hacksaw", "fivebar", "threeprr")
ENGINES = ("mujoco", "pymunk")
REPEATS = 7
STAGES = {
    "positions": mujoco.mjtStage.mjSTAGE_POS,
    "with rates": mujoco.mjtStage.mjSTAGE_VEL,
    "all": mujoco.mjtStage.mjSTAGE_ACC,
}
"""The last stage of MuJoCo whose sensors are read."""


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row for each case and each of `STAGES`."""
    quick = command(__doc__).parse_args(argv).quick
    print(f"{'poses a second':<28}{'poses':>6}" + "".join(f"{name:>10}" for name in ENGINES))
    for name in CASES[:1] if quick else CASES:
        case = load_case(ROOT / "models" / "linkages" / f"{name}.toml")
        model = compiled_model(case)
        for words, stage in STAGES.items():
            least = dict.fromkeys(ENGINES, float("inf"))
            for engine in ENGINES * (1 if quick else REPEATS):
                run = plan_run(case, "sweep", engine)
                sensors = {one: model.sensor(one.partition(".")[0]) for one in run.channels}
                read = tuple(one for one, s in sensors.items() if s.needstage[0] <= int(stage))
                curves = call_engine(engine, case.model_path, replace(run, channels=read))
                least[engine] = min(least[engine], curves.seconds)
            count = run.x.size
            print(
                f"{f'{name}, {words}':<28}{count:>6}"
                + "".join(f"{count / least[engine]:>10.0f}" for engine in ENGINES)
            )


if __name__ == "__main__":
    main()
