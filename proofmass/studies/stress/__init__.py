"""Limits of parameters: how far each goes until an engine's run fails."""
