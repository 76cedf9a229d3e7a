"""What a model is: its mobility, its faults at the start, and the time steps that it bears."""
