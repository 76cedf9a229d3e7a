"""Engines that run in interpreters of their own, started by uv."""
