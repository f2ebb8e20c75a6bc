"""What objects are: articulated and rigid ones, generated and real, one value for each kind.

Libraries are imported when asked for: whoever only holds an object needs none of what makes and reads them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from gensim2.objects.errors import AssetError
from gensim2.objects.rigid import Grip, RigidKeypoint, RigidObject
from gensim2.objects.types import Instance, Keypoint, MovingJoint, Placement

if TYPE_CHECKING:
    from gensim2.objects.library.articulated import ClassListing, Library, listing, open_library
    from gensim2.objects.library.rigid import RigidLibrary, has_rigid_objects, open_rigid_library

__all__ = [
    "AssetError",
    "ClassListing",
    "Grip",
    "Instance",
    "Keypoint",
    "Library",
    "MovingJoint",
    "Placement",
    "RigidKeypoint",
    "RigidLibrary",
    "RigidObject",
    "has_rigid_objects",
    "listing",
    "open_library",
    "open_rigid_library",
]

_MODULES = {
    "ClassListing": "articulated",
    "Library": "articulated",
    "RigidLibrary": "rigid",
    "has_rigid_objects": "rigid",
    "listing": "articulated",
    "open_library": "articulated",
    "open_rigid_library": "rigid",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.library.{_MODULES[name]}"), name)
