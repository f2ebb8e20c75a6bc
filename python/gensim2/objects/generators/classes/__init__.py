"""Classes of generated objects; each module defines one class or a few related classes."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from gensim2.objects.generators.blueprint import ObjectClass


@cache
def object_classes() -> dict[str, ObjectClass]:
    """Return all classes that the modules of this package define, by class name in alphabetical order."""
    values = (value for name in class_modules() for value in vars(importlib.import_module(name)).values())
    return dict(sorted((each.name, each) for each in values if isinstance(each, ObjectClass)))


@cache
def class_modules() -> tuple[str, ...]:
    """Return the full names of this package's modules, including helper modules."""
    return tuple(sorted(f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__)))
