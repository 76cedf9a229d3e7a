"""Why curves differ, and which wrong numbers no run would notice."""
