"""Generated instances: a pure function of (class, number)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import numpy as np

from gensim2.assets.blueprint import Blueprint
from gensim2.assets.classes import object_classes
from gensim2.assets.model import Model, from_blueprint
from gensim2.assets.shapes import Solid
from gensim2.seeding import rng

LICENSE = "Apache-2.0"


def blueprint(asset_class: str, number: int) -> Blueprint:
    """Draw the blueprint of one instance."""
    return object_classes()[asset_class].build(rng(0, f"assets/{asset_class}", number))


def blueprint_hash(asset_class: str, number: int, drawn: Blueprint) -> str:
    """Hex digest of all geometry, to a nanometre, so that it is the same on every machine."""
    digest = hashlib.sha256(f"{asset_class}/{number}".encode())

    def add(values: object) -> None:
        rounded = np.round(np.asarray(values, float) * 1e9) + 0.0
        digest.update(rounded.astype(np.int64).tobytes())

    def add_solids(solids: Iterable[Solid]) -> None:
        for solid in solids:
            if solid.hull is not None:
                add(solid.hull)
            if solid.mesh is not None:
                add(solid.mesh.vertices)
                add([*solid.mesh.look.rgba, solid.mesh.look.metallic, solid.mesh.look.roughness])

    add_solids(drawn.body)
    add_solids(drawn.moving)
    add(drawn.joint_origin)
    add(drawn.joint_axis)
    add(drawn.limits)
    for name, (position, description) in sorted(drawn.keypoints.items()):
        digest.update(f"{name}: {description}".encode())
        add(position)
    return digest.hexdigest()


def generate(asset_class: str, number: int) -> Model:
    """The model of instance ``number`` of a class."""
    drawn = blueprint(asset_class, number)
    return from_blueprint(asset_class, number, drawn, blueprint_hash(asset_class, number, drawn), LICENSE)
