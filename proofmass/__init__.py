"""proofmass: multibody simulators held against mathematics."""

from importlib.metadata import PackageNotFoundError, version

from proofmass.case import Case, load_case
from proofmass.check import check
from proofmass.compare import Comparison, compare
from proofmass.errors import InputError
from proofmass.reference import evaluate
from proofmass.sim.protocol import Curves
from proofmass.solve import solve

try:
    __version__ = version("proofmass")
except PackageNotFoundError:  # a source tree on the path, not installed
    __version__ = "0+unknown"

__all__ = ["Case", "Comparison", "Curves", "InputError", "check", "compare", "evaluate",
           "load_case", "solve"]
