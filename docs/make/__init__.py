"""Makers of pages and pictures of docs/, and of files of models/: ``python -m docs.make.NAME``.

Pages of speeds and limits are written by `benchmarks`, which measures them.  Each module that can
be run has the option `--quick`, as those of `benchmarks` have.
"""
