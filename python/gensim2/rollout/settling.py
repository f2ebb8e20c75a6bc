"""How long the last command is held before an episode is judged."""

SETTLE_STEPS = 10
"""Control steps (0.5 s) for which it is held in any case."""

MAX_SETTLE_STEPS = 40
"""Control steps after which an episode is judged although something still moves."""

LASTING_STEPS = 20
"""Control steps (1 s) after which a goal that lasts is still there; they count from the last command, too."""
