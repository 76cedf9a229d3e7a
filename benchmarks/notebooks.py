"""How long sliders of the notebooks take to answer, and the notebooks to run.

    python -m benchmarks.notebooks [--quick]
    uv run --group notebooks python -m benchmarks.notebooks --browser

A slider's answer is the CPU time of its callback, the least of some, for which the cells of a
notebook run in this process: closed form and drawing after a change of a length, drawing alone
after a change of the pose.  A run is that of a whole notebook in a kernel, with the CPU time of
the kernel and of its workers; with --quick there is none.

With --browser it is what a user waits for: in JupyterLab and the Chromium of the system, from a
key that moves a slider to the first frame after the drawing has changed, with the kernel, the
server and the browser on this machine.
"""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median
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


@contextmanager
def lab() -> Iterator[str]:
    """The address of a server of the notebooks, which asks for no token."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    words = [
        *(sys.executable, "-m", "jupyter", "lab", "--no-browser", "--allow-root"),
        f"--port={port}",
        f"--ServerApp.root_dir={NOTEBOOKS}",
        "--IdentityProvider.token=",
        "--LabApp.news_url=",
    ]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            for _ in range(60):
                with socket.socket() as asked:
                    if not asked.connect_ex(("localhost", port)):
                        break
                time.sleep(0.5)
            yield f"http://localhost:{port}/lab/tree"
        finally:
            server.terminate()


WATCH = """() => {
  let began = null;
  window.waits = [];
  document.addEventListener("keydown", () => { began = performance.now(); }, true);
  new MutationObserver(() => {
    if (began !== null) {
      const start = began;
      began = null;
      requestAnimationFrame(() => window.waits.push(performance.now() - start));
    }
  }).observe(
    document.querySelector(".widget-html-content svg").closest(".widget-html-content"),
    { childList: true, subtree: true },
  );
}"""
"""Notes the time from a key to the frame after the next change of the drawing [ms]."""
KEYS = 10  # presses for each slider, to and fro


def waits(browser: Any, address: str, name: str) -> list[list[float]]:
    """How long each key of each slider of a notebook takes until the drawing has changed [ms]."""
    tab = browser.new_page(viewport={"width": 1400, "height": 1000})
    tab.goto(f"{address}/{name}.ipynb?reset")
    tab.wait_for_selector(".jp-Notebook .jp-Cell")
    tab.wait_for_timeout(3000)
    tab.get_by_role("menuitem", name="Run").first.click()
    tab.get_by_text("Run All Cells", exact=True).first.click()
    tab.wait_for_timeout(2000)
    tab.locator(".jp-Notebook").first.hover()
    drawn = tab.locator(".widget-html-content svg")
    while not (drawn.count() and "Idle" in tab.locator("#jp-main-statusbar").inner_text()):
        tab.mouse.wheel(0, -3000)  # cells out of sight are not there
        tab.wait_for_timeout(500)
    handles = tab.locator(".noUi-handle")
    handles.first.scroll_into_view_if_needed()
    tab.evaluate(WATCH)
    tab.wait_for_timeout(3000)  # until what came into sight is there
    found = []
    for number in range(handles.count()):
        handles.nth(number).focus()
        tab.evaluate("window.waits = []")
        for turn in range(KEYS):
            tab.keyboard.press("ArrowRight" if turn % 2 else "ArrowLeft")
            tab.wait_for_timeout(300)
        found.append(tab.evaluate("window.waits"))
    tab.close()
    return found


def in_browser() -> None:
    """Print how long sliders take in a browser."""
    from benchmarks.pictures import chromium  # loads the report, which is slow

    print(f"{'notebook':24}{'sliders':>9}{'medians ms':>14}{'longest ms':>12}")
    with lab() as address, chromium() as browser:
        for name in NAMES:
            there = [some for some in waits(browser, address, name) if some]
            middle = sorted(median(some) for some in there)
            span = f"{middle[0]:.0f} to {middle[-1]:.0f}"
            print(f"{name:24}{len(there):9}{span:>14}{max(map(max, there)):12.0f}", flush=True)


def main() -> None:
    parser = command(__doc__)
    parser.add_argument("--browser", action="store_true")
    given = parser.parse_args()
    if given.browser:
        in_browser()
        return
    quick = given.quick
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
