"""Many cases at once: their files, the workers that run them, and their results."""
