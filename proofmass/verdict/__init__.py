"""Whether the curves of a run agree with the reference."""
