"""What ``proofmass new --from`` proposes for a model: a run, a reference, tolerances, mutants."""
