"""Proven errors of references: a table that ``python -m benchmarks.proven_errors`` writes.

A bound holds for numbers, not for a program: it is the distance between the float64 values of a
reference at the samples of a run and the exact values.  So a bound is given only if the case has
the inputs of the proof, and if its reference has the same values here, bit by bit.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from proofmass.base.arrays import Array
from proofmass.base.strict import Kind
from proofmass.case.case import Case
from proofmass.case.drive import DriveState
from proofmass.reference.evaluate import evaluate
from proofmass.reference.profiles import drive_profiles
from proofmass.reference.samples import run_samples
from proofmass.sim.model_files import model_key

TABLE_FILE = Path(__file__).with_name("proven.json")
UNRELATED_TABLES = frozenset(
    {"file", "title", "source", "model", "settings", "tolerance", "view", "chart", "refine"}
    | {"compare_with", "run", "unchecked", "unmatched", "called", "asked"}
)
"""Fields of a case on which the values of its reference and their scales do not depend."""
DIGITS_OF_DIGEST = 16
"""Hexadecimal digits of a digest that are kept: 64 bits, against accidents and not attacks."""


@dataclass(frozen=True)
class ProvenRun:
    """What is proven of the reference of a case in a run.

    Attributes
    ----------
    inputs, values : str
        Digests of the inputs of the proof, and of the values that it is about.
    samples : int
        Number of samples [1].
    alone_within : float
        At each sample the pose is the only one in a box of this half width [m or rad]; 0 if the
        reference solves no loops.
    errors : dict of float
        Largest error of all channels of a kind, such as position or moment, as a share of the range
        of its curve [1].
    not_covered : tuple of str
        Channels without a bound.
    continuous : bool
        Whether one branch is proven to lead from each sample to the next.
    """

    inputs: str
    values: str
    samples: int
    alone_within: float
    errors: dict[str, float]
    not_covered: tuple[str, ...] = ()
    continuous: bool = False


@dataclass(frozen=True)
class ProvenTable:
    """All runs of which something is proven, by ``case run``, and the versions of that proof.

    `reasons` says why nothing is proven of the other runs of shipped cases.
    """

    versions: dict[str, str] = field(default_factory=dict)
    runs: dict[str, ProvenRun] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)


TABLE_FORMAT = TypeAdapter(ProvenTable)


def proven_errors(case: Case, kind: Kind) -> Mapping[str, float]:
    """The proven errors of the reference of a run, by the kind of quantity.

    The reference is evaluated once if the case is one of the table, to compare its values with
    those of the proof.

    Parameters
    ----------
    case : Case
    kind : str
        The run.

    Returns
    -------
    mapping of str to float
        Largest error at the samples of the run, as a share of the range of its curve [1], by
        "position", "velocity", "acceleration", "moment", "force" or "energy".  Empty if nothing is
        proven, or if the case or a value of its reference differs from that of the proof.
    """
    found = proven_run(case, kind)
    return found.errors if found else {}


def proven_run(case: Case, kind: Kind) -> ProvenRun | None:
    """What is proven of the reference of a run; None if nothing is, as in `proven_errors`."""
    found = read_proven_table().runs.get(f"{case.name} {kind}")
    if found is None or found.inputs != digest_inputs(case, kind):
        return None
    return found if found.values == digest_values(case, kind) else None


@cache
def read_proven_table() -> ProvenTable:
    """Read the table; it is empty if there is none."""
    if not TABLE_FILE.is_file():
        return ProvenTable()
    return TABLE_FORMAT.validate_json(TABLE_FILE.read_bytes())


def digest_inputs(case: Case, kind: Kind) -> str:
    """Digest what a proof takes as exact: parameters, channels, samples, motion, and the model.

    The numbers of a model that a reference reads itself depend on the version of MuJoCo as well.
    """
    tables = case.model_dump(mode="json", exclude=set(UNRELATED_TABLES))
    files = model_key(case.model_path)
    compiler = version("mujoco") if case.reads_model else ""
    text = json.dumps([tables, kind, case.has_inertia(kind), files, compiler], sort_keys=True)
    x, state = prescribed_motion(case, kind)
    return short_digest(text.encode(), *map(np.ndarray.tobytes, (x, *(state or ()))))


def digest_values(case: Case, kind: Kind) -> str:
    """Digest the values of the reference at the samples of a run."""
    curves = evaluate(case, kind, *prescribed_motion(case, kind)).channels
    return short_digest(*(curves[name].tobytes() for name in sorted(case.channels_of(kind))))


def short_digest(*parts: bytes) -> str:
    """Digest parts in their order.

    >>> short_digest(b"abc")
    'ba7816bf8f01cfea'
    """
    return sha256(b"".join(parts)).hexdigest()[:DIGITS_OF_DIGEST]


def prescribed_motion(case: Case, kind: Kind) -> tuple[Array, DriveState | None]:
    """The samples of a run, and the prescribed state of its drives there; None without drives."""
    x = run_samples(case, kind)
    if kind == "equilibrium":
        return x, None
    profiles = [np.broadcast_arrays(*profile(x), x)[:3] for profile in drive_profiles(case, kind)]
    if not profiles:
        return x, None
    value, rate, acceleration = map(np.array, zip(*profiles, strict=True))
    return x, (value, rate, acceleration)
