"""Classes of generated objects, one or a few related ones in each module."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from gensim2.objects.generators.blueprint import ObjectClass


@cache
def object_classes() -> dict[str, ObjectClass]:
    """Return every class of this package's modules by name, sorted."""
    values = (value for name in class_modules() for value in vars(importlib.import_module(name)).values())
    return dict(sorted((each.name, each) for each in values if isinstance(each, ObjectClass)))


@cache
def class_modules() -> tuple[str, ...]:
    """Return the full names of this package's modules, helpers included."""
    return tuple(sorted(f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__)))
