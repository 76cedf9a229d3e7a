"""Closed forms of linkages, one file each."""
