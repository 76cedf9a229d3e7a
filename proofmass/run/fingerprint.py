"""Digests of what a stored result depends on: files, compiled models, versions and sources."""

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import distribution, version
from pathlib import Path

import mujoco
import numpy as np

from proofmass import analytic, reference, sim
from proofmass.base.entry_points import foreign_distribution
from proofmass.base.installation import digest_plugins, own_version
from proofmass.case.case import Case
from proofmass.reference.case_model import compiled_model
from proofmass.reference.find import REFERENCE_GROUP
from proofmass.run.case_files import recorded_files
from proofmass.sim import hosts
from proofmass.sim.engines import VERSION_MARK, distribution_of_engine, engine_of

SCRIPTS = Path(hosts.__path__[0]) / "scripts"
"""The scripts of the engines of this distribution that run in other interpreters."""


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal.

    >>> digest(b"abc")[:8]
    'ba7816bf'
    """
    return hashlib.sha256(data).hexdigest()


def bytes_of_case_model(case: Case) -> bytes:
    """The compiled model as bytes, with its rods and with the files that it includes."""
    return bytes_of_model(compiled_model(case))


def bytes_of_model(model: mujoco.MjModel) -> bytes:
    """Save a compiled model to bytes in MuJoCo's own format."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def digest_recorded_files(case: Case) -> str:
    """Digest the recorded files of a case, and the code of a reference from elsewhere."""
    parts = list(map(Path.read_bytes, recorded_files(case)))
    if brought := foreign_distribution(REFERENCE_GROUP, case.reference):
        parts.append(digest_plugins(distribution(brought)).encode())
    return digest(b"".join(parts)) if parts else ""


@cache
def package_versions(engine: str) -> dict[str, str]:
    """Versions of the packages that compute a result, and a digest of an engine from elsewhere."""
    brought = distribution_of_engine(engine.partition(VERSION_MARK)[0])
    names = ["mujoco", "numpy", "scipy", *filter(None, [brought])]
    code = {"adapter": digest_plugins(distribution(brought))} if brought else {}
    return {
        "proofmass": own_version(),
        **{name: version(name) for name in names},
        **engine_of(engine).versions(),
        **code,
    }


def digest_sources(own: Iterable[Path]) -> str:
    """Digest the source code of engines and references, and given files of other folders.

    A script of an engine in another interpreter concerns the runs of that engine alone, whose
    `versions` have its digest.
    """
    files = [
        file
        for package in (sim, analytic, reference)
        for folder in package.__path__
        for file in sorted(Path(folder).rglob("*.py"))
        if SCRIPTS not in file.parents
    ]
    return digest(b"".join(file.read_bytes() for file in (*files, *own)))
