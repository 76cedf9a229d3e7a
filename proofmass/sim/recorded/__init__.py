"""Recorded curves of other programs and test rigs; others import only its module `engine`."""
