"""Measurements that are run by hand.  NumPy is held to one thread, before it is loaded."""

import os

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
