"""Why a run differs or failed: `find_causes` and `describe_failure`.

`fault` has the object that a cause is about, a wrong value in a file; `explanation` what is found;
`causes` the search, with its hypotheses in `channels`, `model` and `settings`; `fit` the fits;
`failure` the description of runs that failed.
"""

from proofmass.evidence.diagnosis.causes import best_causes, find_causes
from proofmass.evidence.diagnosis.explanation import (
    Diagnosis,
    Explanation,
    SharedCause,
    shared_causes,
)
from proofmass.evidence.diagnosis.failure import describe_failure
from proofmass.evidence.diagnosis.fault import Fault
from proofmass.evidence.diagnosis.model import confirm_cause

__all__ = [
    "Diagnosis",
    "Explanation",
    "Fault",
    "SharedCause",
    "best_causes",
    "confirm_cause",
    "describe_failure",
    "find_causes",
    "shared_causes",
]
