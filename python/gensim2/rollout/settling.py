"""Seconds for which the last command is held before an episode is judged; a profile says how many steps these are."""

SETTLE_SECONDS = 0.5
"""For which it is held in any case."""

MAX_SETTLE_SECONDS = 2.0
"""After which an episode is judged although something still moves."""

LASTING_SECONDS = 1.0
"""After which a goal that lasts is still there; they count from the last command, too."""
