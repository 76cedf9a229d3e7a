"""What all other folders build on: errors, files, units, workers and plain data."""
