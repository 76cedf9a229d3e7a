"""Closed-form motion of simple mechanisms: the references the physics engines are compared with.

Every module has one ``solve`` returning a dict of arrays, one entry per curve. SI units, radians;
angles are counter-clockwise from +x (the pendulum's from straight down) and continuous along the
sweep, which is the last axis. Formulas only: no iteration to a tolerance and no integration in
time, so what is left is rounding. numpy and scipy are all that is needed.
"""
