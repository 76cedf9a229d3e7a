"""Releases of the package of an engine, as uv finds them in its index."""

import subprocess
import sys
import tempfile
from collections.abc import Callable

from proofmass.sim.hosts.process import explain_uv, find_uv
from proofmass.sim.protocol.failures import Unavailable

NO_RELEASE = ("unsatisfiable", "incompatible", "no solution", "No solution")
"""Words of uv by which no release fulfils a requirement."""


def list_releases(
    package: str, oldest: str, newest: str = "", progress: Callable[[str], None] = lambda _: None
) -> list[str]:
    """The releases of a package that have a wheel for this Python, the oldest first.

    uv is asked for the newest release, then for the newest before that, and so on: it has no
    command that lists them.

    Parameters
    ----------
    package : str
        Such as ``mujoco``.
    oldest, newest : str
        The first and the last release; empty: the last one there is.
    progress : callable
        Called with each release.

    Raises
    ------
    Unavailable
        There is no uv, or it finds no release.
    """
    found = list[str]()
    below = f",<={newest}" if newest else ""
    while (release := newest_release(f"{package}>={oldest}{below}", not found)) is not None:
        found.append(release)
        progress(release)
        below = f",<{release}"
    return found[::-1]


def newest_release(requirement: str, must: bool = False) -> str | None:
    """The newest release that a requirement allows; None if there is none.

    Raises
    ------
    Unavailable
        uv cannot ask its index, or there is none although there `must` be one.
    """
    flags = ["--quiet", "--no-header", "--no-annotate", "--no-deps", "--only-binary", ":all:"]
    with tempfile.TemporaryDirectory() as nowhere:
        made = subprocess.run(
            [find_uv(), "pip", "compile", *flags, "--python", sys.executable, "-"],
            input=requirement,
            capture_output=True,
            text=True,
            cwd=nowhere,
            check=False,
        )
    if made.returncode == 0:
        return made.stdout.strip().partition("==")[2] or None
    if must or not any(word in made.stderr for word in NO_RELEASE):
        raise Unavailable(explain_uv(made.stderr, (requirement,)))
    return None
