"""Draw close-ups of the fingertips for videos.

The view is from beside the hand, which hides the contact in other views.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gensim2.objects import ObjectModel
from gensim2.perception import Camera, View
from gensim2.perception.raycast.drawing import shaded
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import RobotProfile

Frame = npt.NDArray[np.uint8]

SHARE = 0.3
"""Width and height of the close-up as a fraction of the picture's height."""
DISTANCE, BEHIND = 0.22, 0.12
"""Offset of the camera from the fingertips: sideways, and back towards the wrist (m)."""
FIELD_OF_VIEW = float(np.deg2rad(45))
BLOCKED = 0.06
"""A surface hides the fingertips if it is nearer to the camera than they are by more than this distance (m)."""
FRAME, FRAME_WIDTH = (40, 46, 56), 2
TEXT, OUTLINE = (235, 238, 242), (24, 26, 30)
TEXT_HEIGHT, SMALL_TEXT_HEIGHT = 14, 11
"""Height of the title of a frame and of a close-up, pixels."""


class CloseUp:
    """Object that draws a close-up of the fingertips, from the least hidden side, into a corner of video frames.

    Args:
        profile: robot profile.
        objects: objects of the scene by name.
        height: height of the video frames, pixels.
    """

    def __init__(self, profile: RobotProfile, objects: Mapping[str, ObjectModel], height: int) -> None:
        self._size = int(SHARE * height)
        self._profile = profile
        self._scene = RaycastScene(profile, objects, [_camera(profile, side, self._size) for side in (1.0, -1.0)])
        self._side = 0

    def onto(self, picture: Frame, states: Mapping[str, Any]) -> Frame:
        """Return a copy of a picture (H, W, 3) with the close-up in its lower right corner.

        Args:
            picture: frame of the video.
            states: recorded states at this time in ManiSkill's layout, arrays (1, ...).
        """
        link = self._profile.hand_link
        pose = self._scene.link_poses(states, self._profile.agent, link)[0]
        views = self._scene.see(self._scene.poses(states)[0], {link: pose})
        hidden = [_hidden(view) for view in views]
        if hidden[self._side] > 0.5 > hidden[1 - self._side]:
            self._side = 1 - self._side
        drawn, edge = picture.copy(), self._size + FRAME_WIDTH
        drawn[-edge:, -edge:] = FRAME
        drawn[-self._size :, -self._size :] = titled(shaded(views[self._side]), "fingertips", SMALL_TEXT_HEIGHT)
        return drawn


def titled(picture: Frame, title: str, height: int = TEXT_HEIGHT) -> Frame:
    """Return a copy of a picture with a title in the upper left corner.

    Args:
        picture: picture (H, W, 3).
        title: text of one line.
        height: height of the text, pixels.
    """
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(picture)
    font = ImageFont.load_default(height)
    ImageDraw.Draw(image).text((height // 2, height // 2 - 1), title, TEXT, font, stroke_width=2, stroke_fill=OUTLINE)
    return np.asarray(image)


def _camera(profile: RobotProfile, side: float, size: int) -> Camera:
    """Return a camera fixed to the hand, in whose picture the fingers point down."""
    tips = np.asarray(profile.tool_keypoints["tool_head"], dtype=np.float64)
    forward = tips - np.asarray(profile.tool_keypoints["tool_tail"], dtype=np.float64)
    across = np.asarray(profile.tool_keypoints["tool_side"], dtype=np.float64) - tips
    forward, across = forward / np.linalg.norm(forward), across / np.linalg.norm(across)
    eye = tips + side * DISTANCE * np.cross(forward, across) - BEHIND * forward
    looks = (tips - eye) / np.linalg.norm(tips - eye)
    down = forward - forward @ looks * looks
    down /= np.linalg.norm(down)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.column_stack([np.cross(down, looks), down, looks]), eye
    flat = Camera.looking(f"close_up_{side:+.0f}", (0, 0, 1), (1, 0, 0), width=size, height=size, fov=FIELD_OF_VIEW)
    return replace(flat, T_base_camera=pose, link=profile.hand_link)


def _hidden(view: View) -> float:
    """Return the fraction of the picture's centre in which something hides the fingertips."""
    third = view.depth.shape[0] // 3
    middle = view.depth[third : 2 * third, third : 2 * third]
    return float(np.mean((middle > 0) & (middle < np.hypot(DISTANCE, BEHIND) - BLOCKED)))
