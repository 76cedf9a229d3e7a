"""Measurements of speed and limits, run by hand.  NumPy gets one thread before it is loaded.

Each module that can be run has the option `--quick`, with which it runs at small sizes in seconds
and writes nothing into docs/.  `tests/test_benchmarks.py` runs all of them with this option, and
those of `docs.make`.
"""

import os
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

ROOT = Path(__file__).parent.parent


def command(text: str | None) -> ArgumentParser:
    """A command line with `--quick`."""
    parser = ArgumentParser(description=text, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument(
        "--quick",
        action="store_true",
        help="the same at small sizes, in seconds; writes nothing into docs/",
    )
    return parser


@contextmanager
def folders(quick: bool, runs: Path) -> Iterator[tuple[Path, Path]]:
    """The folders of runs and of pages; if quick, both are temporary."""
    if not quick:
        with replacing_pages():
            yield runs, ROOT / "docs"
        return
    with TemporaryDirectory() as folder:
        yield Path(folder) / "runs", Path(folder)


@contextmanager
def replacing_pages() -> Iterator[None]:
    """Let outputs replace the pictures of docs/, and leave no list of what was written there."""
    from proofmass.base.files import LIST_NAME, output_permissions  # after the threads are set

    try:
        with output_permissions(force=True):
            yield
    finally:
        (ROOT / "docs" / LIST_NAME).unlink(missing_ok=True)
