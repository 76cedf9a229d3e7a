"""Simulators, each in a folder; ``NAME/engine.py`` has ``simulate(model, run) -> Curves``."""
