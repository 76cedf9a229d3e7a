"""Response times of the notebooks' sliders, and run times of the notebooks.

    python -m benchmarks.notebooks [--quick]
    uv run --group notebooks python -m benchmarks.notebooks --browser

The response time of a slider is the CPU time of its callback, the shortest of some, with the cells
of a notebook in this process.  A change of a length evaluates the closed form and draws; a change
of the pose only draws.  The run time is that of a whole notebook in a kernel, with the CPU time of
the kernel and of its workers; with --quick no notebook is run.

With --browser the time is that for which a user waits, in JupyterLab and the Chromium of the
system: from a key that moves a slider to the first frame after the drawing has changed, with the
kernel, the server and the browser on this machine.
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

NOTEBOOKS = ROOT / "teaching"
NAMES = sorted(file.stem for file in NOTEBOOKS.glob("*.ipynb"))
ROUNDS = 5
SPENT = """
import psutil

me = psutil.Process()
print(sum(sum(one.cpu_times()[:4]) for one in (me, *me.children(recursive=True))))
"""
"""Code that prints the CPU time [s] of a kernel and of its workers, ended ones included."""


def cells(name: str) -> dict[str, str]:
    """The code of the cells of a notebook, by the names of the cells."""
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
    """CPU times [s] of a change of a length, and of a change of the pose."""

    def least(call: Any) -> float:
        took = []
        for _ in range(rounds):
            began = time.process_time()
            call()
            took.append(time.process_time() - began)
        return min(took)

    return least(explorer.change), least(explorer.move)


def executed(name: str, last: str = "pass") -> Any:
    """The notebook after a run in a kernel, with an additional last cell; failures raise."""
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
    """Run a server of the notebooks without a token; gives its address."""
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
"""JavaScript that records the time [ms] from a key to the frame after the drawing has changed."""
KEY_PRESSES = 10  # for each slider, to and fro


def waits(browser: Any, address: str, name: str) -> list[list[float]]:
    """Times [ms] from each key of each slider of a notebook until the drawing has changed."""
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
        tab.mouse.wheel(0, -3000)  # JupyterLab renders only visible cells
        tab.wait_for_timeout(500)
    handles = tab.locator(".noUi-handle")
    handles.first.scroll_into_view_if_needed()
    tab.evaluate(WATCH)
    tab.wait_for_timeout(3000)  # until the visible cells are rendered
    found = []
    for number in range(handles.count()):
        handles.nth(number).focus()
        tab.evaluate("window.waits = []")
        for turn in range(KEY_PRESSES):
            tab.keyboard.press("ArrowRight" if turn % 2 else "ArrowLeft")
            tab.wait_for_timeout(300)
        found.append(tab.evaluate("window.waits"))
    tab.close()
    return found


def in_browser() -> None:
    """Print the response times of sliders in a browser."""
    from docs.make.pictures import chromium  # loads the report, which is slow

    print(f"{'notebook':24}{'sliders':>9}{'medians ms':>14}{'longest ms':>12}")
    with lab() as address, chromium() as browser:
        for name in NAMES:
            times = [some for some in waits(browser, address, name) if some]
            middle = sorted(median(some) for some in times)
            span = f"{middle[0]:.0f} to {middle[-1]:.0f}"
            print(f"{name:24}{len(times):9}{span:>14}{max(map(max, times)):12.0f}", flush=True)


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
