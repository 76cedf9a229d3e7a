"""Results as text for a terminal and for other programs."""
