"""All equilibria of rods of a file: read, searched, drawn, and tried in the engines."""
