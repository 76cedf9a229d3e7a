"""A run of a case in an engine: its sidecar with all defaults, its plan, and what it depends on."""
