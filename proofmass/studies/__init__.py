"""Studies of the engines: trade (with choose), stress and diet, and what they share."""

LONGEST = 30.0
"""Wall time after which a run of a study is given up, unless another is given [s]."""
BUDGET = 20.0
"""Wall time of all runs of a search for a setting together, unless another is given [s]."""
