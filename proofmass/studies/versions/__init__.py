"""``proofmass versions``: what changed between versions of an engine, and in which."""
