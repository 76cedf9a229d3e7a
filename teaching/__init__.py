"""Methods as two source documents teach them, beside the notebooks that show them.

A notebook of this folder imports these modules by their names alone: ``natural_coordinates``.
"""
