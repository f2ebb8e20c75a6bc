"""Workers import the jobs of this folder and the fake world by name, so both are added to the path."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "kill")]
