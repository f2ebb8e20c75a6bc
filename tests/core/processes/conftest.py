"""Workers import the jobs of this folder by name, so it is on the path for as long as the tests run."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
