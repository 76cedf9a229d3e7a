"""Studies: what accuracy costs, how far it goes, and what a model can do without."""
