"""Rigid objects: generated ones of everyday kinds, and readers for real ones."""

from gensim2.assets.rigid.library import RigidLibrary, has_rigid_objects, open_rigid_library
from gensim2.assets.rigid.types import Grip, RigidKeypoint, RigidObject

__all__ = ["Grip", "RigidKeypoint", "RigidLibrary", "RigidObject", "has_rigid_objects", "open_rigid_library"]
