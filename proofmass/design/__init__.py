"""Design of mechanisms: cases written from their parameters."""
