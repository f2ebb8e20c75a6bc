"""Classes of generated objects: each module of this package holds one class, or several of one kind of thing."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from gensim2.objects.generators.blueprint import ObjectClass


@cache
def object_classes() -> dict[str, ObjectClass]:
    """Return every class that a module of this package holds, by name, sorted."""
    values = (value for name in class_modules() for value in vars(importlib.import_module(name)).values())
    return dict(sorted((each.name, each) for each in values if isinstance(each, ObjectClass)))


@cache
def class_modules() -> tuple[str, ...]:
    """Modules of this package, helpers included, by their full names."""
    return tuple(sorted(f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__)))
