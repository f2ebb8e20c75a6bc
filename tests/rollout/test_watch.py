"""Whether the fingers hold an object."""

from __future__ import annotations

import numpy as np
import pytest

from gensim2.robots import robot
from gensim2.rollout.watch import Held
from gensim2.tasks.measurement import Measurement

PROFILE = robot("panda")


@pytest.mark.parametrize(
    ("width", "opening", "is_lost"),
    [
        (0.0028, 0.0018, False),  # the wall of a bowl, into which the pads sink
        (0.0028, 0.0004, True),
        (0.03, 0.02, False),
        (0.03, 0.005, True),
        (None, 0.0018, True),
        (None, 0.0025, False),
    ],
)
def test_an_object_is_lost_if_the_pads_are_much_closer_than_its_width(
    width: float | None, opening: float, is_lost: bool
) -> None:
    q = np.asarray(PROFILE.reset_qpos, dtype=np.float64)
    T_hand_object = np.linalg.inv(PROFILE.T_world_base @ PROFILE.model.forward_kinematics(q))
    measured = Measurement(
        openness={},
        joint_speed={},
        keypoints={},
        poses={"bowl": np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])},
        speeds={},
        gripper={},
        finger_opening=opening,
    )
    assert Held("bowl", T_hand_object, width).is_lost(PROFILE, q, measured) is is_lost
