"""Simulators, one folder each: ``NAME/engine.py`` holds ``simulate(model, run) -> Curves``."""
