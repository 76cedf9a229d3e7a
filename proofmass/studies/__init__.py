"""Studies of the engines: trade (with choose), stress and diet, and what they share."""

LONGEST = 30.0
"""Wall time after which a run of a study is given up, unless another is given [s]."""
BUDGET = 300.0
"""Wall time of a whole search for a setting, unless another is given [s]."""
