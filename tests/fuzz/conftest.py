"""Makes ``mutate`` importable by name, for the tests here and for the long run."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
