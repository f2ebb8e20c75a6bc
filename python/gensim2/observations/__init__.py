"""What a policy sees, made of depth pictures: the same code for a simulated camera and a real one."""

from __future__ import annotations

from gensim2.observations.camera import Camera

__all__ = ["Camera"]
