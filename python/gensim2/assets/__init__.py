"""Articulated objects: a generated library, a reader of real ones, one value for both."""

from gensim2.assets.errors import AssetError
from gensim2.assets.library import ClassListing, Library, listing, open_library
from gensim2.assets.types import Instance, Keypoint, MovingJoint, Placement

__all__ = [
    "AssetError",
    "ClassListing",
    "Instance",
    "Keypoint",
    "Library",
    "MovingJoint",
    "Placement",
    "listing",
    "open_library",
]
