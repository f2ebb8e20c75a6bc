"""What objects are: articulated and rigid ones, generated and real, one value for each kind.

Libraries are imported when asked for: whoever only holds an object needs none of what makes and reads them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from gensim2.objects.errors import AssetError
from gensim2.objects.rigid import Grip, RigidObject
from gensim2.objects.types import Instance, Keypoint, Kind, MovingJoint, ObjectModel, Placement, Source

if TYPE_CHECKING:
    from gensim2.objects.library.catalogue import ClassListing, Library, listing, open_library

__all__ = [
    "AssetError",
    "ClassListing",
    "Grip",
    "Instance",
    "Keypoint",
    "Kind",
    "Library",
    "MovingJoint",
    "ObjectModel",
    "Placement",
    "RigidObject",
    "Source",
    "listing",
    "open_library",
]

_OF_LIBRARIES = ("ClassListing", "Library", "listing", "open_library")


def __getattr__(name: str) -> Any:
    if name not in _OF_LIBRARIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.library.catalogue"), name)
