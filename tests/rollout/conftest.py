"""Spawned workers import the jobs of this folder by name, so it is on the path for as long as the tests run;
so is the made-up world of runs that are killed."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "kill")]
