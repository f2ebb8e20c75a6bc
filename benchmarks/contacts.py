"""Which bodies may touch during which part of a motion, by their roles: docs/solver.md, "What may touch"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from judge import Pair
from mechanism import Mechanism
from parts import Moved, Part

Array = np.ndarray


@dataclass
class Obstacle:
    """A rigid body of a scene: ``role`` is table, object_body, moving_link, rigid, target or attached.

    ``pose`` (4, 4) is in the base frame; of an attached body, in the hand frame.
    """

    name: str
    role: str
    parts: list[Part]
    pose: Array


@dataclass
class Clock:
    """When the hand may begin to touch the moving link, and when that link begins to move, seconds."""

    touching_from: float
    moving_from: float


def judged_pairs(
    arm: Mechanism, obstacles: Sequence[Obstacle], clock: Clock, times: Array, q: Array
) -> list[tuple[str, Pair]]:
    """Every pair that is judged somewhere along a motion, with its group: self, table or object.

    Args:
        arm: the robot.
        obstacles: the scene.
        clock: of the contact rules.
        times: (M,) seconds.
        q: (M, n) joint vectors at those times.
    """
    placed = arm.place(q)
    links = {name: Moved(name, arm.parts[name], placed[name]) for name in arm.parts}
    held = [
        Moved(each.name, each.parts, placed[arm.hand_link] @ each.pose) for each in obstacles if each.role == "attached"
    ]
    always = np.ones(len(times), dtype=bool)
    pairs = [("self", Pair(links[one], links[two], always)) for one, two in arm.self_pairs]
    carried = arm.movers(arm.hand_link)
    for body in held:
        pairs += [
            ("self", Pair(body, links[name], always))
            for name in arm.parts
            if name not in arm.hand_links and arm.movers(name) != carried
        ]
    movers = [(links[name], name in arm.hand_links) for name in arm.moving_links] + [(body, True) for body in held]
    for obstacle in obstacles:
        if obstacle.role == "attached":
            continue
        still = Moved(obstacle.name, obstacle.parts, obstacle.pose[None])
        group = "table" if obstacle.role == "table" else "object"
        for body, on_hand in movers:
            if obstacle.role == "target" and on_hand:
                continue
            judged = always
            if obstacle.role == "moving_link":
                judged = times < (clock.touching_from if on_hand else clock.moving_from)
            pairs.append((group, Pair(body, still, judged)))
    return pairs
