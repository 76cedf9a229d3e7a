"""Simulators, one file each: ``with_NAME.py`` holds ``simulate(model, run) -> Curves``."""
