"""Tables of other programs: what their columns are, and what was changed to read them."""
