"""The commands of the terminal; only they know its options and its console."""
