"""A solver config with its own clock, as the original's have: to a drawer's handle and twice forward."""

from __future__ import annotations

from typing import Any

from constraints import point_to_point

CONFIG: dict[str, Any] = {
    "constraint_list": [
        point_to_point("tool_head", "articulated_object_head", 0.001),
    ],
    "pre_actuation_motions": [["translate_z", -0.1]],
    "post_actuation_motions": ["move-forward", "move-forward"],
    "actuation_time": 8.0,
    "pre_actuation_times": [4.0],
    "post_actuation_times": [12.0, 16.0],
}
