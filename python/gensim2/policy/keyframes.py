"""Keyframes of demonstrations: where the hand stands still on its way (James and Davison 2022, C2F-ARM)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.signal import find_peaks

KEY_POSITIONS, KEY_ROTATIONS = "keyframe_positions", "keyframe_rotations"
"""Names of targets, (B, K, 3) m and (B, K, 3, 3): the tool at its next keyframes, in the frame that it has now. NaN
where nothing is known of them."""
REST = 0.3
"""Rad/s of the fastest joint's target below which the arm counts as standing still, where it is slowest."""
APART = 5
"""Control steps between two keyframes at least."""
MOVES = 0.1
"""Rad/s of the fastest joint's target above which the arm moves."""
BEFORE, BEHIND = 1, 3
"""Control steps before an arm sets off and behind its coming to its end that still teach something."""
FINGERS = 1e-3
"""Metres in a control step by which the distance of the pads changes where the fingers move."""


def keyframes(actions: npt.NDArray[np.float32], control_hz: float) -> npt.NDArray[np.int64]:
    """Return the numbers of an episode's keyframes, rising; the last one is where the arm has come to its end.

    Args:
        actions: (T, m) targets of the arm's joints, rad.
        control_hz: actions a second.
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
    """Return which frames are worth learning from, (T,).

    Where nothing moves before the arm sets off, and where it rests until a judge has seen enough, all frames look the
    same and a policy would learn to wait. Frames in which the fingers close before that are kept: an episode begins in
    them.

    Args:
        actions: (T, m) targets of the arm's joints, rad.
        widths: (T,) distance of the pads, m.
        control_hz: actions a second.
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
    """Return the numbers of the next keyframes behind each frame, (frames, count); the last one, again, where none is.

    A keyframe is at hand until a step before it.
    """
    first = np.searchsorted(keys, np.arange(frames) + 1, side="right")
    found: npt.NDArray[np.int64] = keys[np.minimum(first[:, None] + np.arange(count), len(keys) - 1)]
    return found


def _speed(actions: npt.NDArray[np.float32], control_hz: float) -> npt.NDArray[np.float32]:
    """(T - 1,) rad/s of the fastest joint's target."""
    found: npt.NDArray[np.float32] = np.abs(np.diff(actions, axis=0)).max(1, initial=0.0) * control_hz
    return found
