"""Find keyframes of demonstrations: frames in which the hand nearly stands still (James and Davison 2022, C2F-ARM)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.signal import find_peaks

KEY_POSITIONS, KEY_ROTATIONS = "keyframe_positions", "keyframe_rotations"
"""Names of the targets for the tool's pose at its next K keyframes, in the present tool frame: positions (B, K, 3), m,
and rotations (B, K, 3, 3). Unknown poses are NaN.
"""
REST = 0.3
"""Speed (rad/s) of the fastest joint below which a local minimum of the speed is a keyframe."""
APART = 5
"""Minimum number of control steps between two keyframes."""
MOVES = 0.1
"""Speed (rad/s) of the fastest joint above which the arm counts as moving."""
BEFORE, BEHIND = 1, 3
"""Number of frames before the arm starts, and after it has stopped, that are still used for training."""
FINGERS = 1e-3
"""Change of the finger distance (m) in a control step above which the fingers count as moving."""


def keyframes(actions: npt.NDArray[np.float32], control_hz: float) -> npt.NDArray[np.int64]:
    """Return the frame numbers of an episode's keyframes, ascending. At the last keyframe the arm has stopped.

    Args:
        actions: (T, m) targets of the arm's joints, rad.
        control_hz: control rate, Hz.
    """
    speed = _speed(actions, control_hz)
    moving = np.flatnonzero(speed > MOVES)
    if not len(moving):
        return np.array([len(actions) - 1], dtype=np.int64)
    end = int(moving[-1]) + 1
    slow, _ = find_peaks(-speed[:end], height=-REST, distance=APART)
    between = slow[(slow > moving[0]) & (slow <= end - APART)]
    return np.append(between, end).astype(np.int64)


def taught_frames(
    actions: npt.NDArray[np.float32], widths: npt.NDArray[np.float32], control_hz: float
) -> npt.NDArray[np.bool_]:
    """Return a mask (T,) of the frames that are used for training.

    Most frames before the arm starts and after it stops are left out. Such frames look alike and would teach the policy
    to wait. Frames in which the fingers move before the arm starts are kept.

    Args:
        actions: (T, m) targets of the arm's joints, rad.
        widths: (T,) distance of the finger pads, m.
        control_hz: control rate, Hz.
    """
    speed = _speed(actions, control_hz)
    moving = np.flatnonzero(speed > MOVES)
    if not len(moving):
        return np.ones(len(actions), dtype=bool)
    taught = np.zeros(len(actions), dtype=bool)
    begin = max(int(moving[0]) - BEFORE, 0)
    taught[:begin] = np.abs(np.diff(widths))[:begin] > FINGERS
    taught[begin : int(moving[-1]) + BEHIND + 1] = True
    return taught


def next_keyframes(keys: npt.NDArray[np.int64], frames: int, count: int) -> npt.NDArray[np.int64]:
    """Return the indices of the next ``count`` keyframes of each frame, (frames, count).

    The list of a keyframe starts with the keyframe after it. If too few keyframes remain, the last one is repeated.
    """
    first = np.searchsorted(keys, np.arange(frames) + 1, side="right")
    found: npt.NDArray[np.int64] = keys[np.minimum(first[:, None] + np.arange(count), len(keys) - 1)]
    return found


def _speed(actions: npt.NDArray[np.float32], control_hz: float) -> npt.NDArray[np.float32]:
    """Return the speed (T - 1,), rad/s, at which the target of the fastest joint moves."""
    found: npt.NDArray[np.float32] = np.abs(np.diff(actions, axis=0)).max(1, initial=0.0) * control_hz
    return found
