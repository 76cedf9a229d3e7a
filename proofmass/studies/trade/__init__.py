"""Accuracy over wall time: settings from coarse to fine, error floors, and the one to choose."""
