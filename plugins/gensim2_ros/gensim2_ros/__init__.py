"""Plan motions of MoveIt's messages with the solver of gensim2; only :mod:`gensim2_ros.node` needs ROS 2."""

from .arm import Arm as Arm
from .planner import Answer as Answer
from .planner import Planner as Planner
from .refusals import ErrorCode as ErrorCode
from .refusals import RefusedError as RefusedError
from .responses import joint_trajectory as joint_trajectory
from .responses import motion_plan_response as motion_plan_response
