"""Articulated and rigid objects from one source."""

from __future__ import annotations

from pathlib import Path

from gensim2.errors import InputError
from gensim2.objects import Library, RigidLibrary, RigidObject, has_rigid_objects, open_library, open_rigid_library
from gensim2.objects.library.articulated import BUILTIN
from gensim2.objects.types import Instance

ONLY = "0"
"""Id of a rigid object, which is the only instance of its class."""


class _BothLibraries:
    """A rigid object's name is its class; where a folder lacks it, the generated one of that name stands in."""

    def __init__(self, articulated: Library, rigid: RigidLibrary) -> None:
        self._articulated, self._rigid = articulated, rigid
        self._generated = open_rigid_library(BUILTIN)

    def _is_rigid(self, asset_class: str) -> bool:
        known = (*self._rigid.names(), *self._generated.names())
        return asset_class not in self._articulated.classes() and asset_class in known

    def instances(self, asset_class: str, /) -> tuple[str, ...]:
        return (ONLY,) if self._is_rigid(asset_class) else self._articulated.instances(asset_class)

    def choose(self, asset_class: str, which: str, /) -> tuple[str, ...]:
        if not self._is_rigid(asset_class):
            return self._articulated.choose(asset_class, which)
        if which not in ("all", "train", ONLY):
            raise InputError(f"{asset_class} has no instance {which!r}", field="instance", remedy=f"only {ONLY!r}")
        return (ONLY,)

    def load(self, asset_class: str, instance_id: str, /) -> Instance | RigidObject:
        if not self._is_rigid(asset_class):
            return self._articulated.load(asset_class, instance_id)
        own = asset_class in self._rigid.names()
        return (self._rigid if own else self._generated).load(asset_class)


def with_rigid_objects(assets: str | Path | Library | None) -> _BothLibraries:
    """A library of articulated objects, and the rigid ones that lie beside it."""
    library = assets if isinstance(assets, Library) else open_library(assets)
    place = Path(library.location)
    beside = library.location != BUILTIN and has_rigid_objects(place)
    return _BothLibraries(library, open_rigid_library(place if beside else BUILTIN))
