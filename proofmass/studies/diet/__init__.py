"""Reduced models: what of a model its motion needs."""
