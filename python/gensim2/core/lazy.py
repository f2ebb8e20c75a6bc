"""Import the names of a package on first access (PEP 562)."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from functools import cache
from typing import Any


def lazy_names(package: str) -> Callable[[str], Any]:
    """Return ``__getattr__`` for a package.

    The function imports a name of the package's ``if TYPE_CHECKING:`` block when the name is first used.

    Args:
        package: ``__name__`` of the package.
    """

    def get(name: str) -> Any:
        if name.startswith("__") or name not in (modules := _imported(package)):
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(modules[name]), name)

    return get


@cache
def _imported(package: str) -> dict[str, str]:
    """Return the names that a package imports in its ``if TYPE_CHECKING:`` block, with the module of each name."""
    import ast  # imported here, because most programs do not need the parser

    loader: Any = sys.modules[package].__loader__
    tree = ast.parse(loader.get_source(package))
    blocks = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    lines = (line for block in blocks for line in block.body if isinstance(line, ast.ImportFrom))
    return {alias.name: str(line.module) for line in lines for alias in line.names}
