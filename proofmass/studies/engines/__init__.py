"""``proofmass engines``: cases beside engines, where each is good and where it breaks."""
