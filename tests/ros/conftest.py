"""Plug-ins are distributions of their own, which the test environment does not install."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "plugins/gensim2_ros"))
