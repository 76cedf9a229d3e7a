"""Check a model: run a case in every engine, and compare all curves with its reference.

The case is a four-bar linkage: `models/linkages/fourbar.xml` is the model, `fourbar.toml` says
what must be true of it. The reference is a closed form. For each run and solver the script prints
the channel whose error is nearest to its tolerance, and the smallest changes of lengths that the
check would detect.

    uv run python examples/check_a_model.py [SIDECAR]
"""

import sys
from pathlib import Path

from proofmass import check

MODELS = Path(__file__).parent.parent / "models"


def main(sidecar: Path) -> int:
    """Check a sidecar, and return the exit code of `proofmass check`."""
    result = check([sidecar])
    for error in result.errors:  # bad input: the file, the key, and what is expected there
        print("error:", error)
    for run, solver in dict.fromkeys((c.run, c.solver) for c in result.comparisons):
        rows = [c for c in result.comparisons if (c.run, c.solver) == (run, solver)]
        checked = [c for c in rows if c.allowed > 0]
        if not checked:
            print(f"{run:9}{solver:16}is shown, not checked: no tolerance covers it")
            continue
        worst = max(checked, key=lambda c: c.error_max / c.allowed)
        print(
            f"{run:9}{solver:16}{worst.outcome}: {worst.channel} is off by {worst.error_max:.1e} "
            f"{worst.unit}, allowed {worst.allowed:.1e}"
        )
        for name, change in worst.detectable.items():
            if change.relative and name in ("crank", "coupler", "rocker"):
                print(f"{'':25}a {name} longer by {change.size:.0e} of its length would be noticed")
    print("exit code", result.exit_code)
    return result.exit_code


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if sys.argv[1:] else MODELS / "linkages" / "fourbar.toml"))
