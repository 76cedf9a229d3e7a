"""Studies of the engines: trade (with choose), stress and diet, and what they share."""

DEFAULT_LONGEST_RUN = 30.0
"""Default processor time after which a run of a study is given up [s]."""
DEFAULT_SEARCH_BUDGET = 20.0
"""Default processor time of all runs of a search for a setting together [s]."""
