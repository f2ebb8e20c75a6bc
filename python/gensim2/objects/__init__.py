"""Provide models of articulated and rigid objects, generated or real.

Names are imported on first use. A program that only holds an object loads no package that reads or generates objects.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names
from gensim2.objects.types import (
    ArticulatedObject,
    AssetError,
    Grip,
    Keypoint,
    Kind,
    MovingJoint,
    ObjectModel,
    Placement,
    RigidObject,
    Source,
)

if TYPE_CHECKING:
    from gensim2.objects.library.catalogue import ClassListing, Library, listing, open_library

__all__ = [
    "ArticulatedObject",
    "AssetError",
    "ClassListing",
    "Grip",
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

__getattr__ = lazy_names(__name__)
