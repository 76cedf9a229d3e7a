"""The reference of a case: found, called at the samples of a run, and what can be drawn of it."""
