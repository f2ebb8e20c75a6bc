"""Check, without moving the arm, everything that a run needs."""

from __future__ import annotations

import importlib.util
import shutil
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from gensim2.core.errors import GenSim2Error
from gensim2.robots import robot
from gensim2_robot.arm_limits import CYCLE, ArmLimits
from gensim2_robot.limits import RefusedError, begin, limit
from gensim2_robot.log import MAX_BYTES

MODULES = {"mcap": "robot", "sapien": "sim", "embreex": "sim", "fpsample": "sim"}
"""Modules that a simulated run imports, and the extra that installs each module."""
WAKE_UPS = 100


def check(robot_name: str, folder: Path) -> list[dict[str, Any]]:
    """Run all checks. Return the name of each check, whether it passed, and a finding in words.

    Args:
        folder: folder in which a run would write its log.
    """
    found = []
    for module, extra in MODULES.items():
        there = importlib.util.find_spec(module) is not None
        found.append(_said(module, there, "installed" if there else f"pip install 'gensim2[{extra}]'"))
    room = shutil.disk_usage(folder).free
    found.append(
        _said("room for the log", room > MAX_BYTES, f"{room / 2**30:.1f} GiB free, {MAX_BYTES / 2**30:.0f} wanted")
    )
    late = _lateness()
    worst = max(late)
    found.append(
        _said("clock", worst < CYCLE, f"woken {statistics.median(late) * 1e3:.2f} ms late, {worst * 1e3:.1f} at worst")
    )
    try:
        limits = ArmLimits.of(robot(robot_name))
        sent = begin(robot(robot_name).reset_qpos[: limits.size], limits)
        found.append(_said("start", True, "within the limits, clear of itself and of the table"))
        begun = time.perf_counter()
        for step in range(WAKE_UPS):
            sent = limit(sent, sent.q + 0.01 * np.sin(0.1 * step), limits)
        spent = (time.perf_counter() - begun) / WAKE_UPS
        found.append(_said("limits", spent < 0.2 * CYCLE, f"{1e3 * spent:.2f} ms a command of {1e3 * CYCLE:.0f}"))
    except (RefusedError, GenSim2Error) as error:
        found.append(_said("start", False, str(error)))
    return found


def _lateness() -> list[float]:
    """Measure how late this process wakes up after waiting, and return the delays, s."""
    found = []
    for _ in range(WAKE_UPS):
        due = time.monotonic() + 2e-3
        time.sleep(2e-3)
        found.append(max(0.0, time.monotonic() - due))
    return found


def _said(name: str, fine: bool, found: str) -> dict[str, Any]:
    return {"name": name, "fine": fine, "found": found}
