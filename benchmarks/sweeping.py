"""How many poses a second quasi-static sweeps do in both engines.

    python -m benchmarks.sweeping [--quick]

Interleaved, the least of the repeats; a sweep reads all channels of its case at every pose, with
moments and forces where the case has them.
"""

from collections.abc import Sequence

from benchmarks import ROOT, command
from proofmass.sidecar import load_case
from proofmass.solve import plan, simulate

CASES = ("fourbar", "slider_crank", "hacksaw", "fivebar", "threeprr")
ENGINES = ("mujoco", "pymunk")
REPEATS = 7


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row a case."""
    quick = command(__doc__).parse_args(argv).quick
    print(f"{'poses a second':<18}{'poses':>8}" + "".join(f"{name:>12}" for name in ENGINES))
    for name in CASES[:1] if quick else CASES:
        case = load_case(ROOT / "models" / "linkages" / f"{name}.toml")
        runs = {engine: plan(case, "sweep", engine) for engine in ENGINES}
        least = dict.fromkeys(ENGINES, float("inf"))
        for _ in range(1 if quick else REPEATS):
            for engine, run in runs.items():
                curves = simulate(engine, case.model_path, run)
                least[engine] = min(least[engine], curves.seconds)
        count = runs[ENGINES[0]].x.size
        print(f"{name:<18}{count:>8}" + "".join(f"{count / least[e]:>12.0f}" for e in ENGINES))


if __name__ == "__main__":
    main()
