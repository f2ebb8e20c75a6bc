"""Classes of generated objects: one module each, found by its name."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from gensim2.objects.generators.blueprint import ObjectClass


@cache
def object_classes() -> dict[str, ObjectClass]:
    """Every class of this package by name, sorted; a module that starts with an underscore is no class."""
    found = {}
    for module in pkgutil.iter_modules(__path__):
        if not module.name.startswith("_"):
            value = importlib.import_module(f"{__name__}.{module.name}").OBJECT_CLASS
            found[value.name] = value
    return dict(sorted(found.items()))


@cache
def class_modules() -> tuple[str, ...]:
    """Modules of this package, helpers included, by their full names."""
    return tuple(sorted(f"{__name__}.{module.name}" for module in pkgutil.iter_modules(__path__)))
