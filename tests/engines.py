"""Engines in interpreters of their own, for tests: what uv has fetched, or may fetch."""

import os
import sys

from proofmass.sim.engines import engine_of
from proofmass.sim.hosts.engine import About, HostedEngine
from proofmass.sim.hosts.engines import PYMUNK
from proofmass.sim.hosts.process import is_fetched

MAY_FETCH = "PROOFMASS_FETCH"
"""Variable of the environment that lets tests fetch packages of engines, of up to 0.4 GB each."""

PYMUNK_HERE = HostedEngine(
    "pymunk_plain.py",
    (f"pymunk=={PYMUNK.version}",),
    title="pymunk",
    about=About("as shipped", "MIT"),
    settings=PYMUNK.settings,
    lacks=PYMUNK.lacks,
    planar=True,
    stops=True,
    friction=True,
    contacts=True,
    rests=True,
    python=sys.executable,
)
"""pymunk by the script of other interpreters, in the interpreter of the tests."""


def why_not_there(name: str) -> str:
    """Why a test cannot run an engine; empty if it can.

    Tests fetch nothing unless the environment says so: nobody asked for these engines.
    """
    engine = engine_of(name)
    if os.environ.get(MAY_FETCH) == "1" or not isinstance(engine, HostedEngine):
        return engine.provide()
    state = is_fetched(engine.requires, engine.python)
    return "" if state == "fetched" else f"{name}: {state}, which {MAY_FETCH}=1 allows in tests"
