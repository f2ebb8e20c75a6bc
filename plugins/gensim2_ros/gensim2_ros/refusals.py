"""Error codes of MoveIt, and the exception for requests that cannot be honoured."""

from __future__ import annotations

from enum import IntEnum


class ErrorCode(IntEnum):
    """Values of ``moveit_msgs/msg/MoveItErrorCodes`` that this package reports."""

    SUCCESS = 1
    PLANNING_FAILED = -1
    TIMED_OUT = -6
    PREEMPTED = -7
    START_STATE_IN_COLLISION = -10
    START_STATE_VIOLATES_PATH_CONSTRAINTS = -11
    GOAL_IN_COLLISION = -12
    GOAL_VIOLATES_PATH_CONSTRAINTS = -13
    INVALID_GROUP_NAME = -15
    INVALID_GOAL_CONSTRAINTS = -16
    INVALID_ROBOT_STATE = -17
    INVALID_LINK_NAME = -18
    INVALID_OBJECT_NAME = -19
    FRAME_TRANSFORM_FAILURE = -21
    COLLISION_CHECKING_UNAVAILABLE = -22
    START_STATE_INVALID = -26
    GOAL_STATE_INVALID = -27
    UNRECOGNIZED_GOAL_TYPE = -28
    NO_IK_SOLUTION = -31


class RefusedError(Exception):
    """A message cannot be honoured.

    Attributes:
        code: error code of MoveIt.
        field: path of the field at fault in the message.
        message: what is wrong with the value, and the remedy.
    """

    def __init__(self, code: ErrorCode, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.code, self.field, self.message = code, field, message
