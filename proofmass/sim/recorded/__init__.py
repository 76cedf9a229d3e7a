"""Recorded curves of other programs and test rigs: `engine` is all that the rest asks for."""
