"""Closed forms of linkages: a file or folder for each linkage."""
