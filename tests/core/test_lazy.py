"""Lazy names of packages agree with those that type checkers see."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest

import gensim2

LAZY = sorted(
    ".".join(path.parent.relative_to(Path(gensim2.__file__).parents[1]).parts)
    for path in Path(gensim2.__file__).parent.rglob("__init__.py")
    if "lazy_names(__name__)" in path.read_text()
)

pytestmark = pytest.mark.fast


@pytest.mark.parametrize("package", ["gensim2", "gensim2.rollout", "gensim2.objects"])
def test_every_name_that_is_offered_can_be_had(package: str) -> None:
    module = importlib.import_module(package)
    assert package in LAZY
    for name in module.__all__:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        _ = module.nonsense


@pytest.mark.parametrize("package", LAZY)
def test_what_type_checkers_see_is_offered(package: str) -> None:
    source = importlib.import_module(package).__spec__.loader.get_source(package)
    tree = ast.parse(source)
    blocks = [node for node in tree.body if isinstance(node, ast.If)]
    names = {
        alias.name
        for block in blocks
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
    offered = next(
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    )
    assert names
    assert names <= set(offered)
