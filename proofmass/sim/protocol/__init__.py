"""The interface of engines: a run, its curves, settings, and the parts that an engine may have."""
