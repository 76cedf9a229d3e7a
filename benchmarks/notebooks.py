"""How long sliders of the notebooks take to answer, and the notebooks to run.

    python -m benchmarks.notebooks [--quick]

A slider's answer is the CPU time of its callback, the least of some, for which the cells of a
notebook run in this process: closed form and drawing after a change of a length, drawing alone
after a change of the pose.  A run is that of a whole notebook in a kernel, with the CPU time of
the kernel and of its workers; with --quick there is none.
"""

import json
import time
from typing import Any

from benchmarks import ROOT, command
from proofmass import Explorer

NOTEBOOKS = ROOT / "notebooks"
NAMES = sorted(file.stem for file in NOTEBOOKS.glob("*.ipynb"))
ROUNDS = 5
SPENT = """
import psutil

me = psutil.Process()
print(sum(sum(one.cpu_times()[:4]) for one in (me, *me.children(recursive=True))))
"""
"""CPU time [s] of a kernel, of its workers, and of those that have ended."""


def cells(name: str) -> dict[str, str]:
    """The code of a notebook by the names of its cells."""
    found = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text(encoding="utf-8"))
    return {c["id"]: "".join(c["source"]) for c in found["cells"] if c["cell_type"] == "code"}


def explored(name: str) -> Explorer:
    """The sliders of a notebook, in this process."""
    known: dict[str, Any] = {}
    for cell in ("case", "model", "sliders"):
        code = cells(name)[cell].replace('"../models/', f'"{ROOT.as_posix()}/models/')
        exec(compile(code, f"{name}:{cell}", "exec"), known)
    found: Explorer = known["explorer"]
    return found


def answers(explorer: Explorer, rounds: int = ROUNDS) -> tuple[float, float]:
    """CPU time [s] of a change of a length, and of one of the pose."""

    def least(call: Any) -> float:
        took = []
        for _ in range(rounds):
            began = time.process_time()
            call()
            took.append(time.process_time() - began)
        return min(took)

    return least(explorer.change), least(explorer.move)


def executed(name: str, last: str = "pass") -> Any:
    """The notebook after it ran in a kernel, with a last cell; a cell that fails raises."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell(last, id="last"))
    return NotebookClient(
        notebook,
        timeout=300,
        resources={"metadata": {"path": str(NOTEBOOKS)}},
        extra_arguments=["--IPKernelApp.log_level=40"],
    ).execute()


def main() -> None:
    quick = command(__doc__).parse_args().quick
    print(f"{'notebook':24}{'length ms':>10}{'pose ms':>9}{'kB':>5}{'run s':>8}{'CPU s':>8}")
    for name in NAMES[-1:] if quick else NAMES:
        explorer = explored(name)
        length, pose = answers(explorer)
        line = (
            f"{name:24}{1e3 * length:10.1f}{1e3 * pose:9.1f}{len(explorer.panel.value) / 1e3:5.0f}"
        )
        if not quick:
            began = time.perf_counter()
            spent = executed(name, SPENT).cells[-1].outputs[0]["text"]
            line += f"{time.perf_counter() - began:8.1f}{float(spent):8.1f}"
        print(line)


if __name__ == "__main__":
    main()
